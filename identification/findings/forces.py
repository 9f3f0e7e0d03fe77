"""Forces that the model does not have, and logs whose parts tell different devices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from identification.errors import Finding, refusal
from identification.estimators.estimate import (
    Estimate,
    half_width,
    solve,
    spread,
    symmetric_inverse,
    unit_columns,
)
from identification.estimators.motion import running_maximum
from identification.findings.columns import standing
from identification.findings.force_balance import ForceBalance, balance_at, least_squares_residual
from identification.trajectory import BoolArray, FloatArray, IndexArray, Trajectory, finest_reading

_POWERS = (1, 2, 3)  # powers of position that stand for any smooth force over the travel
_PARTS = 4  # parts a log is cut into, each left out in turn
#: Of the mean square that mass, damping and friction leave over, position explains this part in
#: rows it was not fitted on. Below, it may be chance.
_LEAST_GAIN = 0.3
_LEAST_SHARE = 0.02  # the rms force of position is at least this part of the rms force
#: A shift of mass or damping by less than this part is beyond what these coarse rows can tell.
_MATTERS = 0.05
POSITION_REMEDY = (
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
        seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel and "
        f"{share:.0%} of the force rms, acts in {trajectory.source}; the estimate has a term "
        "for it",
        needed=f"below {_LEAST_SHARE:.0%}",
        remedy=POSITION_REMEDY,
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
    moves = ", ".join(f"{name} by {moved:.3g} (± {width:.2g})" for name, moved, width in shifts)
    return Finding(
        code="gravity",
        severity="refusal" if refused else "warning",
        seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel, explains "
        f"{gain:.0%} of what the other terms leave over in {trajectory.source}; it shifts {moves}",
        needed=f"shifts below {_MATTERS:.0%}" if refused else f"below {_LEAST_SHARE:.0%}",
        remedy=POSITION_REMEDY,
    )


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
#: The rest is this many times stronger in the band of tremor than beside it: what play, vibration,
#: friction and springs leave stays below 3, hands lie above, ...
_PEAK = 4.0
#: ... its power there is this part of the force's own, where no spring is, or it is what a force
#: excited there leaves behind, ...
_UNDRIVEN = 0.1
_LEAST_TREMOR = 0.015  # ... and its rms there is this part of the rms force.
#: Above this part of the force the hand that trembles is as much in the log as the device is.
_MOST_TREMOR = 0.1
SLOW = 1.0  # slow motion of a hand, Hz, and the part of the rms force it may push with, unlogged
MOST_SLOW = 0.15
#: A force of position of this part of the force may be a spring to the body: then this part of the
#: tremor or of the slow force is enough.
_HELD, _HELD_NEEDS = 0.1, 1 / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlogged:
    """Forces that the log does not know, at the pace of a hand."""

    tremor: float  # rms at TREMOR, N
    #: power there against that beside it; 0 where the logged force may have left it and no spring
    #: is there
    peak: float
    slow: float  # rms below 1 Hz, a force of position taken out, N
    spring: float  # rms of a force of position, N; 0 in motion one way
    needed: float  # part of the usual evidence that is enough, beside that force
    #: rms of the force that these are judged against, N: of its changes, or of all of it in motion
    #: one way, where a steady force is what keeps the device moving
    force: float

    @property
    def shaking(self) -> bool:
        """Whether the tremor stands out and is more than a trace of the force."""
        return self.peak >= _PEAK and self.tremor >= _LEAST_TREMOR * self.needed * self.force

    @property
    def pushing(self) -> bool:
        """Whether something pushes slowly."""
        return self.slow >= MOST_SLOW * self.needed * self.force

    @property
    def much(self) -> bool:
        """Whether what pushed so is as much in the estimate as the device is."""
        shaken = self.shaking and self.tremor >= _MOST_TREMOR * self.force
        return shaken or self.slow >= MOST_SLOW * self.force


def unlogged(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate, unexplained: float
) -> Unlogged:
    """Forces at the pace of a hand that mass, damping, friction and offset leave over."""
    steady = float(np.mean(balance.force)) if balance.one_way else 0.0
    force = float(np.hypot(np.std(balance.force), steady))
    slow, spring = _slow(trajectory, balance), 0.0
    if not balance.one_way:  # there a force of position would explain one of time
        slow = min(slow, unexplained * force)
        gain, further = _position_force(balance)
        carried = _carried_force(balance) + (further if gain >= _LEAST_GAIN else 0.0)
        spring = float(np.std(carried))
    held = spring >= _HELD * force
    tremor, peak = _tremor(trajectory, balance, chosen, held=held)
    tremor, needed = min(tremor, unexplained * force), _HELD_NEEDS if held else 1.0
    return Unlogged(tremor=tremor, peak=peak, slow=slow, spring=spring, needed=needed, force=force)


def hand(trajectory: Trajectory, balance: ForceBalance, left: Unlogged) -> Iterator[Finding]:
    """``hand-on-device``: forces that the log does not know, at the pace of a hand.

    Tremor alone disturbs like noise and widens the intervals: a warning. With a spring to the body,
    or as strong as the excitation, the mass and damping of the hand are in the estimate: a refusal.

    In motion one way nothing is called a hand. Ripple once a turn, a load and friction that varies
    look the same there, and a force of position is one of time; ``excitation`` says so instead.
    """
    if balance.one_way or not (left.shaking or left.pushing):
        return
    spring = left.spring >= _LEAST_SHARE * left.force
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
        f"slow force below {MOST_SLOW * left.needed:.1%} of the force",
        remedy="Take the hand off while logging: its mass, damping and stiffness are read as "
        "the device's.",
    )


#: Forces at which the answer of the device may bend, as quantiles of those of the log in motion.
_KNEES = np.linspace(0.1, 0.97, 18)
#: A bend at one of them leaves at most this part of the mean square that no bend leaves. Springs,
#: friction, hands, play and lags that nobody stated leave 0.71 or more.
_BENT = 0.6
#: Less than this part of the acceleration, rms, is nothing that needs a bend.
_STRAIGHT = 2e-3
_FEWEST_BENT = 64  # rows in motion at least


def uneven_actuator(trajectory: Trajectory, balance: ForceBalance) -> Iterator[Finding]:
    """``force-saturated``: more force moves the device less, or more, than the force before it.

    The acceleration is explained by force, friction and place, and by the force beyond a knee as
    well: what the actuator gives is no straight line of what the log says (Hammerstein model).
    """
    moving = balance.moving
    if np.count_nonzero(moving) < _FEWEST_BENT or balance.one_way:
        return
    way, fast = balance.direction, balance.velocity / np.max(np.abs(balance.velocity))
    friction = (fast, way, np.ones_like(way), fast * way, fast**3, way * np.sqrt(np.abs(fast)))
    columns = np.column_stack((balance.force, *friction, _powers_of(balance.position)))[moving]
    force, answer = balance.force[moving], balance.acceleration[moving]
    straight = least_squares_residual(columns, answer)
    if np.std(straight) <= _STRAIGHT * np.std(answer):
        return

    def bent(knee: float) -> FloatArray:
        """The columns, and the force beyond a knee."""
        return np.column_stack((columns, force - np.clip(force, -knee, knee)))

    def left_by(knee: float, rows: slice, straight: FloatArray) -> float:
        """Part of what no bend leaves, that a bend at this force does."""
        left = np.sum(least_squares_residual(bent(knee)[rows], answer[rows]) ** 2)
        return float(left / np.sum(straight**2))

    knees = np.quantile(np.abs(force), _KNEES).tolist()
    share, knee = min((left_by(knee, slice(None), straight), knee) for knee in knees)
    # A device that changes in between has no bend in either half.
    halves = (slice(None, answer.size // 2), slice(answer.size // 2, None))
    parts = [(rows, least_squares_residual(columns[rows], answer[rows])) for rows in halves]
    if max(share, *(left_by(knee, *part) for part in parts)) > _BENT:
        return
    weights = solve(bent(knee), answer)
    part = float((weights[0] + weights[-1]) / weights[0])
    where, less = ("above", part) if part < 1 else ("below", 1 / part)
    yield refusal(
        "force-saturated",
        seen=f"{where} some {knee:.3g} of the force of {trajectory.source} more of it moves the "
        f"device {max(less, 0.0):.0%} as much as elsewhere, which explains "
        f"{1 - share:.0%} of what mass and friction leave over",
        needed="the same answer to every force",
        remedy="Log the force that the actuator gives, or excite within what it gives evenly.",
    )


def _tremor(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate, *, held: bool
) -> tuple[float, float]:
    """Rms of the rest in the band of tremor, N, and its power there against that beside it."""
    shortest = _PIECE / 2
    if trajectory.sample_time > _SLOWEST or np.ptp(trajectory.time) < shortest:
        return 0.0, 0.0
    rows = replace(balance_at(trajectory, _HALF_WIDTH, chosen.delay), gravity=balance.gravity)
    step = float(np.median(np.diff(rows.time)))
    piece = min(len(rows), round(_PIECE / step))
    if piece * step < shortest:
        return 0.0, 0.0
    frequency = np.fft.rfftfreq(piece, step)

    def power(density: FloatArray, band: tuple[float, float]) -> float:
        return float(np.mean(density[(frequency >= band[0]) & (frequency <= band[1])]))

    left = rows.unlogged(_at_rest(trajectory, rows), rows.carried, _powers_of(rows.position))
    rest, whole = (_density(each, step, piece) for each in (left, rows.force))
    shaking, beside = power(rest, TREMOR), np.sqrt(power(rest, _BELOW) * power(rest, _ABOVE))
    driven = not held and shaking < _UNDRIVEN * power(whole, TREMOR)
    peak = 0.0 if driven or beside == 0 else float(shaking / beside)
    return float(np.sqrt(shaking * (TREMOR[1] - TREMOR[0]))), peak


def _at_rest(trajectory: Trajectory, rows: ForceBalance) -> BoolArray:
    """In which rows the device stands for some time."""
    still, width = standing(trajectory, finest_reading(trajectory.position, trajectory.force))
    stands = np.append(0, np.cumsum(running_maximum(still.astype(np.float64), width) > 0))
    # Rows follow each other by half of the half-width of their windows.
    reach = 2 * float(np.median(np.diff(rows.time)))
    first, last = (np.searchsorted(trajectory.time, rows.time + off) for off in (-reach, reach))
    return stands[last] > stands[first]


def _density(column: FloatArray, step: float, piece: int) -> FloatArray:
    """One-sided power spectral density of pieces that overlap by half, N²/Hz.

    Each less its mean and tapered (Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967,
    p. 70).
    """
    window = np.hanning(piece + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(column, piece)[:: piece - piece // 2]
    lines = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window)
    return 2 * step / float(window @ window) * np.mean(np.abs(lines) ** 2, axis=0)


def _slow(trajectory: Trajectory, balance: ForceBalance) -> float:
    """Rms of what is left over below SLOW, a force of position taken out, N."""
    left = balance.unlogged(
        _at_rest(trajectory, balance), _powers_of(balance.position), balance.carried
    )
    step = float(np.median(np.diff(balance.time)))
    spectrum = np.fft.rfft(left)
    spectrum[np.fft.rfftfreq(left.size, step) > SLOW] = 0
    return float(np.std(np.fft.irfft(spectrum, left.size)))


#: A prediction may miss by this part of the rms force more than a fit of the part itself does; ...
_DOUBTED = 0.05
_REFUSED = 0.25  # ... beyond this the parts are not of one device.
#: ... and by this many standard deviations of the prediction itself, or the rest says too little.
_SIGMAS = 4.0
_JUDGED = ("mass", "damping")  # parameters that must not move
_HARMLESS = 0.02  # a move that is this part of the value, or less, matters to no margin


def cross_validation(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate
) -> Iterator[Finding]:
    """``heldout-misfit``: the device changed while it was logged, or the model is wrong."""
    missed = _held_out_errors(balance, chosen)
    worst = int(np.argmax(missed))
    share = float(missed[worst] / np.std(balance.force))
    if share < _DOUBTED:
        return
    start, span = float(balance.time[0]), float(balance.time[-1] - balance.time[0])
    first, last = (start + span * part / _PARTS for part in (worst, worst + 1))
    refused = share >= _REFUSED
    yield Finding(
        code="heldout-misfit",
        severity="refusal" if refused else "warning",
        seen=f"fitted on the rest of {trajectory.source}, the force from {first:.3g} to "
        f"{last:.3g} s is missed by {share:.0%} of its rms more than by a fit of its own",
        needed=f"at most {_REFUSED if refused else _DOUBTED:.0%}",
        remedy="Log again with nothing loose, warmed up and untouched; cut the log where the "
        "device changed.",
    )


def cut_off_sensitivity(trajectory: Trajectory, chosen: Estimate) -> Iterator[Finding]:
    """``heldout-misfit``: what the cut-off moves is more than the interval without it holds.

    A model that is right is right at every frequency. The move is in the interval all the same.
    """
    if chosen.choice_shift is None:
        return
    alone = replace(
        chosen, covariance=chosen.covariance - np.outer(chosen.choice_shift, chosen.choice_shift)
    )
    moved = {
        name: abs(float(chosen.choice_shift[chosen.parameters.index(name)])) for name in _JUDGED
    }
    unstable = [
        name
        for name, move in moved.items()
        if move > half_width(alone, name) and move > _HARMLESS * abs(chosen.value(name))
    ]
    if not unstable:
        return
    seen = " and ".join(
        f"{name} {chosen.value(name):.4g} ± {half_width(alone, name):.2g} by ± {moved[name]:.2g}"
        for name in unstable
    )
    yield Finding(
        code="heldout-misfit",
        seen=f"another cut-off moves the {seen} in {trajectory.source}",
        needed="a move within the interval",
        remedy="A force that the model does not have acts at some frequencies: excite harder, "
        "and look for play, vibration or friction that depends on place.",
    )


def _held_out_errors(balance: ForceBalance, chosen: Estimate) -> FloatArray:
    """Excess of each part's prediction over its own fit, rms in N, shape (parts,); 0 if chance.

    Only rows of a part that move no faster than the rest count: others are extrapolated.
    """
    # A term that the estimate does without would only follow chance where the rest is slow.
    terms = balance.plant if chosen.model.directional else balance.plant[:, :-1]
    columns, _ = unit_columns(np.column_stack((terms, balance.carried)))
    part, slow = np.arange(len(balance)) * _PARTS // len(balance), balance.moving
    for column in (np.abs(balance.acceleration), np.abs(balance.velocity)):
        fastest = np.array([np.max(column[part == each]) for each in range(_PARTS)])
        others = np.array([np.max(np.delete(fastest, each)) for each in range(_PARTS)])
        slow &= column <= others[part]
    pairs = [(balance.moving & (part != each), slow & (part == each)) for each in range(_PARTS)]
    return np.array([_held_out_error(columns, balance.force, *pair) for pair in pairs])


def _held_out_error(
    columns: FloatArray, force: FloatArray, rest: BoolArray, own: BoolArray
) -> float:
    """What some rows predict worse of others than these by themselves, rms in N; 0 if chance."""
    if min(np.count_nonzero(rest), np.count_nonzero(own)) < _ROWS:
        return 0.0
    parts = [(columns[rows], force[rows]) for rows in (rest, own)]
    fits: list[FloatArray] = [
        symmetric_inverse(table.T @ table) @ (table.T @ right) for table, right in parts
    ]
    shown = parts[1][0]
    excess = float(np.mean((shown @ (fits[0] - fits[1])) ** 2))
    if excess < (_DOUBTED * np.std(force)) ** 2:
        return 0.0
    chance = 0.0
    for (table, right), found in zip(parts, fits, strict=True):
        around = spread(table.T, right - table @ found, found.size, signal=right).covariance
        chance += float(np.sum((shown.T @ shown) * around)) / len(shown)
    return float(np.sqrt(excess)) if excess > _SIGMAS**2 * chance else 0.0


#: Bands of velocity in each direction at most, and rows in each at least: two take up what
#: the straight line costs, the others tell.
_BANDS = 20
_ROWS = 24
_EITHER = 0.2  # ... of which this part, at least, is accelerated, and as many braked.
_FEWEST_BANDS = 4  # bands without which there is no judgement
_STRETCHES = 30  # stretches of the log left out in turn for the deviation
#: Windows, the delay and what friction remembers are good to this part of the mass.
_SYSTEMATIC = 0.01
_MASS_SIGMAS = 4.0  # deviations of the difference beyond which the estimate is not of this device
#: ... and part of the mass beyond which it is refused; below, stability margins absorb it.
_REFUSED_MASS = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class _Inertia:
    """Mass told by rows at equal velocity."""

    least: float  # slope of force over acceleration, kg (kg·m²)
    most: float  # inverse slope of acceleration over force, kg (kg·m²)
    deviation: float  # standard deviation of either, kg (kg·m²)

    def outside(self, estimate: Estimate) -> float:
        """How far the mass of an estimate lies below (negative) or above the bounds, kg (kg·m²)."""
        mass = estimate.value("mass")
        return mass - float(np.clip(mass, self.least, self.most))

    def contradicts(self, estimate: Estimate) -> bool:
        """Whether a mass lies further outside than chance and its own doubt explain."""
        chance = float(np.hypot(self.deviation, estimate.deviation("mass")))
        return abs(self.outside(estimate)) > _MASS_SIGMAS * chance


def inertia_of(balance: ForceBalance) -> _Inertia | None:
    """The mass that a log tells without a model of friction; None where it tells too little."""
    moving = np.flatnonzero(balance.moving)
    velocity = balance.velocity[moving]
    acceleration, force = balance.acceleration[moving], balance.force[moving]
    carried, bands = balance.carried[moving], 0
    columns = np.column_stack((acceleration, force, carried))
    left: list[FloatArray] = []
    rows_used: list[IndexArray] = []
    for sense in (1.0, -1.0):
        side = np.flatnonzero(sense * velocity > 0)
        side = side[np.argsort(velocity[side])]
        parts = np.array_split(side, max(1, min(_BANDS, side.size // _ROWS)))
        sizes = np.array([part.size for part in parts])
        gaining = _sums(sense * acceleration[side] > 0, sizes)
        either = np.minimum(gaining, sizes - gaining)
        tells = (sizes >= _ROWS) & (either >= _EITHER * sizes)
        bands += np.count_nonzero(tells)
        kept = np.repeat(tells, sizes)
        left.append(_levelled(columns[side], velocity[side], sizes)[kept])
        rows_used.append(side[kept])
    if bands < _FEWEST_BANDS:
        return None
    table, rows = np.concatenate(left), np.concatenate(rows_used)
    if table.shape[1] > 2:
        table[:, :2] = np.stack(
            [least_squares_residual(table[:, 2:], each) for each in table[:, :2].T], axis=1
        )
    change, pull = table[:, 0], table[:, 1]
    power, both = float(change @ change), float(change @ pull)
    if both <= 0:
        return None
    value = both / power
    stretch = moving[rows] * _STRETCHES // len(balance)
    squares = np.bincount(stretch, change * change, minlength=_STRETCHES)
    scores = np.bincount(stretch, change * (pull - value * change), minlength=_STRETCHES)
    # A stretch that alone tells nearly all leaves no judgement of the others.
    if np.max(squares) > 0.5 * power:
        return None
    shifts = scores / (power - squares)
    chance = float(np.sqrt((_STRETCHES - 1) / _STRETCHES * np.sum(shifts**2)))
    return _Inertia(
        least=value,
        most=float(pull @ pull) / both,
        deviation=float(np.hypot(chance, _SYSTEMATIC * value)),
    )


def _sums(rows: FloatArray | BoolArray, sizes: IndexArray) -> FloatArray:
    """Sum of the rows of each band, shape (bands, ...)."""
    if not len(rows):
        return np.zeros((sizes.size, *rows.shape[1:]))
    return np.add.reduceat(rows, np.cumsum(sizes) - sizes, axis=0, dtype=np.float64)


def _levelled(columns: FloatArray, velocity: FloatArray, sizes: IndexArray) -> FloatArray:
    """Columns less a straight line in velocity in each band, shape (rows, columns)."""
    both = np.column_stack((velocity, columns))
    both = both - np.repeat(_sums(both, sizes) / np.maximum(sizes, 1)[:, None], sizes, axis=0)
    speed, rest = both[:, :1], both[:, 1:]
    power = _sums(speed * speed, sizes)
    slopes = _sums(speed * rest, sizes) / np.where(power > 0, power, 1.0)
    return rest - speed * np.repeat(slopes, sizes, axis=0)


def inertia(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> Iterator[Finding]:
    """``heldout-misfit``: the mass is not the one that rows at equal velocity tell."""
    judge = inertia_of(balance)
    if judge is None or not judge.contradicts(chosen):
        return
    mass, doubt = chosen.value("mass"), 2 * judge.deviation
    refused = abs(judge.outside(chosen)) > _REFUSED_MASS * abs(mass)
    needed = f"{_REFUSED_MASS:.0%}" if refused else f"{_MASS_SIGMAS:g} deviations"
    yield Finding(
        code="heldout-misfit",
        severity="refusal" if refused else "warning",
        seen=f"at equal velocity the force of {trajectory.source} while accelerating, less that "
        f"while braking, tells a mass from {judge.least:.4g} to {judge.most:.4g}, ± {doubt:.2g}, "
        f"{chosen.method.replace('-', ' ')} {mass:.4g} ± {2 * chosen.deviation('mass'):.2g}",
        needed=f"within {needed}",
        remedy="The friction is not what the model has: excite faster, so that inertia is "
        "more of the force, and look for play, cables or a gear that remember the motion.",
    )
