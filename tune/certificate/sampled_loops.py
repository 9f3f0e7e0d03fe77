"""Sampled loops in double precision, many at once: to search with, never to decide.

One file: from parameters to polynomials, in doubles all the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import ComplexArray, FloatArray
from tune.certificate.point import Setting
from tune.certificate.polynomial import law_of
from tune.certificate.precision import precision
from tune.certificate.region import Region

#: Taylor terms of the exponential of a matrix below one half in norm: 2^-18/18! < 1e-20.
_TAYLOR = 18


@dataclass(frozen=True, slots=True)
class Loops:
    """Descending coefficients in z of D and N of D + s·N, each (points, degree + 1).

    Where nothing holds the position, the pole z = 1 of free motion has been divided out.
    """

    open: FloatArray
    feedback: FloatArray

    def chosen(self, which: NDArray[np.bool_]) -> Loops:
        """The loops of some of the points, told by a mask of shape (points,)."""
        return Loops(self.open[which], self.feedback[which])

    def radius(self, gain: float | FloatArray) -> FloatArray:
        """Largest pole modulus at a gain, by companion matrices; inf where doubles overflow.

        One gain, no unit, or one a point, shape (points,); the answer has shape (points,).
        """
        with np.errstate(over="ignore", invalid="ignore"):
            full = self.open + np.reshape(gain, (-1, 1)) * self.feedback
            # Poles at zero that all loops have in common are left out.
            full = full[:, : np.flatnonzero(full.any(axis=0))[-1] + 1]
            monic = full[:, 1:] / full[:, :1]
        size = monic.shape[1]
        companion = np.zeros((len(full), size, size))
        companion[:, 0, :] = -monic
        companion[:, np.arange(1, size), np.arange(size - 1)] = 1.0
        radius = np.full(len(full), np.inf)
        finite = np.isfinite(monic).all(axis=1)
        radius[finite] = np.abs(np.linalg.eigvals(companion[finite])).max(axis=1)
        return radius

    def distance(self, gain: float | FloatArray, z: ComplexArray) -> FloatArray:
        """Least |1 + s·L| over the given points of the circle and every gain in [0, gain].

        One gain, no unit, or one a point, shape (points,); the circle's points have shape (n,); the
        answer has shape (points,).
        """
        # Powers of z that all loops have in common are left out.
        used = (
            int(np.flatnonzero((self.open != 0).any(axis=0) | (self.feedback != 0).any(axis=0))[-1])
            + 1
        )
        powers = np.vander(z, used).T
        (d, e), (n, m) = (
            (part[:, :used] @ powers.real, part[:, :used] @ powers.imag)
            for part in (self.open, self.feedback)
        )
        with np.errstate(all="ignore"):
            # L = (n + jm)/(d + je).
            nearest = np.clip(-(n * d + m * e) / (n * n + m * m), 0, np.reshape(gain, (-1, 1)))
            size = ((d + nearest * n) ** 2 + (e + nearest * m) ** 2) / (d * d + e * e)
        # A loop too weak or too strong for doubles comes near -1 nowhere that they can tell.
        return np.sqrt(np.min(np.where(np.isnan(size), np.inf, size), axis=1))


# What doubles cannot hold is looked at in many digits.
@np.errstate(over="ignore", invalid="ignore")
def sampled_loops(
    region: Region,
    settings: Sequence[Setting],
    values: FloatArray,
    extra: FloatArray,
    which: NDArray[np.intp] | None = None,
) -> Loops:
    """Loops at points of a region.

    Values have shape (sides, points), SI units; the extra delay has shape (points,).

    Args:
        region: which sides there are.
        settings: what may be played; all play the same effects with the same filters.
        values: one column a point, rows as in `Region.sides`.
        extra: samples of delay on top, one a point.
        which: the setting of each point, shape (points,); None for the first at all of them.
    """
    motion, drive, read = state_space(region, values)
    step, delay = values[2], values[3]
    late = delay / step + extra
    whole = np.floor(late + 1e-9)
    fraction = np.clip(late - whole, 0.0, 1.0)
    size = motion.shape[-1]
    augmented = np.zeros((len(step), size + 1, size + 1))
    augmented[:, :size, :size] = motion
    augmented[:, :size, size] = drive
    times = np.stack([(1 - fraction) * step, fraction * step])
    after, before = _exponential(augmented * times[:, :, None, None])
    transition = after[:, :size, :size] @ before[:, :size, :size]
    new = after[:, :size, size]
    old = (after[:, :size, :size] @ before[:, :size, size:])[..., 0]
    denominator, by_new, by_old = _resolvent(transition, read, new, old)
    numerator = np.pad(by_new, ((0, 0), (0, 1))) + np.pad(by_old, ((0, 0), (1, 0)))
    which = np.zeros(len(step), dtype=np.intp) if which is None else which
    top, bottom = _laws(settings, which, step)
    if not settings[0].stiffness:
        if region.grounded:
            top = _convolved(top, np.array([[1.0, -1.0]]))
        else:
            # Free motion: divided by z - 1, the remainder being nothing but rounding.
            denominator = np.cumsum(denominator, axis=1)[:, :-1]
    most = int(whole.max())
    length = denominator.shape[1] + bottom.shape[1] + most
    open_ = _padded(_convolved(denominator, bottom), length)
    feedback = np.zeros_like(open_)
    product = _convolved(numerator, top)
    for count in np.flatnonzero(np.bincount(whole.astype(np.intp))):
        rows = whole == count
        # D has its highest power first and most + 1 zeros behind; N ends at its own delay.
        end = length - (most - int(count))
        feedback[rows, end - product.shape[1] : end] = product[rows]
    return Loops(open_, feedback)


def state_space(region: Region, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(A, B, C) of positions, speeds and, with a lag, the force, from command to encoder.

    Arguments as of `sampled_loops`; shapes (points, states, states), (points, states), (states,).
    """
    mass, damping, _, _, lag, slope, *rest = values
    points = len(mass)
    hand = np.zeros((3, points))
    if region.hand is not None:
        hand = np.array(rest[:3])
        rest = rest[3:]
    encoder = np.array([1.0, *(mode.at_encoder for mode in region.modes)])
    handle = np.array([1.0, *(mode.at_handle for mode in region.modes)])
    count = len(encoder)
    grip = np.outer(handle, handle)
    diagonal = np.arange(count)
    inertia, loss, spring = (grip * part[:, None, None] for part in hand)
    inertia[:, diagonal, diagonal] += mass[:, None]
    loss[:, 0, 0] += damping
    spring[:, 0, 0] += slope
    for i in range(count - 1):
        omega = 2 * np.pi * rest[2 * i]
        loss[:, i + 1, i + 1] += 2 * rest[2 * i + 1] * omega * mass
        spring[:, i + 1, i + 1] += omega**2 * mass
    inverse = np.linalg.inv(inertia)
    lagged = region.current_lag[1] > 0
    size = 2 * count + lagged
    motion, drive = np.zeros((points, size, size)), np.zeros((points, size))
    motion[:, diagonal, count + diagonal] = 1.0
    motion[:, count : 2 * count, :count] = -inverse @ spring
    motion[:, count : 2 * count, count : 2 * count] = -inverse @ loss
    force = inverse @ encoder
    if lagged:
        motion[:, count : 2 * count, -1] = force
        motion[:, -1, -1] = -1 / lag
        drive[:, -1] = 1 / lag
    else:
        drive[:, count:] = force
    return motion, drive, np.pad(encoder, (0, size - count))


def held_motion(
    motion: FloatArray, drive: FloatArray, time: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(Φ, Γ) of x after a time of constant force F, Φ·x + Γ·F, for a stack of (A, B).

    One time, or one a member of the stack.
    """
    size = motion.shape[-1]
    augmented = np.zeros((len(motion), size + 1, size + 1))
    augmented[:, :size, :size] = motion
    augmented[:, :size, size] = drive
    whole = _exponential(augmented * np.asarray(time)[..., None, None])
    return whole[:, :size, :size], whole[:, :size, size]


def _exponential(matrix: FloatArray) -> FloatArray:
    """e^A of each of a stack, by scaling and squaring."""
    norm = np.abs(matrix).sum(axis=-1).max(initial=0.5)
    halvings = max(0, int(np.ceil(np.log2(2 * norm))))
    scaled = matrix / 2.0**halvings
    term = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape).copy()
    total = term.copy()
    for order in range(1, _TAYLOR):
        term = term @ scaled / order
        total += term
    for _ in range(halvings):
        total = total @ total
    return total


def _resolvent(
    transition: FloatArray, read: FloatArray, *drives: FloatArray
) -> tuple[FloatArray, ...]:
    """det(zI - Φ), and C·adj(zI - Φ)·Γ for each Γ; descending in z, by Faddeev and LeVerrier."""
    points, size = transition.shape[0], transition.shape[-1]
    adjugate = np.broadcast_to(np.eye(size), transition.shape)
    determinant = [np.ones(points)]
    numerators: list[list[FloatArray]] = [[] for _ in drives]
    for order in range(1, size + 1):
        for numerator, drive in zip(numerators, drives, strict=True):
            numerator.append((adjugate @ drive[..., None])[..., 0] @ read)
        product = transition @ adjugate
        coefficient = -np.trace(product, axis1=-2, axis2=-1) / order
        determinant.append(coefficient)
        adjugate = product + coefficient[:, None, None] * np.eye(size)
    return (
        np.stack(determinant, axis=1),
        *(np.stack(numerator, axis=1) for numerator in numerators),
    )


def _laws(
    settings: Sequence[Setting], which: NDArray[np.intp], step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of the law of each point; a zero at z = 1 left out."""
    steps, at = np.unique(step, return_inverse=True)
    kinds, kind = np.unique(which * len(steps) + at, return_inverse=True)
    numbers: list[int] = kinds.tolist()
    pairs = [divmod(number, len(steps)) for number in numbers]
    laws = [_law_at(settings[setting], float(steps[place])) for setting, place in pairs]
    return np.array([top for top, _ in laws])[kind], np.array([low for _, low in laws])[kind]


@lru_cache(maxsize=1024)
def _law_at(setting: Setting, step: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Numerator and denominator of the law at one sample time, of equal length."""
    with precision():
        law = law_of(setting, step)
        top = [float(c) for c in law.numerator.coeffs()][::-1]
        bottom = [float(c) for c in law.denominator.coeffs()][::-1]
    return (*[0.0] * (len(bottom) - len(top)), *top), tuple(bottom)


def _convolved(a: FloatArray, b: FloatArray) -> FloatArray:
    product = np.zeros((len(a), a.shape[1] + b.shape[1] - 1))
    for power in range(b.shape[1]):
        product[:, power : power + a.shape[1]] += a * b[:, power : power + 1]
    return product


def _padded(a: FloatArray, length: int) -> FloatArray:
    return np.pad(a, ((0, 0), (0, length - a.shape[1])))


def upper_half_circle(count: int, slowest: float) -> NDArray[np.complex128]:
    """Points of the upper half circle, in equal ratios of frequency and to the very end.

    The answer has shape (count,), no unit; the slowest angle is given as a part of π.
    """
    return np.exp(1j * np.pi * np.geomspace(slowest, 1.0, count))
