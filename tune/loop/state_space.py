"""State space of the sampled loop: matrices from one sample to the next.

A wall that is entered and left switches between two loops, and a clock that jitters between many:
both are followed in time. The state is that of the mechanism in continuous time, the commands on
their way to the actuator, and what the estimators remember.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device
from tune.loop.filters import Filters

FloatArray = NDArray[np.float64]


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
        order = filters.velocity_filter_order
        velocity = _smoothed(slope, filters.velocity_filter_hz, order, filters, T)
    if M:
        twice = np.array([1.0, -2.0, 1.0]) / T**2
        order = filters.acceleration_filter_order
        acceleration = _smoothed(twice, filters.acceleration_filter_hz, order, filters, T)
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


def _smoothed(
    difference: FloatArray, cutoff: float | None, order: int, filters: Filters, T: float
) -> tuple[FloatArray, FloatArray]:
    """(numerator, denominator) in 1/z of a difference behind its low-pass."""
    if cutoff is None:
        return difference, np.array([1.0])
    # x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]
    angle, ratio = 2 * np.pi * cutoff * T, filters.filter_damping_ratio
    if order == 1:
        t, p = float(np.exp(-angle)), 0.0
    else:
        left = np.exp(-ratio * angle)
        t = float(2 * left * np.cos(np.sqrt((1 - ratio) * (1 + ratio)) * angle))
        p = float(left**2)
    return difference * (1 - t + p), np.array([1.0, -t, p][: order + 1])


#: Taylor terms of the exponential of a matrix below one half in norm: 2^-18/18! < 1e-20.
_TAYLOR = 18
#: Parts of a sample that count as none; clocks are not better.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """One way a device may be, SI units.

    Position stiffness is the slope of its own force by position. Modes are (frequency in Hz,
    damping ratio, participation at motor and encoder) of each.
    """

    mass: float
    damping: float
    sample_time: float
    delay: float
    position_stiffness: float = 0.0
    current_lag: float = 0.0
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

    @property
    def lagged(self) -> bool:
        """Whether the last state is the force of the actuator."""
        return len(self.drive) > 2 * self.speed

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
        augmented = np.zeros((size + 1, size + 1))
        augmented[:size, :size] = self.motion
        augmented[:size, size] = self.drive
        whole = exponential(augmented * np.asarray(time)[..., None, None])
        return whole[..., :size, :size], whole[..., :size, size]


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
        whole = int(np.floor(delay_samples + _WHOLE))
        part = delay_samples - whole
        part = part if part > _WHOLE else 0.0
        under_way = whole + (part > 0)
        time = np.asarray(place.sample_time * lengths)
        size, start = len(plant.drive), len(plant.drive) + under_way
        states = start + len(law.update)

        read = np.zeros(states)
        read[:size] = plant.read
        command = np.zeros(states)
        command[start:] = law.command
        command += law.direct * read

        last = plant.held((1 - part) * time)
        transition = np.zeros((*time.shape, states, states))
        transition[..., :size, :size] = last[0]
        if part:
            first = plant.held(part * time)
            transition[..., :size, :size] = last[0] @ first[0]
            transition[..., :size, size + whole] = (last[0] @ first[1][..., None])[..., 0]
        for older in range(1, under_way):
            transition[..., size + older, size + older - 1] = 1.0
        transition[..., start:, start:] = law.update
        transition[..., start:, :] += law.drive[:, None] * read
        pushed = transition.copy()
        if whole:
            transition[..., :size, size + whole - 1] = last[1]
            pushed[..., :size, size + whole - 1] = last[1]
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


def exponential(matrix: FloatArray) -> FloatArray:
    """e^A of each matrix of a stack, shape (..., n, n), by scaling and squaring."""
    norm = float(np.abs(matrix).sum(axis=-1).max(initial=0.5))
    halvings = max(0, int(np.ceil(np.log2(2 * norm))))
    scaled = matrix / 2.0**halvings
    term = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape)
    total = term.copy()
    for order in range(1, _TAYLOR):
        term = term @ scaled / order
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total
