"""Linear programs by HiGHS, and nonnegative combinations as one of them.

Through CasADi, which a tuning has loaded anyway; scipy.optimize alone would take a third of a
second to import.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def solve_linear_program(
    cost: FloatArray,
    rows: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """The x of least cost·x with rows·x between two ends and x between two bounds.

    All numbers are of one scale, without unit.

    Args:
        cost: shape (n,).
        rows: shape (m, n).
        ends: lowest and highest of each row, shape (m,) each, infinite for none.
        bounds: of each unknown, shape (n,) each, infinite for none.

    Returns:
        Shape (n,); None where there is no such x.
    """
    solver = _solver(*rows.shape)
    found = solver(g=cost, a=rows, lba=ends[0], uba=ends[1], lbx=bounds[0], ubx=bounds[1])
    if not solver.stats()["success"]:
        return None
    return np.asarray(found["x"], dtype=np.float64).ravel()


def nonnegative_combination(columns: FloatArray, target: FloatArray) -> FloatArray | None:
    """Weights, none negative, of the combination of columns that comes nearest to a target.

    Nearest in the sum of absolute differences. Columns and target are of length about one.

    Args:
        columns: shape (rows, n).
        target: shape (rows,).

    Returns:
        Shape (n,); None where the solver gives up.
    """
    rows, count = columns.shape
    identity = np.eye(rows)
    cost = np.concatenate([np.zeros(count), np.ones(2 * rows)])
    answer = solve_linear_program(
        cost,
        np.hstack([columns, identity, -identity]),
        (target, target),
        (np.zeros_like(cost), np.full_like(cost, np.inf)),
    )
    return None if answer is None else np.maximum(answer[:count], 0.0)


@lru_cache(maxsize=256)
def _solver(rows: int, unknowns: int) -> Any:
    import casadi as ca

    shape = {"h": ca.Sparsity(unknowns, unknowns), "a": ca.Sparsity.dense(rows, unknowns)}
    options = {"error_on_fail": False, "highs": {"output_flag": False}}
    return ca.conic("linear_program", "highs", shape, options)
