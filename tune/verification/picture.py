"""Picture of a verification: measured motion in its predicted envelope, force beside its law."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Design
from tune.verification.comparison import Verification
from tune.verification.elements import spoken
from tune.verification.prediction import binding_stiffness

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

_UNITS = {"linear": ("m", "N"), "rotary": ("rad", "N·m")}


def verification_picture(profile: Design, seen: Verification) -> Figure:
    """Position with fit and predicted envelope above, force with the law's prediction below."""
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(9, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    length, force = _UNITS[profile.device.motion]
    _motion(above, profile, seen)
    above.set_ylabel(f"position, {length}")
    trajectory = seen.trajectory
    below.plot(trajectory.time, trajectory.force, color="0.5", lw=2, label="logged")
    below.plot(
        trajectory.time,
        seen.law.predicted,
        color="tab:blue",
        lw=0.8,
        ls="--",
        label="law of the profile on the logged positions",
    )
    below.set_ylabel(f"force, {force}")
    below.set_xlabel("time, s")
    for axes in (above, below):
        axes.legend(fontsize=7, loc="upper right")
    words = [f"{each.check} {each.verdict}" for each in seen.outcomes]
    figure.suptitle(
        f"{seen.source}: {spoken(seen.elements)} on {profile.device.name}\n{', '.join(words)}",
        fontsize=9,
    )
    return figure


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
    if motion.release is None or prediction is None or played is None or not measured.frequency:
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
    for side in (1, -1):
        axes.fill_between(
            trajectory.time[free],
            rest + side * narrow,
            rest + side * wide,
            color="tab:green",
            alpha=0.4,
            lw=0,
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
