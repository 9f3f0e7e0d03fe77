"""Control law of a simulated controller: a force for every reading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.controller import Controller
from datasets_synthetic.estimates import (
    Estimates,
    FirstOrderEstimates,
    SectionEstimates,
    first_order_pole,
    section,
)
from datasets_synthetic.wall import Element, ElementsAtWork

FloatArray = NDArray[np.float64]


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need.

    The estimates of velocity and acceleration follow every reading, inside a wall and outside.
    """

    __slots__ = ("_elements", "_estimates")

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        self._estimates = _estimates(controller, sample_time)
        own = Element(
            stiffness=controller.stiffness, damping=controller.damping, mass=controller.mass
        )
        elements = (own, *controller.beside)
        self._elements = ElementsAtWork(elements, controller.wall, sample_time)

    def force(self, reading: FloatArray) -> FloatArray:
        """-(K·q + B·velocity + M·acceleration) for this sample's reading (m), N, shape (batch,).

        With a wall q is counted from it, and there is no force outside but of what fades out;
        what stands beside the controller's own effects is added.
        """
        return self._elements.force(reading, *self._estimates.update(reading))


def _estimates(controller: Controller, sample_time: FloatArray) -> Estimates:
    """The filters; the usual ones as plain cascades of first order."""
    velocity, acceleration = controller.velocity_filter_hz, controller.acceleration_filter_hz
    pairs_equal = np.equal(controller.acceleration_filter_order, 2) & np.equal(
        controller.filter_damping_ratio, 1
    )
    if np.all(
        np.equal(controller.velocity_filter_order, 1)
        & np.equal(controller.velocity_window_samples, 1)
        & (pairs_equal | np.isinf(acceleration))
    ):
        return FirstOrderEstimates(
            first_order_pole(velocity, sample_time),
            first_order_pole(acceleration, sample_time) if controller.has_mass else None,
            sample_time,
        )
    ratio = controller.filter_damping_ratio
    window = per_member(controller.velocity_window_samples, sample_time.size).astype(np.int64)
    return SectionEstimates(
        section(velocity, controller.velocity_filter_order, ratio, sample_time),
        section(acceleration, controller.acceleration_filter_order, ratio, sample_time),
        window,
        sample_time,
    )
