"""The sampled loop as matrices from one sample to the next, for what polynomials cannot follow.

A wall that is entered and left switches between two loops, and a clock that jitters between many:
both are followed in time. The state is that of the mechanism in continuous time, the commands on
their way to the actuator, and what the estimators remember.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.loop.filters import Filters

FloatArray = NDArray[np.float64]

#: Taylor terms of the exponential of a matrix below one half in norm: 2^-18/18! < 1e-20.
_TAYLOR = 18
#: Parts of a sample that count as none; clocks are not better.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A mechanism in continuous time, x' = motion·x + drive·F, reading = read·x.

    x is the positions of the rigid mass and of each mode, their speeds and, with a lag, the force
    of the actuator.

    Attributes:
        motion: shape (states, states), 1/s.
        drive: of the command, shape (states,).
        read: of the encoder, shape (states,).
        speed: index of the rigid mass's speed.
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
    def of(
        cls,
        *,
        mass: float,
        damping: float,
        position_stiffness: float = 0.0,
        current_lag: float = 0.0,
        modes: tuple[tuple[float, float, float], ...] = (),
    ) -> Plant:
        """A device without a hand, SI units.

        Args:
            mass: kg.
            damping: N·s/m.
            position_stiffness: slope of the device's own force by position, N/m.
            current_lag: time constant of the actuator, s.
            modes: (frequency in Hz, damping ratio, participation at motor and encoder) of each.
        """
        count = 1 + len(modes)
        lagged = current_lag > 0
        size = 2 * count + lagged
        read = np.zeros(size)
        read[:count] = [1.0, *(mode[2] for mode in modes)]
        turn = [2 * np.pi * mode[0] for mode in modes]
        motion, drive = np.zeros((size, size)), np.zeros(size)
        motion[np.arange(count), count + np.arange(count)] = 1.0
        spring = [position_stiffness / mass, *(omega**2 for omega in turn)]
        loss = [damping / mass, *(2 * m[1] * w for m, w in zip(modes, turn, strict=True))]
        motion[np.arange(count, 2 * count), np.arange(count)] = np.negative(spring)
        motion[np.arange(count, 2 * count), np.arange(count, 2 * count)] = np.negative(loss)
        pushed = read[:count] / mass
        if lagged:
            motion[count : 2 * count, -1] = pushed
            motion[-1, -1] = -1 / current_lag
            drive[-1] = 1 / current_lag
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

    The state z is the plant's, then the commands under way, the newest first, then past readings,
    the newest first, then the two last values of each filtered estimate.

    Attributes:
        pushed: the transition while the law acts; shape (..., states, states).
        free: the transition while it commands nothing; likewise.
        command: the law's force is command·z; shape (states,).
        read: the reading is read·z; shape (states,).
        under_way: where the commands under way are.
        past: where past readings are.
        estimates: where the filtered velocity is, if any; its steady value is the speed.
    """

    pushed: FloatArray
    free: FloatArray
    command: FloatArray
    read: FloatArray
    under_way: slice
    past: slice
    estimates: slice

    @classmethod
    def of(
        cls,
        plant: Plant,
        filters: Filters,
        *,
        stiffness: float,
        damping: float,
        mass: float,
        sample_time: float,
        delay_samples: float,
        steps: FloatArray | float | None = None,
    ) -> SampledLoop:
        """The loop of a plant.

        Args:
            plant: of the device.
            filters: of velocity and acceleration, made for the sample time.
            stiffness: K of the law, N/m; 0 for none, as of the others.
            damping: B, N·s/m.
            mass: M, kg.
            sample_time: T, s.
            delay_samples: from reading to force, counted in steps and parts of a step.
            steps: true lengths of a step, s, of any shape, that of the transitions; None is T.
        """
        law = _law(filters, sample_time, stiffness, damping, mass)
        whole = int(np.floor(delay_samples + _WHOLE))
        part = delay_samples - whole
        part = part if part > _WHOLE else 0.0
        under_way = whole + (part > 0)
        time = np.asarray(sample_time if steps is None else steps, dtype=np.float64)
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
        for place in range(1, under_way):
            transition[..., size + place, size + place - 1] = 1.0
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
            pushed=pushed,
            free=transition,
            command=command,
            read=read,
            under_way=slice(size, start),
            past=slice(start, start + law.past),
            estimates=slice(start + law.past, start + law.past + law.velocities),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Law:
    """Estimates from readings: s[k+1] = update·s + drive·y, force = command·s + direct·y."""

    update: FloatArray
    drive: FloatArray
    command: FloatArray
    direct: float
    past: int
    velocities: int


def _law(filters: Filters, T: float, K: float, B: float, M: float) -> _Law:
    """States: past readings, newest first; two values of the velocity; two of the acceleration."""
    window = filters.velocity_window_samples or 1
    past = max(window if B else 0, 2 if M else 0)
    filtered = bool(B) and filters.velocity_filter_hz is not None
    smoothed = bool(M) and filters.acceleration_filter_hz is not None
    size = past + 2 * filtered + 2 * smoothed
    update, drive, command, direct = np.zeros((size, size)), np.zeros(size), np.zeros(size), -K
    update[np.arange(1, past), np.arange(past - 1)] = 1.0
    drive[: min(past, 1)] = 1.0
    place = past
    for gain, there, cutoff, order, difference in (
        (B, filtered, filters.velocity_filter_hz, filters.velocity_filter_order, (window, T)),
        (
            M,
            smoothed,
            filters.acceleration_filter_hz,
            filters.acceleration_filter_order,
            (0, T),
        ),
    ):
        if not gain:
            continue
        row = np.zeros(size)
        if difference[0]:
            row[window - 1] = -1 / (window * T)
            new = 1 / (window * T)
        else:
            row[:2] = -2 / T**2, 1 / T**2
            new = 1 / T**2
        if there and cutoff is not None:
            t, p = _section(cutoff, order, filters.filter_damping_ratio, T)
            row, new = row * (1 - t + p), new * (1 - t + p)
            row[place], row[place + 1] = t, -p
            update[place], drive[place] = row, new
            update[place + 1, place] = 1.0
            place += 2
        command -= gain * row
        direct -= gain * new
    return _Law(
        update=update,
        drive=drive,
        command=command,
        direct=direct,
        past=past,
        velocities=2 * filtered,
    )


def _section(cutoff: float, order: int, ratio: float, T: float) -> tuple[float, float]:
    """(t, p) of x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]."""
    angle = 2 * np.pi * cutoff * T
    if order == 1:
        return float(np.exp(-angle)), 0.0
    left = np.exp(-ratio * angle)
    return float(2 * left * np.cos(np.sqrt((1 - ratio) * (1 + ratio)) * angle)), float(left**2)


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
