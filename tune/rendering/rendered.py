"""What a hand feels of commanded effects at the motions people make, docs/theory.md, 8.

Filters, delay and hold let a virtual mass lag behind the acceleration: less of it is felt as mass,
and some as damping. A damper that lags takes mass away, a spring that lags takes damping away. One
file: impedances, bands and shares are steps of one computation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from identification import Device, round_to_digits
from tune.documents.profile import Rendered
from tune.loop.filters import Filters

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Hz. Voluntary movements of the arm and hand lie between these; what is slower is felt as the
#: spring and friction, what is faster as vibration.
SLOWEST, FASTEST = 0.5, 5.0
#: Gauss-Lobatto nodes on the logarithm of frequency, the ends among them. Means are right to 1e-12
#: with well damped filters above 5 Hz and to 1e-5 with the sharpest resonance in band.
NODES = 65
#: Digits of a written value, as of the perceived steps.
_DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Impedances:
    """Force against motion over velocity, of one unit of each effect; complex, of any shape.

    Attributes:
        stiffness: of 1 N/m, N·s/m.
        damping: of 1 N·s/m, N·s/m.
        mass: of 1 kg, N·s/m.
    """

    stiffness: ComplexArray
    damping: ComplexArray
    mass: ComplexArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """A quantity over the motions people make: mean over the logarithm of frequency, and ends."""

    mean: float
    slowest: float
    fastest: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """What one unit of each commanded effect is felt as; rotary units alike.

    Attributes:
        mass: apparent mass of a mass, kg per kg.
        damping: damping of a damper, N·s/m per N·s/m.
        damping_of_mass: parasitic damping of a mass, N·s/m per kg; positive, as it lags.
        mass_of_damping: apparent mass of a damper, kg per N·s/m; negative, as it lags.
        damping_of_stiffness: damping of a spring, N·s/m per N/m; negative, as it lags.
    """

    mass: Band
    damping: Band
    damping_of_mass: Band
    mass_of_damping: Band
    damping_of_stiffness: Band

    @classmethod
    def of(cls, device: Device, filters: Filters) -> Shares:
        """Shares at the device's best estimate; a vibration mode does not show at these motions."""
        lag = device.current_lag
        return _shares(
            filters,
            device.sample_time.value,
            device.delay.value,
            0.0 if lag is None else lag.value,
        )


def impedances(
    filters: Filters,
    frequency: FloatArray,
    *,
    sample_time: float,
    delay: float,
    current_lag: float = 0.0,
) -> Impedances:
    """What a hand that moves in a sine feels at its frequency, exact for the sampled, held force.

    The force at multiples of the sample rate away from the motion is ripple, not counted.

    Args:
        filters: of velocity and acceleration.
        frequency: of the motion, Hz, any shape.
        sample_time: s.
        delay: from position to force, s.
        current_lag: time constant of the current loop, s.
    """
    turn: ComplexArray = np.multiply(2j * np.pi, frequency)
    step = turn * sample_time
    hold = -np.expm1(-step) / step
    late = np.exp(-turn * delay) * hold / (1 + turn * current_lag)
    difference = -np.expm1(-step) / sample_time
    if filters.velocity_window_samples is not None:
        span = filters.velocity_window_samples * sample_time
        velocity = -np.expm1(-turn * span) / span
    else:
        velocity = difference * _low_pass(
            filters.velocity_filter_hz,
            filters.velocity_filter_order,
            filters.filter_damping_ratio,
            step,
            sample_time,
        )
    acceleration = difference**2 * _low_pass(
        filters.acceleration_filter_hz,
        filters.acceleration_filter_order,
        filters.filter_damping_ratio,
        step,
        sample_time,
    )
    force = late / turn
    return Impedances(stiffness=force, damping=velocity * force, mass=acceleration * force)


def rendered_mass_and_damping(
    device: Device, filters: Filters, *, stiffness: float, damping: float, mass: float
) -> Rendered:
    """The apparent mass and damping that an element adds to the device.

    Args:
        device: sample time, delay and current lag are read.
        filters: of velocity and acceleration.
        stiffness: of the element, N/m; 0 if it has none, as of the others.
        damping: N·s/m.
        mass: kg.
    """
    shares = Shares.of(device, filters)

    def band(*parts: tuple[float, Band]) -> tuple[float, tuple[float, float]]:
        mean, slow, fast = (
            round_to_digits(
                sum(size * getattr(share, name) for size, share in parts if size), _DIGITS
            )
            for name in ("mean", "slowest", "fastest")
        )
        return mean, (slow, fast)

    felt_mass, mass_at_ends = band((mass, shares.mass), (damping, shares.mass_of_damping))
    felt_damping, damping_at_ends = band(
        (damping, shares.damping),
        (mass, shares.damping_of_mass),
        (stiffness, shares.damping_of_stiffness),
    )
    return Rendered(
        mass=felt_mass,
        damping=felt_damping,
        mass_at_ends=mass_at_ends,
        damping_at_ends=damping_at_ends,
    )


def _low_pass(
    cutoff: float | None, order: int, ratio: float, step: ComplexArray, sample_time: float
) -> ComplexArray:
    """Π (1-p)/(1-p/z) over the poles p = exp(-2π·f·T·(ζ ± j√(1-ζ²))), with ζ = 1 if of order 1."""
    passed = np.ones_like(step)
    if cutoff is None:
        return passed
    angle = 2 * np.pi * cutoff * sample_time
    turn = 1j * np.sqrt((1 - ratio) * (1 + ratio))
    poles = (1.0 + 0j,) if order == 1 else (ratio + turn, ratio - turn)
    for pole in poles:
        passed = passed * np.expm1(-angle * pole) / np.expm1(-angle * pole - step)
    return passed


@lru_cache(maxsize=1024)
def _shares(filters: Filters, sample_time: float, delay: float, current_lag: float) -> Shares:
    frequency, weights = _nodes()
    felt = impedances(
        filters, frequency, sample_time=sample_time, delay=delay, current_lag=current_lag
    )
    turn = 2 * np.pi * frequency

    def band(values: FloatArray) -> Band:
        return Band(
            mean=float(weights @ values), slowest=float(values[0]), fastest=float(values[-1])
        )

    return Shares(
        mass=band(felt.mass.imag / turn),
        damping=band(felt.damping.real),
        damping_of_mass=band(felt.mass.real),
        mass_of_damping=band(felt.damping.imag / turn),
        damping_of_stiffness=band(felt.stiffness.real),
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
