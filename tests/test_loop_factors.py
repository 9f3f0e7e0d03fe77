"""The rooms of the loop one by one: held blocks, quadratic factors, fractions, criterion."""

from __future__ import annotations

import time

import numpy as np
import pytest
from flint import arb, arb_mat, arb_poly

from tests.reference import roots_of
from tune.documents.effects import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.plant import ModeNumbers, block
from tune.loop.polynomials import Polynomial, split_fractions, split_into_quadratics
from tune.stability.criterion import UNIT, routh
from tune.stability.verdict import is_stable, verdict


def _step(a: float, b: float, span: arb) -> tuple[arb, arb]:
    """Position and rate of x'' + a·x' + b·x = 1 after a span, from rest; 360 digits."""
    system = arb_mat([[arb(0), span, arb(0)], [-arb(b) * span, -arb(a) * span, span], [arb(0)] * 3])
    moved = system.exp()
    return moved[0, 2], moved[1, 2]


def _true_block(a: float, b: float, f: float) -> tuple[list[arb], list[arb], list[arb]]:
    """(denominator, position, rate) in w, from b1, b2 and b3 of the shifts."""
    p = (-arb(a)).exp()
    moved = arb_mat([[arb(0), arb(1)], [-arb(b), -arb(a)]]).exp()
    t = moved[0, 0] + moved[1, 1]
    numerators: list[list[arb]] = []
    for which in range(2):
        whole = _step(a, b, arb(1))[which]
        back = _step(a, b, arb(-1))[which]
        new = _step(a, b, 1 - arb(f))[which]
        old = p * _step(a, b, -arb(f))[which]
        numerators.append([whole + p * back, 2 * (new - old), 2 * (new + old) - whole - p * back])
    return [1 - t + p, 2 * (1 - p), 1 + t + p], numerators[0], numerators[1]


def _worst(found: Polynomial, truth: list[arb], index: int) -> float:
    """Largest error in units of roundoff of the sizes."""
    worst = 0.0
    for value, size, exact in zip(found.value[:, index], found.size[:, index], truth, strict=True):
        error = float(abs(arb(float(value)) - exact).mid())
        if error > 1e-100:  # a ball around zero in the reference
            assert size > 0
            worst = max(worst, error / (UNIT * float(size)))
    return worst


def test_held_blocks_from_slow_to_aliased_poles() -> None:
    """ωT from 1e-6 to 10, any damping, double poles, δ up to 700, fractions at both ends."""
    rng = np.random.default_rng(0)
    count = 250
    omega = 10 ** rng.uniform(-6, 1, count)
    ratio = np.where(
        rng.random(count) < 0.5, rng.uniform(0, 1, count), 10 ** rng.uniform(-6, 1, count)
    )
    a, b = 2 * ratio * omega, omega**2
    a[:15] = 0.0
    b[15:60] = 0.0
    a[15:40] = 10 ** rng.uniform(-12, np.log10(700), 25)
    a[60:80] = 2 * omega[60:80]
    b[60:80] = (a[60:80] / 2) ** 2
    f = rng.uniform(0, 1, count)
    f[::7], f[1::7] = 0.0, 1.0
    f[2::7] = 10 ** rng.uniform(-9, 0, f[2::7].size)
    f[3::7] = 1 - 10 ** rng.uniform(-9, 0, f[3::7].size)
    held, whole = block(a, b, f), block(a, b, None)
    worst = 0.0
    for index in range(count):
        triple = (float(a[index]), float(b[index]), float(f[index]))
        denominator, position, rate = _true_block(*triple)
        _, prompt, prompt_rate = _true_block(*triple[:2], 0.0)
        worst = max(
            worst,
            _worst(held.denominator, denominator, index),
            _worst(held.position, position, index),
            _worst(held.rate, rate, index),
            # Without a fraction, 1+w is divided out.
            _worst(whole.position, [prompt[0], prompt[2]], index),
            _worst(whole.rate, [arb(0), prompt_rate[2]], index),
        )
        if omega[index] <= 1:  # nothing cancels in what decides at low frequency
            gain = arb(float(held.position.value[0, index]))
            assert abs(gain / position[0] - 1) < 1e-14
    assert worst <= 16


@pytest.mark.parametrize("zeros", [0, 1, 2])
def test_quadratic_factors_and_fractions_put_together_again(zeros: int) -> None:
    """Graded, damped and undamped factors, roots at zero: product and sum are what they were."""
    rng = np.random.default_rng(zeros)
    for pairs in (2, 3, 5):
        omega = 10 ** rng.uniform(-4, 1, (pairs, 50))
        ratio = 10 ** rng.uniform(-4, 0.5, (pairs, 50))
        b, a = omega**2, 2 * ratio * omega
        b[0] = b[0] if zeros == 0 else 0.0
        a[0] = a[0] if zeros < 2 else 0.0
        one = np.ones(50)
        whole = Polynomial.exact(one).times(
            *(Polynomial.exact(y, x, one) for x, y in zip(a, b, strict=True))
        )
        top = Polynomial.exact(*(10 ** rng.uniform(-2, 0, (2 * pairs - 1, 50))))
        factors = split_into_quadratics(whole)
        again = Polynomial.exact(one).times(*(Polynomial.exact(q.b, q.a, one) for q in factors))
        np.testing.assert_allclose(again.value, whole.value, rtol=1e-13)
        parts = split_fractions(top, factors)
        lines = [Polynomial.exact(q.b, q.a, one) for q in factors]
        terms = [
            part.times(*(line for j, line in enumerate(lines) if j != k))
            for k, part in enumerate(parts)
        ]
        total = terms[0].plus(*terms[1:])
        missing = np.zeros_like(total.value)
        missing[: len(top.value)] = top.value
        assert np.all(np.abs(total.value - missing) <= 200 * UNIT * total.size)


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


def test_a_box_of_coefficients_is_stable_only_as_a_whole() -> None:
    """Sizes as large as the distance to the boundary leave the verdict open."""
    c = np.array([9.0 - 1e-12, 3.0, 3.0, 1.0])  # (9, 3, 3, 1) has roots at ±j√3
    assert routh(c, np.abs(c)) == 1
    assert routh(c, 1e4 * np.abs(c)) == 0
    c[0] = 9.0 + 1e-12
    assert routh(c, np.abs(c)) == -1
    assert routh(c, 1e4 * np.abs(c)) == 0


def _loop_of_degree_ten() -> Loop:
    mode = ModeNumbers(frequency_hz=80.0, damping_ratio=0.02, at_encoder=0.3, at_handle=-0.5)
    return Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1.5,
        modes=(mode,),
        filters=Filters(
            velocity_filter_hz=60.0, velocity_filter_order=2, acceleration_filter_hz=40.0
        ),
    )


def test_many_points_are_judged_like_each_of_them() -> None:
    rng = np.random.default_rng(6)
    loop = _loop_of_degree_ten()
    assert loop.degree == 10
    values = rng.uniform([[0], [-50], [-2]], [[9e3], [2e3], [20]], (3, 20_000))
    for effects in (
        Effects(stiffness=values[0], damping=values[1], mass=values[2]),
        Effects(damping=values[1], mass=values[2]),
        Effects(stiffness=values[0]),
    ):
        many = verdict(loop, effects)
        start = 1 if effects.position_free else 0
        coefficients, sizes = loop.polynomial(effects)
        np.testing.assert_array_equal(many, routh(coefficients[start:], sizes[start:]))
        assert 0.02 < np.mean(many > 0) < 0.98


def test_a_million_verdicts_of_degree_ten_take_at_most_200_ns_each() -> None:
    rng = np.random.default_rng(7)
    values = rng.uniform([[0], [-50], [-2]], [[9e3], [2e3], [20]], (3, 1_000_000))
    loop = _loop_of_degree_ten()
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
