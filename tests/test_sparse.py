"""The sparse regression of pysindy: which terms pay for themselves."""

from __future__ import annotations

import numpy as np

from identification.fitting.stability_selection import paying_terms


def test_terms_that_pay_are_picked() -> None:
    """With independent unit errors a term's χ² is the square of its coefficient."""
    answers = np.array([[9.0, 0.1, 9.0, 2.0], [9.0, -0.3, 2.4, 0.0], [-7.0, 0.0, -2.6, 0.0]])
    picked = paying_terms(np.eye(3), answers, 2.5**2)
    expected = [[True, True, True], [False] * 3, [True, False, True], [False] * 3]
    assert picked.tolist() == expected


def test_the_best_subset_is_found_among_correlated_columns() -> None:
    """Two columns at 5 degrees: either alone seems to explain the other's part."""
    tilt = np.deg2rad(5.0)
    columns = np.array([[1.0, np.cos(tilt)], [0.0, np.sin(tilt)]])
    answers = np.stack([columns[:, 1] * 20, columns[:, 0] * 20, columns @ [200.0, -150.0]], axis=1)
    picked = paying_terms(columns, answers, 1.0)
    assert picked.tolist() == [[False, True], [True, False], [True, True]]


def test_a_coefficient_that_is_exactly_zero_does_not_come_free() -> None:
    """In orthogonal columns, on every processor; the one before is so by rounding, on some."""
    picked = paying_terms(np.eye(3), np.array([[20.0], [0.0], [0.0]]), 1.0)
    assert picked.tolist() == [[True, False, False]]
