"""The one verb: device + scene to a certified profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from identification import Device, as_stored
from tune.certificate.certify import (
    certify,
    note_of_apart,
    note_of_dropped,
    refusal_of,
    skipped_parts,
)
from tune.documents import CheckFailedError, NoFeasibleEffectError
from tune.documents.certified import AbsoluteStability
from tune.documents.perception import PerceptionTable, default_table
from tune.documents.profile import (
    Design,
    LoopProfile,
    MarginProfile,
    PerceptionProfile,
    SafeProfile,
)
from tune.documents.scene import MARGINS, EffectName, Scene, groups_of, hand_of
from tune.loop.loop import Filters
from tune.optimisation.cutoffs import choose_filters
from tune.optimisation.describe import (
    SizedMoment,
    element_profile,
    extra_delays,
    moment_margins,
    with_fades,
    with_levels_and_contacts,
)
from tune.optimisation.nash import SAME, Solution
from tune.optimisation.problem import DesignTask
from tune.optimisation.region import PlantPoint
from tune.optimisation.solve import groups, solve

if TYPE_CHECKING:
    from tune.optimisation.saturation import AllFound

Progress = Callable[[str], None]

#: Proposals after the first, each warned by what the check said of the one before.
_MOST_ATTEMPTS = 4
#: Margin beyond the one asked for, and less claimed of what is beyond it, relative, where a proof
#: came too close to the edge.
SLACK = (1e-3, 1e-2, 5e-2)
#: Cells of a proof, for one moment, after which more margin is tried instead; the last try has all.
_CELLS = 50_000


def optimise(
    device: Device,
    scene: Scene,
    *,
    table: PerceptionTable | None = None,
    favour: EffectName | None = None,
    progress: Progress | None = None,
) -> SafeProfile:
    """The largest perceivable effects of a scene that are safe on a device, with a certificate.

    Args:
        device: identified, or from a data sheet with intervals.
        scene: what is wanted.
        table: Weber fractions; None is the paper's study.
        favour: an effect whose steps count four times in the product; None for none.
        progress: called with a sentence before each part of the work.

    Raises:
        UnstatedError: facts of the device that a person has to state; asked before any solving.
        NoFeasibleEffectError: nothing the scene asks for can be rendered, or nothing at all,
            because the device runs away by its own force.
        CheckFailedError: the independent check did not pass; nothing may be written.
    """
    device.require_stated()
    say = progress or silent
    refusal = refusal_of(device)
    if refusal is not None:
        raise NoFeasibleEffectError((f"device: {refusal}",))
    task = DesignTask.of(as_stored(device), scene, table or default_table(), favour)
    filters = choose_filters(task, say)
    for attempt in range(_MOST_ATTEMPTS + 1):
        task, design, witnesses = _proposed(task, filters, say)
        say("certifying")
        try:
            last = attempt == _MOST_ATTEMPTS or task.slack == SLACK[-1]
            certificate = certify(design, None if last else _CELLS, witnesses)
        except CheckFailedError as error:
            warned = _warned(task, error)
            if warned is None or attempt == _MOST_ATTEMPTS:
                raise
            task = warned
            continue
        profile = SafeProfile.model_validate({**dict(design), "certificate": certificate})
        return as_stored(profile).signed()
    raise AssertionError("the last attempt returns or raises")


def silent(sentence: str) -> None:
    """No report of progress."""
    del sentence


def _proposed(
    task: DesignTask, filters: Filters, say: Progress
) -> tuple[DesignTask, Design, dict[str, AbsoluteStability]]:
    """The largest effects of every group, and what proves its clamps, as stored.

    A wall and an element that cannot be met together at one step of each are told apart in the
    task that is returned.
    """
    solutions: list[Solution] = []
    together = groups(task.scene)
    for number, elements in enumerate(together, start=1):
        say(f"tuning {', '.join(elements)} ({number} of {len(together)})")
        solved = solve(task, elements, filters, solutions)
        while solved.clash is not None:
            say(f"{' and '.join(solved.clash)} cannot be met together")
            task = task.without(solved.clash)
            solved = solve(task, elements, filters, solutions)
        solutions.append(solved)
    dropped = {label: why for solved in solutions for label, why in solved.dropped.items()}
    if not any(solved.by_label() for solved in solutions):
        raise NoFeasibleEffectError(tuple(f"{label}: {why}" for label, why in dropped.items()))
    design = with_fades(design_of(task, filters, solutions, dropped), task.scene)
    found, witnesses = _proved(solutions), dict[str, AbsoluteStability]()
    if found:
        from tune.optimisation.saturation import witness_of

        kept, slack = MARGINS[task.scene.margin], task.slack
        for names, one in found.items():
            witnesses[" + ".join(names)] = as_stored(witness_of(one, kept, slack))
    return task, as_stored(design), witnesses


def _proved(solutions: Sequence[Solution]) -> AllFound:
    """The gains of moments that must be absolutely stable, and are part of no other."""
    found = {names: one for solved in solutions for names, one in solved.absolute.items()}
    if not found:
        return found
    from tune.optimisation.saturation import largest_sets

    return {names: found[names] for names in largest_sets(found)}


def _warned(task: DesignTask, error: CheckFailedError) -> DesignTask | None:
    """The task with the points at which its proposal was unstable; with more slack if none was.

    None where neither is left to try.
    """
    spots = tuple(
        PlantPoint(
            mass=point.mass,
            damping=point.damping,
            sample_time=point.sample_time,
            delay=point.delay_samples * point.sample_time,
            position_stiffness=point.position_stiffness or 0.0,
            modes=tuple((mode.frequency_hz, mode.damping_ratio) for mode in point.modes),
            current_lag=point.current_lag or 0.0,
            hand=point.hand and (point.hand.mass, point.hand.damping, point.hand.stiffness),
        )
        for point in error.points
    )
    if not spots:
        slack = next((more for more in SLACK if more > task.slack), None)
        return None if slack is None else replace(task, slack=slack)
    return replace(task, region=replace(task.region, found=task.region.found + spots))


def design_of(
    task: DesignTask, filters: Filters, solutions: Sequence[Solution], dropped: dict[str, str]
) -> Design:
    """What was chosen for every element, with its margins and why it is no larger, uncertified."""
    device, scene, table = task.device, task.scene, task.table
    felt = [
        SizedMoment(solved.problem, moment, solved.sizes)
        for solved in solutions
        for moment in solved.problem.moments
        if solved.sizes.size and any(moment.members)
    ]
    kept = MARGINS[scene.margin]
    found = {
        one.moment.elements: moment_margins(device, one, late, kept, task.slack)
        for one, late in zip(felt, extra_delays(felt), strict=True)
    }
    # Of every moment the elements of which something is left.
    there = {unknown.element for solved in solutions for unknown in solved.problem.unknowns}
    margins = [
        found[part]._replace(elements=each)
        for each in scene.subsets()
        if (part := tuple(name for name in each if name in there)) in found
    ]
    absolute = _proved(solutions)
    elements = {
        name: element_profile(device, scene, solved, name, margins, absolute, task.slack)
        for solved, own in zip(solutions, groups(scene), strict=True)
        for name in own
        if any(u.element == name for u in solved.problem.unknowns)
        or any(label.rpartition(".")[0] == name for label in solved.dropped)
    }
    methods: dict[str, str] = {}
    for solved, own in zip(solutions, groups(scene), strict=True):
        if solved.by_label():
            apart = f"; solvers differ by {solved.disagreement:.1e}, settled by the exact check"
            methods[", ".join(own)] = solved.method + apart * (solved.disagreement > SAME)
    played = {name: elements[name] for name in scene.elements if name in elements}
    design = Design(
        device=device,
        scene=scene.name,
        loop=LoopProfile(
            sample_time=device.sample_time.value,
            extra_delay_samples=device.delay.value / device.sample_time.value,
            **asdict(filters),
        ).with_effects(
            damping=any(each.damping for each in played.values()),
            mass=any(each.mass for each in played.values()),
        ),
        hand=hand_of(scene.hand, device.motion),
        margin=MarginProfile.of(scene.margin),
        elements=played,
        together=groups_of(scene.elements, scene.together),
        apart=groups_of(scene.elements, scene.apart),
        ripple_limit=scene.ripple_limit or table.threshold(device.motion),
        perception=PerceptionProfile(
            name=table.name,
            stiffness=table.stiffness.value,
            damping=table.damping.value,
            mass=table.mass.value,
            threshold=table.threshold(device.motion),
        ),
        notes=(
            *(note_of_dropped(label) + why for label, why in dropped.items()),
            *(note_of_apart(pair) for pair in task.apart),
        ),
        method=methods,
    )
    design = with_levels_and_contacts(design, device, task.region.box)
    return design.model_copy(update={"skipped": skipped_parts(design)})
