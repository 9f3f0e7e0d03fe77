"""What a profile predicts of free motion: the slowest mode of the loop, over the device's box."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from identification import Device, quantity
from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile
from tune.loop.filters import filters_of
from tune.loop.loop import Loop

#: Imaginary parts below this part of the modulus are rounding: the pole is real.
_REAL = 1e-9
#: A pole so near to w = -1, z = 0, is over within a sample: what a delay or a difference leaves.
_GONE = 1e-6
#: A mode that decays this many times faster than the slowest is over before anything is measured.
_MUCH_FASTER = 4.0
#: Part of the release a second mode of like decay may carry before the motion is no single mode.
_SECOND_MODE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Slowest:
    """The mode in which a loop comes to rest.

    Attributes:
        frequency: damped, Hz; 0 where it does not oscillate.
        decay: of its envelope exp(-decay·t), 1/s.
        natural: modulus of the pole, rad/s.
        next_decay: of the slowest among the other modes, 1/s; infinite where there is none.
        nearness: of the slow mode to the other modes: its modulus over the least of theirs.
        others: part of the response to a release that modes of like decay carry, relative.
    """

    frequency: float
    decay: float
    natural: float
    next_decay: float
    nearness: float
    others: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Slowest mode at the best estimate, and its range over the corners of the device's box.

    Attributes:
        nominal: at the best estimate.
        frequency: (low, high), Hz.
        decay: (low, high), 1/s.
        single: whether one mode, or two real poles, describes the motion at every corner.
    """

    nominal: Slowest
    frequency: tuple[float, float]
    decay: tuple[float, float]
    single: bool


def predict(device: Device, loop: LoopProfile, effects: Effects) -> Prediction:
    """The free motion of a device, no hand on it, under effects at the gain they are played.

    Args:
        device: with its intervals.
        loop: the filters that are run.
        effects: single numbers.
    """
    box = device.simultaneous_box()
    nominal = slowest(device, loop, effects)
    corners = [
        slowest(
            device.model_copy(
                update={
                    "mass": quantity(mass),
                    "damping": quantity(damping),
                    "sample_time": quantity(step),
                    "delay": quantity(delay),
                    "position_stiffness": quantity(slope),
                }
            ),
            loop,
            effects,
        )
        for mass, damping, step, delay, slope in product(
            *(
                sorted(set(side))
                for side in (
                    box.mass,
                    box.damping,
                    box.sample_time,
                    box.delay,
                    box.position_stiffness,
                )
            )
        )
    ]
    every = [nominal, *corners]
    return Prediction(
        nominal=nominal,
        frequency=(min(m.frequency for m in every), max(m.frequency for m in every)),
        decay=(min(m.decay for m in every), max(m.decay for m in every)),
        single=max(mode.others for mode in every) <= _SECOND_MODE,
    )


def binding_stiffness(device: Device, effects: Effects) -> float:
    """K and the slope of the device's own force together, N/m; 0 where the position is free."""
    own = device.slope_at_zero
    return own if effects.stiffness is None else own + float(np.asarray(effects.stiffness))


def slowest(
    device: Device, loop: LoopProfile, effects: Effects, *, extra_delay_samples: int = 0
) -> Slowest:
    """The slowest mode of the loop at the best estimate of a device."""
    built = Loop.from_parts(device, filters_of(loop), extra_delay_samples=extra_delay_samples)
    closed, _ = built.polynomial(effects)
    free = built.has_free_pole(effects)
    w = np.asarray(np.roots(closed[built.lowest_power(effects) :][::-1]))
    w = w[np.abs(1 + w) > _GONE].astype(np.complex128)
    poles = 2 / device.sample_time.value * np.arctanh(w)
    order = np.argsort(np.abs(poles))
    w, poles = w[order], poles[order]
    first = poles[0]
    oscillates = abs(first.imag) > _REAL * abs(first)
    if free:
        # Without a spring one real pole is the decay of speed; anything else is no single mode.
        weights = np.ones(poles.size)
    else:
        spring = np.polynomial.polynomial.polyval(w, built.terms.alpha)
        slope = np.polynomial.polynomial.polyval(w, np.polynomial.polynomial.polyder(closed))
        # Residues, but for one factor, of the response to letting go of what springs hold.
        weights = np.abs(spring / (slope * w * (1 - w)))
    pair = len(poles) > 1 and not free and poles[1].imag == 0
    own = 2 if oscillates or pair else 1
    other_decays = -poles.real[own:]
    alike = other_decays < _MUCH_FASTER * -first.real
    return Slowest(
        frequency=float(abs(first.imag)) / (2 * np.pi) if oscillates else 0.0,
        decay=-float(first.real),
        natural=float(abs(first)),
        next_decay=float(np.min(other_decays, initial=np.inf)),
        nearness=float(np.max(abs(first) / np.abs(poles[own:]), initial=0.0)),
        others=float(np.sum(weights[own:][alike]) / np.sum(weights[:own])),
    )
