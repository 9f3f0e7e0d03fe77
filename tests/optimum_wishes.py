"""What the effects of an element ask for, and how high a size stands on the scale of steps.

Written down anew from the documented meaning of device and scene.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
#: Least size looked at, relative to the reference: a hundred-thousandth of a step.
_LEAST = 1e-6
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
    level: int
    met: float | None

    @property
    def label(self) -> str:
        return f"{self.element}.{EFFECTS[self.effect]}"

    def steps(self, size: float) -> float:
        """|ln(1 + value/reference)| / ln(1 + w)."""
        return float(abs(np.log1p(self.sign * size / self.reference)) * self.unit)

    def height(self, size: float) -> float:
        """Steps, or minus those that a wanted value is short of."""
        return self.steps(size) - (0.0 if self.met is None else self.steps(self.met))


def weber_fraction(effect: int) -> float:
    """Equal-range signal detection, theory.md 8."""
    equal, different, ratio = COUNTS[effect]
    distance = norm.ppf((1 + equal) / 2) + norm.ppf(different)
    return float(ratio ** (1 / distance) - 1)


def felt_share(device: Device, filter_hz: float | None, power: int) -> float:
    """The part of a damper (power 1) or mass (power 2) that is in phase with it, on average.

    Sines from 0.5 to 5 Hz evenly over the logarithm; differences, filters, delay and hold as they
    are. A velocity is the place times jω, a force that opposes it as damping is real over it.
    """
    step = device.sample_time.value
    nodes, weights = np.polynomial.legendre.leggauss(60)
    frequency = _SLOW * (_FAST / _SLOW) ** ((nodes + 1) / 2)
    turn = 2j * np.pi * frequency
    z = np.exp(turn * step)
    decay = 0.0 if filter_hz is None else np.exp(-2 * np.pi * filter_hz * step)
    rate = (1 - decay) * (z - 1) / (step * (z - decay))
    held = (1 - 1 / z) / (turn * step) * np.exp(-turn * device.delay.value)
    return max(float(weights @ (held * (rate / turn) ** power).real) / 2, _BARELY)


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
    references = (
        masked / (element.penetration or MOTION[0]),
        device.damping.value,
        device.mass.value,
    )
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
        low = wish.low if wish.kind == "range" and wish.low else _LEAST * references[effect]
        yield Wanted(
            element=name,
            effect=effect,
            sign=-1 if negative else 1,
            low=low,
            high=high,
            reference=references[effect] / felt[effect],
            unit=1 / np.log1p(weber_fraction(effect)),
            level=0 if wish.kind == "value" else element.priority,
            met=high if wish.kind == "value" else None,
        )
