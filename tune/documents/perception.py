"""How finely hands tell effects apart, as data: Weber fractions, thresholds, steps and chances.

One file: the table and the steps that are counted in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from statistics import NormalDist
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from identification import Device, Document, load_document
from tune.documents.discrimination import Answers, Estimate, Study
from tune.documents.effects import EffectName

FloatArray = NDArray[np.float64]


class WeberFraction(Document):
    """Smallest relative change of one effect that is noticed, with where the number is from.

    Either ``value``, as published, with its 95 % interval ``low`` to ``high`` where that is known;
    or ``study``, the counts from which it follows.

    Attributes:
        stated: w, called ``value`` in a file.
        low: of its 95 % interval.
        high: likewise.
        study: counts of a same-different study.
        people: who took part.
        source: where the numbers are from.
    """

    model_config = ConfigDict(
        validate_by_name=False,
        json_schema_extra={"oneOf": [{"required": ["value"]}, {"required": ["study"]}]},
    )

    stated: float | None = Field(default=None, alias="value", gt=0, lt=10)
    low: float | None = Field(default=None, gt=0)
    high: float | None = Field(default=None, gt=0)
    study: Study | None = None
    people: int | None = Field(default=None, ge=1)
    source: str

    @model_validator(mode="after")
    def _one_origin(self) -> WeberFraction:
        if (self.stated is None) == (self.study is None):
            raise ValueError("give either value or study, the counts it follows from")
        if (self.low is None) != (self.high is None) or (self.study and self.low is not None):
            raise ValueError("give low and high together, beside a value")
        if (
            self.stated is not None
            and self.low is not None
            and self.high is not None
            and not self.low <= self.stated <= self.high
        ):
            raise ValueError(
                f"needs low <= value <= high, not {self.low:g}, {self.stated:g}, {self.high:g}"
            )
        return self

    @property
    def value(self) -> float:
        """w, as stated or from the study."""
        if self.stated is not None:
            return self.stated
        assert self.study is not None
        return self.study.weber_fraction()

    def estimate(self) -> Estimate:
        """w with its 95 % interval; without one where the source gives none."""
        if self.study is not None:
            return self.study.weber_estimate()
        return Estimate(value=self.value, low=self.low, high=self.high)


class ForceThreshold(Document):
    """Smallest force a resting hand notices, N (N·m if rotary)."""

    value: float = Field(gt=0)
    source: str


class PerceptionTable(Document):
    """Weber fractions and thresholds; data that a user can replace with a file of this form."""

    schema_: Literal["haptune/perception/1"] = Field(default="haptune/perception/1", alias="schema")
    name: str = "perception"
    note: str = ""
    stiffness: WeberFraction
    damping: WeberFraction
    mass: WeberFraction
    force_threshold: ForceThreshold
    torque_threshold: ForceThreshold

    def threshold(self, motion: Literal["linear", "rotary"]) -> float:
        """Smallest force (N) or torque (N·m) that is noticed; also the default ripple limit."""
        return (self.force_threshold if motion == "linear" else self.torque_threshold).value

    def fraction(self, effect: EffectName) -> WeberFraction:
        """The Weber fraction of one effect."""
        return {"stiffness": self.stiffness, "damping": self.damping, "mass": self.mass}[effect]


class PublishedFraction(Document):
    """A Weber fraction from the literature, to compare with.

    Attributes:
        quantity: what was told apart.
        low: least published, equal to ``high`` where there is one number.
        high: greatest.
        people: who took part, where known.
        source: paper and conditions.
        known_from: whether the paper's abstract was read or the number is quoted from memory.
    """

    quantity: Literal["force", "stiffness", "compliance", "damping", "mass"]
    low: float = Field(gt=0)
    high: float = Field(gt=0)
    people: int | None = Field(default=None, ge=1)
    source: str
    known_from: Literal["abstract", "memory"]


class Literature(Document):
    """Published Weber fractions; nothing is computed from them."""

    schema_: Literal["haptune/weber-fractions/1"] = Field(
        default="haptune/weber-fractions/1", alias="schema"
    )
    entries: tuple[PublishedFraction, ...]


@cache
def default_table() -> PerceptionTable:
    """The paper's study turned into Weber fractions: 33.8 %, 26.7 % and 22.5 %."""
    with as_file(files("tune") / "data" / "homerehab_study.yaml") as path:
        return load_document(PerceptionTable, Path(path))


@cache
def published_fractions() -> tuple[PublishedFraction, ...]:
    """Weber fractions from the literature."""
    with as_file(files("tune") / "data" / "weber_fractions.yaml") as path:
        return load_document(Literature, Path(path)).entries


#: m and rad: the depth at which a stiffness is compared with what the device masks. The scale of
#: steps, no limit: how deep a hand goes into an element does not change them.
SCALE_DEPTH = {"linear": 0.01, "rotary": 0.1}


def references(device: Device, table: PerceptionTable) -> dict[EffectName, float]:
    """What each effect is compared with: K_ref (N/m), b (N·s/m) and m (kg).

    K_ref = max(Coulomb friction, force threshold)/`SCALE_DEPTH` is the stiffness whose force at
    10 mm (0.1 rad) just exceeds what the device masks. A device without damping of its own is given
    a hundredth of m over one second, so that the logarithm has a foot to stand on.
    """
    masked = max(device.coulomb_friction.value, table.threshold(device.motion))
    return {
        "stiffness": masked / SCALE_DEPTH[device.motion],
        "damping": max(device.damping.value, 0.01 * device.mass.value),
        "mass": device.mass.value,
    }


def perceived_steps(value: float, reference: float, weber: float) -> float:
    """|ln(1 + value/reference)| / ln(1 + w); inf where the device would feel weightless."""
    relative = 1 + value / reference
    return float(abs(np.log(relative)) / np.log1p(weber)) if relative > 0 else float("inf")


def steps_estimate(steps: float, fraction: WeberFraction) -> Estimate:
    """Perceived steps with the 95 % interval that the Weber fraction leaves them.

    The setting and the device are taken as known: steps ∝ 1/ln(1 + w).

    Args:
        steps: at the fraction's own value.
        fraction: with an interval, or the estimate has none.
    """
    weber = fraction.estimate()
    if weber.low is None or weber.high is None:
        return Estimate(value=steps)
    scale = steps * np.log1p(weber.value)
    return Estimate(
        value=steps,
        low=float(scale / np.log1p(weber.high)),
        high=float(scale / np.log1p(weber.low)),
    )


@overload
def value_at_steps(steps: float, reference: float, weber: float, sign: int) -> float: ...
@overload
def value_at_steps(steps: FloatArray, reference: float, weber: float, sign: int) -> FloatArray: ...
def value_at_steps(
    steps: float | FloatArray, reference: float, weber: float, sign: int
) -> float | FloatArray:
    """The value of the given sign that stands that many steps above (below) the bare device.

    Steps are one number or an array of any shape, and so is the answer, in the unit of the
    reference.
    """
    return reference * np.expm1(np.multiply(sign * np.log1p(weber), steps))


@dataclass(frozen=True, slots=True, kw_only=True)
class Telling:
    """How well two settings of one effect are predicted to be told apart.

    Attributes:
        steps: perceived steps between them, the d' of the pair.
        forced_choice: chance to say rightly which is greater: Φ(steps), a half for equal ones.
        answers: what people as cautious as those of the table's study would say if "equal" is an
            answer too; None where the table states a fraction without a study.
    """

    steps: Estimate
    forced_choice: Estimate
    answers: Answers | None


def chance_to_tell_apart(
    effect: EffectName,
    first: float,
    second: float,
    *,
    device: Device,
    table: PerceptionTable | None = None,
) -> Telling:
    """The chance that a hand tells two settings of one effect apart.

    Compared is what is felt: b + B, m + M, and for walls K itself as in the paper's study, though
    none below the stiffness that the device masks, K_ref of `references`. A pair like the study's
    gives back the shares the study observed; anything else is an extrapolation by Weber's law, for
    one effect changed at a time, of which the study's pooled cells are no test.

    Args:
        effect: stiffness, damping or mass.
        first: one setting, SI.
        second: the other, SI.
        device: whose m and b are felt as well.
        table: None is the paper's study.

    Raises:
        ValueError: a setting that leaves no damping or mass to be felt.
    """
    table = table or default_table()
    reference = references(device, table)[effect]
    felt = [
        max(value, reference) if effect == "stiffness" else reference + value
        for value in (first, second)
    ]
    if min(felt) <= 0:
        raise ValueError(f"{effect} felt is {min(felt):.4g}, which no ratio can be formed with")
    ratio = max(felt) / min(felt)
    fraction = table.fraction(effect)
    steps = steps_estimate(float(np.log(ratio) / np.log1p(fraction.value)), fraction)
    if fraction.study is not None:
        return Telling(
            steps=steps,
            forced_choice=fraction.study.forced_choice(ratio),
            answers=fraction.study.answers(ratio),
        )
    low, high = (None if s is None else NormalDist().cdf(s) for s in (steps.low, steps.high))
    chance = Estimate(value=NormalDist().cdf(steps.value), low=low, high=high)
    return Telling(steps=steps, forced_choice=chance, answers=None)
