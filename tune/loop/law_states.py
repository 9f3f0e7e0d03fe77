"""State space of the control law: readings in, force out, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.loop.filters import Filters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LawStates:
    """s[k+1] = update·s + drive·y, force = command·s + direct·y; y is the reading, m.

    Attributes:
        update: shape (states, states).
        drive: shape (states,).
        command: shape (states,).
        direct: N/m.
    """

    update: FloatArray
    drive: FloatArray
    command: FloatArray
    direct: float


def law_states(filters: Filters, T: float, K: float, B: float, M: float) -> LawStates:
    """The law as one filter of the reading, as few states as its order (transposed direct form)."""
    velocity, acceleration = (np.array([1.0]), np.array([1.0])), (np.array([1.0]), np.array([1.0]))
    if B:
        window = filters.velocity_window_samples or 1
        slope = np.zeros(window + 1)
        slope[0], slope[-1] = 1 / (window * T), -1 / (window * T)
        order = filters.velocity_filter_order
        velocity = _smoothed(slope, filters.velocity_filter_hz, order, filters, T)
    if M:
        twice = np.array([1.0, -2.0, 1.0]) / T**2
        order = filters.acceleration_filter_order
        acceleration = _smoothed(twice, filters.acceleration_filter_hz, order, filters, T)
    below = np.convolve(velocity[1], acceleration[1])
    above = [
        K * below,
        B * np.convolve(velocity[0], acceleration[1]),
        M * np.convolve(acceleration[0], velocity[1]),
    ]
    size = max(len(part) for part in (below, *above))
    top = np.zeros(size)
    for part in above:
        top[: len(part)] -= part
    bottom = np.pad(below, (0, size - len(below)))
    update = np.eye(size - 1, k=1)
    if size > 1:
        update[:, 0] -= bottom[1:]
    return LawStates(
        update=update,
        drive=top[1:] - bottom[1:] * top[0],
        command=np.eye(1, size - 1)[0],
        direct=float(top[0]),
    )


def _smoothed(
    difference: FloatArray, cutoff: float | None, order: int, filters: Filters, T: float
) -> tuple[FloatArray, FloatArray]:
    """(numerator, denominator) in 1/z of a difference behind its low-pass."""
    if cutoff is None:
        return difference, np.array([1.0])
    t, p = _section(cutoff, order, filters.filter_damping_ratio, T)
    return difference * (1 - t + p), np.array([1.0, -t, p][: order + 1])


def _section(cutoff: float, order: int, ratio: float, T: float) -> tuple[float, float]:
    """(t, p) of x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]."""
    angle = 2 * np.pi * cutoff * T
    if order == 1:
        return float(np.exp(-angle)), 0.0
    left = np.exp(-ratio * angle)
    return float(2 * left * np.cos(np.sqrt((1 - ratio) * (1 + ratio)) * angle)), float(left**2)
