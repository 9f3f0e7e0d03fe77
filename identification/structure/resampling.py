"""One regression, cut into blocks: what the whole log and its random halves say.

Only the normal equations of each block are kept, so halves cost nothing in the length of the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import UNKNOWN_FORCE

FloatArray = NDArray[np.float64]

#: Blocks a log is cut into: a block of a usual log outlasts the filter many times, and the
#: covariance of seven candidates needs several times their number.
BLOCKS = 60
#: Correlation of neighbouring blocks above this is taken as this: beyond it sixty blocks cannot
#: tell a slow disturbance from a constant.
MOST_CORRELATED = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class Resampled:
    """Coefficients of the candidates, of the whole log and of parts.

    Attributes:
        coefficients: shape (p,), of the candidates, all in.
        covariance: shape (p, p), by leaving out one block in turn.
        root: shape (p, p), W with WᵀW = covariance⁻¹: in W·coefficients errors are independent.
        gram: shape (p, p), mean products of the candidates' columns.
        normals: shape (blocks, q, q), nuisance first.
        rights: shape (blocks, q).
    """

    coefficients: FloatArray
    covariance: FloatArray
    root: FloatArray
    gram: FloatArray
    normals: FloatArray
    rights: FloatArray

    def halves(self, count: int, seed: int) -> FloatArray:
        """Coefficients of random halves of the blocks, complementary in pairs, shape (count, p)."""
        generator = np.random.default_rng(seed)
        blocks = len(self.normals)
        middle = blocks // 2
        parts: list[NDArray[np.intp]] = []
        for _ in range((count + 1) // 2):
            order = generator.permutation(blocks)
            parts += [order[:middle], order[middle:]]
        nuisance = self.rights.shape[1] - self.coefficients.size
        return np.stack(
            [
                least_norm(self.normals[part].sum(axis=0), self.rights[part].sum(axis=0))[nuisance:]
                for part in parts[:count]
            ]
        )

    def only(self, members: list[int]) -> tuple[FloatArray, float]:
        """The fit with some candidates only: coefficients, shape (len(members),), and the rise χ².

        Generalised least squares from the fit with all of them.
        """
        target = self.root @ self.coefficients
        if not members:
            return np.empty(0), float(target @ target)
        columns = self.root[:, members]
        fitted = least_norm(columns, target)
        missed = target - columns @ fitted
        return fitted, float(missed @ missed)


def cut_into_blocks(columns: FloatArray, answer: FloatArray, *, nuisance: int) -> Resampled:
    """The least-squares fit of an answer, in blocks.

    Args:
        columns: shape (rows, q), each of mean square 1.
        answer: shape (rows,), of mean square 1.
        nuisance: how many leading columns are not candidates.
    """
    return sums_of(columns, answer).resampled(list(range(columns.shape[1])), nuisance=nuisance)


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockSums:
    """Normal equations of consecutive blocks, from which any columns are fitted at once.

    Attributes:
        normals: shape (blocks, q, q).
        rights: shape (blocks, q).
        rows: of the whole log.
        square: sum of squares of the answer.
    """

    normals: FloatArray
    rights: FloatArray
    rows: int
    square: float

    def fit(self, members: list[int]) -> tuple[FloatArray, FloatArray]:
        """Least squares on some columns: coefficients, shape (p,), and covariance, (p, p).

        The covariance is that of leaving out one block in turn, whatever the colour of the
        residual, plus that of a force nobody knows.
        """
        normals = self.normals[:, members][:, :, members]
        rights = self.rights[:, members]
        whole = normals.sum(axis=0)
        fitted = least_norm(whole, rights.sum(axis=0))
        scores = rights - normals @ fitted
        # The fit without block i differs from the whole fit by -(A - A_i)⁺ c_i.
        shifts = (_inverse(whole - normals) @ scores[:, :, None])[:, :, 0]
        floor = UNKNOWN_FORCE**2 * self.rows * _inverse(whole)
        return fitted, _long_run(shifts) + floor

    def resampled(self, members: list[int], *, nuisance: int) -> Resampled:
        """The fit of some columns and of its parts; the first few are no candidates."""
        fitted, covariance = self.fit(members)
        normals, rights = self.normals[:, members][:, :, members], self.rights[:, members]
        return Resampled(
            coefficients=fitted[nuisance:],
            covariance=covariance[nuisance:, nuisance:],
            root=_root_of_inverse(covariance[nuisance:, nuisance:]),
            gram=normals.sum(axis=0)[nuisance:, nuisance:] / self.rows,
            normals=normals,
            rights=rights,
        )

    def left(self, members: list[int]) -> float:
        """Mean square of the answer that least squares on some columns leaves over."""
        right = self.rights[:, members].sum(axis=0)
        whole = self.normals.sum(axis=0)[np.ix_(members, members)]
        return max(0.0, self.square - float(least_norm(whole, right) @ right)) / self.rows


def sums_of(columns: FloatArray, answer: FloatArray) -> BlockSums:
    """Normal equations of BLOCKS blocks.

    Args:
        columns: shape (rows, q), each of mean square 1.
        answer: shape (rows,), of mean square 1.
    """
    edges = np.linspace(0, answer.size, BLOCKS + 1).astype(int).tolist()
    return BlockSums(
        normals=np.stack([columns[i:j].T @ columns[i:j] for i, j in pairwise(edges)]),
        rights=np.stack([columns[i:j].T @ answer[i:j] for i, j in pairwise(edges)]),
        rows=answer.size,
        square=float(answer @ answer),
    )


def _long_run(shifts: FloatArray) -> FloatArray:
    """Covariance of a sum of shifts that are correlated from block to block, shape (q, q).

    Bartlett's weights (Newey and West, Econometrica 55, 1987, p. 703) up to the distance that is
    best for a first-order process (Andrews, Econometrica 59, 1991, p. 834).

    Args:
        shifts: of the coefficients by leaving out each block, shape (blocks, q).
    """
    blocks = len(shifts)
    power = np.sum(shifts * shifts, axis=0)
    crossed = np.sum(shifts[1:] * shifts[:-1], axis=0)
    correlation = float(np.max(crossed / np.where(power > 0, power, 1.0)))
    correlation = min(max(correlation, 0.0), MOST_CORRELATED)
    memory = 4 * correlation**2 / (1 - correlation**2) ** 2
    reach = int(1.1447 * (memory * blocks) ** (1 / 3))
    total = shifts.T @ shifts
    for distance in range(1, reach + 1):
        later = shifts[distance:].T @ shifts[:-distance]
        total += (1 - distance / (reach + 1)) * (later + later.T)
    return (blocks - 1) / blocks * total


def least_norm(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution of least norm; a half of a log may lack a term altogether.

    The matrix has shape (rows, columns), the right side shape (rows,), the solution shape
    (columns,).
    """
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def _inverse(normal: FloatArray) -> FloatArray:
    """Pseudo-inverse of symmetric matrices, shape (..., q, q)."""
    return np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=np.float64)


def _root_of_inverse(covariance: FloatArray) -> FloatArray:
    """W with WᵀW the inverse of a covariance."""
    deviations = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    return (vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))).T / deviations
