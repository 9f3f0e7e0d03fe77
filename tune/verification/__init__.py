"""The one verb: does a low-gain closed-loop log behave as its profile predicts? And its picture.

Clock and encoder of the log, the law, free motion and delay in their own files, and the force
ripple of the encoder against the closed form, in differences that leave nothing of the motion.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from identification import (
    Finding,
    LogRefusedError,
    Trajectories,
    Trajectory,
    UsageError,
    counted,
    typed,
)
from tune.certificate.certify import refuse_unbalanced
from tune.documents import LoopError
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import UNITS, Effects
from tune.loop.loop import Loop, filters_of
from tune.loop.polynomials import FloatArray, value_at
from tune.rendering import law_numerator
from tune.verification.delay import (
    Advice,
    Kept,
    MeasuredDelay,
    advise,
    judge_delay,
    margins_of_others,
    unknown_delay,
)
from tune.verification.directions import (
    along,
    comparable,
    judge_across,
    leading_direction,
    motion_across,
    principal_directions,
    turned_to,
)
from tune.verification.law import (
    MeasuredCutoff,
    Outcome,
    combination_in_words,
    compared,
    measured_cutoffs,
    rms,
    unassessed_outcome,
)
from tune.verification.measured_law import MeasuredLaw, digits_of, judge_law
from tune.verification.motion import MeasuredMotion, judge_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Advice", "Kept", "Outcome", "Verification"]
__all__ += ["advise", "along", "comparable", "margins_of_others", "principal_directions"]
__all__ += ["verification_picture", "verify"]


#: Count of the log against the encoder of the device.
_COUNT_TOLERANCE = 0.02
#: A grid is seen where neighbouring readings are whole counts apart within this part.
_ON_GRID = 0.05
#: A log whose steps differ from the sample time of the profile by more is of another loop.
_SAMPLE_TIME_TOLERANCE = 0.01
#: A step this many times the usual one has lost a row, which the filters of the law need.
_LOST = 1.5
#: rms of the steps about their mean, as part of it, above which backward differences are not those
#: of an even clock.
_MOST_JITTER = 0.05
#: Of what the axes say of their encoders, the first of these is told.
_WORST = ("disagrees", "agrees", "cannot tell", "not assessed")
#: What the loop of a profile predicts of its motion, and of its slow mode.
_OF_THE_MOTION = ("frequency", "decay", "ripple")
_OF_THE_MODE = {"frequency", "decay"}
#: What must be known to speak of agreement.
_NEEDED = {
    "law": "the law that is played",
    "frequency": "frequency or decay of the free motion",
    "decay": "frequency or decay of the free motion",
    "delay": "the margin of the profile at every delay the log allows",
}

#: The remedy of what has none of its own.
_ELSEWHERE = "What to play is said of the delay."

#: Part of Nyquist up to which the differences leave nothing of the motion, and their order.
_SLOW_MOTION, _ORDER = 1 / 60, 4
#: Counts a sample: slower, the rounding error is no white noise (docs/theory.md, 6).
_SLOWEST = 0.5
#: Rows in motion that are needed.
_FEWEST_ROWS = 100
#: Places on the upper half of the unit circle for the ripple.
_PLACES = 4096
#: Seen against predicted, either way.
_RIPPLE_TOLERANCE = 0.25

#: Of a picture: inches, and letters of a line of verdicts.
_INCHES, _LETTERS = (9.0, 7.5), 110


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What a log says about its profile.

    Attributes:
        source: the log.
        profile: that the log was compared with; of several axes, on the device in one direction.
        direction: of most of the force, a unit vector over the axes; None of one axis.
        elements: that were played.
        gain: part of the profile's effects that was played; nan where no law was recognised.
        outcomes: encoder, law, gain, filters, frequency, decay, ripple and delay, in this order;
            of several axes "across" follows the gain.
        law: the law that was seen.
        cutoffs: intervals of the filters in use.
        motion: the free motion that was seen; None where no law says what to expect.
        delay: what is known of the delay, and of which elements the log tells that they keep their
            margin.
        trajectory: the log, in the direction.
    """

    source: str
    profile: Design
    direction: tuple[float, ...] | None
    elements: tuple[str, ...]
    gain: float
    outcomes: tuple[Outcome, ...]
    law: MeasuredLaw
    cutoffs: tuple[MeasuredCutoff, ...]
    motion: MeasuredMotion | None
    delay: MeasuredDelay
    trajectory: Trajectory

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{each.check}: {each.verdict}" for each in self.outcomes)
        return (
            f"Verification({self.source}: {'+'.join(self.elements)} at gain {self.gain:.3g}; "
            f"{verdicts})"
        )

    @property
    def played(self) -> str:
        """The elements that were played and, of several axes, in which direction."""
        return f"{combination_in_words(self.elements)}{along(self.profile, self.direction)}"

    @property
    def disagreements(self) -> tuple[Outcome, ...]:
        """What is not as predicted; what another delay explains comes last."""
        explained = self.delay.allowed is not None and self.delay.allowed.delays is not None
        found = (each for each in self.outcomes if each.verdict == "disagrees")
        return tuple(sorted(found, key=lambda each: explained and each.check in _OF_THE_MODE))

    @property
    def assessed(self) -> bool:
        """Whether enough was compared to speak of agreement.

        The law, frequency or decay, and the margin on every loop that the log allows.
        """
        return {"law", "delay"} <= self._compared and bool(self._compared & _OF_THE_MODE)

    @property
    def _compared(self) -> set[str]:
        return {each.check for each in self.outcomes if each.verdict in {"agrees", "disagrees"}}

    def refuse_unassessed(self, remedy: str) -> None:
        """Raise LogRefusedError, with what to play instead, unless enough was compared."""
        if self.assessed:
            return
        known = self._compared | _OF_THE_MODE if self._compared & _OF_THE_MODE else self._compared
        needed = {check: words for check, words in _NEEDED.items() if check not in known}
        raise LogRefusedError(
            tuple(
                Finding(
                    code="delay-unknown" if each.check == "delay" else "not-exciting-damping",
                    severity="refusal",
                    seen=each.summary,
                    needed=needed[each.check],
                    remedy=remedy if each.check == "delay" else each.remedy or _ELSEWHERE,
                    source=self.source,
                )
                for each in self.outcomes
                if each.check in needed
            )
        )


@typed
def verify(
    profile: Design,
    trajectory: Trajectory | Trajectories,
    *,
    element: str | None = None,
    gain: float | None = None,
    release: float | None = None,
) -> Verification:
    """Compare a closed-loop log with what its profile predicts.

    A log of several axes is compared in the direction of most of its force, with the device as it
    moves there; across it the force must be that of the same elements, and of no wall.

    Args:
        profile: of the device the log was taken on.
        trajectory: force as the haptic controller commanded it, position as it read it; an element
            played at a reduced gain, the handle pushed or displaced, and let go.
        element: "wall", or "wall+water" for what is felt together; None is found out.
        gain: at which the element was played; None is found out.
        release: s, in the time of the log, when the hand is off; None is the largest deviation,
            without a spring the row from which speed falls as free motion does.

    Raises:
        UsageError: an element that is not in the profile, a log of other axes.
        LogRefusedError: rows lost, an uneven clock, another sample time.
        CheckFailedError: a device that no effect can be certified on.
    """
    refuse_unbalanced(profile.device)
    _check_request(profile, trajectory, gain, release)
    axes = trajectory.axes if isinstance(trajectory, Trajectories) else (trajectory,)
    _check_clock(profile, axes[0])
    encoders = [_encoder(profile, each) for each in axes]
    direction, line = None, axes[0]
    if isinstance(trajectory, Trajectories):
        direction = leading_direction([each.force for each in axes])
        profile = profile.model_copy(update={"device": profile.device.along(direction)})
        line = turned_to(trajectory, direction)
    digits = digits_of(profile, axes, direction or (1.0,))
    size = np.linalg.norm([each.force for each in axes], axis=0)
    law = judge_law(profile, comparable(profile, direction, element), line, gain, digits, size)
    told = list(law.outcomes)
    why = "" if law.effects is not None and law.gain > 0 else "no law is known that was played"
    if direction is not None:
        told.append(judge_across(profile, axes, direction, law, digits))
    motion: MeasuredMotion | None = None
    cutoffs: tuple[MeasuredCutoff, ...] = ()
    rest = tuple(unassessed_outcome(check, why) for check in _OF_THE_MOTION)
    delay = unknown_delay(why)
    if not why and law.effects is not None:
        try:
            motion = judge_motion(
                profile.device,
                law.loop,
                law.effects,
                line.position,
                law.acting,
                _step(line),
                0 if direction is None else motion_across(profile, axes, direction, law),
                None if release is None else int(np.searchsorted(line.time, release)),
            )
            ripple = _ripple(profile, line, law.loop, law.effects, motion, digits.force)
            rest = (*motion.outcomes, ripple)
            if law.outcomes[0].verdict == "agrees":
                cutoffs = measured_cutoffs(law.log, law.loop, law.effects)
                delay = judge_delay(
                    profile, law.loop, law.elements, law.effects, motion.mode, cutoffs
                )
            else:
                delay = unknown_delay("the law is not the profile's")
        except LoopError as error:  # the law was compared all the same
            rest = tuple(unassessed_outcome(check, str(error)) for check in _OF_THE_MOTION)
            delay = unknown_delay(str(error))
    filters = tuple(each.outcome for each in cutoffs)
    worst = min(encoders, key=lambda each: _WORST.index(each.verdict))
    return Verification(
        source=trajectory.source,
        profile=profile,
        direction=direction,
        elements=law.elements,
        gain=law.gain,
        outcomes=(worst, *told, *filters, *rest, delay.outcome),
        law=law,
        cutoffs=cutoffs,
        motion=motion,
        delay=delay,
        trajectory=line,
    )


def _check_request(
    profile: Design,
    trajectory: Trajectory | Trajectories,
    gain: float | None,
    release: float | None,
) -> None:
    device = profile.device
    remedy = "Give the log and the profile of one axis"
    if device.axes is not None:
        remedy = "Give --force and --position of all axes in this order, with commas between"
    for name, seen, known in (
        ("--axis", trajectory.axis, ",".join(device.axes or (device.axis,))),
        ("motion", trajectory.motion, device.motion),
    ):
        if seen is not None and seen != known:
            raise UsageError(name, f"the log is of {seen}, the profile of {known}", remedy)
    if gain is not None and not (np.isfinite(gain) and gain > 0):
        raise UsageError("--gain", f"{gain:g} is no gain", "Give a number above 0, usually below 1")
    time = trajectory.axes[0].time if isinstance(trajectory, Trajectories) else trajectory.time
    begin, end = float(time[0]), float(time[-1])
    if release is not None and not begin <= release < end:
        seen = f"{release:g} s is outside of the log, {begin:g} to {end:g} s"
        raise UsageError("--release", seen, "Give the instant in the time of the log")


def _check_clock(profile: Design, trajectory: Trajectory) -> None:
    """Refuse a log whose rows are not those of the controller's loop."""
    steps = np.diff(trajectory.time)
    usual, stated = float(np.median(steps)), profile.loop.sample_time
    known = profile.device.sample_time
    low = min(stated, known.low) * (1 - _SAMPLE_TIME_TOLERANCE)
    high = max(stated, known.high) * (1 + _SAMPLE_TIME_TOLERANCE)
    long = int(np.count_nonzero(steps > _LOST * usual))
    jitter = float(np.std(steps) / np.mean(steps))
    if not low <= usual <= high:
        code, seen, needed, remedy = (
            "dropped-samples" if usual > high else "jitter",
            f"{trajectory.source} steps by {usual * 1e3:.5g} ms",
            f"the sample time of the profile, {stated * 1e3:.5g} ms",
            "Log every sample of the control loop, with time in seconds; if the loop runs at "
            "another rate, correct the device and tune again.",
        )
    elif long:
        code, seen, needed, remedy = (
            "dropped-samples",
            f"{trajectory.source} has {long} gap(s), the longest {steps.max() * 1e3:.4g} ms",
            "every sample, since the filters of the law remember all of them",
            "Log with a real-time thread, or cut the log to a part without gaps.",
        )
    elif jitter > _MOST_JITTER:
        code, needed = "jitter", f"at most {_MOST_JITTER:.0%}"
        seen = f"the steps of {trajectory.source} vary by {jitter:.2%} rms"
        remedy = "Run the controller at a constant rate."
    else:
        return
    found = Finding(code=code, severity="refusal", seen=seen, needed=needed, remedy=remedy)
    raise LogRefusedError((found.of(trajectory.source),))


def _step(trajectory: Trajectory) -> float:
    return float(trajectory.time[-1] - trajectory.time[0]) / (len(trajectory) - 1)


def _encoder(profile: Design, trajectory: Trajectory) -> Outcome:
    """Is the position in the unit of the device, read by its encoder?"""
    length = UNITS[profile.device.motion]["length"]
    known = profile.device.encoder_resolution
    if known is None:
        return unassessed_outcome("encoder", "the resolution is not in the device")
    apart = np.diff(np.unique(trajectory.position))
    if not apart.size:
        return unassessed_outcome("encoder", "the axis does not move")
    counts = np.rint(apart / apart.min())
    count = float(np.sum(apart) / np.sum(counts))  # the mean, as readings may have few digits
    if np.any(np.abs(apart / count - counts) > _ON_GRID):
        return unassessed_outcome("encoder", "the positions lie on no grid")
    ratio = count / known.value
    return compared(
        "encoder",
        {"seen": count, "predicted": known.value, "tolerance": _COUNT_TOLERANCE},
        agrees=abs(ratio - 1) <= _COUNT_TOLERANCE,
        seen=f"positions in steps of {count:.5g} {length}",
        predicted=f"{known.value:.5g} {length}",
        tolerance=f"{_COUNT_TOLERANCE:.0%}",
        remedy=f"The unit of the position looks {ratio:.4g} times too large: state "
        f"--position-gain {1 / ratio:.4g}; or log more digits; only where the data sheet of the "
        "encoder says so, state another encoder_resolution and tune again.",
    )


def _ripple(
    profile: Design,
    trajectory: Trajectory,
    loop: LoopProfile,
    effects: Effects,
    motion: MeasuredMotion,
    force_digit: float,
) -> Outcome:
    """The ripple of the force while the handle moves freely, seen in differences, and predicted."""
    release, measured, known = motion.release, motion.measured, profile.device.encoder_resolution
    if release is None or measured is None or known is None:
        moves = release is not None and measured is not None
        why = "the encoder resolution is not known" if moves else "no free motion is seen"
        return unassessed_outcome("ripple", why)
    force = trajectory.force[release.first : release.end]
    position = trajectory.position[release.first : release.end]
    motion_hertz = max(motion.prediction.nominal.natural / (2 * np.pi), measured.frequency)
    if motion_hertz > _SLOW_MOTION * 0.5 / _step(trajectory):
        why = f"the motion reaches {motion_hertz:.3g} Hz, no band is above"
        return unassessed_outcome("ripple", why, reached_hz=motion_hertz)
    unit, resolution = UNITS[profile.device.motion]["force"], known.value
    turn = (np.arange(_PLACES) + 0.5) * np.pi / _PLACES
    built = Loop.from_parts(profile.device, filters_of(loop))
    power = (_force_per_position(built, effects, turn) * resolution) ** 2 / 12
    weight = (2 * np.sin(turn / 2)) ** (2 * _ORDER)
    predicted, of_differences = (float(np.sqrt(np.mean(power * each))) for each in (1.0, weight))
    if of_differences < force_digit * np.sqrt(np.mean(weight)):
        return unassessed_outcome(
            "ripple",
            f"{predicted:.2g} {unit} are predicted, the force is logged to {force_digit:g}",
            predicted=predicted,
            force_digit=force_digit,
        )
    moving = np.abs(position[_ORDER:] - position[:-_ORDER]) > _ORDER * _SLOWEST * resolution
    count = int(np.count_nonzero(moving))
    if count < _FEWEST_ROWS:
        why = f"the handle moves by half a count a sample or more for {counted(count, 'row')} only"
        return unassessed_outcome("ripple", why, rows=count)
    seen = predicted * rms(np.diff(force, _ORDER)[moving]) / of_differences
    return compared(
        "ripple",
        {"seen": seen, "rows": count, "predicted": predicted, "tolerance": _RIPPLE_TOLERANCE},
        agrees=1 / (1 + _RIPPLE_TOLERANCE) <= seen / predicted <= 1 + _RIPPLE_TOLERANCE,
        seen=f"{seen:.3g} {unit} rms over {count} rows in motion",
        predicted=f"{predicted:.3g} {unit} rms",
        tolerance=f"{_RIPPLE_TOLERANCE:.0%}",
        remedy="Check the resolution of the encoder in the device, and look for noise on the "
        "position, an uneven clock or a vibration of the mechanism.",
    )


def _force_per_position(loop: Loop, effects: Effects, turn: FloatArray) -> FloatArray:
    """|C/(1 + G·C)| at angles on the unit circle, N/m, shape of ``turn``."""
    v, law, (closed, _) = np.tan(turn / 2), law_numerator(loop, effects), loop.polynomial(effects)
    if law is None:
        return np.zeros_like(turn)
    through = value_at(law, v) * value_at(loop.transfer.plant_denominator, v)
    return np.abs(through / value_at(closed, v)) / float(loop.scales[0])


def verification_picture(seen: Verification) -> Figure:
    """Motion and the mode fitted to it, force beside its law, what the law leaves; verdicts."""
    from identification import NotebookFigure, legend_above

    figure = NotebookFigure(figsize=_INCHES, layout="constrained")
    above, below, left = figure.subplots(3, 1, sharex=True)
    device = seen.profile.device
    units = UNITS[device.motion]
    time, measured = seen.trajectory.time, None if seen.motion is None else seen.motion.measured
    above.plot(time, seen.trajectory.position, color="0.5", lw=2, label="logged")
    if measured is not None:
        above.plot(time[measured.rows], measured.fitted, color="#E69F00", lw=0.8, label="fitted")
    above.set_ylabel(f"position, {units['length']}")
    said = "law of the profile on the logged positions"
    below.plot(time, seen.trajectory.force, color="0.5", lw=2, label="logged")
    below.plot(time, seen.law.predicted, color="#0072B2", lw=0.8, ls="--", label=said)
    below.set_ylabel(f"force, {units['force']}")
    _residual(left, seen)
    left.set_ylabel(f"force less law, {units['force']}")
    left.set_xlabel("time, s")
    for axes in (above, below, left):
        legend_above(axes)
    gain = f" at gain {seen.gain:.3g}" if np.isfinite(seen.gain) else ""
    title = f"{seen.source}: {seen.played}{gain} on {device.name}"
    verdicts = "; ".join(f"{each.check}: {each.verdict}" for each in seen.outcomes)
    figure.suptitle(f"{title}\n{fill(verdicts, _LETTERS)}", fontsize=10)
    return figure


def _residual(axes: Axes, seen: Verification) -> None:
    """What the law leaves of the force, on the scale of the force where the two disagree."""
    verdict = seen.law.outcomes[0].verdict
    left = seen.trajectory.force - seen.law.predicted
    color = "#D55E00" if verdict == "disagrees" else "#009E73"
    axes.plot(seen.trajectory.time, left, color=color, lw=0.8, label=f"law {verdict}")
    most = float(np.nanmax(np.abs(seen.trajectory.force), initial=0.0))
    if most > 0:
        axes.set_ylim(-most, most)
