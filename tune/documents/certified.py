"""What a certificate says, as part of a profile: region, worst point, proof, assumptions."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from identification import Document

#: Taps of a multiplier; tuning tries no more than twenty, and a proof takes time for each.
_MOST_TAPS = 32


class ModePlace(Document):
    """One vibration mode at one point: Hz, damping ratio."""

    frequency_hz: float
    damping_ratio: float


class HandPlace(Document):
    """One grip at one point: kg, N·s/m, N/m."""

    mass: float
    damping: float
    stiffness: float


class WorstPoint(Document):
    """The point at which the slowest pole was found, at the full gain of the margin.

    Attributes:
        elements: felt together.
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay_samples: the whole delay, with the extra; need not be whole.
        modes: in the order of the device's.
        current_lag: s; None for none.
        position_stiffness: slope of the device's own force by position, N/m; None for none.
        hand: None for the device alone.
        gain: of all effects.
        pole_radius: largest modulus of a pole.
    """

    elements: tuple[str, ...]
    mass: float
    damping: float
    sample_time: float
    delay_samples: float
    modes: tuple[ModePlace, ...] = ()
    current_lag: float | None = None
    position_stiffness: float | None = None
    hand: HandPlace | None = None
    gain: float
    pole_radius: float


class ModeBox(Document):
    """Intervals of one vibration mode: Hz, damping ratio."""

    frequency_hz: tuple[float, float]
    damping_ratio: tuple[float, float]


class HandBox(Document):
    """Intervals of the grip: kg, N·s/m, N/m."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    stiffness: tuple[float, float]


class Tap(Document):
    """weight·(1 - z^-samples) in a multiplier."""

    samples: int = Field(ge=1)
    weight: float = Field(gt=0)


class Channel(Document):
    """The multiplier of one nonlinearity: M(z) = constant + Σ weight·(1 - z^-samples).

    Attributes:
        name: of the element whose clamp it is, or ``damping`` for what is damping only and is
            switched at any moment, all of it together.
        constant: of a clamp zero where nothing holds the position of the device, above zero where
            it is held; of damping all there is.
        taps: in rising order of samples.
    """

    name: str
    constant: float = Field(default=0.0, ge=0)
    taps: tuple[Tap, ...] = Field(default=(), max_length=_MOST_TAPS)


class Multiplier(Document):
    """Causal multipliers of Zames and Falb, one for each nonlinearity of a sum of elements.

    Attributes:
        channels: of the elements with springs, in their order, then of ``damping``, if any.
    """

    channels: tuple[Channel, ...]


class AbsoluteStability(Document):
    """What one moment is proved for beside its linear loop: clamped, switched, faded.

    Attributes:
        gain: every gain in (0, gain].
        extra_delay_samples: on top of the device's delay, any part of it.
        free: the multiplier for devices whose position nothing holds; None where there are none.
        held: the multiplier for devices held by a spring of their own, of friction or of a hand.
        covers: in words.
    """

    gain: float
    extra_delay_samples: float
    free: Multiplier | None = None
    held: Multiplier | None = None
    covers: tuple[str, ...]


class Certificate(Document):
    """What was re-checked, how, over which region, and what it takes for granted.

    Attributes:
        method: in words.
        confidence: of the box of mass and damping.
        mass: kg, and so on: the region, every combination of which is proved stable.
        delay: of the device, s.
        delay_samples: the same in samples, over the interval of the sample time.
        modes: in the order of the device's.
        current_lag: time constant of the actuator, s; None for none.
        position_stiffness: slope of the device's own force by position, N/m; None for none.
        presliding_stiffness: that slope where friction holds the device, before it slides, N/m;
            proved beside the device that slides. None for none.
        hand: None for the device alone; with a hand the device alone is proved beside it.
        gain: every gain in (0, gain].
        extra_delay_samples: on top of the device's delay, any part of it.
        points: judged one by one in many digits.
        cells: excluded one by one, of which the proof is made.
        interior: by moment; nothing but "proved" is ever written.
        absolute_stability: by moment, for those with a clamp that may be reached; None for none.
        worst: found by search over all moments.
        assumes: what the proof takes for granted.
        not_assessed: what it leaves out.
        versions: of what computed it.
    """

    method: str
    confidence: float
    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]
    delay: tuple[float, float]
    delay_samples: tuple[float, float]
    modes: tuple[ModeBox, ...] = ()
    current_lag: tuple[float, float] | None = None
    position_stiffness: tuple[float, float] | None = None
    presliding_stiffness: tuple[float, float] | None = None
    hand: HandBox | None = None
    gain: float
    extra_delay_samples: float
    points: int
    cells: int
    interior: dict[str, Literal["proved"]]
    absolute_stability: dict[str, AbsoluteStability] | None = None
    worst: WorstPoint
    assumes: tuple[str, ...]
    not_assessed: tuple[str, ...]
    versions: dict[str, str]

    @property
    def longest_tap(self) -> int:
        """Samples of the longest tap of any multiplier, 1 at least.

        So long a clamp has to be without force before its gain may rise.
        """
        return max(
            (
                tap.samples
                for proved in (self.absolute_stability or {}).values()
                for multiplier in (proved.free, proved.held)
                if multiplier is not None
                for channel in multiplier.channels
                for tap in channel.taps
            ),
            default=1,
        )
