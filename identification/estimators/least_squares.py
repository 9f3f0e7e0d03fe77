"""Filtered least squares: the regression of a log solved as it is, with its cut-off in doubt."""

from __future__ import annotations

from identification.estimators.intervals import spread
from identification.estimators.model import Estimate
from identification.estimators.point_estimate import PointEstimate, complete_estimate
from identification.estimators.regression import Regression

#: The cut-off is divided and multiplied by this to see whether the estimate leans on it; half of
#: the difference is one more standard deviation.
CUT_OFF_RANGE = 2.0


def point(table: Regression, delay: float) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    force, values = table.force(delay), table.solve(delay)
    residual = force - values @ table.columns
    return PointEstimate(values=values, delay=delay, signal=force, residual=residual)


def fit(table: Regression, delay: float) -> Estimate:
    """Mass, damping and friction by filtered least squares.

    Args:
        table: with at least as many known intervals as the delay needs.
        delay: s, command to force; a fraction of a sample is honoured.

    Returns:
        Estimate with the residual in force, filtered; its notes state the cut-off and what mass
        and damping become at half and at twice of it.
    """
    found = point(table, delay)
    force, residual = found.signal, found.residual
    around = spread(table.columns, residual, len(table.columns), signal=force)
    low, high = (
        table.at_cut_off(factor * table.cut_off.frequency).solve(delay)
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    # What depends on the filter is an error of the model, which blocks of one log do not show.
    leaning = (high - low) / 2
    notes = (
        table.cut_off.reason,
        f"at half the cut-off mass is {low[0]:.5g} and damping {low[1]:.5g}",
        f"at twice the cut-off mass is {high[0]:.5g} and damping {high[1]:.5g}",
    )
    return complete_estimate(
        "least-squares",
        table.model,
        found,
        around,
        fitted=False,
        unit="force",
        mean_speed=table.mean_speed,
        notes=notes,
        leaning=leaning,
    )
