"""How finely hands tell effects apart: Weber fractions, and the scale of perceived steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from identification import Device, Document, load_document
from tune.documents.scene import EffectName, Motion, Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its 95 % interval; None where its source gives no interval."""

    value: float
    low: float | None = None
    high: float | None = None


class WeberFraction(Document):
    """Smallest relative change of one effect that is noticed, with where the number is from.

    A step, d' = 1, is told rightly in 84 % of forced choices.

    Attributes:
        value: w.
        low: of its 95 % interval, where that is known.
        high: likewise.
        people: who took part.
        source: where the numbers are from.
    """

    value: float = Field(gt=0, lt=10)
    low: float | None = Field(default=None, gt=0)
    high: float | None = Field(default=None, gt=0)
    people: int | None = Field(default=None, ge=1)
    source: str

    @model_validator(mode="after")
    def _in_its_interval(self) -> WeberFraction:
        if self.low is None or self.high is None:
            if self.low != self.high:
                raise ValueError("give low and high together")
        elif not self.low <= self.value <= self.high:
            raise ValueError(
                f"needs low <= value <= high, not {self.low:g}, {self.value:g}, {self.high:g}"
            )
        return self


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


@cache
def default_table() -> PerceptionTable:
    """The Weber fractions of the paper's study: 33.8 %, 26.7 % and 22.5 %."""
    with as_file(files("tune") / "data" / "homerehab_study.yaml") as path:
        return load_document(PerceptionTable, Path(path))


#: m and rad: the depth at which a stiffness is compared with what the device masks. The scale of
#: steps, no limit: how deep a hand goes into an element does not change them.
SCALE_DEPTH = {"linear": 0.01, "rotary": 0.1}


def perception_of(scene: Scene, folder: Path) -> PerceptionTable:
    """The scene's perception table: the default, or a file named relative to ``folder``."""
    if scene.perception == "default":
        return default_table()
    return load_document(PerceptionTable, folder / scene.perception)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Steps of one effect beside what the device has of it, docs/theory.md, 8.

    A step is w of what is felt above ``corner`` and one smallest force below it: the integral of
    1/max(I, corner) over ln(1 + w), where I is device and effect together.

    Attributes:
        reference: what the device has of it: K_ref (N/m), b (N·s/m) or m (kg).
        weber: Weber fraction w.
        floor: c, whose force is the smallest that is noticed, in the unit of the reference.
    """

    reference: float
    weber: float
    floor: float

    @classmethod
    def of(
        cls, effect: EffectName, device: Device, table: PerceptionTable, motion: Motion
    ) -> Scale:
        """The scale of an effect that is felt in a motion.

        K_ref = max(Coulomb friction, force threshold)/`SCALE_DEPTH` is the stiffness whose force at
        10 mm (0.1 rad) just exceeds what the device masks. A device without damping of its own is
        given a hundredth of m over one second.
        """
        threshold, depth = table.threshold(device.motion), SCALE_DEPTH[device.motion]
        reference, reach = {
            "stiffness": (max(device.coulomb_friction.value, threshold) / depth, depth),
            "damping": (max(device.damping.value, 0.01 * device.mass.value), motion.speed),
            "mass": (device.mass.value, motion.acceleration),
        }[effect]
        weber = table.fraction(effect).value
        return cls(reference=reference, weber=weber, floor=threshold / reach)

    @property
    def corner(self) -> float:
        """c/ln(1 + w): steps are linear below it and logarithmic above, with one slope there."""
        return self.floor / float(np.log1p(self.weber))

    @property
    def parts(self) -> tuple[float, float, float]:
        """What is up to the corner, the larger of reference and corner, and the corner."""
        return self.corner - self.reference, max(self.reference, self.corner), self.corner

    def through(self, share: float) -> Scale:
        """The scale of commanded sizes of which this share is felt."""
        return replace(self, reference=self.reference / share, floor=self.floor / share)

    def steps(self, value: float) -> float:
        """Steps from the bare device to the device with an effect of this value."""
        return float(abs(self.height(np.asarray(value))) / np.log1p(self.weber))

    def height(self, values: FloatArray) -> FloatArray:
        """Steps times ln(1 + w), below zero where something is taken away; of any shape."""
        top, base, corner = self.parts
        above = np.maximum(values, top) - max(0.0, top)
        return np.log(1 + above / base) + (np.minimum(values, top) - min(0.0, top)) / corner

    @overload
    def value_at(self, steps: float, sign: int) -> float: ...
    @overload
    def value_at(self, steps: FloatArray, sign: int) -> FloatArray: ...
    def value_at(self, steps: float | FloatArray, sign: int) -> float | FloatArray:
        """The value of the given sign that stands that many steps above (below) the bare device.

        Steps are one number or an array of any shape, and so is the answer, in the unit of the
        reference.
        """
        return self.value_from(self.reference, steps, sign)

    def value_from(
        self, reference: float | FloatArray, steps: float | FloatArray, sign: int
    ) -> FloatArray:
        """`value_at` from other references, of the shape of both."""
        corner = self.corner
        base = np.maximum(reference, corner)
        height = np.multiply(sign * np.log1p(self.weber), steps)
        # In heights: from the reference up to the corner, or from the corner up to the reference.
        ahead, behind = 1 - np.minimum(reference, corner) / corner, np.log(corner / base)
        above = np.maximum(height - ahead, behind)
        below = np.minimum(height - ahead, behind) - behind
        return base * np.expm1(above) + corner * (ahead + below)

    def estimate(self, value: float, fraction: WeberFraction) -> Estimate:
        """Steps of a value with the 95 % interval that the Weber fraction leaves them.

        Value and device are taken as known; without an interval of the fraction there is none.
        """
        low, high = (
            None if one is None else replace(self, weber=one).steps(value)
            for one in (fraction.high, fraction.low)
        )
        return Estimate(value=self.steps(value), low=low, high=high)
