"""Signals that excite one axis within its limits, and what makes a force of them.

Each is brought to its best on a design grid: a net force before friction is made up for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.planning.information import DesignGrid, Response, fade, force_room
from identification.planning.limits import ExcitationSpec, Used
from identification.trajectory import FloatArray

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
class Shape:
    """A net force before friction is made up for."""

    family: Family  # of signals
    band: tuple[float, float]  # its lowest and its highest frequency, Hz
    lines: int = 0  # how many frequencies it has; 0 where it sweeps through all of the band
    #: N (N·m) at any times (s), in their shape, the first limit just reached on the bench
    force: _Force


def multisines(bench: DesignGrid) -> list[Shape]:
    """Multisines worth fitting to the limits."""
    return [multisine(bench, lines, seed) for lines, seed in line_sets(bench)]


def line_sets(bench: DesignGrid) -> list[tuple[NDArray[np.int64], int]]:
    """Lines that are worth a try, as multiples of 1/duration, with the seed of a start.

    Without friction all multiples of 1/duration are lines. With friction the lines are the odd
    multiples of a few periods in the duration. Such a force is its own opposite half a period
    later, and so is the motion: a friction other than guessed pulls as long one way as the other,
    and the device does not drift.
    """
    highest = max(int(bench.highest * bench.spec.duration), 4)
    if bench.spec.coulomb_friction.high == 0:
        return [(np.arange(1, highest + 1), seed) for seed in _SEEDS]
    # Fewer than two lines cannot tell damping from friction.
    periods = [each for each in _PERIODS if 3 * each <= highest]
    return [(np.arange(each, highest + 1, 2 * each), 0) for each in periods]


def multisine(bench: DesignGrid, lines: NDArray[np.int64], seed: int) -> Shape:
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
    return Shape(
        family="multisine",
        band=(float(lines[0] / spec.duration), float(lines[-1] / spec.duration)),
        lines=int(lines.size),
        force=lambda time: waves(time) @ weights,
    )


def swept_sines(bench: DesignGrid) -> list[Shape]:
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


def binaries(bench: DesignGrid) -> list[Shape]:
    """One force, one way or the other, switched at a rate that sweeps, of the best two ends."""
    return _best_sweep(bench, "binary", lambda phase, _: np.where(np.sin(phase) >= 0, 1.0, -1.0))


def _best_sweep(bench: DesignGrid, family: Family, wave: _Wave) -> list[Shape]:
    """The sweeps of the least merit."""
    spec = bench.spec
    slowest = min(2 / spec.duration, bench.highest / 4)
    ends = np.geomspace(slowest, bench.highest, _ENDS)
    found: list[tuple[float, Shape]] = []
    for first in ends:
        for last in ends:
            force = _settled(bench, _sweep(spec, float(first), float(last), wave))
            try:
                merit = bench.score(force(bench.time))[0]
            except np.linalg.LinAlgError:  # nothing but one frequency and no friction told apart
                continue
            band = (float(first), float(last))
            found.append((merit, Shape(family=family, band=band, force=force)))
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


def opposing_force(spec: ExcitationSpec, net: FloatArray) -> FloatArray:
    """Friction and offset of the guessed device while a net force moves it, N, shape (n,)."""
    guess = spec.guess
    response = Response(rate=guess.rate, step=spec.sample_time, count=net.size, noise=1.0)
    speed = response.speed(net / guess.mass)
    middle = (speed + np.concatenate(([0.0], speed[:-1]))) / 2
    sense = middle / np.hypot(middle, _SMOOTH * np.max(np.abs(middle)))
    return guess.coulomb_friction * sense + guess.force_offset


def rounded(force: FloatArray, limit: float) -> FloatArray:
    """The force as its file will hold it, with a row of zero at either end."""
    decimals = _DIGITS - 1 - int(np.floor(np.log10(limit)))
    rows = np.append(np.round(force, decimals), 0.0)
    rows[0] = 0.0
    return rows


def fit_to_limits(
    force_at: Callable[[float], FloatArray],
    used_by: Callable[[FloatArray], Used],
    scale: float = 1.0,
) -> tuple[float, FloatArray, Used] | Used:
    """The largest scale that keeps all limits, its force, and what that uses of them.

    Looks from a scale on. Returns what the last try used of the limits if none keeps them.
    """
    best: tuple[float, FloatArray, Used] | None = None
    used = Used(force=0.0, travel=0.0, speed=0.0)
    for _ in range(_TRIES):
        force = force_at(scale)
        used = used_by(force)
        if used.most <= 1 and (best is None or scale > best[0]):
            best = scale, force, used
            if used.most >= _ENOUGH:
                break
        scale *= _AIM / used.most
        if scale < _LEAST:
            break
    return best or used
