"""What the effects of an element ask for, what is felt of them, and how many steps a size is.

Written down anew from the documented meaning of device and scene.
"""

# pyright: standard

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from identification import Device
from tune.documents.scene import Element, Wish

FloatArray = NDArray[np.float64]

EFFECTS = ("stiffness", "damping", "mass")
#: (gain, extra samples) of the README.
MARGINS = {"conservative": (3.0, 2), "balanced": (2.0, 1), "firm": (1.5, 1)}
#: Counts of the paper's tables 2 and 3: right of equal pairs, right of different ones, their ratio.
COUNTS = ((27 / 60, 77 / 80, 2.0), (45 / 60, 77 / 80, 2.0), (31 / 60, 61 / 80, 4 / 3))
#: Motions where an element states none: m, m/s, m/s².
MOTION = (0.01, 0.2, 2.0)
#: Smallest force that a hand notices, N; also what the ripple keeps to where nothing is said.
NOTICED = 0.1
#: Steps that every effect keeps; what is over one is for the rounding of what is written.
_LEAST = 1 + 2e-5
#: Of the step within which an effect has to be felt, likewise.
_OF_A_STEP = 0.997
#: Motions that people make, Hz; an effect counts as the part of it that is felt there.
_SLOW, _FAST = 0.5, 5.0
#: ... and as no less than this.
_BARELY = 1e-3
#: Largest, where nothing is said.
_MOST = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """One effect of one element: sizes are positive, ``sign`` says what they are."""

    element: str
    effect: int
    sign: int
    low: float
    high: float
    reference: float
    unit: float
    corner: float
    given: bool = False

    @property
    def label(self) -> str:
        """Element and effect."""
        return f"{self.element}.{EFFECTS[self.effect]}"

    def at(self, steps: float) -> float:
        """The size of so many steps."""
        felt = inner(
            outer(self.reference, self.corner) + self.sign * steps / self.unit, self.corner
        )
        return float(self.sign * (felt - self.reference))

    def steps(self, size: float) -> float:
        """Steps from what is there to what is felt with this size."""
        felt = outer(self.reference + self.sign * size, self.corner)
        return float(abs(felt - outer(self.reference, self.corner)) * self.unit)


def outer(felt: FloatArray | float, corner: float) -> FloatArray:
    """∫ dI/max(I, corner) from zero, any shape: Weber's law with a floor, times ln(1 + w)."""
    above = np.maximum(felt, corner)
    return np.minimum(felt, corner) / corner + np.log(above / corner)


def inner(height: FloatArray | float, corner: float) -> FloatArray:
    """What is felt where the integral has this value, any shape."""
    return corner * (np.minimum(height, 1.0) + np.expm1(np.maximum(height, 1.0) - 1.0))


def weber_fraction(effect: int) -> float:
    """Equal-range signal detection, theory.md 8."""
    equal, different, ratio = COUNTS[effect]
    distance = norm.ppf((1 + equal) / 2) + norm.ppf(different)
    return float(ratio ** (1 / distance) - 1)


def felt_of(
    device: Device, filters_hz: tuple[float | None, float | None], frequency: FloatArray
) -> NDArray[np.complex128]:
    """Force over velocity of one unit of K, B and M, complex, at each frequency: (3, ...)."""
    step = device.sample_time.value
    lag = 0.0 if device.current_lag is None else device.current_lag.value
    turn = 2j * np.pi * frequency
    z = np.exp(turn * step)
    held = (1 - 1 / z) / (turn * step) * np.exp(-turn * device.delay.value) / (1 + turn * lag)
    rates = []
    for hz in filters_hz:
        decay = 0.0 if hz is None else np.exp(-2 * np.pi * hz * step)
        rates.append((1 - decay) * (z - 1) / (step * (z - decay)))
    velocity, again = rates
    return np.stack([held / turn, held * velocity / turn, held * again**2 / turn])


def felt_share(device: Device, filter_hz: float | None, power: int) -> float:
    """The part of a damper (power 1) or mass (2) in phase with it, on average over 0.5 to 5 Hz."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    frequency = _SLOW * (_FAST / _SLOW) ** ((nodes + 1) / 2)
    felt = felt_of(device, (filter_hz, filter_hz), frequency)[power]
    share = (felt / (2j * np.pi * frequency) ** (power - 1)).real
    return max(float(weights @ share) / 2, _BARELY)


@dataclass(frozen=True, slots=True, kw_only=True)
class Felt:
    """One end of the step within which an element's mass or damping is felt; see `felt_ends`."""

    given: FloatArray
    asked: FloatArray
    own: float
    corner: float
    step: float

    def row(self, sizes: FloatArray) -> FloatArray:
        """a with a·sizes <= 1: the tangent of where one step ends, shapes (unknowns,)."""
        place = self.own + float(self.asked @ sizes)
        end = float(inner(outer(place, self.corner) + self.step, self.corner))
        slope = max(end, self.corner) / max(place, self.corner)
        least = end - slope * place - (1 - slope) * self.own
        return (self.given - slope * self.asked) / least


def felt_ends(
    device: Device,
    wanted: list[Wanted],
    filters_hz: tuple[float | None, float | None],
    elements: Mapping[str, Element],
) -> list[Felt]:
    """Mass and damping at both ends of motions within a step of what is asked, up and down."""
    found: list[Felt] = []
    effects = np.array([one.effect for one in wanted])
    for frequency in (_SLOW, _FAST):
        felt = felt_of(device, filters_hz, np.array(frequency))
        mass, damping = felt.imag / (2 * np.pi * frequency), felt.real
        mass[0] = 0.0  # a spring is felt as a spring
        for name in {one.element for one in wanted if not one.given}:
            for effect, own, parts in (
                (1, device.damping.value, damping),
                (2, device.mass.value, mass),
            ):
                mine = np.array([one.sign * float(one.element == name) for one in wanted])
                step = _OF_A_STEP * np.log1p(weber_fraction(effect))
                found += [
                    Felt(
                        given=mine * parts[effects],
                        asked=mine * (effects == effect),
                        own=own,
                        corner=corner_of(effect, elements[name]),
                        step=sign * step,
                    )
                    for sign in (1, -1)
                ]
    return found


def corner_of(effect: int, element: Element) -> float:
    """The smallest force that is noticed, over the motion it is noticed in, over ln(1 + w)."""
    stated = (None, element.speed, element.acceleration)[effect]
    return NOTICED / (stated or MOTION[effect]) / float(np.log1p(weber_fraction(effect)))


def wanted_of(
    device: Device,
    name: str,
    element: Element,
    gain: float,
    filters_hz: tuple[float | None, float | None],
) -> Iterator[Wanted]:
    """What an element asks for; nothing is taken away beyond a gain margin of what is there."""
    box = device.simultaneous_box()
    masked = max(device.coulomb_friction.value, NOTICED)
    references = (masked / MOTION[0], device.damping.value, device.mass.value)
    felt = (1.0, *(felt_share(device, hz, power) for power, hz in enumerate(filters_hz, start=1)))
    there = (0.0, box.damping[0], box.mass[0])
    for effect, word in enumerate(EFFECTS):
        wish: Wish | None = getattr(element, word)
        if wish is None:
            continue
        negative = wish.kind == "min" or (wish.kind == "value" and (wish.high or 0) < 0)
        high = _MOST * references[effect] if wish.high is None else abs(wish.high)
        if negative:
            high = min(high, there[effect] / gain)
        sign, unit = -1 if negative else 1, float(1 / np.log1p(weber_fraction(effect)))
        reference = references[effect] / felt[effect]
        one = Wanted(
            element=name,
            effect=effect,
            sign=sign,
            low=0.0,
            high=high,
            reference=reference,
            unit=unit,
            corner=corner_of(effect, element) / felt[effect],
            given=wish.kind == "value",
        )
        yield replace(one, low=max(one.at(_LEAST), (wish.kind == "range" and wish.low) or 0.0))
