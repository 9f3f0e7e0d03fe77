"""Steps that a hand can tell: Fechner's scale of Weber's law with a floor, and chances by it.

One file: the scale and what is counted on it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import overload

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.discrimination import Answers, Estimate
from tune.documents.effects import EffectName
from tune.documents.perception import PerceptionTable, WeberFraction, default_table
from tune.documents.scene import DEFAULT_MOTION, Motion

FloatArray = NDArray[np.float64]

#: m and rad: the depth at which a stiffness is compared with what the device masks. The scale of
#: steps, no limit: how deep a hand goes into an element does not change them.
SCALE_DEPTH = {"linear": 0.01, "rotary": 0.1}


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
        base, corner = max(self.reference, self.corner), self.corner
        height = np.multiply(sign * np.log1p(self.weber), steps)
        # In heights: from the reference up to the corner, or from the corner up to the reference.
        ahead, behind = 1 - min(self.reference, corner) / corner, np.log(corner / base)
        above = np.maximum(height - ahead, behind)
        below = np.minimum(height - ahead, behind) - behind
        return base * np.expm1(above) + corner * (ahead + below)

    def estimate(self, value: float, fraction: WeberFraction) -> Estimate:
        """Steps of a value with the 95 % interval that the Weber fraction leaves them.

        Value and device are taken as known; without an interval of the fraction there is none.
        """
        weber = fraction.estimate()
        low, high = (
            None if one is None else replace(self, weber=one).steps(value)
            for one in (weber.high, weber.low)
        )
        return Estimate(value=self.steps(value), low=low, high=high)


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
    motion: Motion | None = None,
) -> Telling:
    """The chance that a hand tells two settings of one effect apart.

    Compared is what is felt: b + B, m + M, and for walls K itself as in the paper's study, though
    none below the stiffness that the device masks, K_ref of `Scale`. A pair like the study's
    gives back the shares the study observed; anything else is an extrapolation by Weber's law, for
    one effect changed at a time, of which the study's pooled cells are no test.

    Args:
        effect: stiffness, damping or mass.
        first: one setting, SI.
        second: the other, SI.
        device: whose m and b are felt as well.
        table: None is the paper's study.
        motion: of the hand; None is the usual one of a linear or rotary axis.

    Raises:
        ValueError: a setting that leaves no damping or mass to be felt.
    """
    table = table or default_table()
    scale = Scale.of(effect, device, table, motion or DEFAULT_MOTION[device.motion])
    low, high = sorted(
        max(value, scale.reference) if effect == "stiffness" else scale.reference + value
        for value in (first, second)
    )
    if low <= 0:
        raise ValueError(f"{effect} felt is {low:.4g}, which no ratio can be formed with")
    fraction = table.fraction(effect)
    steps = replace(scale, reference=low).estimate(high - low, fraction)
    if fraction.study is not None:
        ratio = float(np.exp(steps.value * np.log1p(scale.weber)))
        return Telling(
            steps=steps,
            forced_choice=fraction.study.forced_choice(ratio),
            answers=fraction.study.answers(ratio),
        )
    least, most = (None if s is None else NormalDist().cdf(s) for s in (steps.low, steps.high))
    chance = Estimate(value=NormalDist().cdf(steps.value), low=least, high=most)
    return Telling(steps=steps, forced_choice=chance, answers=None)
