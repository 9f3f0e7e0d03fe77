"""What entering one element amounts to, in numbers people know: bounce, depth, jolt and energy.

docs/theory.md, 10. They are the element's own, at full gain and below the force limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from identification import Box, Device, rounded
from tune.documents.effects import EffectName
from tune.documents.profile import Contact
from tune.loop.filters import Filters
from tune.loop.state_space import SampledLoop, corners_of
from tune.rendering.restitution import restitutions

#: Samples beyond which half a period of the device on a spring is no bounce off a wall.
LONGEST_CONTACT = 5_000
#: Digits of a stated number; restitutions are rounded outwards.
_DIGITS = 4


def contact(
    device: Device,
    box: Box,
    filters: Filters,
    values: Mapping[EffectName, float],
    *,
    speed: float,
    one_sided: bool,
) -> Contact:
    """What a free device meets that enters an element.

    Args:
        device: modes, current lag and force limit are read.
        box: of everything else of the device.
        filters: of velocity and acceleration.
        values: stiffness, damping and mass of the element, N/m, N·s/m, kg.
        speed: of the entry, m/s.
        one_sided: the element pushes only.
    """
    K, B, M = (values[name] for name in ("stiffness", "damping", "mass"))
    limit = device.force_limit if K else None
    fades = bool(M) or B < 0
    jolt = speed * abs(K * max(box.sample_time) + B)
    return Contact(
        restitution=None
        if fades or not K
        else _restitution(device, box, filters, K, B, one_sided=one_sided),
        depth_at_continuous_force=None if limit is None else rounded(limit.continuous / K, _DIGITS),
        depth_at_peak_force=None if limit is None else rounded(limit.peak / K, _DIGITS),
        force_on_entry=rounded(jolt, _DIGITS),
        energy_per_entry=rounded(abs(M) * speed**2 / 2, _DIGITS) if M else None,
    )


def _restitution(
    device: Device, box: Box, filters: Filters, stiffness: float, damping: float, *, one_sided: bool
) -> tuple[float, float] | None:
    """Least and largest over the corners of the box and the places between two samples.

    Between the places computed it is continuous; the largest difference between neighbours is
    added on both sides. That no device inside the box is beyond its corners is not proved.
    """
    half_period = math.pi * math.sqrt(box.mass[1] / stiffness)
    if half_period > LONGEST_CONTACT * box.sample_time[0]:
        return None
    found = np.array(
        [
            restitutions(
                SampledLoop.of(place, filters, (stiffness, damping, 0.0)),
                one_sided=one_sided,
                sample_time=place.sample_time,
                half_period=half_period,
            )
            for place in corners_of(device, box)
        ]
    )
    if not np.isfinite(found).all():
        return None
    beside = np.abs(np.diff(found, axis=1)).max()
    least, most = max(0.0, found.min() - beside), found.max() + beside
    return _outwards(least, -1), _outwards(most, 1)


def _outwards(value: float, side: int) -> float:
    """The next number of as many digits downwards (-1) or upwards (1)."""
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) + 1 - _DIGITS)
    return rounded(max(0.0, (math.floor if side < 0 else math.ceil)(value / unit) * unit), _DIGITS)
