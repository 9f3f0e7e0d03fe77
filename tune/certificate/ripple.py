"""Encoder ripple by integrating |C/(1+GC)|² around the unit circle: a second opinion."""

from __future__ import annotations

import numpy as np
from flint import arb_poly

from tune.certificate.polynomial import Point, Setting, closed_loop, precision

#: Points on the half circle. The integrand is smooth; the mean converges like r^points for a
#: slowest pole of radius r, and the number is raised until two agree.
_FEWEST = 1 << 14
_MOST = 1 << 22
_AGREE = 1e-6


def ripple_by_integration(point: Point, setting: Setting, resolution: float) -> float:
    """Force ripple, N rms, from white quantisation noise of variance resolution²/12.

    With no spring, loop and law share the pole z = 1 of free motion, which the closed loop has had
    divided out; the law then vanishes there like z - 1 does.
    """
    with precision():
        loop = closed_loop(point, setting)
        full = _floats(loop.open + loop.feedback)
        # C/(1+GC) is D·C/(D + N) where N = D·G·C.
        open_ = _floats(loop.open)
    value, count = np.nan, _FEWEST
    while count <= _MOST:
        angle = (np.arange(count) + 0.5) * (np.pi / count)
        z = np.exp(1j * angle)
        response = _law(point, setting, z) * np.polyval(open_, z) / np.polyval(full, z)
        previous, count = value, count * 4
        value = float(np.sqrt(np.mean(np.abs(response) ** 2) / 12) * resolution)
        if abs(value - previous) <= _AGREE * value:
            break
    return value


def _law(point: Point, setting: Setting, z: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    def pole(cutoff: float | None) -> float:
        return 0.0 if cutoff is None else float(np.exp(-2 * np.pi * cutoff * point.sample_time))

    av, aa = pole(setting.velocity_filter_hz), pole(setting.acceleration_filter_hz)
    rate = (1 - av) * (z - 1) / (point.sample_time * (z - av))
    rate_of_rate = ((1 - aa) * (z - 1) / (point.sample_time * (z - aa))) ** 2
    return setting.stiffness + setting.damping * rate + setting.mass * rate_of_rate


def _floats(polynomial: arb_poly) -> np.ndarray:  # type: ignore[type-arg]
    return np.array([float(c) for c in polynomial.coeffs()][::-1])
