"""Largest change of a reading against linear extrapolation of the two before it."""

from __future__ import annotations

from tune.documents.profile import SafeProfile
from tune.exporters.heading import force_limit

#: The line through two readings, each rounded to a count, and the rounding of the third.
_COUNTS = 2.0


def largest_change(profile: SafeProfile) -> float:
    """What a device can do to its speed in one period, as travel in that period, m (rad).

    It may come to rest from the fastest speed that an element states, and be thrown by the peak
    force at its least mass; a vibration mode lets the encoder move sum(e²) times more. Two counts
    of the encoder are added. A reading farther from the straight line is not of the device.

    Raises:
        UnstatedError: the peak force is not known.
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
