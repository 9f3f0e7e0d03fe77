"""Are the samples complete, their stamps true, and as fast as the hardware says?

Stamps are used as they are. Uneven steps by themselves spoil nothing; what a lost row takes along
is the force of its sample, and what a gap takes along is the motion in it. Measured on a device
moved at up to 5 Hz and 1 kHz: with a third of the rows lost mass is within 0.2 %, after a gap in
which the speed changes by its rms mass is off by 1 % and outside of its interval. One file: the
findings about one clock.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding, InvalidInputError
from identification.estimators.signals import LOST
from identification.findings.force_balance import balance_of
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Part of the samples lost above which the force of the others is no longer what acted: ...
MOST_LOST = 0.2
#: ... and below which a warning is enough, unless one gap alone hides the motion: at the typical
#: acceleration the speed changes by this part of the typical speed within it.
LONGEST_GAP = 0.5
#: Root mean square of the steps about their mean, as part of it, above which the log is doubted.
#: Steps of 10 and 12 ms in turn have 9 %; taken as equal they shift the inertia of a real log by a
#: tenth, taken as they are by nothing.
DOUBTED_JITTER = 0.01
#: Stamps are false if from its neighbours a position is told worse by them, by this factor, than by
#: even steps: then they say when a row was written, not when it was read. ...
FALSE = 1.5
#: ... So a log is refused above this jitter, which spoils speed by as much.
FALSE_JITTER = 0.05
#: With true stamps it is refused above this: a robot's joint sampled every 8 ms lost a third of its
#: damping at 0.35, in spite of its interval.
MOST_JITTER = 0.3
#: Samples looked at for that, from the middle: more add time, not truth.
_LONGEST = 1 << 20
#: Units of time by mistake, and s in each; above 1 it is the hardware that is not in s.
_CLOCKS = (
    ("milliseconds", 1e-3),
    ("microseconds", 1e-6),
    ("nanoseconds", 1e-9),
    ("milliseconds", 1e3),
    ("microseconds", 1e6),
)
#: Hardware and log may differ by this part in sample time; mass goes with its square.
SAMPLE_TIME_TOLERANCE = 0.01
#: A stated delay may be this part of the log.
LONGEST_DELAY = 0.1


def sampling(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``dropped-samples`` and ``jitter``, ``force-unit`` for time that is not in seconds.

    Raises:
        InvalidInputError: the log's sample time is not the hardware's nor a multiple of it, or the
            hardware's delay is no small part of the log.
    """
    steps = np.diff(trajectory.time)
    long = steps > LOST * trajectory.sample_time
    return (
        *_against_hardware(trajectory, hardware),
        *(_lost(trajectory, steps, long) if long.any() else ()),
        *_uneven(trajectory, steps[~long]),
    )


def _lost(
    trajectory: Trajectory, steps: FloatArray, long: NDArray[np.bool_]
) -> tuple[Finding, ...]:
    median = trajectory.sample_time
    # Jitter lengthens some steps and shortens others; only what lengthens the log was lost.
    lengthened = round(float(np.sum(steps)) / median) - steps.size
    lost = max(0, min(int(np.sum(np.rint(steps[long] / median) - 1)), lengthened))
    share = lost / (lost + len(trajectory))
    longest, first = float(steps.max()), int(np.flatnonzero(long)[0])
    hidden = longest / _pace(trajectory)
    refused = share > MOST_LOST or hidden > LONGEST_GAP
    if lost == 0 and not refused:
        return ()
    return (
        Finding(
            code="dropped-samples",
            severity="refusal" if refused else "warning",
            seen=f"{trajectory.source} has {int(long.sum())} gaps, about {lost} samples lost "
            f"({share:.1%}), the first after {trajectory.time[first]:g} s, the longest "
            f"{longest * 1e3:.4g} ms at a usual step of {median * 1e3:.4g} ms, in which the speed "
            f"changes by {hidden:.0%} of its rms",
            needed=f"at most {MOST_LOST:.0%} lost, and a change of {LONGEST_GAP:.0%} in any gap"
            if refused
            else f"no step above {LOST * median * 1e3:.4g} ms",
            remedy="Log with a real-time thread, or cut the log to a part without gaps.",
        ),
    )


def _pace(trajectory: Trajectory) -> float:
    """Time in which the typical acceleration makes the typical speed, s."""
    rows = balance_of(trajectory)
    return float(np.std(rows.velocity)) / float(np.std(rows.acceleration))


def _uneven(trajectory: Trajectory, even: FloatArray) -> tuple[Finding, ...]:
    jitter = float(np.std(even) / np.mean(even))
    if jitter <= DOUBTED_JITTER:
        return ()
    false = _false(trajectory)
    most = FALSE_JITTER if false else MOST_JITTER
    refused = jitter > most
    return (
        Finding(
            code="jitter",
            severity="refusal" if refused else "warning",
            seen=f"the steps of {trajectory.source} vary by {jitter:.2%} rms, from "
            f"{even.min() * 1e3:.4g} to {even.max() * 1e3:.4g} ms; "
            + (
                "the motion is smoother with even steps, so the stamps do not say when position "
                "was read"
                if false
                else "the stamps are used as they are"
            ),
            needed=f"at most {most if refused else DOUBTED_JITTER:.0%}",
            remedy="Log at a constant rate and stamp each row when position is read; where only "
            "the stamps are late, number the rows and multiply by the sample time.",
        ),
    )


def _false(trajectory: Trajectory) -> bool:
    """Whether even steps tell each position better from its four neighbours than the stamps do."""
    middle = max(0, (len(trajectory) - _LONGEST) // 2)
    part = slice(middle, middle + _LONGEST)
    time, place = trajectory.time[part], trajectory.position[part]
    near = (0, 1, 3, 4)
    rows = time.size - 4
    offset = np.stack([time[i : i + rows] - time[2 : 2 + rows] for i in near])
    told = np.zeros(rows)
    for j, i in enumerate(near):
        others = np.delete(offset, j, axis=0)
        told += place[i : i + rows] * np.prod(others / (others - offset[j]), axis=0)
    even = (4 * (place[1:-3] + place[3:-1]) - place[:-4] - place[4:]) / 6
    # Over lost rows even steps are wrong, whatever the stamps are worth.
    whole = np.ptp(offset, axis=0) < (3 + LOST) * trajectory.sample_time
    if not whole.any():
        return False
    by_stamps, by_even = (
        float(np.median(np.abs(place[2:-2] - each)[whole])) for each in (told, even)
    )
    return by_stamps > FALSE * by_even


def _against_hardware(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    if hardware is None:
        return ()
    _refuse_delay(trajectory, hardware)
    if hardware.sample_time is None:
        return ()
    stated, seen = hardware.sample_time, mean_step(trajectory)
    low = stated.low * (1 - SAMPLE_TIME_TOLERANCE)
    high = stated.high * (1 + SAMPLE_TIME_TOLERANCE)
    if low <= seen <= high:
        return ()
    ratio = seen / stated.value
    for unit, size in _CLOCKS:
        if abs(ratio * size - 1) <= SAMPLE_TIME_TOLERANCE:
            return (_other_clock(trajectory, stated.value, seen, unit, size),)
    if ratio > LOST and abs(ratio / round(ratio) - 1) <= SAMPLE_TIME_TOLERANCE:
        return (
            Finding(
                code="dropped-samples",
                severity="refusal",
                seen=f"{trajectory.source} steps by {seen * 1e3:.4g} ms, every "
                f"{round(ratio)}th sample of the {stated.value * 1e3:.4g} ms of the hardware",
                needed="every sample of the control loop, since force is held for each of them",
                remedy="Log every sample; sample_time in the hardware file is the period of the "
                "control loop, whatever the log was written with.",
            ),
        )
    raise InvalidInputError(
        trajectory.source,
        f"steps by {seen:.6g} s, but the hardware states a sample time of {stated.value:.6g} s",
        "Give time in seconds (--time names the column, --time-gain s in one unit of it) of every "
        "sample; sample_time is the period of the control loop in s",
    )


def _other_clock(
    trajectory: Trajectory, stated: float, seen: float, unit: str, size: float
) -> Finding:
    return Finding(
        code="force-unit",
        severity="refusal",
        seen=f"{trajectory.source} steps by {seen:.4g}, {seen / stated:.4g} times the sample time "
        f"{stated:.4g} s of the hardware",
        needed="both in seconds",
        remedy=f"Give --time-gain {size:g} if the column of time is in {unit}."
        if size < 1
        else "State sample_time of the hardware file in seconds.",
    )


def _refuse_delay(trajectory: Trajectory, hardware: Hardware) -> None:
    """Refuse a log shorter than many delays: hardly a row of it feels a force that was logged."""
    if hardware.delay is None:
        return
    stated, span = hardware.delay.high, float(trajectory.time[-1] - trajectory.time[0])
    if stated > LONGEST_DELAY * span:
        raise InvalidInputError(
            trajectory.source,
            f"lasts {span:.4g} s, but the hardware states a delay of {stated:.4g} s, "
            f"{stated / span:.3g} times as long; at most {LONGEST_DELAY:g} times",
            "Correct delay in the hardware file, which is in seconds, or log for longer",
        )


def mean_step(trajectory: Trajectory) -> float:
    """Sample time in s: the mean of the steps that lost nothing.

    The mean, not the median: stamps printed with few digits have a biased median.
    """
    steps = np.diff(trajectory.time)
    return float(np.mean(steps[steps <= LOST * trajectory.sample_time]))
