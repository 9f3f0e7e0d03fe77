"""Routh-Hurwitz criterion with bounds of its rounding errors, and the condition of passivity.

**Stability**: are all roots in Re w < 0? Each coefficient c comes with a size s, the sum of the
absolute values it was added up from; the true coefficient lies within ``ULPS·u·s`` of c. +1 is
certainly stable, -1 certainly not stable and 0 closer to the boundary than float64 can tell.

Many settings of one loop are judged a block of points at a time: both judges decide what error
bounds common to all the points of a block can decide, and leave the rest at 0 for `routh`.

**Passivity** is a second verdict. J. E. Colgate and G. G. Schenkel, "Passivity of a class of
sampled-data systems: application to haptic interfaces", Journal of Robotic Systems 14(1), 1997: a
rigid device of damping b under a zero-order hold is passive, and so stable in every passive hand,
exactly when for all ω

    b > (T/2)·Re{(1 - exp(-jωT))·C(exp(jωT))} / (1 - cos ωT).

With w = jv, v = tan(ωT/2), the right-hand side is (T/2)·(Re C - Im C/v), a quotient of polynomials
in v². Common devices run stably in violation of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.plant import WHOLE
from tune.loop.polynomials import (
    UNIT,
    ComplexArray,
    FloatArray,
    companion_roots,
    parts_on_axis,
    peak,
    squared_modulus,
)

VerdictArray = NDArray[np.int8]

#: Units of roundoff in one coefficient: the factors of a block are right to 12 of their sizes, a
#: filter to 3, delays are whole numbers, and each product and sum adds one; against 600 bits no
#: coefficient of 3 000 loops was off by more than 12.
ULPS = 32.0
#: Signs of the errors in a vertex of Kharitonov's, from one power to the next.
_SIGNS = (1, 1, -1, -1)
#: Newton steps on a computed root.
_POLISHES = 3
#: The disc around a root is so much wider than the distance the root may have.
_WIDER = 1.5
#: Covers the roundings of the terms of a disc.
_SAFE = 1 - 1e-9


def routh(coefficients: FloatArray, sizes: FloatArray) -> VerdictArray:
    """The verdict for coefficients (degree+1, *shape) in ascending powers of w, of that shape."""
    shape = coefficients.shape[1:]
    c = coefficients.reshape(len(coefficients), -1)
    errors = ULPS * UNIT * sizes.reshape(c.shape)
    # Running error bounds decide most; they grow with the degree, so what they leave open is judged
    # by sharper and slower means: stable where the four vertices of Kharitonov's theorem are, not
    # stable where a disc around a computed root lies beyond the axis.
    verdict = _running(c, errors)
    known = np.all(np.isfinite(c) & np.isfinite(errors), axis=0)
    open_ = np.flatnonzero((verdict == 0) & known)
    if open_.size:
        rest, slack = c[:, open_], errors[:, open_]
        beyond = np.where(_root_beyond(rest, slack), np.int8(-1), np.int8(0))
        verdict[open_] = np.where(_vertices_stable(rest, slack), np.int8(1), beyond)
    return verdict.reshape(shape)


def _running(coefficients: FloatArray, errors: FloatArray) -> VerdictArray:
    """Routh's array with running error bounds: quick, and sharp for low degrees."""
    unstable = np.any(coefficients < -errors, axis=0)
    doubtful = np.any(coefficients <= errors, axis=0) & ~unstable
    degree = len(coefficients) - 1
    upper, upper_error = coefficients[degree::-2], errors[degree::-2]
    lower, lower_error = coefficients[degree - 1 :: -2], errors[degree - 1 :: -2]
    with np.errstate(all="ignore"):
        while len(lower):
            pivot, slack = lower[0], lower_error[0]
            # Once a pivot is not certainly positive nothing below it means anything.
            unstable |= (pivot < -slack) & ~doubtful
            doubtful |= ~(unstable | (pivot > slack))
            ratio = upper[0] / pivot
            size = np.abs(ratio)
            ratio_error = (upper_error[0] + size * slack) / (pivot - slack) + 2 * UNIT * size
            nxt, nxt_error = upper[1:].copy(), upper_error[1:].copy()
            below, below_error = lower[1 : len(upper)], lower_error[1 : len(upper)]
            both = len(below)
            product = ratio * below
            nxt[:both] -= product
            nxt_error[:both] += (
                size * below_error
                + ratio_error * (np.abs(below) + below_error)
                + 2 * UNIT * (np.abs(product) + np.abs(nxt[:both]))
            )
            upper, upper_error, lower, lower_error = lower, lower_error, nxt, nxt_error
    return np.where(unstable, np.int8(-1), np.where(doubtful, np.int8(0), np.int8(1)))


def _vertices_stable(coefficients: FloatArray, errors: FloatArray) -> NDArray[np.bool_]:
    """True where every polynomial within the errors is stable; (degree+1, points)."""
    # Kharitonov (1978): a box of coefficients is stable if four of its vertices are. Routh's array
    # in floating point, while all its entries are positive, is the exact one of coefficients that
    # differ by two units of roundoff for each row at most, because they are sums of products of its
    # entries without a subtraction. The box is widened by that.
    degree = len(coefficients) - 1
    errors = errors + 4 * degree * UNIT * (np.abs(coefficients) + errors)
    stable = np.ones(coefficients.shape[1], dtype=np.bool_)
    for start in range(4):
        signs = np.array([_SIGNS[(start + power) % 4] for power in range(degree + 1)])
        stable &= _all_positive(coefficients + signs[:, None] * errors)
    return stable


def _all_positive(coefficients: FloatArray) -> NDArray[np.bool_]:
    """True where every entry of Routh's array is positive."""
    positive = np.all(coefficients > 0, axis=0)
    upper, lower = coefficients[::-1][::2], coefficients[::-1][1::2]
    with np.errstate(all="ignore"):
        while len(lower):
            following = upper[1:].copy()
            following[: len(lower) - 1] -= upper[0] / lower[0] * lower[1:][: len(following)]
            positive &= np.all(following > 0, axis=0)
            upper, lower = lower, following
    return positive


def _root_beyond(coefficients: FloatArray, errors: FloatArray) -> NDArray[np.bool_]:
    """True where every polynomial within the errors has a root in Re w > 0; (degree+1, points)."""
    degree = len(coefficients) - 1
    roots = _roots(coefficients)
    slack = errors + 4 * degree * UNIT * np.abs(coefficients)
    with np.errstate(all="ignore"):
        for _ in range(_POLISHES):
            value, slope, *_ = _expanded(coefficients, roots)
            step = value / slope
            roots = np.where(np.abs(step) < 0.1 * np.abs(roots), roots - step, roots)
        terms = [np.abs(term) for term in _expanded(coefficients, roots)]
        blur = [np.abs(term) for term in _expanded(slack, np.abs(roots).astype(np.complex128))]
        (constant, slope, *higher), (constant_slack, slope_slack, *higher_slack) = terms, blur
        # By Rouché's theorem a disc of radius ρ around a point holds exactly one root if |p'|·ρ
        # exceeds |p| and all higher terms of the expansion there, errors included.
        radius = _WIDER * (constant + constant_slack) / (slope - slope_slack)
        rest = constant + constant_slack
        for power, (term, more) in enumerate(zip(higher, higher_slack, strict=True), start=2):
            rest += (term + more) * radius**power
        single = (radius > 0) & (rest < _SAFE * (slope - slope_slack) * radius)
        return np.any(single & (np.real(roots) > radius), axis=0)


def _roots(coefficients: FloatArray) -> ComplexArray:
    """(degree, points), in whatever digits eigenvalues have."""
    degree = len(coefficients) - 1
    lead = np.where(coefficients[-1] != 0, coefficients[-1], np.finfo(float).tiny)
    unit = np.abs(coefficients[0] / lead) ** (1 / degree)
    unit = np.where(np.isfinite(unit) & (unit > 0), unit, 1.0)
    with np.errstate(all="ignore"):
        scaled = coefficients[:-1] / lead / unit ** (degree - np.arange(degree))[:, None]
    return companion_roots(np.nan_to_num(scaled)) * unit


def _expanded(coefficients: FloatArray, place: ComplexArray) -> list[ComplexArray]:
    """Coefficients of the polynomial in the distance from a place, by Horner's scheme."""
    rows = [np.zeros_like(place) + row for row in coefficients]
    for first in range(len(rows) - 1):
        for power in range(len(rows) - 2, first - 1, -1):
            rows[power] = rows[power] + place * rows[power + 1]
    return rows


def routh_ratios(coefficients: Sequence[Any]) -> list[Any]:
    """Ratios, all below 1 exactly when a polynomial with positive coefficients is stable.

    Each new entry of the table is a difference p - q; in a stable table every p, q and difference
    is positive, so the ratios q/p say it all, free of units and of the scale of w. Coefficients
    ascend, of degree 2 or more.
    """
    upper, lower = list(coefficients[::-2]), list(coefficients[-2::-2])
    ratios: list[Any] = []
    while len(upper) > 1:
        factor = upper[0] / lower[0]
        following = upper[1:]
        for column, item in enumerate(lower[1:]):
            ratios.append(factor * item / following[column])
            following[column] = following[column] - factor * item
        upper, lower = lower, following
    return ratios


#: Points of a block: its arrays stay in the cache, and the cost of a call is shared by many.
_BLOCK = 8192

#: The bounds begin with so much more than the coefficients' own errors; see `_table`.
_ROUNDED = 8

#: (certainly stable, certainly not) at some points.
_Judged = tuple[NDArray[np.bool_], NDArray[np.bool_]]


def judge_many(
    terms: FloatArray,
    sizes: FloatArray,
    values: Sequence[FloatArray],
    count: int,
    *,
    position_free: bool,
) -> VerdictArray:
    """The verdicts of one loop at many points, shape (count,); 0 is left to `routh`.

    Terms are (degree+1, 1 + effects), ascending: the constant part and the coefficient of each
    effect; in sizes every factor is taken absolutely. Values of each effect are (count,). Without a
    spring in the structure (``position_free``) the factor w is left out of the judgement.
    """
    quartic = len(terms) == 5
    if not quartic:
        start = 1 if position_free else 0
        terms, sizes = np.ascontiguousarray(terms[start:][::-1]), sizes[start:][::-1]
    verdict = np.empty(count, dtype=np.int8)
    for first in range(0, count, _BLOCK):
        part = verdict[first : first + _BLOCK]
        points = np.ones((1 + len(values), part.size))
        for row, value in zip(points[1:], values, strict=True):
            row[:] = value[first : first + _BLOCK]
        size = sizes @ np.maximum(points.max(axis=1), -points.min(axis=1))
        c = terms @ points
        stable, unstable = _quartic(c, size, position_free) if quartic else _table(c, size)
        part[:] = stable
        part -= unstable.view(np.int8)
    return verdict


def _table(c: FloatArray, size: FloatArray) -> _Judged:
    """Any degree: Routh's array with running error bounds, in place; highest power first."""
    # With r = u0/v0 every entry of the next row is u - r·v, and its error that of u, r + dr times
    # that of v, and dr times |v|. What is rounded on the way is less than a sixteenth of these
    # bounds in each row, because they begin with more than 32 units of roundoff; beginning with
    # eight times as much covers thirty rows.
    slack = _ROUNDED * ULPS * UNIT * size
    e = np.repeat(slack[:, None], c.shape[1], axis=1)
    unstable = c.min(axis=0) < -slack.max()
    stable = c[0] > e[0]
    # u and v hold every second power.
    u, v, eu, ev = c[0::2], c[1::2], e[0::2], e[1::2]
    with np.errstate(all="ignore"):
        while len(v):
            unstable |= stable & (v[0] < -ev[0])
            stable &= v[0] > ev[0]
            width = len(v) - 1
            if width:
                ratio = u[0] / v[0]
                dr = (ratio * ev[0] + eu[0]) / (v[0] - ev[0])
                u[1 : 1 + width] -= v[1:] * ratio
                eu[1 : 1 + width] += np.abs(v[1:]) * dr
                eu[1 : 1 + width] += ev[1:] * (ratio + dr)
            u, v, eu, ev = v, u[1:], ev, eu[1:]
    return stable, unstable


def _quartic(c: FloatArray, size: FloatArray, position_free: bool) -> _Judged:  # noqa: FBT001
    """Degree four: c_i > 0 and c1·c2·c3 - c0·c3² - c4·c1² > 0."""
    # This is the criterion of equations (38) to (43) with the signs they leave out. Where no spring
    # holds the position the factor w is left in, and c0 is not asked for.
    s0, s1, s2, s3, s4 = size
    slack = ULPS * UNIT * float(size.max())
    h_slack = 4 * ULPS * UNIT * float(s1 * s2 * s3 + s0 * s3 * s3 + s4 * s1 * s1)
    c0, c1, c2, c3, c4 = c
    lowest = np.minimum(c1, c2)
    for coefficient in (c3, c4) if position_free else (c3, c4, c0):
        np.minimum(lowest, coefficient, out=lowest)
    # h = c3·(c1·c2 - c0·c3) - c4·c1², overwriting what is no longer used.
    c2 *= c1
    c0 *= c3
    c2 -= c0
    c2 *= c3
    c1 *= c1
    c1 *= c4
    c2 -= c1
    return (lowest > slack) & (c2 > h_slack), (lowest < -slack) | (c2 < -h_slack)


@dataclass(frozen=True, slots=True, kw_only=True)
class Passivity:
    """Whether a device with its effects is passive.

    Attributes:
        passive: the verdict at the device's best estimate; None where the condition does not apply.
        damping_needed: b must exceed it, N·s/m (N·m·s/rad); None where it does not apply.
        reason: why it does not apply; empty where it does.
    """

    passive: bool | None
    damping_needed: float | None
    reason: str = ""


def passivity(device: Device, effects: Effects, filters: Filters | None = None) -> Passivity:
    """Whether a device is passive at its best estimate, whatever passive hand holds it."""
    time, reason = device.sample_time.value, ""
    delay = device.delay.value / time
    if device.modes:
        reason = "the mechanism vibrates; the condition is proved for a rigid device"
    elif device.current_lag is not None:
        reason = "the actuator lags behind its command; the condition is proved for a held force"
    elif abs(delay - round(delay)) > WHOLE * max(1.0, delay):
        reason = (
            f"the delay is {delay:.6g} samples; the condition is proved for whole samples only, "
            "which can be counted to the computer"
        )
    if reason:
        return Passivity(passive=None, damping_needed=None, reason=reason)
    K, B, M = (0.0 if gain is None else float(gain) for gain in effects.arrays())
    needed = damping_needed(K, B, M, time, filters, delay_samples=round(delay))
    return Passivity(passive=bool(device.damping.value > needed), damping_needed=needed)


def damping_needed(
    stiffness: float,
    damping: float,
    mass: float,
    sample_time: float,
    filters: Filters | None = None,
    *,
    delay_samples: int = 0,
) -> float:
    """Device damping b above which K, B and M are passive, N·s/m (N·m·s/rad).

    Without filters and delay it is KT/2 + max over c in [-1, 1] of [-Bc + (M/T)(2c² - c - 1)], for
    a spring and a damper KT/2 + |B|.

    Args:
        stiffness: K, N/m.
        damping: B, N·s/m.
        mass: M, kg.
        sample_time: T, s.
        filters: of velocity and acceleration.
        delay_samples: whole samples between reading the position and the force that answers it.
    """
    # The law does not know the device: any mass will do.
    loop = Loop.from_numbers(mass=1.0, damping=0.0, sample_time=sample_time, filters=filters)
    parts = loop.transfer
    gains = (stiffness, damping, mass)
    terms = (parts.alpha, parts.beta, parts.gamma)
    numerator = np.zeros(max(len(term) for term in terms))
    for gain, scale, term in zip(gains, loop.scales, terms, strict=True):
        numerator[: len(term)] += gain * float(scale) * term
    denominator = parts.law_denominator
    for _ in range(delay_samples):
        numerator = np.convolve(numerator, [1.0, -1.0])
        denominator = np.convolve(denominator, [1.0, 1.0])
    # (top, bottom) in x = v² of Re C - Im C/v for C = numerator/denominator in w = jv.
    mirrored = denominator * (-1.0) ** np.arange(len(denominator))
    even, odd = parts_on_axis(np.convolve(numerator, mirrored))
    squared = squared_modulus(denominator)
    top, bottom = np.zeros((2, max(len(even), len(squared))))
    top[: len(even)] = even
    top[: len(odd)] -= odd
    bottom[: len(squared)] = squared
    rate = float(loop.scales[1])

    def needed(v: FloatArray) -> FloatArray:
        return np.polyval(top[::-1], v * v) / np.polyval(bottom[::-1], v * v)

    corners = np.abs(np.roots(denominator[::-1]))
    return peak(needed, top, bottom, corners)[0] / (2 * rate)
