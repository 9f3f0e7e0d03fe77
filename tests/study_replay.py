"""Tables 2 and 3 of the paper, and table 3 as filled by people who follow the perception model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.simulated.experiment import EFFECTS, EffectName
from tests.simulated.user_study import AREA_1, AREA_2, Given
from tune import PerceptionTable, Study

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Columns of `AREA_1` and `AREA_2`.
COLUMN: dict[EffectName, int] = {"stiffness": 0, "damping": 1, "mass": 2}
#: Table 3 as printed: successes of 60 equal and of 80 different pairs.
TABLE_3: dict[EffectName, tuple[int, int]] = {
    "stiffness": (27, 77),
    "damping": (45, 77),
    "mass": (31, 61),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One row of table 3."""

    trials: int
    success: int

    @property
    def failure(self) -> int:
        """How many were wrong."""
        return self.trials - self.success

    @property
    def percent(self) -> float:
        """Success rate, rounded to 0.01 % as printed."""
        return round(100 * self.success / self.trials, 2)

    def pooled_with(self, other: Cell) -> Cell:
        """The row of both rows' answers."""
        return Cell(trials=self.trials + other.trials, success=self.success + other.success)


def equal_trials(effect: EffectName) -> NDArray[np.bool_]:
    """In which of the seven trials both areas have the same of an effect, by table 2."""
    column = COLUMN[effect]
    return np.array([area[column] == AREA_1[column] for area in AREA_2])


def table_3(counts: dict[EffectName, tuple[int, int]], people: int) -> dict[str, Cell]:
    """All ten rows of table 3 from the successes with equal and with different pairs."""
    rows: dict[str, Cell] = {}
    everything = Cell(trials=0, success=0)
    for effect in EFFECTS:
        same = equal_trials(effect)
        equal, different = (
            Cell(trials=people * int(np.sum(which)), success=int(success))
            for which, success in zip((same, ~same), counts[effect], strict=True)
        )
        rows |= {f"equal {effect}": equal, f"different {effect}": different}
        rows[f"total {effect}"] = equal.pooled_with(different)
        everything = everything.pooled_with(rows[f"total {effect}"])
    return rows | {"all": everything}


def felt_ratios(given: Given) -> dict[EffectName, FloatArray]:
    """Area 2 over area 1 as given to each hand, shape (trials, people); area 1 is the first."""
    return {name: getattr(given, name)[1:] / getattr(given, name)[0] for name in EFFECTS}


def study_of(table: PerceptionTable, effect: EffectName) -> Study:
    """The counts that an effect's Weber fraction follows from."""
    study = table.fraction(effect).study
    assert study is not None
    return study


def answer(
    study: Study, ratios: FloatArray, lot: np.random.Generator, replays: int = 1
) -> IntArray:
    """Answers of people who feel ln(ratio) through noise: +1 higher, 0 equal, -1 lower."""
    apart = study.sensitivity() * np.log(ratios) / np.log(study.ratio)
    felt = apart + lot.standard_normal((replays, *ratios.shape))
    return np.where(np.abs(felt) <= study.criterion(), 0, np.sign(felt)).astype(np.int64)


def replay(
    given: Given, table: PerceptionTable, *, seed: int, replays: int = 1
) -> dict[EffectName, IntArray]:
    """Successes with equal and with different pairs of each effect, shape (replays, 2)."""
    found: dict[EffectName, IntArray] = {}
    lot = np.random.default_rng(seed)
    for effect, ratios in felt_ratios(given).items():
        answers = answer(study_of(table, effect), ratios, lot, replays)
        same = equal_trials(effect)
        right = answers == np.where(same, 0, 1)[:, None]
        found[effect] = np.stack(
            [right[:, which].sum(axis=(1, 2)) for which in (same, ~same)], axis=1
        )
    return found
