"""Polynomials in w with bounds of their rounding errors; quadratic factors, fractions, peaks.

A coefficient comes with a size: its error is at most a few units of roundoff of it. Products and
sums keep that true, because sizes are multiplied and added without signs.

For quadratic factors, roots from eigenvalues are paired (conjugates, and real neighbours, so that a
nearly double root stays in one factor) and the factors then improved by Newton's method on their
coefficients, whose residual is exact to rounding. Its Jacobian is the matrix of the partial
fractions too. Close factors are ill-determined one by one, but all together they still reproduce
the polynomial to a few units of roundoff of its terms, and that is what counts for whatever is put
together from them.

The peak of P(x)/Q(x), x = v², over all frequencies is found by level sets and no grid. Where
P - level·Q has no positive root the level is nowhere exceeded. From the largest value known, the
roots at that level enclose whatever exceeds it; the middles of those gaps give a larger value, and
so on; it converges quadratically (Bruinsma and Steinbuch 1990, for norms of transfer functions).
Levels need polynomials of half the degree that the stationary points would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Unit roundoff of float64.
UNIT = 2.0**-53


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polynomial:
    """Ascending coefficients, (degree+1, *shape), and their sizes, of the same shape."""

    value: FloatArray
    size: FloatArray

    @classmethod
    def exact(cls, *coefficients: FloatArray | float) -> Polynomial:
        """Coefficients in which nothing cancelled, constant first."""
        value = np.stack(np.broadcast_arrays(*(np.asarray(c, float) for c in coefficients)))
        return cls(value=value, size=np.abs(value))

    def scaled(self, factor: FloatArray | float) -> Polynomial:
        """Multiplied by a number, or an array of the loops' shape, known to its last digits."""
        single = np.asarray(factor, float)[None]
        return Polynomial(
            value=product(self.value, single), size=product(self.size, np.abs(single))
        )

    def times(self, *others: Polynomial) -> Polynomial:
        """The product."""
        value, size = self.value, self.size
        for other in others:
            value, size = product(value, other.value), product(size, other.size)
        return Polynomial(value=value, size=size)

    def plus(self, *others: Polynomial) -> Polynomial:
        """The sum."""
        value, size = self.value, self.size
        for other in others:
            value, size = _total(value, other.value), _total(size, other.size)
        return Polynomial(value=value, size=size)


#: The polynomial 1.
ONE = Polynomial.exact(1.0)
#: z → 1 + w over 1 - w; also the factor that a delay of one sample adds to a denominator.
LATE = Polynomial.exact(1.0, 1.0)
#: What a delay of one sample, and the hold, add to a numerator.
EARLY = Polynomial.exact(1.0, -1.0)
#: z - 1 → 2w over 1 - w.
DIFFERENCE = Polynomial.exact(0.0, 2.0)


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Product of polynomials (degree+1, ...) along the first axis; the other axes broadcast."""
    shape = _common(p, q)
    grown = np.zeros((len(p) + len(q) - 1, *shape))
    p = spread(p, shape)
    for power, coefficient in enumerate(q):
        grown[power : power + len(p)] += p * coefficient
    return grown


def _total(p: FloatArray, q: FloatArray) -> FloatArray:
    """Sum of polynomials (degree+1, ...) along the first axis; the other axes broadcast."""
    shape = _common(p, q)
    grown = np.zeros((max(len(p), len(q)), *shape))
    grown[: len(p)] += spread(p, shape)
    grown[: len(q)] += spread(q, shape)
    return grown


def pad_coefficients(part: FloatArray, length: int) -> FloatArray:
    """With zeros for the powers that are missing, up to ``length`` coefficients."""
    missing = length - len(part)
    return np.concatenate([part, np.zeros((missing, *part.shape[1:]))]) if missing else part


def part_of(whole: FloatArray, part: slice, behind: int, leading: int = 0) -> FloatArray:
    """A part of an array along the axis that is so many from its end, if it is as long there.

    Leading axes are not of the loops: powers.
    """
    if whole.ndim - leading < behind or whole.shape[-behind] == 1:
        return whole
    return whole[(..., part, *(slice(None),) * (behind - 1))]


def _common(p: FloatArray, q: FloatArray) -> tuple[int, ...]:
    """The shape behind the axis of powers that both broadcast to."""
    own, other = p.shape[1:], q.shape[1:]
    return own if own == other else np.broadcast_shapes(own, other)


def spread(coefficients: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Coefficients (degree+1, *own) with room to broadcast against ``shape``."""
    missing = len(shape) - (coefficients.ndim - 1)
    if missing <= 0:
        return coefficients
    return coefficients.reshape(len(coefficients), *(1,) * missing, *coefficients.shape[1:])


def value_at(polynomial: FloatArray, v: FloatArray) -> ComplexArray:
    """A polynomial in w, ascending, at w = jv; of the shape of v."""
    total = np.full(np.shape(v), polynomial[-1], dtype=np.complex128)
    for coefficient in polynomial[-2::-1]:
        total = total * (1j * v) + coefficient
    return total


def slope(polynomial: FloatArray) -> FloatArray:
    """The derivative of a polynomial, ascending."""
    return polynomial[1:] * np.arange(1, len(polynomial))


def companion_roots(lower: FloatArray) -> ComplexArray:
    """Roots of stacked monic polynomials, (degree, columns), in the digits of eigenvalues.

    ``lower`` are ascending coefficients, (degree, columns), without the leading one.
    """
    degree, columns = lower.shape
    companion = np.zeros((columns, degree, degree))
    companion[:, 0, :] = -lower[::-1].T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.linalg.eigvals(companion).T.astype(np.complex128)


#: Newton steps; each doubles the digits, and eigenvalues of graded polynomials may bring but four.
_STEPS = 5
#: Sweeps of equilibration; each halves the logarithms of what the rows differ by.
_SWEEPS = 8


class Quadratic(NamedTuple):
    """s² + a·s + b, arrays of one shape."""

    a: FloatArray
    b: FloatArray
    # 1 and by how many units of roundoff of its terms the product of all factors misses the
    # polynomial; sizes of whatever is made of the factors grow by it
    blur: FloatArray


def split_into_quadratics(polynomial: Polynomial) -> tuple[Quadratic, ...]:
    """Quadratic factors of a monic polynomial of even degree."""
    shape = polynomial.value.shape[1:]
    value = polynomial.value.reshape(len(polynomial.value), -1)
    size = polynomial.size.reshape(value.shape)
    pairs = len(value) // 2
    b, a = np.empty((2, pairs, value.shape[1]))
    # A constant, or a constant and a slope, that are exactly zero are roots at zero, which the
    # first factor takes.
    zeros = np.where(value[0] != 0, 0, np.where(value[1] != 0, 1, 2))
    with np.errstate(all="ignore"):
        for count in set(zeros.tolist()):
            chosen = np.flatnonzero(zeros == count)
            b[:, chosen], a[:, chosen] = _factors(value[:, chosen], count)
        blur = _residual(value - _multiplied(b, a), size + _multiplied(np.abs(b), np.abs(a)))
    return tuple(
        Quadratic(b=b[k].reshape(shape), a=a[k].reshape(shape), blur=blur.reshape(shape))
        for k in range(pairs)
    )


def split_fractions(
    numerator: Polynomial, quadratics: Sequence[Quadratic]
) -> tuple[Polynomial, ...]:
    """r0 + r1·s over each factor, adding up to numerator over the product of all."""
    shape = numerator.value.shape[1:]
    count = len(quadratics)
    # The numerator is of lower degree than the product; no two factors have a common root.
    wanted = pad_coefficients(numerator.value, 2 * count).reshape(2 * count, -1)
    matrix = _jacobian(
        np.stack([q.b.reshape(-1) for q in quadratics]),
        np.stack([q.a.reshape(-1) for q in quadratics]),
    )
    with np.errstate(all="ignore"):
        inverse = _inverse(matrix)
        r = _applied(inverse, wanted)
        r += _applied(inverse, wanted - _applied(matrix, r))
        rest = wanted - _applied(matrix, r)
        sizes = _applied(np.abs(matrix), np.abs(r))
        # A share that is small beside the others has their rounding, as far as it can have it.
        moved = _applied(np.abs(inverse), sizes)
        every = np.tile(np.abs(r).reshape(count, 2, -1).sum(axis=0), (count, 1))
        size = (np.abs(r) + np.minimum(moved, every)) * _residual(rest, sizes)
    return tuple(
        Polynomial(
            value=r[2 * k : 2 * k + 2].reshape(2, *shape),
            size=size[2 * k : 2 * k + 2].reshape(2, *shape),
        )
        for k in range(count)
    )


def _applied(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """Products of matrices, (columns, i, j), with columns, (j, columns)."""
    # Added one after another: the order of a sum depends on how many others there are.
    return np.add.accumulate(matrix * columns.T[:, None, :], axis=2)[:, :, -1].T


def _residual(rest: FloatArray, sizes: FloatArray) -> FloatArray:
    """1 and the largest residual of each column in units of roundoff; nan where unsolved."""
    return 1 + np.max(np.where(sizes == 0, 0.0, np.abs(rest) / (UNIT * sizes)), axis=0)


def _factors(value: FloatArray, zeros: int) -> tuple[FloatArray, FloatArray]:
    """(b, a), each (factors, columns); roots at zero are in the first."""
    degree, columns = len(value) - 1, value.shape[1]
    b, a = np.zeros((2, degree // 2, columns))
    # The smallest real root joins a single one at zero.
    first = 1 if zeros == 2 else 0
    b[first:], a[first:] = _paired(_roots(value[zeros:]), single=zeros == 1)
    values = np.stack([b, a], axis=1).reshape(degree, columns)
    free = range(zeros, degree)
    for _ in range(_STEPS):
        b, a = values[0::2], values[1::2]
        inverse = _inverse(_jacobian(b, a)[:, zeros:, zeros:])
        values[free] += _applied(inverse, (value - _multiplied(b, a))[free])
    return values[0::2], values[1::2]


def _roots(value: FloatArray) -> ComplexArray:
    """Roots of each column, (degree, columns), in units in which they are about 1."""
    degree, columns = len(value) - 1, value.shape[1]
    if degree == 0:
        return np.zeros((0, columns), dtype=np.complex128)
    unit = np.abs(value[0]) ** (1 / degree)
    scaled = value / unit ** (degree - np.arange(degree + 1))[:, None]
    return companion_roots(scaled[:-1]) * unit


def _paired(roots: ComplexArray, *, single: bool) -> tuple[FloatArray, FloatArray]:
    """(b, a) of each pair; ``single``: the first is a root at zero and the smallest real one."""
    count, columns = roots.shape
    pairs = (count + 1) // 2
    b, a = np.zeros((2, pairs, columns))
    reals = np.sum(roots.imag == 0, axis=0)
    for number in set(reals.tolist()):
        chosen = np.flatnonzero(reals == number)
        part = roots[:, chosen]
        order = np.argsort(np.where(part.imag == 0, 0.0, np.sign(part.imag)), axis=0, kind="stable")
        part = np.take_along_axis(part, order, axis=0)
        half = (count - number) // 2
        complex_ = part[count - half :]
        real = part[half : half + number].real
        real = np.take_along_axis(real, np.argsort(-real, axis=0), axis=0)
        lone = number % 2
        if single and lone:
            a[0, chosen] = -real[0]
        rest = _neighbours(real[lone:])
        at = slice(lone, lone + number // 2)
        b[at, chosen], a[at, chosen] = rest[0::2] * rest[1::2], -(rest[0::2] + rest[1::2])
        at = slice(lone + number // 2, pairs)
        b[at, chosen] = np.abs(complex_) ** 2
        a[at, chosen] = -2 * complex_.real
    return b, a


def _neighbours(real: FloatArray) -> FloatArray:
    """Sorted real roots, two by two, so that the closest across two pairs are far apart."""
    if len(real) < 4:
        return real
    shifted = np.roll(real, -1, axis=0)

    def apart(pairs: FloatArray) -> FloatArray:
        gaps = np.abs((pairs[2::2] - pairs[1:-1:2]) / (np.abs(pairs[2::2]) + np.abs(pairs[1:-1:2])))
        return np.min(gaps, axis=0)

    return np.where(apart(real) >= apart(shifted), real, shifted)


def _jacobian(b: FloatArray, a: FloatArray) -> FloatArray:
    """(columns, 2m, 2m): derivatives of the product by b0, a0, b1, a1, ...; powers in the rows."""
    count, columns = b.shape
    matrix = np.zeros((columns, 2 * count, 2 * count))
    for k in range(count):
        rest = _multiplied(b, a, without=k).T
        matrix[:, : 2 * count - 1, 2 * k] = rest
        matrix[:, 1:, 2 * k + 1] = rest
    return matrix


def _multiplied(b: FloatArray, a: FloatArray, without: int | None = None) -> FloatArray:
    total = np.ones((1, b.shape[1]))
    for k in range(len(b)):
        if k != without:
            total = product(total, np.stack([b[k], a[k], np.ones_like(b[k])]))
    return total


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverses of a stack of badly scaled matrices; infinite where there is none."""
    rows = np.ones(matrix.shape[:2])
    columns = np.ones((matrix.shape[0], matrix.shape[2]))
    scaled = matrix
    for _ in range(_SWEEPS):
        large = np.max(np.abs(scaled), axis=2)
        wide = np.max(np.abs(scaled), axis=1)
        rows /= np.sqrt(np.where(large > 0, large, 1.0))
        columns /= np.sqrt(np.where(wide > 0, wide, 1.0))
        scaled = matrix * rows[:, :, None] * columns[:, None, :]
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        # One of the stack is singular: two factors share a root.
        inverse = np.full_like(scaled, np.inf)
        for index, each in enumerate(scaled):
            if np.linalg.matrix_rank(each) == len(each):
                inverse[index] = np.linalg.inv(each)
    return inverse * columns[:, :, None] * rows[:, None, :]


#: Levels are raised by this, relative: two roots that touch the axis must be seen as a pair.
_RAISED = 1e-13
#: A gain in value below this, relative, ends the search; the peak is flat to its square root.
_ENOUGH = 1e-12
#: Levels tried; from a start near a peak four are usual.
_MOST_LEVELS = 40
#: Roots this far from the real axis, relative, are still tried: near its top a peak's two roots
#: leave the axis by the square root of the rounding error. A false one costs one evaluation.
_NEARLY_REAL = 1e-3


def squared_modulus(polynomial: FloatArray) -> FloatArray:
    """|p(jv)|² as coefficients of x = v², for ascending coefficients of p; shape (degree+1,)."""
    even, odd = parts_on_axis(polynomial)
    total = np.zeros(len(polynomial))
    squared = np.convolve(even, even)
    total[: len(squared)] = squared
    if len(odd):
        squared = np.convolve(odd, odd)
        total[1 : 1 + len(squared)] += squared
    return total


def parts_on_axis(polynomial: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(E, O) in powers of x with p(jv) = E(x) + jv·O(x), for coefficients (degree+1, ...)."""
    even, odd = polynomial[0::2], polynomial[1::2]
    signs = (-1.0) ** np.arange(len(even))[(...,) + (None,) * (polynomial.ndim - 1)]
    return even * signs, odd * signs[: len(odd)]


def positive_roots(polynomial: FloatArray) -> FloatArray:
    """Positive and nearly real roots of a polynomial in x, ascending."""
    roots = np.roots(polynomial[::-1])
    real = (roots.real > 0) & (np.abs(roots.imag) <= _NEARLY_REAL * roots.real)
    return np.sort(roots.real[real]).astype(np.float64)


def peak(
    value: Callable[[FloatArray], FloatArray],
    top: FloatArray,
    bottom: FloatArray,
    starts: FloatArray,
) -> tuple[float, float]:
    """(largest value, its v) of P/Q over v in [0, ∞].

    Both have shape (degree + 1,), ascending in x; Q is positive for x > 0, its last coefficient not
    zero. ``value`` is P/Q at finite v and may know better digits than the expanded P and Q;
    ``starts`` are places v where a peak may be expected, such as the imaginary parts of poles.
    """
    places = np.concatenate([[0.0], starts[np.isfinite(starts)]])
    best, place = _largest(value, places)
    end = float(top[-1] / bottom[-1])
    if not best >= end:
        best, place = end, float("inf")
    for _ in range(_MOST_LEVELS):
        edges = positive_roots(top - (best + _RAISED * abs(best)) * bottom)
        if not edges.size:
            break
        middles = np.sqrt(edges[1:]) * np.sqrt(edges[:-1])
        found, where = _largest(value, np.sqrt(np.concatenate([edges, middles])))
        if not found > best:
            break
        gained, best, place = found - best, found, where
        if gained <= _ENOUGH * abs(best):
            break
    return best, place


def _largest(value: Callable[[FloatArray], FloatArray], v: FloatArray) -> tuple[float, float]:
    with np.errstate(divide="ignore", invalid="ignore"):
        values = value(v)
    index = int(np.argmax(np.where(np.isnan(values), -np.inf, values)))
    return float(values[index]), float(v[index])


def convolve(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    """Coefficients of the product of two polynomials, in any arithmetic."""
    total: list[Any] = [0.0] * (len(p) + len(q) - 1)
    for i, left in enumerate(p):
        for j, right in enumerate(q):
            total[i + j] = total[i + j] + left * right
    return total


def h2_squared(numerator: Sequence[Any], denominator: Sequence[Any]) -> Any:
    """(1/2π)∫|N(jω)/D(jω)|² dω of a stable, strictly proper quotient, in any arithmetic."""
    # The α-β recursion of K. J. Åström (Introduction to Stochastic Control Theory, 1970, chapter
    # 5): the energy is the sum of β_k²/(2α_k) over two tables, whose rows are reduced as in
    # Routh's.
    a = list(denominator[::-1])
    b = [0.0] * (len(a) - 1 - len(numerator)) + list(numerator[::-1])
    total: Any = 0.0
    while len(a) > 1:
        alpha = a[0] / a[1]
        beta = b[0] / a[1]
        total = total + beta * beta / (2 * alpha)
        reduced, left = a[1:], b[1:]
        for index in range(1, len(reduced) - 1, 2):
            reduced[index] = reduced[index] - alpha * a[index + 2]
        for index in range(1, len(left), 2):
            left[index] = left[index] - beta * a[index + 2]
        a, b = reduced, left
    return total
