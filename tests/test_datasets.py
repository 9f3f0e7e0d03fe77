"""Named devices, scenarios, random fleets and the bundled log."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import datasets_synthetic
from datasets_synthetic import (
    SCENARIOS,
    Faults,
    Rig,
    bundled_path,
    fit_to_limits,
    log_text,
    multisine,
    named_rig,
    run,
    run_batch,
    simulate,
)
from datasets_synthetic.scenarios import bundle_texts
from identification import (
    Hardware,
    InvalidInputError,
    load_device,
    load_document,
    load_mapping,
    named_devices,
)
from tests.simulated.fleet import random_devices
from tests.thinned import thinned


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


@pytest.mark.parametrize("name", ["stylus", "knob"])
def test_illustrative_devices_say_that_nothing_was_measured(name: str) -> None:
    device = load_device(name)
    assert device.force_limit is not None
    sources = {device.mass.source, device.damping.source, device.force_limit.source}
    assert sources == {"assumed"}


@pytest.mark.parametrize("name", named_devices())
def test_a_named_rig_is_the_device_without_its_intervals(name: str) -> None:
    device, rig = load_device(name), named_rig(name)
    assert (rig.name, rig.axis, rig.motion) == (device.name, device.axis, device.motion)
    assert rig.batch == 1
    for quantity in ("mass", "damping", "coulomb_friction", "force_offset", "delay"):
        assert getattr(rig, quantity)[0] == getattr(device, quantity).value
    assert device.force_limit is not None
    assert rig.force_limit[0] == device.force_limit.peak


@pytest.mark.parametrize("name", thinned(SCENARIOS, 2))
def test_scenario_stays_within_its_limits_and_moves(name: str) -> None:
    scenario = SCENARIOS[name]
    rig, log = scenario.rig(), run(scenario)
    count = float(rig.encoder_resolution[0])
    assert len(log) == round(scenario.duration / float(rig.sample_time[0]))
    assert (log.axis, log.motion) == (rig.axis, rig.motion)
    assert np.max(np.abs(log.force)) <= (scenario.force or float(rig.force_limit[0])) + 1e-9
    # Noise and friction may carry a device a little beyond the noise-free reach.
    assert np.max(np.abs(log.position)) <= 1.03 * scenario.travel + count
    assert np.ptp(log.position) > 500 * count
    np.testing.assert_allclose(log.position / count, np.rint(log.position / count), atol=1e-6)
    assert scenario.description.endswith(".")


@pytest.mark.parametrize(
    "name", thinned([name for name in SCENARIOS if SCENARIOS[name].force > 0], 2)
)
def test_excitation_reaches_a_limit_and_tells_mass_from_damping(name: str) -> None:
    """Either the travel or the force is used; speed and acceleration are both there."""
    scenario = SCENARIOS[name]
    found = scenario.excitation()
    offset = float(scenario.rig().force_offset[0])
    force = found.force[0] - offset
    peak = np.max(np.abs(force)) + abs(offset)
    assert found.reach[0] >= 0.9 * scenario.travel or peak >= 0.99 * scenario.force
    frequency = 2 * np.pi * np.fft.rfftfreq(force.size, float(scenario.rig().sample_time[0]))
    power = np.abs(np.fft.rfft(force)) ** 2
    corner = float(scenario.rig().damping[0] / scenario.rig().mass[0])
    moved = power / (frequency**2 + corner**2)
    slow = np.sum(moved[frequency < corner]) / np.sum(moved)
    assert 0.02 < slow < 0.98


def test_wall_hit_comes_to_rest() -> None:
    log = run("homerehab-wall")
    friction_holds = 0.8 / 500.0
    assert np.max(np.abs(log.position)) > 5 * friction_holds
    assert np.max(np.abs(log.position[-300:])) < 1.1 * friction_holds


def test_one_simulation_of_many_seeds_equals_many_simulations() -> None:
    together = run_batch("homerehab-wall", (3, 4))
    for member, seed in enumerate((3, 4)):
        alone = run("homerehab-wall", seed=seed)
        np.testing.assert_array_equal(together.position[member], alone.position)
        np.testing.assert_array_equal(together.force[member], alone.force)
    assert np.any(together.position[0] != together.position[1])
    np.testing.assert_array_equal(run("homerehab-wall").position, together.position[0])


def test_an_unknown_scenario_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(InvalidInputError, match="homerehab-clean"):
        run("homerehap")
    with pytest.raises(FrozenInstanceError):
        SCENARIOS["homerehab"].seed = 5  # pyright: ignore[reportAttributeAccessIssue]


def test_multisine_fades_in_has_peak_one_and_a_low_crest() -> None:
    rig = Rig(mass=[3.0, 0.1], damping=[10.0, 1.0], sample_time=[0.001, 0.002])
    force = multisine(rig, 10_000)
    assert force.shape == (2, 10_000)
    np.testing.assert_allclose(np.max(np.abs(force), axis=1), 1.0)
    assert np.all(np.abs(force[:, 0]) < 1e-12)
    assert np.all(np.abs(force[:, :20]) < 0.01)
    assert np.all(1.0 / np.std(force, axis=1) < 3.2)  # a random choice of phases gives about 4


def test_force_that_cannot_move_the_device_is_refused() -> None:
    rig = Rig(mass=1.0, damping=1.0, sample_time=0.001, coulomb_friction=2.0, force_offset=1.0)
    with pytest.raises(ValueError, match="more than its friction 2 is needed"):
        fit_to_limits(rig, multisine(rig, 1000), travel=0.1, force=3.0)


def test_offset_is_cancelled_within_the_force_limit() -> None:
    rig = Rig(mass=1.0, damping=2.0, sample_time=0.001, force_offset=-3.0)
    found = fit_to_limits(rig, multisine(rig, 4000), travel=0.05, force=10.0)
    assert np.max(np.abs(found.force)) <= 10.0
    position = simulate(rig, found.force, position=found.start).position
    assert position.max() == pytest.approx(-position.min())
    assert 0.045 <= position.max() <= 0.05


def test_random_devices_differ_and_stay_within_their_limits() -> None:
    fleet = random_devices(60, 1, samples=3000)
    rig, logs = fleet.rig, fleet.logs()
    assert rig.batch == logs.batch == 60
    assert rig.mass.min() < 0.2
    assert rig.mass.max() > 5
    assert np.all((rig.mass >= 0.05) & (rig.mass <= 20))
    time_constant = rig.mass / rig.damping
    assert np.all((time_constant > 0.0499) & (time_constant < 5.001))
    assert set(rig.sample_time) == {0.0005, 0.001, 0.002}
    np.testing.assert_array_equal(np.unique(np.rint(rig.delay / rig.sample_time)), [0, 1, 2])
    assert 10 < np.count_nonzero(rig.coulomb_friction) < 50
    half_range = np.ptp(logs.position, axis=1) / 2
    assert np.all(half_range <= 0.2 + rig.encoder_resolution)
    assert np.all(half_range >= 900 * rig.encoder_resolution)
    assert np.all(np.abs(logs.force) <= rig.force_limit[:, None])
    for member in range(60):
        step = logs.trajectory(member).sample_time
        assert step == pytest.approx(float(rig.sample_time[member]))


def test_random_devices_depend_on_the_seed_only() -> None:
    first, again, other = (random_devices(5, seed, samples=500) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.excitation.force, again.excitation.force)
    np.testing.assert_array_equal(first.rig.mass, again.rig.mass)
    assert not np.any(first.rig.mass == other.rig.mass)
    noisy = first.logs(faults=Faults(force_noise=0.01), seed=3)
    assert np.any(noisy.position != first.logs().position)


@pytest.mark.long
def test_a_thousand_random_devices_give_a_thousand_logs() -> None:
    fleet = random_devices(1000, 0)
    logs = fleet.logs()
    assert logs.force.shape == (1000, 20_000)
    half_range = np.ptp(logs.position, axis=1) / 2
    assert np.all(half_range >= 900 * fleet.rig.encoder_resolution)
    assert all(len(logs.trajectory(member)) == 20_000 for member in range(1000))


def test_bundled_files_are_what_their_scenario_makes() -> None:
    texts = bundle_texts(SCENARIOS["homerehab"])
    assert sorted(texts) == ["homerehab.csv", "homerehab.hardware.yaml", "homerehab.truth.yaml"]
    for name, text in texts.items():
        assert bundled_path(name).read_text(encoding="utf-8") == text, (
            f"{name} differs from its scenario: python -m datasets_synthetic.scenarios"
        )


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


def test_log_text_prints_every_sample() -> None:
    log = run("homerehab-wall")
    lines = log_text(log).splitlines()
    assert len(lines) == len(log) + 1
    printed = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    for column, (_, values) in zip(printed.T, log.columns(), strict=True):
        np.testing.assert_allclose(column, values, rtol=0, atol=1e-12)
    assert "-0," not in log_text(log)


def test_an_unknown_bundled_file_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"homerehab\.csv"):
        bundled_path("../device.py")


def test_public_names_exist_and_load_lazily() -> None:
    for name in datasets_synthetic.__all__:
        assert getattr(datasets_synthetic, name) is not None
    assert dir(datasets_synthetic) == sorted(datasets_synthetic.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = datasets_synthetic.nothing  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType, reportUnknownMemberType]
    listing = (
        "import sys, datasets_synthetic as d; d.SCENARIOS; d.simulate; d.rehearse;"
        "print(sorted({'scipy', 'scipy.signal', 'casadi', 'matplotlib'} & set(sys.modules)))"
    )
    shown = subprocess.run(
        [sys.executable, "-c", listing], capture_output=True, text=True, check=True
    )
    assert shown.stdout.strip() == "[]"
    bare = "import sys, datasets_synthetic; print('numpy' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", bare], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "False"
