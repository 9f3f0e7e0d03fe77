"""What the encoder makes the hand feel: force ripple from quantisation, an H2 norm.

A position in motion is quantised like white noise of variance Δ²/12. It reaches the force through
C/(1 + G·C), and the closed form of the norm needs no simulation. In w the norm on the unit circle
is that of a transfer function times √2/(1+w) on the imaginary axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.effects import Effects
from tune.loop import Loop
from tune.routh_table import h2_squared, product

FloatArray = NDArray[np.float64]


def force_ripple(loop: Loop, effects: Effects, encoder_resolution: float) -> FloatArray:
    """Force ripple from encoder quantisation, N rms (N·m if rotary).

    Args:
        loop: of any shape; scaled by mass and sample time (`Loop.from_numbers`).
        effects: broadcast against the loop; for an unstable setting the answer, possibly nan,
            means nothing.
        encoder_resolution: Δ, m (rad): one count.

    Returns:
        rms force of the broadcast shape.
    """
    values = loop.dimensionless_effects(effects)
    law: Any = 0.0
    for term, value in zip(
        (loop.controller.alpha, loop.controller.beta, loop.controller.gamma), values, strict=True
    ):
        if value is not None:
            law = law + _columns(term, value) * value
    if np.ndim(law) == 0:
        return np.zeros(loop.scales[0].shape)
    numerator = product(list(loop.controller.free), list(law))
    denominator, _ = loop.polynomial(effects)
    energy = ripple_energy(numerator, list(denominator), position_free=effects.position_free)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(energy / 12) * encoder_resolution / loop.scales[0])


def ripple_energy(
    numerator: Sequence[Any], denominator: Sequence[Any], *, position_free: bool
) -> Any:
    """Squared discrete H2 norm of numerator/denominator in w, in any arithmetic.

    Args:
        numerator: of C/(1+GC) over the common denominator, ascending in w; trailing zeros allowed.
        denominator: the loop polynomial.
        position_free: both then share a factor w, which is divided out.
    """
    size = len(denominator)
    top, bottom = list(numerator[:size]), list(denominator)
    if position_free:
        top, bottom = top[1:], bottom[1:]
    root2 = float(np.sqrt(2.0))
    widened = [bottom[0], *(a + b for a, b in pairwise(bottom)), bottom[-1]]
    return h2_squared([root2 * item for item in top], widened)


def _columns(term: FloatArray, value: FloatArray) -> FloatArray:
    return term.reshape(len(term), *(1,) * (value.ndim - term.ndim + 1), *term.shape[1:])
