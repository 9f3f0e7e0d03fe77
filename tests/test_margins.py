"""Margins, passivity and ripple against the loop in z at 60 digits, and known answers."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from math import exp, pi

import numpy as np
import pytest
from flint import acb, arb

from identification import Device, quantity
from tests import general_loops
from tests.reference import Case, Sampled
from tests.thinned import thinned
from tune import (
    Effects,
    Filters,
    Loop,
    count_jump,
    damping_needed,
    delay_margin,
    disk_margin,
    force_ripple,
    handle_vibration,
    largest,
    least_damping_ratio,
    margins_of,
    phase_margin,
    safe_gain,
    slowest_decay,
)
from tune.documents.scene import Hand
from tune.stability.criterion import passivity


def draw(rng: np.random.Generator, *, plain: bool = False) -> Case:
    """A stable case at a random part of its gain limit; plain: rigid, held, whole samples."""
    while True:
        case = _drawn(rng, plain=plain)
        limit = Sampled(case).safe_gain()
        if limit == 0:
            continue
        gain = rng.uniform(0.03, 0.9) * limit if np.isfinite(limit) else 1.0
        return replace(
            case,
            stiffness=gain * case.stiffness,
            added_damping=gain * case.added_damping,
            added_mass=gain * case.added_mass,
        )


def _drawn(rng: np.random.Generator, *, plain: bool) -> Case:
    case = general_loops.draw_case(rng)
    if plain:
        rigid = replace(case, modes=(), hand=(0.0, 0.0, 0.0), current_lag=0.0)
        whole = float(int(case.delay_samples))
        case = replace(rigid, delay_samples=whole, velocity_window_samples=None)
    k, b, m = (part or 0.0 for part in general_loops.draw_ray(rng, case))
    return replace(case, stiffness=k, added_damping=b, added_mass=m)


def felt_only(case: Case) -> Case:
    """Without the filters of effects that are not there."""
    return replace(
        case,
        velocity_filter_hz=case.velocity_filter_hz if case.added_damping else None,
        velocity_window_samples=case.velocity_window_samples if case.added_damping else None,
        acceleration_filter_hz=case.acceleration_filter_hz if case.added_mass else None,
    )


def filters_of(case: Case) -> Filters:
    """The filters of the effects that are there."""
    return general_loops.filters_of(felt_only(case))


def loop_of(case: Case) -> Loop:
    return general_loops.loop_of(felt_only(case))


def effects_of(case: Case) -> Effects:
    return Effects(
        stiffness=case.stiffness or None,
        damping=case.added_damping or None,
        mass=case.added_mass or None,
    )


#: What every margin must agree to, relative.
AGREEMENT = 1e-9


def _differences(case: Case) -> dict[str, float]:
    """Relative difference of each margin from the reference."""
    reference = Sampled(case)
    loop, effects = loop_of(case), effects_of(case)
    fixed, varied, closed = reference.loop.fixed, reference.loop.varied, reference.closed

    def balanced(z: acb) -> arb:
        return abs((fixed(z) - varied(z)) / closed(z)) / 2

    def sensitivity(z: acb) -> arb:
        return abs(fixed(z) / closed(z))

    peaks = [reference.largest(balanced), reference.largest(sensitivity)]
    disk = disk_margin(loop, effects)
    decays = reference.in_s()
    slow = [(d, r) for d, r in decays if exp(-d * case.sample_time) > exp(-pi)]
    pairs = {
        "gain": (float(safe_gain(loop, effects)), reference.safe_gain()),
        "decay": (float(slowest_decay(loop, effects)), min(d for d, _ in decays)),
        "ratio": (
            float(least_damping_ratio(loop, effects)),
            min((r for _, r in slow), default=1.0),
        ),
        "phase": (float(phase_margin(loop, effects)), reference.phase_margin()),
        "balanced": (disk.balanced, 1 / peaks[0][0]),
        "balanced_hz": (disk.balanced_hz, peaks[0][1]),
        "sensitivity": (disk.sensitivity, 1 / peaks[1][0]),
        "sensitivity_hz": (disk.sensitivity_hz, peaks[1][1]),
    }
    return {
        name: 0.0 if ours == theirs else abs(ours - theirs) / abs(theirs)
        for name, (ours, theirs) in pairs.items()
    }


def _compare(count: int, seed: int, *, plain: bool) -> None:
    rng = np.random.default_rng(seed)
    wrong: Counter[str] = Counter()
    examples: dict[str, tuple[Case, float]] = {}
    for _ in range(count):
        case = draw(rng, plain=plain)
        for name, difference in _differences(case).items():
            if not difference <= AGREEMENT:
                wrong[name] += 1
                examples[name] = (case, difference)
    assert not wrong, (wrong, examples)


@pytest.mark.parametrize("plain", thinned([False, True], 1))
@pytest.mark.parametrize("count", thinned([3, 5], 1))
def test_margins_of_random_loops(plain: bool, count: int) -> None:
    _compare(count, seed=1, plain=plain)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_margins_of_random_loops_long(seed: int) -> None:
    _compare(200, seed=100 + seed, plain=bool(seed % 2))


def _device(**changes: object) -> Device:
    values = {"mass": 3.0, "damping": 10.0, "sample_time": 1e-3, "delay": 1e-3, **changes}
    return Device.model_validate(
        {
            "schema": "haptune/device/1",
            "name": "test",
            "axis": "x",
            "motion": "linear",
            "coulomb_friction": 0.0,
            "force_offset": 0.0,
            **values,
        }
    )


def test_an_unstable_loop_has_no_margins_but_a_growth() -> None:
    found = margins_of(_device(), Effects(stiffness=30_000.0))
    assert (found.gain < 1, found.phase, found.disk.balanced) == (True, 0.0, 0.0)
    assert (found.delay.every_gain, found.delay.full_gain) == (0.0, 0.0)
    assert found.decay < 0
    assert np.isnan(found.time_constant)


def test_filters_of_absent_effects_are_left_out() -> None:
    """A 0.1 Hz filter that nothing uses must not show as a slow pole."""
    filters = Filters(velocity_filter_hz=0.1, acceleration_filter_hz=0.1)
    found = margins_of(_device(), Effects(stiffness=1000.0), filters)
    bare = margins_of(_device(), Effects(stiffness=1000.0))
    assert found == bare


def test_margins_of_a_device_that_vibrates_in_a_hand() -> None:
    quantities = {"frequency_hz": 60.0, "damping_ratio": 0.02, "at_encoder": 0.5}
    device = _device(modes=[{**quantities, "at_handle": -2.0}])
    hand = Hand(mass=quantity(0.2), damping=quantity(5.0), stiffness=quantity(300.0))
    effects = Effects(stiffness=500.0, damping=5.0)
    found, bare = margins_of(device, effects, hand=hand), margins_of(device, effects)
    assert found.gain != bare.gain
    assert found.passivity.passive is None
    assert "vibrates" in found.passivity.reason


#: Samples looked for; random loops that bear more are many.
MOST = 5.0
#: The crossing lies within this, relative.


def _delay_compare(count: int, seed: int, *, between: int, plain: bool = False) -> int:
    """Check random loops; how many of them turn unstable within MOST."""
    rng = np.random.default_rng(seed)
    crossings = 0
    for _ in range(count):
        case = draw(rng, plain=plain)
        margin = delay_margin(
            lambda further, case=case: loop_of(case.later(further)), effects_of(case), most=MOST
        )
        assert margin.every_gain <= margin.full_gain

        def every(further: float, case: Case = case) -> bool:
            return Sampled(case.later(further)).safe_gain() > 1

        def full(further: float, case: Case = case) -> bool:
            return Sampled(case.later(further)).stable()

        for found, stable in ((margin.every_gain, every), (margin.full_gain, full)):
            assert all(stable(float(x)) for x in np.linspace(0, found, between + 2)[:-1]), case
            if found < MOST:
                crossings += 1
                assert stable(found * (1 - AGREEMENT)), case
                assert not stable(found * (1 + AGREEMENT)), case
    return crossings


@pytest.mark.long
def test_delay_margins_of_random_loops() -> None:
    assert _delay_compare(3, seed=3, between=8) >= 1


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_delay_margins_of_random_loops_long(seed: int) -> None:
    assert _delay_compare(200, seed=100 + seed, between=40, plain=bool(seed % 2)) >= 100


@pytest.mark.parametrize(
    ("effect", "tables"),
    [
        # docs/theory.md, 5: limits with one and two samples of delay, m = 3 kg, b = 10, 1 ms.
        ("stiffness", (6673.0, 4006.0)),
        ("damping", (2493.0, 1615.0)),
        pytest.param("mass", (3.71, 3.33), marks=pytest.mark.long),
    ],
)
def test_a_limit_with_delay_has_that_delay_as_its_margin(
    effect: str, tables: tuple[float, float]
) -> None:
    def at(samples: float) -> Loop:
        return Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=samples)

    for samples, printed in zip((1, 2), tables, strict=True):
        limit = float(largest(at(samples), effect))  # type: ignore[arg-type]
        assert limit == pytest.approx(printed, rel=2e-3)
        margin = delay_margin(at, Effects(**{effect: limit}))
        # A delay within 1e-9 samples of a whole number is taken for that number.
        assert margin.every_gain == pytest.approx(samples, abs=2e-9)


def test_lower_gains_can_be_what_delay_destabilises() -> None:
    """Stable at full gain and not below: the two margins differ (theory.md, 4, two intervals)."""

    def at(samples: float) -> Loop:
        # In units of the mass and the sample time.
        return Loop.from_numbers(mass=1.0, damping=0.0057, sample_time=1.0, delay_samples=samples)

    effects = Effects(stiffness=0.752, damping=0.211, mass=0.576)
    margin = delay_margin(at, effects)
    assert margin.every_gain == 0.0
    assert 0.0 < margin.full_gain < 0.5


def test_nothing_to_look_for_is_refused() -> None:
    with pytest.raises(ValueError, match="most must be positive"):
        delay_margin(lambda _: Loop.dimensionless(0.1), Effects(damping=0.1), most=0.0)


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


def _passive_device(**changes: object) -> Device:
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
    passive = passivity(_passive_device(), Effects(stiffness=1000.0, damping=9.0))
    assert passive.passive is True
    assert passive.damping_needed == pytest.approx(9.5)
    assert passivity(_passive_device(), Effects(stiffness=1000.0, damping=9.6)).passive is False
    # A sample of delay asks a spring for KT more: (KT/2)·(1 + 2).
    late = passivity(_passive_device(), Effects(stiffness=1000.0), extra_delay_samples=1)
    assert late.damping_needed == pytest.approx(1.5, rel=1e-12)


def test_where_the_theorem_does_not_reach() -> None:
    effects = Effects(stiffness=1000.0)
    mode = {"frequency_hz": 50.0, "damping_ratio": 0.02, "at_encoder": 1.0}
    for device, extra, word in (
        (_passive_device(), 0.5, "whole samples"),
        (_passive_device(modes=[mode]), 0.0, "vibrates"),
        (_passive_device(current_lag=1e-3), 0.0, "lags"),
    ):
        answer = passivity(device, effects, Filters(), extra_delay_samples=extra)
        assert (answer.passive, answer.damping_needed) == (None, None)
        assert word in answer.reason


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


def test_one_count_commands() -> None:
    """docs/theory.md, 7: 6 mN at K = 1000, 0.06 N at B = 10, 6 N at M = 1 kg on 6 µm and 1 ms."""
    effects = Effects(stiffness=1000.0, damping=10.0, mass=-1.0)
    jump = count_jump(effects, 1e-3, 6e-6)
    found = (jump.stiffness, jump.damping, jump.mass)
    assert found == pytest.approx((6e-3, 0.06, 6.0), rel=1e-12)
    alone = count_jump(Effects(damping=10.0), 1e-3, 6e-6)
    assert (alone.stiffness, alone.mass) == (0.0, 0.0)
