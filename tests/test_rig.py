"""The simulator against closed forms and independent integration written out here."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lfilter, tf2zpk
from scipy.special import ellipk

from datasets_synthetic import Clock, Controller, Faults, Rig, RigOfAxes, Servo, Vibration, simulate

FloatArray = NDArray[np.float64]

T = 0.001
M, B = 3.0, 10.0


def rig(**changes: Any) -> Rig:
    """3 kg and 10 N·s/m at 1 kHz, but for what is changed."""
    values: dict[str, Any] = {"mass": M, "damping": B, "sample_time": T}
    return Rig(**values | changes)


def clock(samples: int, step: float = T) -> FloatArray:
    return step * np.arange(samples, dtype=np.float64)


def step_response(time: FloatArray) -> FloatArray:
    """Position t after a unit force is switched on; zero before."""
    after = np.maximum(time, 0.0)
    return (after + M / B * np.expm1(-B / M * after)) / B


def test_constant_force_matches_the_closed_form() -> None:
    position = simulate(rig(), np.full(2000, 5.0)).position[0]
    np.testing.assert_allclose(position, 5.0 * step_response(clock(2000)), rtol=1e-9, atol=1e-15)


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


#: Held in place by friction, so that the reading is its noise.
FIXED = Rig(mass=3.0, damping=10.0, sample_time=T, coulomb_friction=1e12)


def heard(controller: Controller) -> tuple[FloatArray, FloatArray]:
    """Readings from rest at zero, and the force the controller answered with."""
    log = simulate(FIXED, np.zeros(400), controller=controller, faults=Faults(position_noise=1e-3))
    return log.position[0], log.force[0]


def through(reading: FloatArray, numerator: list[float], poles: list[complex]) -> FloatArray:
    """The filter (in powers of 1/z) with these poles, at rest at the first reading before."""
    moved = reading - reading[0]
    return np.asarray(lfilter(numerator, np.real(np.poly(poles)), moved))


def pair(cutoff: float, ratio: float) -> list[complex]:
    angle = ratio + 1j * np.sqrt(1 - ratio**2)
    return [complex(np.exp(-2 * np.pi * cutoff * T * turn)) for turn in (angle, np.conj(angle))]


@pytest.mark.parametrize("ratio", [1.0, 0.7071, 0.2])
def test_second_order_filters_have_the_stated_poles_and_gain_one(ratio: float) -> None:
    controller = Controller(
        damping=7.0,
        mass=0.3,
        velocity_filter_hz=40.0,
        acceleration_filter_hz=25.0,
        velocity_filter_order=2,
        filter_damping_ratio=ratio,
    )
    q, force = heard(controller)
    poles, others = pair(40.0, ratio), pair(25.0, ratio)
    gain, other = (float(np.real(np.prod([1 - p for p in some]))) for some in (poles, others))
    velocity = through(q, [gain / T, -gain / T], poles)
    acceleration = through(q, [other / T**2, -2 * other / T**2, other / T**2], others)
    expected = -(7.0 * velocity + 0.3 * acceleration)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-9 * np.ptp(expected))
    # At the printed damping ratio the poles are those of scipy's matched prototype.
    zeros, found, _ = tf2zpk([gain], np.real(np.poly(poles)))
    assert zeros.size == 0
    turn = np.log(found) / T
    np.testing.assert_allclose(np.abs(turn), 2 * np.pi * 40.0, rtol=1e-6)
    np.testing.assert_allclose(-turn.real / np.abs(turn), ratio, rtol=1e-6)


#: Relative error of one integration step, |h·p|⁴/120 at the default 0.02, with a margin of ten for
#: what adds up over a few hundred samples.
STEP_ERROR = 1e-8


def resisting(truth: dict[str, Any], q: float) -> float:
    """Force of position and offset, N."""
    gravity = truth["gravity_sine"] * np.sin(q) + truth["gravity_cosine"] * np.cos(q)
    return truth["force_offset"] + truth["stiffness"] * q + gravity


def slide(
    truth: dict[str, Any], state: tuple[float, float], pull: float, way: float, left: float
) -> tuple[float, float, float]:
    """Position, speed and time spent until ``left`` s have passed or the device is at rest."""
    damping = truth["damping"] + way * truth["damping_asymmetry"]

    def motion(_: float, now: FloatArray) -> list[float]:
        friction = damping * now[1] + way * truth["coulomb_friction"]
        return [now[1], (pull - friction - resisting(truth, now[0])) / truth["mass"]]

    def at_rest(time: float, now: FloatArray) -> float:
        return way * now[1] if time > 0 else 1.0  # the start from rest is no stop

    setattr(at_rest, "terminal", True)  # noqa: B010 what solve_ivp looks for
    found = solve_ivp(
        motion, (0.0, left), state, events=at_rest, method="DOP853", rtol=1e-11, atol=1e-14
    )
    q, v = (float(value) for value in found.y[:, -1])
    return q, 0.0 if found.status == 1 else v, float(found.t[-1])


def integrated(truth: dict[str, Any], force: FloatArray, start: float) -> FloatArray:
    """The law by an adaptive eighth-order method that stops at every instant of rest."""
    q, v, positions = start, 0.0, np.empty(force.size)
    for k, pull in enumerate(force):
        positions[k] = q
        left = T
        while left > 0:
            way = float(np.sign(v))
            if v == 0:
                net = pull - resisting(truth, q)
                way = float(np.sign(net) * (abs(net) > truth["coulomb_friction"]))
            if way == 0:
                break
            q, v, spent = slide(truth, (q, v), float(pull), way, left)
            left -= spent
    return positions


def test_everything_at_once_matches_an_adaptive_integrator() -> None:
    """Stick and slip, both directions and a curved field: 600 samples of random force."""
    truth: dict[str, Any] = {
        "mass": 0.05,
        "damping": 0.3,
        "damping_asymmetry": 0.1,
        "coulomb_friction": 0.5,
        "force_offset": -0.05,
        "stiffness": 0.8,
        "gravity_sine": 1.5,
        "gravity_cosine": -0.4,
    }
    force = np.repeat(np.random.default_rng(2).uniform(-1.5, 1.5, 20), 30)
    expected = integrated(truth, force, 0.3)
    position = simulate(Rig(**truth, sample_time=T), force, position=0.3).position[0]
    held = np.count_nonzero(np.diff(expected) == 0)
    assert 50 < held < 550  # it does both stick and move
    assert np.min(np.diff(expected)) < 0 < np.max(np.diff(expected))
    np.testing.assert_allclose(position, expected, rtol=0, atol=STEP_ERROR * np.ptp(expected))


def test_a_pendulum_swings_with_the_period_of_the_elliptic_integral() -> None:
    """Without damping it is back where it started after a period, which depends on the swing."""
    starts = np.array([0.1, 1.0, 2.5])
    rate = np.sqrt(1.5 / 0.05)
    period = 4 / rate * ellipk(np.sin(starts / 2) ** 2)
    for start, turn in zip(starts, period, strict=True):
        arm = Rig(mass=0.05, damping=0.0, gravity_sine=1.5, sample_time=turn / 1000)
        position = simulate(arm, np.zeros(1001), position=start).position[0]
        assert position[1000] == pytest.approx(start, rel=1e-9)
        assert position[500] == pytest.approx(-start, rel=1e-7)
        assert abs(position[250]) < 1e-6 * start


SOFT = Vibration(frequency_hz=35.0, damping_ratio=0.02, at_encoder=0.6, at_handle=-1.4)


@pytest.mark.parametrize("turn", [0.05, 1.0, 10.0])
def test_a_mode_of_any_speed_rings_as_the_closed_form_says(turn: float) -> None:
    """ωT up to 10 rad a sample, released by a step of force; e·F/(m·w²)·(1 - e^(-zwt)·(..))."""
    w, z, e = turn / T, 0.02, 0.7
    mode = Vibration(frequency_hz=w / (2 * np.pi), damping_ratio=z, at_encoder=e, at_handle=e)
    samples = 60
    read = simulate(rig(damping=0.0, modes=(mode,)), np.full(samples, 2.0)).position[0]
    time = T * np.arange(samples)
    ring = w * np.sqrt(1 - z * z)
    shape = np.cos(ring * time) + z * w / ring * np.sin(ring * time)
    exact = e * e * 2.0 / (M * w * w) * (1 - np.exp(-z * w * time) * shape)
    rigid = 2.0 / M * time**2 / 2
    np.testing.assert_allclose(read - rigid, exact, rtol=0, atol=1e-9 * np.max(np.abs(exact)))


def test_current_lag_is_an_exponential() -> None:
    lag, samples = 0.8 * T, 40
    free = Rig(mass=1.0, damping=0.0, sample_time=T, current_lag=lag)
    time = T * np.arange(samples)
    exact = time**2 / 2 - lag * time - lag**2 * np.expm1(-time / lag)
    read = simulate(free, np.ones(samples)).position[0]
    np.testing.assert_allclose(read, exact, rtol=1e-11, atol=1e-18)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(SOFT, frequency_hz=0.0), "frequency_hz of a mode must be positive, not 0"),
        (lambda: replace(SOFT, damping_ratio=-0.1), "damping_ratio must not be negative"),
        (lambda: rig(current_lag=-1e-3), "current_lag must be finite and not negative"),
        (
            lambda: rig(modes=(replace(SOFT, at_handle=np.ones(3)),), mass=[1.0, 2.0]),
            r"modes must be of 2 devices or of 1, not \{3\}",
        ),
        (
            lambda: simulate(rig(gravity_sine=1.0, modes=(SOFT,)), np.zeros(5)),
            "only one of the two is simulated",
        ),
        (lambda: simulate(rig(), np.zeros(5), push=np.zeros(4)), "push has 4 samples, force 5"),
        (
            lambda: simulate(rig(mass=[1.0, 2.0]), np.zeros(5), push=np.zeros((3, 5))),
            "batch sizes must agree or be 1",
        ),
        (lambda: rig(mass=0.0), "mass must be positive, not 0"),
        (lambda: rig(delay=-1e-3), "delay must be finite and not negative, not -0.001"),
        (lambda: rig(damping=np.nan), "damping must be finite, not nan"),
        (
            lambda: rig(encoder_resolution=np.inf),
            "encoder_resolution must be finite and not negative",
        ),
        (lambda: rig(force_limit=np.nan), "force_limit must be positive"),
    ],
)
def test_what_no_device_or_run_can_be_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


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


def test_the_handle_moves_by_its_own_share_of_a_mode() -> None:
    """Opposite shares have the rigid motion as their mean; a push there is felt as reciprocal."""
    mode = Vibration(frequency_hz=35.0, damping_ratio=0.02, at_encoder=0.6, at_handle=-0.6)
    log = simulate(rig(modes=(mode,)), np.full(400, 5.0), watch=True)
    assert log.truth is not None
    rigid = 5.0 * step_response(clock(400))
    mean = (log.truth.handle[0, :400] + log.position[0]) / 2
    np.testing.assert_allclose(mean, rigid, rtol=0, atol=1e-9 * np.ptp(rigid))
    pushed = simulate(rig(modes=(mode,)), np.zeros(400), push=np.full(400, 5.0))
    np.testing.assert_allclose(pushed.position[0], log.truth.handle[0, :400], atol=1e-12)
    assert np.max(np.abs(pushed.position[0] - log.position[0])) > 1e-5


def test_an_axis_that_another_one_frees_within_a_sample_starts_at_that_instant() -> None:
    """Pulled by the damping between them: v = F/d·(1 - exp(-d·t/m)) frees it at 3 N, at ln 2/20 s.

    From then on both follow the matrix exponential.
    """
    damping, push, hold = np.array([[20.0, 12.0], [12.0, 15.0]]), 10.0, 3.0
    rig = RigOfAxes(
        mass=np.eye(2)[None],
        damping=damping[None],
        sample_time=1e-3,
        coulomb_friction=np.array([[0.0, hold]]),
    )
    force = np.zeros((1, 101, 2))
    force[..., 0] = push
    played = rig.run(force)
    freed = np.log(2) / 20
    assert np.all(played.truth[0, : int(freed / 1e-3) + 1, 1] == 0)
    law = np.zeros((5, 5))
    law[:2, 2:4], law[2:4, 2:4], law[2:4, 4] = np.eye(2), -damping, (push, hold)
    speed = push / 20 * (1 - np.exp(-20 * freed))
    start = np.array([push / 20 * freed - speed / 20, 0.0, speed, 0.0, 1.0])
    after = expm(law * (0.1 - freed)) @ start
    assert played.truth[0, 100] == pytest.approx(after[:2], rel=1e-7)
    assert played.speed[0, 100] == pytest.approx(after[2:4], rel=1e-6)
