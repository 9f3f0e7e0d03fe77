"""Gates that pump: dampers and masses opened and shut so that a device under a spring swings up.

Beside a two-sided spring, which never changes, a loop with gates is linear at every sample: it goes
on by one matrix with the gate shut and by another with it open. A periodic pattern destabilises it
when the product of its matrices has an eigenvalue outside the unit circle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.wall_play import Array, Bench, State

Pattern = NDArray[np.bool_]


def transitions(bench: Bench, damper: float, inertia: float) -> Array:
    """What one sample does to `State.flat` of every member, shape (members, n, n)."""
    start = bench.state
    width = start.flat().shape[1]
    found = np.empty((bench.members, width, width))
    gates = np.full(bench.members, damper), np.full(bench.members, inertia)
    for place in range(width):
        flat = np.zeros((bench.members, width))
        flat[:, place] = 1.0
        bench.state = unflattened(start, flat)
        bench.step(0, lambda k, bench, damper, inertia: gates)
        found[:, :, place] = bench.state.flat()
    bench.state = start
    return found


def unflattened(like: State, flat: Array) -> State:
    """The state that `State.flat` shows, no period missed."""
    ends = np.cumsum([like.plant.shape[1], like.forces.shape[1]])
    plant, forces, rest = np.split(flat, ends, axis=1)
    last, speed, first, second = rest.T
    return replace(
        like, plant=plant, forces=forces, last=last, speed=speed, first=first, second=second
    )


def growth(matrices: Array, pattern: NDArray[np.intp]) -> float:
    """Growth a sample under a periodic pattern of indices into the matrices, shape (c, n, n)."""
    product = np.eye(matrices.shape[1])
    for each in pattern:
        product = matrices[each] @ product
    return float(np.max(np.abs(np.linalg.eigvals(product)))) ** (1 / len(pattern))


def chased(matrices: Array, *, samples: int) -> NDArray[np.intp]:
    """Pattern that at every sample lifts the slowest-dying swing of the first matrix the most."""
    values, vectors = np.linalg.eig(matrices[0].T)
    swinging = np.abs(values) * (np.abs(values.imag) > 1e-9)
    left = vectors[:, int(np.argmax(swinging))]
    state = np.real(left)
    found = np.empty(samples, dtype=np.intp)
    for k in range(samples):
        nexts = matrices @ state
        found[k] = int(np.argmax(np.abs(nexts @ left)))
        state = nexts[found[k]]
        state /= np.linalg.norm(state)
    return found


def improved(matrices: Array, pattern: NDArray[np.intp]) -> tuple[float, NDArray[np.intp]]:
    """Growth and pattern after changing one sample at a time for as long as that helps."""
    pattern, best = pattern.copy(), growth(matrices, pattern)
    count, width = len(pattern), matrices.shape[1]
    while True:
        before = np.empty((count + 1, width, width))
        after = np.empty((count + 1, width, width))
        before[0] = after[count] = np.eye(width)
        for k in range(count):
            before[k + 1] = matrices[pattern[k]] @ before[k]
        for k in reversed(range(count)):
            after[k] = after[k + 1] @ matrices[pattern[k]]
        # All patterns that differ in one sample, (count, choices).
        products = after[1:, None] @ matrices[None] @ before[:-1, None]
        sizes = np.max(np.abs(np.linalg.eigvals(products)), axis=-1) ** (1 / count)
        place = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        if sizes[place] <= best * (1 + 1e-12):
            return best, pattern
        best = float(sizes[place])
        pattern[place[0]] = place[1]
