"""The columns of a log: complete, with true stamps, in SI units, finely read, and in motion?

Stamps are used as they are (docs/decisions, 10). What a lost row takes along is the force of its
sample, and what a gap takes along is the motion in it: with a third of the rows lost at 1 kHz mass
is within 0.2 %, after a gap in which the speed changes by its rms it is off by 1 % and outside of
its interval.

A log cannot prove its own units, and no remedy fits the hardware to the log (docs/decisions, 37).
What can be seen: numbers no handle reaches, whole numbers throughout, and disagreement with the
hardware file.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.device.hardware import Hardware
from identification.errors import Finding, InvalidInputError, counted, refusal
from identification.estimators.motion import running_maximum, running_range
from identification.estimators.signals import LOST, position_noise
from identification.findings.force_balance import balance_of
from identification.trajectory import (
    BoolArray,
    FloatArray,
    Trajectory,
    encoder_count,
    finest_reading,
)

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
_AROUND = 8  # rows to either side that tell which way the device moves, and ...
_FEWEST_PACKETS = 20  # ... packets that tell how far
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


def sampling(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """``dropped-samples`` and ``jitter``, ``force-unit`` for time that is not in seconds."""
    steps = np.diff(trajectory.time)
    long = steps > LOST * trajectory.sample_time
    packets = _packets(trajectory, steps, long)
    yield from _against_hardware(trajectory, hardware, packets=packets)
    if long.any() and not packets:
        yield from _lost(trajectory, steps, long)
    yield from _uneven(trajectory, steps if packets else steps[~long], packets=packets)


def _packets(trajectory: Trajectory, steps: FloatArray, long: BoolArray) -> bool:
    """Whether rows came in packets, stamped at once: then no long step moves further."""
    usual = float(np.mean(steps)) <= LOST * trajectory.sample_time
    if usual or np.count_nonzero(long[_AROUND:-_AROUND]) < _FEWEST_PACKETS:
        return False
    place, width = trajectory.position, 2 * _AROUND + 1
    way, inner = np.sign(place[width:] - place[:-width]), slice(_AROUND, -_AROUND)
    moved, long = way * np.diff(place)[inner], long[inner]
    return float(np.mean(moved[long])) < _FALSE * float(np.mean(moved[~long]))


def _lost(trajectory: Trajectory, steps: FloatArray, long: BoolArray) -> Iterator[Finding]:
    median = trajectory.sample_time
    lost = _rows_lost(steps, long, median)
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
        seen=f"{trajectory.source} has {counted(long.sum(), 'gap')}, about "
        f"{counted(lost, 'sample')} lost ({share:.1%}), the first after "
        f"{trajectory.time[first]:g} s, the longest {longest * 1e3:.4g} ms at a usual step of "
        f"{median * 1e3:.4g} ms, in which the speed may change by {hidden:.3g} times its rms",
        needed=f"at most {_MOST_LOST:.0%} lost, and {_LONGEST_GAP:g} times its rms in any gap"
        if refused
        else f"no step above {LOST * median * 1e3:.4g} ms",
        remedy="Log with a real-time thread, or cut the log to a part without gaps.",
        at=trajectory.spans(np.append(long, False) | np.append(False, long)),
    )


def _rows_lost(steps: FloatArray, long: BoolArray, usual: float) -> int:
    # Jitter lengthens some steps and shortens others; only what lengthens the log was lost.
    lengthened = round(float(np.sum(steps)) / usual) - steps.size
    return max(0, min(int(np.sum(np.rint(steps[long] / usual) - 1)), lengthened))


def _uneven(trajectory: Trajectory, even: FloatArray, *, packets: bool) -> Iterator[Finding]:
    jitter = float(np.std(even) / np.mean(even))
    if jitter <= _DOUBTED_JITTER:
        return
    false = packets or _false(trajectory)
    how = "the stamps are used as they are"
    if packets:
        how = f"rows come in packets, {np.mean(even) * 1e3:.4g} ms a row, and the stamps say when"
    elif false:
        how = "even steps make the motion smoother, so the stamps do not say when position was read"
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
    interpolated = np.zeros(rows)
    for j, i in enumerate(near):
        others = np.delete(offset, j, axis=0)
        interpolated += place[i : i + rows] * np.prod(others / (others - offset[j]), axis=0)
    even = (4 * (place[1:-3] + place[3:-1]) - place[:-4] - place[4:]) / 6
    # Over lost rows even steps are wrong, whatever the stamps are worth.
    gapless = np.ptp(offset, axis=0) < (3 + LOST) * trajectory.sample_time
    if not gapless.any():
        return False
    by_stamps, by_even = (
        float(np.median(np.abs(place[2:-2] - each)[gapless])) for each in (interpolated, even)
    )
    return by_stamps > _FALSE * by_even


def _against_hardware(
    trajectory: Trajectory, hardware: Hardware, *, packets: bool
) -> Iterator[Finding]:
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
    usual = trajectory.sample_time
    long = steps > LOST * usual
    # Means, not the median: stamps printed with few digits have a biased median. Rows that come
    # late and then follow at once are no faster clock: one leaves out both, one counts all rows.
    even = float(np.mean(steps[~long & (steps >= (2 - LOST) * usual)]))
    whole = span / (steps.size + _rows_lost(steps, long, usual))
    seen = min(even, whole, key=lambda each: abs(each - stated.value))
    seen = span / steps.size if packets else seen
    low = stated.low * (1 - _SAMPLE_TIME_TOLERANCE)
    high = stated.high * (1 + _SAMPLE_TIME_TOLERANCE)
    if low <= seen <= high:
        return
    ratio = seen / stated.value
    for unit, size in _CLOCKS:
        if abs(ratio * size - 1) <= _SAMPLE_TIME_TOLERANCE:
            yield refusal(
                "force-unit",
                seen=f"{trajectory.source} steps by {seen:.4g}, {ratio:.4g} times the sample time "
                f"{stated.value:.4g} s of the hardware",
                needed="both in seconds",
                remedy=f"Give --time-gain {size:g} if the column of time is in {unit}."
                if size < 1
                else "State sample_time of the hardware file in seconds.",
            )
            return
    nth = {2: "second", 3: "third"}.get(round(ratio), f"{round(ratio)}th")
    if ratio > LOST and abs(ratio / round(ratio) - 1) <= _SAMPLE_TIME_TOLERANCE:
        yield refusal(
            "dropped-samples",
            seen=f"{trajectory.source} steps by {seen * 1e3:.4g} ms, every {nth} sample of the "
            f"{stated.value * 1e3:.4g} ms of the hardware",
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


#: A column of whole numbers that spans at least this many of them comes from a counter or a
#: converter; forces commanded in whole newtons stay below.
_WHOLE_NUMBERS = 200
#: Times the peak force of the hardware above which it is not the actuator that is overloaded.
_OVER_LIMIT = 10.0
#: Part of the continuous force of the hardware that a calibration reaches; what stays below may be
#: in volts or amperes, of which most handles need fewer than newtons.
_UNDER_LIMIT = 0.4
#: Ratio of the count seen to the count stated above which one of them has another unit: less than
#: 57, from degrees to radians, and more than interpolation by four to sixteen.
_COUNT_RATIO = 25.0
_A_TURN = 0.02  # ... or that is 2π within this part: turns. Six counts to one are 4.5 % away.
#: Scatter of a reading, in counts stated, from which one of them has another unit where the count
#: stated is not seen: half a count of noise and the rounding make 33 in degrees.
_SCATTER = 30.0
#: Units a column may be in by mistake, and SI in each; ...
_FORCES = (("mN or N·mm", 1e-3), ("kN", 1e3))
_LENGTHS = {
    "linear": (("mm", 1e-3), ("µm", 1e-6), ("cm", 1e-2), ("inches", 0.0254)),
    "rotary": (("degrees", float(np.pi / 180)), ("turns", float(2 * np.pi)), ("mrad", 1e-3)),
}
_NAMED = 0.1  # ... what counts as one of them may be off by this part.


#: Travel and speed that a handle or a servo axis stays below, their unit, and what is likely above.
#: A gantry of 20 m; a hand throws at 10 to 20 m/s. A shaft of 20 000 rpm turns at 2 100 rad/s, and
#: a log of 1 000 turns is long.
_PLAUSIBLE = {
    "linear": (20.0, 20.0, "m", "millimetres or counts"),
    "rotary": (6000.0, 2500.0, "rad", "degrees or counts"),
}


def units(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """``force-unit`` as far as it shows before anything is estimated."""
    yield from _whole_numbers(trajectory)
    yield from _against_limit(trajectory, hardware)
    yield from _against_count(trajectory, hardware)
    yield from _out_of_reach(trajectory)


def _whole_numbers(trajectory: Trajectory) -> Iterator[Finding]:
    for name, column in (("force", trajectory.force), ("position", trajectory.position)):
        if not np.all(column == np.rint(column)) or np.ptp(column) < _WHOLE_NUMBERS:
            continue
        yield refusal(
            "force-unit",
            seen=f"every {name} in {trajectory.source} is a whole number, from "
            f"{column.min():.0f} to {column.max():.0f}",
            needed="SI units, not the counts of a converter",
            remedy=f"Give what one count is with --{name}-gain.",
        )


def _against_limit(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """Force far above what the actuator gives, or so small that it may be volts or amperes."""
    if hardware.force_limit is None:
        return
    limit, peak = hardware.force_limit, float(np.max(np.abs(trajectory.force)))
    over = peak > _OVER_LIMIT * limit.peak
    under = peak < _UNDER_LIMIT * limit.continuous and "force" not in trajectory.stated_units
    if limit.peak == 0 or not (over or under):
        return
    likely = [
        f"; {unit}: --force-gain {size:g}"
        for unit, size in _FORCES
        if _UNDER_LIMIT * limit.continuous <= peak * size <= limit.peak
    ]
    sure = "" if over else ", or --force-gain 1 if it is in N (N·m)"
    yield refusal(
        "force-unit",
        seen=f"{trajectory.source} reaches a force of {peak:.4g}; the actuator gives "
        f"{limit.continuous:.4g} continuous and {limit.peak:.4g} peak",
        needed=f"between {_UNDER_LIMIT * limit.continuous:.4g} and {limit.peak:.4g}, so that "
        "the unit of the column is no guess",
        remedy="Volts or amperes are possible: give N (N·m) per unit of the force column with "
        f"--force-gain (per ampere: torque constant and transmission{''.join(likely)}){sure}. "
        "Limits are those of the data sheet, in N (N·m) at the handle.",
    )


def _against_count(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """A count, or where noise hides it a scatter of readings, other than the encoder stated."""
    if hardware.encoder_resolution is None:
        return
    stated, seen = hardware.encoder_resolution.value, encoder_count(trajectory.position)
    likely, sure, ratio = "", ", or --position-gain 1 if it is", (seen or stated) / stated
    known, rotary = "position" in trajectory.stated_units, trajectory.motion == "rotary"
    turns = rotary and not known and _is_a_turn(max(ratio, 1 / ratio))
    if turns or not 1 / _COUNT_RATIO < ratio < _COUNT_RATIO:
        words, sure = f"steps by {seen:.4g}", sure if turns else ""
        needed = f"the same within a factor of {_COUNT_RATIO:g}, and not 2π apart, as turns are"
        for unit, size in _LENGTHS[trajectory.motion or "linear"]:
            if abs(ratio * size - 1) < _NAMED:
                likely = f" (in {unit}: --position-gain {size:.6g})"
    elif known or (seen is not None and abs(ratio - 1) < _NAMED):
        return
    else:
        scatter = position_noise(trajectory.position, trajectory.force, trajectory.steps)
        if scatter <= _SCATTER * stated:
            return
        ratio, words = scatter / stated, f"scatters by {scatter:.4g} rms"
        needed = f"at most {_SCATTER:g} times"
    yield refusal(
        "force-unit",
        seen=f"position in {trajectory.source} {words}, {ratio:.3g} times the encoder "
        f"resolution {stated:.4g} of the hardware",
        needed=needed,
        remedy="Where position is not in m (rad), give what one unit of it is with "
        f"--position-gain{likely}{sure}. The encoder resolution is that of the data "
        "sheet, in m (rad) at the handle.",
    )


def _is_a_turn(size: float) -> bool:
    return abs(size / (2 * np.pi) - 1) < _A_TURN


def _out_of_reach(trajectory: Trajectory) -> Iterator[Finding]:
    farthest, fastest, unit, wrong = _PLAUSIBLE[trajectory.motion or "linear"]
    travel = float(np.ptp(trajectory.position))
    # Over spans of about a hundredth of the log's samples, which noise does not swell.
    place, time = trajectory.position, trajectory.time
    span = max(1, len(trajectory) // 100)
    speed = float(np.max(np.abs((place[span:] - place[:-span]) / (time[span:] - time[:-span]))))
    if travel <= farthest and speed <= fastest:
        return
    remedy = (
        f"Give --position-gain: the position looks like {wrong}, or the motion that the "
        "hardware file states is not that of the axis."
    )
    if trajectory.motion is None:
        known = "position" in trajectory.stated_units
        remedy = (
            "If the axis turns, state motion: rotary in the hardware file (--hardware)"
            + ", and for degrees --position-gain 0.0174533" * (not known)
            + "; if it slides, state motion: linear and give --position-gain, since the position "
            f"looks like {wrong}."
        )
    yield refusal(
        "force-unit",
        seen=f"{trajectory.source} travels {travel:.4g} {unit} at up to {speed:.4g} "
        f"{unit}/s" + ("" if trajectory.motion else ", read as m"),
        needed=f"at most {farthest:g} {unit} and {fastest:g} {unit}/s",
        remedy=remedy,
    )


#: Travel in counts below which rounding is no longer noise but part of the motion.
_FEWEST_COUNTS = 100


def resolution(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """``few-counts``."""
    stated, place = hardware.encoder_resolution, trajectory.position
    count = finest_reading(place, trajectory.force) if stated is None else stated.value
    travel = float(np.ptp(place))
    if travel >= _FEWEST_COUNTS * count:
        return
    yield refusal(
        "few-counts",
        seen=f"{trajectory.source} travels {travel:.3g}, {travel / count:.0f} counts of "
        f"{count:.3g}",
        needed=f"at least {_FEWEST_COUNTS} counts",
        remedy="Give m (rad) per unit of the position column with --position-gain if it is in "
        "another unit; otherwise move the device further while logging.",
    )


#: A jump is this many times the largest step that is none; no device speeds up so from one sample
#: to the next and back.
_FASTEST = 8.0
#: Jumps of one log agree in size within this part, beside the steps of the motion itself: a counter
#: has one range.
_ALIKE = 0.05
_LEAST_JUMP = 0.02  # a jump is at least this part of the travel; less is a count or two of noise


def encoder_wrap(trajectory: Trajectory) -> Iterator[Finding]:
    """``encoder-wrap``: jumps of one size, far above what speed allows."""
    far = _jumps(trajectory)
    if not far.any():
        return
    steps = np.diff(trajectory.position)
    moved = np.interp(np.flatnonzero(far), np.flatnonzero(~far), steps[~far])  # beside the jump
    size = float(np.median(np.abs(steps[far] - moved)))
    turn = trajectory.motion != "linear" and (_is_a_turn(size) or _is_a_turn(np.deg2rad(size)))
    period = f"period={size:.6g}"
    if turn:
        period = "a turn as period: 360 in degrees, 6.283185307 in rad, 1 in turns"
    elif "position" in trajectory.stated_units:
        period += " for position in m (rad)"
    yield refusal(
        "encoder-wrap",
        seen=f"position in {trajectory.source} jumps {moved.size} times by {size:.4g}"
        + (", one turn," if turn else "")
        + " from one sample to the next",
        needed=f"steps of at most {_FASTEST:g} times the others, as mass allows",
        remedy="Where a counter starts anew, add or subtract its range after each jump "
        f"(numpy.unwrap with {period}); where a reading is lost, log it again.",
        at=trajectory.spans(np.append(far, False) | np.append(False, far)),
    )


def _jumps(trajectory: Trajectory) -> BoolArray:
    """Which steps of position are the range of a counter."""
    steps = np.diff(trajectory.position)
    # What happens during a gap is unknown, but not a jump.
    gapless = np.diff(trajectory.time) <= LOST * trajectory.sample_time
    steps = np.where(gapless, steps, 0.0)
    size = np.abs(steps)
    largest = float(size.max())
    far = size > largest / 2
    usual = float(size[~far].max(initial=0.0))
    travel = float(np.ptp(trajectory.position))
    if usual == 0 or largest < _FASTEST * usual or largest < _LEAST_JUMP * travel:
        return np.zeros_like(far)
    if np.ptp(size[far]) > _ALIKE * largest + 2 * usual:
        return np.zeros_like(far)
    return far


#: Force counts as at its limit within this part of it (printed digits, one count of a converter).
_AT_LIMIT = 1e-4
_RUN = 5  # consecutive samples at the limit that a smooth signal does not reach by chance
_TOLERATED = 0.01  # part of the log in such runs that is tolerated
#: A force with at most this many distinct sizes is a switching signal, whose plateaus are meant.
_SWITCHING_LEVELS = 16
_SWITCHED = 0.5  # ... so is a plateau entered or left by this part of it from row to row, ...
_AS_LONG = 2.0  # ... and one at most this many times as long as other forces are held.
#: Part of the continuous force of the hardware below which no actuator is at its limit.
_FAR_BELOW = 0.5


def saturation(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """``force-saturated``: long runs at the exact maximum, or more than the hardware can give."""
    size = np.abs(trajectory.force)
    peak = float(size.max())
    limit = None if hardware.force_limit is None else hardware.force_limit.peak
    if limit is not None and peak > limit * (1 + _AT_LIMIT):
        share = float(np.mean(size > limit * (1 + _AT_LIMIT)))
        yield refusal(
            "force-saturated",
            seen=f"{trajectory.source} asks for up to {peak:.4g}, more than the peak force "
            f"{limit:.4g} of the hardware in {share:.2%} of its samples",
            needed="force that the actuator can give",
            remedy="Give N (N·m) per unit of the force column with --force-gain if it is in "
            "volts, amperes or another unit; only if it is in N (N·m), excite more gently. The "
            "limit is that of the data sheet.",
            at=trajectory.spans(size > limit * (1 + _AT_LIMIT)),
        )
    free = 0.0 if hardware.force_limit is None else _FAR_BELOW * hardware.force_limit.continuous
    reached = limit is not None and peak >= limit * (1 - _AT_LIMIT)
    runs = _runs_at(trajectory.force, peak * (1 - _AT_LIMIT), switched=not reached)
    share = float(np.mean(runs))
    levels = np.unique(np.round(size / peak / _AT_LIMIT)).size
    if share > _TOLERATED and levels > _SWITCHING_LEVELS and peak >= free:
        below = f" (below {free:.4g} plateaus are believed)" if free else ""
        yield refusal(
            "force-saturated",
            seen=f"{share:.1%} of {trajectory.source} stays at the largest force {peak:.4g} "
            f"for {_RUN} samples or more",
            needed=f"at most {_TOLERATED:.0%}",
            remedy=f"Excite more gently{below}, so that the actuator gives what the log says"
            + ("." if free else "; where plateaus are meant, state the hardware's force_limit."),
            at=trajectory.spans(runs),
        )


def _runs_at(force: FloatArray, limit: float, *, switched: bool) -> BoolArray:
    """Which samples are in runs of at least _RUN at the limit, without smooth tops.

    Plateaus that begin or end by a jump, or last as long as others, are left out as well if they
    may be ``switched``.
    """
    size = np.abs(force)
    side = np.where(size >= limit, np.sign(force), 0.0)
    change = np.flatnonzero(np.diff(side, prepend=0.0, append=0.0))
    starts, ends = change[:-1], change[1:]
    there = side[starts] != 0
    starts, ends = starts[there], ends[there]
    long = ends - starts >= _RUN
    if switched and long.any():
        jumps = np.abs(np.diff(force, prepend=0.0, append=0.0)) >= _SWITCHED * limit
        long &= ~(jumps[starts] | jumps[ends])
        long &= ends - starts > _AS_LONG * _held(force, limit)
    flat = np.zeros(size.size, dtype=np.bool_)
    for start, end in zip(starts[long].tolist(), ends[long].tolist(), strict=True):
        flat[start:end] = not _smooth_top(size[start:end])
    return flat


def _held(force: FloatArray, limit: float) -> float:
    """Rows for which a force below the limit is held, median over such rows but those at rest."""
    level = np.rint(force / (limit * _AT_LIMIT))
    lengths = np.diff(np.flatnonzero(np.diff(level, prepend=np.inf, append=np.inf)))
    values, of_value = np.unique(level, return_inverse=True)
    rest = of_value == np.argmax(np.bincount(of_value, np.abs(force) < limit, values.size))
    rows = np.repeat(lengths, lengths)[~rest & (np.abs(force) < limit)]
    return float(np.median(rows)) if rows.size else 0.0


def _smooth_top(part: FloatArray) -> bool:
    """Whether it rises and then falls, as no force does that is cut off."""
    steps = np.sign(np.diff(part))
    return bool(
        np.count_nonzero(steps) > steps.size / 2 and np.all(np.diff(steps[steps != 0]) <= 0)
    )


#: The device stands where its position stays within this many readings of the finest resolution, a
#: count to either side, ...
_STANDING = 3.0
#: ... for as long as it takes to move this many times as far at its usual speed: a slow turn is no
#: standstill, ...
_FURTHER = 10.0
_FEWEST_SAMPLES = 20  # ... and for this many samples at least, this part of the log at most, ...
_LONGEST_WINDOW = 0.1
_CHANGE = 0.02  # ... while the force in the window changes by this part of its whole range.
#: Part of the log spent so above which friction is doubted, and above which too little motion is
#: left to tell mass and damping.
_DOUBTED_REST = 0.25
_REFUSED_REST = 0.9


def stiction(trajectory: Trajectory, hardware: Hardware) -> Iterator[Finding]:
    """``stiction``: the device is held, or sticks and slips, under a force that changes."""
    stuck = _stuck(trajectory, hardware)
    share = float(np.mean(stuck))
    if share < _DOUBTED_REST:
        return
    stops = int(np.count_nonzero(np.diff(stuck.astype(np.int8)) == 1)) + int(stuck[0])
    largest = float(np.max(np.abs(trajectory.force[:-1][stuck])))
    refused = share >= _REFUSED_REST
    yield Finding(
        code="stiction",
        severity="refusal" if refused else "warning",
        seen=f"{trajectory.source} stands still for {share:.0%} of its time, in {stops} "
        f"stops, while the force changes and reaches {largest:.3g}",
        needed=f"at most {_REFUSED_REST if refused else _DOUBTED_REST:.0%} of the time",
        remedy="Push harder than friction holds, for longer in each direction; look for a "
        "brake, an end stop or a dry bearing.",
        at=trajectory.spans(np.append(stuck, False) | np.append(False, stuck)),
    )


def _stuck(trajectory: Trajectory, hardware: Hardware) -> BoolArray:
    """Which of the n - 1 intervals lie in a standstill under a changing force."""
    place, force = trajectory.position, trajectory.force
    stated = hardware.encoder_resolution
    known = 0.0 if stated is None else stated.value
    still, width = standing(trajectory, max(known, finest_reading(place, force)))
    if not still.any():
        return np.zeros(place.size - 1, dtype=np.bool_)
    still &= running_range(force, width) >= _CHANGE * float(np.ptp(force))
    covered = running_maximum(still.astype(np.float64), width) > 0
    return covered[:-1] & covered[1:]


def standing(trajectory: Trajectory, fine: float) -> tuple[BoolArray, int]:
    """About which samples position stays within its resolution, in m, and about how many each."""
    place = trajectory.position
    # Over spans long enough for the noise of a reading not to count as speed.
    span = max(1, place.size // 200)
    speed = float(np.sqrt(np.mean((place[span:] - place[:-span]) ** 2))) / span
    if speed == 0:  # a cycle of exactly this span
        return np.zeros(place.size, dtype=np.bool_), 1
    width = 2 * (int(max(_FEWEST_SAMPLES, _FURTHER * _STANDING * fine / speed)) // 2) + 1
    if width >= _LONGEST_WINDOW * place.size:
        return np.zeros(place.size, dtype=np.bool_), 1
    return running_range(place, width) <= _STANDING * fine, width
