"""The simulator against closed forms written out here, and against its own stated error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Faults, Rig, simulate
from identification import LogRefusedError

FloatArray = NDArray[np.float64]

T = 0.001
M, B = 3.0, 10.0


def rig(**changes: Any) -> Rig:
    values: dict[str, Any] = {"mass": M, "damping": B, "sample_time": T}
    return Rig(**values | changes)


def clock(samples: int, step: float = T) -> FloatArray:
    return step * np.arange(samples, dtype=np.float64)


def step_response(time: FloatArray, mass: float = M, damping: float = B) -> FloatArray:
    """Position t after a unit force is switched on; zero before."""
    after = np.maximum(time, 0.0)
    return (after + mass / damping * np.expm1(-damping / mass * after)) / damping


def test_constant_force_matches_the_closed_form() -> None:
    position = simulate(rig(), np.full(2000, 5.0)).position[0]
    np.testing.assert_allclose(position, 5.0 * step_response(clock(2000)), rtol=1e-9, atol=1e-15)


def test_undamped_and_negatively_damped_devices_match_their_closed_forms() -> None:
    time = clock(1000)
    position = simulate(Rig(mass=M, damping=[0.0, -2.0], sample_time=T), np.ones(1000)).position
    np.testing.assert_allclose(position[0], time**2 / (2 * M), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        position[1], step_response(time, damping=-2.0), rtol=1e-9, atol=1e-13
    )


def test_initial_velocity_coasts_to_the_known_distance() -> None:
    time = clock(3000)
    position = simulate(rig(), np.zeros(3000), position=0.1, velocity=0.2).position[0]
    coasting = 0.1 - 0.2 * M / B * np.expm1(-B / M * time)
    np.testing.assert_allclose(position, coasting, rtol=1e-9)


def test_offset_acts_against_the_force() -> None:
    position = simulate(rig(force_offset=2.0), np.full(500, 5.0)).position[0]
    np.testing.assert_allclose(position, 3.0 * step_response(clock(500)), rtol=1e-9, atol=1e-15)


def test_sine_matches_the_closed_form() -> None:
    """m·q̈ + b·q̇ = A·sin(ωt) from rest.

    Held from the middle of each step h the force differs from the sine in the order h², which two
    runs, h and h/2, extrapolate away.
    """
    omega, amplitude = 2 * np.pi * 2.0, 6.0

    def held(step: float) -> FloatArray:
        time = clock(round(2.0 / step), step)
        device = Rig(mass=M, damping=B, sample_time=step)
        return simulate(device, amplitude * np.sin(omega * (time + step / 2))).position[0]

    coarse, fine = held(4e-4), held(2e-4)[::2]
    time = clock(coarse.size, 4e-4)
    square = B**2 + (M * omega) ** 2
    steady = -amplitude * (M * omega * np.sin(omega * time) + B * np.cos(omega * time))
    steady /= omega * square
    transient = -amplitude * M**2 * omega / (B * square) * np.exp(-B / M * time)
    exact = steady + transient + amplitude / (B * omega)
    size = np.ptp(exact)
    np.testing.assert_allclose((4 * fine - coarse) / 3, exact, rtol=0, atol=1e-10 * size)
    assert np.max(np.abs(fine - exact)) < (omega * 2e-4) ** 2 * size


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 1.37, 2.0, 3.999])
def test_delay_shifts_the_force_by_any_fraction_of_a_sample(delay: float) -> None:
    force = np.random.default_rng(0).uniform(-5, 5, 150)
    position = simulate(rig(delay=delay * T), force).position[0]
    time = clock(150)
    changes = np.diff(force, prepend=0.0)
    expected = sum(
        change * step_response(time - k * T - delay * T) for k, change in enumerate(changes)
    )
    np.testing.assert_allclose(position, expected, rtol=0, atol=1e-9 * np.ptp(position))


def test_delay_is_between_the_logged_command_and_its_action() -> None:
    force = np.zeros(50)
    force[10] = 1.0
    recording = simulate(rig(delay=2 * T), force)
    np.testing.assert_array_equal(recording.force[0], force)
    assert np.flatnonzero(recording.position[0])[0] == 13  # acts on [12T, 13T), seen at 13T


def test_coulomb_friction_alone_stops_after_the_known_distance() -> None:
    """Constant deceleration Fc/m: distance v0²·m/(2Fc), wherever in a sample it ends."""
    speeds = np.array([0.05, 0.1, 0.1234567, -0.2])
    position = simulate(
        Rig(mass=M, damping=0.0, sample_time=T, coulomb_friction=0.8),
        np.zeros(1000),
        velocity=speeds,
    ).position
    distance = np.sign(speeds) * speeds**2 * M / (2 * 0.8)
    np.testing.assert_allclose(position[:, -1], distance, rtol=1e-12)
    stopping = np.abs(speeds) * M / 0.8
    time = clock(1000)[None, :]
    gone = np.minimum(time, stopping[:, None])
    decelerating = np.sign(speeds)[:, None] * (
        np.abs(speeds)[:, None] * gone - 0.8 / M * gone**2 / 2
    )
    np.testing.assert_allclose(position, decelerating, rtol=1e-11, atol=1e-15)


def test_friction_takes_the_energy_that_the_closed_form_says() -> None:
    """With viscous damping too: distance (m/b)·(v0 - (Fc/b)·ln(1 + b·v0/Fc))."""
    position = simulate(rig(coulomb_friction=0.8), np.zeros(1500), velocity=0.3).position[0]
    distance = M / B * (0.3 - 0.8 / B * np.log1p(B * 0.3 / 0.8))
    assert position[-1] == pytest.approx(distance, rel=1e-9)
    assert position[-1] == position[-200]


def test_held_below_coulomb_friction_and_moving_above() -> None:
    force = np.array([0.8 * 0.999, 0.8, 0.8 * 1.001, -0.8 * 1.001])[:, None] * np.ones(300)
    position = simulate(rig(coulomb_friction=0.8), force).position
    assert not np.any(position[:2])
    excess = 0.8 * 0.001
    np.testing.assert_allclose(position[2], excess * step_response(clock(300)), rtol=1e-8)
    np.testing.assert_allclose(position[3], -position[2], rtol=1e-12)


def test_force_turns_a_moving_device_round_inside_a_sample() -> None:
    """Against the motion Fc adds to the force, after the reversal it is taken off."""
    against, back = (2.0 + 0.8) / M, (2.0 - 0.8) / M
    speed = 0.01234
    time = clock(400)
    position = simulate(
        Rig(mass=M, damping=0.0, sample_time=T, coulomb_friction=0.8),
        np.full(400, -2.0),
        velocity=speed,
    ).position[0]
    turn = speed / against
    assert (turn / T) % 1 > 0.1
    before = speed * time - against * time**2 / 2
    after = speed * turn / 2 - back * (time - turn) ** 2 / 2
    np.testing.assert_allclose(
        position, np.where(time < turn, before, after), rtol=1e-11, atol=1e-15
    )


def test_reversal_is_found_to_the_last_digits_on_a_heavily_damped_device() -> None:
    """v = (v0 + c)·e^(-pt) - c with c = (F + Fc)/b up to rest, then from rest with F - Fc."""
    mass, damping, friction, push = 0.5, 9.0, 0.3, 1.0
    speeds = np.linspace(0.01, 0.02, 40)
    position = simulate(
        Rig(mass=mass, damping=damping, sample_time=T, coulomb_friction=friction),
        np.full(200, -push),
        velocity=speeds,
    ).position
    rate, ends = damping / mass, (push + friction) / damping
    turn = np.log1p(speeds / ends) / rate
    place = speeds / rate - ends * turn
    after = clock(200)[None, :] - turn[:, None]
    back = place[:, None] - (push - friction) * step_response(after, mass, damping)
    late = after > 0
    np.testing.assert_allclose(position[late], back[late], rtol=2e-9, atol=2e-9 * 0.02 / rate)


def test_encoder_rounds_to_whole_counts() -> None:
    force = np.full(1000, 4.0)
    exact = simulate(rig(), force).position[0]
    read = simulate(rig(encoder_resolution=6e-6), force).position[0]
    np.testing.assert_allclose(read / 6e-6, np.rint(read / 6e-6), atol=1e-9)
    assert np.max(np.abs(read - exact)) <= 3e-6 * (1 + 1e-9)
    assert np.std(read - exact) == pytest.approx(6e-6 / np.sqrt(12), rel=0.1)


def test_force_is_logged_and_applied_as_limited() -> None:
    limited = simulate(rig(force_limit=2.0), np.full(400, 5.0))
    np.testing.assert_array_equal(limited.force, 2.0)
    np.testing.assert_allclose(
        limited.position[0], 2.0 * step_response(clock(400)), rtol=1e-9, atol=1e-15
    )
    closed = simulate(
        rig(force_limit=2.0), np.zeros(100), controller=Controller(stiffness=1e4), position=0.01
    )
    assert closed.force[0, 0] == -2.0


def test_noise_has_the_stated_size_and_place() -> None:
    quiet = simulate(rig(), np.zeros(20_000)).position[0]
    noisy = simulate(rig(), np.zeros(20_000), faults=Faults(position_noise=1e-4)).position[0]
    assert np.std(noisy - quiet) == pytest.approx(1e-4, rel=0.03)
    light = Rig(mass=0.01, damping=B, sample_time=T)  # comes to rest within a sample or so
    pushed = simulate(light, np.zeros((400, 400)), faults=Faults(force_noise=0.5))
    assert not np.any(pushed.force)
    wandered = np.std(pushed.position[:, -1])
    assert wandered == pytest.approx(0.5 * T / B * np.sqrt(400), rel=0.12)


def test_same_seed_same_log_other_seed_other_log() -> None:
    faults = Faults(position_noise=1e-5, force_noise=0.1)
    first, again, other = (
        simulate(rig(), np.ones(300), faults=faults, seed=seed).position for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    assert np.all(first[0] != other[0])
    spread = simulate(rig(), np.ones((3, 300)), faults=faults, seed=7).position
    np.testing.assert_array_equal(spread[0], first[0])
    assert np.all(spread[0] != spread[1])


def test_batch_equals_singles() -> None:
    several = Rig(
        mass=[3.0, 0.5, 10.0],
        damping=[10.0, 0.0, 30.0],
        sample_time=[0.001, 0.0005, 0.002],
        coulomb_friction=[0.0, 0.05, 2.0],
        force_offset=[0.0, 0.3, -1.0],
        delay=[0.0, 0.00071, 0.004],
        encoder_resolution=[6e-6, 0.0, 1e-5],
        force_limit=[14.0, 3.0, np.inf],
    )
    force = np.random.default_rng(3).standard_normal((3, 1000)) * np.array([[5.0], [2.0], [20.0]])
    gains: dict[str, Any] = {
        "stiffness": [100.0, 20.0, 500.0],
        "damping": [5.0, 0.0, 20.0],
        "mass": [1.0, 0.1, 0.0],
        "velocity_filter_hz": [50.0, np.inf, 30.0],
        "acceleration_filter_hz": [20.0, 40.0, np.inf],
    }
    faults = Faults(position_noise=1e-6, force_noise=0.02)
    arrays: dict[str, Any] = {name: np.array(values) for name, values in gains.items()}
    together = simulate(
        several,
        force,
        controller=Controller(**arrays),
        faults=faults,
        seed=(11, 12, 13),
    )
    for member in range(3):
        alone = simulate(
            several.members([member]),
            force[member],
            controller=Controller(**{name: values[member] for name, values in gains.items()}),
            faults=faults,
            seed=11 + member,
        )
        np.testing.assert_array_equal(together.position[member], alone.position[0])
        np.testing.assert_array_equal(together.force[member], alone.force[0])
        log = together.trajectory(member)
        assert log.sample_time == pytest.approx(float(several.sample_time[member]))
        assert len(log) == 1000


def test_finer_steps_change_no_more_than_the_stated_error() -> None:
    """|h·p|⁴/120 of the motion, and of fourth order, on a device as fast as its sampling."""
    fast = Rig(mass=0.05, damping=10.0, sample_time=0.002, delay=0.0007)
    force = np.random.default_rng(5).uniform(-1, 1, 500)
    finest = simulate(fast, force, largest_step=0.0025).position

    def error(largest_step: float) -> float:
        return float(
            np.max(np.abs(simulate(fast, force, largest_step=largest_step).position - finest))
        ) / float(np.max(np.abs(finest)))

    assert error(0.02) < 0.02**4 / 120
    assert error(0.26) / error(0.13) == pytest.approx(16, rel=0.3)
    default = simulate(fast, force).position
    np.testing.assert_array_equal(default, simulate(fast, force, largest_step=0.02).position)


def test_filters_are_the_stated_difference_equations() -> None:
    """Held in place by friction, so that the reading is noise only and the forces can be redone."""
    fixed = Rig(mass=M, damping=B, sample_time=T, coulomb_friction=1e9)
    effects = Controller(
        stiffness=100.0, damping=7.0, mass=0.3, velocity_filter_hz=40.0, acceleration_filter_hz=25.0
    )
    log = simulate(fixed, np.full(300, 0.5), controller=effects, faults=Faults(position_noise=1e-3))
    q = log.position[0]
    pole, other = np.exp(-2 * np.pi * 40.0 * T), np.exp(-2 * np.pi * 25.0 * T)
    velocity = slope = acceleration = 0.0
    expected = [0.5 - 100.0 * q[0]]
    for k in range(1, 300):
        change = (q[k] - q[k - 1]) / T
        velocity = pole * velocity + (1 - pole) * change
        last, slope = slope, other * slope + (1 - other) * change
        acceleration = other * acceleration + (1 - other) * (slope - last) / T
        expected.append(0.5 - 100.0 * q[k] - 7.0 * velocity - 0.3 * acceleration)
    np.testing.assert_allclose(log.force[0], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": 0.0}, "mass must be positive, not 0"),
        ({"delay": -1e-3}, "delay must be finite and not negative, not -0.001"),
        ({"damping": np.nan}, "damping must be finite, not nan"),
        ({"encoder_resolution": np.inf}, "encoder_resolution must be finite and not negative"),
        ({"force_limit": np.nan}, "force_limit must be positive"),
    ],
)
def test_impossible_devices_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rig(**changes)


def test_disagreeing_batches_are_refused() -> None:
    with pytest.raises(ValueError, match="batch sizes must agree"):
        simulate(rig(), np.zeros((3, 10)), velocity=np.zeros(2))


def test_arrays_are_read_only() -> None:
    recording = simulate(rig(), np.zeros(10))
    for array in (recording.position, recording.force, recording.sample_time, rig().mass):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_a_diverged_loop_is_no_log() -> None:
    recording = simulate(rig(), np.zeros(5000), controller=Controller(stiffness=1e8), position=1e-3)
    with pytest.raises(LogRefusedError, match="non-finite"):
        recording.trajectory()
