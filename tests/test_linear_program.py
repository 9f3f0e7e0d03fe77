"""Linear programs and nonnegative combinations beside those of another library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from tune.optimisation.linear_programs import nonnegative_combination, solve_linear_program


@pytest.mark.parametrize("seed", range(20))
def test_programs_end_where_those_of_another_library_do(seed: int) -> None:
    rng = np.random.default_rng((seed, 3))
    rows = np.column_stack([rng.normal(size=(8, 2)), np.ones(8)])
    most, cost = rng.normal(size=8), np.array([0.0, 0.0, -1.0])
    low, high = np.array([-1.0, -1.0, -np.inf]), np.array([1.0, 1.0, np.inf])
    found = solve_linear_program(cost, rows, (np.full(8, -np.inf), most), (low, high))
    other = linprog(cost, A_ub=rows, b_ub=most, bounds=[(-1, 1), (-1, 1), (None, None)])
    assert found is not None
    assert other.x is not None
    np.testing.assert_allclose(found, other.x, atol=1e-9)


def test_what_no_point_meets_has_no_answer() -> None:
    one = np.ones(1)
    assert solve_linear_program(one, np.eye(1), (2 * one, 3 * one), (0 * one, one)) is None
    free = np.array([np.inf])
    assert solve_linear_program(-one, np.eye(1), (-free, free), (-free, free)) is None


@pytest.mark.parametrize("seed", range(20))
def test_a_combination_that_reaches_its_target_is_found(seed: int) -> None:
    rng = np.random.default_rng((seed, 4))
    columns = rng.normal(size=(3, 3))
    columns /= np.linalg.norm(columns, axis=0)
    weights = rng.uniform(0, 1, 3) * (rng.random(3) < 0.7)
    found = nonnegative_combination(columns, columns @ weights)
    assert found is not None
    np.testing.assert_allclose(columns @ found, columns @ weights, atol=1e-9)
    np.testing.assert_allclose(found, weights, atol=1e-8 * np.linalg.cond(columns))


@pytest.mark.parametrize("seed", range(20))
def test_a_target_out_of_reach_is_seen_as_such(seed: int) -> None:
    """Where the nearest by least squares is far, so is the nearest by absolute differences."""
    rng = np.random.default_rng((seed, 5))
    columns, target = rng.normal(size=(3, 4)), rng.normal(size=3)
    _, left = nnls(columns, target)
    found = nonnegative_combination(columns, target)
    assert found is not None
    assert np.all(found >= 0)
    own = float(np.linalg.norm(columns @ found - target))
    assert left - 1e-9 <= own <= np.sqrt(3) * left + 1e-9
