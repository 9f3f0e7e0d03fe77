"""State space of the sampled loop: matrices from one sample to the next.

A wall that is entered and left switches between two loops, and a clock that jitters between many:
both are followed in time. The state is that of the mechanism in continuous time, the commands on
their way to the actuator, and what the estimators remember, which run outside of an element too.
Where an element is entered and left: docs/theory.md, 11.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device
from tune.documents.estimators import Estimator
from tune.loop.loop import Filters
from tune.loop.polynomials import FloatArray


class LawStates(NamedTuple):
    """s[k+1] = update·s + drive·y, force = command·s + direct·y; y is the reading, m."""

    update: FloatArray
    drive: FloatArray
    command: FloatArray
    direct: float


def law_states(filters: Filters, T: float, K: float, B: float, M: float) -> LawStates:
    """The law as one filter of the reading, as few states as its order (transposed direct form)."""
    velocity, acceleration = (np.array([1.0]), np.array([1.0])), (np.array([1.0]), np.array([1.0]))
    if B:
        window = filters.velocity_window_samples or 1
        slope = np.zeros(window + 1)
        slope[0], slope[-1] = 1 / (window * T), -1 / (window * T)
        velocity = _smoothed(slope, Estimator.of(filters, "velocity", T))
    if M:
        twice = np.array([1.0, -2.0, 1.0]) / T**2
        acceleration = _smoothed(twice, Estimator.of(filters, "acceleration", T))
    below = np.convolve(velocity[1], acceleration[1])
    above = [
        K * below,
        B * np.convolve(velocity[0], acceleration[1]),
        M * np.convolve(acceleration[0], velocity[1]),
    ]
    size = max(len(part) for part in (below, *above))
    top = np.zeros(size)
    for part in above:
        top[: len(part)] -= part
    bottom = np.pad(below, (0, size - len(below)))
    update = np.eye(size - 1, k=1)
    if size > 1:
        update[:, 0] -= bottom[1:]
    drive = top[1:] - bottom[1:] * top[0]
    return LawStates(update, drive, np.eye(1, size - 1)[0], float(top[0]))


def _smoothed(difference: FloatArray, behind: Estimator) -> tuple[FloatArray, FloatArray]:
    """(numerator, denominator) in 1/z of a difference behind its filter."""
    above, below = difference, np.array([1.0])
    for section in (behind.first, behind.then):
        poles = np.trim_zeros(np.array([1.0, -section.t, section.p]), "b")
        above, below = above * section.gain, np.convolve(below, poles)
    lead = np.trim_zeros(np.array([1 + behind.lead, -behind.lead]), "b")
    return np.convolve(above, lead), below


#: Taylor terms of the exponential of a matrix below one half in norm: 2^-18/18! < 1e-20.
_TAYLOR = 18
#: Parts of a sample that count as none; clocks are not better.
_NO_FRACTION = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """One way a device may be, SI units."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    position_stiffness: float = 0.0  # slope of its own force by position
    current_lag: float = 0.0
    # (frequency in Hz, damping ratio, participation at motor and encoder) of each
    modes: tuple[tuple[float, float, float], ...] = ()


def corners_of(device: Device, box: Box) -> tuple[Corner, ...]:
    """The corners of a device's box; modes at their least, middle and largest, all together."""
    lag = device.current_lag
    sides = (
        box.mass,
        box.damping,
        box.sample_time,
        box.delay,
        box.position_stiffness,
        (0.0, 0.0) if lag is None else (lag.low, lag.high),
    )
    certain = all(m.frequency_hz.exact and m.damping_ratio.exact for m in device.modes)
    return tuple(
        Corner(
            mass=mass,
            damping=damping,
            sample_time=step,
            delay=delay,
            position_stiffness=slope,
            current_lag=late,
            modes=tuple(
                (
                    (1 - part) * mode.frequency_hz.low + part * mode.frequency_hz.high,
                    (1 - part) * mode.damping_ratio.low + part * mode.damping_ratio.high,
                    mode.at_encoder,
                )
                for mode in device.modes
            ),
        )
        for mass, damping, step, delay, slope, late in product(*map(dict.fromkeys, sides))
        for part in ((0.0,) if certain else (0.0, 0.5, 1.0))
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """A mechanism in continuous time, x' = motion·x + drive·F, reading = read·x.

    x is the positions of the rigid mass and of each mode, their speeds, the rigid mass's at index
    ``speed``, and, with a lag, the force of the actuator.
    """

    motion: FloatArray
    drive: FloatArray
    read: FloatArray
    speed: int

    @classmethod
    def of(cls, place: Corner) -> Mechanism:
        """A device without a hand, at one corner of its box."""
        mass, modes = place.mass, place.modes
        count = 1 + len(modes)
        lagged = place.current_lag > 0
        size = 2 * count + lagged
        read = np.zeros(size)
        read[:count] = [1.0, *(mode[2] for mode in modes)]
        turn = [2 * np.pi * mode[0] for mode in modes]
        motion, drive = np.zeros((size, size)), np.zeros(size)
        motion[np.arange(count), count + np.arange(count)] = 1.0
        spring = [place.position_stiffness / mass, *(omega**2 for omega in turn)]
        loss = [place.damping / mass, *(2 * m[1] * w for m, w in zip(modes, turn, strict=True))]
        motion[np.arange(count, 2 * count), np.arange(count)] = np.negative(spring)
        motion[np.arange(count, 2 * count), np.arange(count, 2 * count)] = np.negative(loss)
        pushed = read[:count] / mass
        if lagged:
            motion[count : 2 * count, -1] = pushed
            motion[-1, -1] = -1 / place.current_lag
            drive[-1] = 1 / place.current_lag
        else:
            drive[count : 2 * count] = pushed
        return cls(motion=motion, drive=drive, read=read, speed=count)

    def held(self, time: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """(Φ, Γ) of x(t) = Φ·x(0) + Γ·F under a constant force, for times of any shape, s."""
        size = len(self.drive)
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = self.motion
        matrix[:size, size] = self.drive
        matrix = matrix * np.asarray(time)[..., None, None]
        # The exponential of a matrix, by scaling and squaring.
        norm = float(np.abs(matrix).sum(axis=-1).max(initial=0.5))
        halvings = max(0, int(np.ceil(np.log2(2 * norm))))
        scaled = matrix / 2.0**halvings
        term = np.broadcast_to(np.eye(size + 1), matrix.shape)
        total = term.copy()
        for order in range(1, _TAYLOR):
            term = term @ scaled / order
            total = total + term
        for _ in range(halvings):
            total = total @ total
        return total[..., :size, :size], total[..., :size, size]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledLoop:
    """A device with its law from one sample to the next, as z[k+1] = pushed·z[k] or free·z[k].

    The law acts in ``pushed`` and commands nothing in ``free``, (..., states, states). Its force is
    command·z, the reading read·z. The state z is the plant's, then the commands under way, the
    newest first, then what the law remembers.
    """

    plant: Mechanism
    pushed: FloatArray
    free: FloatArray
    command: FloatArray
    read: FloatArray
    under_way: slice
    remembered: slice

    @classmethod
    def of(
        cls,
        place: Corner,
        filters: Filters,
        values: Sequence[float],
        *,
        lengths: FloatArray | float = 1.0,
    ) -> SampledLoop:
        """The loop of a device; its delay is counted in steps and parts of a step.

        ``values`` are K, B and M of the law, 0 for none; the filters are made for the sample time;
        ``lengths`` of true steps in sample times have the shape of the transitions.
        """
        plant = Mechanism.of(place)
        law = law_states(filters, place.sample_time, *values)
        delay_samples = place.delay / place.sample_time
        samples = int(np.floor(delay_samples + _NO_FRACTION))
        fraction = delay_samples - samples
        fraction = fraction if fraction > _NO_FRACTION else 0.0
        under_way = samples + (fraction > 0)
        time = np.asarray(place.sample_time * lengths)
        size, start = len(plant.drive), len(plant.drive) + under_way
        states = start + len(law.update)

        read = np.zeros(states)
        read[:size] = plant.read
        command = np.zeros(states)
        command[start:] = law.command
        command += law.direct * read

        last = plant.held((1 - fraction) * time)
        transition = np.zeros((*time.shape, states, states))
        transition[..., :size, :size] = last[0]
        if fraction:
            first = plant.held(fraction * time)
            transition[..., :size, :size] = last[0] @ first[0]
            transition[..., :size, size + samples] = (last[0] @ first[1][..., None])[..., 0]
        for older in range(1, under_way):
            transition[..., size + older, size + older - 1] = 1.0
        transition[..., start:, start:] = law.update
        transition[..., start:, :] += law.drive[:, None] * read
        pushed = transition.copy()
        if samples:
            transition[..., :size, size + samples - 1] = last[1]
            pushed[..., :size, size + samples - 1] = last[1]
        else:
            pushed[..., :size, :] += last[1][..., None] * command
        if under_way:
            pushed[..., size, :] += command
        return cls(
            plant=plant,
            pushed=pushed,
            free=transition,
            command=command,
            read=read,
            under_way=slice(size, start),
            remembered=slice(start, states),
        )

    def moving(self, reading: FloatArray, advance: float) -> FloatArray:
        """States of the law, (states, n), before readings (n,) that rise evenly by ``advance``."""
        update = self.free[self.remembered, self.remembered]
        drive = (self.free @ self.read)[self.remembered] / (self.read @ self.read)
        left = np.eye(len(drive)) - update
        at_rest = np.asarray(np.linalg.solve(left, drive), dtype=np.float64)
        behind = np.asarray(np.linalg.solve(left, at_rest * advance), dtype=np.float64)
        return at_rest[:, None] * reading - behind[:, None]


#: Samples beyond which half a period of the device on a spring is no bounce off a wall.
_LONGEST_CONTACT = 5_000
#: Places between two samples at which the element is entered, evenly up to a whole sample.
_PHASES = 8
#: Samples after which a device that is still inside has stayed.
_FOLLOWED = 20_000
#: Samples computed at once, at least and at most.
_FEWEST, _MOST = 32, 1024


def restitution(
    device: Device, box: Box, filters: Filters, values: tuple[float, float], *, one_sided: bool
) -> tuple[float, float] | None:
    """Least and largest speed out of an element over that in; None where it is no bounce.

    Over the corners of the box and the places between two samples at which it is entered. Between
    those it is continuous; the largest difference between neighbours is added on both sides. That
    no device inside the box is beyond its corners is not proved.
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
    return max(0.0, found.min() - beside), found.max() + beside


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
    if len(plant.drive) > 2 * plant.speed:  # the last state is the force of the actuator
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
