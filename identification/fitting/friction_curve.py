"""What the residual of a log holds beside noise, and what that does to mass and to damping.

Every kind of force that the model lacks is put to the log in turn, as a few columns that follow any
force of that kind closely enough to find it, and to give mass and damping without it;
docs/theory.md, 7. What the kinds found leave over counts against the slope of friction in the
proportion in which they themselves moved damping.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from identification.device.device import Kind, SlopeRange, UnmodelledForce
from identification.device.quantities import LARGEST
from identification.errors import Finding
from identification.estimators.estimate import Estimate, symmetric_inverse, unit_columns, wald
from identification.estimators.filters import LowPass, width_of
from identification.estimators.least_squares import Regression
from identification.estimators.signals import HeldColumn
from identification.fitting.stability_selection import BLOCKS, STABLE, Blocks, least_norm
from identification.trajectory import NORMAL_95, FloatArray, Trajectory

#: Widths of the bells of speed, parts of the fastest.
_BELLS = (0.03, 0.06, 0.12, 0.25)
#: Waves of position over the travel: of damping, ...
_DAMPING_WAVES = 8
#: ... and of force.
_WAVES = 16
#: Part of the mean square of a smoothed velocity that may be noise of position.
_SPEED_NOISE = 1e-4
#: Widths of the springs that yield, parts of the travel.
_WIDTHS = (0.15, 0.05, 0.015, 0.005, 0.0015)
#: Speeds, places and times at which slopes are taken.
_SPEEDS, _PLACES, _TIMES = 21, 65, 9
#: Probability that a kind is found by chance, for each kind and log.
_CHANCE = 1e-6
#: What a kind takes away from the residual is at least this part of the force, both rms. Less moves
#: damping by less than amplifiers and calibrations do; waves of position are many, and follow more
#: of a short log by chance.
_LEAST: dict[Kind, float] = {
    "drag": 0.002,
    "falling": 0.003,
    "memory": 0.003,
    "place": 0.007,
    "position": 0.007,
    "drift": 0.003,
}
#: ... and this part of what is left, mean squares: the first of all, and a further one. Position
#: also follows what a controller answers to forces nobody logged: up to 0.35 of what is left in 200
#: such logs, where a force of position of 1.5 % of all took 0.87 or more. Drag has two columns that
#: nothing else resembles, and is found in noise as well.
_FIRST, _FURTHER = 0.25, 0.5
#: Kinds in one log at most.
_MOST = 3
#: Standard deviations by which a slope may be off.
_SURE = 2 * NORMAL_95
#: Time between coarse rows, parts of the period of the cut-off, and independent rows in a period.
_COARSE, _INDEPENDENT = 0.125, 2.13
#: Part of a rest that hints at a kind, or so many deviations above what chance explains; directions
#: weaker than the last, of columns of norm 1, carry nothing.
_HINTED, _BY_CHANCE, _ALIKE = 0.1, 3.0, 1e-9
#: Least stiffness before sliding, part of the largest: below it the device as good as slides.
_SOFTEST = 0.01
#: Friction that the slope over speed does not cover, because it falls, depends on position or
#: remembers, may make up this part of the force, both rms, ...
_MOST_SHARE = 0.15
#: ... or this, where it leaves so little of the force over that mass and damping are told.
_MOST_EXPLAINED, _LITTLE_LEFT = 0.5, 0.04
_NAMED_SHARE = 0.01  # a kind named in a finding makes up at least this part of the force
#: A slope over the speeds seen that would take this many times the largest force is not told.
_STEEPEST = 10.0


def stop_operators(position: FloatArray, widths: Sequence[float]) -> FloatArray:
    """Stretch of each spring over its width, -1 to 1, from rest at the first sample."""
    moves = np.diff(position).tolist()
    courses: list[FloatArray] = []
    for width in widths:
        stretch, course = 0.0, [0.0]
        for move in moves:
            stretch += move
            if not -width <= stretch <= width:
                stretch = width if stretch > 0 else -width
            course.append(stretch)
        courses.append(np.array(course) / width)
    return np.stack(courses)


@dataclass(frozen=True)
class _Forces:
    """The kinds of force of one log."""

    table: Regression  # its regression, direction of motion settled
    stride: int = 1  # intervals that are taken as one

    @cached_property
    def fastest(self) -> float:
        """Fastest speed seen, smoothed, m/s."""
        return float(np.max(np.abs(self._speed)))

    def columns(self, kinds: int | None) -> dict[Kind, FloatArray]:
        """Filtered columns of the first kinds, shape (rows, its columns); none zero or wild."""
        moving, steps = self.table.motion.moving, self.table.signals.steps
        found: dict[Kind, FloatArray] = {}
        for kind, held in islice(self.held(), kinds):
            made = [self.table.filtered(HeldColumn.constant(each * moving, steps)) for each in held]
            found[kind] = np.stack(made, axis=1)
        return found

    def slopes(self, kind: Kind) -> FloatArray:
        """What each column of a kind adds to the slope of friction over speed, N·s/m a unit.

        One row each of the speeds and places, rest first; one row of zeros stands for a kind that
        is no static function of speed, or one that falls.
        """
        if kind == "drag":
            speed = np.linspace(0.0, 1.0, _SPEEDS)
            return np.stack((2 * speed, 3 * speed**2), axis=1) / self.fastest
        if kind == "place":
            place = np.quantile(self._place, np.linspace(0.01, 0.99, _PLACES))
            return np.stack(list(_waves(place, _DAMPING_WAVES)), axis=1) / self.fastest
        if kind == "drift":
            time = np.linspace(-1.0, 1.0, _TIMES)
            slopes = np.stack((time, time**2), axis=1) / self.fastest
            return np.column_stack((slopes, np.zeros_like(slopes)))
        count = {"falling": len(_BELLS), "position": 1 + 2 * _WAVES, "memory": 1 + len(_WIDTHS)}
        return np.zeros((1, count[kind]))

    def stiffnesses(self) -> FloatArray:
        """What each column of memory adds to the stiffness before sliding, N/m a unit.

        One row a state: all springs yield, then the widest holds, then one more each.
        """
        travel = float(np.ptp(self.table.signals.position))
        springs = 1 / (np.array(_WIDTHS) * travel)
        held = np.tril(np.ones((len(_WIDTHS) + 1, len(_WIDTHS))), -1)
        return np.column_stack((np.full(len(held), 2 / travel), held * springs))

    def rigid(self, delay: float) -> Iterator[list[FloatArray]]:
        """Columns that resemble what a lag, load, play and a mass by position leave."""
        force = self.thin(self.table.held_force(delay).mean())
        speed, place = self.thin(self._speed), self.thin(self._place)
        slope, bend = np.gradient(force), np.gradient(speed)
        yield [slope, np.gradient(slope)]
        yield [np.abs(force) * self.sense]
        yield [bend * (1 - np.abs(stop)) for stop in self.stops]
        yield [each * bend + np.gradient(each) * speed / 2 for each in (place, place**2)]

    def thin(self, held: FloatArray) -> FloatArray:
        """Means over as many intervals as are taken as one."""
        count = held.size // self.stride
        return held[: count * self.stride].reshape(count, self.stride).mean(axis=1)

    @cached_property
    def sense(self) -> FloatArray:
        """Direction of motion."""
        return self.thin(self.table.motion.direction.mean())

    @cached_property
    def stops(self) -> FloatArray:
        """Stretch of the springs that yield."""
        position = self.table.signals.position
        widths = [width * np.ptp(position) for width in _WIDTHS]
        stops = stop_operators(position[:: self.stride], widths)[:, : self.sense.size + 1]
        return (stops[:, 1:] + stops[:, :-1]) / 2

    @cached_property
    def _speed(self) -> FloatArray:
        """Velocity of each interval, as smooth as noise of position asks for and no more.

        White noise of deviation σ has σ²·h/(4·√π·w³) of variance in the velocity under a bell of
        deviation w. The low-pass of the table, which is set by the acceleration, is the widest.
        """
        from scipy.ndimage import gaussian_filter1d

        signals, widest = self.table.signals, width_of(self.table.cut_off.frequency)
        noisy = signals.noise**2 * signals.step / (4 * np.sqrt(np.pi) * _SPEED_NOISE)
        width = min(float(np.cbrt(noisy / np.var(signals.speed))), widest) / signals.step
        return np.asarray(gaussian_filter1d(signals.speed, width, mode="nearest"), dtype=np.float64)

    @cached_property
    def _place(self) -> FloatArray:
        """Mean position of each interval, -1 to 1 over the travel."""
        position = self.table.signals.position
        middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
        return ((position[1:] + position[:-1]) / 2 - middle) / half

    def held(self) -> Iterator[tuple[Kind, list[FloatArray]]]:
        """Columns of each kind of force, one value an interval of the log."""
        unit = self.thin(self._speed) / self.fastest
        yield "drag", [np.abs(unit) * unit, unit**3]
        place, sense = self.thin(self._place), self.sense
        time = np.linspace(-1.0, 1.0, unit.size)
        yield "falling", [sense * np.exp(-((unit / width) ** 2)) for width in _BELLS]
        yield "place", [unit * wave for wave in _waves(place, _DAMPING_WAVES)]
        yield "position", [place, *_waves(place, _WAVES)]
        yield "memory", [place, *self.stops]
        yield "drift", [each * power for each in (unit, sense) for power in (time, time**2)]


def _waves(place: FloatArray, count: int) -> Iterator[FloatArray]:
    """Cosines and sines with 1 to ``count`` half periods from the middle to an end."""
    turn = wave = np.exp(1j * np.pi * place).astype(np.complex128)
    for _ in range(count):
        yield np.real(wave)
        yield np.imag(wave)
        wave = wave * turn


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionCurve:
    """Friction as one log shows it, where it is not constant damping and Coulomb friction."""

    found: tuple[UnmodelledForce, ...]  # kinds of force, the largest first
    slope: SlopeRange  # of friction over speed, from rest to ``fastest``
    fastest: float  # speed seen, m/s
    #: stiffness of friction with a memory while it holds, N/m, above zero; None where there is none
    presliding: SlopeRange | None
    mass: float  # kg, with the kinds in the regression
    mass_deviation: float  # standard deviation of it, kg
    left: float  # rms over that of the force of what the model and the kinds leave over

    def carried_by(self, estimate: Estimate) -> Estimate:
        """An estimate with the mass that the friction found leaves, known no better than before."""
        if self.mass <= 0:
            return estimate
        values, covariance = estimate.values.copy(), estimate.covariance.copy()
        values[0] = self.mass
        before = estimate.deviation("mass")
        deviation = max(before, self.mass_deviation)
        factor = deviation / before if before > 0 else 0.0
        covariance[0, :] *= factor
        covariance[:, 0] *= factor
        covariance[0, 0] = deviation**2
        note = f"mass {estimate.value('mass'):.5g} without the friction found beyond the model"
        return replace(
            estimate, values=values, covariance=covariance, notes=(*estimate.notes, note)
        )


@dataclass(frozen=True, slots=True)
class _Fit:
    """Least squares with some kinds beside the model."""

    values: FloatArray  # coefficients of the model and the kinds, SI units
    covariance: FloatArray  # of them
    places: Mapping[Kind, slice]  # where those of each kind stand

    @classmethod
    def of(cls, own: Blocks[Kind], kinds: Sequence[Kind]) -> _Fit:
        fitted, covariance = own.fit(kinds)
        scales = own.scales[own.chosen(kinds)]
        places: dict[Kind, slice] = {}
        first = len(own.base)
        for kind in kinds:
            places[kind] = slice(first, first + len(own.members[kind]))
            first = places[kind].stop
        return cls(fitted * scales, covariance * np.outer(scales, scales), places)

    def weighted(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weighted sums of the coefficients, and how far each may be off."""
        variance = np.einsum("ij,jk,ik->i", weights, self.covariance, weights)
        return weights @ self.values, _SURE * np.sqrt(np.maximum(variance, 0.0))


def _is_sure(own: Blocks[Kind], kind: Kind, beside: Sequence[Kind]) -> bool:
    """Whether Wald's statistic of a kind exceeds what chance does with _CHANCE."""
    from scipy.special import fdtri

    fitted, covariance = own.fit((*beside, kind))
    count = len(own.members[kind])
    freedom = BLOCKS - count
    chance = count * (BLOCKS - 1) / freedom * float(fdtri(count, freedom, 1 - _CHANCE))
    return wald(fitted[-count:], covariance[-count:, -count:]) >= chance


def follows_motion(table: Regression, delay: float) -> bool:
    """Whether forces, a lag, load or play may explain more than chance does: a coarse look."""
    frequency, step = table.cut_off.frequency, table.signals.step
    stride = int(_COARSE / (frequency * step))
    if stride <= 1:
        return True
    forces, low_pass = _Forces(table, stride), LowPass.at(frequency, stride * step)
    # Rows of the table in the middle of the coarse ones.
    rows = (np.arange(forces.sense.size - 2 * low_pass.half) + low_pass.half) * stride
    rows += stride // 2 - table.first
    inside = (rows >= 0) & (rows < table.columns.shape[1])
    rows = rows[inside]
    basis = np.linalg.qr(table.columns[:, rows].T)[0]
    left = table.force(delay)[rows]
    left = left - basis @ (left @ basis)
    independent = _INDEPENDENT * frequency * step * stride * rows.size
    groups = [*(held for _, held in forces.held()), *forces.rigid(delay)]
    for group in groups:
        seen = low_pass(np.stack(group))[:, inside]
        seen = unit_columns((seen - seen @ basis @ basis.T).T)[0]
        right = left @ seen
        part = float(right @ symmetric_inverse(seen.T @ seen, _ALIKE) @ right / (left @ left))
        count = len(group)
        if part > max(_HINTED, (count + _BY_CHANCE * np.sqrt(2 * count)) / independent):
            return True
    return False


def friction_curve(
    table: Regression, delay: float, *, structured: bool = True
) -> FrictionCurve | None:
    """Kinds of friction beyond the model, of a rest without structure drag alone; or None."""
    forces = _Forces(table)
    columns, answer = forces.columns(None if structured else 1), table.force(delay)
    own = Blocks[Kind].of(table.columns.T, columns, answer)
    if answer.size < BLOCKS * (own.scales.size + 1) / 4 or not np.any(answer):
        return None
    noticed = _kinds(own)
    often = own.often_asked(noticed) if noticed else []
    kinds: list[Kind] = [each for each, part in zip(noticed, often, strict=True) if part >= STABLE]
    return _curve(own, kinds, forces) if kinds else None


def _kinds(own: Blocks[Kind]) -> list[Kind]:
    """The kinds found, the one that takes most away first."""
    kinds: list[Kind] = []
    while len(kinds) < _MOST:
        left = own.left(kinds)
        others: list[Kind] = [kind for kind in own.members if kind not in kinds]
        gone: dict[Kind, float] = {each: left - own.left([*kinds, each]) for each in others}
        noticed: list[Kind] = []
        for each in others:
            part = _FURTHER if kinds or each == "position" else 0.0 if each == "drag" else _FIRST
            if gone[each] >= max(_LEAST[each] ** 2, part * left) and _is_sure(own, each, kinds):
                noticed.append(each)
        if not noticed:
            break
        kinds.append(max(noticed, key=gone.__getitem__))
    return kinds


def _curve(own: Blocks[Kind], kinds: Sequence[Kind], forces: _Forces) -> FrictionCurve:
    linear, fit = _Fit.of(own, ()), _Fit.of(own, kinds)
    left = float(np.sqrt(own.left(kinds) / own.left(())))
    moved = np.abs(fit.values[:2] - linear.values[:2]) * left
    low, high = _slope_range(fit, forces)
    others: list[Kind] = [each for each in own.members if each not in kinds]
    for other in others:
        # One that explains the log so well alone that the first finds nothing beside it.
        if _is_sure(own, other, ()) and not _is_sure(own, kinds[0], (other,)):
            below, above = _slope_range(_Fit.of(own, (other,)), forces)
            low, high = min(low, below), max(high, above)
    return FrictionCurve(
        found=tuple(UnmodelledForce(kind=kind, share=_share(own, fit, kind)) for kind in kinds),
        slope=SlopeRange(
            low=max(low - float(moved[1]), -LARGEST), high=min(high + float(moved[1]), LARGEST)
        ),
        fastest=forces.fastest,
        presliding=_presliding(fit, forces),
        mass=float(fit.values[0]),
        mass_deviation=float(np.hypot(np.sqrt(fit.covariance[0, 0]), moved[0])),
        left=float(np.sqrt(own.left(kinds))),
    )


def _share(own: Blocks[Kind], fit: _Fit, kind: Kind) -> float:
    """Rms of a kind over the rms of the force.

    Of all but drag only what Coulomb friction and the other terms of the model cannot follow: they
    overlap, and their sum alone is known.
    """
    gram, members = own.gram, own.members[kind]
    part = fit.values[fit.places[kind]] / own.scales[members]
    square = float(part @ gram[np.ix_(members, members)] @ part)
    terms = own.base[2:] if kind != "drag" else []
    if terms:
        overlap = gram[np.ix_(terms, members)] @ part
        square -= float(overlap @ least_norm(gram[np.ix_(terms, terms)], overlap))
    return float(np.sqrt(max(square, 0.0)))


def _presliding(fit: _Fit, forces: _Forces) -> SlopeRange | None:
    """Least and largest stiffness of friction that remembers, before all of it slides."""
    if "memory" not in fit.places:
        return None
    added = forces.stiffnesses()
    weights = np.zeros((len(added), fit.values.size))
    weights[:, fit.places["memory"]] = added
    value, half = fit.weighted(weights)
    high = float(np.max(value + half))
    if high <= 0:
        return None
    high = min(high, LARGEST)
    return SlopeRange(low=max(float(np.min(value)), _SOFTEST * high), high=high)


def _slope_range(fit: _Fit, forces: _Forces) -> tuple[float, float]:
    """Least and largest slope of friction over speed with some kinds in the regression, N·s/m."""
    weights = np.zeros((1, fit.values.size))
    weights[0, 1] = 1.0
    for kind, place in fit.places.items():
        added = forces.slopes(kind)
        weights = np.repeat(weights, len(added), axis=0)
        weights[:, place] = np.tile(added, (len(weights) // len(added), 1))
    slope, half = fit.weighted(weights)
    return float(np.min(slope - half)), float(np.max(slope + half))


def unmodelled(trajectory: Trajectory, curve: FrictionCurve, damping: float) -> Finding:
    """``unmodelled-force``: what the friction is, and the slopes that it has over speed."""
    named = [each for each in curve.found if each.share >= _NAMED_SHARE] or curve.found[:1]
    kinds = ", ".join(
        f"{each.words}, "
        + (f"{each.share:.1%} of the force" if each.share < 1 else "as much as the force itself")
        for each in named
    )
    uncovered = [each for each in curve.found if not each.rises]
    steepest = _STEEPEST * float(np.max(np.abs(trajectory.force))) / curve.fastest
    told = -steepest <= curve.slope.low and curve.slope.high <= steepest
    most = _MOST_EXPLAINED if curve.left <= _LITTLE_LEFT else _MOST_SHARE
    refused = not told or any(each.share > most for each in uncovered)
    unit, speed = ("N·s/m", "m/s") if trajectory.motion == "linear" else ("N·m·s/rad", "rad/s")
    slopes = (
        f"runs from {curve.slope.low:.4g} to {curve.slope.high:.4g} {unit}, damping alone is "
        f"{damping:.4g}"
        if told
        else "is not told"
    )
    seen = (
        f"{trajectory.source} shows {kinds}; from rest to {curve.fastest:.3g} {speed} the slope of "
        f"friction {slopes}"
    )
    if not told:
        needed = "motion at several speeds that tells the slope of friction"
        remedy = "Excite slower and faster, further and for longer, with nothing else on the axis."
    elif uncovered:
        needed = (
            f"at most {most:.0%} of the force that does not rise with speed"
            if refused
            else "friction that rises with speed, every slope of which the certificate covers"
        )
        remedy = (
            "Oil, align or exchange what rubs, free the cables, warm up, and log again; what is "
            "left must be allowed for in the margin: no proof covers friction that falls, drifts "
            "or depends on position."
        )
    else:
        needed = "Coulomb friction and constant damping, or slopes that the certificate covers"
        remedy = (
            "The certificate takes every slope. A log at the speeds of use gives a narrower range."
        )
    return Finding(
        code="unmodelled-force",
        severity="refusal" if refused else "warning",
        seen=seen,
        needed=needed,
        remedy=remedy,
    )
