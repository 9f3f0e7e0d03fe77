"""Verdicts and limits: how long, and how often wrong next to the boundary."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec

import numpy as np
from flint import arb
from numpy.typing import NDArray

from benchmarks.row import Row, best_seconds
from tests.reference import crossings, reference_loop, stable_by_jury
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.plant import ModeNumbers
from tune.stability.verdict import largest, verdict

FloatArray = NDArray[np.float64]

_POINTS = 1_000_000
_FEW = 20_000
#: Points for a library that judges one at a time.
_SINGLE = 300


def rows() -> Iterator[Row]:
    """Verdicts by the criterion and by eigenvalues, then limits."""
    rng = np.random.default_rng(0)
    alpha, beta, gamma = rng.uniform(-3, 8, (3, _POINTS))
    loop = Loop.dimensionless(0.01)
    effects = Effects(stiffness=alpha, damping=beta, mass=gamma)
    one = best_seconds(lambda: verdict(loop, effects)) / _POINTS
    few = Effects(stiffness=alpha[:_FEW], damping=beta[:_FEW], mass=gamma[:_FEW])
    falling = loop.polynomial(few)[0][::-1]
    other = best_seconds(lambda: stacked_eigenvalues(falling)) / _FEW
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
    yield from _degree_ten(rng)
    homerehab = Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1,
        filters=Filters(velocity_filter_hz=50.0, acceleration_filter_hz=30.0),
    )
    yield Row(
        what="largest stiffness, one loop of degree 6",
        seconds=best_seconds(lambda: largest(homerehab, "stiffness", Effects(damping=10.0)), 20),
        error="1e-9 against 360-digit roots (tests)",
    )


def _degree_ten(rng: np.random.Generator) -> Iterator[Row]:
    """A mode, two samples of delay and two second-order filters, against other people's ways."""
    sample_time, stiffness, mode = 1e-3, 3.0 * (2 * np.pi * 80.0) ** 2, (80.0, 0.02, 0.3)
    velocity, acceleration = 60.0, 40.0
    loop = Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=sample_time,
        delay_samples=2,
        modes=(
            ModeNumbers(
                frequency_hz=mode[0], damping_ratio=mode[1], at_encoder=mode[2], at_handle=-0.5
            ),
        ),
        filters=Filters(
            velocity_filter_hz=velocity,
            velocity_filter_order=2,
            acceleration_filter_hz=acceleration,
        ),
    )
    K, B, M = rng.uniform([[0], [-50], [-2]], [[9e3], [2e3], [20]], (3, _POINTS))
    effects = Effects(stiffness=K, damping=B, mass=M)
    ours = best_seconds(lambda: verdict(loop, effects), 3) / _POINTS
    few = Effects(stiffness=K[:_FEW], damping=B[:_FEW], mass=M[:_FEW])
    falling = loop.polynomial(few)[0][::-1]
    other = best_seconds(lambda: stacked_eigenvalues(falling), 2) / _FEW
    answers = verdict(loop, few)
    inside = np.max(stacked_eigenvalues(falling).real, axis=1) < 0
    differ = int(np.sum(inside != (answers > 0)))
    yield Row(
        what="verdict, million points, one loop of degree 10",
        seconds=ours,
        error=f"{int(np.sum(verdict(loop, effects) == 0))} undecided",
        against=f"{other / ours:.0f} times faster than eigvals",
    )
    yield Row(
        what="the same by stacked numpy.linalg.eigvals in w",
        seconds=other,
        error=f"differs in {differ} of {_FEW}",
    )
    if find_spec("control") is None:
        return
    control = import_module("control")
    plant = control.tf([1], [3.0, 10.0, 0]) + control.tf(
        [mode[2] ** 2], [3.0, 2 * mode[1] * np.sqrt(3.0 * stiffness), stiffness]
    )
    held = control.sample_system(plant, sample_time) * control.tf([1], [1, 0, 0], sample_time)
    v, a = (float(np.exp(-2 * np.pi * f * sample_time)) for f in (velocity, acceleration))
    speed = control.tf(
        np.array([1, -1, 0]) * (1 - v) ** 2 / sample_time, np.poly([v, v]), sample_time
    )
    rate = control.tf(
        np.array([1, -2, 1]) * (1 - a) ** 2 / sample_time**2, np.poly([a, a]), sample_time
    )

    def one_by_one() -> list[bool]:
        return [
            bool(np.max(np.abs(control.feedback(held, k + b * speed + m * rate).poles())) < 1)
            for k, b, m in zip(K[:_SINGLE], B[:_SINGLE], M[:_SINGLE], strict=True)
        ]

    theirs = best_seconds(one_by_one, 1) / _SINGLE
    differ = int(np.sum(np.array(one_by_one()) != (answers[:_SINGLE] > 0)))
    yield Row(
        what=f"the same by python-control {control.__version__}, point by point",
        seconds=theirs,
        error=f"differs in {differ} of {_SINGLE}",
        against=f"ours {theirs / ours:.0f} times faster",
    )


def stacked_eigenvalues(coefficients: FloatArray) -> NDArray[np.complex128]:
    """Roots of polynomials, falling powers in shape (degree + 1, n), by companions; (n, degree)."""
    degree = len(coefficients) - 1
    companion = np.zeros((coefficients.shape[1], degree, degree))
    companion[:, 0, :] = (-coefficients[1:] / coefficients[0]).T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)


def _near_the_boundary() -> tuple[int, int, int]:
    """(ours not right, z-plane float roots wrong, cases) at 1e-9 from the boundary."""
    rng = np.random.default_rng(1)
    ours = theirs = cases = 0
    for _ in range(150):
        delta = float(10 ** rng.uniform(-9, 0))
        ray = rng.uniform(0.01, 2, 3) * np.array([10 ** rng.uniform(-8, 0), 1, 1])
        reference = reference_loop(delta, *(float(x) for x in ray))
        for gain in crossings(reference):
            for sign in (1, -1):
                s = float(gain.mid()) * (1 + sign * 1e-9)
                exact = reference.at(arb(s))
                truth = stable_by_jury(exact)
                effects = Effects(stiffness=s * ray[0], damping=s * ray[1], mass=s * ray[2])
                ours += int(verdict(Loop.dimensionless(delta), effects)) != (1 if truth else -1)
                printed = _printed(delta, s * ray[0], s * ray[1], s * ray[2])
                theirs += bool(np.max(np.abs(np.roots(printed))) < 1) != truth
                cases += 1
    return ours, theirs, cases


def _printed(delta: float, alpha: float, beta: float, gamma: float) -> FloatArray:
    """Equation (37) multiplied out in z with m = T = 1, as printed, in float64."""
    decay = np.exp(-delta)
    plant = np.array([decay - 1 + delta, 1 - (1 + delta) * decay])
    law = np.polyadd(np.polyadd([alpha, 0, 0], [beta, -beta, 0]), gamma * np.poly([1, 1]))
    open_loop = np.polymul([1, 0, 0], np.polymul([1, -1], [1, -decay])) * delta**2
    return np.asarray(np.polyadd(open_loop, np.polymul(law, plant)), dtype=np.float64)
