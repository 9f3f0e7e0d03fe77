"""What a hand gets: rendered mass and damping, entering an element, force ripple.

**Rendered**, docs/theory.md, 8: what a hand feels of commanded effects at the motions people make.
Filters, delay and hold let a virtual mass lag behind the acceleration: less of it is felt as mass,
and some as damping. A damper that lags takes mass away, a spring that lags takes damping away.

**Contact**, docs/theory.md, 11: bounce, depth, jolt and energy of entering one element, its own, at
full gain and below the level of its clamp.

**Ripple.** A position in motion is quantised like white noise of variance Δ²/12. It reaches the
force through C/(1 + G·C); the closed form of the H2 norm needs no simulation. In w the norm on the
unit circle is that of a transfer function times √2/(1+w) on the imaginary axis. A device at rest
shows single counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device, round_to_digits
from tune.documents import LoopError
from tune.documents.estimators import DIFFERENCES, Derivative, filter_of, leads
from tune.documents.profile import Contact, ElementProfile, Rendered
from tune.documents.scene import EFFECT_NAMES, EffectName, Effects
from tune.loop.loop import Filters, Loop
from tune.loop.polynomials import h2_squared, product, spread
from tune.loop.state_space import law_states, restitution

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Hz. Voluntary movements of the arm and hand lie between these; what is slower is felt as the
#: spring and friction, what is faster as vibration.
SLOWEST, FASTEST = 0.5, 5.0
#: Hz. Up to here a mass still has to be felt as one and a damper may not pump, docs/tuning.md.
BEYOND = 20.0
#: Hz, in equal ratios: where what is felt is bound, in the motions and beyond; an extreme between
#: two of them is off by less than 0.05 % of the largest. And where it is told.
_WITHIN, _AFTER = np.geomspace(SLOWEST, FASTEST, 129), np.geomspace(FASTEST, BEYOND, 97)
PLACES: FloatArray = np.concatenate([_WITHIN, _AFTER])
IN_MOTION: NDArray[np.bool_] = np.arange(PLACES.size) < _WITHIN.size
_MOTIONS, _FARTHER = np.geomspace(SLOWEST, FASTEST, 801), np.geomspace(FASTEST, BEYOND, 401)
_TOLD: FloatArray = np.concatenate([_MOTIONS, _FARTHER])
#: Gauss-Lobatto nodes on the logarithm of frequency, the ends among them. Means are right to 1e-12
#: with well damped filters above 5 Hz and to 1e-5 with the sharpest resonance in band.
NODES = 65
#: Digits of a written value, as of the perceived steps; restitutions are rounded outwards.
_DIGITS = 4


class Impedances(NamedTuple):
    """Force against motion over velocity, N·s/m, of one unit of each effect; of any shape."""

    stiffness: ComplexArray
    damping: ComplexArray
    mass: ComplexArray


class Band(NamedTuple):
    """A quantity over frequency: its mean over the logarithm in motions, and at all `PLACES`."""

    mean: float
    places: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """What one unit of each commanded effect is felt as; rotary units alike."""

    mass: Band  # apparent mass of a mass, kg per kg
    damping: Band  # of a damper, N·s/m per N·s/m
    damping_of_mass: Band  # parasitic, N·s/m per kg; positive, as a mass lags
    mass_of_damping: Band  # apparent, kg per N·s/m; negative, as a damper lags
    damping_of_stiffness: Band  # N·s/m per N/m; negative, as a spring lags

    @classmethod
    def of(cls, device: Device, filters: Filters) -> Shares:
        """Shares at the device's best estimate; a vibration mode does not show at these motions."""
        return _shares(filters, *_timing(device))


def _timing(device: Device) -> tuple[float, float, float]:
    """(sample time, delay, lag of the current) at the best estimate, s."""
    lag = device.current_lag
    return device.sample_time.value, device.delay.value, 0.0 if lag is None else lag.value


def _impedances(
    filters: Filters, frequency: FloatArray, sample_time: float, delay: float, current_lag: float
) -> Impedances:
    """What a hand that moves in a sine feels, exact for the sampled, held force; SI units.

    The force at multiples of the sample rate away from the motion is ripple, not counted.
    """
    turn: ComplexArray = np.multiply(2j * np.pi, frequency)
    step = turn * sample_time
    hold = -np.expm1(-step) / step
    late = np.exp(-turn * delay) * hold / (1 + turn * current_lag)
    difference = -np.expm1(-step) / sample_time

    def filtered(which: Derivative) -> ComplexArray | float:
        """Π (1-p)/(1-p/z) over the poles p, of which the pair has ζ; carried on by its lag."""
        kind, cutoff, order = filter_of(filters, which)
        if cutoff is None:
            return 1.0
        passed, ratio = np.ones_like(step), filters.filter_damping_ratio
        angle, lag = 2 * np.pi * cutoff * sample_time, DIFFERENCES[which] / 2
        turned = 1j * np.sqrt((1 - ratio) * (1 + ratio))
        pair = (1.0,) if order == 1 else (ratio + turned, ratio - turned)
        for pole in (*pair, *(1.0,) * (order - 2)):
            passed = passed * np.expm1(-angle * pole) / np.expm1(-angle * pole - step)
            lag += (1 / np.expm1(angle * pole)).real
        return passed * (1 - lag * np.expm1(-step)) if leads(which, kind, order) else passed

    window = filters.velocity_window_samples
    if window is None:
        velocity = difference * filtered("velocity")
    else:
        velocity = -np.expm1(-turn * (window * sample_time)) / (window * sample_time)
    acceleration = difference**2 * filtered("acceleration")
    force = late / turn
    return Impedances(stiffness=force, damping=velocity * force, mass=acceleration * force)


def felt_over_frequency(
    device: Device, filters: Filters, frequency: FloatArray, K: float, B: float, M: float
) -> tuple[FloatArray, FloatArray]:
    """Apparent mass, kg, and damping, N·s/m, that an element adds, at frequencies in Hz.

    Of the shape of the frequencies; rotary units alike. Its spring is no part of the mass.
    """
    told = _impedances(filters, frequency, *_timing(device))
    moving = B * told.damping + M * told.mass
    return moving.imag / (2 * np.pi * frequency), (moving + K * told.stiffness).real


def rendered_mass_and_damping(
    device: Device, filters: Filters, *, stiffness: float, damping: float, mass: float
) -> Rendered:
    """The apparent mass and damping that an element adds to the device."""
    shares = Shares.of(device, filters)
    felt = felt_over_frequency(device, filters, _TOLD, stiffness, damping, mass)
    means = {
        "mass": mass * shares.mass.mean + damping * shares.mass_of_damping.mean,
        "damping": damping * shares.damping.mean
        + mass * shares.damping_of_mass.mean
        + stiffness * shares.damping_of_stiffness.mean,
    }
    found: dict[str, Any] = {}
    for name, values in zip(("mass", "damping"), felt, strict=True):
        motion, beyond = np.split(values, [_MOTIONS.size])
        pairs = {
            "at_ends": (motion[0], motion[-1]),
            "in_motion": (motion.min(), motion.max()),
            "beyond": (beyond.min(), beyond.max()),
        }
        found[name] = round_to_digits(float(means[name]), _DIGITS)
        for end, pair in pairs.items():
            found[f"{name}_{end}"] = tuple(round_to_digits(float(x), _DIGITS) for x in pair)
    return Rendered(**found)


@lru_cache(maxsize=1024)
def _shares(filters: Filters, sample_time: float, delay: float, current_lag: float) -> Shares:
    nodes, weights = _nodes()
    frequency = np.concatenate([nodes, PLACES])
    unit = _impedances(filters, frequency, sample_time, delay, current_lag)
    turn = 2 * np.pi * frequency

    def band(values: FloatArray) -> Band:
        return Band(float(weights @ values[:NODES]), values[NODES:])

    return Shares(
        mass=band(unit.mass.imag / turn),
        damping=band(unit.damping.real),
        damping_of_mass=band(unit.mass.real),
        mass_of_damping=band(unit.damping.imag / turn),
        damping_of_stiffness=band(unit.stiffness.real),
    )


@lru_cache(maxsize=1)
def _nodes() -> tuple[FloatArray, FloatArray]:
    """Frequencies, Hz, and weights of the mean over their logarithm, by Gauss-Lobatto."""
    legendre = np.polynomial.Legendre.basis(NODES - 1)
    inner = np.sort(legendre.deriv().roots().real)
    places = np.concatenate([[-1.0], inner, [1.0]])
    weights = 1 / (NODES * (NODES - 1) * legendre(places) ** 2)
    frequency = SLOWEST * (FASTEST / SLOWEST) ** ((places + 1) / 2)
    frequency[0], frequency[-1] = SLOWEST, FASTEST
    return frequency, weights


#: Less than this of a speed comes back as nothing: a number so small has no digits to round to.
_LEAST = 1e-12


def contact(
    device: Device, box: Box, filters: Filters, element: ElementProfile, extra: float
) -> Contact:
    """What a free device meets that enters an element, ``extra`` samples late beyond its delay."""
    K, B, M = element.stiffness, element.damping, element.mass
    speed, level = element.motion.speed, element.force_level
    found = Contact(
        force_on_entry=round_to_digits(
            speed * (K * max(box.sample_time) if K else abs(B)), _DIGITS
        ),
        energy_per_entry=round_to_digits(abs(M) * speed**2 / 2, _DIGITS) if M else None,
    )
    if not K:
        return found
    limit, lag = device.force_limit, device.current_lag
    late = box.delay[1] + (extra + 0.5) * max(box.sample_time) + (lag.high if lag else 0.0)
    present = device.delay.value + 0.5 * device.sample_time.value + (lag.value if lag else 0.0)
    bounce = None
    if not element.fades:
        bounce = restitution(device, box, filters, (K, B), one_sided=element.one_sided)
    if bounce is not None:
        bounce = _outwards(bounce[0], -1), _outwards(bounce[1], 1)
    stated = {
        "restitution": bounce,
        "net_damping": round_to_digits(B - K * late, _DIGITS),
        "lead": round_to_digits(speed * (B / K - present), _DIGITS),
    }
    if limit is not None:
        stated["depth_at_continuous_force"] = round_to_digits(
            min(limit.continuous, level) / K, _DIGITS
        )
        stated["depth_at_peak_force"] = round_to_digits(level / K, _DIGITS)
    return found.model_copy(update=stated)


def _outwards(value: float, side: int) -> float:
    """The next number of as many digits downwards (-1) or upwards (1)."""
    if value < _LEAST:
        return _LEAST if side > 0 and value > 0 else 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) + 1 - _DIGITS)
    return round_to_digits(
        max(0.0, (math.floor if side < 0 else math.ceil)(value / unit) * unit), _DIGITS
    )


#: A filtered estimate answers a step of one count most strongly within a quarter of a period of
#: its cut-off (second order, least damped); half a period is looked at, and not for ever.
_PERIODS = 0.5
_FEWEST_SAMPLES = 3
_MOST_SAMPLES = 100_000


def force_ripple(loop: Loop, effects: Effects, encoder_resolution: float) -> FloatArray:
    """Force ripple from encoder quantisation, N rms (N·m if rotary).

    Args:
        loop: of any shape; scaled by mass and sample time (`Loop.from_numbers`).
        effects: broadcast against the loop; for an unstable setting the answer, possibly nan,
            means nothing.
        encoder_resolution: Δ, m (rad): one count.

    Returns:
        rms force of the broadcast shape.

    Raises:
        LoopError: a resolution that is not above zero.
    """
    _refuse_nothing(encoder_resolution=encoder_resolution)
    law = law_numerator(loop, effects)
    if law is None:
        return np.zeros(loop.scales[0].shape)
    denominator, _ = loop.polynomial(effects)
    shape, path = denominator.shape[1:], loop.transfer.plant_denominator
    numerator = list(product(spread(law, shape), spread(path, shape)))
    energy = ripple_energy(numerator, list(denominator), position_free=loop.has_free_pole(effects))
    with np.errstate(invalid="ignore"):
        noise = np.asarray(np.sqrt(energy / 12) * encoder_resolution)
    return np.asarray(noise / loop.scales[0])


def _refuse_nothing(**numbers: float) -> None:
    for name, number in numbers.items():
        if not 0 < number < math.inf:
            raise LoopError(f"{name} must be above 0, not {number:g}; state it in SI units")


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
) -> dict[EffectName, float]:
    """The force, N (N·m), that one count commands through each effect that is there.

    KΔ, and BΔ/T and MΔ/T² without filters; with one the largest sample of the filtered answer to a
    step of one count.

    Args:
        effects: single values.
        sample_time: T, s.
        encoder_resolution: Δ, m (rad).
        filters: of velocity and acceleration.

    Raises:
        LoopError: a sample time or resolution that is not above zero.
    """
    _refuse_nothing(sample_time=sample_time, encoder_resolution=encoder_resolution)
    filters = filters or Filters()
    cutoffs = (None, filters.velocity_filter_hz, filters.acceleration_filter_hz)
    found: dict[EffectName, float] = {}
    for name, size, cutoff in zip(EFFECT_NAMES, effects.arrays(), cutoffs, strict=True):
        if size is not None:
            values = (float(size) if name == each else 0.0 for each in EFFECT_NAMES)
            law = law_states(filters, sample_time, *values)
            periods = 0 if cutoff is None else math.ceil(_PERIODS / (cutoff * sample_time))
            state, most = np.zeros(len(law.drive)), 0.0
            for _ in range(min(_FEWEST_SAMPLES + periods, _MOST_SAMPLES)):
                most = max(most, abs(float(law.command @ state) + law.direct))
                state = law.update @ state + law.drive
            found[name] = most * encoder_resolution
    return found


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
