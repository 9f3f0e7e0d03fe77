"""Zames-Falb multipliers by conic programming over a grid of frequencies.

For a given gain the condition of `absolute` is linear in the weights of the taps and the constants:
a Hermitian matrix of each frequency and loop that has to be positive definite. The weights with
which the least of their eigenvalues is largest are the answer of a conic program; frequencies at
which it then falls short are added until none does.

G. Zames and P. L. Falb, "Stability conditions for systems with monotone and slope-restricted
nonlinearities", SIAM J. Control 6(1), 1968; discrete: J. C. Willems and R. W. Brockett, "Some new
rearrangement inequalities having application in stability analysis", IEEE TAC 13(5), 1968.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Channel, Multiplier, Tap
from tune.stability.absolute import Nonlinearities, Responses, difference_at, is_peak

if TYPE_CHECKING:
    import clarabel

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Delays of the taps, samples: all of the short ones, then each so many times the one before, up to
#: so many times the delay of the loop, or to this many.
_SHORT, _RATIO, _DELAYS, _LONG = 8, 1.3, 6, 31
#: Of the points of the grid the first program sees one in so many.
_SEEN = 128
#: Programs at most.
_ROUNDS = 6
#: Weights below this part of the largest are none.
_NOTHING = 1e-9


def find_multiplier(
    responses: Responses, parts: Nonlinearities, gain: float, delay_samples: float
) -> Multiplier | None:
    """The multiplier with the most room at a gain, over all loops; None where there is none.

    It is as good as a grid can tell: what it proves is for `absolute_gain` to say.

    Args:
        responses: of the loops, all free or all grounded.
        parts: the nonlinearities of the sum.
        gain: up to which it is to prove the sum.
        delay_samples: the longest of the loops.
    """
    table, owners = _table(responses, parts, gain, _ladder(delay_samples))
    slopes = _slopes(responses, parts, owners)
    seen = np.arange(0, table.shape[1], _SEEN, dtype=np.intp)
    weights: FloatArray | None = None
    for _ in range(_ROUNDS):
        weights = _program(table[:, seen], slopes)
        if weights is None:
            return None
        matrices = np.tensordot(weights, table, axes=1)
        values: FloatArray = np.asarray(np.linalg.eigvalsh(matrices), dtype=np.float64)
        least = values[:, 0].reshape(responses.position.shape)
        short = np.flatnonzero(is_peak(-least) & (least <= 0))
        if not short.size:
            break
        seen = np.union1d(seen, short)
    assert weights is not None
    return _multiplier(weights, owners, parts, grounded=responses.grounded)


def _ladder(delay_samples: float) -> list[int]:
    """Delays of the taps, samples."""
    longest = max(_LONG, _DELAYS * (delay_samples + 1))
    count = int(np.log(longest / _SHORT) / np.log(_RATIO))
    return [*range(1, _SHORT), *(round(_SHORT * _RATIO**step) for step in range(count + 1))]


def _table(
    responses: Responses, parts: Nonlinearities, gain: float, ladder: list[int]
) -> tuple[ComplexArray, list[tuple[int, int]]]:
    """Hermitian matrices of each unknown, (unknowns, points, n, n), and its (channel, tap).

    A constant is tap 0. Rows of a channel are in units of its own size times the gain. At each
    point the matrices are turned and scaled alike, so that none of their directions is small in all
    of them: near θ = 0 that in which two clamps push against each other is.
    """
    loops = gain * parts.loops(responses)
    size, angle = len(loops), np.broadcast_to(responses.angle, loops.shape[1:])
    tables: list[ComplexArray] = []
    owners: list[tuple[int, int]] = []
    for channel in range(size):
        taps = (0, *ladder) if responses.grounded else ladder
        for tap in taps if channel < len(parts.clamps) else (0,):
            factor = difference_at(tap, angle) if tap else np.ones(angle.shape)
            matrix = np.zeros((*angle.shape, size, size), dtype=np.complex128)
            matrix[..., channel, :] = (factor * loops[channel])[..., None]
            matrix[..., channel, channel] += factor
            hermitian = (matrix + np.conj(np.swapaxes(matrix, -1, -2))) / 2
            tables.append(hermitian.reshape(-1, size, size))
            owners.append((channel, tap))
    table = np.stack(tables)
    values, vectors = np.linalg.eigh(np.einsum("vpij,vpjk->pik", table, table))
    scale = vectors * np.maximum(values, np.finfo(float).tiny)[:, None, :] ** -0.25
    return np.einsum("pji,vpjk,pkl->vpil", np.conj(scale), table, scale, optimize=True), owners


def _slopes(
    responses: Responses, parts: Nonlinearities, owners: list[tuple[int, int]]
) -> FloatArray:
    """Rows that are zero where every clamp's multiplier has the slope of the first at θ = 0.

    Where nothing holds the position, no others prove two clamps there. Shape (rows, unknowns).
    """
    count = 1 if responses.grounded else len(parts.clamps)
    each = [parts.sizes[owner] / max(parts.sizes) * tap for owner, tap in owners]
    own = np.eye(len(parts.sizes))[:, [owner for owner, _ in owners]]
    return (own[:1] - own[1:count]) * each


def _program(table: ComplexArray, slopes: FloatArray) -> FloatArray | None:
    """Weights that sum to one with which the least eigenvalue of a table is largest, if above 0.

    They make every row of slopes zero.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    count, points, *_ = table.shape
    cone, rows, unit = _cone_rows(table)
    equal, first = 1 + len(slopes), 1 + len(slopes) + count
    program = np.zeros((first + rows.shape[1], count + 1))
    program[0, :count] = 1
    program[1:equal, :count] = slopes
    program[equal:first, :count] = -np.eye(count)
    program[first:, :count] = -rows.T
    program[first:, -1] = np.tile(unit, points)
    target, cost = np.zeros(len(program)), np.zeros(count + 1)
    target[0], cost[-1] = 1, -1
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones: list[clarabel.Cone] = [clarabel.ZeroConeT(equal), clarabel.NonnegativeConeT(count)]
    cones += [clarabel.NonnegativeConeT(points)] if cone is None else [cone] * points
    answer = clarabel.DefaultSolver(
        csc_matrix((count + 1, count + 1)), cost, csc_matrix(program), target, cones, settings
    ).solve()
    found = np.array(answer.x, dtype=np.float64)
    if not np.all(np.isfinite(found)) or not found[-1] > -_NOTHING:
        return None
    return np.maximum(found[:-1], 0.0)


def _cone_rows(table: ComplexArray) -> tuple[clarabel.Cone | None, FloatArray, FloatArray]:
    """(cone of one point, rows of all points by unknown, what an eigenvalue adds to each row)."""
    import clarabel

    count, _, size, _ = table.shape
    if size == 1:
        return None, table.real.reshape(count, -1), np.ones(1)
    if size == 2:
        first, second, across = table[..., 0, 0].real, table[..., 1, 1].real, table[..., 0, 1]
        rows = np.stack([first + second, first - second, 2 * across.real, 2 * across.imag], axis=-1)
        return clarabel.SecondOrderConeT(4), rows.reshape(count, -1), np.array([2.0, 0, 0, 0])
    whole = np.block([[table.real, -table.imag], [table.imag, table.real]])
    column, row = np.tril_indices(2 * size)
    scaled = whole[..., row, column] * np.where(row == column, 1.0, np.sqrt(2))
    cone = clarabel.PSDTriangleConeT(2 * size)
    return cone, scaled.reshape(count, -1), np.where(row == column, 1.0, 0.0)


def _multiplier(
    weights: FloatArray, owners: list[tuple[int, int]], parts: Nonlinearities, *, grounded: bool
) -> Multiplier:
    """Weights as channels: rows were in units of each channel's own size.

    Over the slope of the first clamp where nothing holds the position, else over the largest.
    """
    scaled = np.array([w * parts.sizes[i] for (i, _), w in zip(owners, weights, strict=True)])
    slope = sum(w * tap for (i, tap), w in zip(owners, scaled, strict=True) if i == 0)
    scaled /= float(scaled.max()) if grounded else float(slope)
    least = _NOTHING * float(scaled.max())
    channels: list[Channel] = []
    for index, name in enumerate(parts.names):
        own = [w * (owner == index) for (owner, _), w in zip(owners, scaled, strict=True)]
        mine = {tap: float(w) for (_, tap), w in zip(owners, own, strict=True) if w > least}
        constant = mine.pop(0, 0.0)
        taps = tuple(Tap(samples=tap, weight=weight) for tap, weight in mine.items())
        channels.append(Channel(name=name, constant=constant, taps=taps))
    return Multiplier(channels=tuple(channels))
