"""Exact motion under held forces: exponentials of stacks of matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def held_motion(motion: Array, drive: Array, span: Array) -> tuple[Array, Array]:
    """Motion over a span, and what a force held over it adds."""
    members, order = drive.shape
    both = np.zeros((members, order + 1, order + 1))
    both[:, :order, :order] = motion
    both[:, :order, order] = drive
    grown = exponential(both * span[:, None, None])
    return grown[:, :order, :order], grown[:, :order, order]


def exponential(matrices: Array) -> Array:
    """Of every matrix of a stack: Taylor's series of a small part of it, squared back."""
    size = float(np.max(np.sum(np.abs(matrices), axis=2), initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300) / 0.25))))
    small = matrices / 2.0**halvings
    grown = term = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for power in range(1, 14):
        term = term @ small / power
        grown = grown + term
    for _ in range(halvings):
        grown = grown @ grown
    return grown
