"""Forces that mass, damping, friction and offset do not explain: of place, of a hand, of rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.device.device import SlopeRange, UnmodelledForce
from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.estimate import Estimate, half_width
from identification.estimators.linear import solve, unit_columns
from identification.estimators.motion import running_maximum, running_range
from identification.estimators.signals import finest_reading
from identification.findings.force_balance import ForceBalance, balance_at
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

_POWERS = (1, 2, 3)  # powers of position that stand for any smooth force over the travel
#: Parts a log is cut into; what position explains is judged on the part it was not fitted on.
_PARTS = 4
#: Of the mean square that mass, damping and friction leave over, position explains this part in
#: rows it was not fitted on. Below, it may be chance.
_LEAST_GAIN = 0.3
_LEAST_SHARE = 0.02  # the rms force of position is at least this part of the rms force
#: A shift of mass or damping by less than this part is beyond what these coarse rows can tell.
_MATTERS = 0.05
_REMEDY = (
    "Level or counterbalance the axis, take off springs and cables, or subtract the known force of "
    "gravity from the force column."
)


def position_dependence(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate
) -> Iterator[Finding]:
    """``gravity``: a weight, a spring or a magnet whose force is not the same everywhere."""
    total = float(np.std(balance.force))
    gain, force = _position_force(balance)
    if gain >= _LEAST_GAIN and float(np.std(force)) >= _LEAST_SHARE * total:
        yield _uncarried(trajectory, balance, chosen, gain, force)
        return
    force = _carried_force(balance)
    share = float(np.std(force)) / total
    if share < _LEAST_SHARE:
        return
    yield Finding(
        code="gravity",
        severity="warning",
        seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel and "
        f"{share:.0%} of the force rms, acts in {trajectory.source}; the estimate has a term "
        "for it",
        needed=f"below {_LEAST_SHARE:.0%}",
        remedy=_REMEDY,
    )


def _uncarried(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate, gain: float, force: FloatArray
) -> Finding:
    columns = np.column_stack((balance.plant, balance.carried))
    plain = solve(columns, balance.force)
    fuller = solve(np.column_stack((columns, _powers_of(balance.position))), balance.force)
    shifts = [
        (name, abs(float(fuller[index] - plain[index])), half_width(chosen, name))
        for index, name in enumerate(("mass", "damping"))
    ]
    refused = any(
        moved > max(width, _MATTERS * abs(chosen.value(name))) for name, moved, width in shifts
    )
    told = ", ".join(f"{name} by {moved:.3g} (± {width:.2g})" for name, moved, width in shifts)
    return Finding(
        code="gravity",
        severity="refusal" if refused else "warning",
        seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel, explains "
        f"{gain:.0%} of what the other terms leave over in {trajectory.source}; it shifts {told}",
        needed=f"shifts below {_MATTERS:.0%}" if refused else f"below {_LEAST_SHARE:.0%}",
        remedy=_REMEDY,
    )


def _position_force_rms(balance: ForceBalance) -> float:
    """Rms of the force of position that the log shows, whether the estimate has it or not, N."""
    gain, force = _position_force(balance)
    return float(np.std(_carried_force(balance) + (force if gain >= _LEAST_GAIN else 0.0)))


def _carried_force(balance: ForceBalance) -> FloatArray:
    """Force of the position terms of the estimate's model at each row, N."""
    carried = balance.carried
    if carried.shape[1] == 0:
        return np.zeros(len(balance))
    weights = solve(np.column_stack((balance.plant, carried)), balance.force)
    return carried @ weights[-carried.shape[1] :]


def _position_force(balance: ForceBalance) -> tuple[float, FloatArray]:
    """How much of what the estimate's terms leave over position explains.

    Both where it was fitted and where it was not count, and the smaller share is taken: a part of
    the log that is faster than the rest is told badly without position, too.

    Gives the share of the mean square, at most 1, and its force at each row, N, mean zero.
    """
    moving = balance.moving
    powers = _powers_of(balance.position)
    plant = np.column_stack((balance.plant, balance.carried))
    table, norms = unit_columns(np.column_stack((plant, powers, balance.force))[moving])
    both, fewer = table.shape[1] - 1, plant.shape[1]
    if len(table) < _PARTS * both:
        return 0.0, np.zeros(len(balance))
    edges = -(-np.arange(_PARTS + 1) * len(table) // _PARTS)
    # R of each part (QR): what any columns leave of the force there is told by it alone.
    parts: list[FloatArray] = [
        np.asarray(np.linalg.qr(table[first:last], mode="r"), dtype=np.float64)
        for first, last in pairwise(edges.tolist())
    ]
    every = np.concatenate(parts)
    without, within = (
        sum(
            _left(np.concatenate(parts[:part] + parts[part + 1 :]), count, parts[part])
            for part in range(_PARTS)
        )
        for count in (fewer, both)
    )
    left, fuller = (_left(every, count, every) for count in (fewer, both))
    force: FloatArray = powers @ (_solved(every, both) / norms[:both])[fewer:] * norms[-1]
    kept = max(within / without if without > 0 else 1.0, fuller / left if left > 0 else 1.0)
    return 1 - kept, force - np.mean(force)


def _solved(rows: FloatArray, count: int) -> FloatArray:
    """Weights by which the first columns fit the last one, shape (count,)."""
    found = np.linalg.lstsq(rows[:, :count], rows[:, -1], rcond=None)[0]
    return np.asarray(found, dtype=np.float64)


def _left(fitted: FloatArray, count: int, shown: FloatArray) -> float:
    """Sum of squares that the first columns, fitted on some rows, leave of the last on others."""
    missed = shown[:, -1] - shown[:, :count] @ _solved(fitted, count)
    return float(missed @ missed)


def _powers_of(position: FloatArray) -> FloatArray:
    """Powers of position, -1 to 1 over the travel, shape (rows, 3)."""
    middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
    unit = (position - middle) / (half if half > 0 else 1.0)
    return np.stack([unit**power for power in _POWERS], axis=1)


#: Physiological tremor of hand and forearm, Hz, and the bands beside it that it is compared with
#: (Elble and Koller, Tremor, 1990).
TREMOR = (8.0, 12.0)
_BELOW, _ABOVE = (4.5, 7.0), (14.0, 20.0)
_HALF_WIDTH = 0.03  # half-width of the windows, s: they pass 85 % of a sine of 10 Hz
_SLOWEST = 0.01  # steps longer than this do not show a tremor, s
_PIECE = 2.0  # length of the pieces of the spectrum, s: bands of 2.5 Hz hold several lines
_PEAK = 1.7  # the rest is this many times stronger in the band of tremor than beside it, ...
#: ... its power there is this part of the force's own, or it is what a force excited there leaves
#: behind, ...
_UNDRIVEN = 0.04
_LEAST_TREMOR = 0.015  # ... and its rms there is this part of the rms force.
#: Above this part of the force the hand that trembles is as much in the log as the device is.
_MOST_TREMOR = 0.1
SLOW = 1.0  # slow motion of a hand, Hz, and the part of the rms force it may push with, unlogged
MOST_SLOW = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlogged:
    """Forces that the log does not know, at the pace of a hand."""

    tremor: float  # rms at TREMOR, N
    peak: float  # power there against that beside it, 0 where the force itself is strong there
    slow: float  # rms below 1 Hz, a force of position taken out, N
    #: rms of the force that these are judged against, N: of its changes, or of all of it in motion
    #: one way, where a steady force is what keeps the device moving
    force: float

    @property
    def shaking(self) -> bool:
        """Whether the tremor stands out and is more than a trace of the force."""
        return self.peak >= _PEAK and self.tremor >= _LEAST_TREMOR * self.force

    @property
    def much(self) -> bool:
        """Whether what pushed so is as much in the estimate as the device is."""
        shaken = self.shaking and self.tremor >= _MOST_TREMOR * self.force
        return shaken or self.slow >= MOST_SLOW * self.force


def unlogged(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> Unlogged:
    """Forces at the pace of a hand that mass, damping, friction and offset leave over."""
    tremor, peak = _tremor(trajectory, chosen)
    steady = float(np.mean(balance.force)) if balance.one_way else 0.0
    force = float(np.hypot(np.std(balance.force), steady))
    return Unlogged(tremor=tremor, peak=peak, slow=_slow(balance), force=force)


def hand(trajectory: Trajectory, balance: ForceBalance, left: Unlogged) -> Iterator[Finding]:
    """``hand-on-device``: forces that the log does not know, at the pace of a hand.

    Tremor alone disturbs like noise and widens the intervals: a warning. With a spring to the body,
    or as strong as the excitation, the mass and damping of the hand are in the estimate: a refusal.

    In motion one way nothing is called a hand. Ripple once a turn, a load and friction that varies
    look the same there, and a force of position is one of time; excitation.py says so instead.
    """
    if balance.one_way or not (left.shaking or left.slow >= MOST_SLOW * left.force):
        return
    spring = _position_force_rms(balance) >= _LEAST_SHARE * left.force
    refused = spring or left.much
    seen = [f"forces that {trajectory.source} does not log:"]
    if left.shaking:
        seen.append(
            f"tremor of {left.tremor:.3g} rms at {TREMOR[0]:g} to {TREMOR[1]:g} Hz, "
            f"{left.peak:.0f} times the power beside that band,"
        )
    seen.append(f"{left.slow / left.force:.0%} of the force below {SLOW:g} Hz")
    seen.append("and a spring to the body" if spring else "")
    yield Finding(
        code="hand-on-device",
        severity="refusal" if refused else "warning",
        seen=" ".join(seen).strip(),
        needed=f"no spring, tremor below {_MOST_TREMOR if refused else _LEAST_TREMOR:.1%} and "
        f"slow force below {MOST_SLOW:.0%} of the force",
        remedy="Take the hand off while logging: its mass, damping and stiffness are read as "
        "the device's.",
    )


def _tremor(trajectory: Trajectory, chosen: Estimate) -> tuple[float, float]:
    """Rms of the rest in the band of tremor, N, and its power there against that beside it.

    The latter is 0 where the force itself is so strong in the band that its rest may be an error
    of the model.
    """
    shortest = _PIECE / 2
    if trajectory.sample_time > _SLOWEST or np.ptp(trajectory.time) < shortest:
        return 0.0, 0.0
    rows = balance_at(trajectory, _HALF_WIDTH, chosen.delay)
    step = float(np.median(np.diff(rows.time)))
    piece = min(len(rows), round(_PIECE / step))
    if piece * step < shortest:
        return 0.0, 0.0
    frequency = np.fft.rfftfreq(piece, step)
    left, driven = (_density(each, step, piece) for each in (rows.unexplained(), rows.force))

    def power(density: FloatArray, band: tuple[float, float]) -> float:
        return float(np.mean(density[(frequency >= band[0]) & (frequency <= band[1])]))

    inside = power(left, TREMOR)
    beside = float(np.sqrt(power(left, _BELOW) * power(left, _ABOVE)))
    rms = float(np.sqrt(inside * (TREMOR[1] - TREMOR[0])))
    if beside == 0 or inside < _UNDRIVEN * power(driven, TREMOR):
        return rms, 0.0
    return rms, inside / beside


def _density(column: FloatArray, step: float, piece: int) -> FloatArray:
    """One-sided power spectral density of pieces that overlap by half, N²/Hz.

    Each less its mean and tapered (Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967,
    p. 70).
    """
    window = np.hanning(piece + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(column, piece)[:: piece - piece // 2]
    lines = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window)
    return 2 * step / float(window @ window) * np.mean(np.abs(lines) ** 2, axis=0)


def _slow(balance: ForceBalance) -> float:
    """Rms of what is left over below SLOW, a force of position taken out, N."""
    left = balance.unexplained(_powers_of(balance.position), balance.carried)
    step = float(np.median(np.diff(balance.time)))
    spectrum = np.fft.rfft(left)
    spectrum[np.fft.rfftfreq(left.size, step) > SLOW] = 0
    return float(np.std(np.fft.irfft(spectrum, left.size)))


#: The device stands where its position stays within this many readings of the finest resolution, a
#: count to either side, ...
_STILL = 3.0
#: ... for as long as it takes to move this many times as far at its usual speed: a slow turn is no
#: standstill, ...
_FURTHER = 10.0
_FEWEST = 20  # ... and for this many samples at least, this part of the log at most, ...
_LONGEST = 0.1
_CHANGES = 0.02  # ... while the force in the window changes by this part of its whole range.
#: Part of the log spent so above which friction is doubted, and above which too little motion is
#: left to tell mass and damping.
_DOUBTED_REST = 0.25
_REFUSED_REST = 0.9


def stiction(trajectory: Trajectory, hardware: Hardware | None) -> Iterator[Finding]:
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
    )


def _stuck(trajectory: Trajectory, hardware: Hardware | None) -> NDArray[np.bool_]:
    """Which of the n - 1 intervals lie in a standstill under a changing force."""
    place, force = trajectory.position, trajectory.force
    stated = None if hardware is None else hardware.encoder_resolution
    known = 0.0 if stated is None else stated.value
    fine = max(known, finest_reading(place, force))
    # Over spans long enough for the noise of a reading not to count as speed.
    span = max(1, place.size // 200)
    speed = float(np.sqrt(np.mean((place[span:] - place[:-span]) ** 2))) / span
    if speed == 0:  # a cycle of exactly this span
        return np.zeros(place.size - 1, dtype=np.bool_)
    width = 2 * (int(max(_FEWEST, _FURTHER * _STILL * fine / speed)) // 2) + 1
    if width >= _LONGEST * place.size:
        return np.zeros(place.size - 1, dtype=np.bool_)
    changes = running_range(force, width) >= _CHANGES * float(np.ptp(force))
    still = changes & (running_range(place, width) <= _STILL * fine)
    covered = running_maximum(still.astype(np.float64), width) > 0
    return covered[:-1] & covered[1:]


#: Friction that the slope over speed does not cover, because it falls, depends on position or
#: remembers, may make up this part of the force, both rms.
_MOST_SHARE = 0.15
_NAMED_SHARE = 0.01  # a kind named in a finding makes up at least this part of the force


def unmodelled(
    trajectory: Trajectory,
    chosen: Estimate,
    forces: Sequence[UnmodelledForce],
    slope: SlopeRange,
    fastest: float,
) -> Iterator[Finding]:
    """``unmodelled-force``: what the friction is, and the slopes that it has over speed."""
    named = [each for each in forces if each.share >= _NAMED_SHARE] or forces[:1]
    told = ", ".join(f"{each.words}, {each.share:.1%} of the force" for each in named)
    uncovered = [each for each in forces if not each.rises]
    refused = any(each.share > _MOST_SHARE for each in uncovered)
    unit, speed = ("N·s/m", "m/s") if trajectory.motion == "linear" else ("N·m·s/rad", "rad/s")
    seen = (
        f"{trajectory.source} shows {told}; from rest to {fastest:.3g} {speed} the slope of "
        f"friction runs from {slope.low:.4g} to {slope.high:.4g} {unit}, damping alone "
        f"is {chosen.value('damping'):.4g}"
    )
    if uncovered:
        needed = (
            f"at most {_MOST_SHARE:.0%} of the force that does not rise with speed"
            if refused
            else "friction that rises with speed, every slope of which the certificate covers"
        )
        remedy = (
            "Oil, align or exchange what rubs, free the cables, and log again; what is left must "
            "be allowed for in the margin: no proof covers friction that falls or depends on "
            "position."
        )
    else:
        needed = "Coulomb friction and constant damping, or slopes that the certificate covers"
        remedy = (
            "The certificate takes every slope. A log at the speeds of use gives a narrower range."
        )
    yield Finding(
        code="unmodelled-force",
        severity="refusal" if refused else "warning",
        seen=seen,
        needed=needed,
        remedy=remedy,
    )
