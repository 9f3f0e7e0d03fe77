"""Devices as a controller meets them: sampled, held and late, before it has any filters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tune.errors import LoopError
from tune.held_plant import HeldPlant, general, ideal, split_delay
from tune.mechanism import HandNumbers, ModeNumbers, grip_of, vibration_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """Position from force of devices, which any filters may be put around.

    Attributes:
        plant: in w, over T²/m.
        delta: δ = bT/m, of the shape of all that was given, as the two below.
        mass: kg.
        sample_time: s.
        held: a spring of the hand holds the position.
    """

    plant: HeldPlant
    delta: FloatArray
    mass: FloatArray
    sample_time: FloatArray
    held: bool

    @classmethod
    def from_numbers(
        cls,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        sample_time: ArrayLike,
        delay_samples: ArrayLike = 0.0,
        modes: Sequence[ModeNumbers] = (),
        hand: HandNumbers | None = None,
        current_lag: ArrayLike = 0.0,
    ) -> SampledPlant:
        """For numbers or arrays, broadcast; as `Loop.from_numbers`, which says more.

        Raises:
            LoopError: a mass, sample time, delay, mode, hand or lag that cannot be.
        """
        given = [mass, damping, sample_time, delay_samples, current_lag]
        given += [number for mode in modes for number in mode.numbers()]
        given += () if hand is None else hand.numbers()
        m, b, T, delay, lag, *rest = np.broadcast_arrays(*(np.asarray(x, float) for x in given))
        if not (np.all(m > 0) and np.all(T > 0)):
            raise LoopError(f"mass and sample time must be positive, not {m.min():g}, {T.min():g}")
        samples, fraction = split_delay(delay)
        if not np.all(lag >= 0):
            raise LoopError(f"current_lag must not be negative, not {lag.min():g} s")
        vibrations = [vibration_of(rest[4 * k : 4 * k + 4], T) for k in range(len(modes))]
        grip = None if hand is None else grip_of(rest[-3:], m, T)
        delta = b * T / m
        if fraction is None and not vibrations and grip is None and not np.any(lag):
            plant = ideal(delta, samples)
        else:
            plant = general(
                delta,
                samples,
                fraction,
                modes=vibrations,
                grip=grip,
                lag=lag / T if np.any(lag) else None,
            )
        return cls(
            plant=plant,
            delta=delta,
            mass=m,
            sample_time=T,
            held=grip is not None and bool(np.any(grip.stiffness > 0)),
        )
