"""A controller at work: a force for every reading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.controller import Controller
from datasets_synthetic.estimates import (
    Estimates,
    FirstOrderEstimates,
    SectionEstimates,
    first_order_pole,
    section,
)
from datasets_synthetic.members import per_member

FloatArray = NDArray[np.float64]


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need."""

    __slots__ = ("_controller", "_estimates", "_inside", "_place", "_start")

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        self._controller = controller
        self._estimates = _estimates(controller, sample_time)
        wall = controller.wall
        self._place = None if wall is None else per_member(wall.place, sample_time.size)
        #: Where the spring is relaxed.
        self._start = (
            None if self._place is None else np.where(np.isinf(self._place), 0.0, self._place)
        )
        self._inside = np.zeros(sample_time.shape, dtype=bool)

    def force(self, reading: FloatArray) -> FloatArray:
        """-(K·q + B·velocity + M·acceleration) for this sample's reading (m), N, shape (batch,).

        With a wall q is counted from it, and there is no force outside.
        """
        gains, wall = self._controller, self._controller.wall
        if wall is None or self._place is None or self._start is None:
            return self._pull(gains.stiffness * reading, reading)
        inside = reading > self._place
        if wall.restarts:
            self._estimates.restart(inside & ~self._inside, reading)
            self._inside = inside
        force = self._pull(gains.stiffness * (reading - self._start), reading)
        if wall.unilateral:
            force = np.minimum(force, 0.0)
        return np.where(inside, force, 0.0)

    def _pull(self, spring: FloatArray, reading: FloatArray) -> FloatArray:
        gains = self._controller
        velocity, acceleration = self._estimates.update(reading)
        return -(spring + gains.damping * velocity + gains.mass * acceleration)


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
            first_order_pole(acceleration, sample_time),
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
