"""Do parameters fitted on one part of a log, or at one cut-off, predict the other?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.intervals import half_width
from identification.estimators.linear import unit_columns
from identification.estimators.model import Estimate
from identification.findings.balance import Balance
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Parts a log is cut into, each left out in turn.
_PARTS = 4
#: A prediction may miss by this part of the rms force more than a fit of the part itself does; ...
DOUBTED = 0.05
#: ... beyond this the parts are not of one device.
REFUSED = 0.25
#: ... and by this many standard deviations of the prediction itself, or the rest says too little.
_SIGMAS = 4.0
#: Blocks of each part, left out in turn for that standard deviation.
_BLOCKS = 8
#: Parameters that must not move.
_JUDGED = ("mass", "damping")
#: A move that is this part of the value, or less, matters to no margin.
_HARMLESS = 0.02


def heldout(trajectory: Trajectory, balance: Balance, chosen: Estimate) -> tuple[Finding, ...]:
    """``heldout-misfit``: the device changed while it was logged, or the model is wrong."""
    missed = [_Blocks.of(balance, chosen, part).miss(part) for part in range(_PARTS)]
    worst = int(np.argmax(missed))
    share = missed[worst] / float(np.std(balance.force))
    if share < DOUBTED:
        return ()
    start, span = float(balance.time[0]), float(balance.time[-1] - balance.time[0])
    first, last = (start + span * part / _PARTS for part in (worst, worst + 1))
    refused = share >= REFUSED
    return (
        Finding(
            code="heldout-misfit",
            severity="refusal" if refused else "warning",
            seen=f"fitted on the rest of {trajectory.source}, the force from {first:.3g} to "
            f"{last:.3g} s is missed by {share:.0%} of its rms more than by a fit of its own",
            needed=f"at most {REFUSED if refused else DOUBTED:.0%}",
            remedy="Log again with nothing loose, warmed up and untouched; cut the log where the "
            "device changed.",
        ),
    )


def stability(trajectory: Trajectory, chosen: Estimate) -> tuple[Finding, ...]:
    """``heldout-misfit``: what the cut-off moves is more than the interval without it holds.

    A model that is right is right at every frequency. The move is in the interval all the same.
    """
    if chosen.leaning is None:
        return ()
    alone = replace(chosen, covariance=chosen.covariance - np.outer(chosen.leaning, chosen.leaning))
    moved = {name: abs(float(chosen.leaning[chosen.parameters.index(name)])) for name in _JUDGED}
    unstable = [
        name
        for name, move in moved.items()
        if move > half_width(alone, name) and move > _HARMLESS * abs(chosen.value(name))
    ]
    if not unstable:
        return ()
    seen = " and ".join(
        f"{name} {chosen.value(name):.4g} ± {half_width(alone, name):.2g} by ± {moved[name]:.2g}"
        for name in unstable
    )
    return (
        Finding(
            code="heldout-misfit",
            severity="warning",
            seen=f"another cut-off moves the {seen} in {trajectory.source}",
            needed="a move within the interval",
            remedy="A force that the model does not have acts at some frequencies: excite harder, "
            "and look for play, vibration or friction that depends on place.",
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Blocks:
    """Sums of squares and products of consecutive blocks, from which any part is fitted at once.

    Attributes:
        normal: XᵀX of each block, shape (_PARTS * _BLOCKS, p, p), columns of unit norm.
        right: Xᵀf, shape (_PARTS * _BLOCKS, p).
        counts: rows of each, shape (_PARTS * _BLOCKS,).
    """

    normal: FloatArray
    right: FloatArray
    counts: FloatArray

    @classmethod
    def of(cls, balance: Balance, chosen: Estimate, part: int) -> _Blocks:
        """With the rows of one part that move no faster than the rest: others are extrapolated."""
        # A term that the estimate does without would only follow chance where the rest is slow.
        terms = balance.plant if chosen.model.directional else balance.plant[:, :-1]
        columns, _ = unit_columns(np.column_stack((terms, balance.carried)))
        moving = balance.moving
        split = np.array_split(np.arange(len(balance)), _PARTS * _BLOCKS)
        rest = np.concatenate([rows for i, rows in enumerate(split) if i // _BLOCKS != part])
        for column in (balance.acceleration, balance.velocity):
            moving &= np.abs(column) <= np.max(np.abs(column[rest]))
        rows = [each[moving[each]] for each in split]
        return cls(
            normal=np.stack([columns[each].T @ columns[each] for each in rows]),
            right=np.stack([columns[each].T @ balance.force[each] for each in rows]),
            counts=np.array([float(each.size) for each in rows]),
        )

    def miss(self, part: int) -> float:
        """Excess of the prediction's rms over that of the part's own fit, N; 0 if it is chance."""
        blocks = np.arange(_PARTS * _BLOCKS)
        inside = blocks // _BLOCKS == part
        rest, own = self._fit(~inside), self._fit(inside)
        if self.counts[inside].sum() == 0 or self.counts[~inside].sum() == 0:
            return 0.0
        excess = self._square(rest - own, inside)
        # How far both fits may be off: each without one of its blocks in turn (jackknife).
        chance = 0.0
        for whole, used in ((rest, ~inside), (own, inside)):
            others = 1.0 - np.eye(int(np.count_nonzero(used)))
            normal = np.tensordot(others, self.normal[used], axes=1)
            left = _solved(normal, others @ self.right[used]) - whole
            chance += sum(self._square(change, inside) for change in left) * (1 - 1 / len(left))
        return float(np.sqrt(excess)) if excess > _SIGMAS**2 * chance else 0.0

    def _fit(self, used: NDArray[np.bool_]) -> FloatArray:
        """Least squares on some blocks, shape (p,)."""
        return _solved(self.normal[used].sum(axis=0), self.right[used].sum(axis=0))

    def _square(self, change: FloatArray, shown: NDArray[np.bool_]) -> float:
        """Mean square of what a change of the parameters does to the force of some blocks, N²."""
        return float(change @ self.normal[shown].sum(axis=0) @ change) / float(
            self.counts[shown].sum()
        )


def _solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of normal equations, shape (..., p, p) and (..., p), of least norm."""
    inverse = np.linalg.pinv(normal, hermitian=True)
    return np.asarray((inverse @ right[..., None])[..., 0], dtype=np.float64)
