"""Elements that share moments to their largest perceivable effects, rounded and allowed exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification import rounded
from tune.documents.errors import NoFeasibleEffectError
from tune.documents.scene import Scene
from tune.loop.filters import Filters
from tune.optimisation.backends import Backend
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.climb import SAME, climb, closed_form
from tune.optimisation.describe import bindings, reasons_for_nothing
from tune.optimisation.limits import allowed
from tune.optimisation.problem import Job, Problem, pose

if TYPE_CHECKING:
    from tune.optimisation.saturation import AllFound, Found

FloatArray = NDArray[np.float64]

#: Significant digits of a written effect; what is lost is 1e-5 at most.
_DIGITS = 6
#: Parts by which sizes that are a little beyond are taken back.
_RETREATS = (0.0, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """The answer for elements that share moments.

    Attributes:
        problem: with only the unknowns that are perceptible and feasible.
        sizes: rounded, allowed exactly.
        dropped: reason by label of every effect that was left out.
        method: what found the answer.
        disagreement: of the solvers, relative.
        absolute: gains of the moments that are one-sided.
    """

    problem: Problem
    sizes: FloatArray
    dropped: dict[str, str]
    method: str = "as given"
    disagreement: float = 0.0
    absolute: AllFound = field(default_factory=dict[tuple[str, ...], "Found"])


def groups(scene: Scene) -> tuple[tuple[str, ...], ...]:
    """Elements connected through ``together``; each group is one problem."""
    found = [{name} for name in scene.elements]
    for together in scene.together:
        joined = [group for group in found if group & set(together)]
        found = [group for group in found if not group & set(together)]
        found.append({name for group in joined for name in group})
    order = list(scene.elements)
    ordered = [tuple(sorted(group, key=order.index)) for group in found]
    return tuple(sorted(ordered, key=lambda group: order.index(group[0])))


def solve(
    job: Job,
    elements: Sequence[str],
    filters: Filters,
    *,
    second_opinion: bool = True,
) -> Solved:
    """Tune one group; effects that no hand can tell from nothing are dropped, worst first.

    Args:
        job: device and scene.
        elements: of one group.
        filters: cut-offs.
        second_opinion: by another solver, and of one-sided moments by their absolute stability; to
            compare cut-offs neither is asked for.
    """
    dropped: dict[str, str] = {}
    while True:
        problem = pose(job, elements=elements, filters=filters, gone=frozenset(dropped))
        if not problem.unknowns:
            return Solved(
                problem=problem, sizes=np.empty(0), dropped=dropped, method="none", disagreement=0.0
            )
        impossible = reasons_for_nothing(problem)
        if impossible:
            _refuse_broken_ranges(problem, impossible)
            dropped |= impossible
            continue
        if len(problem.unknowns) == 1:
            answer = closed_form(problem)
        else:
            answer = climb(problem, backends(second_opinion=second_opinion))
        if answer.sizes is None:
            label = max(problem.unknowns, key=lambda unknown: unknown.level).label
            reason = {label: "no setting keeps every limit together with the other effects"}
            _refuse_broken_ranges(problem, reason)
            dropped |= reason
            continue
        sizes = settled(problem, answer.sizes)
        absolute: AllFound = {}
        if second_opinion and any(moment.one_sided for moment in problem.moments):
            from tune.optimisation.saturation import all_found, taken_back

            sizes = np.array([_floor_digits(float(x)) for x in taken_back(problem, sizes)])
            short = {
                unknown.label: f"as a one-sided wall {size:.4g} is proved stable at most"
                for unknown, size in zip(problem.unknowns, sizes, strict=True)
                if size < unknown.low
            }
            if short:
                _refuse_broken_ranges(problem, short)
                dropped |= short
                continue
            absolute = all_found(problem, sizes)
        faint = _faint(problem, sizes)
        if faint:
            dropped |= faint
            continue
        return Solved(
            problem=problem,
            sizes=sizes,
            dropped=dropped,
            method=" and ".join(answer.methods) or "start",
            disagreement=answer.disagreements,
            absolute=absolute,
        )


def _faint(problem: Problem, sizes: FloatArray) -> dict[str, str]:
    """Why an effect is dropped that no hand could tell from nothing, by its label.

    The faintest of those that would not reach a step even alone, or of all. One at a time: the
    margin that it leaves may be all that others lack.
    """
    steps = np.array([u.steps(float(s)) for u, s in zip(problem.unknowns, sizes, strict=True)])
    if np.min(steps) >= 1:
        return {}
    low = np.array([unknown.low for unknown in problem.unknowns])
    faint = np.flatnonzero(steps < 1)
    most = {int(i): largest_allowed(problem, low, int(i)) for i in faint}
    alone = [i for i, size in most.items() if problem.unknowns[i].steps(size) < 1]
    index = min(alone or most, key=lambda i: float(steps[i]))
    setting = sizes
    if alone:
        setting = low.copy()
        setting[index] = most[index]
    return {problem.unknowns[index].label: _too_little(problem, setting, index)}


def _too_little(problem: Problem, sizes: FloatArray, index: int) -> str:
    unknown, size = problem.unknowns[index], float(sizes[index])
    return (
        f"{unknown.sign * size:.4g} would be {unknown.steps(size):.2g} of a step a hand can tell, "
        f"limited by {bindings(problem, sizes, [index])[0]}"
    )


def backends(*, second_opinion: bool = True) -> list[Backend]:
    """The solvers that propose, loaded when first needed."""
    from tune.optimisation.backends.casadi_ import Ipopt
    from tune.optimisation.backends.nlopt_ import Slsqp

    return [Ipopt(), Slsqp()] if second_opinion else [Slsqp()]


def _refuse_broken_ranges(problem: Problem, impossible: dict[str, str]) -> None:
    """A range is a promise: its lower end is met or nothing is written."""
    broken = tuple(
        f"{unknown.label}: its range starts at {unknown.low:g}, {impossible[unknown.label]}"
        for unknown in problem.unknowns
        if unknown.wish.kind == "range" and unknown.label in impossible
    )
    if broken:
        raise NoFeasibleEffectError(broken)


def settled(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Wanted values met exactly, the rest rounded to six digits towards nothing, still allowed."""
    caps = np.array([unknown.high for unknown in problem.unknowns])
    met = np.array([u.wish.kind in {"value", "range"} for u in problem.unknowns]) & (
        sizes >= caps * (1 - 10 * SAME)
    )
    for retreat in _RETREATS:
        trial = np.array(
            [
                cap if whole else _floor_digits(float(size * (1 - retreat)))
                for cap, whole, size in zip(caps, met, sizes, strict=True)
            ]
        )
        if allowed(problem, trial):
            return trial
    return sizes * (1 - SAME)


def _floor_digits(value: float) -> float:
    if value <= 0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(value)) - _DIGITS + 1)
    return rounded(float(np.floor(value / unit) * unit))
