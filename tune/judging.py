"""What is there already: are gains safe on a device, why not; does an old profile still hold.

**Audit** judges gains as one element of a scene and finds the nearest safe ones.

**Compare** tells what changed between two devices or two profiles. A quantity counts as changed
where the two intervals have no value in common: two 95 % intervals of the same truth miss one
another in fewer than one comparison of a hundred. An old profile holds where its effects, filters
and margin are proved anew over the box of the new device.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import combinations_with_replacement
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from identification import Device, Tabular, UsageError, as_stored, parse_document, to_mapping, typed
from tune.certificate.certify import certify, refusal_of
from tune.documents import CheckFailedError, refuse_unknown
from tune.documents.changes import Change, Interval, changes_of, exact, renamed, stated
from tune.documents.perception import Scale, default_table
from tune.documents.profile import (
    AbsoluteStability,
    Certificate,
    Contact,
    Design,
    Margins,
    SafeProfile,
    WorstPoint,
)
from tune.documents.scene import (
    DEFAULT_MOTION,
    EFFECT_NAMES,
    LARGEST,
    MARGINS,
    EffectName,
    Effects,
    Margin,
    MarginName,
    Scene,
)
from tune.loop.loop import Filters, Loop, used_filters
from tune.margins import LoopMargins, margins_of
from tune.optimisation import design_of
from tune.optimisation.feasibility import forces, ripple, round_sizes, worst_gain
from tune.optimisation.nash import AllFound, Solution, largest_product
from tune.optimisation.problem import SLACK, DesignTask, Problem, may_saturate, problem_of
from tune.optimisation.solve import backends, reasons_for_nothing, witnesses_of
from tune.rendering import contact, count_jump
from tune.stability.criterion import Passivity, passivity

FloatArray = NDArray[np.float64]

Word = Literal[
    "device", "stability", "gain-margin", "delay-margin", "force", "ripple", "lead", "certificate"
]
#: What stability rests on; force limit and encoder are judged against where they are stated.
NEEDED: Final = ("motion", "sample_time", "delay")
#: The one element of the scene that an audit makes of the gains.
ELEMENT = "gains"
#: A lead is stated in four digits.
_ROUNDED = 1e-3
#: What stays this close to the least size that is looked at is nothing.
_MORE = 10.0


@dataclass(frozen=True, slots=True)
class Fault:
    """One reason why gains are not fit: which limit, what was seen, what is needed."""

    limit: Word
    seen: str
    needed: str
    remedy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Audit(Tabular):
    """What gains amount to on a device, over the whole box of what is not known of it.

    Attributes:
        design: the gains as a profile would state them.
        gain: stable for every gain in (0, gain] over the box's corners; 0 where small gains are
            unstable.
        delay_samples: extra delay at which every gain in (0, 1] is stable, nan if none.
        margins: of the device at its best estimate; None where it is unstable.
        passivity: Colgate and Schenkel's condition for the device in any passive hand.
        sustained: K·penetration, N; None where the force is cut at its limit.
        peak: with |B|·speed and |M|·acceleration, N.
        ripple: of the force, N rms; None without an encoder resolution or where it is unstable.
        wall: what a free device meets that runs into these gains as a wall that only pushes; at
            the speed of the default motion.
        lead: how far before its face a wall may be met, m; None where none is asked for.
        jumps: force that one count of the encoder causes through each effect, N.
        faults: empty where the gains are safe.
        nearest: the nearest safe values, None where the gains are safe or nothing is.
        certificate: of safe gains.
    """

    design: Design
    gain: float
    delay_samples: float
    margins: LoopMargins | None
    passivity: Passivity
    sustained: float | None
    peak: float | None
    ripple: float | None
    wall: Contact
    lead: float | None
    jumps: dict[EffectName, float]
    faults: tuple[Fault, ...]
    nearest: Effects | None
    certificate: Certificate | None

    def __repr__(self) -> str:
        faults = ", ".join(fault.limit for fault in self.faults) or "none"
        return (
            f"Audit({'safe' if self.safe else 'not safe'}: gain {self.gain:.4g}, "
            f"{self.delay_samples:.3g} extra samples of delay, faults: {faults})"
        )

    def _rows(self) -> list[dict[str, object]]:
        margin, limit = self.design.margin, self.design.device.force_limit
        return [
            {"quantity": name, "seen": value, "needed": needed}
            for name, value, needed in (
                ("gain_margin", self.gain, margin.gain),
                ("extra_delay_samples", self.delay_samples, float(margin.extra_delay_samples)),
                ("sustained_force", self.sustained, limit and limit.continuous),
                ("peak_force", self.peak, limit and limit.peak),
                ("ripple", self.ripple, self.design.ripple_limit),
                ("lead", self.wall.lead, self.lead),
            )
        ]

    @property
    def jitter(self) -> float:
        """Part of the sample time by which each step may vary, at the corners of the box."""
        return self.design.elements[ELEMENT].margins.jitter or 0.0

    @property
    def safe(self) -> bool:
        """True when nothing was found and the independent check agrees."""
        return not self.faults and self.certificate is not None


@typed
def audit(
    device: Device,
    effects: Effects,
    *,
    filters: Filters | None = None,
    margin: MarginName | None = None,
    extra_delay_samples: float = 0.0,
    like: tuple[Design, str] | None = None,
    proved: bool = True,
) -> Audit:
    """Judge K, B and M as one element of a scene, met alone.

    Stability rests on motion, sample time and delay, which have to be stated. Force and ripple are
    judged where force limit and encoder are stated too, never against what a log suggests.

    Args:
        device: with its intervals.
        effects: numbers; zero is the same as absent.
        filters: of the controller; None is plain backward differences.
        margin: what is asked for; None is that of the profile, balanced without one.
        extra_delay_samples: on top of the device's delay, from now on part of it.
        like: a profile and the name of its element as which they are judged: a wall, cut at its
            level of force, in its motion and hand, rippling and met before its face as much as is
            allowed there. None is an element that is neither, in the usual motion, in no hand.
        proved: False leaves out certificate and nearest safe values, which take most of the time;
            nothing is safe then.

    Raises:
        UnstatedError: motion, sample time or delay that a person has to state.
        LoopError: a delay that cannot be judged.
        InvalidInputError: values no scene can hold.
        UsageError: several gains, no such element, an extra delay below zero.
    """
    device.require_stated(NEEDED)
    if not extra_delay_samples >= 0:
        seen = f"{extra_delay_samples:g} would take away from the delay of the device"
        raise UsageError("--extra-delay-samples", seen, "Give 0 or more, or correct the device")
    if several := [size.shape for size in effects.present().values() if size.ndim]:
        raise UsageError("effects", f"an array of shape {several[0]}", "Judge one of each a call")
    if like is not None:
        refuse_unknown("like", "element", like[1], like[0].elements)
    filters = filters or Filters()
    margin = margin or ("balanced" if like is None else like[0].margin.name)
    later = to_mapping(_as_judged(device, float(extra_delay_samples)))
    device = parse_document(Device, later, "the device with its extra delay")
    scene = parse_document(
        Scene, _scene_of(effects, filters, margin, like), "the gains and filters"
    )
    task = DesignTask.of(device, scene, default_table())
    cut = frozenset[str]() if like is None else may_saturate(task, [ELEMENT])
    problem = problem_of(task, elements=[ELEMENT], filters=filters, cut=cut, felt=False)
    sizes = np.array([abs(unknown.wish.high or 0.0) for unknown in problem.unknowns])
    (combination,) = problem.combinations
    gain = worst_gain(problem, combination, sizes, late=False)
    stable = gain > 1
    solved = Solution(problem=problem, sizes=sizes, dropped={})
    design = as_stored(design_of(task, filters, [solved], {}))
    late = design.elements[ELEMENT].margins.extra_delay_samples
    noise = ripple(problem, combination, sizes) if stable else None
    refusal = refusal_of(device, held=design.hand is not None)
    level = design.elements[ELEMENT].force_level
    if like is not None:
        level = min(level, like[0].elements[like[1]].force_level or level)
    changed = {"one_sided": True, "force_level": level}
    wall = design.elements[ELEMENT].model_copy(update=changed)
    extra, lead = problem.margin.extra_delay_samples, scene.elements[ELEMENT].lead
    met = contact(design.device, problem.region.box, problem.filters, wall, extra)
    faults = tuple(_faults_of(problem, MARGINS[margin], sizes, gain, noise))
    if lead is not None and met.lead is not None and met.lead > lead * (1 + _ROUNDED):
        seen, remedy = f"it is met {met.lead:.4g} before its face", "Lower the damping."
        faults = (*faults, Fault("lead", seen, f"{lead:g} at most", remedy))
    if refusal is not None:
        faults = (Fault(limit="device", **asdict(refusal)), *faults)
    certificate = None
    if proved and not faults:
        try:
            design, certificate = _certified(task, filters, solved)
        except CheckFailedError as error:
            least = "Lower the gains."
            faults = tuple(Fault("certificate", why, "proved", least) for why in error.failures)
    sustained, peak = (None if cut else float(force) for force in forces(combination, sizes))
    total = problem.effects(combination, sizes)
    used, count = used_filters(filters, total), device.encoder_resolution
    return Audit(
        design=design,
        gain=gain,
        delay_samples=late if stable else np.nan,
        margins=margins_of(Loop.from_parts(device, used), total) if stable else None,
        passivity=passivity(device, total, used),
        sustained=sustained,
        peak=peak,
        ripple=noise,
        wall=met,
        lead=lead,
        jumps={}
        if count is None
        else count_jump(total, device.sample_time.value, count.value, filters),
        faults=faults,
        nearest=_nearest(task, filters, cut) if proved and faults and refusal is None else None,
        certificate=certificate,
    )


def _faults_of(
    problem: Problem, margin: Margin, sizes: FloatArray, gain: float, noise: float | None
) -> Iterator[Fault]:
    """Every limit that the sizes break, in words; their gain margin and ripple are known."""
    (combination,) = problem.combinations
    limits = problem.limits
    late = worst_gain(problem, combination, sizes)
    extra = f"{margin.extra_delay_samples} extra sample{'s' * (margin.extra_delay_samples > 1)}"
    needed, smaller = f"{margin.gain:g}", "Lower the gains, or filter velocity and acceleration."
    if gain <= 1:
        upto = f": every gain from 0 holds up to {gain:.4g} of these" if gain else ""
        yield Fault("stability", f"unstable{upto}", needed, smaller)
    elif gain <= margin.gain:
        yield Fault("gain-margin", f"stable up to {gain:.4g} of these gains", needed, smaller)
    elif late <= margin.gain:
        seen = f"with {extra} of delay stable up to {late:.4g} of these gains"
        yield Fault("delay-margin", seen, needed, "Lower the gains, or shorten the delay.")
    words = ("K·penetration", "K·penetration + |B|·speed + |M|·acceleration")
    most = (limits.continuous_force, limits.peak_force)
    for name, force, limit in zip(words, forces(combination, sizes), most, strict=True):
        if limit is not None and force > limit:
            remedy = "Lower the gains, or keep to less penetration."
            yield Fault("force", f"{name} is {force:.4g}", f"{limit:.4g} at most", remedy)
    if noise is not None and noise > limits.ripple:
        seen = f"the encoder makes the force ripple by {noise:.3g} rms"
        unnoticed = f"{limits.ripple:g} at most, what a hand does not notice"
        remedy = "Filter velocity and acceleration, or lower damping and mass."
        yield Fault("ripple", seen, unnoticed, remedy)


def _certified(task: DesignTask, filters: Filters, solved: Solution) -> tuple[Design, Certificate]:
    """The gains with all the margin that can be proved, at least the one asked for."""
    solved = replace(solved, absolute=_clamps_of(solved.problem, solved.sizes))
    for slack in (0.0, *SLACK[:-1]):
        task = replace(task, slack=slack)
        design = as_stored(design_of(task, filters, [solved], {}))
        # Whether gains in use are felt as such is told, and no fault of theirs.
        design = design.model_copy(update={"perception": None})
        try:
            return design, certify(design, witnesses=witnesses_of(task, [solved]))
        except CheckFailedError as error:
            found = (point for point in error.points if isinstance(point, WorstPoint))
            if slack == SLACK[-2] or any(p.gain == design.margin.gain for p in found):
                raise
    raise AssertionError("the last attempt returns or raises")


def _clamps_of(problem: Problem, sizes: FloatArray) -> AllFound:
    """The proved gain of the gains where their force may be cut; empty where it may not."""
    if not any(combination.absolute for combination in problem.combinations):
        return {}
    from tune.optimisation.saturation import prove_combinations

    return prove_combinations(problem, sizes)


def _scene_of(
    effects: Effects, filters: Filters, margin: MarginName, like: tuple[Design, str] | None
) -> dict[str, object]:
    """A scene file of these gains with these filters: its ranges are those of an audit."""
    asked: dict[str, object] = {
        name: float(size) for name, size in effects.present().items() if size != 0
    }
    loop: dict[str, object] = {
        "velocity_filter_hz": filters.velocity_filter_hz or "none",
        "acceleration_filter_hz": filters.acceleration_filter_hz or "none",
    }
    scene: dict[str, object] = {"name": "audit", "margin": margin, "loop": loop}
    if like is not None:
        element = like[0].elements[like[1]]
        asked |= {"one_sided": element.one_sided, **to_mapping(element.motion)}
        # One that is told which damping to have no lead limits.
        noted = any(note.startswith(f"{like[1]}.damping: ") for note in like[0].notes)
        wanted = noted or element.limited_by.get("damping") == "wanted"
        if element.lead is not None and not wanted:
            asked["lead"] = element.lead
        scene |= {"ripple_limit": like[0].ripple_limit, "hand": like[0].hand or "none"}
    return scene | {"elements": {ELEMENT: asked}}


def _as_judged(device: Device, samples: float) -> Device:
    """The device with its extra delay, without force limit and encoder that nobody stated."""
    delay, step = device.delay, device.sample_time.value
    shift = {name: getattr(delay, name) + samples * step for name in ("value", "low", "high")}
    later = {"delay": delay.model_copy(update=shift)}
    return device.model_copy(update={**dict.fromkeys(device.unstated()), **later})


def _nearest(task: DesignTask, filters: Filters, cut: frozenset[str]) -> Effects | None:
    """The safe values closest to those wanted on the perceptual scale; what none is, left out."""
    gone: frozenset[str] = frozenset()
    problem = problem_of(task, elements=[ELEMENT], filters=filters, cut=cut, felt=False)
    while impossible := reasons_for_nothing(problem):
        gone |= impossible.keys()
        problem = problem_of(
            task, elements=[ELEMENT], filters=filters, gone=gone, cut=cut, felt=False
        )
    if not problem.unknowns:
        return None
    found = largest_product(problem, backends())
    if found.sizes is None:
        return None
    sizes = round_sizes(problem, found.sizes)
    if any(one.gain < problem.proved_gain for one in _clamps_of(problem, sizes).values()):
        return None
    lows = np.array([unknown.low for unknown in problem.unknowns])
    return problem.effects(problem.combinations[0], np.where(sizes > _MORE * lows, sizes, 0.0))


#: How closely the gain that is kept is found, as part of the margin, and how much of it the next
#: log of a device that did not change may cost.
_STEP = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Felt:
    """What a hand can tell of one effect: steps from old to new, below zero where it is less."""

    name: str
    steps: float

    @property
    def differs(self) -> bool:
        """Whether it is a step or more."""
        return abs(self.steps) >= 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison(Tabular):
    """What changed.

    Attributes:
        kind: "devices", "profiles", or "profile and device".
        changes: of the devices, in the order of their files.
        effects: of the profiles, none where one of the two is a device.
        failures: why the old profile does not hold on the new device; empty where it does.
        gain: margin that the old profile keeps there, as proved, with the extra delay of its
            margin; None without an old profile, or where forces or ripple are what fails.
        judged: whether there was an old profile to judge.
        at_margin: whether it fails by less than a hundredth of its gain margin, all else proved, on
            a device of which nothing changed beyond both intervals.
        felt: of the device's own mass, damping and friction, and of every effect.
        renamed: name, axis and serial number that are not the same, as "axis x → y".
    """

    kind: str
    changes: tuple[Change, ...]
    effects: tuple[Change, ...] = ()
    failures: tuple[str, ...] = ()
    gain: float | None = None
    judged: bool = False
    felt: tuple[Felt, ...] = ()
    renamed: tuple[str, ...] = ()
    at_margin: bool = False

    def _rows(self) -> list[dict[str, object]]:
        steps = {felt.name: felt.steps for felt in self.felt}
        return [
            {
                "quantity": each.name,
                "old": each.old and each.old.value,
                "new": each.new and each.new.value,
                "part": each.part,
                "beyond": each.beyond,
                "steps": steps.get(each.name),
            }
            for each in (*self.changes, *self.effects)
        ]

    @property
    def holds(self) -> bool | None:
        """Whether the old profile holds on the new device; None without an old profile."""
        return not self.failures if self.judged else None


@typed
def compare(old: Device | SafeProfile, new: Device | SafeProfile) -> Comparison:
    """Compare two devices, two profiles, or an old profile with a new device.

    An old profile is proved anew over the box of the new device, with its own margin.

    Raises:
        UsageError: an old device with a new profile, axes of different motion, or other axes.
        UnstatedError: facts of the new device that a person has to state before it is judged.
    """
    before, after = (each if isinstance(each, Device) else each.device for each in (old, new))
    if before.motion != after.motion:
        seen = f"the old axis is {before.motion}, the new one {after.motion}"
        raise UsageError("OLD NEW", seen, "Compare files of one motion")
    old_axes, new_axes = (sorted(each.axes or ()) for each in (before, after))
    if old_axes != new_axes:
        known = [", ".join(axes) or "one axis" for axes in (old_axes, new_axes)]
        seen = f"the old device has {known[0]}, the new one {known[1]}"
        raise UsageError("OLD NEW", seen, "Compare files of the same axes")
    changes = changes_of(before, after)
    called = renamed(before, after)
    if isinstance(old, Device):
        if isinstance(new, SafeProfile):
            raise UsageError("OLD NEW", "are a device and a profile", "Swap them")
        felt = tuple(_felt(old, after))
        return Comparison(kind="devices", changes=changes, felt=felt, renamed=called)
    failures, gain, nearly = tuple[str, ...](), old.margin.gain, False
    after.require_stated()
    try:
        certify(_moved(old, after), witnesses=_witnesses(old, gain))
    except CheckFailedError as error:
        failures, most = error.failures, (1 - _STEP) * gain
        unchanged = not any(change.beyond for change in changes)
        nearly = unchanged and _is_proved(old, _moved(old, after), most)
        kept = most if nearly else _kept_gain(old, after)
        gain = kept if kept < gain else None
    both = isinstance(new, SafeProfile)
    return Comparison(
        kind="profiles" if both else "profile and device",
        changes=changes,
        effects=_effects(old, new) if both else (),
        failures=failures,
        gain=gain,
        judged=True,
        felt=(*_felt(before, after), *(_felt_effects(old, new) if both else ())),
        renamed=called,
        at_margin=nearly,
    )


def _felt(old: Device, new: Device) -> Iterator[Felt]:
    """The device itself, by the default perception table in the usual motion."""
    table, motion = default_table(), DEFAULT_MOTION[old.motion]
    for effect in ("mass", "damping"):
        if old.axes is not None and new.axes is not None:
            for name, along, more in _felt_entries(effect, old, new):
                scale = Scale.of(effect, along, table, motion)
                yield Felt(name=name, steps=_signed_steps(scale, more))
        else:
            scale = Scale.of(effect, old, table, motion)
            more: float = getattr(new, effect).value - getattr(old, effect).value
            yield Felt(name=effect, steps=_signed_steps(scale, more))
    # Friction resists as damping does at one speed: as finely is its force told.
    weber, floor = table.fraction("damping").value, table.threshold(old.motion)
    for name, before, after in _frictions(old, new):
        scale = Scale(reference=before, weber=weber, floor=floor)
        yield Felt(name=name, steps=_signed_steps(scale, after - before))


def _frictions(old: Device, new: Device) -> Iterator[tuple[str, float, float]]:
    """Coulomb friction, old and new, of each axis; of several poses of the first."""
    if old.axes is None:
        yield "coulomb_friction", old.coulomb_friction.value, new.coulomb_friction.value
        return
    tables = [device.by_axis() for device in (old, new)]
    for name in (f"coulomb_friction_{axis}" for axis in sorted(old.axes)):
        before, after = (table[name][0].value for table in tables)
        yield _first_pose(old, new) + name, before, after


def _first_pose(old: Device, new: Device) -> str:
    """What entries of the first pose begin with, where both have as many, and several."""
    counts = {len(device.poses or ()) for device in (old, new)}
    return "pose_1." if len(counts) == 1 and counts != {1} else ""


def _felt_entries(effect: str, old: Device, new: Device) -> Iterator[tuple[str, Device, float]]:
    """Each entry that both have, the old device where it is felt most, and the difference."""
    axes = old.axes or ()
    tables = [device.by_axis() for device in (old, new)]
    for one, other in combinations_with_replacement(sorted(axes), 2):
        name = f"{effect}_{one}_{other}"
        if name in tables[1]:
            unit = np.array([float(axis in {one, other}) for axis in axes])
            before, after = (table[name][0].value for table in tables)
            yield (
                _first_pose(old, new) + name,
                old.along((unit / np.linalg.norm(unit)).tolist()),
                after - before,
            )


def _felt_effects(old: Design, new: Design) -> Iterator[Felt]:
    """Each effect, on the old device and in the motion of the design that has it."""
    for name, effect, sizes in _sizes(old, new):
        motion = next(d.elements[name].motion for d in (old, new) if name in d.elements)
        scale = Scale.of(effect, old.device, default_table(), motion)
        before, after = (_signed_steps(scale, size) for size in sizes)
        if any(sizes):
            yield Felt(name=f"{name}.{effect}", steps=after - before)


def _sizes(old: Design, new: Design) -> Iterator[tuple[str, EffectName, list[float]]]:
    """Every effect of every element of both, old and new, 0 where it is not there."""
    for name in dict.fromkeys((*old.elements, *new.elements)):
        both = [design.elements.get(name) for design in (old, new)]
        for effect in EFFECT_NAMES:
            yield name, effect, [0.0 if each is None else getattr(each, effect) for each in both]


def _signed_steps(scale: Scale, value: float) -> float:
    return float(np.copysign(scale.steps(value), value))


def _kept_gain(design: SafeProfile, device: Device) -> float:
    """The gain margin, at most the one asked for, that is proved on another device; 0 for none.

    With the extra delay of the margin, and within a hundredth of it below the largest. Force and
    ripple are not looked at.
    """
    moved = _moved(design, device.model_copy(update={"force_limit": None})).model_copy(
        update={"ripple_limit": LARGEST}
    )
    kept, lost = 0.0, design.margin.gain

    if _is_proved(design, moved, lost):
        return lost
    while lost - kept > _STEP * design.margin.gain:
        middle = (kept + lost) / 2
        kept, lost = (middle, lost) if _is_proved(design, moved, middle) else (kept, middle)
    return kept


def _is_proved(design: SafeProfile, moved: Design, gain: float) -> bool:
    margin = moved.margin.model_copy(update={"gain": gain})
    try:
        certify(moved.model_copy(update={"margin": margin}), witnesses=_witnesses(design, gain))
    except CheckFailedError:
        return False
    return True


def _witnesses(design: SafeProfile, gain: float) -> dict[str, AbsoluteStability]:
    """The multipliers of a profile, asked for no more than a gain."""
    stated = design.certificate.absolute_stability or {}
    return {name: each.model_copy(update={"gain": gain}) for name, each in stated.items()}


def _moved(design: SafeProfile, device: Device) -> Design:
    """The design on another device, its claims those of its margin and no more.

    What the design states of the device it was made for, such as margins beyond the one asked for
    and what is felt, is not asked of the other one.
    """
    extra = float(design.margin.extra_delay_samples)
    kept = Margins(gain=0.0, extra_delay_samples=extra, passive=False)
    bare: dict[str, object] = {
        "margins": kept,
        "ripple": LARGEST,
        "rendered": None,
        "perceived_steps": {},
    }
    unclaimed = {name: each.model_copy(update=bare) for name, each in design.elements.items()}
    return design.model_copy(
        update={"device": as_stored(device), "elements": unclaimed, "perception": None}
    )


def _effects(old: Design, new: Design) -> tuple[Change, ...]:
    """Every effect that acts in at least one of the designs."""
    sides: dict[str, list[Interval | None]] = {
        f"{name}.{effect}": [exact(size) if size else None for size in sizes]
        for name, effect, sizes in _sizes(old, new)
    }
    return stated(sides)
