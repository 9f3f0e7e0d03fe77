"""Encoder ripple: closed form against known values, integration and a time simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.margin_cases import draw, effects_of, loop_of
from tests.sampled_reference import Sampled
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.rendering import count_jump, force_ripple, handle_vibration


def _homerehab(delay: int, cutoff: float | None) -> Loop:
    return Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=delay,
        filters=Filters(velocity_filter_hz=cutoff, acceleration_filter_hz=cutoff),
    )


@pytest.mark.parametrize(
    ("delay", "cutoff", "printed"),
    [
        (0, None, "4.6"),
        (1, None, "4.2"),
        (2, None, "4.3"),
        (0, 50.0, "0.15"),
        (1, 50.0, "0.15"),
        (1, 20.0, "0.026"),
    ],
)
def test_known_ripple_of_one_kilogram(delay: int, cutoff: float | None, printed: str) -> None:
    """m = 3 kg, b = 10 N·s/m, T = 1 ms, M = 1 kg, 6 µm encoder, to the digits printed."""
    ripple = float(force_ripple(_homerehab(delay, cutoff), Effects(mass=1.0), 6e-6))
    assert f"{ripple:.2g}" == printed


def _compare_with_the_reference(count: int, seed: int) -> None:
    """Force ripple and handle vibration of random loops with all that a mechanism may have."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        case = draw(rng)
        reference = Sampled(case)
        loop, effects = loop_of(case), effects_of(case)
        noise = 6e-6 / 12**0.5
        force = reference.noise_gain(reference.force_numerator) * noise
        handle = reference.noise_gain(reference.handle_numerator) * noise
        assert float(force_ripple(loop, effects, 6e-6)) == pytest.approx(force, rel=1e-9), case
        assert float(handle_vibration(loop, effects, 6e-6)) == pytest.approx(handle, rel=1e-9), case


def test_random_loops_against_a_60_digit_solution() -> None:
    _compare_with_the_reference(25, seed=1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_random_loops_against_a_60_digit_solution_long(seed: int) -> None:
    _compare_with_the_reference(200, seed=100 + seed)


def test_handle_of_a_rigid_device_in_a_long_noisy_run() -> None:
    """The difference equation of a held spring: what the noise makes of the position itself."""
    mass, damping, step, stiffness = 3.0, 10.0, 1e-3, 1000.0
    decay, delta = np.exp(-damping * step / mass), damping * step / mass
    gain = mass / damping**2
    numerator = stiffness * gain * np.array([0.0, decay - 1 + delta, 1 - (1 + delta) * decay])
    closed = np.array([1.0, -1 - decay, decay]) + numerator
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 6e-6 / np.sqrt(12), 4_000_000)
    position = np.asarray(lfilter(numerator, closed, noise))[10_000:]
    ours = float(handle_vibration(_homerehab(0, None), Effects(stiffness=stiffness), 6e-6))
    # A pole of 1.6 1/s forgets in 0.6 s: 4000 s hold some thousand independent pieces.
    assert ours == pytest.approx(float(np.std(position)), rel=0.04)


def test_ripple_broadcasts_and_nothing_moves_without_effects() -> None:
    loop = Loop.from_numbers(mass=np.array([[1.0], [3.0]]), damping=10.0, sample_time=1e-3)
    effects = Effects(stiffness=np.array([100.0, 1000.0]), damping=5.0)
    for measure in (force_ripple, handle_vibration):
        together = measure(loop, effects, 6e-6)
        assert together.shape == (2, 2)
        alone = measure(_homerehab(0, None), Effects(stiffness=1000.0, damping=5.0), 6e-6)
        assert together[1, 1] == pytest.approx(float(alone), rel=1e-12)
        assert np.all(measure(loop, Effects(), 6e-6) == 0)


def test_one_count_commands() -> None:
    """docs/theory.md, 7: 6 mN at K = 1000, 0.06 N at B = 10, 6 N at M = 1 kg on 6 µm and 1 ms."""
    effects = Effects(stiffness=1000.0, damping=10.0, mass=-1.0)
    jump = count_jump(effects, 1e-3, 6e-6)
    found = (jump.stiffness, jump.damping, jump.mass)
    assert found == pytest.approx((6e-3, 0.06, 6.0), rel=1e-12)
    alone = count_jump(Effects(damping=10.0), 1e-3, 6e-6)
    assert (alone.stiffness, alone.mass) == (0.0, 0.0)


@pytest.mark.parametrize("cutoff", [5.0, 50.0, 400.0])
def test_one_count_through_first_order_filters(cutoff: float) -> None:
    """The estimators run as difference equations on a step of one count."""
    step, count = 1e-3, 6e-6
    a = np.exp(-2 * np.pi * cutoff * step)
    position = np.full(2000, count)
    velocity = lfilter([(1 - a) / step, -(1 - a) / step], [1, -a], position)
    acceleration = lfilter([(1 - a) / step, -(1 - a) / step], [1, -a], velocity)
    jump = count_jump(
        Effects(damping=10.0, mass=1.0),
        step,
        count,
        Filters(velocity_filter_hz=cutoff, acceleration_filter_hz=cutoff),
    )
    assert jump.damping == pytest.approx(10 * np.max(np.abs(velocity)), rel=1e-9)
    assert jump.mass == pytest.approx(np.max(np.abs(acceleration)), rel=1e-9)


@pytest.mark.parametrize("cutoff", [5.0, 50.0, 400.0])
def test_one_count_through_butterworth_filters_answers_later(cutoff: float) -> None:
    step, count, zeta = 1e-3, 6e-6, 0.5**0.5
    rate = 2 * np.pi * cutoff * step
    pole = np.exp(-rate * (zeta - 1j * np.sqrt(1 - zeta * zeta)))
    poles = [1, -2 * pole.real, abs(pole) ** 2]
    position = np.full(2000, count)
    velocity = lfilter([sum(poles) / step, -sum(poles) / step], poles, position)
    filters = Filters(velocity_filter_hz=cutoff, velocity_filter_order=2, filter_damping_ratio=zeta)
    jump = count_jump(Effects(damping=10.0), step, count, filters)
    assert jump.damping == pytest.approx(10 * np.max(np.abs(velocity)), rel=1e-9)


def test_one_count_through_a_moving_window() -> None:
    """A window of n samples spreads the count over n: B·Δ/(n·T)."""
    jump = count_jump(Effects(damping=10.0), 1e-3, 6e-6, Filters(velocity_window_samples=15))
    assert jump.damping == pytest.approx(10 * 6e-6 / 15e-3, rel=1e-9)
