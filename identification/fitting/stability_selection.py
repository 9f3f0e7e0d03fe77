"""Stability selection: which further terms a log asks for, by sparse regression.

It never gives mass or damping. Columns have unit mean square, so that no unit decides. Fits with
one block of the log left out give the covariance of the candidates, and fits to random halves of
the blocks show which are asked for again and again (Meinshausen and Bühlmann, Journal of the Royal
Statistical Society B 72, 2010, p. 417, in complementary halves: Shah and Samworth, ibid. 75, 2013,
p. 55). pysindy judges each half, in coordinates in which the errors are independent.

A term is asked for if most halves ask for it, if the whole log does so by a margin that chance does
not reach, and if it is a noticeable part of the force.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, TypeVar
from warnings import catch_warnings, simplefilter

import numpy as np

from identification.estimators.estimate import UNKNOWN_FORCE, symmetric_inverse, wald
from identification.estimators.least_squares import Regression
from identification.trajectory import BoolArray, FloatArray

Group = TypeVar("Group", bound=Hashable)

#: Size of the anchor's column and answer: dropping it would cost this much squared, more than any
#: other term, so pysindy never empties the model and never spends a step on the anchor.
_ANCHOR = 1e3
#: Blocks a log is cut into: a block of a usual log outlasts the filter many times, and the
#: covariance of seven candidates needs several times their number.
BLOCKS = 60
#: Correlation of neighbouring blocks above this is taken as this: beyond it sixty blocks cannot
#: tell a slow disturbance from a constant.
_MOST_CORRELATED = 0.9
#: Random halves of the log that are looked at, in complementary pairs: frequencies in steps of
#: 1/20, and pysindy takes some six milliseconds for each.
_HALVES = 20
_SEED = 0
#: A half asks for a term worth this many of its own standard deviations.
_HALF_HURDLE = 2.5
#: A term is stable if this part of the halves asks for it; without a force behind it a half does
#: so once in eighty times.
STABLE = 0.7
#: The whole log must ask with this many standard deviations: about once in 3000 by chance with
#: Student's t of 59 degrees of freedom.
_HURDLE = 3.8
#: A term below this part of the rms force is not asked for however sure it is: amplifiers and
#: calibrations are no better, and mass and damping hardly notice.
_LEAST_SHARE = 0.01
_WORDS: dict[tuple[str, ...], str] = {
    ("damping_asymmetry",): "damping that differs by direction",
    ("position_stiffness",): "a force in proportion to position",
    ("gravity_sine", "gravity_cosine"): "gravity",
}


def _scale_to_unit_rms(column: FloatArray) -> FloatArray:
    """A column over its rms, found without overflow whatever the unit; zeros stay zero."""
    largest = float(np.max(np.abs(column)))
    if largest == 0:
        return column
    moderate = column / largest
    return moderate / np.sqrt(np.mean(moderate**2))


def _asked(whitened: FloatArray, answer: FloatArray) -> BoolArray:
    """Which terms an answer asks for, by stepwise sparse regression, shape (terms,).

    pysindy's SSR (Boninsegna, Nüske, Clementi, Journal of Chemical Physics 148, 2018, 241723) drops
    one term after the other, always the one that is missed least, and keeps the model with the
    least χ² + price · terms on the way. Rows have independent errors with variance 1, so a rise of
    the squared residual is the χ² of what was dropped.
    """
    from pysindy import SSR
    from sklearn import config_context

    rows, count = whitened.shape
    # Columns of unit norm for the solver's sake. pysindy always keeps one term: the anchor, which
    # stands for mass and damping.
    columns, anchored = np.zeros((rows + 1, count + 1)), np.empty((rows + 1, 1))
    columns[:rows, :count] = whitened / np.linalg.norm(whitened, axis=0)
    columns[rows, count] = 1.0
    anchored[:rows, 0], anchored[rows] = answer, _ANCHOR + np.linalg.norm(answer)
    # Without a charge of its own pysindy notes the squared residual of every model on the way. Its
    # own charge counts coefficients that are not zero, so a term whose coefficient happens to be
    # exactly zero would come free, and the model that holds it would be the best.
    search = SSR(alpha=0.0, kappa=0.0, criteria="model_residual", max_iter=count + 1, unbias=False)
    # scikit-learn, on which pysindy rests, would spend half of the time on checking arguments.
    # A warning that two terms are alike says what dropping one of them finds anyway.
    with config_context(skip_parameter_validation=True), catch_warnings():
        simplefilter("ignore")
        search.fit(columns, anchored)
    charges = _HALF_HURDLE**2 * np.arange(count, -1, -1, dtype=np.float64)
    best = int(np.argmin(np.add(search.err_history_, charges)))
    # pysindy 2.1 overwrites the coefficients of the first model, the one with every term, while it
    # drops terms.
    chosen = np.ones(count, dtype=np.bool_)
    if best > 0:
        chosen[:] = search.history_[best][0, :count]
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks(Generic[Group]):
    """Normal equations of consecutive blocks of a log, from which any columns are fitted at once.

    Columns and answer have mean square 1; coefficients are those of such columns.
    """

    normals: FloatArray  # shape (BLOCKS, q, q)
    rights: FloatArray  # shape (BLOCKS, q)
    rows: int  # of the whole log
    square: float  # sum of squares of the answer
    scales: FloatArray  # unit of each column over that of the answer, shape (q,)
    base: list[int]  # columns that are in every fit
    members: Mapping[Group, list[int]]  # columns of each group of candidates

    @classmethod
    def of(
        cls, base: FloatArray, groups: Mapping[Group, FloatArray], answer: FloatArray
    ) -> Blocks[Group]:
        """Columns of the model and of groups of candidates, shape (rows, theirs) each."""
        every = np.concatenate((base, *groups.values()), axis=1)
        unit = np.stack([_scale_to_unit_rms(column) for column in every.T], axis=1)
        right, sizes = _scale_to_unit_rms(answer), np.sqrt(np.mean(every**2, axis=0))
        cuts = pairwise(np.linspace(0, answer.size, BLOCKS + 1).astype(int).tolist())
        parts = [(unit[i:j], right[i:j]) for i, j in cuts]
        ends = np.cumsum([base.shape[1], *(each.shape[1] for each in groups.values())]).tolist()
        return cls(
            normals=np.stack([columns.T @ columns for columns, _ in parts]),
            rights=np.stack([columns.T @ part for columns, part in parts]),
            rows=answer.size,
            square=float(right @ right),
            scales=np.sqrt(np.mean(answer**2)) / np.where(sizes > 0, sizes, np.inf),
            base=list(range(base.shape[1])),
            members={
                group: list(range(i, j))
                for group, (i, j) in zip(groups, pairwise(ends), strict=True)
            },
        )

    def chosen(self, groups: Sequence[Group]) -> list[int]:
        """Columns of a fit with some groups."""
        return self.base + [each for group in groups for each in self.members[group]]

    @property
    def gram(self) -> FloatArray:
        """Mean products of all columns, shape (q, q)."""
        return np.asarray(self.normals.sum(axis=0) / self.rows, dtype=np.float64)

    def fit(self, groups: Sequence[Group]) -> tuple[FloatArray, FloatArray]:
        """Coefficients with some groups, (p,), and their covariance, shape (p, p)."""
        members = self.chosen(groups)
        normals = self.normals[:, members][:, :, members]
        rights = self.rights[:, members]
        total = normals.sum(axis=0)
        fitted = least_norm(total, rights.sum(axis=0))
        scores = rights - normals @ fitted
        # The fit without block i differs from the whole fit by -(A - A_i)⁺ c_i.
        shifts = (symmetric_inverse(total - normals) @ scores[:, :, None])[:, :, 0]
        floor = UNKNOWN_FORCE**2 * self.rows * symmetric_inverse(total)
        return fitted, _long_run(shifts) + floor

    def left(self, groups: Sequence[Group]) -> float:
        """Mean square of the answer that least squares with some groups leaves over."""
        members = self.chosen(groups)
        right = self.rights[:, members].sum(axis=0)
        total = self.normals.sum(axis=0)[np.ix_(members, members)]
        return max(0.0, self.square - float(least_norm(total, right) @ right)) / self.rows

    def often_asked(self, groups: Sequence[Group]) -> list[float]:
        """Part of random halves of the blocks, complementary in pairs, that ask for each group.

        The shape of a group is that of the other half, so that no half is asked for what it
        suggested.
        """
        members, known = self.chosen(groups), len(self.base)
        covariance = self.fit(groups)[1][known:, known:]
        # A half knows each term with twice the variance of the whole.
        root = _root_of_inverse(covariance) / np.sqrt(2)
        normals, rights = self.normals[:, members][:, :, members], self.rights[:, members]
        generator, halves = np.random.default_rng(_SEED), list[FloatArray]()
        for _ in range(_HALVES // 2):
            order = generator.permutation(BLOCKS)
            for part in (order[: BLOCKS // 2], order[BLOCKS // 2 :]):
                fitted = least_norm(normals[part].sum(axis=0), rights[part].sum(axis=0))
                halves.append(fitted[known:])
        numbers = np.arange(len(groups))
        inside = (
            np.repeat(numbers, [len(self.members[each]) for each in groups])[:, None] == numbers
        )
        picked = [
            _asked(root @ np.where(inside, halves[index ^ 1][:, None], 0.0), root @ half)
            for index, half in enumerate(halves)
        ]
        return np.mean(picked, axis=0).tolist()


def _long_run(shifts: FloatArray) -> FloatArray:
    """Covariance of a sum of shifts that are correlated from block to block, shape (q, q).

    Bartlett's weights (Newey and West, Econometrica 55, 1987, p. 703) up to the distance that is
    best for a first-order process (Andrews, Econometrica 59, 1991, p. 834).
    """
    blocks = len(shifts)
    power = np.sum(shifts * shifts, axis=0)
    crossed = np.sum(shifts[1:] * shifts[:-1], axis=0)
    correlation = float(np.max(crossed / np.where(power > 0, power, 1.0)))
    correlation = min(max(correlation, 0.0), _MOST_CORRELATED)
    memory = 4 * correlation**2 / (1 - correlation**2) ** 2
    reach = int(1.1447 * (memory * blocks) ** (1 / 3))
    total = shifts.T @ shifts
    for distance in range(1, reach + 1):
        later = shifts[distance:].T @ shifts[:-distance]
        total += (1 - distance / (reach + 1)) * (later + later.T)
    return (blocks - 1) / blocks * total


def least_norm(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution of least norm; a half of a log may lack a term altogether."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def _root_of_inverse(covariance: FloatArray) -> FloatArray:
    """W with WᵀW the inverse of a covariance."""
    deviations = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    return (vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))).T / deviations


def second_opinion(
    table: Regression, delay: float, groups: Sequence[tuple[str, ...]]
) -> tuple[list[tuple[str, ...]], str]:
    """Which groups of terms sparse regression asks for, all of a short log, and that in words."""
    names, force = table.model.parameters, table.force(delay)
    if force.size < BLOCKS * (len(names) + 1) or not np.any(force):
        return list(groups), ""
    candidates = {group: table.columns[[names.index(name) for name in group]].T for group in groups}
    beside = [name not in {each for group in groups for each in group} for name in names]
    own = Blocks[tuple[str, ...]].of(table.columns[beside].T, candidates, force)
    asked, said = list[tuple[str, ...]](), list[str]()
    fitted, covariance = own.fit(groups)
    for group, often in zip(groups, own.often_asked(groups), strict=True):
        part = np.ix_(own.members[group], own.members[group])
        values = fitted[own.members[group]]
        share = float(np.sqrt(values @ own.gram[part] @ values))
        sure = wald(values, covariance[part]) >= _HURDLE**2
        if often >= STABLE and sure and share >= _LEAST_SHARE:
            asked.append(group)
        said.append(f"{_WORDS[group]} ({share:.1%} of the force, by {often:.0%})")
    return asked, f"halves of the log ask for {'; '.join(said)}"
