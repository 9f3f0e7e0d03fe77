"""Stable at one point, and nowhere in the box can a pole cross: then stable in the whole box.

A pole crosses the boundary at w = jv only where even and odd part of the loop polynomial vanish
together, E_A(x) + s·E_B(x) = 0 and O_A(x) + s·O_B(x) = 0 with x = v². For a cell of (m, b, T) the
coefficients are enclosed in balls; for a cell of x each equation leaves an interval of gains s in
[0, g], found by four linear inequalities. Where the two intervals do not meet there is no crossing.
Cells of x, then cells of the box, are split until every one is excluded or the budget is spent.

The polynomial is assembled here from the exact held plant in w, multiplied through by m so that it
depends on m and b almost linearly; the corners are judged elsewhere, in z, from the printed form.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product

import numpy as np
from flint import arb, arb_poly
from numpy.typing import NDArray

from tune.certificate.polynomial import Setting, precision

FloatArray = NDArray[np.float64]

#: Bound of the relative rounding error of one evaluation, thirty operations of 2^-52 and more.
_ROUNDING = 1e-14
#: Cells of x narrower than this, relative, are not split any further: the box is split instead.
_NARROWEST = 1e-4
#: Below this x = tan²(ωT/2) nothing oscillates.
_SLOWEST = 1e-30
#: Cells of x looked at for one cell of the box before the box is split instead.
_MOST_PIECES = 5_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """Intervals of mass (kg), damping (N·s/m) and sample time (s)."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]

    def halves(self) -> tuple[Cell, Cell]:
        """The cell cut in two across its relatively widest side."""
        sides = {"mass": self.mass, "damping": self.damping, "sample_time": self.sample_time}
        widest = max(sides, key=lambda name: _relative(sides[name]))
        low, high = sides[widest]
        middle = (low + high) / 2
        return (
            replace(self, **{widest: (low, middle)}),
            replace(self, **{widest: (middle, high)}),
        )


def _relative(side: tuple[float, float]) -> float:
    low, high = side
    return (high - low) / max(abs(low), abs(high)) if high > low else 0.0


def no_crossing(
    cell: Cell, setting: Setting, delay_samples: int, gain: float, most_cells: int
) -> bool:
    """True if it is proved that no pole crosses for any point of the cell and gain in (0, gain].

    Args:
        cell: the box of the device.
        setting: what is played, not nothing.
        delay_samples: whole samples of delay.
        gain: upper end of the gains.
        most_cells: cells of the box to be looked at before giving up.
    """
    waiting = deque([cell])
    looked_at = 0
    while waiting:
        part = waiting.popleft()
        looked_at += 1
        if looked_at + len(waiting) > most_cells:
            return False
        with precision():
            fixed, varied = _enclosures(part, setting, delay_samples)
        # A spring holds the position for every gain but zero: c0 = s·K·T²·ψ.
        if not _excluded(fixed, varied, gain, position_held=setting.stiffness > 0):
            waiting.extend(part.halves())
    return True


def _enclosures(cell: Cell, setting: Setting, delay: int) -> tuple[FloatArray, FloatArray]:
    """Coefficients of A and B, ascending in w, as (2, degree+1) arrays of lower and upper ends."""
    m, b, T = (_ball(side) for side in (cell.mass, cell.damping, cell.sample_time))
    # ψ falls and χ rises with δ = bT/m, which is extreme at a corner: so are they.
    corners = product(cell.mass, cell.damping, cell.sample_time)
    deltas = [arb(b_) * arb(T_) / arb(m_) for m_, b_, T_ in corners]
    psi = reduce(arb.union, [_psi(delta) for delta in deltas])
    chi = reduce(arb.union, [_chi(delta) for delta in deltas])
    loss = b * T * psi
    one = arb_poly([1])
    w = arb_poly([0, 2])
    av, aa = (_pole(f, T) for f in (setting.velocity_filter_hz, setting.acceleration_filter_hz))
    behind_velocity = arb_poly([1 - av, 1 + av]) if setting.damping else one
    behind_acceleration = arb_poly([1 - aa, 1 + aa]) ** 2 if setting.mass else one
    damper = behind_acceleration * (T * (1 - av) * arb(setting.damping))
    inertia = behind_velocity * ((1 - aa) ** 2 * arb(setting.mass))
    free = arb_poly([loss, 2 * m - loss]) * arb_poly([1, 1]) ** delay
    free = free * behind_velocity * behind_acceleration
    held = arb_poly([psi, chi]) * arb_poly([1, -1]) ** (1 + delay)
    if setting.stiffness:
        spring = behind_velocity * behind_acceleration * (T * T * arb(setting.stiffness))
        law = spring + damper * w + inertia * w * w
        return _ends(free * w, held * law)
    return _ends(free, held * (damper + inertia * w))


def _ball(side: tuple[float, float]) -> arb:
    return arb(side[0]).union(arb(side[1]))


def _psi(delta: arb) -> arb:
    return arb(1) if delta == 0 else -(-delta).expm1() / delta


def _chi(delta: arb) -> arb:
    if delta == 0:
        return arb(0)
    half = delta / 2
    return (1 + (-delta).exp()) / delta * (1 - half.tanh() / half)


def _pole(cutoff: float | None, sample_time: arb) -> arb:
    return arb(0) if cutoff is None else (arb.pi() * (-2 * cutoff) * sample_time).exp()


def _ends(a: arb_poly, b: arb_poly) -> tuple[FloatArray, FloatArray]:
    size = max(a.degree(), b.degree()) + 1
    tables: list[FloatArray] = []
    for polynomial in (a, b):
        table = np.zeros((2, size))
        for power, ball in enumerate(polynomial.coeffs()):
            table[0, power] = np.nextafter(float(ball.lower()), -np.inf)
            table[1, power] = np.nextafter(float(ball.upper()), np.inf)
        tables.append(table)
    return tables[0], tables[1]


def _excluded(fixed: FloatArray, varied: FloatArray, gain: float, *, position_held: bool) -> bool:
    """No x in [0, ∞] and s in (0, gain] at which both parts can vanish, nor a root at 0 or ∞."""
    ends = [-1] if position_held else [0, -1]
    if not _gains(fixed[:, ends], varied[:, ends], gain)[2].all():
        return False
    flipped = fixed[:, ::-1], varied[:, ::-1]
    degree = fixed.shape[1] - 1
    return _side(fixed, varied, gain, (0, 1)) and _side(
        *flipped, gain, (degree % 2, 1 - degree % 2)
    )


def _side(fixed: FloatArray, varied: FloatArray, gain: float, starts: tuple[int, int]) -> bool:
    """The same for x in [0, 1]; the other half comes with reversed coefficients."""
    parts = [
        (_alternating(fixed[:, start::2]), _alternating(varied[:, start::2])) for start in starts
    ]
    low, high = np.zeros(1), np.ones(1)
    seen = 0
    while low.size:
        seen += low.size
        if seen > _MOST_PIECES:
            return False
        bottom, top = np.zeros(low.size), np.full(low.size, gain)
        for a, b in parts:
            least, most, _ = _gains(_over(a, low, high), _over(b, low, high), gain)
            bottom, top = np.maximum(bottom, least), np.minimum(top, most)
        open_ = bottom <= top
        low, high = low[open_], high[open_]
        if np.any((high - low <= _NARROWEST * high) | (high < _SLOWEST)):
            return False
        middle = np.where(low == 0, high / 16, np.sqrt(low * high))
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return True


def _alternating(part: FloatArray) -> FloatArray:
    """Powers of w² = -x to powers of x, ends kept in order."""
    turned = part.copy()
    turned[:, 1::2] = -part[::-1, 1::2]
    return turned


def _over(part: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Enclosure of a polynomial with interval coefficients over cells of x >= 0; (2, cells)."""
    total = np.zeros((2, low.size))
    size = np.zeros(low.size)
    for power, (bottom, top) in enumerate(part.T):
        small, large = low**power, high**power
        total[0] += bottom * (small if bottom >= 0 else large)
        total[1] += top * (large if top >= 0 else small)
        size += max(abs(bottom), abs(top)) * large
    total[0] -= _ROUNDING * size
    total[1] += _ROUNDING * size
    return total


def _gains(
    a: FloatArray, b: FloatArray, gain: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Gains s in [0, gain] at which 0 can be in a + s·b: (least, most, certainly none)."""
    least, most = np.zeros(a.shape[1]), np.full(a.shape[1], gain)
    # lower end of the sum <= 0 and upper end >= 0, both linear in s >= 0.
    for constant, slope in ((a[0], b[0]), (-a[1], -b[1])):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = -constant / slope
        never = (slope == 0) & (constant > 0)
        # Widened against rounding of the quotient: a longer interval excludes less.
        least = np.where(slope < 0, np.maximum(least, at * (1 - _ROUNDING)), least)
        most = np.where(slope > 0, np.minimum(most, at * (1 + _ROUNDING)), most)
        most = np.where(never, -1.0, most)
    return least, most, least > most
