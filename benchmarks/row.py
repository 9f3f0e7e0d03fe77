"""One measured line, and how it is timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What was timed, how long one unit took (s), its error, and what it is compared with."""

    what: str
    seconds: float
    error: str
    against: str = ""

    def time_text(self) -> str:
        """The time with a readable unit."""
        for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
            if self.seconds >= size:
                return f"{self.seconds / size:.3g} {unit}"
        return f"{self.seconds / 1e-9:.3g} ns"

    def as_json(self) -> dict[str, object]:
        """Plain types for the JSON file."""
        return asdict(self)


def best_seconds(action: Callable[[], object], repeats: int = 5) -> float:
    """Least of several wall-clock times of one call, after one to warm up."""
    action()
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)
