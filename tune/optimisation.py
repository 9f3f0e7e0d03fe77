"""The one verb: device + scene → certified profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from identification import Device, as_stored
from tune.climb import SAME
from tune.cutoffs import choose_filters
from tune.describe import element_profile, skipped_parts
from tune.errors import NoFeasibleEffectError
from tune.loop import Filters
from tune.perception import PerceptionTable, default_table
from tune.problem import Job
from tune.profile import Design, LoopProfile, MarginProfile, SafeProfile
from tune.scene import MARGINS, Scene
from tune.solve import Solved, groups, solve

Progress = Callable[[str], None]


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
    job = Job.of(as_stored(device), scene, table or default_table())
    filters = choose_filters(job, say)
    solutions: list[Solved] = []
    for number, elements in enumerate(groups(scene), start=1):
        say(f"tuning {', '.join(elements)} ({number} of {len(groups(scene))})")
        solutions.append(solve(job, elements, filters))
    dropped = {label: why for solved in solutions for label, why in solved.dropped.items()}
    if all(not solved.problem.unknowns for solved in solutions):
        raise NoFeasibleEffectError(tuple(f"{label}: {why}" for label, why in dropped.items()))
    say("certifying")
    design = as_stored(_design(job, filters, solutions, dropped))
    profile = SafeProfile.model_validate({**dict(design), "certificate": certify(design)})
    return as_stored(profile).signed()


def _design(
    job: Job,
    filters: Filters,
    solutions: Sequence[Solved],
    dropped: dict[str, str],
) -> Design:
    device, scene = job.device, job.scene
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
        ripple_limit=scene.ripple_limit or job.table.threshold(device.motion),
        skipped=skipped_parts(device, scene, filters),
        notes=tuple(f"{label} dropped: {why}" for label, why in dropped.items()),
        method=methods,
    )


def _silent(sentence: str) -> None:
    del sentence
