"""Optimal excitation: the force that tells mass and damping with the least intervals.

Three families of signals are brought to their best within the limits and compared. What is played
is the net force of the best, plus the friction of the guessed device while it moves, so that
friction neither holds the device nor bends its path, and the constant force guessed. The devices of
the guesses that may go farthest are then simulated exactly and the force scaled until none of them
leaves its limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.planning.information import (
    DesignGrid,
    Prediction,
    Response,
    fade,
    force_room,
    predict,
)
from identification.planning.limits import (
    BETWEEN,
    ExcitationSpec,
    Guess,
    Region,
    WorstMotion,
    extremes,
    gentle_spec,
    worst_motions,
)

FloatArray = NDArray[np.float64]

Family = Literal["multisine", "swept-sine", "binary"]
_Force = Callable[[FloatArray], FloatArray]  # N (N·m) at any times (s), in their shape
_Wave = Callable[[FloatArray, FloatArray], FloatArray]  # A force by phase, rad, and frequency, Hz

#: Lines of a multisine: all multiples of 1/duration up to the highest frequency if they are no
#: more, otherwise this many, evenly spaced in octaves.
_LINES = 48
_POWERS = (8, 32, 128)  # the largest load is approached by p-norms, sharper in each round
_STEPS = 250  # steps of the search in each round, ...
_WORK = 1_000_000  # ... fewer where a step takes long (points of the grid times steps) ...
_FEWEST_STEPS = 60  # ... but never fewer than these.
#: Starts of the search where friction is none: their best differ by a few per cent.
_SEEDS = (0, 1, 2)
#: Periods in the duration that are tried where there is friction, one start each.
_PERIODS = (1, 2, 3, 4, 6)
_ENDS = 14  # frequencies tried at either end of a sweep
_SWEEPS = 4  # sweeps handed on: a device of the guesses may drift under the very best


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shape:
    """A net force before friction is made up for."""

    family: Family  # of signals
    band: tuple[float, float]  # its lowest and its highest frequency, Hz
    lines: int = 0  # how many frequencies it has; 0 where it sweeps through all of the band
    #: N (N·m) at any times (s), in their shape, the first limit just reached on the bench
    force: _Force


def _multisines(bench: DesignGrid) -> list[_Shape]:
    """Multisines worth fitting to the limits.

    Without friction all multiples of 1/duration are lines. With friction the lines are the odd
    multiples of a few periods in the duration. Such a force is its own opposite half a period
    later, and so is the motion: a friction other than guessed pulls as long one way as the other,
    and the device does not drift.
    """
    highest = max(int(bench.highest * bench.spec.duration), 4)
    if bench.spec.coulomb_friction.high == 0:
        return [_multisine(bench, np.arange(1, highest + 1), seed) for seed in _SEEDS]
    # Fewer than two lines cannot tell damping from friction.
    periods = [each for each in _PERIODS if 3 * each <= highest]
    return [_multisine(bench, np.arange(each, highest + 1, 2 * each), 0) for each in periods]


def _multisine(bench: DesignGrid, lines: NDArray[np.int64], seed: int) -> _Shape:
    """Fourier coefficients of the least merit by gradient, crest and phases included.

    The merit is taken at the scale where the first limit is met, so limits need no penalty. Two
    conditions are linear in the coefficients and hold exactly: back at the start, and at rest.
    """
    from scipy.optimize import minimize

    spec = bench.spec
    if lines.size > _LINES:
        lines = lines[np.unique(np.rint(np.geomspace(1, lines.size, _LINES)).astype(int)) - 1]

    def waves(time: FloatArray) -> FloatArray:
        angle = 2 * np.pi / spec.duration * time[:, None] * lines
        return np.concatenate((np.cos(angle), np.sin(angle)), axis=1) * fade(time, spec)[:, None]

    basis = waves(bench.time)
    response = bench.devices[0][1]
    ends = np.stack([response.place(basis)[-1], response.speed(basis)[-1]])
    free = np.linalg.svd(ends / np.linalg.norm(ends, axis=1, keepdims=True))[2][2:].T
    table = basis @ free
    steps = int(np.clip(_WORK / bench.count, _FEWEST_STEPS, _STEPS))

    def cost(point: FloatArray, power: int) -> tuple[float, FloatArray]:
        force = table @ point
        size, by_force = _size(bench, force, power)
        value, gradient = bench.score(force / size)
        change = gradient - (gradient @ force) / size * by_force
        return value, (change / size) @ table

    slope = 1 / np.concatenate((lines, lines))
    point = free.T @ (np.random.default_rng(seed).standard_normal(slope.size) * slope)
    for power in _POWERS:
        point = point / _size(bench, table @ point, power)[0]
        result = minimize(
            partial(cost, power=power),
            point,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": steps, "maxfun": 2 * steps, "maxcor": 20},
        )
        point = np.asarray(result.x, dtype=np.float64)
    point = point / np.max(np.abs(bench.loads(table @ point)))
    weights = free @ point
    return _Shape(
        family="multisine",
        band=(float(lines[0] / spec.duration), float(lines[-1] / spec.duration)),
        lines=int(lines.size),
        force=lambda time: waves(time) @ weights,
    )


def _swept_sines(bench: DesignGrid) -> list[_Shape]:
    """Sweeps, even in octaves, of the best two ends; at each frequency to the first limit."""
    spec = bench.spec
    mass, damping = spec.mass.value, spec.damping.value

    def wave(phase: FloatArray, frequency: FloatArray) -> FloatArray:
        omega = 2 * np.pi * frequency
        reach = np.full_like(omega, spec.travel)
        if spec.speed is not None:
            reach = np.minimum(reach, spec.speed / omega)
        most = np.minimum(reach * omega * np.hypot(mass * omega, damping), force_room(spec))
        return most * np.sin(phase)

    return _best_sweep(bench, "swept-sine", wave)


def _binaries(bench: DesignGrid) -> list[_Shape]:
    """One force, one way or the other, switched at a rate that sweeps, of the best two ends."""
    return _best_sweep(bench, "binary", lambda phase, _: np.where(np.sin(phase) >= 0, 1.0, -1.0))


def _best_sweep(bench: DesignGrid, family: Family, wave: _Wave) -> list[_Shape]:
    """The sweeps of the least merit."""
    spec = bench.spec
    slowest = min(2 / spec.duration, bench.highest / 4)
    ends = np.geomspace(slowest, bench.highest, _ENDS)
    found: list[tuple[float, _Shape]] = []
    for first in ends:
        for last in ends:
            force = _settled(bench, _sweep(spec, float(first), float(last), wave))
            try:
                merit = bench.score(force(bench.time))[0]
            except np.linalg.LinAlgError:  # nothing but one frequency and no friction told apart
                continue
            band = (float(first), float(last))
            found.append((merit, _Shape(family=family, band=band, force=force)))
    found.sort(key=lambda each: each[0])
    return [shape for _, shape in found[:_SWEEPS]]


def _sweep(spec: ExcitationSpec, first: float, last: float, wave: _Wave) -> _Force:
    """A wave whose frequency goes evenly in octaves from first to last, Hz."""
    octaves = np.log(last / first)

    def force(time: FloatArray) -> FloatArray:
        frequency = first * np.exp(octaves * time / spec.duration)
        # As ∫f dt, which for equal ends is f·t.
        cycles = (frequency - first) * spec.duration / octaves if octaves else first * time
        return wave(2 * np.pi * cycles + np.pi / 2, frequency)

    return force


def _settled(bench: DesignGrid, force: _Force) -> _Force:
    """The force faded, scaled to the first limit, with a slow part that brings the device back.

    The slow part is a parabola in time under the same fade; its three coefficients take the end
    back to the start, to rest, and the middle of the motion to the start.
    """
    spec = bench.spec

    def slow(time: FloatArray) -> FloatArray:
        middle = 2 * time / spec.duration - 1
        parts = np.stack([np.ones_like(time), middle, middle**2], axis=1)
        return parts * fade(time, spec)[:, None]

    def conditions(table: FloatArray) -> FloatArray:
        response = bench.devices[0][1]
        place = response.place(table)
        return np.stack([place[-1], response.speed(table)[-1] * bench.step, np.mean(place, axis=0)])

    faded = force(bench.time) * fade(bench.time, spec)
    parts = slow(bench.time)
    weights = np.linalg.solve(conditions(parts), conditions(faded[:, None])[:, 0])
    scale = 1 / float(np.max(np.abs(bench.loads(faded - parts @ weights))))
    return lambda time: scale * (force(time) * fade(time, spec) - slow(time) @ weights)


def _size(bench: DesignGrid, force: FloatArray, power: int) -> tuple[float, FloatArray]:
    """p-norm of the loads of a force, a little above the largest, and its gradient by the force."""
    loads = bench.loads(force)
    largest = float(np.max(np.abs(loads)))
    parts = np.abs(loads) / largest
    raised = parts ** (power - 1)
    total = float(raised @ parts)
    weights = np.sign(loads) * raised * total ** (1 / power - 1)
    return largest * total ** (1 / power), bench.loads_returned(weights)


_FAMILIES: tuple[tuple[str, Callable[[DesignGrid], list[_Shape]]], ...] = (
    ("multisine", _multisines),
    ("swept sine", _swept_sines),
    ("binary sequence", _binaries),
)
#: Part of the limits aimed at: what is left covers the rounding of the force in its file.
_AIM = 0.999
_ENOUGH = 0.985  # fitting to the limits ends when this much of one of them is used, ...
_TRIES = 12  # ... or after this many simulations of all devices.
#: A force scaled down to this part of what the guess alone would allow tells next to nothing.
_LEAST = 0.1
#: Friction is made up for from this part of the peak speed on; below it comes in smoothly.
_SMOOTH = 0.01
#: Significant digits of a force in its file: a millionth of the limit is below any amplifier.
_DIGITS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Used:
    """Parts of the limits of force, travel and speed; speed 0 where it has no limit."""

    force: float
    travel: float
    speed: float

    @property
    def most(self) -> float:
        """The largest of them."""
        return max(self.force, self.travel, self.speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """The best force of one family."""

    family: Family
    band: tuple[float, float]  # its lowest and its highest frequency, Hz
    lines: int  # how many frequencies it has; 0 where it sweeps through all of the band
    force: FloatArray  # N (N·m), shape (n,), held from sample to sample, zero at both ends
    prediction: Prediction  # motion of the guessed device and Cramér-Rao bound
    used: Used  # parts of the limits that the worst device uses

    @property
    def description(self) -> str:
        """Its frequencies in words."""
        lines = f"{self.lines} lines, " if self.lines else ""
        return f"{lines}{self.band[0]:.3g} to {self.band[1]:.3g} Hz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """A planned force and what it is predicted to tell.

    Attributes:
        spec: limits and guesses it was planned for; of a gentle play the narrower limits and wider
            guesses that make it gentle.
        candidates: the best of each family, the best of all first.
        worst: how far and how fast the best moves devices other than guessed.
    """

    spec: ExcitationSpec
    candidates: tuple[Candidate, ...]
    worst: tuple[WorstMotion, ...]

    def __repr__(self) -> str:
        return (
            f"Excitation({len(self.best.force)} samples of {self.best.family}, expected half-width "
            f"mass {self.mass:.3g}, damping {self.damping:.3g}; {len(self.candidates)} candidates)"
        )

    @property
    def best(self) -> Candidate:
        """The candidate to be played."""
        return self.candidates[0]

    @property
    def time(self) -> FloatArray:
        """s, shape (n,)."""
        return np.arange(self.best.force.size, dtype=np.float64) * self.spec.sample_time

    @property
    def beyond(self) -> tuple[WorstMotion, ...]:
        """Which of the worst motions leave the travel or the speed allowed."""
        speed = self.spec.speed or np.inf
        return tuple(
            each for each in self.worst if each.travel > self.spec.travel or each.speed > speed
        )

    @property
    def mass(self) -> float:
        """Predicted half-width of the 95 % interval of the mass, kg (kg·m²)."""
        return self.best.prediction.mass

    @property
    def damping(self) -> float:
        """Predicted half-width of the 95 % interval of the damping, N·s/m (N·m·s/rad)."""
        return self.best.prediction.damping


def plan_excitation(
    spec: ExcitationSpec, *, progress: Callable[[str], None] | None = None
) -> Excitation:
    """The multisine, swept sine or binary signal with the least product of both intervals.

    Args:
        spec: limits and guesses.
        progress: called with a sentence before each part of the work.

    Raises:
        InvalidInputError: no force keeps every device the guesses allow within the limits.
    """

    def say(sentence: str) -> None:
        if progress is not None:
            progress(sentence)

    wanted = gentle_spec(spec) if spec.gentle else spec
    bench = DesignGrid.of(wanted)
    devices, spread = Region.stated(wanted).devices(), BETWEEN if wanted.ranges else 1.0
    found: list[Candidate] = []
    used: list[Used] = []
    for name, family in _FAMILIES:
        say(f"designing a {name}")
        tried = [_fitted(bench, shape, devices, spread) for shape in family(bench)]
        used += [each for each in tried if isinstance(each, Used)]
        fitting = [each for each in tried if isinstance(each, Candidate)]
        found += [min(fitting, key=_product)] if fitting else []
    if not found:
        raise InvalidInputError("excitation", *_impossible(wanted, used[0]))
    found.sort(key=_product)
    say("looking for the devices that go farthest")
    worst = worst_motions(spec, found[0].force)
    return Excitation(spec=wanted, candidates=tuple(found), worst=worst)


def _fitted(
    bench: DesignGrid, shape: _Shape, devices: list[Guess], spread: float
) -> Candidate | Used:
    """The shape on the controller's samples, friction and offset made up for, within all limits.

    Returns what the last try used of the limits on these devices if none keeps them.
    """
    spec = bench.spec
    step = spec.sample_time
    net = shape.force((np.arange(spec.samples, dtype=np.float64) + 0.5) * step)
    guess = spec.guess
    response = Response(rate=guess.rate, step=step, count=net.size, noise=1.0)
    speed = response.speed(net / guess.mass)
    middle = (speed + np.concatenate(([0.0], speed[:-1]))) / 2
    sense = middle / np.hypot(middle, _SMOOTH * np.max(np.abs(middle)))
    scale, accepted = 1.0, 0.0
    best: tuple[FloatArray, Used] | None = None
    used = Used(force=0.0, travel=0.0, speed=0.0)
    for _ in range(_TRIES):
        against = guess.coulomb_friction * sense + guess.force_offset
        force = _rounded(scale * net + against, spec.force)
        used = _used(spec, force, devices, spread)
        if used.most <= 1 and scale > accepted:
            best, accepted = (force, used), scale
            if used.most >= _ENOUGH:
                break
        scale *= _AIM / used.most
        if scale < _LEAST:
            break
    if best is None:
        return used
    force, used = best
    prediction = predict(
        force[:-1],
        guess,
        step=step,
        noise=spec.reading_noise,
        force_noise=spec.force_noise,
        delay_known=spec.delay == "known",
    )
    return Candidate(
        family=shape.family,
        band=shape.band,
        lines=shape.lines,
        force=force,
        prediction=prediction,
        used=used,
    )


def _product(found: Candidate) -> float:
    """What is to be small: the product of both intervals."""
    return found.prediction.mass * found.prediction.damping


def _rounded(force: FloatArray, limit: float) -> FloatArray:
    """The force as its file will hold it, with a row of zero at either end."""
    decimals = _DIGITS - 1 - int(np.floor(np.log10(limit)))
    rows = np.append(np.round(force, decimals), 0.0)
    rows[0] = 0.0
    return rows


def _used(spec: ExcitationSpec, force: FloatArray, devices: list[Guess], spread: float) -> Used:
    """Parts of the limits that the worst of some devices uses; others go the spread farther."""
    reach, speed = extremes(force[:-1], devices, spec.sample_time)
    return Used(
        force=float(np.max(np.abs(force))) / spec.force,
        travel=spread * float(np.max(reach)) / spec.travel,
        speed=0.0 if spec.speed is None else spread * float(np.max(speed)) / spec.speed,
    )


def _impossible(spec: ExcitationSpec, used: Used) -> tuple[str, str]:
    """What no force can keep, and what to do."""
    if used.travel == used.most:
        return (
            f"however small the force, some device within the guesses moves {used.travel:.2g} "
            f"times the travel of {spec.travel:g} in {spec.duration:g} s",
            "Without a spring an unknown friction or offset makes a device drift: narrow the "
            "ranges of coulomb_friction and force_offset (gentle: true plans a first play that "
            "tells them), shorten the duration, or allow more travel",
        )
    return (
        f"no force keeps every device within the guesses below the speed of {spec.speed:g}",
        "Allow more speed, or narrow the ranges of the guesses",
    )


#: Significant digits: a nanosecond in three minutes, and more than the force was rounded to.
_FILE_DIGITS = 12


def force_text(excitation: Excitation) -> str:
    """One row a sample; the force of each is held until the next, the first and last are zero."""
    rows = zip(excitation.time.tolist(), excitation.best.force.tolist(), strict=True)
    lines = (f"{time:.{_FILE_DIGITS}g},{force + 0.0:.{_FILE_DIGITS}g}" for time, force in rows)
    return "\n".join(("time,force", *lines)) + "\n"
