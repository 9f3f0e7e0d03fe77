"""Are force and position in SI units, finely read, and what acted on the device?

A unit multiplies every parameter and changes no residual, so a log cannot prove its own. What can
be seen: numbers no handle reaches, whole numbers throughout, and disagreement with the hardware
file. Volts, amperes or mN that happen to look like newtons pass unseen without one, and with one
where their numbers lie between a part of the continuous force and the peak force; a profile says
that it takes the unit on trust.

No remedy fits the hardware to the log: limits and counts come from data sheets, or a wrong unit
would move into the device.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.signals import LOST, encoder_count, finest_reading, position_noise
from identification.trajectory import Motion, Trajectory

FloatArray = NDArray[np.float64]

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
#: Scatter of a reading, in counts stated, from which one of them has another unit: an encoder's
#: readings scatter by a count, and by at least 0.29 of one, which is 17 in degrees.
_SCATTER = 10.0
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
#: A mass, kg, or inertia, kg·m², that is no handle's: a forging press, and a fly's wing.
_MASS: dict[Motion | None, tuple[float, float]] = {
    "linear": (1e-4, 1000.0),
    "rotary": (1e-9, 100.0),
    None: (1e-9, 1000.0),
}
_MASS_UNIT: dict[Motion | None, str] = {"linear": "kg", "rotary": "kg·m²", None: "kg (kg·m²)"}


def units(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """``force-unit`` as far as it shows before anything is estimated."""
    yield from _whole_numbers(trajectory)
    yield from _against_limit(trajectory, hardware)
    yield from _against_count(trajectory, hardware)
    yield from _out_of_reach(trajectory)


def mass_unit(trajectory: Trajectory, mass: float) -> Iterator[Finding]:
    """``force-unit`` where the mass is none a device has."""
    low, high = _MASS[trajectory.motion]
    if low <= mass <= high or mass <= 0:
        return
    unit = _MASS_UNIT[trajectory.motion]
    yield Finding(
        code="force-unit",
        severity="refusal",
        seen=f"{trajectory.source} gives a mass of {mass:.3g} {unit}",
        needed=f"{low:g} to {high:g} {unit}, which handles and axes have",
        remedy="Give what one unit of each column is in SI with --force-gain (mN, volts, "
        "amperes or counts?), --position-gain (mm or degrees?) and --time-gain (ms?), and "
        "state force_limit and encoder_resolution in the hardware file.",
    )


def _whole_numbers(trajectory: Trajectory) -> Iterator[Finding]:
    for name, column in (("force", trajectory.force), ("position", trajectory.position)):
        if not np.all(column == np.rint(column)) or np.ptp(column) < _WHOLE_NUMBERS:
            continue
        yield Finding(
            code="force-unit",
            severity="refusal",
            seen=f"every {name} in {trajectory.source} is a whole number, from "
            f"{column.min():.0f} to {column.max():.0f}",
            needed="SI units, not the counts of a converter",
            remedy=f"Give what one count is with --{name}-gain.",
        )


def _against_limit(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """Force far above what the actuator gives, or so small that it may be volts or amperes."""
    if hardware is None or hardware.force_limit is None:
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
    yield Finding(
        code="force-unit",
        severity="refusal",
        seen=f"{trajectory.source} reaches a force of {peak:.4g}; the actuator gives "
        f"{limit.continuous:.4g} continuous and {limit.peak:.4g} peak",
        needed=f"between {_UNDER_LIMIT * limit.continuous:.4g} and {limit.peak:.4g}, so that "
        "the unit of the column is no guess",
        remedy="Volts or amperes are possible: give N (N·m) per unit of the force column with "
        f"--force-gain (per ampere: torque constant and transmission{''.join(likely)}){sure}. "
        "Limits are those of the data sheet, in N (N·m) at the handle.",
    )


def _against_count(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """A count, or a scatter of readings, that is not that of the encoder stated.

    Noise or few digits may hide the count; a digit printed may look like one.
    """
    if hardware is None or hardware.encoder_resolution is None:
        return
    stated, seen = hardware.encoder_resolution.value, encoder_count(trajectory.position)
    likely, sure = "", ""
    if seen is not None and not 1 / _COUNT_RATIO < seen / stated < _COUNT_RATIO:
        ratio, words = seen / stated, f"steps by {seen:.4g}"
        needed = f"the same within a factor of {_COUNT_RATIO:g}"
        for unit, size in _LENGTHS[trajectory.motion or "linear"]:
            if abs(ratio * size - 1) < _NAMED:
                likely = f" (in {unit}: --position-gain {size:.6g})"
    elif "position" in trajectory.stated_units:
        return
    else:
        scatter = position_noise(trajectory.position, trajectory.force, trajectory.steps)
        if scatter <= _SCATTER * stated:
            return
        ratio, words = scatter / stated, f"scatters by {scatter:.4g} rms"
        needed = f"at most {_SCATTER:g} times"
        sure = ", or --position-gain 1 if it is"
    yield Finding(
        code="force-unit",
        severity="refusal",
        seen=f"position in {trajectory.source} {words}, {ratio:.3g} times the encoder "
        f"resolution {stated:.4g} of the hardware",
        needed=needed,
        remedy="Where position is not in m (rad), give what one unit of it is with "
        f"--position-gain{likely}{sure}. The encoder resolution is that of the data "
        "sheet, in m (rad) at the handle.",
    )


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
        remedy = (
            "If the axis turns, state motion: rotary in the hardware file (--hardware), and for "
            "degrees --position-gain 0.0174533; if it slides, state motion: linear and give "
            f"--position-gain, since the position looks like {wrong}."
        )
    yield Finding(
        code="force-unit",
        severity="refusal",
        seen=f"{trajectory.source} travels {travel:.4g} {unit} at up to {speed:.4g} "
        f"{unit}/s" + ("" if trajectory.motion else ", read as m"),
        needed=f"at most {farthest:g} {unit} and {fastest:g} {unit}/s",
        remedy=remedy,
    )


#: Travel in counts below which rounding is no longer noise but part of the motion.
_FEWEST_COUNTS = 100


def resolution(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """``few-counts``."""
    stated = None if hardware is None else hardware.encoder_resolution
    count = (
        finest_reading(trajectory.position, trajectory.force) if stated is None else stated.value
    )
    travel = float(np.ptp(trajectory.position))
    if travel >= _FEWEST_COUNTS * count:
        return
    yield Finding(
        code="few-counts",
        severity="refusal",
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
_A_TURN = 0.02  # a range within this part of a turn is named in the message


def encoder_wrap(trajectory: Trajectory) -> Iterator[Finding]:
    """``encoder-wrap``: jumps of one size, far above what speed allows.

    A counter that starts anew jumps by its range; a reading that is lost goes there and back.
    """
    jumps = _jumps(trajectory)
    if jumps.size == 0:
        return
    size = float(np.median(np.abs(jumps)))
    turn = trajectory.motion == "rotary" and abs(size / (2 * np.pi) - 1) < _A_TURN
    yield Finding(
        code="encoder-wrap",
        severity="refusal",
        seen=f"position in {trajectory.source} jumps {jumps.size} times by {size:.4g}"
        + (", one turn," if turn else "")
        + " from one sample to the next",
        needed=f"steps of at most {_FASTEST:g} times the others, as mass allows",
        remedy="Where a counter starts anew, add or subtract its range after each jump "
        f"(numpy.unwrap with period={size:.6g}); where a reading is lost, log it again.",
    )


def _jumps(trajectory: Trajectory) -> FloatArray:
    """Steps of position that are the range of a counter, with their signs."""
    steps = np.diff(trajectory.position)
    # What happens during a gap is unknown, but not a jump.
    whole = np.diff(trajectory.time) <= LOST * trajectory.sample_time
    steps = np.where(whole, steps, 0.0)
    size = np.abs(steps)
    largest = float(size.max())
    far = size > largest / 2
    usual = float(size[~far].max(initial=0.0))
    travel = float(np.ptp(trajectory.position))
    if usual == 0 or largest < _FASTEST * usual or largest < _LEAST_JUMP * travel:
        return np.empty(0)
    if np.ptp(size[far]) > _ALIKE * largest + 2 * usual:
        return np.empty(0)
    return steps[far]


#: Force counts as at its limit within this part of it (printed digits, one count of a converter).
_AT_LIMIT = 1e-4
_RUN = 5  # consecutive samples at the limit that a smooth signal does not reach by chance
_TOLERATED = 0.01  # part of the log in such runs that is tolerated
#: A force with at most this many distinct sizes is a switching signal, whose plateaus are meant.
_SWITCHING_LEVELS = 16


def saturation(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
    """``force-saturated``: long runs at the exact maximum, or more than the hardware can give."""
    size = np.abs(trajectory.force)
    peak = float(size.max())
    limit = None if hardware is None or hardware.force_limit is None else hardware.force_limit.peak
    if limit is not None and peak > limit * (1 + _AT_LIMIT):
        share = float(np.mean(size > limit * (1 + _AT_LIMIT)))
        yield Finding(
            code="force-saturated",
            severity="refusal",
            seen=f"{trajectory.source} asks for up to {peak:.4g}, more than the peak force "
            f"{limit:.4g} of the hardware in {share:.2%} of its samples",
            needed="force that the actuator can give",
            remedy="Give N (N·m) per unit of the force column with --force-gain if it is in "
            "volts, amperes or another unit; only if it is in N (N·m), excite more gently. The "
            "limit is that of the data sheet.",
        )
    share = _share_in_runs(size, peak * (1 - _AT_LIMIT))
    levels = np.unique(np.round(size / peak / _AT_LIMIT)).size
    if share > _TOLERATED and levels > _SWITCHING_LEVELS:
        yield Finding(
            code="force-saturated",
            severity="refusal",
            seen=f"{share:.1%} of {trajectory.source} stays at the largest force {peak:.4g} "
            f"for {_RUN} samples or more",
            needed=f"at most {_TOLERATED:.0%}",
            remedy="Excite more gently, so that the actuator gives what the log says.",
        )


def _share_in_runs(size: FloatArray, limit: float) -> float:
    """Part of all samples that lie in runs of at least _RUN at the limit, smooth tops left out."""
    edges = np.diff(np.concatenate(([0], (size >= limit).astype(np.int8), [0])))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    long = ends - starts >= _RUN
    runs = zip(starts[long].tolist(), ends[long].tolist(), strict=True)
    flat = [end - start for start, end in runs if not _smooth_top(size[start:end])]
    return sum(flat) / size.size


def _smooth_top(part: FloatArray) -> bool:
    """Whether it rises and then falls, as no force does that is cut off."""
    steps = np.sign(np.diff(part))
    return bool(
        np.count_nonzero(steps) > steps.size / 2 and np.all(np.diff(steps[steps != 0]) <= 0)
    )
