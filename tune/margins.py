"""Margins of one loop: slowest decay, least damping ratio, phase and disk.

Gain and delay margins over the whole box are those of `tune.stability.verdict`. The disk margin is
that of P. Seiler, A. Packard and P. Gahinet, "An introduction to disk margins", IEEE Control
Systems 40(5), 2020: the loop stays stable while its gain is multiplied, at all frequencies and at
once, by any complex number of the disk {(1 + d/2)/(1 - d/2), |d| < α}; the largest α is
1/max|(S - T)/2|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tune.documents import LoopError
from tune.documents.scene import Effects
from tune.loop.loop import ClosedLoop, Loop, closed_loop
from tune.loop.polynomials import FloatArray, peak, positive_roots, slope, squared_modulus, value_at
from tune.stability.verdict import is_stable

#: A pole that decays by more than exp(-π) within one sample is gone before it can swing: even at
#: the Nyquist frequency its damping ratio exceeds 1/√2. The poles that delays put near z = 0 are
#: of this kind, and doubles do not hold their ratios.
_GONE_IN_A_SAMPLE = np.pi
#: Newton steps on a crossing |L| = 1 or on the top of a peak; each doubles the digits.
_POLISHES = 5
#: A Newton step longer than this, relative, leaves the neighbourhood it was started in.
_LONGEST_NEWTON = 0.1
#: |L| at a crossing is 1 within this, relative; what is not was no crossing.
_ON_CIRCLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """How far one loop is from instability; a disk and a phase of 0 where it is not stable.

    Attributes:
        decay: of the slowest closed-loop pole s = ln(z)/T, 1/s: everything shrinks at least like
            exp(-decay·t); negative for a loop that grows. Without anything that holds the position
            the pole of free motion does not count.
        damping_ratio: the least -Re(s)/|s| of the poles, at most 1; those with z nearer to 0 than
            exp(-π), whose ratio exceeds 0.707 in any case, are left out.
        phase: the least that makes the loop unstable when it turns all frequencies alike,
            |arg(-L)| where |L| = 1, degrees; inf where no phase alone destabilises.
        disk: α, at most 2: gains from (2-α)/(2+α) to (2+α)/(2-α), or phases up to 2·atan(α/2),
            alone are borne.
        critical_frequency_hz: at which least gain and phase together make the loop swing without
            end, Hz; nan where it is not stable.
    """

    decay: float
    damping_ratio: float
    phase: float
    disk: float
    critical_frequency_hz: float


def margins_of(loop: Loop, effects: Effects) -> LoopMargins:
    """All margins of one loop.

    Args:
        loop: of shape (), scaled by mass and sample time; the poles of a filter count even where
            its effect is absent, so leave such a filter out of the loop.
        effects: single values; None marks an effect that is not there.

    Raises:
        LoopError: several loops or values, or one that is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is told so
        closed, _ = loop.polynomial(effects)
    if closed.ndim > 1 or not np.isfinite(closed).all():
        seen = f"{effects} on {loop}"
        raise LoopError(f"margins are those of one loop with one finite value each, not of {seen}")
    one = closed_loop(loop, effects)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Im s in [-π/T, π/T]; -∞ for z = 0.
        s = np.asarray(2 / one.sample_time * np.arctanh(one.poles()), dtype=np.complex128)
    swinging = s[-s.real * one.sample_time < _GONE_IN_A_SAMPLE]
    moduli = np.abs(swinging)
    ratios = np.where(moduli > 0, -swinging.real / np.where(moduli > 0, moduli, 1.0), 0.0)
    phase, disk, hertz = 0.0, 0.0, float("nan")
    if bool(is_stable(loop, effects)):
        phase = _phase(one)
        disk, hertz = _disk(one)
    return LoopMargins(
        decay=float(np.min(-s.real)),
        damping_ratio=float(np.min(ratios, initial=1.0)),
        phase=phase,
        disk=disk,
        critical_frequency_hz=hertz,
    )


def _disk(one: ClosedLoop) -> tuple[float, float]:
    """(α, its frequency in Hz)."""
    # (S - T)/2 = (D - N)/(2(D + N)); D - N loses nothing that |D - N| near its peak needs.
    numerator, poles = (one.open - one.added) / 2, one.poles()
    squared, v = peak(
        lambda v: np.abs(value_at(numerator, v) / value_at(one.closed, v)) ** 2,
        squared_modulus(numerator),
        squared_modulus(one.closed),
        np.concatenate([np.abs(poles.imag), np.abs(poles)]),
    )
    v = _top(numerator, one.closed, v)
    return float(1 / np.sqrt(squared)), float(np.arctan(v) / (np.pi * one.sample_time))


def _top(numerator: FloatArray, denominator: FloatArray, v: float) -> float:
    """The top of a peak near v: Newton on the slope of log|numerator/denominator|."""
    if not 0 < v < np.inf:
        return v
    start = v
    for _ in range(_POLISHES):
        first = second = 0.0
        for sign, p in ((1, numerator), (-1, denominator)):
            at = np.array(v)
            p0, p1, p2 = (complex(value_at(q, at)) for q in (p, slope(p), slope(slope(p))))
            if p0 == 0:
                return start
            first += sign * (1j * p1 / p0).real
            second -= sign * (p2 / p0 - (p1 / p0) ** 2).real
        step = first / second if second < 0 else np.inf
        if not abs(step) <= _LONGEST_NEWTON * v:
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
            (n, n1), (d, d1) = ((value_at(p, v), 1j * value_at(q, v)) for p, q in derivatives)
            step = np.log(np.abs(n / d)) / (n1 / n - d1 / d).real
            good = np.abs(step) <= _LONGEST_NEWTON * v
        v = np.where(good, v - np.where(good, step, 0.0), v)
    loop = value_at(one.added, v) / value_at(one.open, v)
    on_circle = np.abs(np.abs(loop) - 1) <= _ON_CIRCLE
    return float(np.min(np.abs(np.angle(-loop[on_circle], deg=True)), initial=np.inf))
