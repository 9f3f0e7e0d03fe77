"""How many just noticeable steps an effect stands above what the bare device feels like."""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from identification import Device, Document


class WeberFraction(Document):
    """Smallest relative change of one effect that is noticed, with where the number is from."""

    value: float = Field(gt=0, lt=10)
    source: str


class ForceThreshold(Document):
    """Smallest force a resting hand notices, N (N·m if rotary)."""

    value: float = Field(gt=0)
    source: str


class PerceptionTable(Document):
    """Weber fractions and thresholds; data that a user can replace with a file of this form."""

    stiffness: WeberFraction
    damping: WeberFraction
    mass: WeberFraction
    force_threshold: ForceThreshold
    torque_threshold: ForceThreshold

    def threshold(self, motion: Literal["linear", "rotary"]) -> float:
        """Smallest force (N) or torque (N·m) that is noticed; also the default ripple limit."""
        return (self.force_threshold if motion == "linear" else self.torque_threshold).value


class Study(Document):
    """One cell of a same-different study: how often each kind of pair was judged rightly.

    The paper's cells pool trials in which other effects changed too, so what follows from them is
    a scale of perceived difference, not a tested prediction.
    """

    equal_right: int = Field(ge=0)
    equal_trials: int = Field(gt=0)
    different_right: int = Field(ge=0)
    different_trials: int = Field(gt=0)
    ratio: float = Field(gt=1)

    @model_validator(mode="after")
    def _informative(self) -> Study:
        for right, trials in (
            (self.equal_right, self.equal_trials),
            (self.different_right, self.different_trials),
        ):
            if not 0 < right < trials:
                raise ValueError(f"{right} of {trials} right bounds no threshold")
        return self

    def sensitivity(self) -> float:
        """d' by equal-range signal detection: c + Φ⁻¹(P(right|different)), 2Φ(c)-1 = P(equal)."""
        from scipy.special import ndtri

        criterion = ndtri((1 + self.equal_right / self.equal_trials) / 2)
        return float(criterion + ndtri(self.different_right / self.different_trials))

    def weber_fraction(self) -> float:
        """ratio^(1/d') - 1: the relative step at d' = 1."""
        return float(self.ratio ** (1 / self.sensitivity()) - 1)


#: Tables 2 and 3 of the paper (20 subjects, HomeRehab): 500 → 1000 N/m; b ≈ 10 → b + 10 N·s/m;
#: 3 → 4 kg.
PAPER_STUDY = {
    "stiffness": Study(
        equal_right=27, equal_trials=60, different_right=77, different_trials=80, ratio=2.0
    ),
    "damping": Study(
        equal_right=45, equal_trials=60, different_right=77, different_trials=80, ratio=2.0
    ),
    "mass": Study(
        equal_right=31, equal_trials=60, different_right=61, different_trials=80, ratio=4 / 3
    ),
}


@cache
def default_table() -> PerceptionTable:
    """The paper's study turned into Weber fractions (33.8 %, 26.7 % and 22.5 %)."""
    fractions = {
        name: WeberFraction(
            value=study.weber_fraction(),
            source=f"paper, tables 2 and 3: {study.equal_right}/{study.equal_trials} equal and "
            f"{study.different_right}/{study.different_trials} different pairs judged rightly",
        )
        for name, study in PAPER_STUDY.items()
    }
    source = "illustrative order of magnitude for a hand on a handle; replace it"
    return PerceptionTable(
        **fractions,
        force_threshold=ForceThreshold(value=0.1, source=source),
        torque_threshold=ForceThreshold(value=0.005, source=f"0.1 N at 50 mm: {source}"),
    )


def references(device: Device, table: PerceptionTable, penetration: float) -> dict[str, float]:
    """What each effect is compared with: K_ref (N/m), b (N·s/m) and m (kg).

    K_ref = max(Coulomb friction, force threshold)/penetration is the stiffness whose force at full
    penetration (m) just exceeds what the device masks. A device without damping of its own is
    given a hundredth of m over one second, so that the logarithm has a foot to stand on.
    """
    masked = max(device.coulomb_friction.value, table.threshold(device.motion))
    return {
        "stiffness": masked / penetration,
        "damping": max(device.damping.value, 0.01 * device.mass.value),
        "mass": device.mass.value,
    }


def perceived_steps(value: float, reference: float, weber: float) -> float:
    """|ln(1 + value/reference)| / ln(1 + w); inf where the device would feel weightless."""
    relative = 1 + value / reference
    return float(abs(np.log(relative)) / np.log1p(weber)) if relative > 0 else float("inf")


def value_at_steps(steps: float, reference: float, weber: float, sign: int) -> float:
    """The value of the given sign that stands that many steps above (below) the bare device."""
    return float(reference * np.expm1(sign * steps * np.log1p(weber)))
