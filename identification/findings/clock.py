"""Are the samples complete, their stamps true, and the delay told?

Stamps are used as they are. Uneven steps by themselves spoil nothing; what a lost row takes along
is the force of its sample, and what a gap takes along is the motion in it. Measured on a device
moved at up to 5 Hz and 1 kHz: with a third of the rows lost mass is within 0.2 %, after a gap in
which the speed changes by its rms mass is off by 1 % and outside of its interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding, InvalidInputError
from identification.estimators.estimate import NORMAL_95, Estimate
from identification.estimators.least_squares import MOST_SAMPLES, Delay
from identification.estimators.signals import LOST
from identification.findings.force_balance import balance_of
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Part of the samples lost above which the force of the others is no longer what acted: ...
_MOST_LOST = 0.2
#: ... and below which a warning is enough, unless one gap alone hides the motion: at the typical
#: acceleration the speed changes by this part of the typical speed within it.
_LONGEST_GAP = 0.5
#: Root mean square of the steps about their mean, as part of it, above which the log is doubted.
#: Steps of 10 and 12 ms in turn have 9 %; taken as equal they shift the inertia of a real log by a
#: tenth, taken as they are by nothing.
_DOUBTED_JITTER = 0.01
#: Stamps are false if from its neighbours a position is told worse by them, by this factor, than by
#: even steps: then they say when a row was written, not when it was read. ...
_FALSE = 1.5
_FALSE_JITTER = 0.05  # ... so a log is refused above this jitter, which spoils speed by as much.
#: With true stamps it is refused above this: a robot's joint sampled every 8 ms lost a third of its
#: damping at 0.35, in spite of its interval.
_MOST_JITTER = 0.3
_LONGEST = 1 << 20  # samples looked at for that, from the middle: more add time, not truth
#: Units of time by mistake, and s in each; above 1 it is the hardware that is not in s.
_CLOCKS = (
    ("milliseconds", 1e-3),
    ("microseconds", 1e-6),
    ("nanoseconds", 1e-9),
    ("milliseconds", 1e3),
    ("microseconds", 1e6),
)
#: Hardware and log may differ by this part in sample time; mass goes with its square.
_SAMPLE_TIME_TOLERANCE = 0.01
_LONGEST_DELAY = 0.1  # a stated delay may be this part of the log


def sampling(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """``dropped-samples`` and ``jitter``, ``force-unit`` for time that is not in seconds."""
    steps = np.diff(trajectory.time)
    long = steps > LOST * trajectory.sample_time
    yield from _against_hardware(trajectory, hardware)
    if long.any():
        yield from _lost(trajectory, steps, long)
    yield from _uneven(trajectory, steps[~long])


def _lost(trajectory: Trajectory, steps: FloatArray, long: NDArray[np.bool_]) -> Iterator[Finding]:
    median = trajectory.sample_time
    # Jitter lengthens some steps and shortens others; only what lengthens the log was lost.
    lengthened = round(float(np.sum(steps)) / median) - steps.size
    lost = max(0, min(int(np.sum(np.rint(steps[long] / median) - 1)), lengthened))
    share = lost / (lost + len(trajectory))
    longest, first = float(steps.max()), int(np.flatnonzero(long)[0])
    rows = balance_of(trajectory)
    # Over the time in which the typical acceleration makes the typical speed.
    hidden = longest / (float(np.std(rows.velocity)) / float(np.std(rows.acceleration)))
    refused = share > _MOST_LOST or hidden > _LONGEST_GAP
    if lost == 0 and not refused:
        return
    yield Finding(
        code="dropped-samples",
        severity="refusal" if refused else "warning",
        seen=f"{trajectory.source} has {int(long.sum())} gaps, about {lost} samples lost "
        f"({share:.1%}), the first after {trajectory.time[first]:g} s, the longest "
        f"{longest * 1e3:.4g} ms at a usual step of {median * 1e3:.4g} ms, in which the speed "
        f"changes by {hidden:.0%} of its rms",
        needed=f"at most {_MOST_LOST:.0%} lost, and a change of {_LONGEST_GAP:.0%} in any gap"
        if refused
        else f"no step above {LOST * median * 1e3:.4g} ms",
        remedy="Log with a real-time thread, or cut the log to a part without gaps.",
    )


def _uneven(trajectory: Trajectory, even: FloatArray) -> Iterator[Finding]:
    jitter = float(np.std(even) / np.mean(even))
    if jitter <= _DOUBTED_JITTER:
        return
    false = _false(trajectory)
    how = (
        "the motion is smoother with even steps, so the stamps do not say when position was read"
        if false
        else "the stamps are used as they are"
    )
    most = _FALSE_JITTER if false else _MOST_JITTER
    refused = jitter > most
    yield Finding(
        code="jitter",
        severity="refusal" if refused else "warning",
        seen=f"the steps of {trajectory.source} vary by {jitter:.2%} rms, from "
        f"{even.min() * 1e3:.4g} to {even.max() * 1e3:.4g} ms; {how}",
        needed=f"at most {most if refused else _DOUBTED_JITTER:.0%}",
        remedy="Log at a constant rate and stamp each row when position is read; where only "
        "the stamps are late, number the rows and multiply by the sample time.",
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
    return by_stamps > _FALSE * by_even


def _against_hardware(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    if hardware is None:
        return
    span = float(trajectory.time[-1] - trajectory.time[0])
    # Hardly a row of a log shorter than many delays feels a force that was logged.
    if hardware.delay is not None and hardware.delay.high > _LONGEST_DELAY * span:
        late = hardware.delay.high
        raise InvalidInputError(
            trajectory.source,
            f"lasts {span:.4g} s, but the hardware states a delay of {late:.4g} s, "
            f"{late / span:.3g} times as long; at most {_LONGEST_DELAY:g} times",
            "Correct delay in the hardware file, which is in seconds, or log for longer",
        )
    if hardware.sample_time is None:
        return
    stated, steps = hardware.sample_time, np.diff(trajectory.time)
    # The mean, not the median: stamps printed with few digits have a biased median.
    seen = float(np.mean(steps[steps <= LOST * trajectory.sample_time]))
    low = stated.low * (1 - _SAMPLE_TIME_TOLERANCE)
    high = stated.high * (1 + _SAMPLE_TIME_TOLERANCE)
    if low <= seen <= high:
        return
    ratio = seen / stated.value
    for unit, size in _CLOCKS:
        if abs(ratio * size - 1) <= _SAMPLE_TIME_TOLERANCE:
            yield Finding(
                code="force-unit",
                severity="refusal",
                seen=f"{trajectory.source} steps by {seen:.4g}, {ratio:.4g} times the sample time "
                f"{stated.value:.4g} s of the hardware",
                needed="both in seconds",
                remedy=f"Give --time-gain {size:g} if the column of time is in {unit}."
                if size < 1
                else "State sample_time of the hardware file in seconds.",
            )
            return
    if ratio > LOST and abs(ratio / round(ratio) - 1) <= _SAMPLE_TIME_TOLERANCE:
        yield Finding(
            code="dropped-samples",
            severity="refusal",
            seen=f"{trajectory.source} steps by {seen * 1e3:.4g} ms, every "
            f"{round(ratio)}th sample of the {stated.value * 1e3:.4g} ms of the hardware",
            needed="every sample of the control loop, since force is held for each of them",
            remedy="Log every sample; sample_time in the hardware file is the period of the "
            "control loop, whatever the log was written with.",
        )
        return
    raise InvalidInputError(
        trajectory.source,
        f"steps by {seen:.6g} s, but the hardware states a sample time of {stated.value:.6g} s",
        "Give time in seconds (--time names the column, --time-gain s in one unit of it) of every "
        "sample; sample_time is the period of the control loop in s",
    )


_AT_END = 0.1  # samples from the end of the scan within which the true delay may lie beyond it, ...
#: ... if the residual still falls there by this part from one sample to the next. A log that does
#: not tell its delay may have its smallest residual anywhere.
_STILL_FALLING = 0.01
#: Half-width of the 95 % interval of a delay, in samples, above which it is doubted: a stability
#: margin is of one sample.
_WIDEST_DELAY = 1.0
#: Two delays contradict each other if they are further apart than this many deviations of both ...
_DELAY_SIGMAS = 4.0
_APART = 0.25  # ... and than this part of a sample, below which the difference matters to nothing.


def unknown_delay(trajectory: Trajectory, delay: Delay | None) -> Iterator[Finding]:
    """``delay-unknown``: beyond what is looked for, or nowhere in particular."""
    if delay is None:
        return
    step = trajectory.sample_time
    # Nothing is known beyond the scan, so no doubt is wider.
    width = min(NORMAL_95 * delay.deviation / step, float(MOST_SAMPLES))
    found = delay.value / step
    before, last = delay.residuals[-2:]
    beyond = found >= MOST_SAMPLES - _AT_END and last < (1 - _STILL_FALLING) * before
    if not beyond and width <= _WIDEST_DELAY:
        return
    seen = (
        f"the residual of {trajectory.source} is smallest at {found:.2f} ± {width:.2g} samples "
        "of delay"
    )
    yield Finding(
        code="delay-unknown",
        severity="refusal" if beyond else "warning",
        seen=seen + (f", the end of the scan from 0 to {MOST_SAMPLES}" if beyond else ""),
        needed=f"a delay below {MOST_SAMPLES} samples"
        if beyond
        else f"a delay within ± {_WIDEST_DELAY:g} sample",
        remedy="State delay in the hardware file, or excite fast enough to show it.",
    )


def contradicting_delays(
    trajectory: Trajectory, chosen: Estimate, others: Iterable[Estimate]
) -> Iterator[Finding]:
    """``delay-unknown``: two methods read delays that exclude each other."""
    if chosen.delay_deviation is None:
        return
    step = trajectory.sample_time
    for other in others:
        if other.delay_deviation is None:
            continue
        apart = abs(other.delay - chosen.delay)
        chance = float(np.hypot(other.delay_deviation, chosen.delay_deviation))
        if apart > max(_DELAY_SIGMAS * chance, _APART * step):
            yield Finding(
                code="delay-unknown",
                severity="warning",
                seen=f"{_told(chosen, step)} in {trajectory.source}, {_told(other, step)}",
                needed=f"delays within {_DELAY_SIGMAS:g} deviations or {_APART:g} samples",
                remedy="State delay in the hardware file; where it varies from sample to "
                "sample, state its largest value.",
            )
            return
    return


def _told(estimate: Estimate, step: float) -> str:
    width = NORMAL_95 * (estimate.delay_deviation or 0.0)
    name = estimate.method.replace("-", " ")
    return f"{name} say {estimate.delay / step:.2f} ± {width / step:.2g} samples of delay"
