"""Passivity from the frequency response itself: a second opinion on a claim."""

from __future__ import annotations

import numpy as np

from tune.certificate.affine import FloatArray
from tune.certificate.point import Setting
from tune.certificate.polynomial import law_of
from tune.certificate.precision import precision

#: Frequencies looked at, evenly and in equal ratios from the slowest, as parts of π; around the
#: greatest need once more. A smooth peak is then missed by less than a part in 10⁹.
_POINTS = 4096
_SLOWEST = 1e-5
#: A claim may fall short by this part of what is needed.
_AGREE = 1e-6


def passive(setting: Setting, damping: float, sample_time: float, delay_samples: int = 0) -> bool:
    """Whether b > T/2·Re{(1 - e^-jωT)·H(e^jωT)}/(1 - cos ωT) at every ω (Colgate and Schenkel).

    H is the law with its filters and with whole samples of delay within the computer; a rigid mass
    on a damper, any mass.
    """
    return bool(damping > damping_for_passivity(setting, sample_time, delay_samples) * (1 - _AGREE))


def damping_for_passivity(setting: Setting, sample_time: float, delay_samples: int = 0) -> float:
    """The least damping of a passive device, N·s/m; at least zero."""
    with precision():
        law = law_of(setting, sample_time)
        top, bottom = (
            np.array([float(c) for c in polynomial.coeffs()][::-1])
            for polynomial in (law.numerator, law.denominator)
        )

    def needed(angle: FloatArray) -> FloatArray:
        z = np.exp(1j * angle)
        response = np.polyval(top, z) / np.polyval(bottom, z) * z ** -float(delay_samples)
        if law.vanishes:
            response = response * (z - 1)
        return np.real((1 - np.conj(z)) * response) / (2 * np.sin(angle / 2) ** 2) * sample_time / 2

    angle = np.sort(
        np.pi
        * np.concatenate([np.linspace(0, 1, _POINTS + 1)[1:], np.geomspace(_SLOWEST, 1, _POINTS)])
    )
    values = needed(angle)
    at = int(np.argmax(values))
    low, high = float(angle[max(at - 1, 0)]), float(angle[min(at + 1, len(angle) - 1)])
    near: FloatArray = np.linspace(low, high, _POINTS)
    return max(0.0, float(values[at]), float(needed(near).max()))
