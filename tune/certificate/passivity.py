"""Passivity from the frequency response itself: a second opinion on a claim."""

from __future__ import annotations

import numpy as np

from tune.certificate.polynomial import Setting

#: Frequencies on the half circle. What is needed is a parabola in cos ωT, flat at its peak: the
#: nearest of them misses it by a part in 10⁷.
_POINTS = 4096
#: A claim may fall short by this part of what is needed.
_AGREE = 1e-6


def passive(setting: Setting, damping: float, sample_time: float) -> bool:
    """Whether b > T/2·Re{(1 - e^-jωT)·H(e^jωT)}/(1 - cos ωT) at every ω (Colgate and Schenkel).

    H is the law by backward differences; a filter or a delay is outside this condition.
    """
    angle = np.pi * np.arange(1, _POINTS + 1) / _POINTS
    difference = 1 - np.exp(-1j * angle)
    rate = difference / sample_time
    law = setting.stiffness + setting.damping * rate + setting.mass * rate * rate
    needed = sample_time / 2 * np.real(difference * law) / (1 - np.cos(angle))
    return bool(damping > np.max(needed) * (1 - _AGREE))
