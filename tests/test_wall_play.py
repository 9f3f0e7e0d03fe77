"""Walls as they are played: HomeRehab's, by exact motion and by search for what pumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from tests.exact_axis import Axis as ExactAxis
from tests.exact_axis import closed_loop
from tests.wall_axis import Axis, exponential
from tests.wall_cycles import Cycle, Guess, cycle
from tests.wall_gates import faded, pumped, transitions
from tests.wall_play import Array, Bench, Law
from tests.wall_trials import KINDS, Gates, Played, play

T = 1e-3
POLE = float(np.exp(-2 * np.pi * 72.55 * T))
HOMEREHAB = Axis(mass=3.0, damping=10.0, sample_time=T)
#: N/m and N·s/m of its wall; gains with one and two samples of delay up to which every gate is
#: proved, from which some gate pumps, and from which the spring alone does.
K, B = 1154.0, 82.0
PROVED, PUMPED, ALONE = (4.25, 2.84), (5.59, 3.41), (5.7823, 3.4712)


def wall(gain: float | Array, **shape: float | Array) -> Law:
    return Law(stiffness=K * gain, damping=B * gain, velocity_pole=POLE, **shape)


def with_delay(samples: float | Array) -> Axis:
    return replace(HOMEREHAB, delay_samples=samples)


def radius(bench: Bench, damper: float) -> Array:
    return np.max(np.abs(np.linalg.eigvals(transitions(bench, damper, 0.0))), axis=1)


def test_motion_is_exact() -> None:
    """The series of the exponential, and a spring and damper with 1.4 samples of delay."""
    rng = np.random.default_rng(1)
    stack = rng.normal(size=(40, 5, 5)) * 10 ** rng.uniform(-3, 1, (40, 1, 1))
    expected = np.array([expm(each) for each in stack])
    scale = np.max(np.abs(expected), axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(exponential(stack) / scale, expected / scale, atol=1e-11)

    bench = Bench(with_delay(1.4), wall(1.0), places=5)
    bench.start(0.0, 0.2)
    estimate, before = 0.2, -0.2 * T

    def law(_: int, place: Array) -> Array:
        nonlocal estimate, before
        estimate = POLE * estimate + (1 - POLE) * (float(place[0]) - before) / T
        before = float(place[0])
        return -K * place - B * estimate

    # Until the first command arrives, that of the first row acts there and none here.
    exact = ExactAxis(mass=3.0, damping=10.0, sample_time=T, delay=1.4 * T)
    place, force = closed_loop(exact, law, (120, 1), speed=0.2)
    start = float(force[0, 0])
    assert abs(start) < 20
    bench.state = replace(bench.state, forces=np.full((1, 5), start))
    bench.state.forces[:, 0] = start
    own = np.array([[bench.state.plant[0, 0], bench.step(k)[0]] for k in range(120)])
    np.testing.assert_allclose(own[:, 0], place[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(own[:, 1], force[:, 0], rtol=0, atol=1e-8)


def test_restitution_depends_on_the_sampling_phase_alone() -> None:
    """Speed out over speed in: springs, and a spring and damper that only push."""
    stiffness, damping = np.repeat([K, K, 6000.0], 16), np.repeat([0.0, B, 0.0], 16)
    speed = np.tile(np.repeat([0.05, 0.2], 8), 3)
    law = Law(stiffness=stiffness, damping=damping, velocity_pole=POLE, wall=1.0)
    bench = Bench(with_delay(1.0), law, speed.size)
    bench.start(-speed * T * np.tile(np.arange(8) / 8, 6) - 1e-12, speed)
    inside = done = np.zeros(speed.size, dtype=bool)
    out = np.zeros(speed.size)
    for k in range(300):
        bench.step(k)
        inside = inside | (bench.state.plant[:, 0] > 0)
        left = inside & (bench.state.plant[:, 0] <= 0) & ~done
        out[left] = -bench.pace()[left] / speed[left]
        done = done | left
    slow, fast = np.split(out.reshape(3, 16), 2, axis=1)
    np.testing.assert_allclose(slow, fast, rtol=1e-6)
    np.testing.assert_allclose(slow.min(axis=1), [0.798, 0.138, 0.982], atol=1e-3)
    np.testing.assert_allclose(slow.max(axis=1), [0.800, 0.143, 0.986], atol=1e-3)


def test_filters_that_start_from_rest_give_a_blow() -> None:
    """Speed times m/(m + M); estimates that were always running give none.

    The cup, 1.47 kg at 33 Hz, commands 22 N.
    """
    slow = float(np.exp(-2 * np.pi * 33 * T))
    mass = np.array([1.47, -0.3, -1.0, -1.5])
    free = replace(HOMEREHAB, damping=0.0, delay_samples=1.0)
    for running in (False, True):
        bench = Bench(free, Law(mass=mass, acceleration_pole=slow), mass.size)
        bench.start(0.0, 0.2)
        if not running:
            rest = np.zeros(mass.size)
            bench.state = replace(bench.state, speed=rest, first=rest, second=rest)
        force = np.array([bench.step(k) for k in range(400)])
        expected = np.ones(4) if running else 3.0 / (3.0 + mass)
        np.testing.assert_allclose(bench.pace() / 0.2, expected, rtol=1e-6)
        assert np.max(np.abs(force[:, 0])) == pytest.approx(0.0 if running else 21.8, abs=0.1)


def test_gates_pump_from_where_they_were_found_to() -> None:
    """By a periodic gate; a hundredth below none is found, and with a steady gate all is calm."""
    for delay, proved, edge, alone in zip((1.0, 2.0), PROVED, PUMPED, ALONE, strict=True):
        gains = np.array([proved, 0.99 * edge, 1.01 * edge])
        bench = Bench(with_delay(delay), wall(gains), gains.size)
        np.testing.assert_array_equal(pumped(bench, samples=1500) > 1, [False, False, True])
        assert np.all(radius(bench, 0.0) < 1)
        assert np.all(radius(bench, 1.0) < 1)
        edges = Bench(with_delay(delay), wall(np.array([0.9999, 1.0001]) * alone), 2)
        np.testing.assert_array_equal(radius(edges, 0.0) > 1, [False, True])


class Driven(Bench):
    """A device under given forces, one period over and over."""

    forces: Array

    def command(self, y: Array, damper: Array, inertia: Array) -> Array:
        self.count = getattr(self, "count", -1) + 1
        return self.forces[self.count % len(self.forces)][None]


def test_a_wall_and_a_gate_with_a_lasting_cycle() -> None:
    """Linear programs find both, only above where gates pump, and the device does move so."""
    bench = Bench(with_delay(1.0), wall(1.0))
    assert cycle(bench, 0, 0.98 * PUMPED[0], Guess(samples=133)) is None
    gain = 1.01 * PUMPED[0]
    found = cycle(bench, 0, gain, Guess(samples=133))
    assert found is not None
    check_playable(found, gain)
    driven = Driven(with_delay(1.0), Law())
    driven.forces = -(found.spring + found.damper)
    place: list[float] = []
    for k in range(133 * 16):
        place.append(float(driven.state.plant[0, 0]))
        driven.step(k)
    swing = np.array(place[-133:])
    # What the first periods left behind drifts on by less and less.
    error = (swing - swing.mean()) - (found.reading - found.reading.mean())
    assert np.max(np.abs(error)) < 1e-3 * np.ptp(found.reading)


def check_playable(found: Cycle, gain: float) -> None:
    """A nondecreasing spring of slope at most K, and a damper between nothing and B."""
    order = np.argsort(found.reading, kind="stable")
    y, f = found.reading[order], found.spring[order]
    small = 1e-6 * np.ptp(f)
    assert np.all(np.diff(f) >= -small)
    assert np.all(np.diff(y - f / (gain * K)) >= -small / (gain * K))
    rate = (found.reading - np.roll(found.reading, 1)) / T
    speed = np.zeros_like(rate)
    for each in list(rate) * 20:
        speed[:-1], speed[-1] = speed[1:], POLE * speed[-1] + (1 - POLE) * each
    full = gain * B * speed
    assert np.all(found.damper * full >= -small * np.max(np.abs(full)))
    assert np.all(np.abs(found.damper) <= np.abs(full) + 1e-6 * np.max(np.abs(full)))


def played(gain: Array, delay: Array, *, samples: int, seed: int, **how: float) -> Played:
    """HomeRehab's wall with gates, clamps, shapes, speeds and pushes of every kind."""
    members, rng = gain.size, np.random.default_rng(seed)
    shape, gate = rng.integers(0, 4, members), rng.integers(0, len(KINDS), members)
    law = wall(
        gain,
        one_sided=(shape == 1) * 1.0,
        wall=(shape == 2) * 1.0,
        slot=np.where(shape == 3, rng.choice([1e-4, 2e-3], members), 0.0),
        peak=rng.choice([np.inf, 28.0, 6.0], members),
    )
    bench = Bench(with_delay(delay), law, members, places=6)
    speed = rng.choice([0.02, 0.2, 0.5], members)
    bench.start(-speed * T * rng.random(members), speed)
    gates = Gates.drawn(bench, gate, rng)
    push = np.where((shape == 1) | (shape == 2), rng.choice([0.5, 2.0, 4.0], members), 0.0)
    return play(bench, gates, samples=samples, push=push, generator=rng, **how)


def test_nothing_grows_where_it_is_proved() -> None:
    delay = np.tile(np.repeat([1.0, 2.0], 60), 2)
    gain = np.repeat([*PROVED, 7.0, 4.2], 60)
    found = played(gain, delay, samples=800, seed=1)
    calm, wild = np.split(found.grows(), 2)
    assert not calm.any()
    assert np.max(found.ratio[:120]) < 1
    assert np.mean(wild) > 0.1


@pytest.mark.long
@pytest.mark.parametrize(
    ("gain", "seconds", "pumps"), [(1, 0.1, False), (2, 0.1, True), (2, 0.3, False)]
)
def test_a_mass_faded_too_fast_pumps(gain: float, seconds: float, pumps: bool) -> None:
    """5.17 kg beside 238 N/m: a fade is slow from about a quarter of its swing on, 0.26 s."""
    level = np.linspace(0, 1, 41)
    slow = float(np.exp(-2 * np.pi * 5 * T))
    law = Law(stiffness=238.0 * gain, steady_mass=5.17 * gain * level, acceleration_pole=slow)
    bench = Bench(with_delay(1.0), law, level.size)
    assert (faded(bench, round(seconds / T), 1000) > 1) == pumps


@pytest.mark.long
@pytest.mark.parametrize("how", [{}, {"lateness": 1.0}, {"missed": 0.1}, {"missed": 0.5}])
def test_nothing_grows_where_it_is_proved_however_it_is_played(how: dict[str, float]) -> None:
    """Also where samples come up to one later, or periods are missed: at the gain for that."""
    late = bool(how)
    delay = np.repeat([1.0, 1.0 if late else 2.0], 2000)
    gain = np.repeat([PROVED[1] if late else PROVED[0], PROVED[1]], 2000)
    calm = played(gain, delay, samples=5000, seed=2, **how)
    assert not calm.grows().any()
    assert np.max(calm.ratio) < 1
