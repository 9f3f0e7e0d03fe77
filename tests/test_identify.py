"""identify: truth recovered, and intervals that hold it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification import Device, Hardware, Method, Trajectory, as_stored, identify, quantity
from tests.axis_logs import COUNT, HARDWARE, STEP, Array, holds, homerehab, log
from tests.exact_axis import Axis, closed_loop, counted, multisine, positions
from tests.thinned import thinned


def test_clean_logs_are_right_to_a_thousandth() -> None:
    for trajectory in homerehab()[:3]:
        found = identify(trajectory, hardware=HARDWARE)
        assert found.device.mass.value == pytest.approx(3.0, rel=1e-4)
        assert found.device.damping.value == pytest.approx(10.0, rel=1e-4)
        assert found.method == "output-error"
        assert not found.findings


@pytest.mark.long
def test_friction_and_unknown_force_cost_less_than_a_per_cent() -> None:
    for trajectory in homerehab(0.8, disturbance=5e-3)[:3]:
        found = identify(trajectory, hardware=HARDWARE)
        assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)
        assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)
        assert found.device.coulomb_friction.value == pytest.approx(0.8, rel=5e-3)
        assert found.method == "innovations"
        assert not found.findings


@pytest.mark.long
@pytest.mark.parametrize(
    ("coulomb", "disturbance", "noise", "method"),
    [
        (0.0, 0.0, 1e-5, "auto"),
        (0.0, 0.0, 1e-5, "least-squares"),
        (0.8, 5e-3, 0.0, "auto"),
        (0.8, 0.1, 0.0, "auto"),
    ],
)
def test_coverage(coulomb: float, disturbance: float, noise: float, method: Method) -> None:
    """95 % intervals hold the truth in at least 93 % of 300 logs."""
    logs = homerehab(coulomb, disturbance=disturbance, noise=noise, runs=300, seed=1)
    truth = {"mass": 3.0, "damping": 10.0, "coulomb_friction": coulomb, "force_offset": 0.0}
    found = [identify(each, hardware=HARDWARE, method=method) for each in logs]
    assert np.all(np.mean([holds(each, truth) for each in found], axis=0) >= 0.93)


def fleet(runs: int, seed: int) -> tuple[Axis, Array, Array]:
    """Devices of every size in one simulation, with the forces and the positions logged."""
    generator = np.random.default_rng(seed)
    step = float(generator.choice([5e-4, 1e-3, 2e-3]))
    mass = 10 ** generator.uniform(np.log10(0.05), np.log10(20), runs)
    damping = mass * 10 ** generator.uniform(-0.7, 1.5, runs)
    plain = Axis(mass=mass, damping=damping, sample_time=step)
    force = multisine(
        generator, samples=int(8 / step), runs=runs, axis=plain, travel=0.04, peak=1e9
    )
    size = force.std(axis=0)
    rubs = generator.integers(0, 2, runs)
    axis = Axis(
        mass=mass,
        damping=damping,
        coulomb=rubs * size * generator.uniform(0, 0.3, runs),
        offset=size * generator.normal(0, 0.02, runs),
        sample_time=step,
        delay=step * float(generator.integers(0, 3)),
    )
    force = force + axis.offset
    push = rubs * size * 1e-3 * generator.standard_normal(force.shape)
    place = positions(axis, force, disturbance=push)
    return axis, force, counted(place, 10 ** generator.uniform(-6.3, -4.5, runs))


def check_fleet(runs: int, seed: int) -> None:
    axis, force, place = fleet(runs, seed)
    mass, damping = np.asarray(axis.mass), np.asarray(axis.damping)
    for i in range(runs):
        trajectory = log(force[:, i], place[:, i], axis.sample_time)
        for hardware in (Hardware(delay=quantity(axis.delay)), None):
            found = identify(trajectory, hardware=hardware)
            box = found.device.simultaneous_box()
            assert box.mass[0] <= mass[i] <= box.mass[1]
            assert box.damping[0] <= damping[i] <= box.damping[1]
            assert found.device == as_stored(found.device)


@pytest.mark.long
def test_the_simultaneous_box_holds_devices_of_every_size() -> None:
    check_fleet(runs=8, seed=2)


@pytest.mark.parametrize("shape", thinned(["square", "chirp", "prbs", "sine"], 1))
def test_no_usual_excitation_is_refused(shape: str) -> None:
    time = np.arange(12000) * STEP
    generator = np.random.default_rng(3)
    force = {
        "square": 8 * np.sign(np.sin(9.4 * time + 0.1)),
        "prbs": np.repeat(generator.choice([-6.0, 6.0], 120), 100),
        "chirp": 10 * np.sin(2 * np.pi * (0.3 * time + 0.3 * time**2)),
        "sine": 6 * np.sin(6.3 * time),
    }[shape]
    axis = Axis(coulomb=0.8, delay=STEP)
    push = 5e-3 * generator.standard_normal((force.size, 1))
    place = counted(positions(axis, force[:, None], disturbance=push)[:, 0], COUNT)
    found = identify(log(force, place), hardware=HARDWARE)
    assert found.device.mass.value == pytest.approx(3.0, rel=2e-3)
    assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)


def tracked(coulomb: float, push: float) -> tuple[Array, Array]:
    """A loop that follows a reference, closed over the counted position."""
    shape = (12000, 1)
    time = np.arange(shape[0]) * STEP
    wanted = 0.04 * (np.sin(3.1 * time) + 0.4 * np.sin(13.2 * time))
    last = np.zeros(1)

    def law(row: int, place: Array) -> Array:
        nonlocal last
        seen = counted(place, COUNT)
        force = 3000 * (wanted[row] - seen) - 60 * (seen - last) / STEP
        last = seen
        return force

    generator = np.random.default_rng(4)
    disturbance = push * generator.standard_normal(shape)
    place, force = closed_loop(
        Axis(coulomb=coulomb, delay=STEP), law, shape, disturbance=disturbance, speed=0.2
    )
    return force[:, 0], counted(place, COUNT)[:, 0]


@pytest.mark.parametrize(("coulomb", "push"), thinned([(0.8, 5e-3), (0.0, 0.0), (0.8, 0.2)], 1))
def test_a_log_in_closed_loop(coulomb: float, push: float) -> None:
    force, place = tracked(coulomb, push)
    hardware = HARDWARE.model_copy(update={"force_limit": None})
    found = identify(log(force, place), hardware=hardware)
    assert found.device.mass.value == pytest.approx(3.0, rel=3e-3)
    assert found.device.damping.value == pytest.approx(10.0, rel=1e-2)


@cache
def device_of_a_noisy_log() -> tuple[Trajectory, Device]:
    plain = homerehab(0.8, disturbance=5e-3, samples=6000, runs=1)[0]
    return plain, identify(plain).device


def _nothing_changes(force: float, length: float, time: float, shift: float, turn: float) -> None:
    plain, reference = device_of_a_noisy_log()
    # A plausible size of travel and force is all that depends on units.
    allow = ["force-unit"]
    scaled = Trajectory(
        time=plain.time * time + shift,
        force=plain.force * force * turn,
        position=plain.position * length * turn,
    )
    device = identify(scaled, allow=allow).device
    # Turns of a noisy log, and with them the friction, lean on the last digits; where refining
    # them ends does not: less than a thousandth of a half-width, and of the values far less.
    units = (
        (device.mass, reference.mass, force * time**2 / length),
        (device.damping, reference.damping, force * time / length),
        (device.coulomb_friction, reference.coulomb_friction, force),
    )
    for seen, known, unit in units:
        half = (known.high - known.low) / 2
        assert abs(seen.value / unit - known.value) <= 1e-3 * half
        assert (seen.high - seen.low) / unit == pytest.approx(2 * half, rel=1e-2)
    assert device.delay.value == pytest.approx(reference.delay.value * time, rel=1e-2)


#: Sizes of force, length and time, shift of the clock and direction of another log.
CHANGED = given(
    force=st.floats(-2, 2).map(lambda power: 10**power),
    length=st.floats(-3, 3).map(lambda power: 10**power),
    time=st.floats(-1, 1).map(lambda power: 10**power),
    shift=st.floats(-5, 5),
    turn=st.sampled_from([1.0, -1.0]),
)


@settings(max_examples=4)
@CHANGED
def test_units_shifts_and_direction_change_nothing(
    force: float, length: float, time: float, shift: float, turn: float
) -> None:
    _nothing_changes(force, length, time, shift, turn)
