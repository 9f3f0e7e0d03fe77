"""Phase margin and disk margins: how far the frequency response stays from -1, exactly.

Disk margins as in P. Seiler, A. Packard and P. Gahinet, "An introduction to disk margins", IEEE
Control Systems 40(5), 2020: the loop stays stable while its gain is multiplied, at all frequencies
and at once, by any complex number of the disk {(1 + (1-σ)/2·d)/(1 - (1+σ)/2·d), |d| < α}. The
largest α is 1/max|S + (σ-1)/2|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.closed_loop import ClosedLoop, closed_loops, for_each, slope, value
from tune.loop.loop import Loop
from tune.stability.peaks import peak, positive_roots, squared_modulus
from tune.stability.verdict import is_stable

FloatArray = NDArray[np.float64]

#: Newton steps on a crossing |L| = 1 or on the top of a peak; each doubles the digits.
_POLISHES = 5
#: A Newton step longer than this, relative, leaves the neighbourhood it was started in.
_LONGEST_STEP = 0.1
#: |L| at a crossing is 1 within this, relative; what is not was no crossing.
_ON_CIRCLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskMargin:
    """How much complex gain, at all frequencies and at once, a loop bears; 0 where unstable.

    Attributes:
        balanced: α = 1/max|(S-T)/2|, σ = 0, at most 2: gains from (2-α)/(2+α) to (2+α)/(2-α) or
            phases up to 2·atan(α/2) alone are borne.
        balanced_hz: the critical frequency, at which that maximum lies, Hz.
        sensitivity: 1/max|S|, σ = 1: the least distance of the frequency response from -1.
        sensitivity_hz: the frequency of largest sensitivity, Hz.
    """

    balanced: float
    balanced_hz: float
    sensitivity: float
    sensitivity_hz: float


def phase_margin(loop: Loop, effects: Effects) -> FloatArray:
    """Least phase that makes the loop unstable when it turns all frequencies alike, degrees.

    The least |arg(-L)| where |L| = 1.

    Returns:
        0 to 180 of the broadcast shape; 0 where the loop is not certainly stable, inf where |L|
        is nowhere 1, so that no phase alone destabilises.
    """
    margins = for_each(loop, effects, _phase)
    return np.where(is_stable(loop, effects), margins, 0.0)


def disk_margin(loop: Loop, effects: Effects) -> DiskMargin:
    """Disk margins of one device with its effects, and the frequencies that are critical.

    Args:
        loop: of shape ().
        effects: single values.
    """
    (one,), _ = closed_loops(loop, effects)
    if not bool(is_stable(loop, effects)):
        return DiskMargin(balanced=0.0, balanced_hz=np.nan, sensitivity=0.0, sensitivity_hz=np.nan)
    # (S - T)/2 = (D - N)/(2(D + N)); D - N loses nothing that |D - N| near its peak needs.
    balanced, v = _peak_modulus((one.open - one.added) / 2, one)
    sensitivity, v_s = _peak_modulus(one.open, one)
    return DiskMargin(
        balanced=1 / balanced,
        balanced_hz=one.hertz(v),
        sensitivity=1 / sensitivity,
        sensitivity_hz=one.hertz(v_s),
    )


def _peak_modulus(numerator: FloatArray, one: ClosedLoop) -> tuple[float, float]:
    """(max |numerator/closed|, its v)."""
    poles = one.poles()
    squared, v = peak(
        lambda v: np.abs(value(numerator, v) / value(one.closed, v)) ** 2,
        squared_modulus(numerator),
        squared_modulus(one.closed),
        np.concatenate([np.abs(poles.imag), np.abs(poles)]),
    )
    return float(np.sqrt(squared)), _top(numerator, one.closed, v)


def _top(numerator: FloatArray, denominator: FloatArray, v: float) -> float:
    """The top of a peak near v: Newton on the slope of log|numerator/denominator|."""
    if not 0 < v < np.inf:
        return v
    start = v
    for _ in range(_POLISHES):
        first = second = 0.0
        for sign, p in ((1, numerator), (-1, denominator)):
            at = np.array(v)
            p0, p1, p2 = (complex(value(q, at)) for q in (p, slope(p), slope(slope(p))))
            if p0 == 0:
                return start
            first += sign * (1j * p1 / p0).real
            second -= sign * (p2 / p0 - (p1 / p0) ** 2).real
        step = first / second if second < 0 else np.inf
        if not abs(step) <= _LONGEST_STEP * v:
            return start
        v -= step
    return v


def _phase(one: ClosedLoop) -> float:
    crossings = positive_roots(squared_modulus(one.added) - squared_modulus(one.open))
    if not crossings.size:
        return np.inf
    v = np.sqrt(crossings)
    derivatives = [(p, slope(p)) for p in (one.added, one.open)]
    for _ in range(_POLISHES):
        with np.errstate(divide="ignore", invalid="ignore"):
            (n, n1), (d, d1) = ((value(p, v), 1j * value(q, v)) for p, q in derivatives)
            step = np.log(np.abs(n / d)) / (n1 / n - d1 / d).real
            good = np.abs(step) <= _LONGEST_STEP * v
        v = np.where(good, v - np.where(good, step, 0.0), v)
    loop = value(one.added, v) / value(one.open, v)
    on_circle = np.abs(np.abs(loop) - 1) <= _ON_CIRCLE
    return float(np.min(np.abs(np.angle(-loop[on_circle], deg=True)), initial=np.inf))
