"""Absolute stability of clamped impedances and of dampers that switch: the gain that is proved.

Each element with a spring is one nondecreasing function φ of one signal, zero at nothing and of
slope at most 1: F = -φ(K·y + B·v + M·a). Dampers that may be switched at any moment are θ(t)·B·v
with θ(t) in [0, 1]. With the multiplier Mᵢ of Zames and Falb of each (a constant for what is
switched), force and velocity die away if at every frequency the Hermitian part of

    Mᵢ·(δᵢⱼ/(g·sᵢ) + oᵢ·G)

is positive definite, sᵢ being K or B, sᵢ·oᵢ the law and G position over force (docs/theory.md, 11).
That is D/g + C with a diagonal D that is positive: one eigenvalue problem tells the largest g, on
the frequency responses of the loops along the upper half of the unit circle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Channel, Multiplier
from tune.documents.effects import Effects
from tune.loop.loop import Loop
from tune.loop.polynomials import companion_roots

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
        """On a grid that is fine where the loops are, shape (loops,).

        ``steady`` effects are part of the device here, without springs, each at a level of its own:
        none, half or all of it. One loop becomes as many as there are levels.
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
        position = _quotient(parts.plant_numerator, parts.plant_denominator, angle)
        velocity = _quotient(parts.beta, parts.law_denominator, angle)
        acceleration = _quotient(parts.gamma, parts.law_denominator, angle)
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
        return replace(
            self,
            angle=angle,
            position=np.concatenate([part.position for part in parts]),
            velocity=np.concatenate([part.velocity for part in parts]),
            acceleration=np.concatenate([part.acceleration for part in parts]),
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


def _quotient(top: FloatArray, bottom: FloatArray, angle: FloatArray) -> ComplexArray:
    """A quotient of polynomials in w at w = j·tan(θ/2), each (degree+1, loops); also at θ = π."""
    sine, cosine = np.sin(angle / 2), np.cos(angle / 2)
    value = _scaled_value(top, sine, cosine) / _scaled_value(bottom, sine, cosine)
    return value * cosine ** float(len(bottom) - len(top))


def _scaled_value(polynomial: FloatArray, sine: FloatArray, cosine: FloatArray) -> ComplexArray:
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


#: Rounds in which the highest peaks of each loop are closed in on; how many, and points of each.
_ZOOMS, _PEAKS, _ZOOM_POINTS = 4, 6, 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Nonlinearities:
    """What of a sum of elements is not linear.

    Clamps are names and effects of the elements with a spring; ``damping`` is that of all that is
    damping only and switched at any moment, N·s/m (N·m·s/rad), 0 for none.
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
