"""Parts and whole of a loop, arrays and single devices, units and signs: the same answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.general_loops import MODE, draw_case, draw_ray, effects_at, loop_of
from tune.documents.scene import Effects
from tune.loop.loop import Loop
from tune.loop.plant import HandNumbers
from tune.stability.verdict import largest, safe_gain


def test_arrays_of_devices_are_judged_like_each_of_them() -> None:
    rng = np.random.default_rng(9)
    masses, hands = rng.uniform(0.5, 5, 6), 10 ** rng.uniform(1, 3, (4, 1))
    many = Loop.from_numbers(
        mass=masses,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1.4,
        modes=(MODE,),
        hand=HandNumbers(mass=0.1, damping=5.0, stiffness=hands),
    )
    limits = largest(many, "stiffness", Effects(damping=5.0))
    assert limits.shape == (4, 6)
    for row in (0, 3):
        for column in (0, 5):
            single = Loop.from_numbers(
                mass=masses[column],
                damping=10.0,
                sample_time=1e-3,
                delay_samples=1.4,
                modes=(MODE,),
                hand=HandNumbers(mass=0.1, damping=5.0, stiffness=hands[row, 0]),
            )
            assert limits[row, column] == pytest.approx(
                float(largest(single, "stiffness", Effects(damping=5.0))), rel=1e-10
            )


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), unit=st.floats(1e-3, 1e3), time=st.floats(1e-2, 1e2))
def test_units_scale_of_time_and_sign_of_a_mode_do_not_matter(
    seed: int, unit: float, time: float
) -> None:
    """Grams for kilograms, another time unit, a mode counted the other way: the same physics."""
    rng = np.random.default_rng(seed)
    case = draw_case(rng)
    k, b, m = draw_ray(rng, case)
    plain = float(safe_gain(loop_of(case), effects_at((k, b, m), 1.0)))

    def cut(chosen: float | None) -> float | None:
        return None if chosen is None else chosen / time

    mass, damping, stiffness = case.hand
    other = replace(
        case,
        mass=case.mass * unit,
        damping=case.damping * unit / time,
        sample_time=case.sample_time * time,
        modes=tuple((f / time, z, -e, -h) for f, z, e, h in case.modes),
        hand=(mass * unit, damping * unit / time, stiffness * unit / time**2),
        current_lag=case.current_lag * time,
        velocity_filter_hz=cut(case.velocity_filter_hz),
        acceleration_filter_hz=cut(case.acceleration_filter_hz),
    )
    ray = (
        None if k is None else k * unit / time**2,
        None if b is None else b * unit / time,
        None if m is None else m * unit,
    )
    assert float(safe_gain(loop_of(other), effects_at(ray, 1.0))) == pytest.approx(plain, rel=1e-9)
