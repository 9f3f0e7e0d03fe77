"""Changes to the bytes, lines and words of a file, each by chance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

#: What stands in place of a number or a name.
SCALARS = (
    *("", "~", "null", "true", "no", ".nan", ".inf", "-.inf", "nan", "0", "-0.0", "1", "-1", "2.5"),
    *("1e-300", "1e-12", "1e-9", "1e-6", "1e6", "1e9", "1e12", "1e300", "1e308", "-1e308", "1e999"),
    *("9" * 30, "0x1F", "0o17", "1_000", "1:30:00", "2024-01-01", "'0.001'", '"\\0"', "'ü ☃'"),
    *("[]", "{}", "[1, 2]", "{value: 1, low: 2, high: 0}", "{value: 1, low: 0.5, high: 2}"),
    *("{min: 1, max: 2}", "max", "min", "free", "none", "linear", "rotary", "x" * 300, "!!str 3"),
    *("&a 1", "*a", "|\n  text", "? 1", "- 1", "#", "@", "`", "%", "%A", "{", "]", ":", "\t"),
)


def one_of(rng: np.random.Generator, choices: Any) -> Any:
    """One of several, by chance."""
    return choices[int(rng.integers(len(choices)))]


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content or b"?")
    for place in rng.integers(0, len(changed), int(rng.integers(1, 5))):
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(0, len(content) + 1))]


def _doubled(content: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted(int(each) for each in rng.integers(0, len(content) + 1, 2))
    return content[:last] + content[first:]


def _lines(change: Callable[[list[bytes], int, np.random.Generator], None]) -> Any:
    def changed(content: bytes, rng: np.random.Generator) -> bytes:
        lines = content.split(b"\n")
        change(lines, int(rng.integers(len(lines))), rng)
        return b"\n".join(lines)

    return changed


def _gone(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    del lines[place]


def _again(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    lines.insert(int(rng.integers(len(lines) + 1)), lines[place])


def _indented(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    lines[place] = b" " * int(rng.integers(1, 4)) + lines[place]


def _another_value(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    """A word of the line becomes a hostile one."""
    line = lines[place].decode("utf-8", "replace")
    marks = [i for i, letter in enumerate(line) if letter in " ,:{}[]"]
    first = one_of(rng, marks) + 1 if marks else 0
    ends = [mark for mark in marks if mark > first]
    last = ends[0] if ends and rng.random() < 0.7 else len(line)
    lines[place] = (line[:first] + " " + one_of(rng, SCALARS) + line[last:]).encode()


BYTE_MUTATIONS: Any = (_flipped, _cut, _doubled)
TEXT_MUTATIONS: Any = (
    *BYTE_MUTATIONS,
    *(_lines(change) for change in (_gone, _again, _indented, *[_another_value] * 6)),
)
