"""What entering one element amounts to, in numbers people know: bounce, depth, jolt and energy.

docs/theory.md, 11. They are the element's own, at full gain and below the level of its clamp.

An element with a spring is entered where its law K·y + B·v + M·a passes zero: before its place
where it damps, because a hand comes fast. From there to where the law passes zero again the sampled
loop is linear, so that the ratio of speeds depends on the device and on where between two samples
it is entered, and not on the speed. The estimates of velocity and acceleration run outside too: on
entry they hold the free motion, speed constant and acceleration none.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device, round_to_digits
from tune.documents.profile import Contact, ElementProfile
from tune.loop.filters import Filters
from tune.loop.state_space import SampledLoop, corners_of

FloatArray = NDArray[np.float64]

#: Samples beyond which half a period of the device on a spring is no bounce off a wall.
LONGEST_CONTACT = 5_000
#: Places between two samples at which the element is entered, evenly up to a whole sample.
PHASES = 8
#: Samples after which a device that is still inside has stayed.
_FOLLOWED = 20_000
#: Samples computed at once, at least and at most.
_FEWEST, _MOST = 32, 1024
#: Digits of a stated number; restitutions are rounded outwards.
_DIGITS = 4
#: Less than this of a speed comes back as nothing: a number so small has no digits to round to.
_LEAST = 1e-12


def contact(
    device: Device, box: Box, filters: Filters, element: ElementProfile, extra: float
) -> Contact:
    """What a free device meets that enters an element.

    Args:
        device: modes, current lag and force limit are read.
        box: of everything else of the device.
        filters: of velocity and acceleration.
        element: its effects, motion, side and force level.
        extra: samples of delay of the margin.
    """
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
    if half_period > LONGEST_CONTACT * box.sample_time[0]:
        return None
    found = np.array(
        [
            restitutions(
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
def restitutions(
    loop: SampledLoop, *, before: float, one_sided: bool, sample_time: float, half_period: float
) -> FloatArray:
    """Speed out over speed in, for each place between two samples at which it is entered.

    Speeds are those of the rigid mass at the place of entry. Where forces on their way still act on
    a device that has left, it is the speed with which free motion would have left: v + (b/m)·x
    does not change in free motion, nor does v + (b/m)·x + τ·F/m while an actuator's force decays.

    Args:
        loop: of the device with the law of the element.
        before: the face that it is entered at unit speed, B/K, s.
        one_sided: a wall: where its law would pull it gives nothing, until the device is outside.
        sample_time: T, s.
        half_period: of the device's mass on the spring, s.

    Returns:
        Shape (PHASES,); 0 where the device stays inside.
    """
    plant = loop.plant
    phases = np.arange(1, PHASES + 1) / PHASES
    state = np.zeros((len(loop.read), PHASES))
    state[: len(plant.drive)] = plant.held(phases * sample_time)[0][:, :, plant.speed].T
    state[0] -= before
    state[loop.remembered] = loop.moving(loop.read @ state, sample_time)
    wanted = np.clip(1.1 * half_period / sample_time, _FEWEST, _MOST)
    count = 1 << int(np.ceil(np.log2(wanted)))
    acting, idle = _powers(loop.pushed, count), None
    left = np.zeros(PHASES, dtype=bool)
    followed = np.zeros(PHASES, dtype=np.intp)
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
    """States at the first sample at which the law starts or stops pushing, or that is outside.

    Beside them how many samples it took.
    """
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
