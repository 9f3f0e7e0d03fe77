"""How finely hands tell effects apart, as data: Weber fractions and thresholds.

One file: the keys of one file.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field, model_validator

from identification import Document, load_document
from tune.documents.discrimination import Estimate, Study
from tune.documents.effects import EffectName


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
