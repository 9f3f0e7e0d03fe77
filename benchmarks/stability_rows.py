"""Verdicts and limits: how long, and how often wrong next to the boundary."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from flint import arb

from benchmarks.row import Row, best_seconds
from tests.reference import boundary_gains, reference_loop, stable_by_roots
from tune.effects import Effects
from tune.loop import Filters, Loop
from tune.stability import largest, verdict

_POINTS = 1_000_000
_FEW = 20_000


def rows() -> Iterator[Row]:
    """Verdicts by the criterion and by eigenvalues, then limits."""
    rng = np.random.default_rng(0)
    alpha, beta, gamma = rng.uniform(-3, 8, (3, _POINTS))
    loop = Loop.dimensionless(0.01)
    effects = Effects(stiffness=alpha, damping=beta, mass=gamma)
    one = best_seconds(lambda: verdict(loop, effects)) / _POINTS
    few = Effects(stiffness=alpha[:_FEW], damping=beta[:_FEW], mass=gamma[:_FEW])
    coefficients = loop.polynomial(few)[0]

    def eigenvalues() -> np.ndarray:  # type: ignore[type-arg]
        companion = np.zeros((_FEW, 4, 4))
        companion[:, 0, :] = (-coefficients[3::-1] / coefficients[4]).T
        companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
        return np.linalg.eigvals(companion)

    other = best_seconds(eigenvalues) / _FEW
    wrong, wrong_roots, count = _near_the_boundary()
    yield Row(
        what="verdict, million points, one δ",
        seconds=one,
        error=f"{wrong} wrong or undecided of {count} at 1e-9 from the boundary",
        against=f"{other / one:.0f} times faster than eigvals",
    )
    yield Row(
        what="stacked numpy.linalg.eigvals in w",
        seconds=other,
        error=f"{wrong_roots} of the same wrong by numpy.roots of equation (37) as printed",
    )
    deltas = 10 ** rng.uniform(-6, 0, _POINTS)
    many = Loop.dimensionless(deltas)
    yield Row(
        what="verdict, million points, a δ for each",
        seconds=best_seconds(lambda: verdict(many, effects), 2) / _POINTS,
        error="same criterion, running error bounds",
    )
    filtered = Loop.dimensionless(0.01, 1, 0.7, 0.8)
    part = Effects(stiffness=alpha[:100_000], damping=beta[:100_000], mass=gamma[:100_000])
    yield Row(
        what="verdict, filters and delay, degree 6",
        seconds=best_seconds(lambda: verdict(filtered, part), 3) / 100_000,
        error="same criterion, running error bounds",
    )
    homerehab = Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1,
        filters=Filters(velocity_hz=50.0, acceleration_hz=30.0),
    )
    yield Row(
        what="largest stiffness, one loop of degree 6",
        seconds=best_seconds(lambda: largest(homerehab, "stiffness", Effects(damping=10.0)), 20),
        error="1e-9 against 120-digit roots (tests)",
    )


def _near_the_boundary() -> tuple[int, int, int]:
    """(ours not right, z-plane float roots wrong, cases) at 1e-9 from the boundary."""
    rng = np.random.default_rng(1)
    ours = theirs = cases = 0
    for _ in range(150):
        delta = float(10 ** rng.uniform(-9, 0))
        ray = rng.uniform(0.01, 2, 3) * np.array([10 ** rng.uniform(-8, 0), 1, 1])
        reference = reference_loop(delta, *(float(x) for x in ray))
        for gain in boundary_gains(reference):
            for sign in (1, -1):
                s = float(gain.mid()) * (1 + sign * 1e-9)
                exact = reference.at(arb(s))
                truth = stable_by_roots(exact)
                effects = Effects(stiffness=s * ray[0], damping=s * ray[1], mass=s * ray[2])
                ours += int(verdict(Loop.dimensionless(delta), effects)) != (1 if truth else -1)
                printed = _printed(delta, s * ray[0], s * ray[1], s * ray[2])
                theirs += bool(np.max(np.abs(np.roots(printed))) < 1) != truth
                cases += 1
    return ours, theirs, cases


def _printed(delta: float, alpha: float, beta: float, gamma: float) -> np.ndarray:  # type: ignore[type-arg]
    """Equation (37) multiplied out in z with m = T = 1, as printed, in float64."""
    decay = np.exp(-delta)
    plant = np.array([decay - 1 + delta, 1 - (1 + delta) * decay])
    law = np.polyadd(np.polyadd([alpha, 0, 0], [beta, -beta, 0]), gamma * np.poly([1, 1]))
    open_loop = np.polymul([1, 0, 0], np.polymul([1, -1], [1, -decay])) * delta**2
    return np.polyadd(open_loop, np.polymul(law, plant))
