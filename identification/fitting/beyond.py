"""Friction beyond the model, where noise does not explain what the model leaves over."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from identification.estimators.model import Estimate
from identification.fitting.choice import noise_explains
from identification.fitting.workshop import Workshop

if TYPE_CHECKING:
    from identification.structure.friction_curve import FrictionCurve


def beyond_model(workshop: Workshop) -> FrictionCurve | None:
    """What the residual of a log holds beside noise; nothing is spent where noise explains it."""
    if workshop.fit("least-squares").value("mass") <= 0 or noise_explains(workshop) is not None:
        return None
    from identification.structure.friction_curve import friction_curve

    return friction_curve(workshop.table, workshop.delay)


def with_mass_of(curve: FrictionCurve, estimate: Estimate) -> Estimate:
    """The estimate with the mass that the friction found leaves, and the uncertainty of that.

    Damping stays the constant that explains the log best; its slope is the curve's.
    """
    if curve.mass <= 0:
        return estimate
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    values[0] = curve.mass
    before = np.sqrt(covariance[0, 0])
    factor = curve.mass_deviation / before if before > 0 else 0.0
    covariance[0, :] *= factor
    covariance[:, 0] *= factor
    covariance[0, 0] = curve.mass_deviation**2
    note = f"mass {estimate.value('mass'):.5g} without the friction found beyond the model"
    return replace(estimate, values=values, covariance=covariance, notes=(*estimate.notes, note))
