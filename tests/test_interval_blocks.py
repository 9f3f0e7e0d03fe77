"""Intervals from leaving out blocks, against the same done by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import MOST_BLOCKS, spread

Array = NDArray[np.float64]

#: Values behind the columns of ``told_unevenly``.
TOLD = np.array([2.0, -0.1])


def told_unevenly(generator: np.random.Generator) -> tuple[Array, Array, Array]:
    """Columns, instruments and target; the second column is loud in a tenth of the rows only."""
    rows = 1200
    loud = np.where(np.arange(rows) < rows // 10, 50.0, 5.0)
    tests = generator.standard_normal((2, rows)) * np.stack((np.ones(rows), loud))
    columns = tests + 0.3 * generator.standard_normal((2, rows))
    return columns, tests, TOLD @ columns + generator.standard_normal(rows)


def test_covariance_is_the_jackknife_done_by_hand() -> None:
    columns, _, target = told_unevenly(np.random.default_rng(3))
    values = np.linalg.lstsq(columns.T, target, rcond=None)[0]
    rows = target.size
    found = spread(columns, target - values @ columns, 2, signal=np.zeros(rows))
    left_out = np.empty((MOST_BLOCKS, 2))
    edges = np.linspace(0, rows, MOST_BLOCKS + 1).astype(int).tolist()
    for block, (first, last) in enumerate(pairwise(edges)):
        kept = np.r_[0:first, last:rows]
        part = columns[:, kept]
        left_out[block] = np.linalg.solve(part @ part.T, part @ target[kept])
    off = left_out - values
    expected = (MOST_BLOCKS - 1) / MOST_BLOCKS * off.T @ off
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8)
    assert found.degrees_of_freedom == MOST_BLOCKS - 1


def test_with_instruments_each_block_counts_by_the_root_of_what_leaving_it_out_would() -> None:
    from scipy.linalg import sqrtm

    columns, tests, target = told_unevenly(np.random.default_rng(4))
    inverse = np.linalg.inv(tests @ columns.T)
    residual = target - (inverse @ tests @ target) @ columns
    rows = target.size
    found = spread(columns, residual, 2, signal=np.zeros(rows), instruments=tests)
    expected = np.zeros((2, 2))
    for first, last in pairwise(np.linspace(0, rows, MOST_BLOCKS + 1).astype(int).tolist()):
        part = slice(first, last)
        rest = np.eye(2) - inverse @ tests[:, part] @ columns[:, part].T
        adds = inverse @ tests[:, part] @ residual[part]
        shift = np.linalg.solve(np.asarray(sqrtm(rest)).real, adds)
        expected += np.outer(shift, shift)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8)


def test_with_instruments_the_covariance_is_without_bias() -> None:
    errors, variances = np.empty((2, 300, 2))
    for seed in range(300):
        columns, tests, target = told_unevenly(np.random.default_rng([5, seed]))
        values = np.linalg.solve(tests @ columns.T, tests @ target)
        residual = target - values @ columns
        found = spread(columns, residual, 2, signal=np.zeros(target.size), instruments=tests)
        errors[seed], variances[seed] = values - TOLD, np.diag(found.covariance)
    # 300 squares know their mean to 8 %.
    np.testing.assert_allclose(np.mean(np.square(errors), 0), np.mean(variances, 0), rtol=0.25)
