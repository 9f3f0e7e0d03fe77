"""Frequency responses of loops on the upper half of the unit circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.companion import companion_roots
from tune.loop.loop import Loop

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Points in equal ratios from the slowest angle, and as many evenly up to π.
_POINTS = 160
#: The slowest angle looked at, over that of the plant's slowest pole; and between which bounds.
_SLOWEST = 0.03
_LEAST, _MOST = 1e-7, 1e-2
#: A pole whose damping ratio is less than this has points of its own around its frequency, at these
#: multiples of its damping ratio.
_RESONANT = 0.5
_AROUND = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Responses at z = e^jθ, all loops free or all held.

    Attributes:
        loop: of shape (loops,).
        angle: θ in (0, π], rad, shape (points,), or (loops, points) where each has its own.
        position: measured position over force in T²/m, (loops, points).
        velocity: estimate over position, in 1/T, (loops, points).
        acceleration: estimate over position, in 1/T², (loops, points).
        steady: effects that fade and act on every loop at some constant level.
        levels: of all of them, at which each loop is looked at.
    """

    loop: Loop
    angle: FloatArray
    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray
    steady: tuple[Effects, ...]
    levels: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, loop: Loop, steady: Sequence[Effects] = ()) -> Responses:
        """On a grid that is fine where the loops are.

        Args:
            loop: of shape (loops,).
            steady: effects that are part of the device here, without springs, each at a level of
                its own: none, half or all of it. One loop becomes as many as there are levels.
        """
        return cls._at(
            loop, _grid(loop), tuple(steady), tuple(product((0.0, 0.5, 1.0), repeat=len(steady)))
        )

    @classmethod
    def _at(
        cls,
        loop: Loop,
        angle: FloatArray,
        steady: tuple[Effects, ...],
        levels: tuple[tuple[float, ...], ...],
    ) -> Responses:
        parts = loop.transfer
        position = _ratio(parts.plant_numerator, parts.plant_denominator, angle)
        velocity = _ratio(parts.beta, parts.law_denominator, angle)
        acceleration = _ratio(parts.gamma, parts.law_denominator, angle)
        if steady:
            laws = np.zeros((len(steady), *position.shape), dtype=np.complex128)
            estimates = (np.ones_like(position), velocity, acceleration)
            for place, effects in enumerate(steady):
                for value, part in zip(loop.dimensionless_effects(effects), estimates, strict=True):
                    if value is not None:
                        laws[place] += np.broadcast_to(value, loop.scales[0].shape)[:, None] * part
            position = np.concatenate(
                [position / (1 + np.tensordot(each, laws, axes=1) * position) for each in levels]
            )
            velocity, acceleration = (
                np.concatenate([part] * len(levels)) for part in (velocity, acceleration)
            )
        return cls(
            loop=loop,
            angle=angle,
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            steady=steady,
            levels=levels,
        )

    def at_each(self, angle: FloatArray) -> Responses:
        """Every loop at angles of its own, (loops, points)."""
        count = len(self.levels)
        parts = [
            self._at(self.loop, part, self.steady, (level,))
            for part, level in zip(np.split(angle, count), self.levels, strict=True)
        ]
        return Responses(
            loop=self.loop,
            angle=angle,
            position=np.concatenate([part.position for part in parts]),
            velocity=np.concatenate([part.velocity for part in parts]),
            acceleration=np.concatenate([part.acceleration for part in parts]),
            steady=self.steady,
            levels=self.levels,
        )

    @property
    def scales(self) -> FloatArray:
        """(T²/m, T/m, 1/m) of each loop, shape (3, loops)."""
        return np.tile(np.stack(self.loop.scales), (1, len(self.levels)))

    @property
    def grounded(self) -> bool:
        """A spring of device or hand binds the position."""
        return self.loop.grounded


def _grid(loop: Loop) -> FloatArray:
    """Angles in (0, π]: in equal ratios, evenly, and around every resonance of the plant."""
    denominator = loop.transfer.plant_denominator
    drop = 0 if loop.grounded else 1
    lower = denominator[drop:-1] / denominator[-1]
    roots = companion_roots(lower)
    size = np.abs(roots)
    slow = float(np.min(size, initial=_MOST))
    least = min(_MOST, max(_LEAST, _SLOWEST * slow))
    angles = [np.geomspace(least, np.pi, _POINTS), np.linspace(np.pi / _POINTS, np.pi, _POINTS)]
    with np.errstate(all="ignore"):
        ratio = np.abs(roots.real) / size
    resonant = (ratio < _RESONANT) & (roots.imag > 0)
    at, ratio = 2 * np.arctan(roots.imag[resonant]), ratio[resonant]
    angles.append((at * (1 + ratio * _AROUND[:, None])).reshape(-1))
    found = np.unique(np.concatenate(angles))
    return found[(found >= least) & (found <= np.pi)]


def _ratio(top: FloatArray, bottom: FloatArray, angle: FloatArray) -> ComplexArray:
    """A quotient of polynomials in w at w = j·tan(θ/2), each (degree+1, loops); also at θ = π."""
    sine, cosine = np.sin(angle / 2), np.cos(angle / 2)
    value = _value(top, sine, cosine) / _value(bottom, sine, cosine)
    return value * cosine ** float(len(bottom) - len(top))


def _value(polynomial: FloatArray, sine: FloatArray, cosine: FloatArray) -> ComplexArray:
    """cos^degree(θ/2) times the polynomial: even and odd powers apart."""
    shape = np.broadcast_shapes((*polynomial.shape[1:], 1), sine.shape)
    even, odd = np.zeros(shape), np.zeros(shape)
    degree = len(polynomial) - 1
    for power, row in enumerate(polynomial):
        term = row[:, None] * (sine**power * cosine ** (degree - power))
        sign = 1.0 if power % 4 < 2 else -1.0
        if power % 2:
            odd = odd + sign * term
        else:
            even = even + sign * term
    return even + 1j * odd
