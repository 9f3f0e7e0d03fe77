"""The one verb: does a low-gain closed-loop log behave as its profile predicts?

One file: the steps of one verb, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification import Finding, LogRefusedError, Trajectory, UsageError
from tune.certificate.assumptions import refuse_unbalanced
from tune.documents.effects import UNITS, Effects
from tune.documents.errors import LoopError
from tune.documents.profile import Design
from tune.loop.filters import filters_of
from tune.loop.loop import Loop
from tune.verification.clock import check_clock
from tune.verification.decimal_digits import decimal_digit
from tune.verification.elements import moments_of
from tune.verification.measured_cutoffs import MeasuredCutoff, measured_cutoffs
from tune.verification.measured_delay import MeasuredDelay, judge_delay, unknown_delay
from tune.verification.measured_law import MeasuredLaw, judge_law
from tune.verification.measured_motion import MeasuredMotion, judge_motion
from tune.verification.measured_ripple import judge_ripple
from tune.verification.outcome import Outcome, unassessed_outcome
from tune.verification.variants import Log

#: Count of the log against the encoder of the device.
_COUNT_TOLERANCE = 0.02
#: A grid is seen where neighbouring readings are whole counts apart within this part.
_ON_GRID = 0.05
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What a log says about its profile.

    Attributes:
        source: the log.
        elements: that were played.
        gain: part of the profile's effects that was played; nan where no law was recognised.
        outcomes: encoder, law, gain, filters, frequency, decay, ripple and delay, in this order.
        law: the law that was seen.
        cutoffs: intervals of the filters in use.
        motion: the free motion that was seen; None where no law says what to expect.
        delay: what is known of the delay, and of which elements the log tells that they keep their
            margin.
        trajectory: the log.
    """

    source: str
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
    def disagreements(self) -> tuple[Outcome, ...]:
        """What is not as predicted."""
        return tuple(each for each in self.outcomes if each.verdict == "disagrees")

    @property
    def assessed(self) -> bool:
        """Whether enough was compared to speak of agreement.

        The law, frequency or decay, and the margin on every loop that the log allows.
        """
        return {"law", "delay"} <= self._told and bool(self._told & _OF_THE_MODE)

    @property
    def _told(self) -> set[str]:
        return {each.check for each in self.outcomes if each.verdict in {"agrees", "disagrees"}}

    def refuse_unassessed(self, remedy: str) -> None:
        """Raise LogRefusedError unless enough was compared to speak of agreement.

        Args:
            remedy: what to play that tells more.
        """
        if self.assessed:
            return
        needed = {check: words for check, words in _NEEDED.items() if check not in self._told}
        if self._told & _OF_THE_MODE:
            needed = {check: needed[check] for check in needed if check not in _OF_THE_MODE}
        raise LogRefusedError(
            tuple(
                Finding(
                    code="delay-unknown" if each.check == "delay" else "not-exciting-damping",
                    severity="refusal",
                    seen=each.told,
                    needed=needed[each.check],
                    remedy=remedy if each.check == "delay" else each.remedy,
                    source=self.source,
                )
                for each in self.outcomes
                if each.check in needed
            )
        )


def verify(
    profile: Design,
    trajectory: Trajectory,
    *,
    element: str | None = None,
    gain: float | None = None,
    release: float | None = None,
) -> Verification:
    """Compare a closed-loop log with what its profile predicts.

    Args:
        profile: of the device the log was taken on.
        trajectory: force as the haptic controller commanded it, position as it read it; an element
            played at a reduced gain, the handle pushed or displaced, and let go.
        element: "wall", or "wall+water" for what is felt together; None is found out.
        gain: at which the element was played; None is found out.
        release: s, in the time of the log, when the hand is off; None is the largest deviation.

    Raises:
        UsageError: an element that is not in the profile, a log of another axis.
        LogRefusedError: rows lost, an uneven clock, another sample time.
        CheckFailedError: a device that no effect can be certified on.
    """
    refuse_unbalanced(profile.device)
    _check_request(profile, trajectory, gain, release)
    check_clock(profile, trajectory)
    unit = UNITS[profile.device.motion]["force"]
    moments = moments_of(profile, element)
    law = judge_law(profile, moments, trajectory.force, trajectory.position, gain, unit)
    motion: MeasuredMotion | None = None
    cutoffs: tuple[MeasuredCutoff, ...] = ()
    if law.effects is None or law.gain <= 0:
        why = "no law is known that was played"
        rest = tuple(unassessed_outcome(check, why) for check in _OF_THE_MOTION)
        delay = unknown_delay(why)
    else:
        try:
            motion = _motion(profile, trajectory, law, law.effects, release)
            rest = (*motion.outcomes, _ripple(profile, trajectory, law, law.effects, motion, unit))
            if law.outcomes[0].verdict == "agrees":
                log = Log(force=trajectory.force, position=trajectory.position, used=law.used)
                cutoffs = measured_cutoffs(log, law.loop, law.effects)
                delay = judge_delay(
                    profile, law.loop, law.moment, law.effects, motion.mode, cutoffs
                )
            else:
                delay = unknown_delay("the law is not the profile's")
        except LoopError as error:  # the law was compared all the same
            rest = tuple(unassessed_outcome(check, str(error)) for check in _OF_THE_MOTION)
            delay = unknown_delay(str(error))
    filters = tuple(each.outcome for each in cutoffs)
    return Verification(
        source=trajectory.source,
        elements=law.moment,
        gain=law.gain,
        outcomes=(
            _encoder(profile, trajectory),
            *law.outcomes,
            *filters,
            *rest,
            delay.outcome,
        ),
        law=law,
        cutoffs=cutoffs,
        motion=motion,
        delay=delay,
        trajectory=trajectory,
    )


def _check_request(
    profile: Design, trajectory: Trajectory, gain: float | None, release: float | None
) -> None:
    device = profile.device
    for name, seen, known in (
        ("--axis", trajectory.axis, device.axis),
        ("motion", trajectory.motion, device.motion),
    ):
        if seen is not None and seen != known:
            raise UsageError(
                name,
                f"the log is of {seen}, the profile of {known}",
                "Give the log and the profile of one axis",
            )
    if gain is not None and not (np.isfinite(gain) and gain > 0):
        raise UsageError("--gain", f"{gain:g} is no gain", "Give a number above 0, usually below 1")
    begin, end = float(trajectory.time[0]), float(trajectory.time[-1])
    if release is not None and not begin <= release < end:
        raise UsageError(
            "--release",
            f"{release:g} s is outside of the log, {begin:g} to {end:g} s",
            "Give the instant in the time of the log",
        )


def _step(trajectory: Trajectory) -> float:
    return float(trajectory.time[-1] - trajectory.time[0]) / (len(trajectory) - 1)


def _motion(
    profile: Design,
    trajectory: Trajectory,
    law: MeasuredLaw,
    effects: Effects,
    release: float | None,
) -> MeasuredMotion:
    first = 0 if release is None else int(np.searchsorted(trajectory.time, release))
    return judge_motion(
        profile.device,
        law.loop,
        effects,
        trajectory.position,
        law.used,
        _step(trajectory),
        first,
    )


def _encoder(profile: Design, trajectory: Trajectory) -> Outcome:
    """Is the position in the unit of the device, read by its encoder?"""
    length = UNITS[profile.device.motion]["length"]
    known = profile.device.encoder_resolution
    if known is None:
        return unassessed_outcome("encoder", "the resolution is not in the device")
    apart = np.diff(np.unique(trajectory.position))
    counts = np.rint(apart / apart.min())
    count = float(np.sum(apart) / np.sum(counts))  # the mean, as readings may have few digits
    if np.any(np.abs(apart / count - counts) > _ON_GRID):
        return unassessed_outcome("encoder", "the positions lie on no grid")
    ratio = count / known.value
    agrees = abs(ratio - 1) <= _COUNT_TOLERANCE
    return Outcome(
        check="encoder",
        verdict="agrees" if agrees else "disagrees",
        seen=f"positions in steps of {count:.5g} {length}",
        predicted=f"{known.value:.5g} {length}",
        tolerance=f"{_COUNT_TOLERANCE:.0%}",
        numbers={"seen": count, "predicted": known.value, "tolerance": _COUNT_TOLERANCE},
        remedy=""
        if agrees
        else f"The unit of the position looks {ratio:.4g} times too large: state "
        f"--position-gain {1 / ratio:.4g}; or log more digits; only where the data sheet of the "
        "encoder says so, state another encoder_resolution and tune again.",
    )


def _ripple(
    profile: Design,
    trajectory: Trajectory,
    law: MeasuredLaw,
    effects: Effects,
    motion: MeasuredMotion,
    unit: str,
) -> Outcome:
    if motion.release is None or motion.measured is None or motion.prediction is None:
        return unassessed_outcome("ripple", "no free motion is seen")
    known = profile.device.encoder_resolution
    nominal = motion.prediction.nominal
    free = slice(motion.release.first, motion.release.end)
    return judge_ripple(
        Loop.from_parts(profile.device, filters_of(law.loop)),
        effects,
        None if known is None else known.value,
        trajectory.force[free],
        trajectory.position[free],
        tuple(turn - motion.release.first for turn in motion.release.turns),
        _step(trajectory),
        max(nominal.natural / (2 * np.pi), motion.measured.frequency),
        nominal.next_decay,
        decimal_digit(trajectory.force),
        unit,
    )
