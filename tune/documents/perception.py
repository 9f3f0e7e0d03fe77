"""How finely hands tell effects apart: Weber fractions, the study behind them, steps and chances.

Equal-range signal detection: the difference felt between two settings is s + noise of variance 1.
A person answers "equal" while it lies within ±c, otherwise "higher" or "lower" by its sign, so

    P(equal | s) = Φ(c − s) − Φ(−c − s),   P(right sense | s) = Φ(s − c),   P(wrong) = Φ(−s − c).

At s = 0 the first is 2Φ(c) − 1, which gives the criterion c; for the pair that was shown s is d'.
Weber's law makes s proportional to the logarithm of the ratio: s = d'·ln(ratio)/ln(ratio shown).
The criterion is a habit of the people who answered, d' is what they felt. Model: Macmillan and
Creelman, Detection Theory (from memory); it takes "higher" and "lower" to be equally liked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.resources import as_file, files
from math import expm1, inf, log, log1p
from pathlib import Path
from statistics import NormalDist
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from identification import Device, Document, load_document
from tune.documents.scene import DEFAULT_MOTION, EffectName, Motion, Scene

FloatArray = NDArray[np.float64]

#: Points of each of the two rates over which intervals are taken; more changes them by < 0.1 %.
_NODES = 200
#: Half-widths of intervals: 95 %.
_TAILS = (0.025, 0.975)
#: A Weber fraction beyond this is no threshold: the study showed too small a difference.
_LARGEST_FRACTION = 10.0
#: d' as good as none, and the largest power of e worth telling: what is beyond is no number.
_GUESSING, _MOST = 1e-9, 700.0
_NORMAL = NormalDist()


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its 95 % interval; None where its source gives no interval."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """Chances of the three answers to one pair of settings; they sum to 1."""

    right: Estimate
    equal: Estimate
    wrong: Estimate


class Study(Document):
    """One cell of a same-different study: how often each kind of pair was judged rightly.

    Attributes:
        equal_right: equal pairs that were called equal, of ``equal_trials``.
        different_right: different pairs that were called different in the right sense, of
            ``different_trials``.
        lower: the lesser of the two settings shown, as felt (device included), SI.
        upper: the greater.
    """

    equal_right: int = Field(gt=0)
    equal_trials: int = Field(gt=0)
    different_right: int = Field(gt=0)
    different_trials: int = Field(gt=0)
    lower: float = Field(gt=0)
    upper: float = Field(gt=0)

    @model_validator(mode="after")
    def _informative(self) -> Study:
        for right, trials in (
            (self.equal_right, self.equal_trials),
            (self.different_right, self.different_trials),
        ):
            if right >= trials:
                raise ValueError(
                    f"{right} of {trials} right bounds no threshold; more trials would, for "
                    "different pairs a smaller difference too"
                )
        if self.upper <= self.lower:
            raise ValueError(f"upper {self.upper:g} must exceed lower {self.lower:g}")
        if self.sensitivity() <= log(self.ratio) / log1p(_LARGEST_FRACTION):
            raise ValueError(
                f"d' is {self.sensitivity():.2g}: the different pairs were told hardly better than "
                "by guessing, which bounds no threshold; a larger difference would"
            )
        return self

    @property
    def ratio(self) -> float:
        """Ratio of the two settings shown, above 1."""
        return self.upper / self.lower

    def criterion(self) -> float:
        """c, in units of the noise: 2Φ(c) − 1 = P(equal | equal)."""
        return _NORMAL.inv_cdf((1 + self.equal_right / self.equal_trials) / 2)

    def sensitivity(self) -> float:
        """d' of the pair shown, in units of the noise: c + Φ⁻¹(P(right | different))."""
        return self.criterion() + _NORMAL.inv_cdf(self.different_right / self.different_trials)

    def weber_fraction(self) -> float:
        """w = ratio^(1/d') − 1: the relative step at d' = 1, told in 84 % of forced choices."""
        return expm1(log(self.ratio) / self.sensitivity())

    def weber_estimate(self) -> Estimate:
        """The Weber fraction with its 95 % interval; above 1e300 where it may all be guessing."""
        criterion, shift = self._draws()
        least, most = _interval(criterion + shift)
        low, high = (expm1(min(log(self.ratio) / max(d, _GUESSING), _MOST)) for d in (most, least))
        return Estimate(value=self.weber_fraction(), low=low, high=high)

    def forced_choice(self, ratio: float) -> Estimate:
        """Chance to say rightly which of two settings is greater when "equal" is no answer: Φ(s).

        Args:
            ratio: of the two settings as felt, positive; its inverse means the same.
        """
        units = self._units(ratio)
        criterion, shift = self._draws()
        low, high = _interval(_phi(units * (criterion + shift)))
        return Estimate(value=_NORMAL.cdf(units * self.sensitivity()), low=low, high=high)

    def answers(self, ratio: float) -> Answers:
        """Chances of the answers this study's people would give to a pair of settings.

        At the ratio shown they are the shares observed, with the interval of those shares alone.

        Args:
            ratio: of the two settings as felt, positive; its inverse means the same.
        """
        units = self._units(ratio)
        c, s = self.criterion(), units * self.sensitivity()
        criterion, shift = self._draws()
        # s − c is written so that it is the observed shift itself where units is 1.
        beyond = (units - 1) * criterion + units * shift
        below = -beyond - 2 * criterion
        right, wrong = _phi(beyond), _phi(below)
        return Answers(
            right=_estimate(_NORMAL.cdf(s - c), right),
            equal=_estimate(_NORMAL.cdf(c - s) - _NORMAL.cdf(-c - s), 1 - right - wrong),
            wrong=_estimate(_NORMAL.cdf(-c - s), wrong),
        )

    def _draws(self) -> tuple[FloatArray, FloatArray]:
        """c, shape (n, 1), and Φ⁻¹(P(right|different)), shape (1, n), at equally likely points."""
        from scipy.special import ndtri

        equal = _rates(self.equal_right, self.equal_trials)
        different = _rates(self.different_right, self.different_trials)
        return np.asarray(ndtri((1 + equal) / 2))[:, None], np.asarray(ndtri(different))[None, :]

    def _units(self, ratio: float) -> float:
        if not 0 < ratio < inf:
            raise ValueError(f"a ratio of settings is positive and finite, not {ratio:g}")
        return abs(log(ratio)) / log(self.ratio)


@lru_cache(maxsize=32)
def _rates(right: int, trials: int) -> FloatArray:
    """A rate at equally likely points of its posterior under Jeffreys' prior, shape (n,).

    Beta(right + ½, wrong + ½) gives intervals that miss the truth about as often as they say, and
    to both sides alike; percentiles of resampled counts lean towards hands finer than they are.
    """
    from scipy.special import betaincinv

    levels = (np.arange(_NODES) + 0.5) / _NODES
    rates: FloatArray = np.asarray(betaincinv(right + 0.5, trials - right + 0.5, levels))
    rates.flags.writeable = False
    return rates


def _phi(values: FloatArray) -> FloatArray:
    from scipy.special import ndtr

    return np.asarray(ndtr(values))


def _estimate(value: float, draws: FloatArray) -> Estimate:
    low, high = _interval(draws)
    return Estimate(value=value, low=low, high=high)


def _interval(draws: FloatArray) -> tuple[float, float]:
    # Draws stand for the middle of equal parts of probability, which is Hazen's rule.
    low, high = np.quantile(draws, _TAILS, method="hazen")
    return float(low), float(high)


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
