"""A scene with each of the three margins, and with one effect favoured, to choose from.

With one margin the largest product of steps is one point of many that no other exceeds in every
effect (Pareto). Two more of them are shown: more of the stiffness and more of the mass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from identification import Device
from tune.documents.effects import EFFECT_NAMES, EffectName
from tune.documents.errors import CheckFailedError, NoFeasibleEffectError
from tune.documents.perception import Estimate, PerceptionTable, Scale, default_table
from tune.documents.profile import LimitedBy, SafeProfile
from tune.documents.scene import MARGINS, MarginName, Scene
from tune.optimisation._optimise import optimise

#: Stable at twice the gain and one sample late: room for what a model leaves out.
RECOMMENDED: MarginName = "balanced"


#: What may be favoured.
Favour = Literal["stiffness", "mass"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A scene tuned with one margin: its certified profile, or why there is none.

    Attributes:
        margin: by name; its numbers are those of `MARGINS`.
        favour: the effect of which there is more; None where all count alike.
        profile: None where nothing can be rendered, or nothing certified.
        error: why, with its numbers; None where there is a profile.
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
    """One effect of one element with one margin: a row of the comparison.

    Attributes:
        candidate: its name.
        margin: of the candidate.
        element: name in the scene.
        effect: stiffness, damping or mass.
        value: SI; 0 where it was dropped.
        steps: perceived, with the interval that the perception table leaves them.
        gain: stable for every gain in (0, gain].
        extra_delay_samples: further whole samples of delay with every gain in (0, 1] stable.
        ripple: force from encoder quantisation, N (N·m) rms; None where the encoder is not known.
        limited_by: the constraint that binds.
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
    progress: Callable[[str], None] | None = None,
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
    groups: dict[tuple[str, EffectName], list[CandidateEffect]] = {}
    for row in rows:
        groups.setdefault((row.element, row.effect), []).append(row)
    return tuple(row for group in groups.values() for row in group)


def _estimate(
    profile: SafeProfile, name: str, effect: EffectName, table: PerceptionTable
) -> Estimate:
    """The steps that a profile states, with the interval that the table leaves them."""
    element = profile.elements[name]
    scale = Scale.of(effect, profile.device, table, element.motion)
    steps = element.perceived_steps.get(effect, 0.0)
    felt = scale.value_at(steps, -1 if getattr(element, effect) < 0 else 1)
    return replace(scale.estimate(felt, table.fraction(effect)), value=steps)
