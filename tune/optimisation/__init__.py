"""Device and scene to the largest perceivable effects: solvers propose, exact limits dispose.

And a scene tuned otherwise: with other margins or an effect favoured, or on changed hardware. With
one margin the largest product of steps is one point of many that no other exceeds in every effect
(Pareto). Two more of them are shown: more of the stiffness and more of the mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal, cast

from identification import (
    Device,
    InvalidInputError,
    as_stored,
    parse_document,
    quantity,
    to_mapping,
    typed,
)
from tune.certificate.certify import (
    certify,
    note_of_apart,
    note_of_dropped,
    refusal_of,
    skipped_parts,
)
from tune.documents import CheckFailedError, NoFeasibleEffectError, refuse_unknown
from tune.documents.perception import Estimate, PerceptionTable, Scale, default_table
from tune.documents.profile import (
    AbsoluteStability,
    Design,
    LimitedBy,
    LoopProfile,
    MarginProfile,
    PerceptionProfile,
    SafeProfile,
    WorstPoint,
)
from tune.documents.scene import (
    EFFECT_NAMES,
    MARGINS,
    EffectName,
    MarginName,
    Scene,
    groups_of,
    hand_of,
)
from tune.loop.loop import Filters
from tune.optimisation.cutoffs import choose_filters
from tune.optimisation.describe import (
    NoFadeError,
    SizedCombination,
    combination_margins,
    element_profile,
    notes_of_unmet,
    why_pumped,
    with_fades,
    with_levels_and_contacts,
    with_what_is_felt,
)
from tune.optimisation.feasibility import SAME
from tune.optimisation.nash import Solution
from tune.optimisation.problem import LONGER, SLACK, DesignTask
from tune.optimisation.proved import (
    MOST_PROVED,
    Progress,
    Proved,
    best_proved,
    solve_groups,
    with_room_regained,
)
from tune.optimisation.region import PlantPoint
from tune.optimisation.solve import (
    groups,
    keep_promises,
    proofs_of,
    witnesses_of,
)

#: Proposals after the first, each warned by what the check said of the one before.
_MOST_ATTEMPTS = 4
#: Cells of the proof of a combination after which more margin is tried; the last try has all.
_CELLS = 200_000
#: Stable at twice the gain and one sample late: room for what a model leaves out.
_RECOMMENDED: MarginName = "balanced"
#: What may be favoured.
Favour = Literal["stiffness", "mass"]
_Content = dict[str, object]
#: Why an element is left out whose proof was not found.
_UNPROVED = (
    "it was not proved stable for every device of the box within the cells that are looked at; ask "
    "for less of it, or narrow the intervals of the device"
)


@typed
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
        UsageError: an effect to favour that is none.
    """
    device.require_stated()
    if favour is not None:
        refuse_unknown("favour", "effect", favour, EFFECT_NAMES)
    say = progress or _silent
    refusal = refusal_of(device, held=scene.hand != "none")
    if refusal is not None:
        raise NoFeasibleEffectError((f"device: {refusal}",))
    task = DesignTask.of(as_stored(device), scene.one_of_each(), table or default_table(), favour)
    choices, known = choose_filters(task, say), dict[Filters, Proved]()
    while True:
        best = best_proved(task, choices, known, say)
        try:
            return _certified(best, scene, say)
        except CheckFailedError as error:
            choices = [each for each in choices[:MOST_PROVED] if each[0] != best.choice]
            if not choices:
                less = best.task.with_less_to_prove(error.unproved, _UNPROVED)
                if less is None:
                    raise
                say("tuning without what is not proved")
                task, choices, known = less, choose_filters(less, say), {}


def _certified(best: Proved, scene: Scene, say: Progress) -> SafeProfile:
    """The profile of the largest effects with some filters, of a little less where proofs fail."""
    # What vibrates freely needs few cells or far too many.
    free = scene.hand == "none" and best.task.device.modes
    cells = _CELLS // 12 if free else _CELLS
    for attempt in range(_MOST_ATTEMPTS + 1):
        best, design, witnesses = _proposed(best, say)
        say("certifying")
        try:
            last = attempt == _MOST_ATTEMPTS or best.task.slack >= SLACK[-2]
            certificate = certify(design, None if last else cells, witnesses)
        except CheckFailedError as error:
            warned = _warned(best.task, error, witnesses)
            if warned is None or attempt == _MOST_ATTEMPTS:
                raise
            task, solutions = solve_groups(warned, best.filters, say)
            best = replace(best, task=task, solutions=solutions)
            continue
        # What is alike an element that was tuned plays the same.
        if len(scene.elements) > len(best.task.scene.elements):
            from tune.optimisation.alike import with_all_alike

            design = with_all_alike(design, scene)
        profile = SafeProfile.model_validate({**dict(design), "certificate": certificate})
        return as_stored(profile).signed()
    raise AssertionError("the last attempt returns or raises")


def _silent(sentence: str) -> None:
    """No report of progress."""


def _proposed(best: Proved, say: Progress) -> tuple[Proved, Design, dict[str, AbsoluteStability]]:
    """The largest effects of every group as a design, and what proves its clamps, as stored."""
    best = replace(best, solutions=with_room_regained(best.solutions))
    task, solutions = best.task, best.solutions
    dropped = with_what_is_felt(task, best.filters, solutions)
    if not any(solved.by_label() for solved in solutions):
        raise NoFeasibleEffectError(tuple(f"{label}: {why}" for label, why in dropped.items()))
    design = design_of(task, best.filters, solutions, dropped)
    try:
        design = with_fades(design, task.scene)
    except NoFadeError as error:
        # It is left out, and the rest tuned once more, with filters of its own.
        say(f"{error} could be pumped however slowly it fades")
        less = _without_fade(best, design, str(error))
        return _proposed(best_proved(less, choose_filters(less, say), {}, say), say)
    return best, as_stored(design), witnesses_of(task, solutions)


def _without_fade(best: Proved, design: Design, element: str) -> DesignTask:
    """The task without what fades in an element: mass, and what is taken from the device."""
    task = best.task
    (own,) = (
        each
        for each in best.solutions
        if any(u.element == element and not u.settled for u in each.problem.unknowns)
    )
    fading = {
        unknown.label: why_pumped(task.scene, design, unknown, float(size))
        for unknown, size in zip(own.problem.unknowns, own.sizes, strict=True)
        if unknown.element == element and (unknown.effect == "mass" or unknown.sign < 0)
    }
    left = keep_promises(own.problem, fading)
    return replace(task, left_out=(*task.left_out, *left.items()))


def _warned(
    task: DesignTask, error: CheckFailedError, witnesses: Mapping[str, AbsoluteStability]
) -> DesignTask | None:
    """The task with the points at which its proposal was unstable; with more slack if none was."""
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
        if isinstance(point, WorstPoint)
    )
    spots = tuple(each for each in spots if each not in task.region.found)
    if not spots:
        # Shorter taps are left to try where some are long.
        long = any(each.longest_tap > LONGER for each in witnesses.values())
        end = len(SLACK) if long else -1
        slack = next((more for more in SLACK[2 * error.spent : end] if more > task.slack), None)
        return None if slack is None else replace(task, slack=slack)
    return replace(task, region=replace(task.region, found=task.region.found + spots))


def design_of(
    task: DesignTask, filters: Filters, solutions: Sequence[Solution], dropped: dict[str, str]
) -> Design:
    """What was chosen for every element, with its margins and why it is no larger, uncertified."""
    there = {unknown.element for solved in solutions for unknown in solved.problem.unknowns}
    task = task.apart_as_needed(there)
    device, scene, table = task.device, task.scene, task.table
    felt = [
        SizedCombination(solved.problem, combination, solved.sizes)
        for solved in solutions
        for combination in solved.problem.combinations
        if solved.sizes.size and any(combination.members)
    ]
    found = combination_margins(device, felt, MARGINS[scene.margin], task.slack)
    # Of every combination the elements of which something is left.
    margins = [
        found[part]._replace(elements=each)
        for each in scene.combinations()
        if (part := tuple(name for name in each if name in there)) in found
    ]
    absolute = proofs_of(solutions)
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
            *notes_of_unmet(task, filters, elements, solutions),
            *(note_of_apart(pair) for pair in task.apart),
        ),
        method=methods,
    )
    design = with_levels_and_contacts(design, device, task.region.box)
    return design.model_copy(update={"skipped": skipped_parts(design)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A scene tuned with one margin, or with one effect favoured: its certified profile, if any.

    The error says with its numbers why nothing can be rendered, or nothing certified.
    """

    margin: MarginName
    profile: SafeProfile | None
    error: NoFeasibleEffectError | CheckFailedError | None
    favour: Favour | None = None

    @property
    def name(self) -> str:
        """The margin, or what there is more of with the scene's margin."""
        return self.margin if self.favour is None else f"more {self.favour}"

    @property
    def recommended(self) -> bool:
        """The one to take where nothing speaks for another."""
        return self.margin == _RECOMMENDED and self.favour is None


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateEffect:
    """One effect of one element of a candidate, by its name: a row of the comparison.

    Values are SI, 0 where the effect was dropped; steps have the interval that the perception table
    leaves them; the ripple of force is N (N·m) rms, None where the encoder is not known.
    """

    candidate: str
    margin: MarginName
    element: str
    effect: EffectName
    value: float
    steps: Estimate
    gain: float
    extra_delay_samples: float
    ripple: float | None
    limited_by: LimitedBy


@typed
def candidates(
    device: Device,
    scene: Scene,
    *,
    table: PerceptionTable | None = None,
    progress: Progress | None = None,
) -> tuple[Candidate, ...]:
    """The scene tuned with the conservative, the balanced and the firm margin, in this order.

    Then with its own margin and more stiffness, and more mass, where it leaves both open. Three to
    five times the work of `optimise`.

    Args:
        device: identified, or from a data sheet with intervals.
        scene: what is wanted.
        table: Weber fractions; None is the paper's study.
        progress: called with a sentence before each part of the work.
    """

    def tuned(margin: MarginName, favour: Favour | None = None) -> Candidate:
        def say(sentence: str) -> None:
            if progress is not None:
                more = "" if favour is None else f", more {favour}"
                progress(f"{margin} margin{more}: {sentence}")

        wanted = scene.model_copy(update={"margin": margin})
        try:
            profile = optimise(device, wanted, table=table, favour=favour, progress=say)
        except (NoFeasibleEffectError, CheckFailedError) as error:
            return Candidate(margin=margin, profile=None, error=error, favour=favour)
        return Candidate(margin=margin, profile=profile, error=None, favour=favour)

    chosen: tuple[Favour, ...] = ("stiffness", "mass")
    wishes = [wish for each in scene.elements.values() for wish in each.wishes().items()]
    left_open = {effect for effect, wish in wishes if wish.kind != "value"}
    favours = chosen if left_open.issuperset(chosen) else ()
    return (
        *(tuned(margin) for margin in MARGINS),
        *(tuned(scene.margin, favour) for favour in favours),
    )


def compare_candidates(
    found: tuple[Candidate, ...], table: PerceptionTable | None = None
) -> tuple[CandidateEffect, ...]:
    """Every effect of every candidate, effect by effect, those of one effect from safe to firm.

    Args:
        found: by `candidates`.
        table: the one they were tuned with; None is the paper's study.
    """
    table = table or default_table()
    rows = [
        CandidateEffect(
            candidate=candidate.name,
            margin=candidate.margin,
            element=name,
            effect=effect,
            value=getattr(element, effect),
            steps=_estimate(candidate.profile, name, effect, table),
            gain=element.margins.gain,
            extra_delay_samples=element.margins.extra_delay_samples,
            ripple=element.ripple,
            limited_by=element.limited_by[effect],
        )
        for candidate in found
        if candidate.profile is not None
        for name, element in candidate.profile.elements.items()
        for effect in EFFECT_NAMES
        if effect in element.limited_by
    ]
    places = list(dict.fromkeys((row.element, row.effect) for row in rows))
    return tuple(sorted(rows, key=lambda row: places.index((row.element, row.effect))))


def _estimate(
    profile: SafeProfile, name: str, effect: EffectName, table: PerceptionTable
) -> Estimate:
    """The steps that a profile states, with the interval that the table leaves them."""
    element = profile.elements[name]
    scale = Scale.of(effect, profile.device, table, element.motion)
    steps = element.perceived_steps.get(effect, 0.0)
    felt = scale.value_at(steps, -1 if getattr(element, effect) < 0 else 1)
    return replace(scale.estimate(felt, table.fraction(effect)), value=steps)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """A scene tuned on the device with one fact of its hardware changed.

    Attributes:
        change: in words; "as it is" for the device unchanged.
        steps: perceived steps by "element.effect", of the effects that act.
        total: their sum; 0 where nothing could be tuned.
        reason: why there is no profile; None where there is one.
    """

    change: str
    steps: dict[str, float]
    total: float
    reason: str | None = None


@typed
def what_if(
    device: Device,
    scene: Scene,
    *,
    table: PerceptionTable | None = None,
    profile: SafeProfile | None = None,
    progress: Progress | None = None,
) -> tuple[Alternative, ...]:
    """Tune a scene on a device and on the same device with one fact changed at a time.

    Half the delay, twice the sample rate (the delay in seconds stays), an encoder twice as fine,
    an actuator twice as strong, half and twice the damping, and each vibration mode damped twice as
    well. What the device does not state is left out. Steps count from the device at hand: with
    twice the damping a virtual damper starts from twice as much.

    Args:
        device: as it is.
        scene: what is wanted.
        table: Weber fractions; None is the paper's study.
        profile: of the device as it is, where it was tuned already.
        progress: called with a sentence before each part of the work.

    Returns:
        The device as it is, then the changes, the most perceived steps first.

    Raises:
        UnstatedError, NoFeasibleEffectError, CheckFailedError: of the device as it is.
    """
    say = progress or _silent
    known = profile or optimise(device, scene, table=table, progress=say)
    found: list[Alternative] = []
    changes = tuple(_changed(device))
    for number, (change, content) in enumerate(changes, 1):
        say(f"tuning for {change} ({number} of {len(changes)})")
        try:
            other = as_stored(parse_document(Device, content, f"the device with {change}"))
            found.append(_alternative(change, optimise(other, scene, table=table)))
        except (NoFeasibleEffectError, CheckFailedError, InvalidInputError) as error:
            found.append(Alternative(change=change, steps={}, total=0.0, reason=str(error)))
    found.sort(key=lambda each: -each.total)
    return (_alternative("as it is", known), *found)


def _alternative(change: str, profile: SafeProfile) -> Alternative:
    steps = {
        f"{name}.{effect}": count
        for name, element in profile.elements.items()
        for effect, count in element.perceived_steps.items()
    }
    return Alternative(change=change, steps=steps, total=sum(steps.values()))


def _changed(device: Device) -> Iterator[tuple[str, _Content]]:
    """Each change in words with the content of the changed device's file."""
    content = to_mapping(device)

    def scaled(key: str, factor: float) -> _Content:
        return content | {key: _scaled(content[key], factor)}

    if device.delay.high > 0:
        yield "half the delay", scaled("delay", 0.5)
    yield "twice the sample rate", scaled("sample_time", 0.5)
    if device.encoder_resolution is not None:
        yield "an encoder twice as fine", scaled("encoder_resolution", 0.5)
    if device.force_limit is not None:
        yield "twice the force", scaled("force_limit", 2.0)
    for words, factor in (("half the damping", 0.5), ("twice the damping", 2.0)):
        keys = ("damping", "damping_slope", "damping_by_direction")
        yield words, content | {k: _scaled(content[k], factor) for k in keys if k in content}
    for place, mode in enumerate(device.modes):
        given = mode.damping_ratio
        ratio = quantity(given.value * 2.0, given.low * 2.0, given.high * 2.0)
        better = list(device.modes)
        better[place] = mode.model_copy(update={"damping_ratio": ratio})
        words = f"the mode at {mode.frequency_hz.value:.4g} Hz damped twice as well"
        yield words, to_mapping(device.model_copy(update={"modes": tuple(better)}))


def _scaled(item: object, factor: float) -> object:
    """A number of a file, or every number in a mapping, times a factor."""
    if isinstance(item, dict):
        parts = cast("dict[str, object]", item)
        return {key: _scaled(part, factor) for key, part in parts.items()}
    return item * factor if isinstance(item, int | float) else item
