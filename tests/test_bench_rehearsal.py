"""Standard trials: what settles, what keeps oscillating and what diverges, each for its reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Calls, Controller, Element, Hand, Rehearsal, Rig, named_rig, rehearse

T = 0.001
HOMEREHAB = named_rig("homerehab")
FILTERED: dict[str, Any] = {"velocity_filter_hz": 30.0, "acceleration_filter_hz": 30.0}
#: The paper's own setting.
PAPER = Controller(stiffness=1000.0, damping=10.0, mass=1.0, **FILTERED)


def play(rig: Rig, controller: Controller, **changes: Any) -> Rehearsal:
    """With short trials, so that those that need it are played for three seconds."""
    (found,) = rehearse(rig, controller, **{"duration": 1.0, **changes})
    return found


def of(rehearsal: Rehearsal, name: str) -> set[str]:
    """Verdicts of the trials of this name."""
    found = {trial.verdict for trial in rehearsal.trials if trial.name == name}
    assert found
    return set(found)


def test_the_papers_setting_settles_held_or_not_with_friction_or_without() -> None:
    found = play(HOMEREHAB, PAPER, hand=Hand(mass=0.3, damping=5.0, stiffness=300.0))
    assert found.settles
    assert {(trial.held, trial.rubbing) for trial in found.trials} == {
        (False, True),
        (True, True),
        (False, False),
        (True, False),
    }
    assert len(found.trials) == 6 * 4
    assert len({trial.name for trial in found.trials}) == 6
    assert all(trial.reason.endswith(".") for trial in found.trials)


def test_too_much_negative_damping_drifts_away_and_is_vetoed() -> None:
    """-12 N·s/m on 10: friction holds a small start, without it any speed grows."""
    found = play(HOMEREHAB, Controller(stiffness=100.0, damping=-12.0, **FILTERED))
    small = [trial for trial in found.trials if trial.name == "small start"]
    assert {trial.rubbing: trial.verdict == "settles" for trial in small} == {
        True: True,
        False: False,
    }
    assert not found.settles


def test_a_spring_far_too_stiff_is_vetoed_with_numbers() -> None:
    """The force limit keeps the oscillation bounded, friction hides it from a small start."""
    found = play(HOMEREHAB, Controller(stiffness=30_000.0))
    assert of(found, "release") == {"keeps-oscillating"}
    worst = found.vetoes[0]
    assert worst.verdict == "diverges"  # a fall from near the wall gains energy
    assert "times the energy of any before" in worst.reason
    release = next(trial for trial in found.vetoes if trial.name == "release")
    assert release.force > 28.0  # all of it, back and forth
    assert release.counts > 100
    assert "3 counts and 0.28 of force are allowed" in release.reason
    assert any(trial.verdict == "settles" for trial in found.trials if trial.rubbing)


def test_unfiltered_mass_keeps_shaking_within_a_count() -> None:
    """M/T² times a count is 6 N: less than a count of motion, newtons of force, for ever."""
    rough = replace(PAPER, velocity_filter_hz=np.inf, acceleration_filter_hz=np.inf)
    (found,) = rehearse(HOMEREHAB, rough)
    shaking = [trial for trial in found.vetoes if trial.name in {"wall", "near wall"}]
    assert shaking
    for trial in shaking:
        assert trial.verdict == "keeps-oscillating"
        assert trial.counts < 3
        assert 1 < trial.force < 28
        assert not trial.rubbing
    assert play(HOMEREHAB, rough, force_allowed=20.0).settles  # what is allowed is the caller's


@pytest.mark.parametrize(("delay", "quiet", "loud"), [(1, 4.25, 7.0), (2, 2.84, 5.0)])
def test_a_damper_switched_against_it_shakes_a_wall_beyond_its_proof_only(
    delay: int, quiet: float, loud: float
) -> None:
    """A wall of so many times 1154 N/m beside a fluid of 82 N·s/m."""
    gain = np.array([quiet, loud])
    beside = Element(stiffness=1154.0 * gain, side=-1), Element(damping=82.0 * gain)
    rig = replace(HOMEREHAB, delay=delay * T, coulomb_friction=0.0)
    walls = Controller(velocity_filter_hz=72.55, beside=beside)
    found = rehearse(rig, walls, force_allowed=10.0, duration=0.6)
    assert [each.settles for each in found] == [True, False]
    assert "damper against it" in {trial.name for trial in found[1].vetoes}


#: HomeRehab's wall of 12 kN/m, and what may be between two of them.
WALL: dict[str, Any] = {"stiffness": 12_000.0, "damping": 70.0, "level": 14.0}
BETWEEN = {
    "nothing": Element(),
    "ice": Element(damping=-6.0, fade_time=0.1),
    "cup": Element(mass=1.0, fade_time=0.1),
    "feather": Element(mass=-0.5, fade_time=0.1),
    "rubber": Element(stiffness=1400.0, level=14.0),
    "water": Element(damping=20.0),
}


def between(name: str, **calls: Any) -> Controller:
    """Two walls as near as they may stand, or one that a hand leans on, and one of these."""
    walls = np.array([1, 0])
    other = replace(Element(**WALL), stiffness=12_000.0 * walls, damping=70.0 * walls, side=walls)
    return Controller(
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
        beside=(Element(**WALL, side=-1), other, BETWEEN[name]),
        calls=Calls(**calls),
    )


@pytest.mark.parametrize("name", BETWEEN)
def test_whatever_is_called_between_walls_it_ends_no_faster_and_comes_to_rest(name: str) -> None:
    late = replace(HOMEREHAB, mass=2.7, damping=9.0, delay=2 * T)
    found = rehearse(
        HOMEREHAB, between(name, taps=12), others=[late], force_allowed=1.0, duration=1.5
    )
    for each in found:
        assert each.settles, each.vetoes[0].reason
        played = {trial.name for trial in each.trials}
        assert {"calls at random", "calls against it"} <= played
        assert ("damper against it" in played) == (name == "water")


def test_a_spring_that_may_act_with_more_while_it_is_strained_is_vetoed() -> None:
    """By the energy that the device is left with."""
    for name in ("nothing", "rubber"):
        (two, one) = rehearse(HOMEREHAB, between(name, taps=0), force_allowed=1.0, duration=1.5)
        for each in (two, one):
            called = [trial for trial in each.vetoes if trial.name == "calls against it"]
            assert [trial.verdict for trial in called] == ["diverges"]
            assert "times the energy it began with" in called[0].reason


def test_a_hand_leans_on_a_wall_and_pushes_beyond_what_it_gives() -> None:
    """Half of what the clamp gives holds; a tenth more moves on, and comes back when let go."""
    wall = Element(stiffness=2000.0, damping=60.0, side=-1, level=10.0)
    law = Controller(velocity_filter_hz=50.0, beside=(wall,))
    found = play(HOMEREHAB, law)
    assert found.settles
    assert of(found, "sustained push") == {"settles"}


def test_another_device_that_it_may_be_is_played_and_named() -> None:
    """40 kN/m is stable with 60 N·s/m and no delay, not with 10 N·s/m and two samples."""
    stout = replace(HOMEREHAB, damping=60.0, delay=0.0)
    spring = Controller(stiffness=40_000.0)
    assert play(stout, spring, duration=0.3).settles
    found = play(stout, spring, others=[replace(HOMEREHAB, delay=2 * T)], duration=0.3)
    assert not found.settles
    words = "without friction, at 3 of mass, 10 of damping and a delay of 0.002 s"
    assert all(words in trial.reason for trial in found.vetoes)
    assert len(found.trials) == 6 * 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rehearse(Rig(mass=[1.0, 2.0], damping=1.0, sample_time=T), PAPER), "at a time"),
        (lambda: rehearse(Rig(mass=1.0, damping=1.0, sample_time=T), PAPER), "or a reach"),
        (
            lambda: rehearse(Rig(mass=1.0, damping=1.0, sample_time=T), PAPER, reach=0.01),
            "no force_limit: give it one, or a push",
        ),
    ],
)
def test_what_cannot_be_rehearsed_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_what_only_creeps_back_settles() -> None:
    """A faint spring in a device full of grease: 33 s to a third, as the linear loop says."""
    grease = Rig(
        mass=0.5, damping=199.0, sample_time=0.0005, encoder_resolution=6.6e-9, force_limit=0.12
    )
    assert play(grease, Controller(stiffness=6.0)).settles
    away = play(grease, Controller(stiffness=-6.0))
    assert of(away, "release") == {"keeps-oscillating"}


def test_a_release_is_no_farther_than_the_spring_brings_back_in_time() -> None:
    """A thousand coarse counts would take 7 s under a spring cut at 22 of them."""
    rig = Rig(
        mass=0.6947,
        damping=10.93,
        delay=0.000875,
        sample_time=0.00021871,
        encoder_resolution=0.0005983,
        force_limit=0.891,
    )
    spring = Element(stiffness=66.86, level=0.891)
    found = play(rig, Controller(beside=(spring,)), duration=2.6, force_allowed=0.049)
    assert of(found, "release") == {"settles"}
