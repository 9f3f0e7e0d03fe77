"""Sampled loops of a device without modes by their frequency response, in doubles.

No characteristic polynomial is formed: a loop is stable for every gain below the first one at which
s·L(z) passes through -1 on the unit circle (Nyquist). What is measured of the plant comes from
matrix exponentials. Fast enough for a search; its crossings are compared with those of the
characteristic polynomial (`tests.reference`).
"""

# pyright: standard

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.intp]

#: Angles ωT at which crossings are looked for; between two of them a phase may dip, not more.
ANGLES: FloatArray = np.concatenate(
    [np.geomspace(1e-7, 0.05, 115)[:-1], np.linspace(0.05, np.pi, 231)]
)
#: Steps of the false position; its order is 1.44, the brackets are a few per cent wide.
_STEPS = 16
#: ... and it ends where all angles move by less than this, relative.
_SETTLED = 1e-12
#: A dip begins closer to the real axis than this, rad, on the grid; its bottom is looked for by so
#: many golden sections where a parabola says that it may lie beyond the axis.
_DIP = 0.2
_SECTIONS = 25
_GOLDEN = 0.5 * (3 - np.sqrt(5))
#: Half step of the central difference of a slope, relative to the angle; its error is the square.
_SLOPE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """One device: kg, N·s/m, s, samples of delay, hand as (kg, N·s/m, N/m)."""

    mass: float
    damping: float
    sample_time: float
    samples: float
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossings:
    """Where loops L of (combination, corner) are real and negative on the circle."""

    combination: IntArray  # index, shape (count,)
    corner: IntArray  # index
    gain: FloatArray  # at which the loop is on the boundary there
    slopes: FloatArray  # of log gain by (K, B, M), shape (3, count)


class Loops:
    """Responses of K, B and M through corners of the region, under one law.

    Filters of velocity and acceleration, Hz, None for the plain difference, are of first order and
    the same twice.
    """

    def __init__(
        self, corners: list[Corner], filters_hz: tuple[float | None, float | None]
    ) -> None:
        self.corners = corners
        self.step = np.array([c.sample_time for c in corners])
        held = np.array([[c.hand[k] for c in corners] for k in range(3)])
        mass = np.array([c.mass for c in corners]) + held[0]
        delta = (np.array([c.damping for c in corners]) + held[1]) * self.step / mass
        kappa = held[2] * self.step**2 / mass
        samples = np.array([c.samples for c in corners])
        self.whole = np.floor(samples)
        part = samples - self.whole
        self.scale = self.step**2 / mass
        # At z = 1 a damper is held by the device's own; by nothing if a hand holds the place.
        self.still = np.where(kappa > 0, 0.0, self.step / (delta * mass))
        flow = np.zeros((len(corners), 2, 2))
        flow[:, 0, 1], flow[:, 1, 0], flow[:, 1, 1] = 1.0, -kappa, -delta
        over, late, early = (_integral(flow, time) for time in (np.ones_like(part), 1 - part, part))
        self.moved = flow @ over
        self.now = late[:, :, 1]
        self.before = early[:, :, 1] + (flow @ late @ early[:, :, 1:])[:, :, 0]
        # 1 - a of the filters, by corner; a plain difference has a = 0.
        self.open = [
            np.ones_like(self.step) if hz is None else -np.expm1(-2 * np.pi * hz * self.step)
            for hz in filters_hz
        ]
        index, angle = np.meshgrid(np.arange(len(corners)), ANGLES, indexing="ij")
        self.grid = self.responses(index.ravel(), angle.ravel()).reshape(3, *index.shape)

    def responses(self, corner: IntArray, angle: FloatArray) -> ComplexArray:
        """(3, count): position over force times what K, B and M of one make of a position."""
        ahead = -2 * np.sin(angle / 2) ** 2 + 1j * np.sin(angle)  # z - 1, nothing cancelling
        z = 1 + ahead
        moved = self.moved[corner]
        push = self.now[corner] + self.before[corner] / z[:, None]
        top = (ahead - moved[:, 1, 1]) * push[:, 0] + moved[:, 0, 1] * push[:, 1]
        bottom = (ahead - moved[:, 0, 0]) * (ahead - moved[:, 1, 1])
        bottom = bottom - moved[:, 0, 1] * moved[:, 1, 0]
        plant = self.scale[corner] * top / bottom * np.exp(-1j * angle * self.whole[corner])
        velocity, again = (
            part[corner] * ahead / (self.step[corner] * (ahead + part[corner]))
            for part in self.open
        )
        return np.stack([plant, plant * velocity, plant * again**2])

    def crossings(self, totals: FloatArray, most: float) -> Crossings:
        """All crossings at gains up to about ``most``, of totals (combinations, 3) in (K, B, M)."""
        count = len(self.corners)
        loop = (totals @ self.grid.reshape(3, -1)).reshape(len(totals), count, ANGLES.size)
        real, imaginary = loop.real, loop.imag
        turned = imaginary[..., 1:-1] * imaginary[..., :-2] < 0
        deep = np.minimum(real[..., 1:-1], real[..., :-2]) < -0.5 / most
        combination, corner, place = np.nonzero(turned & deep)
        low, high = ANGLES[place], ANGLES[place + 1]
        dip_combination, dip_corner, dip_low, dip_high = self._dips(totals, loop, most)
        combination = np.concatenate([combination, dip_combination])
        corner = np.concatenate([corner, dip_corner])
        low, high = np.concatenate([low, dip_low]), np.concatenate([high, dip_high])
        angle = self._real_at(totals[combination].T, corner, low, high)
        # On the real axis of z itself: z = -1, and z = 1, where only a damper is left.
        still = np.where(totals[:, :1] == 0, totals[:, 1:2] * self.still, 0.0)
        ends = np.stack([still, real[..., -1]])
        end, end_combination, end_corner = np.nonzero(ends < -1 / most)
        combination = np.concatenate([combination, end_combination])
        corner = np.concatenate([corner, end_corner])
        fixed = np.repeat([False, True], [angle.size, end.size])
        angle = np.concatenate([angle, ANGLES[-end]])
        weights = totals[combination].T
        here = self.responses(corner, angle)
        resting = np.append(np.zeros(fixed.size - end.size, dtype=bool), end == 0)
        here[:, resting] = np.stack([0 * angle, self.still[corner], 0 * angle])[:, resting]
        further, nearer = (
            self.responses(corner, angle * (1 + sign * _SLOPE)) for sign in (1.0, -1.0)
        )
        along = np.sum(weights * (further - nearer), axis=0)
        turn = np.where(fixed, 0.0, along.real / np.where(fixed, 1.0, along.imag))
        value = np.sum(weights * here, axis=0).real
        keep = value < -1 / most
        slopes = -(here.real - turn * here.imag) / np.where(keep, value, 1.0)
        return Crossings(
            combination=combination[keep],
            corner=corner[keep],
            gain=-1 / value[keep],
            slopes=slopes[:, keep],
        )

    def _dips(
        self, totals: FloatArray, loop: ComplexArray, most: float
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """(combination, corner, low, high) of crossings in pairs between two angles of the grid.

        Where the loop comes closer to the real axis than at both neighbours, its nearest place is
        looked for; if it lies beyond the axis there is one crossing on each side.
        """
        inner = loop[..., 1:-2]
        close = np.abs(inner.imag) < -_DIP * inner.real
        combination, corner, place = np.nonzero(close & (inner.real < -0.5 / most))
        off = loop.imag[combination[:, None], corner[:, None], place[:, None] + np.arange(3)]
        sides = np.sign(off[:, 1])
        before, here, after = (sides[:, None] * off).T
        # The parabola through three places at least halves the way, or the dip is a shallow one.
        dips = (before >= here) & (after >= here)
        dips &= (after - before) ** 2 >= 4 * here * (after + before - 2 * here)
        combination, corner, place, sides = (
            part[dips] for part in (combination, corner, place, sides)
        )
        weights = totals[combination].T
        low, high = ANGLES[place], ANGLES[place + 2]
        bottom, height = low, np.full(low.shape, np.inf)
        first, last = low, high
        for _ in range(_SECTIONS if dips.any() else 0):
            middle = np.stack([first + _GOLDEN * (last - first), last - _GOLDEN * (last - first)])
            values = [
                sides * np.sum(weights * self.responses(corner, angle), axis=0).imag
                for angle in middle
            ]
            left = values[0] < values[1]
            best = np.where(left, values[0], values[1])
            bottom = np.where(best < height, np.where(left, middle[0], middle[1]), bottom)
            height = np.minimum(height, best)
            first, last = np.where(left, first, middle[0]), np.where(left, middle[1], last)
        under = height < 0
        return (
            np.tile(combination[under], 2),
            np.tile(corner[under], 2),
            np.concatenate([low[under], bottom[under]]),
            np.concatenate([bottom[under], high[under]]),
        )

    def _real_at(
        self, weights: FloatArray, corner: IntArray, low: FloatArray, high: FloatArray
    ) -> FloatArray:
        """Angles between two of each at which the loops are real, by false position."""

        def off(angle: FloatArray) -> FloatArray:
            return np.sum(weights * self.responses(corner, angle), axis=0).imag

        below, above = off(low), off(high)
        middle = before = low
        for _ in range(_STEPS):
            apart = above - below
            flat = apart == 0
            middle = np.where(flat, high, high - above * (high - low) / np.where(flat, 1.0, apart))
            value = off(middle)
            other = value * above > 0
            # The end that stays is halved, so that both ends move (the Illinois rule).
            low, below = np.where(other, low, high), np.where(other, below / 2, above)
            high, above = middle, value
            if np.all(np.abs(middle - before) <= _SETTLED * middle):
                break
            before = middle
        return middle


def _integral(flow: FloatArray, time: FloatArray) -> FloatArray:
    """∫ exp(flow·s) ds from 0 to a time, shape (count, 2, 2)."""
    both = np.zeros((len(flow), 4, 4))
    both[:, :2, :2], both[:, :2, 2:] = flow, np.eye(2)
    return np.asarray(expm(both * time[:, None, None]))[:, :2, 2:]
