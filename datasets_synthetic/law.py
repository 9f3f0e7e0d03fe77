"""Control law of a simulated controller: a force for every reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.calls import Calls, Transitions
from datasets_synthetic.controller import Controller, Element
from datasets_synthetic.estimates import (
    Estimates,
    FirstOrderEstimates,
    SectionEstimates,
    first_order_pole,
    section,
)

FloatArray = NDArray[np.float64]


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need.

    The estimates of velocity and acceleration follow every reading, whatever is felt.
    """

    __slots__ = ("_elements", "_estimates")

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        self._estimates = _estimates(controller, sample_time)
        self._elements = ElementsAtWork(controller.elements, controller.calls, sample_time)

    def force(self, reading: FloatArray) -> FloatArray:
        """Sum of what all elements give for this sample's reading (m), N, shape (batch,)."""
        return self._elements.force(reading, *self._estimates.update(reading))


class ElementsAtWork:
    """Elements together; arrays of shape (elements, batch). What no element has is not computed."""

    __slots__ = (
        "_cut",
        "_damping",
        "_high",
        "_low",
        "_mass",
        "_moving",
        "_rest",
        "_stiffness",
        "_transitions",
    )

    def __init__(
        self, elements: Sequence[Element], calls: Calls | None, sample_time: FloatArray
    ) -> None:
        """Sample time in s, shape (batch,)."""

        def rows(name: str) -> FloatArray:
            return np.stack([per_member(getattr(e, name), sample_time.size) for e in elements])

        stiffness, self._damping, mass = rows("stiffness"), rows("damping"), rows("mass")
        self._stiffness = stiffness if stiffness.any() else None
        self._mass = mass if mass.any() else None
        self._rest, side = rows("place"), rows("side")
        most = np.where((stiffness > 0) | (side != 0), rows("level"), np.inf)
        # A wall that pushes to lower readings lets pass what is positive, and the other way round.
        self._low = np.where(side < 0, 0.0, -most)
        self._high = np.where(side > 0, 0.0, most)
        self._cut = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._transitions = None
        #: The first member of those whose elements come and go.
        self._moving = sample_time.size
        if calls is not None:
            self._moving = first = calls.first(sample_time.size)
            some = slice(first, None)
            self._transitions = Transitions(
                calls.members(np.arange(first, sample_time.size)),
                stiffness=stiffness[:, some],
                damping=self._damping[:, some],
                mass=mass[:, some],
                side=side[:, some],
                rest=self._rest[:, some],
                bounds=(self._low[:, some], self._high[:, some]),
                fade=sample_time[some] / rows("fade_time")[:, some].clip(sample_time[some]),
            )

    def force(
        self, reading: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """Sum of the forces (N) of this sample, shape (batch,).

        Args:
            reading: of the position, m.
            velocity: estimated, m/s.
            acceleration: estimated, m/s².
        """
        moving = self._damping * velocity
        if self._mass is not None:
            moving += self._mass * acceleration
        law = moving
        if self._stiffness is not None:
            law = self._stiffness * (reading - self._rest) + moving
        if self._cut:
            law = np.minimum(np.maximum(law, self._low), self._high)
        if self._transitions is not None:
            some = slice(self._moving, None)
            law[:, some] = self._transitions.played(reading[some], moving[:, some], law[:, some])
        return -np.add.reduce(law)


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
