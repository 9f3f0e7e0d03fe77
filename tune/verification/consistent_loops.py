"""Devices and delays under which the loop would move as the log shows.

In free motion a delay d under a spring K looks like damping: what decays is m·q̈ + (b - K·d)·q̇ +
K·q, so one log at one gain tells b - K·d and never d alone. What it tells is the set of all
(m, b, k, d), m, b and the device's own stiffness k within its box, whose slow mode is the measured
one. The range of d in it is the interval of the delay; and as each d comes with its own m, b and k,
the set says more of other gains than that interval beside the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.loop.filters import Filters, used_filters
from tune.loop.sampled_plant import LONGEST_DELAY
from tune.verification.loops_over import damped_hertz, loops_over, slow_poles

FloatArray = NDArray[np.float64]
Range = tuple[float, float]

#: Samples of delay looked through beyond the stated one, and the step of the search.
_MOST_SAMPLES = 16.0
#: Masses, dampings and own stiffnesses that stand for the box, ...
_MASSES, _DAMPINGS, _STIFFNESSES = 21, 17, 5
#: ... and those, with every whole delay, at which the mode is computed: it is smooth between.
_KNOTS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMode:
    """What is known of the slow mode, intervals and tolerances included; None where nothing is.

    Attributes:
        frequency: (low, high), Hz.
        decay: (low, high), 1/s.
    """

    frequency: Range | None
    decay: Range | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentLoops:
    """Devices and delays whose loop has a given slow mode, each of shape (n,).

    Attributes:
        mass: kg.
        damping: N·s/m.
        position_stiffness: slope of the device's own force by position, N/m.
        delay_samples: from command to measurement.
        most: the longest delay that was looked at, samples.
        step: between the delays that were looked at, samples.
        stated: (low, high) of the device, samples.
    """

    mass: FloatArray
    damping: FloatArray
    position_stiffness: FloatArray
    delay_samples: FloatArray
    most: float
    step: float
    stated: Range

    @property
    def delays(self) -> Range | None:
        """(least, longest) delay, samples; None where no loop is allowed."""
        if self.delay_samples.size == 0:
            return None
        return float(self.delay_samples.min()), float(self.delay_samples.max())

    @property
    def open_ended(self) -> bool:
        """Whether the longest delay that was looked at is allowed, and so may be longer ones."""
        return self.delays is not None and self.delays[1] >= self.most

    @property
    def allow_stated(self) -> bool:
        """Whether a delay the device states is among them."""
        low, high = self.stated
        return bool(np.any((self.delay_samples >= low) & (self.delay_samples <= high)))


class Modes:
    """The slow mode under some effects, of any loop of a device's box and of any delay."""

    __slots__ = ("_knots", "_places", "_values", "most", "stated", "step")

    def __init__(
        self, device: Device, filters: Filters, effects: Effects, *, extra: float, step: float = 0.5
    ) -> None:
        """Computes it at the knots.

        Args:
            device: with its intervals.
            filters: that were run.
            effects: as played, single numbers.
            extra: samples of delay that are to be judged beyond.
            step: between the delays looked at, samples.
        """
        box, T = device.simultaneous_box(), device.sample_time.value
        stated = box.delay[0] / box.sample_time[1], box.delay[1] / box.sample_time[0]
        most = min(LONGEST_DELAY - extra, max(_MOST_SAMPLES, float(np.ceil(stated[1]))))
        delays = np.unique(
            [*np.arange(0.0, most + step / 2, step), *stated, device.delay.value / T]
        )
        slopes = _places(box.position_stiffness, _STIFFNESSES)
        self._places = (
            delays,
            _places(np.log(box.mass), _MASSES),
            _places(box.damping, _DAMPINGS),
            slopes,
        )
        self._knots = (
            np.arange(most + 1),
            _places(np.log(box.mass), _KNOTS),
            _places(box.damping, _KNOTS),
            slopes,
        )
        self._values = _mode(device, filters, effects, self._knots)
        self.most, self.step, self.stated = most, step, stated

    def allow(self, seen: MeasuredMode) -> ConsistentLoops:
        """The loops whose slow mode is the one seen."""
        grid = np.meshgrid(*self._places, indexing="ij")
        inside = np.ones(grid[0].shape, dtype=np.bool_)
        for values, wanted in zip(self._values, (seen.frequency, seen.decay), strict=True):
            if wanted is not None:
                between = _interpolated(self._knots, values, self._places)
                reach = _reach(between)
                inside &= (between + reach >= wanted[0]) & (between - reach <= wanted[1])
        return ConsistentLoops(
            mass=np.exp(grid[1][inside]),
            damping=grid[2][inside],
            position_stiffness=grid[3][inside],
            delay_samples=grid[0][inside],
            most=self.most,
            step=self.step,
            stated=self.stated,
        )


def _mode(
    device: Device, filters: Filters, effects: Effects, knots: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """(frequency, Hz; decay, 1/s) at delays, logarithms of mass, dampings and own stiffnesses."""
    delays, *rigid = knots
    T, used = device.sample_time.value, used_filters(filters, effects)
    masses, damping, slope = (part.ravel() for part in np.meshgrid(*rigid, indexing="ij"))
    mass = np.exp(masses)
    poles = np.stack(
        [
            slow_poles(loops_over(device, mass, damping, slope, delay, used), effects, T)
            for delay in delays.tolist()
        ]
    ).reshape(tuple(each.size for each in knots))
    return damped_hertz(poles), -poles.real


def _interpolated(
    knots: tuple[FloatArray, ...], values: FloatArray, places: tuple[FloatArray, ...]
) -> FloatArray:
    """Values at all combinations of places, between the knots linear in each direction."""
    for axis, (known, wanted) in enumerate(zip(knots, places, strict=True)):
        along = np.tensordot(_weights(known, wanted), values, axes=(1, axis))
        values = np.moveaxis(along, 0, axis)
    return values


def _weights(knots: FloatArray, places: FloatArray) -> FloatArray:
    """What each knot has in the value at each place, shape (places, knots); one knot has all."""
    if knots.size == 1:
        return np.ones((places.size, 1))
    first = np.clip(np.searchsorted(knots, places) - 1, 0, knots.size - 2)
    part = (places - knots[first]) / (knots[first + 1] - knots[first])
    weights, rows = np.zeros((places.size, knots.size)), np.arange(places.size)
    weights[rows, first], weights[rows, first + 1] = 1 - part, part
    return weights


def _places(ends: Range | FloatArray, count: int) -> FloatArray:
    """Places from end to end; one where the ends are the same."""
    low, high = float(ends[0]), float(ends[1])
    return np.array([low]) if low == high else np.linspace(low, high, count)


def _reach(values: FloatArray) -> FloatArray:
    """How far values change halfway to the next place in the box, so that none slips between."""
    reach = np.zeros_like(values)
    for axis in (1, 2, 3):
        if values.shape[axis] > 1:
            reach += np.abs(np.gradient(values, axis=axis)) / 2
    return reach
