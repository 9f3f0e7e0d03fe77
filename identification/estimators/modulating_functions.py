"""Modulating functions: smooth, of compact support, and the integrals of a log under them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.estimators.rows import FIRST, LAST, Kinematics, of_rows
from identification.estimators.zero_order_hold import HeldColumn

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: Exponent of (1 - x²)^n: seven smooth derivatives at the ends, close to a Gaussian.
EXPONENT = 8
#: Distance of two test functions in their standard deviations. At 1 their sums miss what costs
#: 5 % of the precision of mass; at 0.7, 1 %.
SPACING = 0.7
#: Samples that one row of kinematics reads.
_READ = FIRST + LAST + 1


def bump_weights(place: FloatArray, deviation: float) -> csr_array:
    """Weights of the rows of a log in each test function, shape (functions, rows).

    Test function j is (1 - ((t - c[j])/h)²)^EXPONENT for |t - c[j]| < h. Those at the ends of a
    log are cut off there: any weighted sum of rows is exact. The weights of each sum to 1.

    Args:
        place: time of each row, s, shape (rows,).
        deviation: standard deviation of a test function, as of a bell curve, s.
    """
    from scipy.sparse import csr_array

    half = deviation * float(np.sqrt(2 * EXPONENT + 3))
    first_row, last_row = float(place[0]), float(place[-1])
    gaps = max(int((last_row - first_row) / (SPACING * deviation)), 1)
    centres = first_row + np.arange(gaps + 1) * ((last_row - first_row) / gaps)
    first = np.searchsorted(place, centres - half, side="right")
    beyond = np.searchsorted(place, centres + half, side="left")
    lengths = beyond - first
    ends = np.concatenate(([0], np.cumsum(lengths)))
    columns: IndexArray = np.arange(int(ends[-1])) - np.repeat(ends[:-1] - first, lengths)
    apart = (place[columns] - np.repeat(centres, lengths)) / half
    weight = (1 - apart * apart) ** EXPONENT
    weight /= np.repeat(np.add.reduceat(weight, ends[:-1]), lengths)
    return csr_array((weight, columns, ends), shape=(centres.size, place.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class Operators:
    """What test functions read of each position, shape (functions, n) each.

    Attributes:
        acceleration: 1/s².
        velocity: 1/s.
        place: of position itself, 1.
    """

    acceleration: csr_array
    velocity: csr_array
    place: csr_array

    @classmethod
    def of(
        cls, weights: csr_array, steps: float | FloatArray, samples: int, known: int
    ) -> Operators:
        """Operators of a log.

        The rows are asked for their own coefficients: each reads _READ neighbours, so as many
        positions that are 1 at every _READ-th sample show them all.

        Args:
            weights: of rows from ``known`` on.
            steps: of the log, s: one number, or shape (n - 1,).
            samples: n.
            known: first row used.
        """
        from scipy.sparse import csr_array

        rows = samples - _READ + 1
        read = np.arange(rows)[:, None] + np.arange(_READ)
        coefficients = np.empty((3, *read.shape))
        for phase in range(_READ):
            comb = np.zeros(samples)
            comb[phase::_READ] = 1.0
            moved = Kinematics.of(comb, steps)
            middle = HeldColumn.constant((comb[1:] + comb[:-1]) / 2, steps)
            answer = (moved.acceleration, moved.velocity, of_rows(middle.triangle()))
            which = (phase - np.arange(rows)) % _READ
            coefficients[:, np.arange(rows), which] = answer
        ends = np.arange(0, read.size + 1, _READ)
        made = [
            weights @ csr_array((each.ravel(), read.ravel(), ends), shape=(rows, samples))[known:]
            for each in coefficients
        ]
        return cls(acceleration=made[0], velocity=made[1], place=made[2])
