"""Stability constraint for solvers: how far the gain is from where stability ends.

With the sizes fixed, the loop is stable for gains up to some g; ln g is exact (`intervals`), and so
is its slope: the root that crosses at w = jω keeps to the axis when effects and gain change
together. That no gap opens below g is a constraint of its own.

Gaps are unstable gains between stable ones. With L the open loop, a gain s is on the boundary where
s·L = -1. Below the gain that is asked for L must not reach the negative real axis at all: a gap
opens where the phase of -L, at one of its least or greatest values over frequency, touches zero.
That phase is smooth in the sizes where the end of the stable gains jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.loop.loop import Loop
from tune.optimisation.problem import Problem
from tune.stability.verdict import stability_limits

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]
_Table = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

#: Newton steps on the frequency, and the part of it that one may go.
_STEPS, _STRIDE = 6, 0.3
#: An extreme is found where the next step would be less than this part of the frequency.
_FOUND = 1e-6
#: The constraint where nothing is near to touching: kept by a radian.
_CLEAR = -1.0
#: ln g counts as at most this: what is further away limits nothing.
_FAR = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """Stability as constraints that are at most 0 where the margin is kept, at some corners.

    Attributes:
        tables: of each loop with corners, (fixed, varied and their sizes), of shapes
            (degree+1, corners) and (3, degree+1, corners) in K, B and M.
        grounded: whether device or hand bind the position, by loop.
        shares: what each unknown adds to K, B and M of the moments with a spring and of those
            without, shape (moments, 3, unknowns) each.
    """

    tables: tuple[_Table, ...]
    grounded: tuple[bool, ...]
    shares: tuple[FloatArray, FloatArray]
    gain: float

    @classmethod
    def of(
        cls, problem: Problem, shown: Sequence[tuple[Loop, Sequence[int]]], gain: float
    ) -> Reach:
        """At some columns of loops, up to the gain that must be stable."""
        return cls(
            tables=tuple(_table(loop, columns) for loop, columns in shown),
            grounded=tuple(loop.grounded for loop, _ in shown),
            shares=(problem.shares(sprung=True), problem.shares(sprung=False)),
            gain=gain,
        )

    @property
    def size(self) -> int:
        """How many constraints these are."""
        moments = sum(len(shares) for shares in self.shares)
        return 2 * moments * sum(table[0].shape[1] for table in self.tables)

    def at(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Constraints, shape (constraints,), and their slopes to log-sizes, (constraints, n)."""
        values: list[FloatArray] = [np.empty(0)]
        slopes: list[FloatArray] = [np.empty((0, sizes.size))]
        for table, grounded in zip(self.tables, self.grounded, strict=True):
            for shares, sprung in zip(self.shares, (True, False), strict=True):
                if len(shares):
                    skip = 0 if sprung or grounded else 1
                    value, slope = _reach(table, shares * sizes, skip, self.gain)
                    values.append(value.ravel())
                    slopes.append(slope.reshape(-1, sizes.size))
        return np.concatenate(values), np.concatenate(slopes)


def _reach(
    table: _Table, parts: FloatArray, skip: int, gain: float
) -> tuple[FloatArray, FloatArray]:
    """ln(gain) - ln g and the phase of the nearest gap, and their slopes to log-sizes.

    Parts are what each unknown adds to K, B and M, (moments, 3, unknowns); powers of w below
    ``skip`` are left out. Shapes (2, moments, corners) and (2, moments, corners, unknowns).
    """
    fixed, effects, fixed_size, effect_sizes = table
    totals = parts.sum(axis=2)
    varied = np.einsum("me,ekc->kmc", totals, effects)[skip:]
    varied_size = np.einsum("me,ekc->kmc", np.abs(totals), effect_sizes)[skip:]
    shape = varied.shape
    spread = [np.broadcast_to(part[skip:, None], shape) for part in (fixed, fixed_size)]
    together = (spread[0], varied, spread[1], varied_size)
    free, law, free_size, law_size = (part.reshape(shape[0], -1) for part in together)
    found = stability_limits(free, law, free_size, law_size, gain)
    gap, place = _gap_phase(free, law, found.near, gain, found.broken)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = np.stack([np.log(gain / found.end), gap])
        # P(w) = A + g·ΣE·B_E with w = jω keeps its root on the axis: the changes by ln g, by each
        # E and by ω add up to nothing.
        powers = _powers(found.omega, shape[0])
        orders = np.arange(1.0, shape[0])[:, None]
        turn: ComplexArray = np.sum(
            orders * (free + found.end * law)[1:] * powers[:-1] * 1j, axis=0
        )
        # Where the root crosses at the end of the axis all is real, and nothing can turn.
        still = (found.omega == 0) | np.isinf(found.omega)
        across = np.where(still, -1j, np.conj(turn)).reshape(shape[1:])[..., None]
        change = _changes(effects[:, skip:], powers.reshape(shape), parts)
        whole = change.sum(axis=2, keepdims=True)
        slope = np.imag(change * across) / np.imag(whole * across)
        powers = _powers(place, shape[0])
        change = _changes(effects[:, skip:], powers.reshape(shape), parts)
        whole = change.sum(axis=2, keepdims=True)
        alone: ComplexArray = np.sum(free * powers, axis=0)
        towards = np.sign(np.angle(whole / alone.reshape(whole.shape) * -1))
        opens = np.where(found.broken, 1.0, -1.0).reshape(whole.shape)
        turning = opens * towards * np.imag(change / whole)
    slopes = np.stack([slope, turning])
    value = np.nan_to_num(value, nan=_FAR, posinf=_FAR, neginf=-_FAR).reshape(2, *shape[1:])
    slopes[~((np.abs(value) < _FAR) & np.all(np.isfinite(slopes), axis=3))] = 0.0
    return np.clip(value, -_FAR, _FAR), slopes


def _powers(omega: FloatArray, count: int) -> ComplexArray:
    """Powers of jω from 0 on, (count, loops); beyond ω = 1 all over the highest of them.

    No angle between them notices.
    """
    exponents = np.arange(count)[:, None]
    small = np.where(omega > 1, 1.0, omega) ** exponents
    large = np.where(omega > 1, 1 / omega, 1.0) ** (count - 1 - exponents)
    return small * large * 1j ** (exponents % 4)


def _changes(effects: FloatArray, powers: ComplexArray, parts: FloatArray) -> ComplexArray:
    """What each unknown adds to the polynomial, (moments, corners, unknowns)."""
    each = np.einsum("ekc,kmc->mce", effects, powers)
    return np.einsum("mce,mei->mci", each, parts)


def _table(loop: Loop, columns: Sequence[int]) -> _Table:
    chosen = list(columns)
    scales = np.stack([np.broadcast_to(s, loop.terms.free.shape[1:]) for s in loop.scales])
    terms, sizes = (
        np.stack([part.alpha, part.beta, part.gamma])[..., chosen] * scales[:, None, chosen]
        for part in (loop.terms, loop.sizes)
    )
    return loop.terms.free[:, chosen], terms, loop.sizes.free[:, chosen], sizes


def _gap_phase(
    free: FloatArray, law: FloatArray, near: FloatArray, gain: float, broken: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """How far the phase of loops is beyond touching, rad, and at which frequency v.

    The loops without effects and what the effects add have coefficients of shape (degree+1, loops),
    ascending powers of w; frequencies near a gap have shape (candidates, loops), nan where unused.
    At most 0 where no gap is open, below the gain that is asked for; v is nan where none is near.
    """
    near = near[np.any(np.isfinite(near), axis=1)]
    if not len(near):
        return np.full(broken.shape, _CLEAR), np.full(broken.shape, np.nan)
    v = near.copy()
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            slope, curve, _ = _phase(free, law, v)
            step = np.clip(slope / curve, -_STRIDE * v, _STRIDE * v)
            v = v - step
        slope, curve, loop = _phase(free, law, v)
        phase = np.angle(-loop)
        found = (np.abs(slope / curve) <= _FOUND * v) & (np.abs(loop) * gain > 1)
        # Bent away from zero it does not touch yet; bent the other way it crosses twice, which in
        # a loop without a gap it may do at higher gains only.
        open_ = phase * curve < 0
        value = np.where(open_, np.abs(phase), -np.abs(phase))
        value = np.where(found & (open_ == broken), value, -np.inf)
    # Of open gaps the narrowest: others are the bends of the phase far from the axis.
    chosen = np.where(broken, np.argmin(np.where(value > 0, value, np.inf), axis=0), 0)
    chosen = np.where(broken, chosen, np.argmax(value, axis=0))[None]
    best = np.take_along_axis(value, chosen, axis=0)[0]
    place = np.take_along_axis(v, chosen, axis=0)[0]
    near_one = best > _CLEAR
    return np.where(near_one, best, _CLEAR), np.where(near_one, place, np.nan)


def _phase(
    free: FloatArray, law: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """(slope and second derivative to v of the phase of L, L) at w = jv."""
    (a, a1, a2), (b, b1, b2) = (_derivatives(part, v) for part in (free, law))
    slope = np.real(b1 / b - a1 / a)
    curve = -np.imag((b2 / b - (b1 / b) ** 2) - (a2 / a - (a1 / a) ** 2))
    return slope, curve, b / a


def _derivatives(part: FloatArray, v: FloatArray) -> tuple[ComplexArray, ...]:
    """A polynomial and two derivatives to w at w = jv, v of shape (candidates, loops)."""
    w = v * 1j
    value = np.zeros(w.shape, dtype=np.complex128)
    first, second = value.copy(), value.copy()
    for row in part[::-1]:
        second = second * w + 2 * first
        first = first * w + value
        value = value * w + row
    return value, first, second
