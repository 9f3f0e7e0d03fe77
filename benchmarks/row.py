"""One measured line, and how it is timed.

Times are of the processor: with one thread they are those of the clock on a quiet machine, and
hardly change on a busy one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median, quantiles

#: Repeats of one timing end after this long, s; the first call may take longer.
_LONG_ENOUGH = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Times the processor worked on one call, s."""

    first: float  # of the first call, with whatever it builds and keeps
    middle: float  # median of the calls after it
    spread: tuple[float, float]  # quartiles of those


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What was timed, how long one unit took (s), its error, and what it is compared with."""

    what: str
    seconds: float  # least or, with a spread, median
    error: str
    against: str = ""
    spread: tuple[float, float] | None = None  # quartiles, s
    first: float | None = None  # of the first call, s

    @classmethod
    def of(cls, what: str, timing: Timing, error: str, against: str = "") -> Row:
        """A row of a timing."""
        return cls(
            what=what,
            seconds=timing.middle,
            error=error,
            against=against,
            spread=timing.spread,
            first=timing.first,
        )

    def time_text(self) -> str:
        """The time with a readable unit, its quartiles, the first call."""
        text = with_unit(self.seconds)
        if self.spread is not None:
            text += f" ({with_unit(self.spread[0])} to {with_unit(self.spread[1])})"
        if self.first is not None:
            text += f", first {with_unit(self.first)}"
        return text


def with_unit(seconds: float) -> str:
    """A time to three digits."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def best_seconds(action: Callable[[], object], repeats: int = 5) -> float:
    """Least of several times of one call, after one to warm up."""
    action()
    return min(_seconds(action) for _ in range(repeats))


def timed(action: Callable[[], object], repeats: int = 9) -> Timing:
    """The first call, and median and quartiles of several more; fewer where they take long."""
    return timed_in_turn([action], repeats)[0]


def timed_in_turn(actions: Sequence[Callable[[], object]], repeats: int = 9) -> list[Timing]:
    """As `timed`, one call of each action after the other, so that a slow spell is shared."""
    first = [_seconds(action) for action in actions]
    turns: list[list[float]] = []
    while len(turns) < repeats and sum(map(sum, turns)) < _LONG_ENOUGH * len(actions):
        turns.append([_seconds(action) for action in actions])
    timings: list[Timing] = []
    for once, times in zip(first, zip(*turns, strict=True), strict=True):
        low, _, high = quantiles(times, n=4, method="inclusive") if len(times) > 1 else [*times] * 3
        timings.append(Timing(first=once, middle=median(times), spread=(low, high)))
    return timings


def _seconds(action: Callable[[], object]) -> float:
    start = time.process_time()
    action()
    return time.process_time() - start
