"""Limit cycles by describing functions: quantiser and friction of a device at a wall.

Describing functions (Gelb and Vander Velde 1968; for haptics Diolaiti, Niemeyer, Barbagli and
Salisbury 2006): a swing of amplitude A at the encoder and of angular frequency ω sees the quantiser
as a gain N(A) and Coulomb friction c as a damping 4c/(πωA). With the law C, the delay d and the
hold H it sustains itself where

    m(jω)² + (b + 4c/(πωA))·jω + k + N(A)·C(exp(jωT))·H(jω)·exp(-jωd)/(1 + jωτ) = 0.

It is stable where a larger swing loses energy and a smaller one gains. Where a hand pushes decides
where in a count the swing is centred: in the middle the quantiser hides the smallest swings, on an
edge it makes them large. Both are looked at.

Only the first harmonic is seen so. Within a count the force is rather a square wave and the speed a
triangle, which loses 2/3 as much to b and π/4 as much to c as a sine of its height: amplitude and
frequency are told as the range between both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.loop.filters import Filters
from tune.rendering.rendered import impedances

FloatArray = NDArray[np.float64]

Centre = Literal["middle", "edge"]

#: Amplitudes looked at, in counts. Below, the linear loop at rest decides; above, the quantiser is
#: a gain of one to a part in a thousand.
_AMPLITUDES = np.geomspace(0.001, 30.0, 1200)
#: What a triangle of speed loses to viscous and to Coulomb friction, in parts of a sine's loss.
_TRIANGLE_VISCOUS, _TRIANGLE_COULOMB = 2 / 3, np.pi / 4
#: Frequencies looked at, in parts of the Nyquist frequency.
_FREQUENCIES = np.geomspace(1e-4, 0.999, 1500)


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitCycle:
    """A swing that sustains itself.

    Attributes:
        amplitude: (least, largest), from the middle to a peak, m (rad); least 0 where only the
            square wave sustains it.
        frequency_hz: (least, largest), Hz.
    """

    amplitude: tuple[float, float]
    frequency_hz: tuple[float, float]


def limit_cycle(
    device: Device,
    effects: Effects,
    filters: Filters | None = None,
    *,
    extra_delay_samples: float = 0.0,
) -> LimitCycle | None:
    """The largest swing that quantiser, friction and delay sustain, None where there is none.

    Args:
        device: rigid, at its best estimate but for its least Coulomb friction.
        effects: single values of a loop that is stable without quantiser and friction.
        filters: of velocity and acceleration.
        extra_delay_samples: on top of the device's delay.
    """
    resolution = device.encoder_resolution
    if resolution is None or device.modes:
        return None
    time = device.sample_time.value
    omega = np.pi / time * _FREQUENCIES
    felt = impedances(
        filters or Filters(),
        omega / (2 * np.pi),
        sample_time=time,
        delay=device.delay.value + extra_delay_samples * time,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
    )
    K, B, M = (0.0 if value is None else float(value) for value in effects.arrays())
    # Force over position of the law as the device meets it.
    law = (K * felt.stiffness + B * felt.damping + M * felt.mass) * (1j * omega)
    sines: list[_Swing] = []
    squares: list[_Swing] = []
    for centre in ("middle", "edge"):
        swings = _swings(device, law, omega, centre)
        sines += swings.sustained(1.0, 1.0)
        squares += swings.sustained(_TRIANGLE_VISCOUS, _TRIANGLE_COULOMB, most=1.0)
    every = [max(each, key=lambda swing: swing.counts) for each in (sines, squares) if each]
    if not every:
        return None
    least, largest = min(each.counts for each in every), max(each.counts for each in every)
    return LimitCycle(
        amplitude=(resolution.value * (least if sines else 0.0), resolution.value * largest),
        frequency_hz=(min(each.hertz for each in every), max(each.hertz for each in every)),
    )


def quantiser_gain(amplitude: FloatArray, centre: Centre) -> FloatArray:
    """Describing function of rounding to whole counts, for amplitudes in counts.

    Args:
        amplitude: of a sine, counts, shape (n,).
        centre: the middle of a count, or the edge between two.
    """
    most = int(np.ceil(amplitude.max())) + 1
    steps = np.arange(most) + 0.5 if centre == "middle" else np.arange(float(most))
    inside = np.sqrt(np.maximum(0.0, 1 - (steps / amplitude[:, None]) ** 2))
    # The step in the middle is one, all others come in pairs.
    weights = np.where(steps == 0, 0.5, 1.0)
    return 4 / (np.pi * amplitude) * (inside @ weights)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Swing:
    """A swing of an amplitude in counts and of a frequency in Hz."""

    counts: float
    hertz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Swings:
    """Power over speed squared of swings of each amplitude, N·s/m; turn is their ω, rad/s.

    Attributes:
        turn: nan where no frequency fits.
        fed: by the law.
        viscous: lost to b.
        coulomb: lost to c.
    """

    turn: FloatArray
    fed: FloatArray
    viscous: float
    coulomb: FloatArray

    def sustained(self, viscous: float, coulomb: float, most: float = np.inf) -> list[_Swing]:
        """Where a swing gains below and loses above, or gains up to ``most`` counts.

        Args:
            viscous: part of the loss to b that a sine has.
            coulomb: likewise to c.
            most: counts.
        """
        counts = _AMPLITUDES[: np.searchsorted(_AMPLITUDES, most, side="right")]
        gained = self.fed - viscous * self.viscous - coulomb * self.coulomb
        gains = (gained > 0)[: len(counts)]
        ends = np.flatnonzero(gains & ~np.append(gains[1:], len(counts) == len(_AMPLITUDES)))
        return [
            _Swing(counts=float(counts[end]), hertz=float(self.turn[end] / (2 * np.pi)))
            for end in ends
        ]


def _swings(
    device: Device, law: NDArray[np.complex128], omega: FloatArray, centre: Centre
) -> _Swings:
    """The swings of each amplitude, at the frequency where inertia meets the law's spring."""
    assert device.encoder_resolution is not None
    gain = quantiser_gain(_AMPLITUDES, centre)
    inertia = device.mass.value * omega**2 - device.slope_at_zero
    excess = inertia - gain[:, None] * law.real
    rising = (excess[:, :-1] < 0) & (excess[:, 1:] >= 0)
    at, row = rising.argmax(axis=1), np.arange(len(gain))
    part = excess[row, at] / (excess[row, at] - excess[row, at + 1])
    turn = omega[at] + part * (omega[at + 1] - omega[at])
    turn = np.where(rising.any(axis=1), turn, np.nan)
    loss = law.imag[at] + part * (law.imag[at + 1] - law.imag[at])
    speed = turn * _AMPLITUDES * device.encoder_resolution.value
    return _Swings(
        turn=turn,
        fed=-gain * loss / turn,
        viscous=device.damping.value,
        coulomb=4 * device.coulomb_friction.low / (np.pi * speed),
    )
