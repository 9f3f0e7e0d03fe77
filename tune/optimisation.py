"""The one verb: device + scene → certified profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import Device, as_stored, rounded
from tune.backends import Backend
from tune.climb import SAME, climb, closed_form
from tune.describe import binding, element_profile, reasons_for_nothing, skipped_parts
from tune.errors import NoFeasibleEffectError
from tune.limits import allowed
from tune.loop import Filters
from tune.perception import PerceptionTable, default_table
from tune.problem import Problem, Region, pose
from tune.profile import Design, LoopProfile, MarginProfile, SafeProfile
from tune.scene import MARGINS, Cutoff, Scene

FloatArray = NDArray[np.float64]
Progress = Callable[[str], None]

#: Cut-offs tried where a filter is free, Hz; none first, least filtering first. Below 20 Hz an
#: acceleration filter eats into the 0.5 to 5 Hz at which people move.
CUTOFFS = (None, 200.0, 100.0, 50.0, 30.0, 20.0)
#: Least filtering whose score comes this close to the best is taken.
_GOOD_ENOUGH = 0.99
#: Significant digits of a written effect; what is lost is 1e-5 at most.
_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """The answer for elements that share moments.

    Attributes:
        problem: with only the unknowns that are perceptible and feasible.
        sizes: rounded, allowed exactly.
        dropped: reason by label of every effect that was left out.
        method: what found the answer.
        disagreement: of the solvers, relative.
    """

    problem: Problem
    sizes: FloatArray
    dropped: dict[str, str]
    method: str
    disagreement: float


def optimise(
    device: Device,
    scene: Scene,
    *,
    table: PerceptionTable | None = None,
    progress: Progress | None = None,
) -> SafeProfile:
    """The largest perceivable effects of a scene that are safe on a device, with a certificate.

    Args:
        device: identified, or from a data sheet with intervals.
        scene: what is wanted.
        table: Weber fractions; None is the paper's study.
        progress: called with a sentence before each part of the work.

    Raises:
        NoFeasibleEffectError: nothing the scene asks for can be rendered.
        CheckFailedError: the independent check did not pass; nothing may be written.
    """
    from tune.certificate.certify import certify

    say = progress or _silent
    table = table or default_table()
    device = as_stored(device)
    region = Region.of(device.simultaneous_box())
    filters = _choose_filters(device, scene, table, region, say)
    solutions: list[Solved] = []
    for number, elements in enumerate(groups(scene), start=1):
        say(f"tuning {', '.join(elements)} ({number} of {len(groups(scene))})")
        solutions.append(solve(device, scene, table, region, elements, filters))
    dropped = {label: why for solved in solutions for label, why in solved.dropped.items()}
    if all(not solved.problem.unknowns for solved in solutions):
        raise NoFeasibleEffectError(tuple(f"{label}: {why}" for label, why in dropped.items()))
    say("certifying")
    design = as_stored(_design(device, scene, table, filters, solutions, dropped))
    profile = SafeProfile.model_validate({**dict(design), "certificate": certify(design)})
    return as_stored(profile).signed()


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
    device: Device,
    scene: Scene,
    table: PerceptionTable,
    region: Region,
    elements: Sequence[str],
    filters: Filters,
    *,
    second_opinion: bool = True,
) -> Solved:
    """Tune one group; effects that no hand can tell from nothing are dropped, worst first."""
    dropped: dict[str, str] = {}
    while True:
        problem = pose(
            device,
            scene,
            table,
            region,
            elements=elements,
            filters=filters,
            gone=frozenset(dropped),
        )
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
            answer = climb(problem, _backends(second_opinion=second_opinion))
        if answer.sizes is None:
            label = max(problem.unknowns, key=lambda unknown: unknown.level).label
            reason = {label: "no setting keeps every limit together with the other effects"}
            _refuse_broken_ranges(problem, reason)
            dropped |= reason
            continue
        sizes = _settled(problem, answer.sizes)
        steps = [u.steps(float(s)) for u, s in zip(problem.unknowns, sizes, strict=True)]
        faint = int(np.argmin(steps))
        if steps[faint] < 1:
            unknown = problem.unknowns[faint]
            dropped[unknown.label] = (
                f"{unknown.sign * sizes[faint]:.4g} would be {steps[faint]:.2g} of a step a hand "
                f"can tell, limited by {binding(problem, sizes, faint)}"
            )
            continue
        return Solved(
            problem=problem,
            sizes=sizes,
            dropped=dropped,
            method=" and ".join(answer.methods) or "start",
            disagreement=answer.disagreements,
        )


def _backends(*, second_opinion: bool) -> list[Backend]:
    from tune.backends.casadi_ import Ipopt
    from tune.backends.nlopt_ import Slsqp

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


def _settled(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Wanted values met exactly, the rest rounded to six digits towards nothing, still allowed."""
    caps = np.array([unknown.high for unknown in problem.unknowns])
    met = np.array([u.wish.kind in {"value", "range"} for u in problem.unknowns]) & (
        sizes >= caps * (1 - 10 * SAME)
    )
    for retreat in (0.0, *np.geomspace(1e-7, 1e-3, 9)):
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


def _choose_filters(
    device: Device, scene: Scene, table: PerceptionTable, region: Region, say: Progress
) -> Filters:
    """The fixed cut-offs, and for free ones the least filtering that does nearly as well as any.

    A filter is only there for an effect that uses it: without a damper no velocity filter, without
    a virtual mass no acceleration filter.
    """
    wishes = {effect for element in scene.elements.values() for effect in element.wishes()}
    nyquist = 0.5 / device.sample_time.high

    def options(cutoff: Cutoff, effect: str) -> tuple[float | None, ...]:
        if effect not in wishes or cutoff == "none":
            return (None,)
        if cutoff == "free":
            return tuple(c for c in CUTOFFS if c is None or c < nyquist)
        assert isinstance(cutoff, float)
        return (cutoff,)

    velocity = options(scene.loop.velocity_filter_hz, "damping")
    acceleration = options(scene.loop.acceleration_filter_hz, "mass")
    if len(velocity) * len(acceleration) == 1:
        return Filters(velocity_hz=velocity[0], acceleration_hz=acceleration[0])
    scores: dict[Filters, float] = {}
    known: dict[tuple[tuple[str, ...], Filters], float] = {}
    for v, a in product(velocity, acceleration):
        say(f"trying filters: velocity {_hertz(v)}, acceleration {_hertz(a)}")
        total = 0.0
        for elements in groups(scene):
            used = {effect for name in elements for effect in scene.elements[name].wishes()}
            own = Filters(
                velocity_hz=v if "damping" in used else None,
                acceleration_hz=a if "mass" in used else None,
            )
            if used & {"damping", "mass"} and (elements, own) not in known:
                known[elements, own] = _score(device, scene, table, region, elements, own)
            total += known.get((elements, own), 0.0)
        scores[Filters(velocity_hz=v, acceleration_hz=a)] = total
    best = max(scores.values())
    good = [filters for filters, score in scores.items() if score >= _GOOD_ENOUGH * best]
    return max(good, key=lambda f: (f.acceleration_hz or np.inf, f.velocity_hz or np.inf))


def _hertz(cutoff: float | None) -> str:
    return "none" if cutoff is None else f"{cutoff:g} Hz"


def _score(
    device: Device,
    scene: Scene,
    table: PerceptionTable,
    region: Region,
    elements: Sequence[str],
    filters: Filters,
) -> float:
    """Sum over effects of one plus the logarithm of their steps: a lost effect outweighs gains."""
    try:
        solved = solve(device, scene, table, region, elements, filters, second_opinion=False)
    except NoFeasibleEffectError:
        return 0.0
    return sum(
        1 + float(np.log(max(unknown.steps(float(size)), 1.0)))
        for unknown, size in zip(solved.problem.unknowns, solved.sizes, strict=True)
    )


def _design(
    device: Device,
    scene: Scene,
    table: PerceptionTable,
    filters: Filters,
    solutions: Sequence[Solved],
    dropped: dict[str, str],
) -> Design:
    elements = {
        name: element_profile(device, scene, solved.problem, solved.sizes, name, solved.dropped)
        for solved in solutions
        for name in scene.elements
        if any(u.element == name for u in solved.problem.unknowns)
        or any(label.rpartition(".")[0] == name for label in solved.dropped)
    }
    methods = {
        ", ".join(solved.problem.moments[-1].elements): solved.method
        + (
            f"; solvers differ by {solved.disagreement:.1e}, settled by the exact check"
            if solved.disagreement > SAME
            else ""
        )
        for solved in solutions
        if solved.problem.moments
    }
    return Design(
        device=device,
        scene=scene.name,
        loop=LoopProfile(
            sample_time=device.sample_time.value,
            extra_delay_samples=device.delay.value / device.sample_time.value,
            velocity_filter_hz=filters.velocity_hz,
            acceleration_filter_hz=filters.acceleration_hz,
        ),
        margin=MarginProfile(name=scene.margin, **dict(MARGINS[scene.margin])),
        elements={name: elements[name] for name in scene.elements if name in elements},
        together=tuple(tuple(group) for group in scene.together),
        ripple_limit=scene.ripple_limit or table.threshold(device.motion),
        skipped=skipped_parts(device, scene, filters),
        notes=tuple(f"{label} dropped: {why}" for label, why in dropped.items()),
        method=methods,
    )


def _silent(sentence: str) -> None:
    del sentence
