"""What an element amounts to for the hand: the mass and damping that it renders, and entering it.

**Rendered**, docs/theory.md, 8: what a hand feels of commanded effects at the motions people make.
Filters, delay and hold let a virtual mass lag behind the acceleration: less of it is felt as mass,
and some as damping. A damper that lags takes mass away, a spring that lags takes damping away.

**Contact**, docs/theory.md, 11: bounce, depth, jolt and energy of entering one element, its own, at
full gain and below the level of its clamp. An element with a spring is entered where its law
K·y + B·v + M·a passes zero: before its place where it damps, because a hand comes fast. From there
to where the law passes zero again the sampled loop is linear, so that the ratio of speeds depends
on the device and on where between two samples it is entered, and not on the speed. The estimates of
velocity and acceleration run outside too: on entry they hold the free motion, speed constant and
acceleration none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device, round_to_digits
from tune.documents.profile import Contact, ElementProfile, Rendered
from tune.loop.filters import Filters
from tune.loop.state_space import SampledLoop, corners_of

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Hz. Voluntary movements of the arm and hand lie between these; what is slower is felt as the
#: spring and friction, what is faster as vibration.
SLOWEST, FASTEST = 0.5, 5.0
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
            filters, device.sample_time.value, device.delay.value, 0.0 if lag is None else lag.value
        )


def impedances(
    filters: Filters,
    frequency: FloatArray,
    *,
    sample_time: float,
    delay: float,
    current_lag: float = 0.0,
) -> Impedances:
    """What a hand that moves in a sine feels, exact for the sampled, held force; SI units.

    The force at multiples of the sample rate away from the motion is ripple, not counted.
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
    """The apparent mass and damping that an element adds to the device."""
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
        mass_at_ends=mass_at_ends,
        damping=felt_damping,
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
        return Band(float(weights @ values), float(values[0]), float(values[-1]))

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


#: Samples beyond which half a period of the device on a spring is no bounce off a wall.
_LONGEST_CONTACT = 5_000
#: Places between two samples at which the element is entered, evenly up to a whole sample.
_PHASES = 8
#: Samples after which a device that is still inside has stayed.
_FOLLOWED = 20_000
#: Samples computed at once, at least and at most.
_FEWEST, _MOST = 32, 1024
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
    told = {
        "restitution": None
        if element.fades
        else _restitution(device, box, filters, (K, B), one_sided=element.one_sided),
        "net_damping": round_to_digits(B - K * late, _DIGITS),
        "lead": round_to_digits(speed * (B / K - present), _DIGITS),
    }
    if limit is not None:
        told["depth_at_continuous_force"] = round_to_digits(
            min(limit.continuous, level) / K, _DIGITS
        )
        told["depth_at_peak_force"] = round_to_digits(level / K, _DIGITS)
    return found.model_copy(update=told)


def _restitution(
    device: Device, box: Box, filters: Filters, values: tuple[float, float], *, one_sided: bool
) -> tuple[float, float] | None:
    """Least and largest over the corners of the box and the places between two samples.

    Between the places computed it is continuous; the largest difference between neighbours is
    added on both sides. That no device inside the box is beyond its corners is not proved.
    """
    stiffness, damping = values
    half_period = math.pi * math.sqrt(box.mass[1] / stiffness)
    if half_period > _LONGEST_CONTACT * box.sample_time[0]:
        return None
    found = np.array(
        [
            _restitutions(
                SampledLoop.of(place, filters, (stiffness, damping, 0.0)),
                before=damping / stiffness,
                one_sided=one_sided,
                sample_time=place.sample_time,
                half_period=half_period,
            )
            for place in corners_of(device, box)
        ]
    )
    if not np.isfinite(found).all():
        return None
    beside = np.abs(np.diff(found, axis=1)).max()
    least, most = max(0.0, found.min() - beside), found.max() + beside
    return _outwards(least, -1), _outwards(most, 1)


# What grows without end stays inside, or comes out with a speed that is no number.
@np.errstate(over="ignore", invalid="ignore")
def _restitutions(
    loop: SampledLoop, *, before: float, one_sided: bool, sample_time: float, half_period: float
) -> FloatArray:
    """Speed out over speed in, for each place between two samples at which it is entered.

    Speeds are those of the rigid mass at the place of entry. Where forces on their way still act on
    a device that has left, it is the speed with which free motion would have left: v + (b/m)·x
    does not change in free motion, nor does v + (b/m)·x + τ·F/m while an actuator's force decays.
    A wall, ``one_sided``, gives nothing where its law would pull until the device is outside; 0
    where it stays inside. The face is entered ``before``, B/K, at unit speed.
    """
    plant = loop.plant
    phases = np.arange(1, _PHASES + 1) / _PHASES
    state = np.zeros((len(loop.read), _PHASES))
    state[: len(plant.drive)] = plant.held(phases * sample_time)[0][:, :, plant.speed].T
    state[0] -= before
    state[loop.remembered] = loop.moving(loop.read @ state, sample_time)
    wanted = np.clip(1.1 * half_period / sample_time, _FEWEST, _MOST)
    count = 1 << int(np.ceil(np.log2(wanted)))
    acting, idle = _powers(loop.pushed, count), None
    left = np.zeros(_PHASES, dtype=bool)
    followed = np.zeros(_PHASES, dtype=np.intp)
    while True:
        pushing = loop.command @ state < 0
        left |= ~pushing & ((loop.read @ state <= 0) | (not one_sided))
        inside = ~left & (followed < _FOLLOWED)
        if not inside.any():
            break
        for acts in (True, False):
            chosen = np.flatnonzero(inside & (pushing == acts))
            if not chosen.size:
                continue
            if not acts and idle is None:
                idle = _powers(loop.free, count)
            powers = acting if acts or idle is None else idle
            state[:, chosen], steps = _until_switched(loop, powers, state[:, chosen], acts=acts)
            followed[chosen] += steps
    under_way = loop.under_way.stop - loop.under_way.start
    gone = (np.linalg.matrix_power(loop.free, under_way) @ state)[: len(plant.drive)]
    motion = plant.motion[plant.speed]
    speed = gone[plant.speed] - motion[plant.speed] * (gone[0] + before)
    if plant.lagged:
        speed -= motion[-1] / plant.motion[-1, -1] * gone[-1]
    return np.where(left, np.maximum(0.0, -speed), 0.0)


def _powers(transition: FloatArray, count: int) -> FloatArray:
    """A⁰ to A^count, count a power of two; shape (count + 1, states, states)."""
    size = transition.shape[0]
    found = np.empty((count + 1, size, size))
    found[0], found[1] = np.eye(size), transition
    done = 1
    while done < count:
        found[done + 1 : 2 * done + 1] = found[1 : done + 1] @ found[done]
        done *= 2
    return found


def _until_switched(
    loop: SampledLoop, powers: FloatArray, state: FloatArray, *, acts: bool
) -> tuple[FloatArray, NDArray[np.intp]]:
    """States where the law first starts or stops pushing or that is outside; samples till then."""
    other = ((loop.command @ powers[1:]) @ state < 0) != acts
    if not acts:
        other |= (loop.read @ powers[1:]) @ state <= 0
    switched = other.any(axis=0)
    steps = np.where(switched, other.argmax(axis=0) + 1, len(powers) - 1)
    return np.einsum("cij,jc->ic", powers[steps], state), steps


def _outwards(value: float, side: int) -> float:
    """The next number of as many digits downwards (-1) or upwards (1)."""
    if value < _LEAST:
        return _LEAST if side > 0 and value > 0 else 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) + 1 - _DIGITS)
    return round_to_digits(
        max(0.0, (math.floor if side < 0 else math.ceil)(value / unit) * unit), _DIGITS
    )
