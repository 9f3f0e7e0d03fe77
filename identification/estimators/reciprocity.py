"""Reciprocity of a device of several axes: whether one couples to another as that to the first.

The symmetric matrices of a device are of forces and positions that are measured alike. One of
another scale or sign makes the rows of its axis differ from the columns. A Wald test tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from scipy.special import fdtri

from identification.estimators.joint import JointLog
from identification.estimators.joint_fits import JointEstimate, noise_free_positions, solve_rows
from identification.trajectory import FloatArray

#: Couplings differ where no ratios of this at most fit, at this level of confidence: what a few
#: percent of a gain move is less than an axis tells of its own.
_LARGEST_RATIO, _LEVEL = 1.05, 0.999
_RATIOS = 21


@dataclass(frozen=True, slots=True, kw_only=True)
class UnequalCoupling:
    """Entries across the diagonal of a matrix that differ; kg (kg·m²) or N·s/m (N·m·s/rad)."""

    axes: tuple[str, str]  # their names
    which: Literal["mass", "damping"]  # the matrix whose entries differ most surely
    forth: float  # force on the first axis by the motion of the second
    back: float  # force on the second axis by the motion of the first
    alike: bool  # whether their ratio, as a gain would, explains most of both matrices

    @property
    def ratio(self) -> float:
        """How many times too small the second axis reads, if the first is right."""
        return self.forth / self.back


def unequal_couplings(prepared: JointLog, estimate: JointEstimate) -> tuple[UnequalCoupling, ...]:
    """Pairs of axes whose rows of the equations of motion contradict each other.

    The rows are fitted freely; instruments are the positions that the estimate simulates, or those
    its method has. F test of Λ and D of each pair against ratios of nearly one.
    """
    positions = None
    if estimate.positions is not None:
        positions = [list(each) for each in estimate.positions]
    elif estimate.method == "instruments":
        positions = noise_free_positions(prepared)
    values, around = solve_rows(prepared, positions, symmetric=False)
    model, count = prepared.model, len(prepared.model.pairs)
    least = float(fdtri(2, around.degrees_of_freedom, _LEVEL))
    ratios = np.geomspace(1 / _LARGEST_RATIO, _LARGEST_RATIO, _RATIOS).tolist()
    found: list[UnequalCoupling] = []
    for place, pair in enumerate(model.across):
        halves = len(values) - 2 * len(model.across) + place
        slopes = np.zeros((4, len(values)))  # (above, below) of mass, then of damping
        for kind, half in enumerate((halves, halves + len(model.across))):
            slopes[2 * kind : 2 * kind + 2, pair + kind * count] = 1.0
            slopes[2 * kind : 2 * kind + 2, half] = 1.0, -1.0
        entries, covariance = slopes @ values, slopes @ around.covariance @ slopes.T
        nearly = min(_wald(entries, covariance, *each) for each in product(ratios, repeat=2))
        if nearly <= least:
            continue
        gaps = np.array([entries[0] - entries[1], entries[2] - entries[3]])
        apart = np.kron(np.eye(2), [1.0, -1.0])
        surely = np.abs(gaps) / np.sqrt(np.diag(apart @ covariance @ apart.T))
        kind = int(np.argmax(surely))
        forth, back = entries[2 * kind : 2 * kind + 2].tolist()
        one, other = model.pairs[pair]
        found.append(
            UnequalCoupling(
                axes=(model.axes[one], model.axes[other]),
                which="damping" if kind else "mass",
                forth=forth,
                back=back,
                alike=_wald(entries, covariance, forth / back, forth / back) < nearly / 2,
            )
        )
    return tuple(found)


def _wald(entries: FloatArray, covariance: FloatArray, mass: float, damping: float) -> float:
    """F of entries above being these ratios of those below, in mass and damping at once."""
    rest = np.array([[1.0, -mass, 0.0, 0.0], [0.0, 0.0, 1.0, -damping]])
    left = rest @ entries
    return float(left @ np.linalg.pinv(rest @ covariance @ rest.T, hermitian=True) @ left / 2)
