"""Batch values: one value a member of a batch, or one that all of them share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def per_member(values: ArrayLike, batch: int) -> FloatArray:
    """One value a member, an array of its own, shape (batch,)."""
    return np.array(np.broadcast_to(np.asarray(values, dtype=np.float64), (batch,)))


def choose_members(values: ArrayLike, which: NDArray[np.intp]) -> FloatArray:
    """The values of these members; one that all share stays one value.

    Values have shape (batch,) or (1,) or are one number; the answer has shape (members,) or that of
    the one value.
    """
    array = np.asarray(values, dtype=np.float64)
    return array if array.size == 1 else array[which]
