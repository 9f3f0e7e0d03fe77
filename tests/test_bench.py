"""Limits at the simulated bench, standard trials, named devices and the bundled log."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import (
    SCENARIOS,
    Calls,
    Controller,
    Hand,
    Rehearsal,
    Rig,
    Vibration,
    VirtualElement,
    bundled_path,
    named_rig,
    rehearse,
)
from identification import Hardware, load_device, load_document, load_mapping
from tests.reference import Case, crossings, loop_along
from tests.simulated.experiment import limit_by_experiment

FloatArray = NDArray[np.float64]

T = 0.001
DEVICE: dict[str, Any] = {"mass": 3.0, "damping": 10.0, "sample_time": T}
#: Along each effect alone, and along the paper's own setting.
RAYS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1000.0, 10.0, 1.0]])
#: What a bracket of the experiment, and its verdict near the limit, may be off: a third of 1 %.
CLOSE = 1 / 300


def exact_limits(setting: dict[str, Any]) -> FloatArray:
    """Along the four rays, where a pole of the sampled loop reaches the circle, in 360 digits."""
    plain = {name: value for name, value in setting.items() if name != "delay"}
    case = Case(**DEVICE, **plain, delay_samples=setting.get("delay", 0.0) / T)
    rays = [[size or None for size in ray] for ray in RAYS.tolist()]
    return np.array([float(crossings(loop_along(case, *ray))[0].mid()) for ray in rays])


MODE = (60.0, 0.02, 0.5, -1.2)
GRIP = (0.5, 8.0, 400.0)
SECOND: dict[str, Any] = {
    "velocity_filter_hz": 60.0,
    "acceleration_filter_hz": 40.0,
    "velocity_filter_order": 2,
    "filter_damping_ratio": 0.7071,
}


RIGID: tuple[dict[str, Any], ...] = (
    {},
    {"delay": 0.4 * T},
    {"delay": T},
    {"delay": 2.3 * T},
    {"delay": T, "hand": GRIP},
    {"delay": T, "velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
)
FLEXIBLE: tuple[dict[str, Any], ...] = (
    {"delay": T, "modes": (MODE,)},
    {"delay": T, "current_lag": 0.7 * T},
    {"delay": T, **SECOND},
    {"delay": T, "acceleration_filter_hz": 40.0, "acceleration_filter_order": 1},
    {"velocity_window_samples": 15},
    {"delay": 1.4 * T, "hand": GRIP, "modes": (MODE,), "current_lag": 0.3 * T, **SECOND},
)
EVERYTHING: dict[str, Any] = {
    "delay": 0.0,
    "current_lag": 0.0,
    "modes": ((60.0, 0.02, 0.0, 0.0),),
    "hand": (0.0, 0.0, 0.0),
    "velocity_filter_hz": np.inf,
    "acceleration_filter_hz": np.inf,
    "velocity_filter_order": 1,
    "acceleration_filter_order": 2,
    "filter_damping_ratio": 1.0,
    "velocity_window_samples": 1,
}


@pytest.mark.parametrize(
    "settings", [RIGID, FLEXIBLE[-1:], pytest.param(FLEXIBLE, marks=pytest.mark.long)]
)
def test_the_limit_of_a_linear_loop_is_found_at_the_bench(
    settings: tuple[dict[str, Any], ...],
) -> None:
    """K, B, M and (1000, 10, 1)·s of every setting, all in one batch."""
    exact = np.concatenate([exact_limits(each) for each in settings])
    each_ray = np.repeat(np.arange(len(settings)), len(RAYS))

    def values(name: str) -> NDArray[Any]:
        """One a member, shape (members,) or (members, numbers)."""
        chosen = [each.get(name, EVERYTHING[name]) for each in settings]
        return np.array(chosen)[each_ray]

    f, z, e, h = values("modes")[:, 0].T
    mode = Vibration(frequency_hz=f, damping_ratio=z, at_encoder=e, at_handle=h)
    mass, damping, stiffness = values("hand").T
    K, B, M = np.tile(RAYS, (len(settings), 1)).T
    kept = [name for name in EVERYTHING if "_" in name and name != "current_lag"]
    filters: dict[str, Any] = {name: values(name) for name in kept}
    found = limit_by_experiment(
        Rig(
            **DEVICE,
            delay=values("delay"),
            current_lag=values("current_lag"),
            modes=() if settings is RIGID else (mode,),
        ),
        Controller(stiffness=K, damping=B, mass=M, **filters),
        hand=Hand(mass=mass, damping=damping, stiffness=stiffness),
        between=(exact / 31, exact * 4.3),  # so that the exact limit is no special gain
        samples=3000,
        trials=20,
        rounds=3,
    )
    assert np.all(found.width < CLOSE)
    np.testing.assert_allclose(found.middle, exact, rtol=CLOSE)


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


@pytest.mark.parametrize("offset", [0.02, -0.5])
def test_what_is_pushed_settles_as_long_as_any_damping_holds_it(offset: float) -> None:
    """However it gets to its speed; what runs away does not, even if the force limit ends that."""
    law = Controller(damping=np.array([-5.0, -11.0, -30.0]), **FILTERED)
    found = rehearse(replace(HOMEREHAB, force_offset=offset), law)
    assert [each.settles for each in found] == [True, False, False]


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
    beside = VirtualElement(stiffness=1154.0 * gain, side=-1), VirtualElement(damping=82.0 * gain)
    rig = replace(HOMEREHAB, delay=delay * T, coulomb_friction=0.0)
    walls = Controller(velocity_filter_hz=72.55, beside=beside)
    found = rehearse(rig, walls, force_allowed=10.0, duration=0.6)
    assert [each.settles for each in found] == [True, False]
    assert "damper against it" in {trial.name for trial in found[1].vetoes}


#: HomeRehab's wall of 12 kN/m, and what may be between two of them.
WALL: dict[str, Any] = {"stiffness": 12_000.0, "damping": 70.0, "level": 14.0}
BETWEEN = {
    "nothing": VirtualElement(),
    "ice": VirtualElement(damping=-6.0, fade_time=0.1),
    "cup": VirtualElement(mass=1.0, fade_time=0.1),
    "feather": VirtualElement(mass=-0.5, fade_time=0.1),
    "rubber": VirtualElement(stiffness=1400.0, level=14.0),
    "water": VirtualElement(damping=20.0),
}


def between(name: str, **calls: Any) -> Controller:
    """Two walls as near as they may stand, or one that a hand leans on, and one of these."""
    walls = np.array([1, 0])
    other = replace(
        VirtualElement(**WALL), stiffness=12_000.0 * walls, damping=70.0 * walls, side=walls
    )
    return Controller(
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
        beside=(VirtualElement(**WALL, side=-1), other, BETWEEN[name]),
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


@pytest.mark.parametrize("offset", [0.0, 6.0])
def test_a_hand_leans_on_a_wall_and_pushes_beyond_what_it_gives(offset: float) -> None:
    """Half of what the clamp gives holds; a tenth more moves on, and comes back when let go.

    It leans, too, where the device itself pulls it away.
    """
    wall = VirtualElement(stiffness=2000.0, damping=60.0, side=-1, level=10.0)
    law = Controller(velocity_filter_hz=50.0, beside=(wall, VirtualElement(damping=80.0)))
    found = play(replace(HOMEREHAB, force_offset=offset), law)
    assert found.settles
    assert of(found, "sustained push") == {"settles"}


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
    spring = VirtualElement(stiffness=66.86, level=0.891)
    found = play(rig, Controller(beside=(spring,)), duration=2.6, force_allowed=0.049)
    assert of(found, "release") == {"settles"}


def test_emps_is_the_published_model() -> None:
    device = load_device("emps")
    assert device.mass.value == 95.109
    assert device.damping.value == 203.5
    assert device.coulomb_friction.value == 20.394
    assert device.force_offset.value == -3.165
    for item, deviation in (
        (device.mass, 0.109),
        (device.damping, 1.15),
        (device.coulomb_friction, 0.101),
        (device.force_offset, 0.044),
    ):
        wide = 4 * 1.96 * deviation
        assert item.high - item.value == pytest.approx(wide, rel=0.002)
        assert item.value - item.low == pytest.approx(wide, rel=0.002)
    assert device.force_limit is not None
    assert device.force_limit.peak == pytest.approx(35.1507 * 10)
    assert device.force_limit.source == "assumed"


def test_bundled_log_is_small_exact_and_beside_its_truth() -> None:
    path = bundled_path("homerehab.csv")
    assert path.stat().st_size < 350_000
    time, force, position = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    assert path.read_text(encoding="utf-8").startswith("time,force,position\n")
    np.testing.assert_allclose(time, np.arange(8000) / 1000, rtol=1e-15)
    np.testing.assert_allclose(force * 1000, np.rint(force * 1000), rtol=0, atol=1e-9)
    np.testing.assert_allclose(position / 6e-6, np.rint(position / 6e-6), rtol=0, atol=1e-9)
    truth = load_mapping(bundled_path("homerehab.truth.yaml"))
    assert truth["scenario"] == "homerehab"
    assert truth["seed"] == SCENARIOS["homerehab"].seed
    assert (truth["mass"], truth["damping"], truth["coulomb_friction"]) == (3.0, 10.0, 0.8)
    assert truth["faults"] == {"position_noise": 0.0, "force_noise": 0.005}
    hardware = load_document(Hardware, bundled_path("homerehab.hardware.yaml"))
    assert hardware.delay is not None
    assert hardware.delay.value == truth["delay"] == 0.001
    assert hardware.encoder_resolution is not None
    assert hardware.encoder_resolution.value == 6e-6
    assert hardware.force_limit is not None
    assert (hardware.force_limit.continuous, hardware.force_limit.peak) == (14.0, 28.0)
