"""Jitter: how uneven the steps of the control loop may be, by a common quadratic Lyapunov function.

With steps of any length within T(1 ± j), one after the other in any order, the loop is a product of
transition matrices A(τ). It is stable if one norm shrinks under all of them. The norm taken is that
of the closed loop's own modes at the even step, each weighed: with A(T) = V·Λ·V⁻¹ and weights D,

    max over τ of ‖D·V⁻¹·A(τ)·V·D⁻¹‖ < 1.

At the even step it is the largest modulus of a pole whatever the weights; they are taken from the
Perron vectors of the elementwise largest moduli, the best for matrices without signs.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tune.loop.filters import Filters
from tune.loop.state_space import Corner, SampledLoop

FloatArray = NDArray[np.float64]

#: Parts of a sample time beyond which no jitter is looked at.
MOST = 0.5
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
    """Largest j up to `MOST` such that steps anywhere in T(1 ± j) leave every loop stable.

    It is sufficient, not necessary, and says nothing of devices between the places. The law is the
    one made for even steps; its delay is counted in steps.

    Args:
        places: ways the device may be.
        filters: of velocity and acceleration.
        values: K, B and M, N/m, N·s/m and kg; 0 for none.

    Returns:
        0 where a loop is not stable at even steps.
    """
    far = {place: growth(place, filters, values, MOST) for place in places}
    found = MOST
    # The worst first: the others are then looked at no further.
    for place in sorted(far, key=far.__getitem__, reverse=True):
        if far[place] < 0:
            break
        if found == MOST or growth(place, filters, values, found) >= 0:
            found = _margin_at(place, filters, values, found)
    return found


def _margin_at(
    place: Corner, filters: Filters, values: tuple[float, float, float], most: float
) -> float:
    """The margin of a loop that is not stable up to ``most``, by the Illinois false position."""
    low, high = 0.0, most
    above = growth(place, filters, values, most)
    below = growth(place, filters, values, 0.0)
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
        seen = growth(place, filters, values, middle)
        if seen < 0:
            low, below, above = middle, seen, above / 2 if side > 0 else above
            side = 1
        else:
            high, above, below = middle, seen, below / 2 if side < 0 else below
            side = -1
    return low


def growth(
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
