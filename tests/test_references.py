"""The references of a sampled loop against each other: routes that share nothing must agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import arb

from tests.general_loops import draw_case, draw_ray
from tests.reference import (
    boundary_gains,
    crossings,
    reference_loop,
    stable_by_jury,
    stable_by_roots,
)
from tests.sampled_bench import SampledBench
from tests.sampled_loops import Case, loop_along

T = 1e-3
PLAIN = Case(mass=3.0, damping=10.0, sample_time=T)


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("ray", [(1000.0, 10.0, 1.0), (0.0, 10.0, 1.0), (1000.0, 0.0, 0.0)])
def test_the_printed_equation_has_the_boundaries_of_the_matrix_exponential(
    delay: int, ray: tuple[float, float, float]
) -> None:
    """Of a rigid device with filters; the same gains put a root on the unit circle."""
    stiffness, damping, mass = ray
    case = replace(PLAIN, delay_samples=delay, velocity_filter_hz=50.0, acceleration_filter_hz=20.0)
    velocity, acceleration = (float(np.exp(-2 * np.pi * hertz * T)) for hertz in (50.0, 20.0))
    printed = reference_loop(
        case.damping * T / case.mass,
        stiffness * T**2 / case.mass,
        damping * T / case.mass,
        mass / case.mass,
        delay=delay,
        velocity_pole=velocity,
        acceleration_pole=acceleration,
    )
    gains = [float(gain.mid()) for gain in crossings(loop_along(case, *ray))]
    assert gains
    assert [float(gain.mid()) for gain in crossings(printed)] == pytest.approx(gains, rel=1e-9)


def test_boundaries_and_verdicts_do_not_depend_on_how_roots_are_found() -> None:
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(12):
        case = draw_case(rng)
        loop = loop_along(case, *(part and abs(part) for part in draw_ray(rng, case)))
        ends = crossings(loop)
        in_z = [float(gain.mid()) for gain in boundary_gains(loop)]
        assert [float(gain.mid()) for gain in ends] == pytest.approx(in_z, rel=1e-12)
        for end in ends[:2]:
            for factor in (1 - 1e-6, 1 + 1e-6):
                polynomial = loop.at(arb(factor) * end.mid())
                assert stable_by_jury(polynomial) == stable_by_roots(polynomial)
        found += len(ends)
    assert found > 12


def test_one_sample_on_unit_vectors_has_the_limits_of_360_digits() -> None:
    """Mode, hand, lag, a delay of 1.4 samples and filters of second order."""
    case = replace(
        PLAIN,
        delay_samples=1.4,
        current_lag=0.3 * T,
        modes=((60.0, 0.02, 0.5, -1.2),),
        hand=(0.5, 8.0, 400.0),
        velocity_filter_hz=60.0,
        velocity_filter_order=2,
        acceleration_filter_hz=40.0,
        filter_damping_ratio=0.7071,
    )
    bench = SampledBench(
        mass=case.mass,
        damping=case.damping,
        sample_time=T,
        delay=1.4 * T,
        current_lag=case.current_lag,
        modes=case.modes,
        hand=case.hand,
        velocity_filter_hz=60.0,
        velocity_filter_order=2,
        acceleration_filter_hz=40.0,
        filter_damping_ratio=case.filter_damping_ratio,
    )
    for ray, high in (((1.0, 0.0, 0.0), 3e5), ((1000.0, 10.0, 1.0), 300.0)):
        exact = float(crossings(loop_along(case, *ray))[0].mid())
        assert bench.limit(ray, high) == pytest.approx(exact, rel=1e-8)
