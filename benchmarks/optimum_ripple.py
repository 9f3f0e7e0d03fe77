"""Ripple of the force, summed over the steps since a reading was wrong."""

# pyright: standard

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.optimum_loops import Loops

FloatArray = NDArray[np.float64]

#: Doublings of the time over which a ripple is summed, at most.
_DOUBLINGS = 60
#: What is left of a wrong reading when it counts as forgotten.
_FADED = 1e-18
#: ... and when it has grown beyond return; no stable loop of these tests answers so much.
_GROWN = 1e60


def force_ripple(loops: Loops, totals: FloatArray, resolution: float) -> FloatArray:
    """Force of readings that are wrong by white noise of Δ²/12, N rms, shape (combinations,).

    The law and the device are stepped as they are written; without a spring the place itself is no
    state, because nothing answers to it. Loops are of one corner without a hand; totals are (K, B,
    M) of shape (combinations, 3), the resolution is Δ.
    """
    springs = totals[:, 0] != 0
    found = np.zeros(len(totals))
    for spring in np.unique(springs):
        chosen = springs == spring
        found[chosen] = _response_energy(loops, totals[chosen], spring=bool(spring))
    return np.sqrt(found / 12) * resolution


def _response_energy(  # noqa: PLR0915 - one recursion
    loops: Loops, totals: FloatArray, *, spring: bool
) -> FloatArray:
    """Sum of squared forces after one reading is wrong by one."""
    K, B, M = totals.T
    step, whole = loops.step[0], int(loops.whole[0])
    late = loops.before[0].any()
    queue = whole + bool(late)
    # q, velocity times T, change of place less the old error, v, w, acceleration, forces on the way
    size = 6 + queue
    a = np.zeros((len(totals), size, size))
    push = np.zeros((len(totals), size))
    force = np.zeros((len(totals), size))
    open_v, open_a = loops.open[0][0], loops.open[1][0]
    v, w = np.zeros(size), np.zeros(size)
    v[[2, 3]] = open_v / step, 1 - open_v
    w[[2, 4]] = open_a / step, 1 - open_a
    rate = np.zeros(size)
    rate[5] = 1 - open_a
    rate += open_a / step * w
    rate[4] -= open_a / step
    force -= B[:, None] * v + M[:, None] * rate
    force[:, 0] -= K * spring
    direct = -(K + B * open_v / step + M * (open_a / step) ** 2)
    moved, scale = loops.moved[0], loops.scale[0]
    u = np.zeros(size)
    u[1] = 1 + moved[1, 1]
    change = np.zeros(size)
    change[1] = moved[0, 1]
    rows = {0: change + np.eye(size)[0] * spring, 1: u, 2: change, 3: v, 4: w, 5: rate}
    for row, values in rows.items():
        a[:, row] = values
    pushed = {3: open_v / step, 4: open_a / step, 5: (open_a / step) ** 2, 2: -1.0}
    for row, value in pushed.items():
        push[:, row] = value
    for row, part in ((0, 0), (1, 1), (2, 0)):
        for samples, gains in ((whole, loops.now[0]), (whole + 1, loops.before[0])):
            weight = scale * gains[part]
            if samples == 0:
                a[:, row] += weight * force
                push[:, row] += weight * direct
            elif samples <= queue:
                a[:, row, 5 + samples] += weight
    if queue:
        a[:, 6] = force
        push[:, 6] = direct
        for row in range(7, size):
            a[:, row, row - 1] = 1.0
    if not spring:
        a[:, 0] = a[:, :, 0] = push[:, 0] = 0.0
    energy = push[:, :, None] * push[:, None, :]
    lost = np.zeros(len(totals), dtype=bool)
    for _ in range(_DOUBLINGS):
        energy = energy + a @ energy @ a.transpose(0, 2, 1)
        a = a @ a
        left = np.max(np.abs(a), axis=(1, 2))
        lost |= left > _GROWN
        a[lost] = 0.0
        if np.all(lost | (left < _FADED)):
            break
    lost |= np.max(np.abs(a), axis=(1, 2)) >= _FADED
    energy = direct**2 + np.einsum("ki,kij,kj->k", force, energy, force)
    return np.where(lost, np.inf, energy)
