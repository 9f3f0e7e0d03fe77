"""Encoder and friction at a wall: energy of forced motions, and swings against the simulator."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Rig, simulate
from identification import Device, load_device, quantity
from tune.documents.effects import Effects
from tune.loop.filters import Filters
from tune.margins.limit_cycles import limit_cycle, quantiser_gain
from tune.margins.quantised_passivity import quantised_passivity

FloatArray = NDArray[np.float64]

T = 0.001
#: Of a swing that is followed.
_SAMPLES = 6000


def _device(mass: float, damping: float, friction: float, count: float, late: int = 1) -> Device:
    numbers = {
        "mass": mass,
        "damping": damping,
        "coulomb_friction": friction,
        "encoder_resolution": count,
        "sample_time": T,
        "delay": late * T,
    }
    changed = {name: quantity(number) for name, number in numbers.items()}
    return load_device("homerehab").model_copy(update=changed)


@pytest.mark.parametrize(("late", "b", "c"), [(0, 10.0, 0.8), (0, 10.0, 0.001), (2, 3.0, 0.02)])
def test_a_spring_alone_is_the_published_bound(late: int, b: float, c: float) -> None:
    """min(2b/T, 2c/Δ), with the delay as further hold: passive just below, not just above."""
    device = _device(3.0, b, c, 1e-5, late)
    bound = min(2 * b / ((1 + 2 * late) * T), 2 * c / 1e-5)
    for part, answer in ((0.999, True), (1.001, False)):
        found = quantised_passivity(device, Effects(stiffness=part * bound))
        assert found is not None
        assert found.stiffest_spring == pytest.approx(bound)
        assert found.passive is answer


def test_a_damper_asks_friction_for_its_jump() -> None:
    """Unfiltered B·Δ/T beside K·Δ/2; a filter of pole a leaves (1-a) of it."""
    device = _device(3.0, 100.0, 0.5, 1e-5)
    bare = quantised_passivity(device, Effects(stiffness=800.0, damping=20.0))
    assert bare is not None
    assert bare.friction_needed == pytest.approx(1e-5 * (800.0 / 2 + 20.0 / T))
    filters = Filters(velocity_filter_hz=50.0)
    smooth = quantised_passivity(device, Effects(stiffness=800.0, damping=20.0), filters)
    loss = -np.expm1(-2 * np.pi * 50.0 * T)
    assert smooth is not None
    assert smooth.friction_needed == pytest.approx(1e-5 * (800.0 / 2 + 20.0 * loss / T), rel=1e-6)


def _taken(K: float, B: float, b: float, c: float, count: float, chance: Any) -> float:
    """Least energy (J) that a forced motion puts into a wall read in counts, all motions so far.

    The motion is a sum of sines, followed in small parts of each step; the force is held.
    """
    parts, steps = 40, 400
    time = np.arange(steps * parts) * T / parts
    turns = 2 * np.pi * chance.uniform(0.5, 400.0, 3)
    sizes = count * chance.uniform(0.2, 4.0, 3)
    phases = chance.uniform(0, 2 * np.pi, 3)
    angles = turns[:, None] * time + phases[:, None]
    x, v = sizes @ np.sin(angles), (sizes * turns) @ np.cos(angles)
    reading = np.rint(x[::parts] / count) * count
    slope = np.diff(reading, prepend=reading[0]) / T
    force = np.repeat(K * reading + B * slope, parts)
    power = force * v + b * v**2 + c * np.abs(v)
    spring = K / 2 * count**2  # stored in half a count that the reading hides
    return float((np.cumsum(power) * T / parts).min() + K * x[0] ** 2 / 2 + 2 * spring)


def _needs(K: float, B: float, count: float) -> tuple[float, float]:
    found = quantised_passivity(
        _device(3.0, 10.0, 10.0, count, late=0), Effects(stiffness=K, damping=B)
    )
    assert found is not None
    assert found.damping_needed is not None
    return found.damping_needed, found.friction_needed


def test_no_motion_takes_energy_out_where_it_is_passive() -> None:
    """Without delay, with just the friction that is needed, of sines of a few counts."""
    chance = np.random.default_rng(4)
    K, B, count = 1500.0, 5.0, 1e-4
    b, c = _needs(K, B, count)
    assert min(_taken(K, B, b, c, count, chance) for _ in range(40)) > 0


@pytest.mark.parametrize(("part", "out"), [(0.98, True), (1.02, False)])
def test_some_motion_does_with_less_friction(part: float, out: bool) -> None:
    """To and fro over an edge between two counts, one sample each: in while the force is low."""
    K, B, count, reach = 1500.0, 5.0, 1e-4, 1e-8
    b, c = _needs(K, B, count)
    high, low = K * count + B * count / T, -B * count / T
    loss = 2 * reach * (part * c + b * reach / T)
    assert ((high - low) * reach > loss) is out


def test_the_quantiser_in_the_mean() -> None:
    """Describing functions by Fourier sums of a rounded sine, around a count and around an edge."""
    angle = (np.arange(200_000) + 0.5) * 2 * np.pi / 200_000
    sizes = np.array([0.3, 0.7, 1.4, 6.2])
    for shift, centre in ((0.0, "middle"), (0.5, "edge")):
        read = np.rint(sizes[:, None] * np.sin(angle) + shift)
        seen = 2 * np.mean(read * np.sin(angle), axis=1) / sizes
        found = quantiser_gain(sizes, "middle" if centre == "middle" else "edge")
        np.testing.assert_allclose(found, seen, atol=2e-4)


#: Mass, damping, friction, count; stiffness, damping of the law, its filter: swings on an edge.
SWINGS: list[tuple[Any, ...]] = [
    (3.0, 10.0, 0.0, 1e-4, 1154.0, 0.0, None),
    (3.0, 2.5, 0.005, 1e-4, 1154.0, 0.0, None),
    (3.0, 1.8, 0.002, 1e-4, 1154.0, 0.0, None),
    (0.075, 0.2, 2e-4, 2e-5, 100.0, 0.0, None),
    (3.0, 10.0, 0.01, 1e-4, 5000.0, 0.0, None),
    (3.0, 10.0, 0.0, 1e-4, 2000.0, 400.0, None),
    (3.0, 10.0, 0.0, 1e-4, 1000.0, 82.0, 72.0),
]


#: With friction enough: none.
STILL: list[tuple[Any, ...]] = [
    (3.0, 10.0, 0.05, 1e-4, 1154.0, 0.0, None),
    (3.0, 10.0, 0.8, 6e-6, 1154.0, 82.0, 72.55),
    (3.0, 10.0, 0.7, 6e-6, 5000.0, 0.0, None),
]


@functools.cache
def _simulated() -> tuple[FloatArray, FloatArray]:
    """Half the range in counts and the frequency, Hz, of all cases, pushed so that an edge is the
    middle."""
    mass, damping, friction, count, K, B = np.array([case[:6] for case in SWINGS + STILL]).T
    cutoffs = np.array([case[6] or np.inf for case in SWINGS + STILL])
    log = simulate(
        Rig(
            mass=mass,
            damping=damping,
            coulomb_friction=friction,
            encoder_resolution=count,
            sample_time=T,
            delay=T,
        ),
        np.zeros(_SAMPLES),
        controller=Controller(stiffness=K, damping=B, velocity_filter_hz=cutoffs),
        position=0.9 * count,
        push=np.repeat((K * count / 2)[:, None], _SAMPLES, axis=1),
        watch=True,
    )
    assert log.truth is not None
    tail = log.truth.handle[:, _SAMPLES // 2 :]
    highest, lowest = tail.max(axis=1), tail.min(axis=1)
    above = tail > ((highest + lowest) / 2)[:, None]
    turns = np.count_nonzero(above[:, 1:] & ~above[:, :-1], axis=1)
    return (highest - lowest) / 2 / count, turns / (tail.shape[1] * T)


@pytest.mark.parametrize("number", range(len(SWINGS)))
def test_swings_are_those_of_the_simulator(number: int) -> None:
    """Frequency and amplitude lie in the told ranges or an eighth beyond.

    Amplitude a quarter where a swing lasts fewer than twenty samples.
    """
    mass, damping, friction, count, K, B, cutoff = SWINGS[number]
    device = _device(mass, damping, friction, count)
    effects = Effects(stiffness=K, damping=B or None)
    found = limit_cycle(device, effects, Filters(velocity_filter_hz=cutoff))
    assert found is not None
    amplitude, frequency = (float(each[number]) for each in _simulated())
    low, high = (each / count for each in found.amplitude)
    beyond = 1.25 if frequency * T > 1 / 20 else 1.125
    assert low / beyond < amplitude < beyond * high
    assert found.frequency_hz[0] / 1.125 < frequency < 1.125 * found.frequency_hz[1]


@pytest.mark.parametrize("number", range(len(STILL)))
def test_with_friction_enough_nothing_swings(number: int) -> None:
    mass, damping, friction, count, K, B, cutoff = STILL[number]
    device = _device(mass, damping, friction, count)
    effects = Effects(stiffness=K, damping=B or None)
    assert limit_cycle(device, effects, Filters(velocity_filter_hz=cutoff)) is None
    assert _simulated()[0][len(SWINGS) + number] < 0.001
