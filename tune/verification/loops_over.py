"""Loops of many devices at once, and the slow mode of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.documents.scene import Hand
from tune.loop.companion import companion_roots
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.loop.mechanism import HandNumbers, ModeNumbers

FloatArray = NDArray[np.float64]

#: A pole nearer than this to w = -1, z = 0, is over within a sample: a delay leaves it.
_GONE = 1e-6
#: Imaginary parts below this part of the modulus are rounding: the pole is real.
_REAL = 1e-6


def loops_over(
    device: Device,
    mass: FloatArray,
    damping: FloatArray,
    position_stiffness: FloatArray,
    delay_samples: float,
    filters: Filters,
    hand: HandNumbers | None = None,
) -> Loop:
    """Loops of a device whose rigid numbers vary; its modes and current lag at their best.

    Args:
        device: sample time, modes and current lag are read.
        mass: kg, shape (n,).
        damping: N·s/m, shape (n,).
        position_stiffness: slope of its own force by position, N/m, shape (n,).
        delay_samples: from command to measurement, one number.
        filters: of velocity and acceleration.
        hand: at the handle; None is the device alone.

    Raises:
        LoopError: a delay that is too long.
    """
    return Loop.from_numbers(
        mass=mass,
        damping=damping,
        sample_time=device.sample_time.value,
        delay_samples=delay_samples,
        filters=filters,
        modes=tuple(ModeNumbers.of(mode) for mode in device.modes),
        hand=hand,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        position_stiffness=position_stiffness,
    )


def hands_of(hand: Hand | None) -> tuple[HandNumbers | None, ...]:
    """No hand, and every corner of a box of hands."""
    if hand is None:
        return (None,)
    corners = {
        (mass, damping, stiffness): HandNumbers(mass=mass, damping=damping, stiffness=stiffness)
        for mass in (hand.mass.low, hand.mass.high)
        for damping in (hand.damping.low, hand.damping.high)
        for stiffness in (hand.stiffness.low, hand.stiffness.high)
    }
    return (None, *corners.values())


def slow_poles(loop: Loop, effects: Effects, sample_time: float) -> NDArray[np.complex128]:
    """The pole of least modulus of each loop, 1/s, shape (n,); free motion does not count.

    Args:
        loop: of shape (n,).
        effects: single numbers.
        sample_time: s.
    """
    closed, _ = loop.polynomial(effects)
    closed = closed[loop.lowest_power(effects) :]
    w = companion_roots(closed[:-1] / closed[-1])
    poles = np.full(w.shape, np.inf, dtype=np.complex128)
    alive = np.abs(1 + w) > _GONE
    poles[alive] = 2 / sample_time * np.arctanh(w[alive])
    return poles[np.argmin(np.abs(poles), axis=0), np.arange(w.shape[1])]


def damped_hertz(poles: NDArray[np.complex128]) -> FloatArray:
    """Frequency of modes that oscillate, Hz; 0 where a pole is real.

    Poles are in rad/s and of any shape, and the answer has it too.
    """
    swings = np.abs(poles.imag) > _REAL * np.abs(poles)
    return np.where(swings, np.abs(poles.imag), 0.0) / (2 * np.pi)
