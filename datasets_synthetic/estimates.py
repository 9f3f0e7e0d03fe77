"""Velocity and acceleration as a controller estimates them from its readings."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Estimates(Protocol):
    """Filters at work: one call a sample; every array shape (batch,)."""

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        ...


class FirstOrderEstimates:
    """Velocity through one pole, acceleration through two equal ones, as difference equations."""

    __slots__ = (
        "_acceleration",
        "_acceleration_pole",
        "_last",
        "_sample_time",
        "_slope",
        "_velocity",
        "_velocity_pole",
    )

    def __init__(
        self,
        velocity_pole: FloatArray,
        acceleration_pole: FloatArray | None,
        sample_time: FloatArray,
    ) -> None:
        """Without a pole of acceleration that is not estimated and said to be zero."""
        self._velocity_pole = velocity_pole, 1 - velocity_pole
        self._acceleration_pole = (
            None if acceleration_pole is None else (acceleration_pole, 1 - acceleration_pole)
        )
        self._sample_time = sample_time
        self._last: FloatArray | None = None
        self._velocity = self._slope = self._acceleration = np.zeros_like(sample_time)

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        last = reading if self._last is None else self._last
        change = (reading - last) / self._sample_time
        self._last = reading
        pole, rest = self._velocity_pole
        self._velocity = pole * self._velocity + rest * change
        if self._acceleration_pole is not None:
            pole, rest = self._acceleration_pole
            slope = pole * self._slope + rest * change
            change_of_slope = (slope - self._slope) / self._sample_time
            self._acceleration = pole * self._acceleration + rest * change_of_slope
            self._slope = slope
        return self._velocity, self._acceleration


class SectionEstimates:
    """Second-order sections of the differences, or a moving window; members may differ in kind.

    A section is x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]; p = 0 makes it one of first order.
    """

    __slots__ = (
        "_acceleration",
        "_change",
        "_last",
        "_past",
        "_row",
        "_sample_time",
        "_sections",
        "_velocity",
        "_window",
    )

    def __init__(
        self,
        velocity: tuple[FloatArray, FloatArray],
        acceleration: tuple[FloatArray, FloatArray],
        window: NDArray[np.int64],
        sample_time: FloatArray,
    ) -> None:
        """Sections (t, p) of both; window in samples, each shape (batch,)."""
        self._sections = (velocity, acceleration)
        self._window = window
        self._sample_time = sample_time
        self._last: FloatArray | None = None
        self._past = np.zeros((int(np.max(window)), sample_time.size))
        self._row = 0
        still = np.zeros_like(sample_time)
        self._change = still
        self._velocity, self._acceleration = (still, still), (still, still)

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        if self._last is None:
            self._past[:] = reading
        last = reading if self._last is None else self._last
        change = (reading - last) / self._sample_time
        self._last = reading
        velocity, acceleration = self._sections
        self._velocity = _section(velocity, self._velocity, self._mean_slope(reading))
        self._acceleration = _section(
            acceleration, self._acceleration, (change - self._change) / self._sample_time
        )
        self._change = change
        return self._velocity[0], self._acceleration[0]

    def _mean_slope(self, reading: FloatArray) -> FloatArray:
        """(reading - reading n samples ago)/(n·T)."""
        rows = self._past.shape[0]
        before = self._past[(self._row - self._window) % rows, np.arange(reading.size)]
        self._past[self._row] = reading
        self._row = (self._row + 1) % rows
        return (reading - before) / (self._window * self._sample_time)


def first_order_pole(cutoff: FloatArray | float, sample_time: FloatArray) -> FloatArray:
    """a = exp(-2π·fc·T) of a cut-off in Hz; 0 where it is infinite.

    Cut-off and sample time (s) broadcast; the answer has their shape and no unit.
    """
    return np.exp(-2 * np.pi * cutoff * sample_time)


def section(
    cutoff: FloatArray | float,
    order: NDArray[np.int64] | int,
    ratio: FloatArray | float,
    sample_time: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(t, p) of a filter with one pole, or with the pair of poles of this damping ratio.

    The pair is exp(-2π·fc·T·(ζ ± j·√(1-ζ²))), the matched poles of a second-order low-pass.
    """
    turn = np.where(np.isinf(cutoff), 0.0, 2 * np.pi * cutoff * sample_time)
    open_ = np.isinf(cutoff) & np.ones(sample_time.shape, dtype=bool)
    size = np.exp(-ratio * turn)
    pair = 2 * size * np.cos(np.sqrt(1 - np.square(ratio)) * turn)
    single = np.equal(order, 1)
    t = np.where(single, np.exp(-turn), pair)
    p = np.where(single, 0.0, size**2)
    return np.where(open_, 0.0, t), np.where(open_, 0.0, p)


def _section(
    poles: tuple[FloatArray, FloatArray], past: tuple[FloatArray, FloatArray], value: FloatArray
) -> tuple[FloatArray, FloatArray]:
    t, p = poles
    return t * past[0] - p * past[1] + (1 - t + p) * value, past[0]
