"""Picture of each comparison of a verification: what is measured above what is predicted."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from textwrap import shorten
from typing import TYPE_CHECKING

from tune.verification.comparison import Verification
from tune.verification.outcome import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Range = tuple[float, float]

_COLORS: dict[Verdict, str] = {
    "agrees": "tab:green",
    "disagrees": "tab:red",
    "cannot tell": "tab:orange",
    "not assessed": "0.5",
}
#: Letters of a line.
_LETTERS = 74
#: Height of a comparison, of its name, and of its two bars, in parts of a line of text.
_BLOCK, _SEEN, _PREDICTED = 4.0, 1.0, 1.75
#: Room on both sides of the ranges, part of all that they span; and the least of a range.
_ROOM, _LEAST = 0.25, 0.006


def ranges_of(seen: Verification) -> dict[str, tuple[Range, Range]]:
    """(seen, predicted) of every comparison that is one of two ranges, by its check."""
    found: dict[str, tuple[Range, Range]] = {
        f"{each.name} filter": ((each.low, each.high), (each.stated, each.stated))
        for each in seen.cutoffs
    }
    motion = seen.motion
    if motion is not None and motion.measured is not None and motion.prediction is not None:
        one, other = motion.measured, motion.prediction
        for check, value, half, expected in (
            ("frequency", one.frequency, one.frequency_half, other.frequency),
            ("decay", one.decay, one.decay_half, other.decay),
        ):
            found[check] = ((value - half, value + half), expected)
    allowed = seen.delay.allowed
    if allowed is not None and allowed.delays is not None:
        found["delay"] = (allowed.delays, allowed.stated)
    return found


def draw_measured(axes: Axes, seen: Verification) -> None:
    """Every comparison in words; those of two ranges also as bars on one scale.

    Args:
        axes: all of it is taken up.
        seen: a verification.
    """
    ranges = ranges_of(seen)
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(-_BLOCK * max(len(seen.outcomes), 6), 0.6)
    for place, each in enumerate(seen.outcomes):
        top, color = -_BLOCK * place, _COLORS[each.verdict]
        axes.text(0, top, f"{each.check}: {each.verdict}", color=color, fontsize=9, weight="bold")
        both = None if each.verdict == "not assessed" else ranges.get(each.check)
        words = (
            ("", each.seen)
            if each.verdict == "not assessed"
            else (f"seen {each.seen}", f"predicted {each.predicted}")
        )
        for line, text in zip((_SEEN, _PREDICTED), words, strict=True):
            axes.text(
                0, top - line, shorten(text, _LETTERS, placeholder="…"), fontsize=7, va="center"
            )
        if both is not None:
            _draw_ranges(axes, top - _PREDICTED - 0.7, both, color)


def _draw_ranges(axes: Axes, y: float, both: tuple[Range, Range], color: str) -> None:
    """The seen range above the predicted one."""
    low, high = min(side[0] for side in both), max(side[1] for side in both)
    room = _ROOM * ((high - low) or abs(high) or 1.0)
    low, high = low - room, high + room
    axes.plot([0, 1], [y - 0.2] * 2, color="0.85", lw=0.6)
    for (start, end), shift, drawn in ((both[0], 0.0, color), (both[1], -0.45, "k")):
        first, last = ((value - low) / (high - low) for value in (start, end))
        middle, half = (first + last) / 2, max((last - first) / 2, _LEAST)
        axes.barh(y + shift, 2 * half, left=middle - half, height=0.4, color=drawn, alpha=0.8, lw=0)
