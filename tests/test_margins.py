"""Margins, passivity and ripple against the loop in z at 60 digits, and known answers."""

from collections import Counter
from dataclasses import replace
from math import exp, pi

import numpy as np
import pytest
from flint import acb, arb
from numpy.typing import ArrayLike

from identification import Device
from tests import general_loops
from tests.reference import Case, Sampled
from tests.thinned import thinned
from tune import (
    Effects,
    Filters,
    Loop,
    LoopError,
    count_jump,
    damping_needed,
    force_ripple,
    margins_of,
    safe_gain,
)
from tune.stability.criterion import passivity


def draw(rng: np.random.Generator, *, plain: bool = False) -> Case:
    """A stable case at a random part of its gain limit; plain: rigid, held, whole samples."""
    while True:
        case = _drawn(rng, plain=plain)
        try:
            limit = Sampled(case).safe_gain()
        except ArithmeticError:  # a pole on the circle at every gain, as of a mass without damping
            continue
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

    peak, hertz = reference.largest(balanced)
    found = margins_of(loop, effects)
    if found.critical_frequency_hz == 0:  # what is looked through begins a little above
        peak, hertz = max(peak, float(balanced(acb(0, 1e-15).exp()))), 0.0
    decays = reference.in_s()
    slow = [(d, r) for d, r in decays if exp(-d * case.sample_time) > exp(-pi)]
    pairs = {
        "gain": (float(safe_gain(loop, effects)), reference.safe_gain()),
        "decay": (found.decay, min(d for d, _ in decays)),
        "ratio": (found.damping_ratio, min((r for _, r in slow), default=1.0)),
        "phase": (found.phase, reference.phase_margin()),
        "disk": (found.disk, 1 / peak),
        "critical_frequency_hz": (found.critical_frequency_hz, hertz),
    }
    return {
        name: 0.0 if ours == theirs else abs(ours - theirs) / abs(theirs)
        for name, (ours, theirs) in pairs.items()
    }


@pytest.mark.parametrize(
    ("count", "seed", "plain"),
    thinned([(3, 1, False), (5, 1, True), *((200, 100 + k, bool(k % 2)) for k in range(10))], 1),
)
def test_margins_of_random_loops(count: int, seed: int, plain: bool) -> None:
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


def test_an_unstable_loop_has_no_margins_but_a_growth() -> None:
    loop = Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=1)
    found = margins_of(loop, Effects(stiffness=30_000.0))
    assert (found.phase, found.disk) == (0.0, 0.0)
    assert found.decay < 0


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
    late = passivity(_passive_device(delay=1e-3), Effects(stiffness=1000.0))
    assert late.damping_needed == pytest.approx(1.5, rel=1e-12)


def test_where_the_theorem_does_not_reach() -> None:
    effects = Effects(stiffness=1000.0)
    mode = {"frequency_hz": 50.0, "damping_ratio": 0.02, "at_encoder": 1.0}
    for changes, word in (
        ({"delay": 5e-4}, "whole samples"),
        ({"modes": [mode]}, "vibrates"),
        ({"current_lag": 1e-3}, "lags"),
    ):
        answer = passivity(_passive_device(**changes), effects, Filters())
        assert (answer.passive, answer.damping_needed) == (None, None)
        assert word in answer.reason


@pytest.mark.parametrize(
    ("count", "seed"), thinned([(25, 1), *((200, 100 + k) for k in range(10))], 1)
)
def test_force_ripple_against_a_60_digit_solution(count: int, seed: int) -> None:
    """Of random loops with all that a mechanism may have."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        case = draw(rng)
        reference = Sampled(case)
        loop, effects = loop_of(case), effects_of(case)
        noise = 6e-6 / 12**0.5
        force = reference.noise_gain(reference.force_numerator) * noise
        assert float(force_ripple(loop, effects, 6e-6)) == pytest.approx(force, rel=1e-9), case


def test_one_count_commands() -> None:
    """docs/theory.md, 7: 6 mN at K = 1000, 0.06 N at B = 10, 6 N at M = 1 kg on 6 µm and 1 ms."""
    effects = Effects(stiffness=1000.0, damping=10.0, mass=-1.0)
    jump = count_jump(effects, 1e-3, 6e-6)
    assert jump == pytest.approx({"stiffness": 6e-3, "damping": 0.06, "mass": 6.0}, rel=1e-12)
    assert count_jump(Effects(damping=10.0), 1e-3, 6e-6).keys() == {"damping"}
    # One pole takes its share of a jump at once: 1 - exp(-2π·f·T).
    low = count_jump(Effects(damping=10.0), 1e-3, 6e-6, Filters(velocity_filter_hz=50.0))
    assert low["damping"] == pytest.approx(0.06 * -np.expm1(-0.1 * np.pi), rel=1e-12)


@pytest.mark.parametrize("strange", [np.nan, np.inf, [9.0, 8.0]])
def test_margins_of_what_is_not_one_finite_loop_are_refused(strange: ArrayLike) -> None:
    one = Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3)
    with pytest.raises(LoopError, match="margins are those of one loop with one finite value"):
        margins_of(one, Effects(damping=strange))
