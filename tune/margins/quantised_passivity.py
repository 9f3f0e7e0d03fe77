"""Passivity with an encoder and with friction, of the wall that a device renders.

A quantised reading is the position and an error of at most half a count, |n| ≤ Δ/2. The force is
the law of the position, which sampling and delay make active, and the law of the error, at most
(Δ/2)·Σ|c_k| with c_k the law's answer to a unit pulse. If b exceeds what the first needs (Colgate
and Schenkel 1997) and Coulomb friction c is at least the second, no motion takes energy out:

    b > needed(C, T, delay),   c ≥ (Δ/2)·Σ|c_k|.

For a spring with whole samples d of delay these are K ≤ 2b/((1 + 2d)·T) and K ≤ 2c/Δ: without
delay Abbott and Okamura's K ≤ min(2b/T, 2c/Δ) ("Effects of position quantization and sampling rate
on virtual-wall passivity", IEEE Transactions on Robotics 21(5), 2005), there shown to be necessary
too; with delay in the form K·(T/2 + d·T) ≤ b it belongs to the conditions of Diolaiti, Niemeyer,
Barbagli and Salisbury ("Stability of haptic rendering", IEEE Transactions on Robotics 22(2), 2006).
A damper without a filter adds |B| to the first and B/T to the half count's K/2 of the second.

Assumed are a rigid device, a force held over each sample, and friction of at least c whenever the
device moves. It is passivity against any passive hand, not stability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification import Device
from tune.documents.effects import Effects
from tune.loop.filters import Filters
from tune.loop.law_states import law_pulses
from tune.margins.passivity import passivity


@dataclass(frozen=True, slots=True, kw_only=True)
class QuantisedPassivity:
    """Passivity of a device with its effects, its encoder and its friction.

    Attributes:
        passive: with the encoder; None where the condition does not apply.
        damping: b, the least of the box, N·s/m.
        damping_needed: that the clock asks for, N·s/m; None where the condition does not apply.
        friction: c, the least of its interval, N.
        friction_needed: that the encoder asks for, N.
        stiffest_spring: a spring alone that is passive with b, c, clock, delay and encoder, N/m;
            None where the condition does not apply.
    """

    passive: bool | None
    damping: float
    damping_needed: float | None
    friction: float
    friction_needed: float
    stiffest_spring: float | None


def quantised_passivity(
    device: Device, effects: Effects, filters: Filters | None = None
) -> QuantisedPassivity | None:
    """Whether friction keeps a device passive that is read through its encoder.

    Args:
        device: at its least damping and Coulomb friction; sample time, delay and what it is made
            of are read at their best estimate.
        effects: single values.
        filters: of velocity and acceleration.

    Returns:
        None without an encoder resolution.
    """
    if device.encoder_resolution is None:
        return None
    count, time = device.encoder_resolution.value, device.sample_time.value
    damping = device.simultaneous_box().damping[0]
    friction = max(0.0, device.coulomb_friction.low)
    linear = passivity(device, effects, filters)
    K, B, M = (0.0 if gain is None else float(gain) for gain in effects.arrays())
    needed = count / 2 * float(np.abs(law_pulses(filters or Filters(), time, (K, B, M))).sum())
    if linear.damping_needed is None:
        passive = stiffest = None
    else:
        passive = damping > linear.damping_needed and friction >= needed
        late = round(device.delay.value / time)
        stiffest = max(0.0, min(2 * damping / ((1 + 2 * late) * time), 2 * friction / count))
    return QuantisedPassivity(
        passive=passive,
        damping=damping,
        damping_needed=linear.damping_needed,
        friction=friction,
        friction_needed=needed,
        stiffest_spring=stiffest,
    )
