"""Sums over aliases and affine forms of a loop, which the proof over a region is made of."""

from __future__ import annotations

import numpy as np
import pytest
from flint import acb

from tests.random_boxes import around
from tests.thinned import thinned
from tune.certificate.affine import AffineForm
from tune.certificate.poles import closed_loop, precision
from tune.certificate.region import ModeRegion, Region, Setting
from tune.certificate.value_set import Mechanism, value_set
from tune.documents.profile import HandBox


def _region(rng: np.random.Generator, spread: float) -> tuple[Region, Setting]:
    """Anything at all: up to two modes, any hand, a lag, every kind of filter."""
    mass, step = 10 ** rng.uniform(-1, 1.5), 10 ** rng.uniform(-3.7, -2.7)
    damping = mass * 10 ** rng.uniform(-2, 1)
    modes = tuple(
        ModeRegion(
            frequency_hz=around(rng.uniform(0.02, 0.8) / step, spread),
            damping_ratio=around(rng.uniform(0.01, 0.1), spread),
            at_encoder=float(rng.uniform(-1, 1)),
            at_handle=float(rng.uniform(-1, 1)),
        )
        for _ in range(int(rng.integers(0, 3)))
    )
    hand = None
    if rng.random() < 0.6:
        stiffness = around(300.0, spread) if rng.random() < 0.6 else (0.0, 0.0)
        hand = HandBox(mass=around(0.1, spread), damping=around(3.0, spread), stiffness=stiffness)
    window = rng.random() < 0.25
    setting = Setting(
        stiffness=float(rng.choice([0, 1]) * 10 ** rng.uniform(-4, -1) * mass / step**2),
        damping=10 ** rng.uniform(-3, 0) * mass / step,
        mass=10 ** rng.uniform(-2, 0.3) * mass,
        velocity_filter_hz=None if window else float(rng.uniform(0.01, 0.3) / step),
        acceleration_filter_hz=float(rng.uniform(0.01, 0.3) / step),
        velocity_filter_order=int(rng.integers(1, 3)),
        acceleration_filter_order=int(rng.integers(1, 3)),
        filter_damping_ratio=float(rng.choice([1.0, 0.7])),
        velocity_window_samples=4 if window else None,
    )
    region = Region(
        mass=around(mass, spread),
        damping=around(damping, spread),
        sample_time=around(step, spread / 10),
        delay=around(float(rng.choice([1.0, 1.3, 0.5])) * step, spread),
        modes=modes,
        current_lag=around(rng.uniform(0.2, 2) * step, spread)
        if rng.random() < 0.4
        else (0.0, 0.0),
        hand=hand,
    )
    return region, setting


def _forms(low: np.ndarray, high: np.ndarray) -> list[AffineForm | float]:  # type: ignore[type-arg]
    """One cell: every side that has a width in its own symbol."""
    free = np.flatnonzero(high > low)
    forms: list[AffineForm | float] = []
    for row, (bottom, top) in enumerate(zip(low, high, strict=True)):
        if top == bottom:
            forms.append(float(bottom))
            continue
        slopes = (free == row)[:, None] * ((top - bottom) / 2 + 0j)
        forms.append(
            AffineForm(np.array([(bottom + top) / 2 + 0j]), slopes, np.zeros(1), np.zeros(1))
        )
    return forms


@pytest.mark.parametrize("spread", thinned([0.01, 1e-10, 1e-4, 0.1], 2))
def test_forms_hold_the_loop_of_the_matrix_exponential(spread: float) -> None:
    """D + s·N against the closed loop in z in 400 bits, at corners and inside of random cells."""
    bounded = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        region, setting = _region(rng, spread)
        middle = float(rng.choice([rng.uniform(0.01, 3.1), 10 ** rng.uniform(-3, 0)]))
        sides = (
            (middle * (1 - spread / 2), min(np.pi, middle * (1 + spread / 2))),
            *region.sides(),
        )
        low, high = np.array(sides).T
        theta, mass, damping, step, delay, lag, spring, *rest = _forms(low, high)
        assert isinstance(theta, AffineForm)
        assert isinstance(step, AffineForm)
        hand = None
        if region.hand is not None:
            hand, rest = (rest[0], rest[1], rest[2]), rest[3:]
        late = step.inverse() * delay
        mechanism = Mechanism(
            mass=mass,
            damping=damping,
            sample_time=step,
            delay=late,
            lag=lag,
            position_stiffness=spring,
            hand=hand,
            modes=tuple((rest[2 * i], rest[2 * i + 1]) for i in range(len(region.modes))),
            participations=tuple((mode.at_encoder, mode.at_handle) for mode in region.modes),
            grounded=region.grounded,
        )
        with np.errstate(all="ignore"):
            response = value_set(theta, mechanism, setting)
        free = np.flatnonzero(high > low)
        for _ in range(3):
            u = (
                rng.choice([-1.0, 1.0], len(free))
                if rng.random() < 0.5
                else rng.uniform(-1, 1, len(free))
            )
            values = (low + high) / 2
            values[free] += u * (high - low)[free] / 2
            loop = closed_loop(region.point(values[1:], 0.0), setting)
            with precision():
                z = acb(0, values[0]).exp()
                ratio = complex(loop.feedback(z) / loop.open(z))
            fixed, varied = response.fixed, response.varied
            error = abs(_at(varied, u) - ratio * _at(fixed, u))
            bound = _rest(varied) + abs(ratio) * _rest(fixed)
            # Without a bound nothing is claimed.
            assert not error > bound
            bounded += bool(np.isfinite(bound))
    assert bounded > 90


def _at(form: AffineForm, u: np.ndarray) -> complex:  # type: ignore[type-arg]
    return complex(form.centre[0] + u @ form.slopes[:, 0])


def _rest(form: AffineForm) -> float:
    return float(np.hypot(form.real[0], form.imag[0]))
