"""Rounding: sizes as they are written, wanted values met exactly, the rest to six digits."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.optimisation.limits import feasible_points
from tune.optimisation.nash import SAME
from tune.optimisation.problem import Problem

FloatArray = NDArray[np.float64]

#: Significant digits of a written effect; what is lost is 1e-5 at most.
_DIGITS = 6
#: Parts by which sizes that are a little beyond are taken back.
_RETREATS = (0.0, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3)


#: Effects that are rounded either way, all ways tried.
_MOST_WAYS = 5


def round_sizes(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Wanted values met exactly, the rest rounded to six digits towards nothing, still allowed.

    Sizes have shape (unknowns,), SI units, before and after.
    """
    caps = problem.high
    met = np.array([u.wish.kind in {"value", "range"} for u in problem.unknowns]) & (
        sizes >= caps * (1 - 10 * SAME)
    )
    # Towards nothing where that is allowed; an effect that holds another may not be smaller.
    ways = np.array(list(product((0.0, 1.0), repeat=min(sizes.size, _MOST_WAYS))))
    ups = np.zeros((len(ways), sizes.size))
    ups[:, : ways.shape[1]] = ways
    for retreat in _RETREATS:
        units = 10.0 ** (np.floor(np.log10(sizes)) - _DIGITS + 1)
        whole = np.floor(sizes * (1 - retreat) / units) + ups
        trials = np.where(met, caps, np.minimum([_rounded(row) for row in whole * units], caps))
        good = np.flatnonzero(feasible_points(problem, trials))
        if good.size:
            return trials[good[0]]
    return sizes * (1 - SAME)


def _rounded(sizes: FloatArray) -> list[float]:
    return [round_to_digits(float(size)) for size in sizes]
