"""Gates that pump: dampers and masses opened and shut so that a device under a spring swings up.

Beside a two-sided spring, which never changes, a loop with gates is linear at every sample: it goes
on by one matrix with the gate shut and by another with it open. A periodic pattern destabilises it
when the product of its matrices has an eigenvalue outside the unit circle.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from tests.wall_play import Array, Bench, State

Complex = NDArray[np.complex128]


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


def gated(bench: Bench) -> Array:
    """`transitions` with every gate of what there is shut and open, shape (choices, members, n, n).

    Everything shut comes first.
    """
    levels = [
        (0.0, 1.0) if np.any(size) else (0.0,) for size in (bench.law.damping, bench.law.mass)
    ]
    return np.stack([transitions(bench, *both) for both in product(*levels)])


def growth(matrices: Array, pattern: NDArray[np.intp]) -> float:
    """Growth a sample under a periodic pattern of indices into matrices, (choices, n, n)."""
    total = np.eye(matrices.shape[1])
    for each in pattern:
        total = matrices[each] @ total
    return float(np.max(np.abs(np.linalg.eigvals(total)))) ** (1 / len(pattern))


def slowest_swing(matrices: Array) -> tuple[Complex, Complex]:
    """Left eigenvectors of the slowest-dying swings, (members, n), and their eigenvalues."""
    values, vectors = np.linalg.eig(np.swapaxes(matrices, 1, 2))
    slow = np.argmax(np.abs(values) * (np.abs(np.imag(values)) > 1e-9), axis=1)
    row = np.arange(len(slow))
    return vectors[row, :, slow], values[row, slow]


def chased(matrices: Array, watched: Array, *, samples: int) -> NDArray[np.intp]:
    """Gates that at every sample lift one swing as far as they can, shape (samples, members).

    Args:
        matrices: as `gated`.
        watched: loops whose slowest-dying swing is lifted, shape (members, n, n).
        samples: for which this goes on.
    """
    left, _ = slowest_swing(watched)
    row = np.arange(len(left))
    state = np.real(left)
    pattern = np.empty((samples, len(row)), dtype=np.intp)
    for k in range(samples):
        following = (matrices @ state[:, :, None])[..., 0]
        pattern[k] = np.argmax(np.abs(np.einsum("cmi,mi->cm", following, left)), axis=0)
        state = following[pattern[k], row]
        state /= np.linalg.norm(state, axis=1, keepdims=True)
    return pattern


def square_wave(matrices: Array, spans: NDArray[np.intp]) -> NDArray[np.intp]:
    """The pattern of two choices in turn, each for one of the spans, that grows most."""
    powers = np.stack([[np.linalg.matrix_power(each, int(k)) for k in spans] for each in matrices])
    best, found = -1.0, np.zeros(2, dtype=np.intp)
    for one, other in combinations(range(len(matrices)), 2):
        both = powers[other][None] @ powers[one][:, None]
        sizes = np.max(np.abs(np.linalg.eigvals(both)), axis=-1)
        sizes = sizes ** (1 / (spans[:, None] + spans[None]))
        first, second = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        if sizes[first, second] > best:
            best = float(sizes[first, second])
            found = np.repeat([one, other], [spans[first], spans[second]])
    return found


def pumped(bench: Bench, *, samples: int = 3000, longest: int = 400) -> Array:
    """Largest growth a sample that a periodic gate was found to give, shape (members,).

    Gates chase the swing of the loop with everything shut, and of that with everything open, or
    are square waves; what becomes periodic is improved sample by sample.
    """
    matrices = gated(bench)
    found = np.max(np.abs(np.linalg.eigvals(matrices)), axis=(0, 2))
    spans = np.unique(np.geomspace(1, longest / 2, 24).astype(int))
    for watched in (None, matrices[0], matrices[-1]):
        patterns = None if watched is None else chased(matrices, watched, samples=samples)
        for member in np.flatnonzero(found < 1):
            if patterns is None:
                pattern = square_wave(matrices[:, member], spans)
            else:
                late = patterns[samples // 2 :, member]
                pattern = late[-period_of(late, longest) :]
            found[member] = max(found[member], improved(matrices[:, member], pattern)[0])
    return found


def period_of(pattern: NDArray[np.intp], longest: int) -> int:
    """The shift under which a pattern changes least, the shortest of equals."""
    shifts = range(2, min(longest, len(pattern) // 2))
    changes = [float(np.mean(pattern[each:] != pattern[:-each])) for each in shifts]
    return shifts[int(np.argmin(changes))]


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
        grown = after[1:, None] @ matrices[None] @ before[:-1, None]
        sizes = np.max(np.abs(np.linalg.eigvals(grown)), axis=-1) ** (1 / count)
        place = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        if sizes[place] <= best * (1 + 1e-12):
            return best, pattern
        best = float(sizes[place])
        pattern[place[0]] = place[1]


def faded(bench: Bench, samples: int, longest: int) -> float:
    """Largest growth a sample while the law fades from the first member's to the last's and back.

    Each fade takes about so many samples through all members in turn; between fades either end is
    held for as long as pumps most, up to ``longest`` samples.
    """
    matrices = transitions(bench, 0.0, 0.0)
    between, step = matrices[1:-1], max(1, samples // (bench.members - 1))
    up = down = np.eye(matrices.shape[1])
    for each in between:
        up = np.linalg.matrix_power(each, step) @ up
    for each in between[::-1]:
        down = np.linalg.matrix_power(each, step) @ down
    spans = np.unique(np.geomspace(1, longest, 30).astype(int))
    shut, full = (
        np.stack([np.linalg.matrix_power(matrices[end], int(span)) for span in spans])
        for end in (0, -1)
    )
    period = (down @ full)[None] @ (up @ shut)[:, None]
    sizes = np.max(np.abs(np.linalg.eigvals(period)), axis=-1)
    return float(np.max(sizes ** (1 / (spans[:, None] + spans + 2 * step * len(between)))))
