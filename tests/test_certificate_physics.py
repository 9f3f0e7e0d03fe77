"""Plant, ripple and passivity of the certificate against motions between the samples."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from tune.certificate.claims import damping_for_passivity, ripple_by_integration
from tune.certificate.poles import judge, precision, sampled_plant
from tune.certificate.region import ModePoint, Point, Setting
from tune.documents.certified import HandPlace


def _two_bodies(point: Point) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Motor m₁ and handle m₂ on a spring and damper, the hand on the handle, in their own places.

    States x₁, x₂, ẋ₁, ẋ₂; the same mechanism that the mode of `point` states in modal coordinates.
    """
    mode, hand = point.modes[0], point.hand
    assert hand is not None
    share = mode.at_encoder**2  # m₂/m₁
    first = point.mass / (1 + share)
    second = point.mass - first
    reduced = first * second / point.mass
    omega = 2 * np.pi * mode.frequency_hz
    spring, damper = reduced * omega**2, 2 * mode.damping_ratio * omega * reduced
    stiffness = np.array([[spring, -spring], [-spring, spring + hand.stiffness]])
    # Damping of the rigid motion is spread over both bodies by their masses: it moves no mode.
    loss = np.array([[damper, -damper], [-damper, damper + hand.damping]])
    rigid = np.array([first, second]) / point.mass
    loss += point.damping * np.outer(rigid, rigid)
    inverse = np.diag([1 / first, 1 / (second + hand.mass)])
    motion = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ loss]])
    return motion, np.concatenate([np.zeros(2), inverse @ [1.0, 0.0]])


def _simulated(
    point: Point, motion: NDArray[np.float64], drive: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """x₁ at the samples after one sample of unit force, by the exponential between switchings."""
    step = point.sample_time
    edges = np.array([0.0, step]) + point.delay_samples * step
    times = np.union1d(np.arange(count) * step, edges)
    state, seen = np.zeros(len(drive)), {0.0: 0.0}
    for start, end in pairwise(times):
        force = float(edges[0] <= (start + end) / 2 < edges[1])
        augmented = np.zeros((len(drive) + 1,) * 2)
        augmented[:-1, :-1], augmented[:-1, -1] = motion, drive * force
        state = (expm(augmented * (end - start)) @ np.append(state, 1.0))[:-1]
        seen[float(end)] = float(state[0])
    return np.array([seen[float(t)] for t in np.arange(count) * step])


def _general(delay: float) -> Point:
    """1 kg of motor and 0.5 kg of handle at 40 Hz, in a hand."""
    return Point(
        mass=1.5,
        damping=3.0,
        sample_time=1e-3,
        delay_samples=delay,
        modes=(
            ModePoint(
                frequency_hz=40.0,
                damping_ratio=0.03,
                at_encoder=math.sqrt(0.5),
                at_handle=-math.sqrt(2.0),
            ),
        ),
        hand=HandPlace(mass=0.2, damping=4.0, stiffness=500.0),
    )


@pytest.mark.parametrize("delay", [0.0, 0.35, 1.0, 2.6])
def test_the_general_plant_is_two_bodies_on_a_spring_in_a_hand(delay: float) -> None:
    """The response of the polynomials in z against physical coordinates between the samples."""
    point = _general(delay)
    with precision():
        plant = sampled_plant(point)
        top, bottom = (
            [float(c) for c in p.coeffs()][::-1] for p in (plant.numerator, plant.denominator)
        )
    impulse = np.zeros(60)
    impulse[0] = 1.0
    top = [0.0] * (len(bottom) - len(top)) + top
    exact = _simulated(point, *_two_bodies(point), 60)
    assert not plant.integrates
    np.testing.assert_allclose(
        lfilter(top, bottom, impulse), exact, rtol=0, atol=1e-9 * exact.max()
    )


def test_without_anything_the_exponential_is_the_printed_plant() -> None:
    """A hand that weighs nothing, and a delay that is almost whole."""
    point = Point(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=1.0)
    nothing = HandPlace(mass=0.0, damping=0.0, stiffness=0.0)
    setting = Setting(
        stiffness=2000.0,
        damping=20.0,
        mass=0.5,
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
    )
    radii = [
        judge(each, setting, 1.0).radius
        for each in (
            point,
            replace(point, hand=nothing),
            replace(point, delay_samples=1 + 1e-12),
            replace(point, current_lag=1e-13),
        )
    ]
    np.testing.assert_allclose(radii, radii[0], rtol=1e-9)


def _low_passed(values: NDArray[np.float64], cutoff: float, step: float) -> NDArray[np.float64]:
    """A Butterworth filter of order two by matched poles."""
    pole = np.exp(-2 * np.pi * cutoff * step * (0.7071 + 1j * math.sqrt(1 - 0.7071**2)))
    trace, product = 2 * pole.real, abs(pole) ** 2
    return np.asarray(lfilter([1 - trace + product], [1.0, -trace, product], values))


def test_the_ripple_in_a_hand_is_the_sum_of_its_impulse_response() -> None:
    """C/(1 + GC) played as a filter, in two bodies whose plant is simulated between samples."""
    point = _general(1.35)
    setting = Setting(
        stiffness=300.0,
        damping=5.0,
        mass=0.1,
        velocity_filter_hz=60.0,
        acceleration_filter_hz=40.0,
        velocity_filter_order=2,
        filter_damping_ratio=0.7071,
    )
    count = 4000
    plant = _simulated(point, *_two_bodies(point), count)
    rate = np.diff(np.eye(count), axis=0, prepend=0.0)[:, 0] / point.sample_time
    bend = np.diff(rate, prepend=0.0) / point.sample_time
    law = (
        300.0 * (np.arange(count) == 0)
        + 5.0 * _low_passed(rate, 60.0, point.sample_time)
        + 0.1 * _low_passed(bend, 40.0, point.sample_time)
    )
    # F = -C·(noise + G·F), and G·C begins after at least one sample.
    loop = np.convolve(law, plant)[:count]
    force = np.zeros(count)
    for k in range(count):
        force[k] = -law[k] - np.dot(loop[1 : k + 1], force[:k][::-1])
    seen = ripple_by_integration(point, setting, 1e-5)
    assert seen == pytest.approx(1e-5 * math.sqrt(np.sum(force**2) / 12), rel=1e-3)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_passivity_of_a_spring_and_a_damper_by_the_known_condition(delay: int) -> None:
    """b > K·T/2 + |B| without a delay; a spring alone needs K·T·(1/2 + d) with d samples."""
    spring = Setting(
        stiffness=1000.0,
        damping=0.0,
        mass=0.0,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    needed = damping_for_passivity(spring, 1e-3, delay)
    assert needed == pytest.approx(1000.0 * 1e-3 * (0.5 + delay), rel=1e-6)
    for damping in (20.0, -20.0):
        both = replace(spring, damping=damping)
        assert damping_for_passivity(both, 1e-3) == pytest.approx(0.5 + 20.0, rel=1e-6)
    assert damping_for_passivity(replace(spring, mass=1.0, damping=10.0), 1e-3) == pytest.approx(
        2010.5, rel=1e-6
    )


def test_passivity_with_a_filter_by_the_energy_of_a_motion() -> None:
    """The sampled force takes from a sine at the worst frequency what the needed damping gives."""
    setting = Setting(
        stiffness=500.0,
        damping=15.0,
        mass=0.0,
        velocity_filter_hz=40.0,
        acceleration_filter_hz=None,
    )
    needed = damping_for_passivity(setting, 1e-3)
    unfiltered = damping_for_passivity(replace(setting, velocity_filter_hz=None), 1e-3)
    assert 0.25 < needed < unfiltered
    a = math.exp(-2 * np.pi * 40.0 * 1e-3)
    for angle in np.linspace(0.01, 3.1, 50):
        z = np.exp(1j * angle)
        law = 500.0 + 15.0 * (1 - a) * (z - 1) / (1e-3 * (z - a))
        taken = 1e-3 / 2 * ((1 - 1 / z) * law).real / (1 - math.cos(angle))
        assert taken <= needed * (1 + 1e-9)
