"""Damping ratio and decay rate of a closed loop, from its poles in s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.closed_loop import ClosedLoop, for_each
from tune.loop.loop import Loop

FloatArray = NDArray[np.float64]

#: A pole that decays by more than exp(-π) within one sample is gone before it can swing: even at
#: the Nyquist frequency its damping ratio exceeds 1/√2. The poles that delays put near z = 0 are
#: of this kind, and doubles do not hold their ratios.
_GONE_IN_A_SAMPLE = np.pi


def slowest_decay(loop: Loop, effects: Effects) -> FloatArray:
    """Decay of the slowest closed-loop pole, 1/s: everything shrinks at least like exp(-decay·t).

    Its inverse is the longest time constant. Without anything that holds the position the pole of
    free motion does not count. The poles of a filter count even where its effect is absent; leave
    such a filter out of the loop.

    Args:
        loop: of any shape; scaled by mass and sample time (`Loop.from_numbers`).
        effects: broadcast against the loop.

    Returns:
        -max Re s of the broadcast shape, with s = ln(z)/T; negative for a loop that grows.
    """
    return for_each(loop, effects, lambda one: float(np.min(-poles_in_s(one).real)))


def least_damping_ratio(loop: Loop, effects: Effects) -> FloatArray:
    """Smallest damping ratio -Re(s)/|s| of the closed-loop poles, s = ln(z)/T; 1 does not ring.

    Poles with z nearer to 0 than exp(-π), whose ratio exceeds 0.707 in any case, are left out.
    Arguments as in `slowest_decay`; negative for a loop that grows.

    The answer has the shape of loop and effects together, and no unit.
    """
    return for_each(loop, effects, _least_ratio)


def poles_in_s(one: ClosedLoop) -> NDArray[np.complex128]:
    """Poles s = ln(z)/T = (2/T)·artanh(w), rad/s, Im s in [-π/T, π/T]; -∞ for z = 0.

    The answer has shape (poles,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2 / one.sample_time * np.arctanh(one.poles()), dtype=np.complex128)


def _least_ratio(one: ClosedLoop) -> float:
    s = poles_in_s(one)
    s = s[-s.real * one.sample_time < _GONE_IN_A_SAMPLE]
    moduli = np.abs(s)
    ratios = np.where(moduli > 0, -s.real / np.where(moduli > 0, moduli, 1.0), 0.0)
    return float(np.min(ratios, initial=1.0))
