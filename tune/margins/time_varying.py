"""Loops that change in time: uneven steps of the clock, and effects that fade in and out.

**Jitter.** With steps of any length within T(1 ± j), one after the other in any order, the loop is
a product of transition matrices A(τ). It is stable if one norm, a common quadratic Lyapunov
function, shrinks under all of them. The norm taken is that of the closed loop's own modes at the
even step, each weighed: with A(T) = V·Λ·V⁻¹ and weights D,

    max over τ of ‖D·V⁻¹·A(τ)·V·D⁻¹‖ < 1.

At the even step it is the largest modulus of a pole whatever the weights; they are taken from the
Perron vectors of the elementwise largest moduli, the best for matrices without signs.

**Fades.** An element with mass is faded in and out, its level l[k] rising or falling by at most T/τ
a sample. At each constant level the loop is stable; a swing may still gain from a level that moves
with it, as a pendulum does from a string drawn in and let out. In coordinates that all levels share

    x[k+1] = (A + l[k]·e·cᵀ)·x[k],

and a hand that enters and leaves decides l. What pumps most goes to and fro between two levels and
waits at each for part of a half swing: the eigenvalues of one such period tell whether it grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tune.loop.filters import Filters
from tune.loop.state_space import Corner, SampledLoop, law_states

FloatArray = NDArray[np.float64]

#: Parts of a sample time beyond which no jitter is looked at.
MOST_JITTER = 0.5
#: Step lengths within ±j at which the norm is computed. A(τ) is all but straight in τ, and the norm
#: of a matrix on a straight line is largest at an end.
_LENGTHS = np.linspace(-1.0, 1.0, 5)
#: The largest j is found to this part of itself, in at most so many steps.
_CLOSE, _MOST_STEPS = 1e-4, 40
#: Balancing sweeps of the moduli, and what stands for none, relative to the largest.
_SWEEPS, _NONE = 6, 1e-9


@lru_cache(maxsize=4096)
def jitter_margin(
    places: tuple[Corner, ...], filters: Filters, values: tuple[float, float, float]
) -> float:
    """Largest j up to `MOST_JITTER` such that steps anywhere in T(1 ± j) leave every loop stable.

    It is sufficient, not necessary, and says nothing of devices between the places. The law is the
    one made for even steps, its values K, B and M, 0 for none; its delay is counted in steps. 0
    where a loop is not stable at even steps.
    """
    far = {place: _growth(place, filters, values, MOST_JITTER) for place in places}
    found = MOST_JITTER
    # The worst first: the others are then looked at no further.
    for place in sorted(far, key=far.__getitem__, reverse=True):
        if far[place] < 0:
            break
        if found == MOST_JITTER or _growth(place, filters, values, found) >= 0:
            found = _margin_at(place, filters, values, found)
    return found


def _margin_at(
    place: Corner, filters: Filters, values: tuple[float, float, float], most: float
) -> float:
    """The margin of a loop that is not stable up to ``most``, by the Illinois false position."""
    low, high = 0.0, most
    above = _growth(place, filters, values, most)
    below = _growth(place, filters, values, 0.0)
    if below >= 0:
        return 0.0
    side = 0
    for _ in range(_MOST_STEPS):
        if high - low < _CLOSE * high:
            break
        # A growth without bound tells no slope. The step aims a little beyond the zero, so that
        # both ends close in.
        share = -below / (above - below) if np.isfinite(above) else 0.5
        aim = low + (high - low) * share
        middle = min(max(aim + side * _CLOSE * aim / 3, (low + aim) / 2), (high + aim) / 2)
        seen = _growth(place, filters, values, middle)
        if seen < 0:
            low, below, above = middle, seen, above / 2 if side > 0 else above
            side = 1
        else:
            high, above, below = middle, seen, below / 2 if side < 0 else below
            side = -1
    return low


def _growth(
    place: Corner, filters: Filters, values: tuple[float, float, float], jitter: float
) -> float:
    """By how much the norm of the modes exceeds 1 under the worst step within T(1 ± jitter)."""
    lengths = 1 + jitter * _LENGTHS
    transitions = SampledLoop.of(place, filters, values, lengths=lengths).pushed
    if not np.isfinite(transitions).all():
        return np.inf
    poles, modes = np.linalg.eig(transitions[len(lengths) // 2])
    try:
        seen = np.linalg.solve(modes, transitions @ modes)
    except np.linalg.LinAlgError:
        return np.inf
    if values[0] == 0 and place.position_stiffness == 0:
        # Wherever the device is, it moves alike: a step keeps that mode as it is.
        kept = np.delete(np.arange(len(poles)), np.argmin(np.abs(poles - 1)))
        seen = seen[:, kept][:, :, kept]
    weights = _weights(np.abs(seen).max(axis=0))
    weighed = seen * (weights[:, None] / weights)
    return float(np.linalg.norm(weighed, 2, axis=(-2, -1)).max()) - 1


def _weights(sizes: FloatArray) -> FloatArray:
    """√(y/x) of the right and left Perron vectors x, y of a nonnegative matrix, balanced first."""
    weights = np.ones(len(sizes))
    apart = sizes * (1 - np.eye(len(sizes))) + np.finfo(float).tiny
    for _ in range(_SWEEPS):
        now = apart * (weights[:, None] / weights)
        weights = weights * (now.sum(axis=0) / now.sum(axis=1)) ** 0.25
        weights = weights / weights.max()
    balanced = sizes * (weights[:, None] / weights)
    balanced = balanced + _NONE * balanced.max()
    return weights * np.sqrt(_perron(balanced.T) / _perron(balanced))


def _perron(sizes: FloatArray) -> FloatArray:
    """The positive eigenvector of a positive matrix."""
    values, vectors = np.linalg.eig(sizes)
    return np.abs(vectors[:, np.argmax(np.real(values))])


Values = tuple[float, float, float]
Spans = NDArray[np.int64]

#: Steps of a fade, and those at which it may turn: where a spring fades, low levels swing slowest.
_STEPS = 16
_STOPS = (0, 1, 2, 4, 8, 12, 16)
#: Waits at a stop, evenly from none to half a swing.
_WAITS = 8
#: rad, how far from whole half turns a period is looked at.
_NEAR = np.linspace(-0.12, 0.12, 13)
#: s, the first fade looked at, the ratio of each to the next, and the longest: of turns at any
#: level, which guide no further where they ask for more, and of going all the way.
_FIRST, _RATIO, _LONGEST, _LONGEST_WHOLE = 0.05, 2**0.5, 1.0, 5.0
#: An eigenvalue of a period this far beyond the circle grows; less is the rounding of a double one.
_GROWS = 1e-6


def shortest_fade(
    places: Sequence[Corner],
    filters: Filters,
    beside: Values,
    fading: Values,
    *,
    whole: bool = False,
) -> float:
    """Shortest fade, s, at which no wave of the level was found to make any loop grow.

    It is necessary, not sufficient: waves of other shapes are not looked at. 0.05 s at least; inf
    where none up to 1 s, or 5 s all the way, is slow enough. The values are K, B and M of what
    stands beside and of what fades, at its full level; ``whole`` says that the level always goes
    all the way, else it may turn at other levels too.
    """
    loops = [
        _FadedLoop.of(place, filters, beside, fading)
        for place in places
        # Without any spring nothing swings.
        if beside[0] or fading[0] or place.position_stiffness or place.modes
    ]
    fade = _FIRST
    for loop in loops:
        while loop.grows(fade, (0, _STEPS) if whole else _STOPS):
            fade *= _RATIO
            if fade > (_LONGEST_WHOLE if whole else _LONGEST):
                return float("inf")
    return fade


@dataclass(frozen=True, slots=True, kw_only=True)
class _FadedLoop:
    """x[k+1] = (still + level·more)·x[k], each of shape (states, states); sample time in s.

    It is grounded where a spring of device or law binds the place at some level.
    """

    still: FloatArray
    more: FloatArray
    sample_time: float
    grounded: bool

    @classmethod
    def of(cls, place: Corner, filters: Filters, beside: Values, fading: Values) -> _FadedLoop:
        """The estimates follow every reading; only what is made of them has a level."""
        step = place.sample_time
        plant = SampledLoop.of(place, filters, (1.0, 0.0, 0.0))
        size, command = len(plant.read), plant.command
        enter = (plant.pushed - plant.free) @ command / (command @ command)
        estimates = [law_states(filters, step, 0.0, *only) for only in ((1.0, 0.0), (0.0, 1.0))]
        total = size + sum(len(each.update) for each in estimates)
        still = np.zeros((total, total))
        still[:size, :size] = plant.free
        rows = np.zeros((3, total))
        rows[0, :size] = command
        start = size
        for row, each in zip(rows[1:], estimates, strict=True):
            end = start + len(each.update)
            still[start:end, start:end] = each.update
            still[start:end, :size] = np.outer(each.drive, plant.read)
            row[start:end] = each.command
            row[:size] = each.direct * plant.read
            start = end
        drive = np.append(enter, np.zeros(total - size))
        return cls(
            still=still + np.outer(drive, np.array(beside) @ rows),
            more=np.outer(drive, np.array(fading) @ rows),
            sample_time=step,
            grounded=bool(beside[0] or fading[0] or place.position_stiffness),
        )

    def at(self, level: FloatArray) -> FloatArray:
        """Transitions at some levels, shape (levels, states, states)."""
        return self.still + level[:, None, None] * self.more

    @np.errstate(over="ignore", invalid="ignore")
    def grows(self, fade: float, stops: Sequence[int]) -> bool:
        """Whether some wave between two stops, as fast as a fade of so many seconds, pumps.

        A loop that is unstable at some level overflows, which is growth.
        """
        count = max(1, int(fade / self.sample_time / _STEPS))
        middles = (np.arange(_STEPS) + 0.5) / _STEPS
        each = self.at(middles)
        steps = np.linalg.matrix_power(each, count)
        turned = count * np.array([_turn(matrix) for matrix in each])
        held = {stop: self.at(np.array([stop / _STEPS]))[0] for stop in stops}
        turns = {stop: _turn(matrix) for stop, matrix in held.items()}
        for place, low in enumerate(stops):
            up = down = np.eye(len(self.still))
            for before, high in pairwise(stops[place:]):
                for step in steps[before:high]:
                    up, down = step @ up, down @ step
                both, fades = (turns[low], turns[high]), 2 * float(turned[low:high].sum())
                for first, last in _waits(both, fades):
                    periods = down @ _held(held[high], last) @ up @ _held(held[low], first)
                    if not np.isfinite(periods).all() or self._radius(periods) > 1 + _GROWS:
                        return True
        return False

    def _radius(self, periods: FloatArray) -> float:
        """Largest eigenvalue of some periods, without the one of a place that nothing holds."""
        values = np.linalg.eigvals(periods).reshape(-1, len(self.still))
        if not self.grounded:
            values[np.arange(len(values)), np.abs(values - 1).argmin(axis=1)] = 0
        return float(np.abs(values).max())


def _turn(matrix: FloatArray) -> float:
    """Angle a sample of the swing that dies out last, rad; 0 where nothing swings."""
    poles = np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)
    swings = poles[poles.imag > 0]
    return float(np.angle(swings[np.argmax(np.abs(swings))])) if swings.size else 0.0


def _waits(turns: tuple[float, float], fades: float) -> list[tuple[Spans, Spans]]:
    """Pairs of waits in samples at a low and a high level, the longest half a swing at each.

    Evenly, and close to those with which a period turns the swing by whole half turns, of so many
    radians a sample at either level and over both ways: where little is lost few periods pump.
    """
    evenly = [
        np.unique(np.linspace(0, np.pi / turn if turn else 0, _WAITS).astype(np.int64))
        for turn in turns
    ]
    first, last = (each.ravel() for each in np.meshgrid(*evenly, indexing="ij"))
    if not turns[1]:
        return [(first, last)]
    left = (-evenly[0] * turns[0] - fades) % np.pi
    near = (left[:, None] + _NEAR) / turns[1]
    tuned = np.maximum(np.rint(near), 0).astype(np.int64).ravel()
    return [(first, last), (np.repeat(evenly[0], len(_NEAR)), tuned)]


def _held(matrix: FloatArray, spans: Spans) -> FloatArray:
    """Transitions over some waits at one level, shape (waits, states, states)."""
    which, place = np.unique(spans, return_inverse=True)
    return np.stack([np.linalg.matrix_power(matrix, int(span)) for span in which])[place]
