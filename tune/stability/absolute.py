"""Absolute stability of clamped impedances and of dampers that switch: the gain that is proved.

Each element with a spring is one nondecreasing function φ of one signal, zero at nothing and of
slope at most 1: F = -φ(K·y + B·v + M·a). Dampers that may be switched at any moment are θ(t)·B·v
with θ(t) in [0, 1]. With the multiplier Mᵢ of Zames and Falb of each (a constant for what is
switched), force and velocity die away if at every frequency the Hermitian part of

    Mᵢ·(δᵢⱼ/(g·sᵢ) + oᵢ·G)

is positive definite, sᵢ being K or B, sᵢ·oᵢ the law and G position over force (docs/theory.md, 11).
That is D/g + C with a diagonal D that is positive: one eigenvalue problem tells the largest g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Channel, Multiplier
from tune.documents.effects import Effects
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Rounds in which the highest peaks of each loop are closed in on; how many, and points of each.
_ZOOMS, _PEAKS, _ZOOM_POINTS = 4, 6, 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Nonlinearities:
    """What of a sum of elements is not linear.

    Attributes:
        clamps: names and effects of the elements with a spring.
        damping: of all that is damping only and switched at any moment, N·s/m (N·m·s/rad); 0 for
            none.
    """

    clamps: tuple[tuple[str, Effects], ...]
    damping: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, as a certificate gives them."""
        return (*(name for name, _ in self.clamps), *["damping"] * bool(self.damping))

    @property
    def sizes(self) -> tuple[float, ...]:
        """sᵢ of the channels: K of a clamp, B of what is switched."""
        springs = (float(np.asarray(effects.stiffness)) for _, effects in self.clamps)
        return (*springs, *[self.damping] * bool(self.damping))

    def loops(self, responses: Responses) -> ComplexArray:
        """sᵢ·oᵢ·G of each channel, shape (channels, loops, points)."""
        laws = [effects for _, effects in self.clamps]
        laws += [Effects(damping=self.damping)] if self.damping else []
        sizes = np.array([[v or 0.0 for v in effects.arrays()] for effects in laws], dtype=float)
        parts = (np.ones_like(responses.position), responses.velocity, responses.acceleration)
        estimates = responses.scales[:, :, None] * np.stack(parts)
        return responses.position * np.tensordot(sizes, estimates, axes=1)


def absolute_gain(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier
) -> FloatArray:
    """Largest g such that the condition holds for all of a sum times any gain in (0, g].

    The multiplier has a channel for each part, in their order. Shape (loops,); inf where nothing
    bounds it.
    """
    inverse = _inverse_gain(responses, parts, multiplier)
    angle = np.broadcast_to(responses.angle, inverse.shape)
    low, high = _around_peaks(inverse, angle)
    most = inverse.max(axis=1)
    for _ in range(_ZOOMS):
        places = np.linspace(low, high, _ZOOM_POINTS, axis=-1)
        near = responses.at_each(places.reshape(len(places), -1))
        peaks = _inverse_gain(near, parts, multiplier).reshape(places.shape)
        most = np.maximum(most, peaks.max(axis=(1, 2)))
        worst = np.argmax(peaks, axis=-1)[..., None]
        low = np.take_along_axis(places, np.maximum(worst - 1, 0), axis=-1)[..., 0]
        high = np.take_along_axis(places, np.minimum(worst + 1, _ZOOM_POINTS - 1), axis=-1)[..., 0]
    with np.errstate(divide="ignore"):
        return np.where(most > 0, 1 / most, np.inf)


def is_peak(values: FloatArray) -> NDArray[np.bool_]:
    """Where rows of values, (loops, points), are no less than on either side."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-np.inf)
    return (values >= padded[:, :-2]) & (values >= padded[:, 2:])


def _around_peaks(inverse: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(lower, upper) neighbours of the highest peaks of each loop, (loops, peaks)."""
    order = np.argsort(np.where(is_peak(inverse), inverse, -np.inf), axis=1)[:, -_PEAKS:]
    low, high = np.maximum(order - 1, 0), np.minimum(order + 1, inverse.shape[1] - 1)
    return np.take_along_axis(angle, low, axis=1), np.take_along_axis(angle, high, axis=1)


def _inverse_gain(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier
) -> FloatArray:
    """1/g of each loop at each point: the largest eigenvalue of -D^(-½)·C·D^(-½)."""
    loops = parts.loops(responses)
    angle = np.broadcast_to(responses.angle, loops.shape[1:])
    values = np.stack(
        [
            multiplier_at(channel, angle) / (size * _slope(channel, responses.grounded))
            for channel, size in zip(multiplier.channels, parts.sizes, strict=True)
        ]
    )
    with np.errstate(all="ignore"):
        products = values * loops
        if len(products) == 1:
            found = -products[0].real / values[0].real
        else:
            roots = np.sqrt(values.real)
            sums = products[:, None] + np.conj(products)
            matrix = np.moveaxis(-sums / (2 * roots[:, None] * roots), (0, 1), (-2, -1))
            good = np.all(np.isfinite(matrix), axis=(-2, -1))
            found = np.linalg.eigvalsh(np.where(good[..., None, None], matrix, 0))[..., -1]
            found = np.where(good, found, np.inf)
    return np.where(np.isnan(found), np.inf, found)


def _slope(channel: Channel, grounded: bool) -> float:  # noqa: FBT001 - of the loops
    """What a multiplier counts over: its slope at θ = 0 where nothing holds the position."""
    if grounded or not channel.taps:
        return 1.0
    return sum(tap.weight * tap.samples for tap in channel.taps)


def multiplier_at(channel: Channel, angle: FloatArray) -> ComplexArray:
    """M(e^jθ), of the shape of the angles; its real part loses nothing at small angles."""
    total = np.full(angle.shape, complex(channel.constant))
    for tap in channel.taps:
        total += tap.weight * difference_at(tap.samples, angle)
    return total


def difference_at(samples: int, angle: FloatArray) -> ComplexArray:
    """1 - e^(-jθ·samples), of the shape of the angles."""
    turn = samples * angle
    return 2 * np.sin(turn / 2) ** 2 + 1j * np.sin(turn)
