"""Uneven stamps, lost rows and the servo of the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Clock, Faults, Hand, Rig, Servo, simulate
from tests.plain_rigs import B, M, T, rig

FloatArray = NDArray[np.float64]


def step_response(time: FloatArray) -> FloatArray:
    """Position t after a unit force is switched on; zero before."""
    after = np.maximum(time, 0.0)
    return (after + M / B * np.expm1(-B / M * after)) / B


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0075, 0.012, 0.0271])
@pytest.mark.parametrize(
    "clock",
    [Clock(steps=(0.010, 0.012)), Clock(jitter=3e-4), Clock(steps=(0.002, 0.009), jitter=1e-3)],
)
def test_force_acts_from_its_true_stamp_and_delay_on(clock: Clock, delay: float) -> None:
    """Superposition of the step responses of every change, each at its own instant."""
    force = np.random.default_rng(0).uniform(-5, 5, 150)
    recording = simulate(rig(delay=delay), force, clock=clock, seed=3)
    time = recording.time[0]
    changes = np.diff(force, prepend=0.0)
    starts = time + delay
    expected = step_response(time[:, None] - starts[None, :]) @ changes
    np.testing.assert_allclose(
        recording.position[0], expected, rtol=0, atol=2e-9 * np.ptp(expected)
    )


def test_jitter_has_the_stated_size_and_never_runs_backward() -> None:
    recording = simulate(
        rig(), np.ones((2, 5000)), clock=Clock(jitter=np.array([1e-4, 1e-3])), seed=1
    )
    assert np.all(np.diff(recording.time, axis=1) > 0)
    assert not np.any(recording.time[:, 0])
    moved = recording.time - T * np.arange(5000)
    assert np.std(moved[0]) == pytest.approx(1e-4, rel=0.04)
    assert np.max(np.abs(moved[1])) == pytest.approx(0.45 * T)
    assert abs(np.mean(moved[0, 1:] * moved[0, :-1])) < 0.06 * 1e-8  # each by itself


def test_dropped_rows_are_lost_from_the_log_only() -> None:
    force = np.random.default_rng(1).uniform(-5, 5, 4000)
    faults = Faults(position_noise=1e-5)
    whole = simulate(rig(delay=0.001), force, faults=faults, seed=(5, 6)).trajectory(1)
    holed = simulate(rig(delay=0.001), force, faults=faults, clock=Clock(dropped=0.03), seed=(5, 6))
    log = holed.trajectory(1)
    rows = np.searchsorted(whole.time, log.time)
    np.testing.assert_array_equal(whole.time[rows], log.time)
    np.testing.assert_array_equal(whole.force[rows], log.force)
    np.testing.assert_array_equal(whole.position[rows], log.position)
    assert (rows[0], rows[-1]) == (0, 3999)
    lost = 4000 - len(log)
    assert lost == pytest.approx(120, abs=4 * np.sqrt(120))
    assert len(log) != len(holed.trajectory(0)) or np.any(holed.trajectory(0).time != log.time)


def test_servo_force_is_the_stated_difference_equation() -> None:
    reference = 0.02 * np.sin(5 * T * np.arange(1000))
    feed = 0.3 * np.cos(7 * T * np.arange(1000))
    servo = Servo(reference=reference, stiffness=900.0, damping=30.0, velocity_filter_hz=40.0)
    log = simulate(
        rig(encoder_resolution=1e-5), feed, controller=servo, faults=Faults(position_noise=1e-5)
    ).trajectory()
    assert log.reference is not None
    np.testing.assert_array_equal(log.reference, reference)
    pole, velocity = np.exp(-2 * np.pi * 40.0 * T), 0.0
    expected = [900.0 * (reference[0] - log.position[0]) + feed[0]]
    for k in range(1, 1000):
        velocity = pole * velocity + (1 - pole) * (log.position[k] - log.position[k - 1]) / T
        expected.append(900.0 * (reference[k] - log.position[k]) - 30.0 * velocity + feed[k])
    np.testing.assert_allclose(log.force, expected, rtol=1e-9, atol=1e-9)


def test_batch_equals_singles_whatever_is_switched_on() -> None:
    """To rounding: the fastest member of a batch sets the integration steps of all."""
    several = Rig(
        mass=[3.0, 0.5, 0.05],
        damping=[10.0, 2.0, 0.3],
        sample_time=[0.001, 0.0005, 0.002],
        coulomb_friction=[0.5, 0.0, 0.02],
        damping_asymmetry=[2.0, 0.5, 0.0],
        coulomb_asymmetry=[-0.2, 0.0, 0.01],
        stiffness=[0.0, 30.0, 0.2],
        gravity_sine=[0.0, 0.0, 1.5],
        gravity_cosine=[1.0, 0.0, 0.4],
        delay=[0.0004, 0.001, 0.003],
        encoder_resolution=[6e-6, 0.0, 1e-4],
    )
    force = np.random.default_rng(3).standard_normal((3, 400)) * np.array([[5.0], [2.0], [0.5]])
    reference = np.multiply(0.0005, np.cumsum(np.sign(force), axis=1), dtype=np.float64)
    fields: dict[str, Any] = {"mass": 0.1, "stiffness": [50.0, 0.0, 1.0], "tremor": 0.1}
    faults = Faults(position_noise=1e-6, force_noise=0.02, coloured_force=0.05, start_spread=1e-4)
    gains = [300.0, 50.0, 5.0]

    def run(which: list[int], seeds: tuple[int, ...]) -> Any:
        return simulate(
            several.members(which),
            force[which],
            controller=Servo(reference=reference[which], stiffness=np.array(gains)[which]),
            hand=Hand(**{key: np.broadcast_to(value, 3)[which] for key, value in fields.items()}),
            faults=faults,
            clock=Clock(jitter=np.array([1e-4, 0.0, 1e-4])[which], dropped=0.05),
            seed=seeds,
        )

    together = run([0, 1, 2], (11, 12, 13))
    for member in range(3):
        alone = run([member], (11 + member,)).trajectory()
        log = together.trajectory(member)
        for (name, column), (_, single) in zip(log.columns(), alone.columns(), strict=True):
            np.testing.assert_allclose(column, single, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Clock(steps=(0.01, 0.0)), "steps of a clock must be positive"),
        (lambda: Clock(jitter=-1e-4), "jitter must not be negative"),
        (lambda: Clock(dropped=1.0), "dropped must be at least 0 and less than 1"),
        (
            lambda: simulate(
                rig(), np.zeros(300), controller=Servo(reference=np.zeros(200), stiffness=1.0)
            ),
            "the reference has 200 samples, the force 300",
        ),
    ],
)
def test_impossible_clocks_and_references_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
