"""Stability verdicts and limits against 60-digit roots, published formulas and known tables."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
import pytest
from flint import arb, arb_poly
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.reference import boundary_gains, reference_loop, roots_of, stable_by_roots
from tests.simulated.experiment import EFFECTS
from tests.thinned import thinned
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.plant import ModeNumbers
from tune.stability.criterion import routh
from tune.stability.verdict import (
    gain_interval,
    is_stable,
    largest,
    safe_gain,
    stable_gains,
    verdict,
)


def _draw_delta(rng: np.random.Generator) -> float:
    lot = rng.random()
    if lot < 0.1:
        return 0.0
    return 10 ** rng.uniform(-12, np.log10(50)) if lot < 0.8 else rng.uniform(50, 700)


def _compare_with_roots(count: int, seed: int) -> Counter[str]:
    """Draw loops of the paper; judge each, a gain between boundaries, and all boundaries."""
    rng = np.random.default_rng(seed)
    tally: Counter[str] = Counter()
    points: list[tuple[float, float, float, float]] = []
    truths: list[bool] = []
    near: list[bool] = []
    for _ in range(count):
        delta = _draw_delta(rng)
        ray = rng.uniform(-3, 8, 3)
        if rng.random() < 0.5:
            ray = np.abs(ray)
        if rng.random() < 0.5:
            ray[0] *= 10 ** rng.uniform(-8, 0)  # a realistic spring: α is small
        loop = reference_loop(delta, *ray)
        boundaries = [float(gain.mid()) for gain in boundary_gains(loop)]
        gains = [(1.0, False)]
        if boundaries:
            index = int(rng.integers(len(boundaries)))
            below = boundaries[index - 1] if index else 0.0
            gains.append((below + (boundaries[index] - below) * rng.uniform(0.01, 0.99), False))
        gains += [
            (boundary * (1 + sign * distance), True)
            for boundary in boundaries
            for distance in (1e-6, 1e-9)
            for sign in (1, -1)
        ]
        for gain, at_boundary in gains:
            point = (delta, float(gain * ray[0]), float(gain * ray[1]), float(gain * ray[2]))
            points.append(point)
            near.append(at_boundary)
            # At the boundary the roots of the exact ray decide; rounding the product is 1e-16.
            exact = loop.at(arb(gain)) if at_boundary else reference_loop(*point).at(arb(1))
            truths.append(stable_by_roots(exact))
    table = np.array(points)
    answers = verdict(
        Loop.dimensionless(table[:, 0]),
        Effects(stiffness=table[:, 1], damping=table[:, 2], mass=table[:, 3]),
    )
    for point, truth, at_boundary, answer in zip(points, truths, near, answers, strict=True):
        single = verdict(
            Loop.dimensionless(point[0]),
            Effects(stiffness=point[1], damping=point[2], mass=point[3]),
        )
        kind = "boundary" if at_boundary else "draw"
        tally[kind] += 1
        tally[f"{kind} stable"] += truth
        for number in (int(answer), int(single)):
            tally["undecided"] += number == 0
            tally["wrong"] += number != 0 and (number > 0) != truth
    return tally


def _accept(tally: Counter[str], count: int) -> None:
    assert tally["wrong"] == 0, tally
    assert tally["draw"] >= count
    assert tally["draw stable"] >= 0.3 * tally["draw"], tally
    assert tally["boundary"] > count, tally
    # 1e-9 from the boundary is meant to be decided, not merely not wrong.
    assert tally["undecided"] <= 1e-4 * tally["boundary"], tally


@pytest.mark.parametrize("count", thinned([150, 300], 1))
def test_no_wrong_verdict_against_60_digit_roots(count: int) -> None:
    _accept(_compare_with_roots(count, seed=1), count)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_no_wrong_verdict_against_60_digit_roots_long(seed: int) -> None:
    _accept(_compare_with_roots(10_000, seed=100 + seed), 10_000)


@pytest.mark.parametrize("missing", thinned(range(1, 7), 3))
def test_every_combination_of_effects_against_roots(missing: int) -> None:
    """The six combinations with something missing, positive and negative, filters and delay."""
    rng = np.random.default_rng(missing)
    absent = [bool(missing >> bit & 1) for bit in range(3)]
    agreed = 0
    stable = 0
    for _ in range(150):
        delta = _draw_delta(rng)
        delay = int(rng.integers(0, 4))
        poles = rng.choice([0.0, 0.5, 0.9], 2)
        values = [0.0 if gone else rng.uniform(-1, 3) * 10 ** rng.uniform(-3, 0) for gone in absent]
        arguments = [None if gone else v for gone, v in zip(absent, values, strict=True)]
        loop = Loop.dimensionless(delta, delay, *poles)
        effects = Effects(stiffness=arguments[0], damping=arguments[1], mass=arguments[2])
        reference = reference_loop(
            delta, *values, delay=delay, velocity_pole=poles[0], acceleration_pole=poles[1]
        )
        if delta == 0 and absent == [True, True, False]:
            truth = False  # nothing damps the velocity: a root stays at z = 1
        else:
            truth = stable_by_roots(reference.at(arb(1)))
        assert bool(is_stable(loop, effects)) == truth
        agreed += 1
        stable += truth
    assert agreed == 150
    assert 15 < stable < 135


def test_two_stable_intervals_and_the_one_connected_to_zero() -> None:
    effects = Effects(stiffness=0.752, damping=0.211, mass=0.576)
    loop = Loop.dimensionless(0.0057)
    low, high = stable_gains(loop, effects)
    assert low == pytest.approx([0, 0.318], abs=2e-3)
    assert high == pytest.approx([0.040, 1.88], abs=2e-3)
    assert gain_interval(loop, effects) == (pytest.approx(low[1]), pytest.approx(high[1]))
    assert float(safe_gain(loop, effects)) == pytest.approx(float(high[0]))


def test_zero_stiffness_is_marginal_but_no_stiffness_is_free() -> None:
    loop = Loop.dimensionless(0.1)
    assert is_stable(loop, Effects(damping=0.1))
    assert not is_stable(loop, Effects(stiffness=0.0, damping=0.1))
    assert verdict(loop, Effects(stiffness=0.0, damping=0.1)) == 0
    assert verdict(loop, Effects(stiffness=-1e-3, damping=0.1)) == -1


def test_undamped_device_cannot_hold_a_spring_but_can_with_a_damper() -> None:
    loop = Loop.from_numbers(mass=3.0, damping=0.0, sample_time=1e-3)
    assert float(largest(loop, "stiffness")) == 0.0
    assert float(largest(loop, "stiffness", Effects(damping=10.0))) > 1000


@given(
    delta=st.floats(1e-6, 2.0),
    ray=st.tuples(*[st.floats(0.01, 3.0)] * 3),
    delay=st.integers(0, 3),
    pole=st.sampled_from([0.0, 0.7]),
)
def test_interval_ends_are_where_60_digit_roots_cross(
    delta: float, ray: tuple[float, float, float], delay: int, pole: float
) -> None:
    loop = Loop.dimensionless(delta, delay, pole, pole)
    effects = Effects(stiffness=ray[0], damping=ray[1], mass=ray[2])
    low, high = stable_gains(loop, effects)
    reference = reference_loop(delta, *ray, delay=delay, velocity_pole=pole, acceleration_pole=pole)
    ends = [float(end) for end in (*low, *high) if end > 0 and np.isfinite(end)]
    for end in ends:
        below = stable_by_roots(reference.at(arb(end * (1 - 1e-9))))
        above = stable_by_roots(reference.at(arb(end * (1 + 1e-9))))
        assert below != above
    crossings = [float(g.mid()) for g in boundary_gains(reference)]
    assert len(ends) <= len(crossings)


@settings(max_examples=40)
@given(
    mass=st.floats(0.05, 50),
    damping=st.floats(0.01, 50),
    step=st.floats(1e-4, 1e-2),
    unit=st.floats(1e-3, 1e3),
)
def test_limits_do_not_depend_on_units(
    mass: float, damping: float, step: float, unit: float
) -> None:
    """Milliseconds for seconds, grams for kilograms: the same physics."""
    plain = Loop.from_numbers(mass=mass, damping=damping, sample_time=step, delay_samples=1)
    other = Loop.from_numbers(
        mass=mass * unit, damping=damping, sample_time=step * unit, delay_samples=1
    )
    for name, power in zip(EFFECTS, (-1, 0, 1), strict=True):
        assert float(largest(other, name)) == pytest.approx(
            float(largest(plain, name)) * unit**power, rel=1e-9
        )


def test_broadcasting_devices_against_effects() -> None:
    loop = Loop.from_numbers(mass=np.array([[1.0], [3.0]]), damping=10.0, sample_time=1e-3)
    stiffness = np.array([100.0, 10_000.0, 30_000.0])
    answer = is_stable(loop, Effects(stiffness=stiffness))
    assert answer.shape == (2, 3)
    assert answer.tolist() == [[True, True, False]] * 2
    limits = largest(loop, "stiffness", Effects(damping=np.array([0.0, 10.0, 50.0])))
    assert limits.shape == (2, 3)
    for row, mass in zip(limits, (1.0, 3.0), strict=True):
        single = Loop.from_numbers(mass=mass, damping=10.0, sample_time=1e-3)
        assert row[1] == pytest.approx(
            float(largest(single, "stiffness", Effects(damping=10.0))), rel=1e-12
        )


def _best_time(action: object, repeats: int) -> float:
    assert callable(action)
    times: list[float] = []
    for _ in range(repeats):
        start = time.thread_time()
        action()
        times.append(time.thread_time() - start)
    return min(times)


def test_a_million_verdicts_cost_at_most_30_ns_each_and_beat_eigenvalues_100_fold() -> None:
    rng = np.random.default_rng(7)
    alpha, beta, gamma = rng.uniform(-3, 8, (3, 1_000_000))
    loop = Loop.dimensionless(0.01)
    effects = Effects(stiffness=alpha, damping=beta, mass=gamma)
    # A processor that is shared is as much slower at ten million plain products, 3.3 ms of one to
    # itself; the best of many turns of both tells by how much.
    first, second, product = rng.uniform(1, 2, (3, 8192))

    def multiply() -> None:
        for _ in range(1221):
            np.multiply(first, second, out=product)

    ours = plain = np.inf
    for _ in range(30):
        ours = min(ours, _best_time(lambda: verdict(loop, effects), 3) / 1e6)
        plain = min(plain, _best_time(multiply, 3))
        if ours <= 30e-9:
            break
    few = Effects(stiffness=alpha[:20_000], damping=beta[:20_000], mass=gamma[:20_000])
    coefficients = loop.polynomial(few)[0]
    companion = np.zeros((20_000, 4, 4))
    companion[:, 0, :] = (-coefficients[3::-1] / coefficients[4]).T
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    theirs = _best_time(lambda: np.linalg.eigvals(companion), 3) / 20_000
    assert ours <= 30e-9 * max(1.0, plain / 3.3e-3)
    assert theirs / ours >= 100


def _built(roots: np.ndarray) -> list[arb]:
    """Coefficients in 360 digits of the real polynomial with these roots and their conjugates."""
    total = arb_poly([1])
    for root in roots:
        real, imaginary = arb(float(root.real)), arb(float(root.imag))
        if root.imag == 0:
            total = total * arb_poly([-real, 1])
        else:
            total = total * arb_poly([real * real + imaginary * imaginary, -2 * real, 1])
    return list(total.coeffs())


def test_any_degree_is_judged_by_its_roots_or_not_at_all() -> None:
    """Clusters, graded and nearly marginal roots up to degree 25; rounded coefficients."""
    rng = np.random.default_rng(4)
    tally = {"stable": 0, "unstable": 0, "open": 0}
    for _ in range(400):
        pairs = int(rng.integers(1, 12))
        modulus = 10 ** rng.uniform(-3, 1, pairs)
        if rng.random() < 0.3:
            modulus[:] = modulus[0] * (1 + 0.1 * rng.standard_normal(pairs))
        angle = rng.uniform(np.pi / 2 + 0.02, np.pi, pairs)
        roots = modulus * np.exp(1j * angle)
        distance = 10 ** rng.uniform(-9, -1) * rng.choice([-1, 1])
        roots[0] = abs(roots[0]) * complex(-distance, 1)
        lone = -(10 ** rng.uniform(-3, 1, int(rng.integers(0, 4)))) + 0j
        exact = _built(np.concatenate([roots, lone]))
        c = np.array([float(x) for x in exact])
        answer = int(routh(c, np.abs(c)))
        # The roots of the rounded coefficients, whose box is what is judged.
        truth = all(root.real < 0 for root in roots_of([arb(x) for x in c]))
        assert answer == 0 or (answer > 0) == truth
        tally["open" if answer == 0 else "stable" if answer > 0 else "unstable"] += 1
    assert min(tally["stable"], tally["unstable"]) > 80, tally
    assert tally["open"] < 160, tally


def test_a_million_verdicts_of_degree_ten_take_at_most_200_ns_each() -> None:
    rng = np.random.default_rng(7)
    values = rng.uniform([[0], [-50], [-2]], [[9e3], [2e3], [20]], (3, 1_000_000))
    mode = ModeNumbers(frequency_hz=80.0, damping_ratio=0.02, at_encoder=0.3, at_handle=-0.5)
    filters = Filters(velocity_filter_hz=60.0, velocity_filter_order=2, acceleration_filter_hz=40.0)
    loop = Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1.5,
        modes=(mode,),
        filters=filters,
    )
    assert loop.degree == 10
    effects = Effects(stiffness=values[0], damping=values[1], mass=values[2])
    # A processor shared with others is as much slower at a hundred million plain products, 33 ms of
    # one to itself; the best of a dozen of both tells by how much.
    first, second, product = rng.uniform(1, 2, (3, 8192))
    least = plain = np.inf
    for _ in range(12):
        start = time.thread_time()
        is_stable(loop, effects)
        middle = time.thread_time()
        for _ in range(12_207):
            np.multiply(first, second, out=product)
        least, plain = min(least, middle - start), min(plain, time.thread_time() - middle)
        if least <= 0.2:
            break
    assert least <= 0.2 * max(1.0, plain / 0.033)
