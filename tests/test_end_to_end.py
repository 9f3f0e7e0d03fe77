"""Simulated device → log → calibrate → is the *true* device stable with its profile?"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from flint import arb

from datasets_synthetic import Faults, Fleet, random_devices
from identification import (
    ForceLimit,
    Hardware,
    LogRefusedError,
    identify,
    quantity,
)
from tests.reference import boundary_gains, reference_loop, stable_by_roots
from tune.errors import NoFeasibleEffectError
from tune.optimisation import optimise
from tune.profile import SafeProfile
from tune.scene import Scene

SCENE = Scene.model_validate(
    {
        "elements": {
            "wall": {"stiffness": "max", "damping": "max"},
            "rubber": {"stiffness": "max"},
            "cup": {"mass": "max"},
            "light": {"mass": "min"},
        },
        "together": [["wall", "cup"]],
        "margin": "firm",
        "ripple_limit": 1e6,
        "loop": {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 40.0},
    }
)


def _hardware(fleet: Fleet, member: int) -> Hardware:
    """What a data sheet would say; no force limit, so that stability is what binds."""
    rig = fleet.rig
    return Hardware(
        sample_time=quantity(float(rig.sample_time[member])),
        delay=quantity(float(rig.delay[member])),
        encoder_resolution=quantity(float(rig.encoder_resolution[member])),
        force_limit=ForceLimit(continuous=1e6, peak=1e6),
    )


def _truly_stable(profile: SafeProfile, fleet: Fleet, member: int) -> bool:
    """Every moment of the profile at every gain up to one, on the device as it really is."""
    rig = fleet.rig
    m, b, T = (float(x[member]) for x in (rig.mass, rig.damping, rig.sample_time))
    delay = round(float(rig.delay[member]) / T)
    poles = [
        0.0 if f is None else float(np.exp(-2 * np.pi * f * T))
        for f in (profile.loop.velocity_filter_hz, profile.loop.acceleration_filter_hz)
    ]
    for moment in profile.moments():
        chosen = [profile.elements[name] for name in moment]
        K, B, M = (
            sum(getattr(element, effect) for element in chosen)
            for effect in ("stiffness", "damping", "mass")
        )
        if not (K or B or M):
            continue
        loop = reference_loop(
            b * T / m,
            K * T * T / m,
            B * T / m,
            M / m,
            delay=delay,
            velocity_pole=poles[0],
            acceleration_pole=poles[1],
        )
        if not stable_by_roots(loop.at(arb(1))):
            return False
        if any(0 < float(gain.mid()) <= 1 for gain in boundary_gains(loop)):
            return False
    return True


def _calibrate(count: int, seed: int) -> Counter[str]:
    tally: Counter[str] = Counter()
    fleet = random_devices(count, seed, samples=10_000)
    # Force noise of a thousandth of the peak and half a count of measurement noise.
    recording = fleet.logs(faults=Faults(position_noise=1e-6, force_noise=1e-3), seed=seed)
    for member in range(count):
        try:
            found = identify(recording.trajectory(member), hardware=_hardware(fleet, member))
            profile = optimise(found.device, SCENE)
        except LogRefusedError as error:
            tally["refused: " + error.findings[0].code] += 1
            continue
        except NoFeasibleEffectError:
            tally["nothing feasible"] += 1
            continue
        tally["profiles"] += 1
        tally["stable"] += _truly_stable(profile, fleet, member)
    return tally


def test_true_devices_are_stable_with_their_profiles() -> None:
    tally = _calibrate(5, seed=0)
    assert tally["stable"] == tally["profiles"], tally
    assert tally["profiles"] >= 4, tally


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 11))
def test_a_thousand_true_devices_are_stable_with_their_profiles(seed: int) -> None:
    tally = _calibrate(100, seed=seed)
    print(dict(tally))
    assert tally["stable"] == tally["profiles"], tally
    assert tally["profiles"] >= 40, tally
