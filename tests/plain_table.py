"""A plain log as a table of text, written by formatting its numbers otherwise."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from identification import LogColumns, Trajectory, load_trajectory

ROWS = 300
TIME = np.arange(ROWS) * 1e-3
FORCE = 2.5 * np.sin(40 * TIME) + 0.125
POSITION = 0.01 * np.cos(33 * TIME) - 0.002
PLAIN = ("time", "force", "position")


def table(
    header: Sequence[str] | str = PLAIN,
    *,
    between: str = ",",
    decimal: str = ".",
    sizes: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> str:
    """The log as text: each column divided by the size of its unit, ten digits."""
    names = header if isinstance(header, str) else between.join(header)
    rows = zip(TIME / sizes[0], FORCE / sizes[1], POSITION / sizes[2], strict=True)
    lines = [between.join(f"{x:.10f}".replace(".", decimal) for x in row) for row in rows]
    return "\n".join([names, *lines]) + "\n"


def load(folder: Path, text: str | bytes, name: str = "log.csv", **asked: Any) -> Trajectory:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return load_trajectory(path, LogColumns(**asked))


def assert_is_the_plain_log(log: Trajectory) -> None:
    for found, true in ((log.time, TIME), (log.force, FORCE), (log.position, POSITION)):
        np.testing.assert_allclose(found, true, rtol=1e-8, atol=1e-10)


def in_lines(text: str, change: Callable[[list[str]], list[str]]) -> str:
    return "\n".join(change(text.splitlines())) + "\n"


MILLI = (1e-3, 1e-3, 1e-3)
DEGREES = (1.0, 1e-3, math.pi / 180)
TEXT = table()
