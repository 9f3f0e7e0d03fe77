"""Picture of a verification: measured motion in its predicted envelope, force beside its law.

Beside them stands each comparison, what is measured above what is predicted.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import UNITS
from tune.documents.profile import Design
from tune.verification.comparison import Verification
from tune.verification.motion import binding_stiffness
from tune.verification.outcome import Verdict, moment_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]
Range = tuple[float, float]

#: Inches.
_WIDTH, _HEIGHT = 12.0, 7.5
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


def verification_picture(profile: Design, seen: Verification) -> Figure:
    """Motion, force and what the law leaves of it; beside them each comparison, seen and predicted.

    What agrees is green, what disagrees red and lies outside of its predicted range.
    """
    from identification import NotebookFigure, legend_above

    figure = NotebookFigure(figsize=(_WIDTH, _HEIGHT), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.7, 1))
    above = figure.add_subplot(grid[0, 0])
    below, left = (figure.add_subplot(grid[row, 0], sharex=above) for row in (1, 2))
    units = UNITS[profile.device.motion]
    length, force = units["length"], units["force"]
    _motion(above, profile, seen)
    above.set_ylabel(f"position, {length}")
    time, said = seen.trajectory.time, "law of the profile on the logged positions"
    below.plot(time, seen.trajectory.force, color="0.5", lw=2, label="logged")
    below.plot(time, seen.law.predicted, color="tab:blue", lw=0.8, ls="--", label=said)
    below.set_ylabel(f"force, {force}")
    _residual(left, seen)
    left.set_ylabel(f"force less law, {force}")
    left.set_xlabel("time, s")
    for axes in (above, below, left):
        legend_above(axes)
    _draw_measured(figure.add_subplot(grid[:, 1]), seen)
    gain = f" at gain {seen.gain:.3g}" if np.isfinite(seen.gain) else ""
    figure.suptitle(
        f"{seen.source}: {moment_in_words(seen.elements)}{gain} on {profile.device.name}",
        fontsize=10,
    )
    return figure


def _residual(axes: Axes, seen: Verification) -> None:
    """What the law leaves of the force, on the scale of the force where the two disagree."""
    verdict = next((each.verdict for each in seen.outcomes if each.check == "law"), "agrees")
    left = seen.trajectory.force - seen.law.predicted
    color = "tab:red" if verdict == "disagrees" else "tab:green"
    axes.plot(seen.trajectory.time, left, color=color, lw=0.8, label=f"law {verdict}")
    most = float(np.nanmax(np.abs(seen.trajectory.force), initial=0.0))
    if most > 0:
        axes.set_ylim(-most, most)


def _motion(axes: Axes, profile: Design, seen: Verification) -> None:
    trajectory, motion = seen.trajectory, seen.motion
    axes.plot(trajectory.time, trajectory.position, color="0.5", lw=2, label="logged")
    if motion is None or motion.measured is None:
        return
    measured = motion.measured
    axes.plot(
        trajectory.time[measured.rows], measured.fitted, color="tab:orange", lw=0.8, label="fitted"
    )
    prediction, played = motion.prediction, seen.law.effects
    if motion.release is None or played is None or not measured.frequency:
        return
    free = slice(motion.release.first, motion.release.end)
    since = trajectory.time[free] - trajectory.time[motion.release.first]
    rest = trajectory.position[motion.release.first] - motion.release.deviation
    friction = profile.device.coulomb_friction
    stiffness = binding_stiffness(profile.device, played)
    start = abs(motion.release.deviation)
    wide, narrow = (
        _envelope(start, decay, each / stiffness, frequency, since)
        for decay, each, frequency in zip(
            prediction.decay, (friction.low, friction.high), prediction.frequency, strict=True
        )
    )
    nominal = prediction.nominal
    axes.plot(
        trajectory.time[free],
        rest
        + np.sign(motion.release.deviation)
        * _envelope(start, nominal.decay, friction.value / stiffness, nominal.frequency, since)
        * np.cos(2 * np.pi * nominal.frequency * since),
        color="tab:green",
        lw=0.8,
        ls="--",
        label="predicted at best",
    )
    for side in (1, -1):
        axes.fill_between(
            trajectory.time[free],
            rest + side * narrow,
            rest + side * wide,
            color="tab:green",
            alpha=0.4,
            lw=0.8,
            label="predicted envelope" if side > 0 else None,
        )


def _envelope(
    start: float, decay: float, held: float, frequency: float, since: FloatArray
) -> FloatArray:
    """Amplitude with exponential decay and Coulomb friction, which takes 2·x_f a half-cycle, m.

    A' = -decay·A - 4·f·x_f, until nothing is left.
    """
    rate = 4 * frequency * held
    if decay == 0:
        return np.maximum(start - rate * since, 0.0)
    return np.maximum((start + rate / decay) * np.exp(-decay * since) - rate / decay, 0.0)


def _ranges_of(seen: Verification) -> dict[str, tuple[Range, Range]]:
    """(seen, predicted) of every comparison that is one of two ranges, by its check."""
    found: dict[str, tuple[Range, Range]] = {
        f"{each.name} filter": ((each.low, each.high), (each.stated, each.stated))
        for each in seen.cutoffs
    }
    motion = seen.motion
    if motion is not None and motion.measured is not None:
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


def _draw_measured(axes: Axes, seen: Verification) -> None:
    """Every comparison in words; those of two ranges also as bars on one scale."""
    ranges = _ranges_of(seen)
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
