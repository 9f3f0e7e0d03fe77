"""The one verb: does a low-gain closed-loop log behave as its profile predicts?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Finding, LogRefusedError, Trajectory, UsageError
from tune.documents.effects import Effects
from tune.documents.errors import LoopError
from tune.documents.profile import Design
from tune.loop.filters import filters_of
from tune.loop.loop import Loop
from tune.verification.elements import moments_of
from tune.verification.law_seen import LawSeen, judge_law, printed_digit
from tune.verification.motion_seen import MotionSeen, judge_motion
from tune.verification.outcome import Outcome, not_assessed
from tune.verification.ripple_seen import judge_ripple

FloatArray = NDArray[np.float64]

#: A log whose steps differ from the sample time of the profile by more is of another loop.
SAMPLE_TIME_TOLERANCE = 0.01
#: A step this many times the usual one has lost a row, which the filters of the law need.
_LOST = 1.5
#: rms of the steps about their mean, as part of it, above which backward differences are not those
#: of an even clock.
_MOST_JITTER = 0.05
#: Count of the log against the encoder of the device.
_COUNT_TOLERANCE = 0.02
#: A grid is seen where neighbouring readings are whole counts apart within this part.
_ON_GRID = 0.05
#: What the loop of a profile predicts, beside its law.
_OF_THE_LOOP = ("frequency", "decay", "ripple")
_UNITS = {"linear": "N", "rotary": "N·m"}
_LENGTHS = {"linear": "m", "rotary": "rad"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What a log says about its profile.

    Attributes:
        source: the log.
        elements: that were played.
        gain: part of the profile's effects that was played; nan where no law was recognised.
        outcomes: encoder, law, gain, frequency, decay and ripple, in this order.
        law: the law that was seen.
        motion: the free motion that was seen; None where no law says what to expect.
        trajectory: the log.
    """

    source: str
    elements: tuple[str, ...]
    gain: float
    outcomes: tuple[Outcome, ...]
    law: LawSeen
    motion: MotionSeen | None
    trajectory: Trajectory

    @property
    def disagreements(self) -> tuple[Outcome, ...]:
        """What is not as predicted."""
        return tuple(each for each in self.outcomes if each.verdict == "disagrees")

    @property
    def assessed(self) -> bool:
        """Whether enough was compared to speak of agreement: the law, and frequency or decay."""
        told = {each.check for each in self.outcomes if each.verdict != "not assessed"}
        return "law" in told and bool(told & {"frequency", "decay"})

    def refuse_unassessed(self) -> None:
        """Raise LogRefusedError unless enough was compared to speak of agreement."""
        if self.assessed:
            return
        missing = [each for each in self.outcomes if each.verdict == "not assessed"]
        raise LogRefusedError(
            (
                Finding(
                    code="not-exciting-damping",
                    severity="refusal",
                    seen="; ".join(str(each) for each in missing),
                    needed="the law, and frequency or decay of the free motion",
                    remedy="Play an element with a spring at a lower gain, displace the handle "
                    "further, let go, and log until it rests.",
                ),
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
    """
    _check_request(profile, trajectory, gain, release)
    _check_clock(profile, trajectory)
    unit = _UNITS[profile.device.motion]
    moments = moments_of(profile, element)
    law = judge_law(profile, moments, trajectory.force, trajectory.position, gain, unit)
    motion: MotionSeen | None = None
    if law.effects is None or law.gain <= 0:
        why = "no law is known that was played"
        rest = tuple(not_assessed(check, why) for check in _OF_THE_LOOP)
    else:
        try:
            motion = _motion(profile, trajectory, law, law.effects, release)
            rest = (*motion.outcomes, _ripple(profile, trajectory, law, law.effects, motion, unit))
        except LoopError as error:  # the law was compared all the same
            rest = tuple(not_assessed(check, str(error)) for check in _OF_THE_LOOP)
    return Verification(
        source=trajectory.source,
        elements=law.moment,
        gain=law.gain,
        outcomes=(_encoder(profile, trajectory), *law.outcomes, *rest),
        law=law,
        motion=motion,
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
        if seen != known:
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


def _check_clock(profile: Design, trajectory: Trajectory) -> None:
    """Refuse a log whose rows are not those of the controller's loop."""
    steps = np.diff(trajectory.time)
    usual, stated = float(np.median(steps)), profile.loop.sample_time
    known = profile.device.sample_time
    low = min(stated, known.low) * (1 - SAMPLE_TIME_TOLERANCE)
    high = max(stated, known.high) * (1 + SAMPLE_TIME_TOLERANCE)
    long = int(np.count_nonzero(steps > _LOST * usual))
    jitter = float(np.std(steps) / np.mean(steps))
    finding: tuple[str, str, str, str] | None = None
    if not low <= usual <= high:
        finding = (
            "dropped-samples" if usual > high else "jitter",
            f"{trajectory.source} steps by {usual * 1e3:.5g} ms",
            f"the sample time of the profile, {stated * 1e3:.5g} ms",
            "Log every sample of the control loop, with time in seconds; if the loop runs at "
            "another rate, correct the device and tune again.",
        )
    elif long:
        finding = (
            "dropped-samples",
            f"{trajectory.source} has {long} gaps, the longest {steps.max() * 1e3:.4g} ms",
            "every sample, since the filters of the law remember all of them",
            "Log with a real-time thread, or cut the log to a part without gaps.",
        )
    elif jitter > _MOST_JITTER:
        finding = (
            "jitter",
            f"the steps of {trajectory.source} vary by {jitter:.2%} rms",
            f"at most {_MOST_JITTER:.0%}",
            "Run the controller at a constant rate.",
        )
    if finding is not None:
        code, seen, needed, remedy = finding
        raise LogRefusedError(
            (Finding(code=code, severity="refusal", seen=seen, needed=needed, remedy=remedy),)
        )


def _step(trajectory: Trajectory) -> float:
    return float(trajectory.time[-1] - trajectory.time[0]) / (len(trajectory) - 1)


def _motion(
    profile: Design,
    trajectory: Trajectory,
    law: LawSeen,
    effects: Effects,
    release: float | None,
) -> MotionSeen:
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
    length = _LENGTHS[profile.device.motion]
    known = profile.device.encoder_resolution
    if known is None:
        return not_assessed("encoder", "the resolution is not in the device")
    apart = np.diff(np.unique(trajectory.position))
    counts = np.rint(apart / apart.min())
    count = float(np.sum(apart) / np.sum(counts))  # the mean, as readings may have few digits
    if np.any(np.abs(apart / count - counts) > _ON_GRID):
        return not_assessed("encoder", "the positions lie on no grid")
    ratio = count / known.value
    agrees = abs(ratio - 1) <= _COUNT_TOLERANCE
    return Outcome(
        check="encoder",
        verdict="agrees" if agrees else "disagrees",
        seen=f"positions in steps of {count:.5g} {length}",
        predicted=f"{known.value:.5g} {length}",
        tolerance=f"{_COUNT_TOLERANCE:.0%}",
        remedy=""
        if agrees
        else f"The unit of the position looks {ratio:.4g} times too large: state "
        f"--position-gain {1 / ratio:.4g}; or log more digits; or correct encoder_resolution and "
        "tune again.",
    )


def _ripple(
    profile: Design,
    trajectory: Trajectory,
    law: LawSeen,
    effects: Effects,
    motion: MotionSeen,
    unit: str,
) -> Outcome:
    if motion.release is None or motion.measured is None or motion.prediction is None:
        return not_assessed("ripple", "no free motion is seen")
    known = profile.device.encoder_resolution
    nominal = motion.prediction.nominal
    fastest = max(nominal.natural / (2 * np.pi), motion.measured.frequency)
    free = slice(motion.release.first, motion.release.end)
    return judge_ripple(
        Loop.from_parts(profile.device, filters_of(law.loop)),
        effects,
        None if known is None else known.value,
        trajectory.force[free],
        trajectory.position[free],
        tuple(turn - motion.release.first for turn in motion.release.turns),
        _step(trajectory),
        fastest,
        nominal.next_decay,
        printed_digit(trajectory.force),
        unit,
    )
