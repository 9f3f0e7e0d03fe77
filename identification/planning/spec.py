"""What a calibration may do and what is guessed of the device (excitation.yaml)."""

from __future__ import annotations

from itertools import product
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from identification.device.device import LIGHTEST
from identification.device.hardware import SHORTEST_STEP
from identification.device.quantities import (
    LARGEST,
    AnyQuantity,
    PositiveQuantity,
    Quantity,
    quantity,
)
from identification.documents import Document
from identification.trajectory import SHORTEST, Motion

#: Rows of the longest force planned: three minutes at 1 kHz. A simulation steps through all of
#: them for every corner of the guesses.
MOST_SAMPLES = 200_000
#: At least this many ramps make up a signal; the rest must still have time to excite.
FEWEST_RAMPS = 4
#: No limit is wider than friction by less than this factor: below it the device creeps and sticks.
ABOVE_FRICTION = 1.5


class ExcitationSpec(Document):
    """Limits, guesses and noise (excitation.yaml); SI units of the motion.

    A guess is a number or {value, low, high}: the force is designed for the value and stays within
    the limits for every device in between.

    Attributes:
        name: of the device.
        axis: name of the axis.
        motion: "linear" or "rotary".
        sample_time: T, s; each force is held that long.
        duration: s, ramps included.
        ramp: s, over which the force fades in, and out again.
        force: largest |force| to be played, N (N·m).
        travel: largest distance from the start, either way, m (rad).
        speed: largest speed, m/s (rad/s), or none.
        mass: guess, kg (kg·m²).
        damping: guess, N·s/m (N·m·s/rad), not negative.
        coulomb_friction: guess, N (N·m).
        force_offset: guess of the constant force that is left when all compensation works, N (N·m).
        encoder_resolution: one count, m (rad).
        position_noise: rms of what is added to the position before it is counted, m (rad).
        force_noise: rms of a white force on the device that no log knows, held one sample, N (N·m).
        delay: "known", or "unknown" if it will be estimated from the same log.
        gentle: plan a short and weak first play that is safe if the guesses are two times wrong
            and a constant force of 2 % of the limit acts that nobody planned for.
        device: file of the device as identified from a gentle play, or a named device; its mass,
            damping, friction and offset stand in for the guesses.
    """

    schema_: Literal["haptune/excitation/1"] = Field(default="haptune/excitation/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    motion: Motion = "linear"
    sample_time: float = Field(ge=SHORTEST_STEP, le=LARGEST)
    duration: float = Field(gt=0, le=LARGEST)
    ramp: float = Field(default=0.5, ge=0, le=LARGEST)
    force: float = Field(gt=0, le=LARGEST)
    travel: float = Field(gt=0, le=LARGEST)
    speed: float | None = Field(default=None, gt=0, le=LARGEST)
    mass: PositiveQuantity
    damping: AnyQuantity
    coulomb_friction: AnyQuantity = quantity(0.0)
    force_offset: AnyQuantity = quantity(0.0)
    encoder_resolution: float = Field(gt=0, le=LARGEST)
    position_noise: float = Field(default=0.0, ge=0, le=LARGEST)
    force_noise: float = Field(default=0.0, ge=0, le=LARGEST)
    delay: Literal["known", "unknown"] = "known"
    gentle: bool = False
    device: str | None = None

    @model_validator(mode="after")
    def _sane(self) -> ExcitationSpec:
        if self.gentle and self.device is not None:
            raise ValueError(
                f"gentle plans for a device that is guessed, {self.device} tells of one that is "
                "known; leave out gentle, or device"
            )
        if self.mass.low < LIGHTEST:
            raise ValueError(f"mass must be {LIGHTEST:g} or more, not {self.mass.low:g}")
        for name in ("damping", "coulomb_friction"):
            low = getattr(self, name).low
            if low < 0:
                raise ValueError(f"{name} must not be negative, not {low:g}")
        if not SHORTEST <= self.samples <= MOST_SAMPLES:
            raise ValueError(
                f"{self.duration:g} s at {self.sample_time:g} s a sample are {self.samples} "
                f"samples; {SHORTEST} to {MOST_SAMPLES} can be planned"
            )
        if self.duration < FEWEST_RAMPS * self.ramp:
            raise ValueError(
                f"a duration of {self.duration:g} s leaves too little between two ramps of "
                f"{self.ramp:g} s; give {FEWEST_RAMPS * self.ramp:g} s or more"
            )
        against = self.coulomb_friction.high + max(
            abs(self.force_offset.low), abs(self.force_offset.high)
        )
        if self.force < ABOVE_FRICTION * against:
            raise ValueError(
                f"a force of {self.force:g} against friction and offset of up to {against:g} "
                f"hardly moves the device; allow {ABOVE_FRICTION * against:g} or more"
            )
        return self

    @property
    def samples(self) -> int:
        """Samples over which the force is held."""
        return round(self.duration / self.sample_time)

    @property
    def reading_noise(self) -> float:
        """Standard deviation of one position in the log, m (rad): noise and rounding to a count."""
        return float(np.hypot(self.position_noise, self.encoder_resolution / np.sqrt(12)))

    @property
    def ranges(self) -> bool:
        """Whether any guess is more than a number."""
        guesses = (self.mass, self.damping, self.coulomb_friction, self.force_offset)
        return not all(guess.exact for guess in guesses)

    def corners(self) -> tuple[tuple[float, float, float, float], ...]:
        """(mass, damping, friction, offset) of the guess, then of every corner of its ranges."""
        guesses = (self.mass, self.damping, self.coulomb_friction, self.force_offset)
        middle = tuple(guess.value for guess in guesses)
        ends = product(*(_ends(guess) for guess in guesses))
        return tuple(dict.fromkeys([middle, *ends]))  # pyright: ignore[reportReturnType]


def _ends(guess: Quantity) -> tuple[float, ...]:
    return (guess.low,) if guess.exact else (guess.low, guess.high)
