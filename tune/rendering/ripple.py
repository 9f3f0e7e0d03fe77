"""What the encoder makes the hand feel: ripple of the force and vibration of the handle.

A position in motion is quantised like white noise of variance Δ²/12. It reaches the force through
C/(1 + G·C) and the handle through G_h·C/(1 + G·C), G_h from the force to the handle; the closed
form of the H2 norm needs no simulation. In w the norm on the unit circle is that of a transfer
function times √2/(1+w) on the imaginary axis. A device at rest shows single counts instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.closed_loop import spread
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.rendering.routh_table import h2_squared, product

FloatArray = NDArray[np.float64]

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
    """The numerator of the dimensionless law C·T²/m over its denominator; None for no effect.

    Returns:
        (degree+1, *shape), ascending in w, of the broadcast shape.
    """
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
    effects: Effects,
    sample_time: float,
    encoder_resolution: float,
    filters: Filters | None = None,
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
    """Squared discrete H2 norm of numerator/denominator in w, in any arithmetic.

    Args:
        numerator: of C/(1+GC) over the common denominator, ascending in w; trailing zeros allowed.
        denominator: the loop polynomial.
        position_free: both then share a factor w, which is divided out.
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
