"""Stacked loops: loops of different delays side by side, judged in one call.

A loop of lower degree is multiplied by (1+w) as often as it takes. Its new poles lie at w = -1,
z = 0, where nothing is ever in doubt, and no verdict, limit or margin changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tune.loop.coefficients import Terms, Transfer
from tune.loop.loop import Loop
from tune.loop.polynomials import pad_coefficients

FloatArray = NDArray[np.float64]


def stack_loops(loops: Sequence[Loop]) -> Loop:
    """Loops of shape (corners,), all grounded or all free, as one of shape (all corners,)."""
    if len(loops) == 1:
        return loops[0]
    degree = max(loop.degree for loop in loops)
    lifts = [degree - loop.degree for loop in loops]

    def joined(part: Callable[[Loop], FloatArray], *, lift: bool = True) -> FloatArray:
        raised = [
            _raised(part(loop), by if lift else 0) for loop, by in zip(loops, lifts, strict=True)
        ]
        length = max(len(one) for one in raised)
        return np.concatenate([pad_coefficients(one, length) for one in raised], axis=1)

    def terms(which: Callable[[Loop], Terms]) -> Terms:
        return Terms(
            free=joined(lambda loop: which(loop).free),
            alpha=joined(lambda loop: which(loop).alpha),
            beta=joined(lambda loop: which(loop).beta),
            gamma=joined(lambda loop: which(loop).gamma),
        )

    return Loop(
        terms=terms(lambda loop: loop.terms),
        sizes=terms(lambda loop: loop.sizes),
        transfer=Transfer(
            plant_numerator=joined(lambda loop: loop.transfer.plant_numerator),
            plant_denominator=joined(lambda loop: loop.transfer.plant_denominator),
            handle_numerator=joined(lambda loop: loop.transfer.handle_numerator),
            law_denominator=joined(lambda loop: loop.transfer.law_denominator, lift=False),
            alpha=joined(lambda loop: loop.transfer.alpha, lift=False),
            beta=joined(lambda loop: loop.transfer.beta, lift=False),
            gamma=joined(lambda loop: loop.transfer.gamma, lift=False),
        ),
        scales=(
            np.concatenate([loop.scales[0] for loop in loops]),
            np.concatenate([loop.scales[1] for loop in loops]),
            np.concatenate([loop.scales[2] for loop in loops]),
        ),
        grounded=loops[0].grounded,
    )


def _raised(part: FloatArray, times: int) -> FloatArray:
    """Multiplied by (1+w) so many times."""
    for _ in range(times):
        part = np.concatenate([part, np.zeros_like(part[:1])])
        part[1:] += part[:-1].copy()
    return part
