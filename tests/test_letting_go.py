"""Without a spring motion is free from where the hand lets go, however long it pushed."""

import json
import re
from collections.abc import Mapping, Sequence
from math import exp, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Controller, Rig, log_text, simulate
from identification import Trajectory, load_device, quantity
from tests.commands import haptune
from tune import SafeProfile, Scene, Verification, optimise, verify
from tune.documents.profile import ElementProfile
from tune.verification import advise

T, STEPS, CUTOFF, RISE, SPEED = 1e-3, 10, 50.0, 0.1, 0.2
GAIN, DAMPING = 0.2, 10.0
KNOWN = {"mass": quantity(3.0, 2.97, 3.03), "damping": quantity(10.0, 9.5, 10.5)}
WATER = {"water": {"damping": DAMPING}}


def tuned(
    elements: Mapping[str, Any] = WATER,
    hertz: float = CUTOFF,
    *,
    apart: Sequence[Sequence[str]] = (),
    together: Sequence[Sequence[str]] = (),
    **facts: Any,
) -> SafeProfile:
    """What is tuned on HomeRehab, well known, but for such facts."""
    scene: dict[str, Any] = {"elements": elements, "loop": {"velocity_filter_hz": hertz}}
    scene |= {"apart": apart, "together": together}
    device = load_device("homerehab").model_copy(update=KNOWN | facts)
    return optimise(device, Scene.model_validate(scene))


PROFILE = tuned()


def pushed(
    hold: float,
    *,
    mass: float = 3.0,
    friction: float = 0.8,
    gain: float = GAIN,
    speed: float = SPEED,
    last: float = 2.0,
    stop: bool = False,
    seed: int = 0,
    step: float = T,
    noise: float = 3e-6,
) -> Trajectory:
    """The water of the profile; a hand brings it to a speed, holds that, and lets go or stops it.

    Semi-implicit Euler of a mass with damping and dry friction; one sample of delay.
    """
    readings = np.random.default_rng(seed).normal(0.0, noise, round((RISE + hold + last) / step))
    pole, h = exp(-2 * pi * CUTOFF * step), step / STEPS
    y = v = filtered = before = acting = 0.0
    rows: list[tuple[float, float, float]] = []
    for k, fuzz in enumerate(readings.tolist()):
        read = 6e-6 * round((y + fuzz) / 6e-6)
        filtered = pole * filtered + (1 - pole) * ((read - before) / step if k else 0.0)
        before, wanted = read, speed * min(1.0, k * step / RISE)
        held, now = k * step < RISE + hold, acting
        acting = -gain * DAMPING * filtered
        rows.append((k * step, acting, read))
        if stop and not held:
            held, wanted = True, 0.0
        for _ in range(STEPS):
            hand = 300.0 * (wanted - v) + friction * (wanted > 0) if held else 0.0
            free = v + h * (now + hand - 10.0 * v) / mass
            v = np.sign(free) * max(abs(free) - h * friction / mass, 0.0)
            y += h * v
    time, force, position = np.array(rows).T
    return Trajectory(time=time, force=force, position=position)


def decay(seen: Verification) -> str:
    return str(next(each for each in seen.outcomes if each.check == "decay"))


@pytest.mark.parametrize("hold", [0.0, 0.4, 0.8])
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


def _rubbing(friction: float, speed: float) -> SafeProfile:
    water = {"damping": DAMPING, "speed": speed}
    return tuned({"water": water}, coulomb_friction=quantity(friction))


def _stored(profile: SafeProfile, **logs: Trajectory) -> None:
    """As profile.yaml in the current folder, beside logs."""
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    for name, log in logs.items():
        Path(f"{name}.csv").write_text(log_text(log), encoding="utf-8")


@pytest.mark.usefixtures("here")
def test_a_push_that_friction_stops_too_soon_is_not_prescribed() -> None:
    friction = 60.0
    _stored(_rubbing(friction, 0.1), slow=pushed(0.0, friction=friction, speed=0.1))
    (told,) = json.loads(haptune("verify", "profile.yaml", "--json").out)["details"]["play"]
    assert told["play"] is None
    assert "friction stops it before the 50 rows" in told["why"]
    enough = float(re.findall(r"pushed to ([\d.]+) m/s", told["why"])[0])
    # Refused as told; not by what it is told to play instead.
    refused = haptune("verify", "profile.yaml", "slow.csv", "--gain", f"{GAIN}")
    assert refused.code == 4
    assert "Instead: play" not in refused.err
    profile = _rubbing(friction, enough)
    (advice,) = advise(profile)
    assert advice.play is not None
    assert advice.play.speed == pytest.approx(enough)
    log = pushed(0.1, friction=friction, speed=enough, gain=advice.play.gain)
    seen = verify(profile, log)
    assert "decay agrees" in decay(seen)


def test_what_was_just_played_is_not_told_as_something_else(here: Path) -> None:
    (advice,) = advise(PROFILE)
    assert advice.play is not None
    _stored(PROFILE, stopped=pushed(0.8, last=0.3, stop=True, gain=advice.play.gain))
    refused = haptune("verify", "profile.yaml", "stopped.csv")
    assert refused.code == 4
    assert "After what is said of the other checks, again: play water" in refused.err
    assert "Instead" not in refused.err


def test_motion_that_friction_or_the_log_ends_is_not_laid_to_a_hand(here: Path) -> None:
    rubbing, log = _rubbing(15.0, SPEED), pushed(0.1, friction=15.0)
    stopped = verify(rubbing, log)
    assert "friction stops it before the 50 rows" in decay(stopped)
    assert "Push it to 0.349 m/s" in decay(stopped)
    ended = decay(verify(PROFILE, pushed(0.8, last=0.05), release=0.9))
    assert "the log ends before the speed has fallen. Log until" in ended
    _stored(rubbing, log=log)
    refused = haptune("verify", "profile.yaml", "log.csv").err
    (frequency,) = (line for line in refused.splitlines() if "nothing oscillates" in line)
    assert frequency.endswith("What to play is said of the delay.")


def test_what_was_dropped_is_not_to_be_verified(here: Path) -> None:
    fluids = {"water": {"damping": DAMPING}, "air": {"damping": 0.01}}
    profile = tuned(fluids, together=[["water", "air"]])
    assert profile.elements["air"].damping == 0
    _stored(profile)
    plan = json.loads(haptune("verify", "profile.yaml", "--json").out)["details"]["play"]
    assert [each["to_verify"] for each in plan] == [["water"]]
    asked = haptune("verify", "profile.yaml", "--element", "water+air")
    assert asked.code == 2
    assert "has an element that gives no force. Choose from water" in asked.err


def test_what_fades_is_pushed_when_it_has_faded_in() -> None:
    for effects, fades in (({"feather": {"damping": -3.0}}, True), (WATER, False)):
        (advice,) = advise(tuned(effects))
        assert advice.play is not None
        said = "held still for 0.1 s until it has faded in, then pushed to 0.2 m/s"
        assert (said in advice.words("linear")) is fades
        # Five time constants, of 3 kg behind some 10 N·s/m, and some rest.
        assert 5 * 3 / 10 + 0.5 <= advice.play.duration < 3


def test_a_handle_that_stops_at_once_at_a_fast_rate_is_a_sentence() -> None:
    step = T / 8
    profile = tuned(sample_time=quantity(step), delay=quantity(step))
    log = pushed(0.0, friction=90.0, speed=0.05, last=0.3, step=step, noise=0.0)
    seen = verify(profile, log, gain=GAIN)
    assert "decay: not assessed" in decay(seen)


STYLUS: dict[str, Any] = {
    "mass": quantity(0.05, 0.0499, 0.0501),
    "damping": quantity(0.3, 0.298, 0.302),
    "coulomb_friction": quantity(0.04),
    "delay": quantity(0.0013),
    "encoder_resolution": quantity(1e-5),
}


def _let_go(element: ElementProfile, gain: float, start: float, hertz: float) -> Trajectory:
    """A stylus let go from where an element pushes it back."""
    known = {name: each.value for name, each in STYLUS.items()}
    law = Controller(
        stiffness=gain * element.stiffness,
        damping=gain * element.damping,
        velocity_filter_hz=hertz,
        side=-1 if element.one_sided else 0,
    )
    rig = Rig(**known, sample_time=T, force_limit=28.0)
    return simulate(rig, np.zeros(1500), controller=law, position=start).trajectory()


def test_a_wall_that_lets_go_before_it_swings_is_not_played_for_motion(here: Path) -> None:
    said, profile = "", PROFILE
    wall: dict[str, object] = {}
    for damping in (12.0, 1.7):  # whose motion would not oscillate, and would
        wall = {"stiffness": 250.0, "damping": damping, "one_sided": True}
        profile = tuned({"spring": wall}, 400.0, **STYLUS)  # a name that is not free
        (advice,) = advise(profile)
        assert advice.play is None
        said = advice.words("linear")
    assert "it lets go of the handle before a swing could be seen, for it never pulls" in said
    # What it asks for instead can be played, and that is judged.
    (damping,) = re.findall(r"`spring_2: {stiffness: max, damping: ([\d.]+)}`", said)
    elements = {"spring": wall, "spring_2": {"stiffness": "max", "damping": float(damping)}}
    both = tuned(elements, 400.0, apart=[["spring", "spring_2"]], **STYLUS)
    assert both.elements["spring_2"].limited_by["damping"] == "wanted"
    told = advise(both)
    for each in told:
        assert each.play is not None
        assert each.play.elements == ("spring_2",)
    play = told[0].play
    assert play is not None
    assert play.displacement is not None
    log = _let_go(both.elements["spring_2"], play.gain, play.displacement, 400.0)
    assert verify(both, log).assessed
    # The wall itself is refused with what happens, and never told to be played again.
    _stored(profile, left=_let_go(profile.elements["spring"], 0.2, 0.02, 400.0))
    refused = haptune("verify", "profile.yaml", "left.csv")
    assert refused.code == 4
    assert "the handle leaves a one-sided wall, or the force its limit" in refused.err
    assert "play spring at gain" not in refused.err
