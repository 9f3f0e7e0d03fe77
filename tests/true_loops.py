"""How safe a profile is on the device as it really is, by polynomials in many digits."""

import numpy as np
from flint import arb

from tests.reference import crossings, reference_loop, stable_by_jury
from tune import SafeProfile


def safe_gain(
    profile: SafeProfile,
    combination: tuple[str, ...],
    device: tuple[float, float, float],
    delay: int,
) -> float:
    """The first gain at which the combination is unstable on a device (m, b, T); inf if none is."""
    m, b, T = device
    loop_ = profile.loop
    poles = [
        0.0 if f is None else float(np.exp(-2 * np.pi * f * T))
        for f in (loop_.velocity_filter_hz, loop_.acceleration_filter_hz)
    ]
    K, B, M = (
        sum(getattr(profile.elements[name], effect) for name in combination)
        for effect in ("stiffness", "damping", "mass")
    )
    loop = reference_loop(
        b * T / m,
        K * T * T / m,
        B * T / m,
        M / m,
        delay=delay,
        velocity_pole=poles[0],
        acceleration_pole=poles[1],
    )
    gains = [float(gain.mid()) for gain in crossings(loop)]
    first = min(gains, default=np.inf)
    return first if stable_by_jury(loop.at(arb(min(first, 1.0) / 2))) else 0.0


def judged(profile: SafeProfile, device: tuple[float, float, float], delay: int) -> str:
    """stable, short of what is claimed, or unstable: every combination, on the device as it is."""
    answer = "stable"
    for combination in profile.combinations():
        chosen = [profile.elements[name] for name in combination]
        if not any(e.stiffness or e.damping or e.mass for e in chosen):
            continue
        if not safe_gain(profile, combination, device, delay) > 1:
            return "unstable"
        claims = [
            (profile.margin.gain, profile.margin.extra_delay_samples),
            (max(e.margins.gain for e in chosen), 0),
            # Whole samples, which this arithmetic can judge.
            (1.0, int(max(e.margins.extra_delay_samples for e in chosen))),
        ]
        if any(safe_gain(profile, combination, device, delay + late) < g for g, late in claims):
            answer = "short of what is claimed"
    return answer
