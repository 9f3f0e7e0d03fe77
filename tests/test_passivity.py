"""Passivity: the general condition against its own definition at 60 digits, and known answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import acb, arb

from identification import Device
from tests.margin_cases import draw, filters_of
from tests.sampled_loops import Case
from tests.sampled_reference import Sampled
from tests.thinned import thinned
from tune.documents.scene import Effects
from tune.loop.loop import Filters
from tune.stability.criterion import damping_needed, passivity


def test_spring_and_damper() -> None:
    """b > KT/2 + |B|."""
    assert damping_needed(1000.0, 10.0, 0.0, 1e-3) == pytest.approx(10.5, rel=1e-12)
    assert damping_needed(1000.0, -10.0, 0.0, 1e-3) == pytest.approx(10.5, rel=1e-12)
    assert damping_needed(0.0, 0.0, 0.0, 1e-3) == 0.0


def test_virtual_mass_without_a_filter_is_far_from_passive() -> None:
    """docs/theory.md, 4: K = 1000, B = 10, M = 1 at 1 ms needs 2010.5, not 10.5."""
    assert damping_needed(1000.0, 10.0, 1.0, 1e-3) == pytest.approx(2010.5, rel=1e-12)


@pytest.mark.parametrize("mass", [-2.0, -0.01, 0.003, 0.5])
@pytest.mark.parametrize("damping", [-20.0, 0.0, 5.0])
def test_printed_form_for_differences_without_filter(damping: float, mass: float) -> None:
    """KT/2 + max over c of [-Bc + (M/T)(2c² - c - 1)], the parabola by its own formula."""
    step, stiffness = 1e-3, 700.0
    rate = mass / step
    ends = [-damping * c + rate * (2 * c * c - c - 1) for c in (-1.0, 1.0)]
    vertex = (damping + rate) / (4 * rate)
    if rate < 0 and abs(vertex) <= 1:
        ends.append(-damping * vertex + rate * (2 * vertex**2 - vertex - 1))
    expected = stiffness * step / 2 + max(ends)
    assert damping_needed(stiffness, damping, mass, step) == pytest.approx(expected, rel=1e-12)


def _needed(case: Case) -> float:
    """sup over ω of (T/2)·Re{(1 - e^-jωT)·C}/(1 - cos ωT) as it is written, at 60 digits."""
    reference = Sampled(case)
    numerator, denominator = reference.law

    def at(z: acb) -> arb:
        late = z ** -int(case.delay_samples)
        law = late * numerator(z) / denominator(z)
        return arb(case.sample_time) / 2 * ((acb(1) - 1 / z) * law).real / (1 - z.real)

    return reference.largest(at)[0]


@pytest.mark.parametrize("seed", thinned(range(12), 6))
def test_any_filter_and_delay_against_the_definition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = draw(rng, plain=True)
    if rng.random() < 0.3:
        case = replace(case, added_mass=-case.added_mass / 3)
    ours = damping_needed(
        case.stiffness,
        case.added_damping,
        case.added_mass,
        case.sample_time,
        filters_of(case),
        delay_samples=int(case.delay_samples),
    )
    assert ours == pytest.approx(_needed(case), rel=1e-9)


def _device(**changes: object) -> Device:
    return Device.model_validate(
        {
            "schema": "haptune/device/1",
            "name": "test",
            "axis": "x",
            "motion": "linear",
            "mass": 3.0,
            "damping": 10.0,
            "sample_time": 1e-3,
            "coulomb_friction": 0.0,
            "force_offset": 0.0,
            "delay": 0.0,
            **changes,
        }
    )


def test_verdict_of_a_device() -> None:
    passive = passivity(_device(), Effects(stiffness=1000.0, damping=9.0))
    assert passive.passive is True
    assert passive.damping_needed == pytest.approx(9.5)
    assert passivity(_device(), Effects(stiffness=1000.0, damping=9.6)).passive is False
    # A sample of delay asks a spring for KT more: (KT/2)·(1 + 2).
    late = passivity(_device(), Effects(stiffness=1000.0), extra_delay_samples=1)
    assert late.damping_needed == pytest.approx(1.5, rel=1e-12)


def test_where_the_theorem_does_not_reach() -> None:
    effects = Effects(stiffness=1000.0)
    mode = {"frequency_hz": 50.0, "damping_ratio": 0.02, "at_encoder": 1.0}
    for device, extra, word in (
        (_device(), 0.5, "whole samples"),
        (_device(modes=[mode]), 0.0, "vibrates"),
        (_device(current_lag=1e-3), 0.0, "lags"),
    ):
        answer = passivity(device, effects, Filters(), extra_delay_samples=extra)
        assert (answer.passive, answer.damping_needed) == (None, None)
        assert word in answer.reason
