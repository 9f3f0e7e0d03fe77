"""Passivity, the second verdict: Colgate and Schenkel's condition for any law of the computer.

J. E. Colgate and G. G. Schenkel, "Passivity of a class of sampled-data systems: application to
haptic interfaces", Journal of Robotic Systems 14(1), 1997: a rigid device of damping b under a
zero-order hold is passive, and so stable in every passive hand, exactly when for all ω

    b > (T/2)·Re{(1 - exp(-jωT))·C(exp(jωT))} / (1 - cos ωT).

With w = jv, v = tan(ωT/2), the right-hand side is (T/2)·(Re C - Im C/v), a quotient of polynomials
in v². Common devices run stably in violation of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.loop.sampled_plant import WHOLE
from tune.stability.peaks import parts_on_axis, peak, squared_modulus

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Passivity:
    """Whether a device with its effects is passive.

    Attributes:
        passive: the verdict at the device's best estimate; None where the condition does not apply.
        damping_needed: b must exceed it, N·s/m (N·m·s/rad); None where it does not apply.
        reason: why it does not apply; empty where it does.
    """

    passive: bool | None
    damping_needed: float | None
    reason: str = ""


def passivity(
    device: Device,
    effects: Effects,
    filters: Filters | None = None,
    *,
    extra_delay_samples: float = 0.0,
) -> Passivity:
    """Whether a device is passive at its best estimate, whatever passive hand holds it.

    Args:
        device: damping, sample time, delay and what it is made of are read.
        effects: single values.
        filters: of velocity and acceleration.
        extra_delay_samples: on top of the device's delay.
    """
    reason = _not_applicable(device)
    time = device.sample_time.value
    delay = device.delay.value / time + extra_delay_samples
    if not reason and abs(delay - round(delay)) > WHOLE * max(1.0, delay):
        reason = (
            f"the delay is {delay:.6g} samples; the condition is proved for whole samples only, "
            "which can be counted to the computer"
        )
    if reason:
        return Passivity(passive=None, damping_needed=None, reason=reason)
    K, B, M = (0.0 if gain is None else float(gain) for gain in effects.arrays())
    needed = damping_needed(K, B, M, time, filters, delay_samples=round(delay))
    return Passivity(passive=bool(device.damping.value > needed), damping_needed=needed)


def damping_needed(
    stiffness: float,
    damping: float,
    mass: float,
    sample_time: float,
    filters: Filters | None = None,
    *,
    delay_samples: int = 0,
) -> float:
    """Device damping b above which K, B and M are passive, N·s/m (N·m·s/rad).

    Without filters and delay it is KT/2 + max over c in [-1, 1] of [-Bc + (M/T)(2c² - c - 1)], for
    a spring and a damper KT/2 + |B|.

    Args:
        stiffness: K, N/m.
        damping: B, N·s/m.
        mass: M, kg.
        sample_time: T, s.
        filters: of velocity and acceleration.
        delay_samples: whole samples between reading the position and the force that answers it.
    """
    # The law does not know the device: any mass will do.
    loop = Loop.from_numbers(mass=1.0, damping=0.0, sample_time=sample_time, filters=filters)
    parts = loop.transfer
    gains = (stiffness, damping, mass)
    terms = (parts.alpha, parts.beta, parts.gamma)
    numerator = np.zeros(max(len(term) for term in terms))
    for gain, scale, term in zip(gains, loop.scales, terms, strict=True):
        numerator[: len(term)] += gain * float(scale) * term
    denominator = parts.law_denominator
    for _ in range(delay_samples):
        numerator = np.convolve(numerator, [1.0, -1.0])
        denominator = np.convolve(denominator, [1.0, 1.0])
    top, bottom = _real_minus_slope(numerator, denominator)
    rate = float(loop.scales[1])

    def needed(v: FloatArray) -> FloatArray:
        return np.polyval(top[::-1], v * v) / np.polyval(bottom[::-1], v * v)

    corners = np.abs(np.roots(denominator[::-1]))
    return peak(needed, top, bottom, corners)[0] / (2 * rate)


def _real_minus_slope(
    numerator: FloatArray, denominator: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(P, Q) in x = v² with P/Q = Re C - Im C/v for C = numerator/denominator in w = jv."""
    mirrored = denominator * (-1.0) ** np.arange(len(denominator))
    even, odd = parts_on_axis(np.convolve(numerator, mirrored))
    squared = squared_modulus(denominator)
    top, bottom = np.zeros((2, max(len(even), len(squared))))
    top[: len(even)] = even
    top[: len(odd)] -= odd
    bottom[: len(squared)] = squared
    return top, bottom


def _not_applicable(device: Device) -> str:
    if getattr(device, "modes", ()):
        return "the mechanism vibrates; the condition is proved for a rigid device"
    if getattr(device, "current_lag", None) is not None:
        return "the actuator lags behind its command; the condition is proved for a held force"
    return ""
