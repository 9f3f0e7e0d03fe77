"""Passivity, the second verdict: Colgate and Schenkel's condition for the paper's ideal loop."""

from __future__ import annotations

import numpy as np


def damping_needed(stiffness: float, damping: float, mass: float, sample_time: float) -> float:
    """Device damping b above which K, B and M by backward differences are passive, N·s/m.

    b > KT/2 + max over c in [-1, 1] of [-Bc + (M/T)(2c² - c - 1)], c = cos ωT; no filter, no delay
    (Colgate and Schenkel 1997, with the double difference for the acceleration). For a spring and
    a damper this is b > KT/2 + |B|.
    """
    rate = mass / sample_time
    cosines = [-1.0, 1.0]
    if rate < 0:
        cosines.append(float(np.clip((damping + rate) / (4 * rate), -1, 1)))
    worst = max(-damping * c + rate * (2 * c * c - c - 1) for c in cosines)
    return stiffness * sample_time / 2 + worst
