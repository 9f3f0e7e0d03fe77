"""Measured free motion: its frequency and decay against the poles of the loop.

One file: what is measured, predicted and concluded of one release.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile
from tune.verification.consistent_loops import MeasuredMode
from tune.verification.free_motion import FreeMotion, measure_sprung, measure_unsprung
from tune.verification.motion_outcomes import (
    DECAY_TOLERANCE,
    LOUDER,
    decay_outcome,
    frequency_outcome,
    frequency_tolerance,
    judge_decay,
)
from tune.verification.outcome import Outcome, unassessed_outcome
from tune.verification.prediction import Prediction, binding_stiffness, predict
from tune.verification.release import Release, find_release

FloatArray = NDArray[np.float64]

#: Motion of which one mode leaves more than this part is no free motion of this loop.
_MISFIT = 0.05
#: Speed below this part of the largest is rest, for motion without a spring.
_SLOW = 0.03
#: Rows that free motion without a spring must last.
_FEWEST_ROWS = 50

_STILL = (
    "the handle does not move by more than noise and a few counts while the force is neither at "
    "its limit nor zero outside of a one-sided wall"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMotion:
    """The free motion and what the loop predicts of it.

    Attributes:
        release: where the motion is free, None where it was not looked for or not found.
        measured: its mode, None where no mode was measured.
        prediction: of the loop, None where nothing was predicted.
        outcomes: "frequency" and "decay".
    """

    release: Release | None
    measured: FreeMotion | None
    prediction: Prediction | None
    outcomes: tuple[Outcome, ...]

    @property
    def mode(self) -> MeasuredMode:
        """Frequency and decay, as far as they were assessed, with intervals and tolerances."""
        measured, prediction = self.measured, self.prediction
        if measured is None or prediction is None:
            return MeasuredMode(frequency=None, decay=None)
        told = {each.check for each in self.outcomes if each.verdict != "not assessed"}
        swings = "frequency" in told and self.release is not None and bool(self.release.turns)
        hertz = frequency_tolerance(prediction) * measured.frequency + measured.frequency_half
        slack = DECAY_TOLERANCE * prediction.nominal.decay + measured.decay_half
        return MeasuredMode(
            frequency=(measured.frequency - hertz, measured.frequency + hertz) if swings else None,
            decay=(measured.decay - slack, measured.decay + slack) if "decay" in told else None,
        )


def judge_motion(
    device: Device,
    loop: LoopProfile,
    effects: Effects,
    position: FloatArray,
    used: NDArray[np.bool_],
    sample_time: float,
    first: int,
) -> MeasuredMotion:
    """Compare the free motion of a log with the slowest mode of a loop.

    Args:
        device: with its intervals.
        loop: the filters that were run.
        effects: as played.
        position: m, shape (n,).
        used: rows neither saturated nor outside of a one-sided wall, shape (n,).
        sample_time: of the log, s.
        first: row before which the motion is not free.
    """
    prediction = predict(device, loop, effects)
    release = find_release(position, first)
    if release is not None and release.grows:
        return _growing(release, prediction)
    hindered = obstacle(prediction)
    if hindered is not None:
        return _unseen(hindered, "", prediction)
    if release is not None and not np.all(used[release.first : release.end]):
        last = int(np.flatnonzero(~used[first:])[-1])
        release = find_release(position, first + last + 1)
    if release is None:
        return _unseen(_STILL, LOUDER, prediction)
    stiffness = binding_stiffness(device, effects)
    if not stiffness:
        return _unsprung(position, sample_time, release, prediction)
    nominal, known = prediction.nominal, device.coulomb_friction
    measured = measure_sprung(
        position,
        sample_time,
        release,
        (nominal.natural, nominal.decay),
        (known.value / stiffness, known.low / stiffness, known.high / stiffness),
    )
    if measured.misfit > _MISFIT:
        return _not_one_mode(measured, release, prediction)
    friction = None if measured.friction is None else measured.friction * stiffness
    return MeasuredMotion(
        release=release,
        measured=measured,
        prediction=prediction,
        outcomes=(
            frequency_outcome(measured, release, prediction, effects, device),
            decay_outcome(
                measured, len(release.turns), prediction, device, loop, effects, friction
            ),
        ),
    )


def obstacle(prediction: Prediction) -> str | None:
    """Why the loop predicts no single mode to compare with."""
    if prediction.decay[0] <= 0:
        return (
            f"at this gain the loop is predicted to decay by {prediction.decay[0]:.3g} to "
            f"{prediction.decay[1]:.3g} 1/s, so it may not come to rest at all"
        )
    if not prediction.single:
        return "the loop is predicted to come to rest in several modes of like decay"
    return None


def _unsprung(
    position: FloatArray, sample_time: float, release: Release, prediction: Prediction
) -> MeasuredMotion:
    """Decay of speed after a push, from the fastest row on."""
    from scipy.ndimage import uniform_filter1d

    width = max(5, round(0.02 / sample_time))
    speed = np.abs(np.gradient(uniform_filter1d(position, width)))
    top = int(np.argmax(speed[release.first : release.end])) + release.first
    slow = np.flatnonzero(speed[top:] < _SLOW * speed[top])
    end = top + int(slow[0]) if slow.size else position.size
    no_frequency = unassessed_outcome(
        "frequency", "nothing holds the position, so nothing oscillates"
    )
    if end - top < _FEWEST_ROWS:
        rows = end - top
        why = f"the handle moves freely for {rows} rows only"
        decay = unassessed_outcome("decay", why, LOUDER, rows=rows)
        return MeasuredMotion(
            release=None, measured=None, prediction=prediction, outcomes=(no_frequency, decay)
        )
    measured = measure_unsprung(position, sample_time, top, end, prediction.nominal.decay)
    if measured.misfit > _MISFIT:
        return _not_one_mode(measured, release, prediction)
    return MeasuredMotion(
        release=release,
        measured=measured,
        prediction=prediction,
        outcomes=(no_frequency, judge_decay(measured, 0, prediction, "", "")),
    )


def _growing(release: Release, prediction: Prediction) -> MeasuredMotion:
    low, high = prediction.decay
    return MeasuredMotion(
        release=release,
        measured=None,
        prediction=prediction,
        outcomes=(
            unassessed_outcome("frequency", "the motion grows"),
            Outcome(
                check="decay",
                verdict="disagrees",
                seen="the swings grow until the log ends",
                predicted=f"{low:.4g} to {high:.4g} 1/s",
                tolerance="decay",
                remedy="Do not raise the gain. Check the sign of force and position, the filters "
                "and the delay of the controller.",
                numbers={"predicted_low": low, "predicted_high": high},
            ),
        ),
    )


def _not_one_mode(measured: FreeMotion, release: Release, prediction: Prediction) -> MeasuredMotion:
    why = (
        f"one damped mode with Coulomb friction leaves {measured.misfit:.1%} of the motion, at "
        f"most {_MISFIT:.0%} is free motion"
    )
    remedy = "Take the hand off, and state with --release when; or cut the log to the free motion."
    return MeasuredMotion(
        release=release,
        measured=measured,
        prediction=prediction,
        outcomes=(
            unassessed_outcome("frequency", why, remedy),
            unassessed_outcome("decay", why, remedy),
        ),
    )


def _unseen(why: str, remedy: str, prediction: Prediction) -> MeasuredMotion:
    return MeasuredMotion(
        release=None,
        measured=None,
        prediction=prediction,
        outcomes=(
            unassessed_outcome("frequency", why, remedy),
            unassessed_outcome("decay", why, remedy),
        ),
    )
