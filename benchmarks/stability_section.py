"""Stability: error of the largest stiffness against time, verdicts near the boundary, scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.limited import answers
from benchmarks.row import Row, best_seconds
from benchmarks.section import Cell, Section
from benchmarks.stability_rows import rows, stacked_eigenvalues
from tests.reference import crossings, reference_loop
from tune.documents.scene import Effects
from tune.loop.loop import Loop
from tune.stability.verdict import largest, verdict

FloatArray = NDArray[np.float64]
#: Of the dimensionless stiffness of one δ.
Method = Callable[[float], float]

_DELTAS = (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 5.0, 700.0)
#: Points of a scan and bisections after it: to the last digit.
_SCAN, _HALVINGS = 80, 60
#: Points in all, and at a time.
_COUNTS, _CHUNK = (10**5, 10**6, 10**7, 10**8), 10**5

_TEXT = """\
The largest stiffness (dimensionless, α = KT²/m) of a spring alone, for δ = bT/m from 1e-12 to
700: relative error against roots in 360-digit ball arithmetic, and time of one δ. `numpy.roots`,
stacked `eigvals` (over equation (5) multiplied out) and python-control (closing the loop round
its own sampled plant) are asked by a scan and bisection of "all poles inside the circle".
Equation (6) is printed as the paper has it. Errors below 1e-15 are the last digits of a double,
and are drawn there.
"""

_REASONS = {
    "haptune, one δ": "one evaluation of a formula against a general answer with bounds on "
    "rounding: the printed formula is quicker, and nearer by a last digit at some δ, where it is "
    "right at all.",
    "haptune, many δ at once": "the last digits differ.",
}


def measure() -> Section:
    """Cells for every δ, rows near the boundary and of scale."""
    cells: list[Cell] = []
    methods = _methods()
    many = np.repeat(_DELTAS, 10_000)
    loops = Loop.dimensionless(many)
    seconds = best_seconds(lambda: largest(loops, "stiffness"), 2) / many.size
    at_once = np.asarray(largest(loops, "stiffness"))[::10_000]
    for delta, value in zip(_DELTAS, at_once, strict=True):
        truth = float(crossings(reference_loop(delta, 1.0, 0.0, 0.0))[0].mid())
        for name, method in methods.items():
            cells.append(_cell(delta, truth, name, method))
        asked = Cell(case=f"δ = {delta:g}", method="haptune, many δ at once", ours=True)
        cells.append(replace(asked, seconds=seconds, error=abs(float(value) / truth - 1)))
    further = tuple(rows())
    by = {row.what: row.seconds for row in further}
    return Section(
        name="stability",
        title="Stability: error of limits against time, from δ = 1e-12 to 700",
        text=_TEXT,
        cells=tuple(cells),
        error="relative error of the largest stiffness",
        floor=1e-15,
        reasons=_REASONS,
        rows=(*further, *_scale()),
        ratios={
            "verdict over eigvals": by["verdict, million points, one δ"]
            / by["stacked numpy.linalg.eigvals in w"],
            "verdict over eigvals, degree 10": by["verdict, million points, one loop of degree 10"]
            / by["the same by stacked numpy.linalg.eigvals in w"],
        },
    )


def _cell(delta: float, truth: float, name: str, method: Method) -> Cell:
    asked = Cell(case=f"δ = {delta:g}", method=name, ours=name.startswith("haptune"))
    found = answers(method, [delta], budget=4.0)
    if not found.values:
        return replace(asked, note=found.trouble)
    seconds, value = float(np.median(found.seconds)), float(found.values[-1])
    if not np.isfinite(value):
        return replace(asked, seconds=seconds, note="no limit found")
    return replace(asked, seconds=seconds, error=abs(value / truth - 1))


def _methods() -> dict[str, Method]:
    found: dict[str, Method] = {
        "haptune, one δ": lambda delta: float(largest(Loop.dimensionless(delta), "stiffness")),
        "equation (6) as printed": _printed_limit,
        "numpy.roots": partial(_bisected, radius=_radius_of_roots),
        "stacked eigvals": _stacked,
    }
    if find_spec("control") is not None:
        found["python-control"] = _control
    return found


def _printed_limit(delta: float) -> float:
    """(6) with m = T = 1."""
    with np.errstate(all="ignore"):
        power = np.exp(np.float64(delta))
        return float(delta**2 * (power - 1) / (power - 1 - delta))


def _polynomial(delta: float, alpha: FloatArray) -> FloatArray:
    """(5) with m = T = 1, as printed, falling powers of z, shape (3, n)."""
    decay = np.exp(-delta)
    ones = np.ones_like(alpha)
    fixed = delta**2 * np.array([1.0, -1 - decay, decay])
    varied = np.array([0.0, decay - 1 + delta, 1 - (1 + delta) * decay])
    return fixed[:, None] * ones + varied[:, None] * alpha


def _radius_of_roots(delta: float, alpha: float) -> float:
    poles = np.roots(_polynomial(delta, np.array([alpha]))[:, 0])
    return float(np.max(np.abs(poles), initial=0.0))


def _bisected(delta: float, radius: Callable[[float, float], float]) -> float:
    """The first end of stability above zero: a scan, then bisection."""
    places = np.geomspace(delta * 1e-3, 1e3 + 1e3 * delta, _SCAN)
    stable = [radius(delta, float(place)) < 1 for place in places]
    if not stable[0] or all(stable):
        return float("nan")
    index = stable.index(False)
    low, high = float(places[index - 1]), float(places[index])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if radius(delta, middle) < 1 else (low, middle)
    return low


def _stacked(delta: float) -> float:
    """As by roots, eigenvalues of all companions of a finer and finer grid at once."""
    low, high = delta * 1e-3, 1e3 + 1e3 * delta
    for _ in range(12):
        places = np.geomspace(low, high, 64)
        poles = stacked_eigenvalues(_polynomial(delta, places))
        stable = np.max(np.abs(poles), axis=1) < 1
        if not stable[0] or stable.all():
            return float("nan")
        index = int(np.argmin(stable))
        low, high = float(places[index - 1]), float(places[index])
    return low


def _control(delta: float) -> float:
    """Poles of the loop closed round python-control's own sampled plant, by bisection."""
    control: Any = import_module("control")
    import warnings

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        plant = control.sample_system(control.tf([1.0], [1.0, delta, 0.0]), 1.0)

        def radius(_: float, alpha: float) -> float:
            poles = control.feedback(plant, alpha).poles()
            return float(np.max(np.abs(poles), initial=0.0))

        return _bisected(delta, radius)


def _scale() -> Iterator[Row]:
    """Verdicts of more and more points a chunk at a time, each count in a process of its own."""
    for count in _COUNTS:
        found, what = answers(_many, [count], budget=60.0, longest=60.0), f"{count:.0e} points"
        if not found.values:
            yield Row(what=f"verdicts of {what}", seconds=0.0, error=found.trouble)
            continue
        yield Row(
            what=f"verdicts of {what}, drawing them included",
            seconds=found.seconds[0],
            error=f"{found.values[0] / count:.3%} stable",
            against=f"memory grew by {found.megabytes:.0f} MB; "
            f"{found.seconds[0] / count * 1e9:.0f} ns a point",
        )


def _many(count: int) -> int:
    loop = Loop.dimensionless(0.01)
    rng = np.random.default_rng(0)
    stable = 0
    for _ in range(count // _CHUNK):
        alpha, beta, gamma = rng.uniform(-3, 8, (3, _CHUNK))
        stable += int(np.sum(verdict(loop, Effects(stiffness=alpha, damping=beta, mass=gamma)) > 0))
    return stable
