"""Runge-Kutta steps of a linear law, many of them as one map of the state.

For dz/dt = G·z a classical fourth-order Runge-Kutta step is itself a fixed linear map of z. It is
run here on the unit vectors once, at a step far below the fastest rate, and applied to itself until
it spans the wanted time: doubling the time squares the map. What is kept is the map less one,
D ↦ 2·D + D², so that slow motion loses no digits beside one.

Error: with h the first step and p the fastest rate the motion behaves like that of a law wrong by
a relative |h·p|⁴/120; rounding adds about one part in 1e15 a doubling. No exponential and no other
closed form of the solution is used: scipy's would serve as well, but tests compare with it,
and the simulator, which runs before every profile is written, loads no scipy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Largest |h·p| of the first step: relative error 0.002⁴/120 = 1.3e-13.
FIRST_STEP = 0.002


def maps(
    generator: FloatArray, duration: FloatArray, rate: FloatArray, halvings: int = 0
) -> list[FloatArray]:
    """Change of the state over a duration, over half of it, a quarter, ...

    Args:
        generator: G, shape (batch, size, size).
        duration: s, shape (batch,).
        rate: p, the fastest in G, 1/s, shape (batch,).
        halvings: how many shorter times are wanted beside the whole.

    Returns:
        1 + halvings maps D, each shape (batch, size, size), the longest time first: the state
        after duration/2^j is z + D[j]·z.
    """
    turns = float(np.max(np.abs(duration * rate), initial=0.0))
    doublings = max(halvings, int(np.ceil(np.log2(max(turns / FIRST_STEP, 1.0)))))
    step = (duration / 2.0**doublings)[:, None, None]
    change = _runge_kutta(generator, step)
    found = [change]
    for _ in range(doublings):
        change = 2 * change + change @ change
        found.append(change)
    return found[::-1][: halvings + 1]


def fastest(generator: FloatArray) -> FloatArray:
    """The largest rate in the law, 1/s, shape (batch,)."""
    return np.max(np.abs(np.linalg.eigvals(generator)), axis=-1)


def fastest_oscillation(generator: FloatArray) -> FloatArray:
    """The largest angular frequency in the law, 1/s, shape (batch,)."""
    return np.max(np.abs(np.linalg.eigvals(generator).imag), axis=-1)


def _runge_kutta(generator: FloatArray, step: FloatArray) -> FloatArray:
    """One step from the unit vectors, less where they started."""
    unit = np.eye(generator.shape[-1])
    first = generator @ unit
    second = generator @ (unit + 0.5 * step * first)
    third = generator @ (unit + 0.5 * step * second)
    fourth = generator @ (unit + step * third)
    return step / 6 * (first + 2 * (second + third) + fourth)
