"""What the encoder makes the hand feel: ripple of the force and vibration of the handle.

A position in motion is quantised like white noise of variance Δ²/12. It reaches the force through
C/(1 + G·C) and the handle through G_h·C/(1 + G·C), G_h from the force to the handle; the closed
form of the H2 norm needs no simulation. In w the norm on the unit circle is that of a transfer
function times √2/(1+w) on the imaginary axis. A device at rest shows single counts instead.

Vibration is weighed by a threshold curve, which is data with a source: the least displacement of a
steady sinusoid that a hand detects. Where the spectrum of the handle's displacement, divided by the
curve, sums to more than 1, it is said to be felt: the energies of a band add up in the Pacinian
channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import as_file, files
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from identification import Document, load_document
from tune.documents.effects import Effects
from tune.documents.errors import LoopError
from tune.loop.filters import Filters
from tune.loop.loop import Loop, closed_loops, spread, value_at

FloatArray = NDArray[np.float64]


def product(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    """Coefficients of the product of two polynomials."""
    total: list[Any] = [0.0] * (len(p) + len(q) - 1)
    for i, left in enumerate(p):
        for j, right in enumerate(q):
            total[i + j] = total[i + j] + left * right
    return total


def routh_ratios(coefficients: Sequence[Any]) -> list[Any]:
    """Ratios, all below 1 exactly when a polynomial with positive coefficients is stable.

    Each new entry of the table is a difference p - q; in a stable table every p, q and difference
    is positive, so the ratios q/p say it all, free of units and of the scale of w. Coefficients
    ascend, of degree 2 or more.
    """
    upper, lower = list(coefficients[::-2]), list(coefficients[-2::-2])
    ratios: list[Any] = []
    while len(upper) > 1:
        factor = upper[0] / lower[0]
        following = upper[1:]
        for column, item in enumerate(lower[1:]):
            ratios.append(factor * item / following[column])
            following[column] = following[column] - factor * item
        upper, lower = lower, following
    return ratios


def h2_squared(numerator: Sequence[Any], denominator: Sequence[Any]) -> Any:
    """(1/2π)∫|N(jω)/D(jω)|² dω of a stable, strictly proper quotient: Åström's α-β recursion.

    The energy is the sum of β_k²/(2α_k) over the two tables, each row of which is reduced as in
    Routh's scheme (K. J. Åström, Introduction to Stochastic Control Theory, 1970, chapter 5).
    """
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


#: A filtered estimate answers a step of one count most strongly within a quarter of a period of
#: its cut-off (second order, least damped); half a period is looked at, and not for ever.
_PERIODS = 0.5
_FEWEST_SAMPLES = 3
_MOST_SAMPLES = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CountJump:
    """Largest force that a single encoder count commands through each effect, N (N·m)."""

    stiffness: float
    damping: float
    mass: float


def force_ripple(loop: Loop, effects: Effects, encoder_resolution: float) -> FloatArray:
    """Force ripple from encoder quantisation, N rms (N·m if rotary).

    Args:
        loop: of any shape; scaled by mass and sample time (`Loop.from_numbers`).
        effects: broadcast against the loop; for an unstable setting the answer, possibly nan,
            means nothing.
        encoder_resolution: Δ, m (rad): one count.

    Returns:
        rms force of the broadcast shape.
    """
    noise = _noise(loop, effects, loop.transfer.plant_denominator, encoder_resolution)
    return np.asarray(noise / loop.scales[0])


def handle_vibration(loop: Loop, effects: Effects, encoder_resolution: float) -> FloatArray:
    """Vibration of the handle from encoder quantisation, m rms (rad), at the samples.

    Arguments as in `force_ripple`; `vibration_in_thresholds` weighs it by what a hand feels.

    The answer has the shape of loop and effects together.
    """
    return _noise(loop, effects, loop.transfer.handle_numerator, encoder_resolution)


def law_numerator(loop: Loop, effects: Effects) -> FloatArray | None:
    """The numerator of the dimensionless law C·T²/m over its denominator; None for no effect."""
    parts = loop.transfer
    terms = (parts.alpha, parts.beta, parts.gamma)
    values = loop.dimensionless_effects(effects)
    present = [(t, v) for t, v in zip(terms, values, strict=True) if v is not None]
    if not present:
        return None
    shape = np.broadcast_shapes(*(value.shape for _, value in present))
    total = np.zeros((max(len(term) for term, _ in present), *shape))
    for term, value in present:
        total[: len(term)] += spread(term, shape) * value
    return total


def count_jump(
    effects: Effects, sample_time: float, encoder_resolution: float, filters: Filters | None = None
) -> CountJump:
    """The force that one count commands: KΔ, and BΔ/T and MΔ/T² without filters.

    With a filter it is the largest sample of the filtered answer to a step of one count.

    Args:
        effects: single values.
        sample_time: T, s.
        encoder_resolution: Δ, m (rad).
        filters: of velocity and acceleration.
    """
    filters = filters or Filters()
    K, B, M = (0.0 if gain is None else abs(float(gain)) for gain in effects.arrays())
    velocity = 1 / (sample_time * (filters.velocity_window_samples or 1))
    if filters.velocity_filter_hz is not None and B:
        alone = replace(filters, acceleration_filter_hz=None)
        velocity = _largest_answer(alone, "beta", filters.velocity_filter_hz, sample_time)
    acceleration = 1 / sample_time**2
    if filters.acceleration_filter_hz is not None and M:
        alone = replace(filters, velocity_filter_hz=None, velocity_window_samples=None)
        acceleration = _largest_answer(alone, "gamma", filters.acceleration_filter_hz, sample_time)
    return CountJump(
        stiffness=K * encoder_resolution,
        damping=B * velocity * encoder_resolution,
        mass=M * acceleration * encoder_resolution,
    )


def ripple_energy(
    numerator: Sequence[Any], denominator: Sequence[Any], *, position_free: bool
) -> Any:
    """Squared discrete H2 norm in any arithmetic, of C/(1+GC) over the loop polynomial in w.

    ``position_free``: both share a factor w, which is divided out.
    """
    size = len(denominator)
    top, bottom = list(numerator[:size]), list(denominator)
    if position_free:
        top, bottom = top[1:], bottom[1:]
    root2 = float(np.sqrt(2.0))
    widened = [bottom[0], *(a + b for a, b in pairwise(bottom)), bottom[-1]]
    return h2_squared([root2 * item for item in top], widened)


def _noise(loop: Loop, effects: Effects, path: FloatArray, resolution: float) -> FloatArray:
    """rms of what a polynomial ``path`` over the plant's denominator makes of the noise."""
    law = law_numerator(loop, effects)
    if law is None:
        return np.zeros(loop.scales[0].shape)
    denominator, _ = loop.polynomial(effects)
    shape = denominator.shape[1:]
    numerator = product(list(spread(path, shape)), list(spread(law, shape)))
    energy = ripple_energy(numerator, list(denominator), position_free=loop.has_free_pole(effects))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(energy / 12) * resolution)


def _largest_answer(
    filters: Filters, name: Literal["beta", "gamma"], cutoff: float, sample_time: float
) -> float:
    """Largest answer of one filtered estimate to a unit step of position, 1/s or 1/s²."""
    # The law does not know the device: any mass will do.
    loop = Loop.from_numbers(mass=1.0, damping=0.0, sample_time=sample_time, filters=filters)
    parts = (getattr(loop.transfer, name), loop.transfer.law_denominator)
    order = max(len(part) for part in parts) - 1
    numerator, denominator = (_in_inverse_z(part, order) for part in parts)
    samples = _FEWEST_SAMPLES + int(np.ceil(_PERIODS / (cutoff * sample_time)))
    answer = _step_answer(numerator, denominator, min(samples, _MOST_SAMPLES))
    scale = loop.scales[1 if name == "beta" else 2]
    return float(max(map(abs, answer)) * scale / loop.scales[0])


def _step_answer(numerator: FloatArray, denominator: FloatArray, samples: int) -> list[float]:
    """Answer of a filter, ascending in 1/z, to a step; scipy.signal takes longer to import."""
    leading = float(denominator[0])
    inputs = (np.cumsum(numerator) / leading).tolist()  # each sample of the step adds one term
    back = (denominator[:0:-1] / leading).tolist()
    answer: list[float] = [0.0] * len(back)
    for sample in range(samples):
        past = sum(a * y for a, y in zip(back, answer[sample : sample + len(back)], strict=True))
        answer.append(inputs[min(sample, len(inputs) - 1)] - past)
    return answer[len(back) :]


def _in_inverse_z(part: FloatArray, order: int) -> FloatArray:
    """(1+w)^order-fold multiple of a polynomial in w, ascending in 1/z, w = (1-1/z)/(1+1/z)."""
    total = np.zeros(order + 1)
    for power, coefficient in enumerate(part):
        minus = np.polynomial.polynomial.polypow([1.0, -1.0], power)
        plus = np.polynomial.polynomial.polypow([1.0, 1.0], order - power)
        total += float(coefficient) * np.convolve(minus, plus)
    return total


#: Nodes of one panel of Gauss and Legendre's rule, between neighbouring corners of the curve and
#: resonances of the loop.
_NODES = 16
#: Halved panels agree to this, relative: far below what is known of any threshold.
_AGREE = 1e-6
#: Halvings of all panels; two are usual, since panels grow from each resonance outwards.
_MOST_HALVINGS = 6
#: Edges of panels around a pole: its distance from the axis times these.
_AROUND = 3.0 ** np.arange(-1, 12)
#: Hz. Below, no hand calls it vibration.
_LOWEST = 1.0


class ThresholdPoint(Document):
    """Least displacement that is felt at one frequency."""

    frequency_hz: float = Field(gt=0)
    displacement: float = Field(gt=0)


class ThresholdCurve(Document):
    """Vibrotactile thresholds; data that a user can replace with a file of this form.

    Attributes:
        source: where the numbers are from, and how sure that is.
        amplitude: what the displacements are: ``peak`` (zero to peak) or ``rms``.
        unit: m, of the handle.
        points: by rising frequency; straight lines between them in logarithms, held beyond them.
    """

    schema_: Literal["haptune/vibration/1"] = Field(default="haptune/vibration/1", alias="schema")
    name: str
    source: str
    amplitude: Literal["peak", "rms"]
    unit: Literal["m"] = "m"
    points: tuple[ThresholdPoint, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _rising(self) -> ThresholdCurve:
        frequencies = [point.frequency_hz for point in self.points]
        if any(b <= a for a, b in pairwise(frequencies)):
            raise ValueError("frequency_hz must rise from point to point")
        return self

    def rms(self, frequency_hz: FloatArray) -> FloatArray:
        """Threshold at given frequencies (Hz), m rms, of the same shape."""
        frequencies = np.log([point.frequency_hz for point in self.points])
        displacements = np.log([point.displacement for point in self.points])
        scale = np.sqrt(0.5) if self.amplitude == "peak" else 1.0
        return scale * np.exp(np.interp(np.log(frequency_hz), frequencies, displacements))


@cache
def default_thresholds() -> ThresholdCurve:
    """The hand around a cylinder; its source says how sure the numbers are."""
    with as_file(files("tune") / "data" / "grasped_cylinder.yaml") as path:
        return load_document(ThresholdCurve, Path(path))


def handle_spectrum(
    loop: Loop, effects: Effects, encoder_resolution: float, frequency_hz: FloatArray
) -> FloatArray:
    """Spectral density of the handle's displacement from quantisation, m²/Hz, one-sided."""
    frequency_hz = np.asarray(frequency_hz, dtype=np.float64)
    (one,), _ = closed_loops(loop, effects)
    law = law_numerator(loop, effects)
    if law is None:
        return np.zeros_like(frequency_hz)
    v = np.tan(np.pi * frequency_hz * one.sample_time)
    closed, _ = loop.polynomial(effects)
    response = value_at(loop.transfer.handle_numerator, v) * value_at(law, v) / value_at(closed, v)
    density = encoder_resolution**2 / 12 * 2 * one.sample_time
    return density * np.abs(response) ** 2


def vibration_in_thresholds(
    loop: Loop, effects: Effects, encoder_resolution: float, curve: ThresholdCurve | None = None
) -> float:
    """Vibration of the handle from quantisation, in thresholds: above 1 it is felt.

    √∫ S(f)/threshold(f)² df from 1 Hz to the Nyquist frequency, by Gauss and Legendre's rule with
    panels halved until two agree to 1e-6.

    Args:
        loop: of shape (), a linear axis, scaled by mass and sample time.
        effects: single values of a stable setting.
        encoder_resolution: Δ, m.
        curve: thresholds; None is `default_thresholds`.

    Raises:
        LoopError: the panels do not agree; the loop rings too sharply to be safe.
    """
    chosen = curve or default_thresholds()
    (one,), _ = closed_loops(loop, effects)
    nyquist = 0.5 / one.sample_time
    lowest = min(_LOWEST, nyquist / 2)
    poles = one.poles()
    poles = poles[np.isfinite(poles)]
    reach = np.abs(poles.real)[:, None] * np.concatenate([-_AROUND, [0.0], _AROUND])
    around = np.arctan(np.abs(poles.imag[:, None] + reach)) / (np.pi * one.sample_time)
    corners = np.concatenate(
        [[lowest, nyquist], [point.frequency_hz for point in chosen.points], around.reshape(-1)]
    )
    edges = np.unique(corners[(corners >= lowest) & (corners <= nyquist)])

    def total(edges: FloatArray) -> float:
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half = np.diff(edges)[:, None] / 2
        f = edges[:-1, None] + half * (1 + nodes)
        density = handle_spectrum(loop, effects, encoder_resolution, f) / chosen.rms(f) ** 2
        return float(np.sum(half * weights * density))

    previous = present = total(edges)
    for _ in range(_MOST_HALVINGS):
        edges = np.sort(np.concatenate([edges, (edges[1:] + edges[:-1]) / 2]))
        previous, present = present, total(edges)
        if abs(present - previous) <= _AGREE * present:
            return float(np.sqrt(present))
    raise LoopError(
        f"the vibration spectrum does not settle: {present:g} after {previous:g}; the loop rings "
        "too sharply. Give it more damping or less gain"
    )
