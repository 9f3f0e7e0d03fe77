"""Named devices, scenarios, random fleets and the bundled log."""

from __future__ import annotations

import numpy as np
import pytest

from datasets_synthetic import SCENARIOS, bundled_path, run
from identification import Hardware, load_device, load_document, load_mapping
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
