"""Affine arithmetic: complex numbers linear in the unknowns of a cell, with a bound of the rest.

An affine form is c + Σ sᵢ·uᵢ + r with every uᵢ in [-1, 1] and r anywhere in a rectangle of the
complex plane. Linear parts of a sum cancel as they should, and the rest shrinks with the square of
the cell. So boxes of ±20 % can be proved near the boundary, where interval arithmetic cannot. Real
and imaginary part of the rest are kept apart, because a loop near its limit is told from an
unstable one by its phase. Cells are the last axis of every array.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]

#: Bound of the relative rounding error of one operation: a complex product errs by √5·2^-53 of its
#: modulus, an elementary function by less than 2^-50; the rest is for the few roundings in what a
#: cell takes as known exactly, such as 1/T².
ROUNDING = 4e-15
#: What a form is multiplied by or shifted by.
Factor = complex | FloatArray | ComplexArray
#: Phases that vary by more within a cell are not followed: anywhere on the circle.
_WIDEST_PHASE = 1.2

#: (sin(x)/x - 1)/x by powers of x², next term 1e-15 at 0.1; beyond it the quotient keeps digits.
_SERIES, _SHORT = np.array([1 / 362_880, -1 / 5040, 1 / 120, -1 / 6]), 0.1


@dataclass(frozen=True, slots=True)
class AffineForm:
    """An affine form c + Σ sᵢ·uᵢ + r with |uᵢ| <= 1, one for each cell."""

    centre: ComplexArray  # c, shape (..., cells)
    slopes: ComplexArray  # sᵢ, shape (symbols, ..., cells)
    real: FloatArray  # bound of |Re r|, shape (..., cells)
    imag: FloatArray  # bound of |Im r|, shape (..., cells)

    def __add__(self, other: AffineForm | Factor) -> AffineForm:
        if not isinstance(other, AffineForm):
            centre: ComplexArray = self.centre + other
            error = ROUNDING * np.abs(centre)
            return AffineForm(centre, self.slopes, self.real + error, self.imag + error)
        centre, slopes = self.centre + other.centre, self.slopes + other.slopes
        error = ROUNDING * (np.abs(centre) + _reach(slopes))
        return AffineForm(
            centre, slopes, self.real + other.real + error, self.imag + other.imag + error
        )

    __radd__ = __add__

    def __sub__(self, other: AffineForm | Factor) -> AffineForm:
        return self + other * -1.0

    def __rsub__(self, other: Factor) -> AffineForm:
        return self * -1.0 + other

    def __mul__(self, other: AffineForm | Factor) -> AffineForm:
        if not isinstance(other, AffineForm):
            return self._scaled(np.asarray(other, dtype=np.complex128))
        x, y = self.centre, other.centre
        centre = x * y
        slopes = x * other.slopes + y * self.slopes
        (xr, xi), (yr, yi) = self._spread(), other._spread()
        # The product of both deviations, and each rest turned by the other's centre.
        real = xr * yr + xi * yi
        imag = xr * yi + xi * yr
        for turn, form in ((x, other), (y, self)):
            size_r, size_i = np.abs(turn.real), np.abs(turn.imag)
            real = real + size_r * form.real + size_i * form.imag
            imag = imag + size_r * form.imag + size_i * form.real
        error = ROUNDING * (np.abs(centre) + np.abs(x) * (yr + yi) + np.abs(y) * (xr + xi))
        return AffineForm(centre, slopes, real + error, imag + error)

    __rmul__ = __mul__

    def _scaled(self, factor: ComplexArray) -> AffineForm:
        centre, slopes = self.centre * factor, self.slopes * factor
        size_r, size_i = np.abs(factor.real), np.abs(factor.imag)
        error = ROUNDING * (np.abs(centre) + _reach(slopes))
        return AffineForm(
            centre,
            slopes,
            size_r * self.real + size_i * self.imag + error,
            size_r * self.imag + size_i * self.real + error,
        )

    def _spread(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of real and imaginary part of what is added to the centre."""
        return (
            np.add.reduce(np.abs(self.slopes.real)) + self.real,
            np.add.reduce(np.abs(self.slopes.imag)) + self.imag,
        )

    def spread(self) -> FloatArray:
        """Bound of the modulus of what is added to the centre."""
        return _reach(self.slopes) + np.hypot(self.real, self.imag) * (1 + ROUNDING)

    def stacked(self) -> AffineForm:
        """With an axis before that of the cells, to broadcast against."""
        return AffineForm(self.centre[None], self.slopes[:, None], self.real[None], self.imag[None])

    def total(self) -> AffineForm:
        """Sum over the axis before that of the cells."""
        centre, slopes = self.centre.sum(axis=-2), self.slopes.sum(axis=-2)
        error = ROUNDING * (np.abs(self.centre) + _reach(self.slopes)).sum(axis=-2)
        return AffineForm(
            centre, slopes, self.real.sum(axis=-2) + error, self.imag.sum(axis=-2) + error
        )

    def widened(self, error: FloatArray | float) -> AffineForm:
        """With anything of that modulus added."""
        return AffineForm(self.centre, self.slopes, self.real + error, self.imag + error)

    def inverse(self) -> AffineForm:
        """1/x; without bound where x may be zero."""
        centre = self.centre
        size, spread = np.abs(centre) * (1 - ROUNDING), self.spread()
        with np.errstate(all="ignore"):
            inverse = 1 / centre
            rest = np.where(spread < size, spread**2 / (size**2 * (size - spread)), np.inf)
        straight = AffineForm(centre * 0, self.slopes, self.real, self.imag)._scaled(
            -inverse * inverse
        )
        error = rest + 4 * ROUNDING * np.abs(inverse)
        return AffineForm(inverse, straight.slopes, straight.real + error, straight.imag + error)

    def exponential(self) -> AffineForm:
        """e^x for x of moderate size."""
        value = np.exp(self.centre)
        spread = self.spread()
        size = np.abs(value)
        with np.errstate(over="ignore"):
            rest = size * spread**2 / 2 * np.exp(spread)
        straight = AffineForm(self.centre * 0, self.slopes, self.real, self.imag)._scaled(value)
        error = rest + ROUNDING * size * (1 + np.abs(self.centre))
        return AffineForm(value, straight.slopes, straight.real + error, straight.imag + error)

    def turn(self) -> AffineForm:
        """e^(-jx) of a real form: anywhere on the unit circle where x is not known well."""
        at = self.centre.real
        spread = np.sum(np.abs(self.slopes.real), axis=0) + self.real
        cosine, sine = np.cos(at), np.sin(at)
        lost = spread > _WIDEST_PHASE
        square = np.where(lost, 0.0, spread**2 / 2)
        rounding = ROUNDING * (1 + np.abs(at))
        real = square * np.minimum(1, np.abs(cosine) + spread) + np.abs(sine) * self.real + rounding
        imag = square * np.minimum(1, np.abs(sine) + spread) + np.abs(cosine) * self.real + rounding
        value = cosine - 1j * sine
        return AffineForm(
            np.where(lost, 0, value).astype(np.complex128),
            np.where(lost, 0, -1j * value * self.slopes.real).astype(np.complex128),
            np.where(lost, 1 + ROUNDING, real),
            np.where(lost, 1 + ROUNDING, imag),
        )

    def of_real(self, value: FloatArray, slope: FloatArray, bend: float) -> AffineForm:
        """A real function, of size about one, from its value, slope and bound of the bend."""
        spread = np.sum(np.abs(self.slopes.real), axis=0) + self.real
        error = (
            bend / 2 * spread**2
            + np.abs(slope) * self.real
            + ROUNDING * (1 + np.abs(value) + np.abs(slope) * (np.abs(self.centre) + spread))
        )
        centre = np.asarray(value, dtype=np.complex128)
        return AffineForm(centre, slope * self.slopes, error, np.zeros_like(error))


#: What a cell knows exactly is a number.
Term = AffineForm | float


def inverse(term: Term) -> Term:
    """1/x of a form or a number."""
    return term.inverse() if isinstance(term, AffineForm) else 1 / term


def reciprocal(term: Term) -> Term:
    """1/x of a real term above zero: the straight line nearest to it between the ends."""
    if not isinstance(term, AffineForm):
        return 1 / term
    low, high = ends_of(term)
    # At both ends the line is as far below 1/x as it is above it at the root.
    at_ends, at_root = (1 / low + 1 / high) / 2, 1 / np.sqrt(low * high)
    slope = -1 / (low * high)
    centre = at_ends + at_root + slope * term.centre.real
    error = at_ends - at_root - slope * term.real + 8 * ROUNDING / low
    error = np.where(low > 0, error, np.inf)
    return AffineForm(centre.astype(np.complex128), slope * term.slopes, error, term.imag)


def ends_of(form: Term) -> tuple[FloatArray, FloatArray]:
    """Least and largest value of a real term in each cell."""
    if not isinstance(form, AffineForm):
        return np.asarray(form), np.asarray(form)
    wide = (np.sum(np.abs(form.slopes.real), axis=0) + form.real) * (1 + ROUNDING)
    return form.centre.real - wide, form.centre.real + wide


def anywhere_between(low: FloatArray, high: FloatArray, like: AffineForm) -> AffineForm:
    """A real number of which only the ends are known, with the symbols of another form."""
    error = (high - low) / 2 + ROUNDING * np.maximum(np.abs(low), np.abs(high))
    centre = ((low + high) / 2).astype(np.complex128)
    return AffineForm(centre, 0 * like.slopes, error, np.zeros_like(error))


def sinc(angle: AffineForm) -> AffineForm:
    """sin(x)/x of a real form."""
    x = angle.centre.real
    small = np.abs(x) < 1e-4
    safe = np.where(small, 1.0, x)
    value = np.where(small, 1 - x * x / 6, np.sin(safe) / safe)
    # The slope by its series below 0.1, where the quotient loses digits: next term 1e-15.
    short = np.abs(x) < 0.1
    other = np.where(short, 1.0, x)
    slope = np.where(
        short,
        -x / 3 * (1 - x * x / 10 * (1 - x * x / 28 * (1 - x * x / 54))),
        (np.cos(other) - np.sin(other) / other) / other,
    )
    return angle.of_real(value, slope, 1 / 3)


def sinc_beyond(angle: AffineForm) -> AffineForm:
    """(sin(x)/x - 1)/x of a real form; its second derivative is ∫∫ s²·sin(sx), at most 1/12."""
    x = angle.centre.real
    short = np.abs(x) < _SHORT
    safe = np.where(short, 1.0, x)
    ratio = np.sin(safe) / safe
    value = np.where(short, x * np.polyval(_SERIES, x * x), (ratio - 1) / safe)
    slopes = np.polyval(_SERIES * [7, 5, 3, 1], x * x)
    slope = np.where(short, slopes, (np.cos(safe) - 2 * ratio + 1) / safe**2)
    return angle.of_real(value, slope, 1 / 12)


def real_part(form: AffineForm) -> AffineForm:
    """Re x."""
    centre, slopes = (part.real.astype(np.complex128) for part in (form.centre, form.slopes))
    return AffineForm(centre, slopes, form.real, np.zeros_like(form.real))


def conjugate(form: AffineForm) -> AffineForm:
    """Re x - j·Im x."""
    return AffineForm(np.conj(form.centre), np.conj(form.slopes), form.real, form.imag)


def squared_modulus(form: AffineForm) -> AffineForm:
    """|x|²."""
    real, imag = real_part(form), real_part(form * -1j)
    return real * real + imag * imag


def add_axis(part: Any) -> Any:
    """A term, or terms in tuples, with room for an axis before that of the cells."""
    if isinstance(part, tuple):
        return tuple(map(add_axis, cast("tuple[Any, ...]", part)))
    return part.stacked() if isinstance(part, AffineForm) else part


def real_lower_bound(form: AffineForm) -> FloatArray:
    """Lower bound of the real part."""
    wide = np.sum(np.abs(form.slopes.real), axis=0) + form.real
    return form.centre.real - wide - ROUNDING * (np.abs(form.centre.real) + wide)


def modulus_bound(form: AffineForm) -> FloatArray:
    """Upper bound of the modulus."""
    return (np.abs(form.centre) + form.spread()) * (1 + ROUNDING)


def range_of(term: Term) -> tuple[float, float]:
    """Least and largest value of a real term over all cells."""
    low, high = ends_of(term)
    return float(np.min(low)), float(np.max(high))


def _reach(slopes: ComplexArray) -> FloatArray:
    """Bound of the modulus of the straight part."""
    return np.add.reduce(np.abs(slopes))
