"""An exported C guard, compiled and driven by the compiler of the system."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

STATUS = "OK NOT_TOGETHER NOT_ENTERED NOT_FINITE BAD_GAIN STALE LATE".split()  # noqa: SIM905
FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]

#: Reads "R elements period position rest" and "F elements period position gain".
_DRIVER = """\
#include "haptune_guard.h"
#include <stdio.h>

int main(void)
{
    static haptune_guard guard;
    char call;
    unsigned long long elements;
    unsigned long period;
    double position, last;
    haptune_init(&guard);
    while (scanf(" %c %llu %lu %lf %lf", &call, &elements, &period, &position, &last) == 5) {
        double force = 0.0;
        if (call == 'R') {
            haptune_reset(&guard, elements, (uint32_t)period, position, last);
        } else {
            force = haptune_force(&guard, elements, (uint32_t)period, position, last);
        }
        printf("%d %d %lu %.17g\\n", (int)guard.status, guard.clamped,
            (unsigned long)guard.missed, force);
    }
    return 0;
}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """What one call left behind."""

    status: str
    clamped: bool
    missed: int
    force: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A reset (``last`` is where springs rest) or a force (``last`` is the gain)."""

    kind: str
    elements: int
    period: int
    position: float
    last: float


def enter(elements: int, period: int, position: float, rest: float = 0.0) -> Call:
    """haptune_reset."""
    return Call(kind="R", elements=elements, period=period, position=position, last=rest)


def push(elements: int, period: int, position: float, gain: float = 1.0) -> Call:
    """haptune_force."""
    return Call(kind="F", elements=elements, period=period, position=position, last=gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class Guard:
    """A compiled guard; every run begins with haptune_init."""

    program: Path

    def run(self, calls: Iterable[Call]) -> list[Reply]:
        """The reply to each call."""
        text = "".join(
            f"{c.kind} {c.elements} {c.period} {c.position!r} {c.last!r}\n" for c in calls
        )
        done = subprocess.run(
            [self.program], input=text, capture_output=True, text=True, check=True, timeout=20
        )
        rows = [line.split() for line in done.stdout.splitlines()]
        assert len(rows) == text.count("\n")
        return [
            Reply(
                status=STATUS[int(row[0])],
                clamped=row[1] == "1",
                missed=int(row[2]),
                force=float(row[3]),
            )
            for row in rows
        ]


def compiler(*names: str) -> str:
    """The first of these compilers there is; skips the test where there is none."""
    found = next((name for name in names if shutil.which(name)), None)
    if found is None:
        pytest.skip(f"no compiler here: none of {', '.join(names)}")
    return found


def write(files: Mapping[str, str], folder: Path) -> None:
    """Put exported files into a folder."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def built(files: Mapping[str, str], folder: Path) -> Guard:
    """Compile without a single warning."""
    write({**files, "driver.c": _DRIVER}, folder)
    cc = compiler("cc", "gcc", "clang")
    subprocess.run(
        [cc, *FLAGS, "driver.c", "haptune_guard.c", "-o", "driver"], cwd=folder, check=True
    )
    return Guard(program=folder / "driver")


def compiles(folder: Path, *flags: str) -> str:
    """What the compiler says to the source alone, "" where it is content."""
    cc = compiler("cc", "gcc", "clang")
    done = subprocess.run(
        [cc, *FLAGS, *flags, "-c", "haptune_guard.c"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stderr if done.returncode else ""
