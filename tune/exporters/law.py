"""The law of a profile as numbers: filters, fading, the largest change of a reading; and in words.

Coefficients come from their definitions in docs/theory.md, 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from identification import InvalidInputError
from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile
from tune.exporters.text import force_limit

Estimate = Literal["velocity", "acceleration"]

#: The line through two readings, each rounded to a count, and the rounding of the third.
_COUNTS = 2.0

#: The law in words, where it is not exported as code.
LAW_IN_WORDS = (
    "u = stiffness*(y - rest) + damping*v + mass*a of each element and F = -level*u, u clamped to "
    "+-force_level where there is stiffness, and at 0 where it is one_sided and would pull; the "
    "sum of F is cut at the peak force. level is the gain, 0 to 1, of what is wanted and 0 of what "
    "is not: it gets there over fade_time, s, if there is one, and not while one that is one_sided "
    "pushes; else it falls at once, and with stiffness it rises only as the element is entered or "
    "after taps samples in a row without force. With stiffness an element that is entered rests "
    "at y; one that is one_sided only if y is behind its face, and after taps samples without "
    "force at its face there again. No face or rest moves under force. What acts at once, what "
    "fades out included, is one of moments; with one_sided elements on both sides it is one "
    "without those of either side, and their faces do not overlap and, where damping/stiffness "
    "differs, lie as far apart as the sum of damping/stiffness*speed. "
    "x[k] = (t*x[k-1] - p*x[k-2]) + g*u[k] for both filters, which run on every reading of the "
    "axis. A reading farther than largest_change times the periods passed from the straight line "
    "through the last two, like one that is missing, holds the force and is bridged by a straight "
    "line"
)


@dataclass(frozen=True, slots=True)
class Section:
    """A low-pass x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k] with g = 1 - t + p.

    One pole a: t = a, p = 0. No filter: t = p = 0.
    """

    t: float = 0.0
    p: float = 0.0

    @property
    def gain(self) -> float:
        """g, from the very t and p that are printed, so that a steady input passes unchanged."""
        return 1 - self.t + self.p


def section_of(loop: LoopProfile, which: Estimate) -> Section:
    """The low-pass of velocity or acceleration, which are differences of the readings y.

    Velocity: (y[k] - y[k-n])/(n·T) over a window of n samples, or 1. Acceleration: the backward
    difference (d[k] - d[k-1])/T of the backward difference d[k] = (y[k] - y[k-1])/T.
    """
    cutoff: float | None = getattr(loop, f"{which}_filter_hz")
    if cutoff is None:
        return Section()
    ratio = loop.filter_damping_ratio
    # Poles exp(-2π·f·T), or exp(-2π·f·T·(ζ ± j·√(1-ζ²))).
    turn = 2 * math.pi * cutoff * loop.sample_time
    if getattr(loop, f"{which}_filter_order") == 1:
        return Section(math.exp(-turn))
    size = math.exp(-ratio * turn)
    return Section(2 * size * math.cos(turn * math.sqrt(1 - ratio * ratio)), size * size)


def fade_step(element: ElementProfile, sample_time: float) -> float:
    """Change of the level of an element in one period, s; 1 switches it at once.

    InvalidInputError where it has to fade, and the profile does not say over which time.
    """
    if element.fades and not element.fade_time:
        raise InvalidInputError(
            "profile",
            "an element with mass or a negative effect has no fade_time, and must not be switched",
            "Tune again",
        )
    return min(1.0, sample_time / element.fade_time) if element.fade_time else 1.0


def largest_change(profile: SafeProfile) -> float:
    """What a device can do to its speed in one period, as travel in that period, m (rad).

    It may come to rest from the fastest speed that an element states, and be thrown by the peak
    force at its least mass; a vibration mode lets the encoder move sum(e²) times more. Two counts
    of the encoder are added. A reading farther from the straight line is not of the device.
    """
    device = profile.device
    resolution = device.encoder_resolution
    step = profile.loop.sample_time
    lively = 1 + sum(mode.at_encoder**2 for mode in device.modes)
    thrown = force_limit(profile).peak * lively / device.simultaneous_box().mass[0] * step
    counts = 0.0 if resolution is None else _COUNTS * resolution.value
    return (_fastest(profile) + thrown) * step + counts


def change_words(profile: SafeProfile) -> str:
    """What the largest change is made of, as a sentence."""
    rotary = profile.device.motion == "rotary"
    return (
        f"Made of the fastest speed stated, {_fastest(profile):g} {'rad/s' if rotary else 'm/s'}, "
        "lost at once, the peak force on the least mass, and two counts of the encoder."
    )


def _fastest(profile: SafeProfile) -> float:
    return max(element.motion.speed for element in profile.elements.values())
