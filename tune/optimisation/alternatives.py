"""A scene tuned otherwise: with other margins or an effect favoured, or on changed hardware.

With one margin the largest product of steps is one point of many that no other exceeds in every
effect (Pareto). Two more of them are shown: more of the stiffness and more of the mass.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from identification import (
    Device,
    InvalidInputError,
    as_stored,
    parse_document,
    quantity,
    to_mapping,
)
from tune.documents import CheckFailedError, NoFeasibleEffectError
from tune.documents.perception import Estimate, PerceptionTable, Scale, default_table
from tune.documents.profile import LimitedBy, SafeProfile
from tune.documents.scene import EFFECT_NAMES, MARGINS, EffectName, MarginName, Scene
from tune.optimisation._optimise import Progress, optimise, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification import Motion

#: Stable at twice the gain and one sample late: room for what a model leaves out.
RECOMMENDED: MarginName = "balanced"
#: What may be favoured.
Favour = Literal["stiffness", "mass"]
#: Of the height of an effect that its bars take up.
_FILLED = 0.8
#: Times the longest bar that the axis is, for the sizes beside the bars.
_ROOM = 1.15
_Content = dict[str, object]


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
        return self.margin == RECOMMENDED and self.favour is None


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
    favours = chosen if all(_left_open(scene, effect) for effect in chosen) else ()
    return (
        *(tuned(margin) for margin in MARGINS),
        *(tuned(scene.margin, favour) for favour in favours),
    )


def _left_open(scene: Scene, effect: EffectName) -> bool:
    """Whether some element asks for as much of an effect as can be."""
    wishes = [element.wishes().get(effect) for element in scene.elements.values()]
    return any(wish is not None and wish.kind != "value" for wish in wishes)


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


def candidates_picture(rows: Sequence[CandidateEffect], motion: Motion) -> Figure:
    """Perceived steps of each effect with each candidate, their values beside the bars.

    Args:
        rows: of `compare_candidates`, at least one.
        motion: of the device, which gives the units.
    """
    from identification import NotebookFigure, legend_above
    from tune.documents.scene import UNITS

    units = UNITS[motion]
    names = list(dict.fromkeys(row.candidate for row in rows))
    effects = list(dict.fromkeys((row.element, row.effect) for row in rows))
    figure = NotebookFigure(figsize=(8, 0.6 + 0.9 * len(effects)), layout="constrained")
    axes = figure.subplots()
    height = _FILLED / len(names)
    for place, name in enumerate(names):
        mine = [row for row in rows if row.candidate == name]
        lines = np.array([effects.index((row.element, row.effect)) for row in mine])
        steps = [row.steps.value for row in mine]
        at = -lines + _FILLED / 2 - height * (place + 0.5)
        axes.barh(at, steps, height=0.9 * height, label=name)
        for row, line, step in zip(mine, at.tolist(), steps, strict=True):
            axes.text(step, line, f" {row.value:.4g}", va="center", fontsize=6)
    axes.axvline(1, color="k", lw=0.8, ls=":")
    names_of_rows = [f"{element} {effect}, {units[effect]}" for element, effect in effects]
    axes.set_yticks([-k for k in range(len(effects))], names_of_rows, fontsize=8)
    axes.set_xlim(0, _ROOM * max(1.0, *(row.steps.value for row in rows)))
    axes.set_xlabel("steps a hand can tell apart; their sizes beside the bars")
    legend_above(axes)
    return figure


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
    say = progress or silent
    known = profile or optimise(device, scene, table=table, progress=say)
    found: list[Alternative] = []
    changes = tuple(_changed(device))
    for number, (change, content) in enumerate(changes, 1):
        say(f"tuning for {change} ({number} of {len(changes)})")
        try:
            other = as_stored(parse_document(Device, content, f"the device with {change}"))
            found.append(_of(change, optimise(other, scene, table=table)))
        except (NoFeasibleEffectError, CheckFailedError, InvalidInputError) as error:
            found.append(Alternative(change=change, steps={}, total=0.0, reason=str(error)))
    found.sort(key=lambda each: -each.total)
    return (_of("as it is", known), *found)


def _of(change: str, profile: SafeProfile) -> Alternative:
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
