"""Absolute stability: springs that are one-sided or saturate, dampers that switch at any moment.

A spring is any F = φ(y), nondecreasing, zero somewhere, of slope at most K; a damper (a mass) any
θ(t)·B·v with θ(t) in [0, 1]. With a multiplier M(z) of Zames and Falb for the spring and a constant
λ for each of the others, force and velocity die away if at every frequency the Hermitian part of

    diag(M/K, λ/B) + [[M·G, M·G], [λ·D·G, λ·D·G]]

is positive definite, G being position over force and D the estimate of velocity (docs/theory.md,
10). The second matrix has rank one, and so its Hermitian part at most one negative eigenvalue: the
determinant alone decides. With all sizes multiplied by 1/x that is a quadratic in x.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Multiplier
from tune.documents.effects import Effects
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Rounds in which the highest peaks of each loop are closed in on, how many, and points in each.
_ZOOMS, _PEAKS, _ZOOM_POINTS = 5, 6, 9


@dataclass(frozen=True, slots=True, kw_only=True)
class GainSlopes:
    """How far each loop may be turned up, and how that changes with the sizes.

    Attributes:
        gain: largest g such that the condition holds for every gain in (0, g], shape (loops,).
        slopes: ∂ln(gain)/∂ln(size) of stiffness, damping and mass, shape (3, loops); zero for what
            is absent. They sum to -1.
    """

    gain: FloatArray
    slopes: FloatArray


def absolute_gain(responses: Responses, effects: Effects, multiplier: Multiplier) -> FloatArray:
    """Largest g such that the condition holds for all effects times any gain in (0, g].

    Args:
        responses: of the loops.
        effects: stiffness that is one-sided or saturates, damping and mass that are switched; each
            a positive number or absent.
        multiplier: with a constant for each of damping and mass that is there.

    Returns:
        Of shape (loops,); inf where nothing bounds it.
    """
    return gain_slopes(responses, effects, multiplier).gain


def gain_slopes(responses: Responses, effects: Effects, multiplier: Multiplier) -> GainSlopes:
    """`absolute_gain` with its derivatives by the sizes, at each loop's worst frequency.

    Where effects and multiplier are as of `absolute_gain`. The gain is homogeneous of degree -1 in
    the sizes, so that "gain at least g" is a smooth constraint on them but for jumps of the worst
    frequency.
    """
    inverse = _inverse_gain(responses, effects, multiplier)
    angle = np.broadcast_to(responses.angle, inverse.shape)
    low, high = _around_peaks(inverse, angle)
    near = responses
    for _ in range(_ZOOMS):
        parts = np.linspace(low, high, _ZOOM_POINTS, axis=-1)
        angle = parts.reshape(len(parts), -1)
        near = responses.at_each(angle)
        inverse = _inverse_gain(near, effects, multiplier)
        peaks = inverse.reshape(parts.shape)
        worst = np.argmax(peaks, axis=-1)[..., None]
        low = np.take_along_axis(parts, np.maximum(worst - 1, 0), axis=-1)[..., 0]
        high = np.take_along_axis(parts, np.minimum(worst + 1, _ZOOM_POINTS - 1), axis=-1)[..., 0]
    sectors = _Sectors.of(near, effects, multiplier)
    rows = np.arange(len(inverse))
    worst = np.argmax(inverse, axis=1)
    most = inverse[rows, worst]
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = sectors.slopes()[:, rows, worst]
        gain = np.where(most > 0, 1 / most, np.inf)
    found = np.zeros((3, len(rows)))
    found[list(sectors.which)] = np.where(most > 0, slopes, 0.0)
    return GainSlopes(gain=gain, slopes=found)


def _around_peaks(inverse: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(lower, upper) neighbours of the highest peaks of each loop, (loops, peaks)."""
    edge = np.full((len(inverse), 1), -np.inf)
    padded = np.hstack([edge, inverse, edge])
    peak = (inverse >= padded[:, :-2]) & (inverse >= padded[:, 2:])
    order = np.argsort(np.where(peak, inverse, -np.inf), axis=1)[:, -_PEAKS:]
    last = inverse.shape[1] - 1
    return (
        np.take_along_axis(angle, np.maximum(order - 1, 0), axis=1),
        np.take_along_axis(angle, np.minimum(order + 1, last), axis=1),
    )


def _inverse_gain(responses: Responses, effects: Effects, multiplier: Multiplier) -> FloatArray:
    return _Sectors.of(responses, effects, multiplier).inverse_gain()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sectors:
    """The terms of the quadratic x² + x·Σ pᵢ - ¼·Σ qᵢⱼ, each of shape (loops, points).

    Attributes:
        which: places of the effects that are there among stiffness, damping, mass.
        own: pᵢ.
        mixed: qᵢⱼ by the places i < j of ``which``.
    """

    which: tuple[int, ...]
    own: tuple[FloatArray, ...]
    mixed: dict[tuple[int, int], FloatArray]

    @classmethod
    def of(cls, responses: Responses, effects: Effects, multiplier: Multiplier) -> _Sectors:
        size = np.abs(responses.position)
        which: list[int] = []
        weights: list[FloatArray] = []
        products: list[ComplexArray] = []
        for place, (value, constant, estimate) in enumerate(
            (
                (effects.stiffness, None, np.ones_like(responses.position)),
                (effects.damping, multiplier.damping, responses.velocity),
                (effects.mass, multiplier.mass, responses.acceleration),
            )
        ):
            if value is None:
                continue
            which.append(place)
            if place == 0:
                factor = multiplier_at(multiplier, responses.angle)
            else:
                assert constant is not None, "the multiplier has no constant for an effect"
                factor: ComplexArray = np.full(responses.angle.shape, complex(constant))
            products.append(factor * estimate)
            scaled = responses.scales[place] * float(np.asarray(value))
            with np.errstate(divide="ignore"):
                weights.append(scaled[:, None] / factor.real)
        own = [w * (p * responses.position).real for w, p in zip(weights, products, strict=True)]
        mixed = {
            (i, j): weights[i] * weights[j] * (size * np.abs(products[i] - products[j])) ** 2
            for i, j in combinations(range(len(which)), 2)
        }
        return cls(which=tuple(which), own=tuple(own), mixed=mixed)

    def inverse_gain(self) -> FloatArray:
        """The larger root x; inf where a multiplier of nothing leaves it open."""
        total, mixed = self._sums()
        with np.errstate(invalid="ignore", over="ignore"):
            root = (np.sqrt(total * total + mixed) - total) / 2 if self.mixed else -total
        return np.where(np.isnan(root), np.inf, root)

    def slopes(self) -> FloatArray:
        """-∂ln x/∂ln(size), shape (effects, loops, points)."""
        total, _ = self._sums()
        x = self.inverse_gain()
        rows: list[FloatArray] = []
        for i, own in enumerate(self.own):
            cross = sum((q for pair, q in self.mixed.items() if i in pair), np.zeros_like(own))
            rows.append((x * own - cross / 4) / (x * (2 * x + total)))
        return np.stack(rows)

    def _sums(self) -> tuple[FloatArray, FloatArray]:
        total = sum(self.own[1:], self.own[0])
        return total, sum(self.mixed.values(), np.zeros_like(total))


def multiplier_at(multiplier: Multiplier, angle: FloatArray) -> ComplexArray:
    """M(e^jθ), of the shape of the angles; its real part loses nothing at small angles."""
    total = np.full(angle.shape, complex(multiplier.constant))
    for tap in multiplier.taps:
        turn = tap.samples * angle
        total += tap.weight * (2 * np.sin(turn / 2) ** 2 + 1j * np.sin(turn))
    return total
