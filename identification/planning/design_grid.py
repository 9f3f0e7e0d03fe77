"""Design grid: the coarse grid of times on which forces are designed, with their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.planning.design_criterion import DesignCriterion, Friction
from identification.planning.response import Response
from identification.planning.spec import ExcitationSpec

FloatArray = NDArray[np.float64]

#: Highest frequency, as a multiple of the corner b/m or of where force or speed runs out before
#: travel does: well above it the device hardly moves.
_ABOVE = 3.0
#: Periods of the highest frequency in the shortest signal, so that there is something to choose.
_FEWEST_PERIODS = 8.0
#: Samples of the controller in a period of the highest frequency, at least.
_FEWEST_SAMPLES = 20.0
#: Points of the grid in a period of the highest frequency; peaks between them are under 1 %.
_POINTS = 24.0
#: The velocity at a turn is as well known as readings over this part of the shortest period tell:
#: with less care, turns become so slow that output error no longer reaches the bound.
_WINDOW = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignGrid:
    """Where forces are tried.

    Attributes:
        spec: limits and guesses.
        highest: frequency, Hz.
        step: of the grid, s.
        count: points of the grid.
        devices: (mass, response) of the guess, and of the lightest and least damped device, which
            goes farthest, if the guesses are ranges.
        merit: of net forces per mass of the guess.
    """

    spec: ExcitationSpec
    highest: float
    step: float
    count: int
    devices: tuple[tuple[float, Response], ...]
    merit: DesignCriterion

    @classmethod
    def of(cls, spec: ExcitationSpec) -> DesignGrid:
        """The bench for limits and guesses."""
        mass, damping = spec.mass.value, spec.damping.value
        room = force_room(spec)
        speed = np.sqrt(room * spec.travel / mass)
        if damping > 0:
            speed = min(speed, room / damping)
        if spec.speed is not None:
            speed = min(speed, spec.speed)
        knee = max(damping / mass, speed / spec.travel) / (2 * np.pi)
        highest = max(_ABOVE * knee, _FEWEST_PERIODS / spec.duration)
        highest = min(highest, 1 / (_FEWEST_SAMPLES * spec.sample_time))
        count = min(int(np.ceil(spec.duration * _POINTS * highest)), spec.samples)
        step = spec.duration / count
        # As many readings as the log has, told by fewer points.
        share = np.sqrt(spec.sample_time / step)

        def device(mass: float, damping: float) -> Response:
            return Response(
                rate=damping / mass,
                step=step,
                count=count,
                noise=spec.reading_noise * share,
                acceleration_noise=spec.force_noise / mass * share,
            )

        devices = [(mass, device(mass, damping))]
        if not (spec.mass.exact and spec.damping.exact):
            devices.append((spec.mass.low, device(spec.mass.low, spec.damping.low)))
        friction = None
        if spec.coulomb_friction.value > 0:
            window = _WINDOW / highest
            friction = Friction(
                grip=spec.coulomb_friction.value / mass,
                # Standard deviation of the slope of a line through the readings of the window.
                blur=spec.reading_noise * np.sqrt(12 * spec.sample_time / window**3),
                speed=speed,
                acceleration=room / mass,
            )
        response = devices[0][1]
        merit = DesignCriterion(
            response=response,
            unknowns=response.unknowns(),
            friction=friction,
            delay_known=spec.delay == "known",
        )
        return cls(
            spec=spec,
            highest=highest,
            step=step,
            count=count,
            devices=tuple(devices),
            merit=merit,
        )

    @property
    def time(self) -> FloatArray:
        """Middles of the steps, s, shape (count,)."""
        return (np.arange(self.count, dtype=np.float64) + 0.5) * self.step

    def score(self, force: FloatArray) -> tuple[float, FloatArray]:
        """Merit of a net force (N, shape (count,)) and its gradient by the force."""
        mass = self.devices[0][0]
        value, gradient = self.merit(force / mass)
        return value, gradient / mass

    def loads(self, force: FloatArray) -> FloatArray:
        """Force, then position and speed of each device, as parts of their limits.

        A net force, in N, has shape (count,); the answer is one such row for each limit, all in one
        column of shape (limits·count,).
        """
        spec = self.spec
        rows = [force / force_room(spec)]
        for mass, response in self.devices:
            rows.append(response.place(force) / (mass * spec.travel))
            if spec.speed is not None:
                rows.append(response.speed(force) / (mass * spec.speed))
        return np.concatenate(rows)

    def loads_returned(self, weights: FloatArray) -> FloatArray:
        """Gradient by the force from that by the loads, shape (count,)."""
        spec = self.spec
        parts = iter(np.split(weights, weights.size // self.count))
        total = next(parts) / force_room(spec)
        for mass, response in self.devices:
            total = total + response.place(next(parts)[::-1])[::-1] / (mass * spec.travel)
            if spec.speed is not None:
                total = total + response.speed_returned(next(parts)) / (mass * spec.speed)
        return total


def force_room(spec: ExcitationSpec) -> float:
    """Force left to move the device when friction and offset have taken theirs, N."""
    offset = max(abs(spec.force_offset.low), abs(spec.force_offset.high))
    return spec.force - spec.coulomb_friction.high - offset


def fade(time: FloatArray, spec: ExcitationSpec) -> FloatArray:
    """Raised cosine from 0 to 1 over the first ramp and back over the last; shape of ``time``."""
    if spec.ramp == 0:
        return np.ones_like(time)
    nearer = np.minimum(time, spec.duration - time) / spec.ramp
    return np.sin(np.pi / 2 * np.clip(nearer, 0.0, 1.0)) ** 2
