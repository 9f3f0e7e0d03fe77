"""Robustness: the certificate beside sampling and beside a structured singular value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.limited import answers
from benchmarks.section import Cell, Section
from tests.reference import crossings, reference_loop
from tune.certificate.region import Region, Setting
from tune.certificate.zero_exclusion import Claim, prove

ComplexArray = NDArray[np.complex128]

_STEP = 1e-3
#: Bisections of a gain between nothing and so many times the true one.
_HALVINGS, _TOP = 12, 1.5
_CELLS = 50_000
_FREQUENCIES = 300
#: Sides of the grid of devices that bounds what is not linear in mass and damping.
_GRID = 9

_TEXT = """\
A box of devices (mass and damping, one sample of delay) and a virtual spring with a damper: up
to which gain is every device of the box stable? Every method is asked by the same bisection of a
yes or no. The true gain is the least of the box by roots in 360-digit arithmetic, at its corners
and on a grid of 9 by 9. The error is the part by which the answer is off: an answer below is
cautious; one above lets unstable devices pass and stands at no front.

- **certificate**: haptune's proof, for every gain from zero on, by affine arithmetic and
  splitting.
- *sampling*: random devices of the box, eigenvalues of each at the gain asked. It proves
  nothing.
- *structured singular value*: slycot's AB13MD, two real blocks (mass, damping, linearised) and a
  complex one for what is not linear in them, on 300 frequencies, at the gain asked only.
- *small gain*: the largest distance of any device from the middle one, at 300 frequencies, as
  one disc.
"""

_REASONS = {"certificate": "a bound that needs no splitting is sooner, and more cautious."}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """A box and effects: kg, N·s/m, N/m, N·s/m."""

    name: str
    mass: tuple[float, float]
    damping: tuple[float, float]
    stiffness: float
    added: float


_CASES = (
    _Case(
        name="HomeRehab ±10 %, K 1000, B 30",
        mass=(2.7, 3.3),
        damping=(9.0, 11.0),
        stiffness=1000.0,
        added=30.0,
    ),
    _Case(
        name="HomeRehab ±30 %, K 1000, B 100",
        mass=(2.1, 3.9),
        damping=(7.0, 13.0),
        stiffness=1000.0,
        added=100.0,
    ),
    _Case(
        name="stylus ±20 %, K 300, B 1",
        mass=(0.04, 0.06),
        damping=(0.08, 0.12),
        stiffness=300.0,
        added=1.0,
    ),
)


def measure() -> Section:
    """Every method on every box."""
    cells: list[Cell] = []
    for case in _CASES:
        truth = _truth(case)
        methods: dict[str, Callable[[float], bool]] = {
            "certificate": partial(_proved, case),
            "sampling, 100 devices": partial(_sampled, case, 100),
            "sampling, 10 000 devices": partial(_sampled, case, 10_000),
            "small gain": partial(_small_gain, case),
        }
        if find_spec("slycot") is not None:
            methods["structured singular value, slycot"] = partial(_structured, case)
        for name, holds in methods.items():
            cells.append(_cell(case, truth, name, holds))
    return Section(
        name="robustness",
        title="Robustness: the certificate beside sampling and structured singular values",
        text=_TEXT,
        cells=tuple(cells),
        error="part by which the gain is off",
        floor=1e-4,
        reasons=_REASONS,
        ratios=_ratios(cells),
    )


def _ratios(cells: list[Cell]) -> dict[str, float]:
    seconds = {(cell.case, cell.method): cell.seconds for cell in cells}
    ratios: dict[str, float] = {}
    for case in _CASES:
        ours = seconds.get((case.name, "certificate"))
        theirs = seconds.get((case.name, "sampling, 10 000 devices"))
        if ours and theirs:
            ratios[f"certificate over 10 000 samples, {case.name}"] = ours / theirs
    return ratios


def _cell(case: _Case, truth: float, name: str, holds: Callable[[float], bool]) -> Cell:
    found = answers(partial(_bisected, holds), [_TOP * truth] * 3, budget=2.0)
    asked = Cell(case=case.name, method=name, ours=name == "certificate")
    if not found.values:
        return replace(asked, note=found.trouble)
    off = found.values[0] / truth - 1
    side = "above: unstable devices pass" if off > 0 else "below"
    return replace(
        asked,
        seconds=float(np.median(found.seconds)),
        error=abs(off),
        unsafe=off > 1e-9,
        note=f"gain {found.values[0]:.5g} of {truth:.5g}, {side}",
    )


def _bisected(holds: Callable[[float], bool], top: float) -> float:
    low, high = 0.0, top
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _truth(case: _Case) -> float:
    gains: list[float] = []
    for mass in np.linspace(*case.mass, _GRID):
        for damping in np.linspace(*case.damping, _GRID):
            loop = reference_loop(
                damping * _STEP / mass,
                case.stiffness * _STEP**2 / mass,
                case.added * _STEP / mass,
                0.0,
                delay=1,
            )
            gains.append(float(crossings(loop)[0].mid()))
    return min(gains)


def _proved(case: _Case, gain: float) -> bool:
    region = Region(
        mass=case.mass, damping=case.damping, sample_time=(_STEP, _STEP), delay=(_STEP, _STEP)
    )
    setting = Setting(
        stiffness=case.stiffness,
        damping=case.added,
        mass=0.0,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    return prove(region, setting, [Claim(gain=gain, extra=0.0)], _CELLS).proved


def _sampled(case: _Case, count: int, gain: float) -> bool:
    """Eigenvalues of place, speed, place before and force under way."""
    rng = np.random.default_rng(0)
    mass, damping = rng.uniform(*case.mass, count), rng.uniform(*case.damping, count)
    rate = damping / mass
    decay, gained = np.exp(-rate * _STEP), -np.expm1(-rate * _STEP) / rate
    step = np.zeros((count, 4, 4))
    step[:, 0, 0], step[:, 0, 1], step[:, 1, 1] = 1.0, gained, decay
    step[:, 0, 3], step[:, 1, 3] = (_STEP - gained) / damping, gained / mass
    step[:, 2, 0] = 1.0
    step[:, 3, 0] = -gain * (case.stiffness + case.added / _STEP)
    step[:, 3, 2] = gain * case.added / _STEP
    return bool(np.max(np.abs(np.linalg.eigvals(step))) < 1)


def _responses(case: _Case) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Controller, middle plant, and plants of a grid, shape (…, frequencies), delay included."""
    z: ComplexArray = np.exp(1j * np.geomspace(1e-4, np.pi, _FREQUENCIES))
    masses, dampings = (np.linspace(*side, _GRID)[:, None] for side in (case.mass, case.damping))

    def plant(mass: Any, damping: Any) -> ComplexArray:
        rate = damping / mass
        decay, gained = np.exp(-rate * _STEP), -np.expm1(-rate * _STEP) / rate
        far = (_STEP - gained) / damping
        above = far * z + gained**2 / mass - far * decay
        return np.asarray(above / ((z - 1) * (z - decay) * z))

    law = 0j + case.stiffness + case.added * (1 - 1 / z) / _STEP
    grid = plant(masses[:, None], dampings[None])
    return (
        np.asarray(law, dtype=np.complex128),
        plant(np.mean(case.mass), np.mean(case.damping)),
        grid,
    )


def _middle_holds(case: _Case, gain: float) -> bool:
    mass, damping = float(np.mean(case.mass)), float(np.mean(case.damping))
    return _sampled(replace(case, mass=(mass, mass), damping=(damping, damping)), 1, gain)


def _small_gain(case: _Case, gain: float) -> bool:
    law, middle, grid = _responses(case)
    loop = gain * law / (1 + gain * law * middle)
    disc = np.max(np.abs(grid - middle), axis=(0, 1))
    return _middle_holds(case, gain) and bool(np.max(np.abs(loop) * disc) < 1)


def _structured(case: _Case, gain: float) -> bool:
    slycot: Any = import_module("slycot")
    if not _middle_holds(case, gain):
        return False
    law, middle, grid = _responses(case)
    heavier, damped = (
        (grid[-1, _GRID // 2] - grid[0, _GRID // 2]) / 2,
        (grid[_GRID // 2, -1] - grid[_GRID // 2, 0]) / 2,
    )
    sides = np.linspace(-1, 1, _GRID)
    linear = middle + sides[:, None, None] * heavier + sides[None, :, None] * damped
    rest = np.max(np.abs(grid - linear), axis=(0, 1))
    loop = -gain * law / (1 + gain * law * middle)
    kinds = np.array([1, 1, 2])
    for index in range(_FREQUENCIES):
        column = loop[index] * np.array([heavier[index], damped[index], rest[index]])
        # Block for block the same through whichever of them the loop is closed.
        matrix = np.outer(np.ones(3), column)
        bound = slycot.ab13md(matrix.astype(complex, order="F"), np.ones(3, dtype=int), kinds)[0]
        if bound >= 1:
            return False
    return True
