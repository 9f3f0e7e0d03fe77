"""Without a spring motion is free from where the hand lets go, however long it pushed."""

from __future__ import annotations

from math import exp, pi

import numpy as np
import pytest

from identification import Trajectory, load_device, quantity
from tune import Scene, Verification, optimise, verify

T, STEPS, CUTOFF, RISE, SPEED = 1e-3, 10, 50.0, 0.1, 0.2
GAIN, DAMPING = 0.2, 10.0
KNOWN = {"mass": quantity(3.0, 2.97, 3.03), "damping": quantity(10.0, 9.5, 10.5)}
PROFILE = optimise(
    load_device("homerehab").model_copy(update=KNOWN),
    Scene.model_validate(
        {"elements": {"water": {"damping": DAMPING}}, "loop": {"velocity_filter_hz": CUTOFF}}
    ),
)


def pushed(
    hold: float, *, mass: float = 3.0, last: float = 2.0, stop: bool = False, seed: int = 0
) -> Trajectory:
    """The water of the profile; a hand brings it to a speed, holds that, and lets go or stops it.

    Semi-implicit Euler of a mass with damping and dry friction; one sample of delay.
    """
    noise = np.random.default_rng(seed).normal(0.0, 3e-6, round((RISE + hold + last) / T))
    pole, h = exp(-2 * pi * CUTOFF * T), T / STEPS
    y = v = filtered = before = acting = 0.0
    rows: list[tuple[float, float, float]] = []
    for k, fuzz in enumerate(noise.tolist()):
        read = 6e-6 * round((y + fuzz) / 6e-6)
        filtered = pole * filtered + (1 - pole) * ((read - before) / T if k else 0.0)
        before, wanted = read, SPEED * min(1.0, k * T / RISE)
        held, now = k * T < RISE + hold, acting
        acting = -GAIN * DAMPING * filtered
        rows.append((k * T, acting, read))
        if stop and not held:
            held, wanted = True, 0.0
        for _ in range(STEPS):
            hand = 300.0 * (wanted - v) if held else 0.0
            free = v + h * (now + hand - 10.0 * v) / mass
            v = np.sign(free) * max(abs(free) - h * 0.8 / mass, 0.0)
            y += h * v
    time, force, position = np.array(rows).T
    return Trajectory(time=time, force=force, position=position)


def decay(seen: Verification) -> str:
    return str(next(each for each in seen.outcomes if each.check == "decay"))


@pytest.mark.parametrize("hold", [0.0, 0.2, 0.4, 0.8])
def test_the_decay_is_that_of_the_device_however_long_a_hand_pushed(hold: float) -> None:
    seen = verify(PROFILE, pushed(hold))
    assert "decay agrees" in decay(seen)
    assert seen.motion is not None
    assert seen.motion.measured is not None
    begun = int(seen.motion.measured.rows[0]) * T
    assert begun == pytest.approx(RISE + hold, abs=0.03)
    # Pole of m·s + b + B, which delay and filter move by less than one per cent.
    assert seen.motion.measured.decay == pytest.approx(12.0 / 3.0, rel=0.02)
    heavy = verify(PROFILE, pushed(hold, mass=3.9))
    assert "decay disagrees" in decay(heavy)


@pytest.mark.parametrize("stop", [True, False])
def test_where_a_hand_may_still_push_it_is_said_and_not_judged(stop: bool) -> None:
    log = pushed(0.8, last=0.3 if stop else 0.0, stop=stop)
    seen = verify(PROFILE, log)
    assert "a hand may still push. Take the hand off, and state with --release" in decay(seen)
    assert "decay agrees" not in decay(verify(PROFILE, log, release=0.2))
