"""A small exact axis for tests: mass, viscous and Coulomb friction under a held force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Axis:
    """True values, SI; scalars, or arrays of shape (runs,)."""

    mass: float | Array = 3.0
    damping: float | Array = 10.0
    coulomb: float | Array = 0.0
    offset: float | Array = 0.0
    sample_time: float = 1e-3
    delay: float = 0.0


@dataclass(frozen=True, slots=True)
class Step:
    """Travel and speed after a span of m·dv/dt + b·v = pull, by speed and by pull over mass."""

    span: Array
    travel: tuple[Array, Array]
    speed: tuple[Array, Array]

    @classmethod
    def of(cls, axis: Axis, span: Array) -> Step:
        rate = np.asarray(axis.damping) / np.asarray(axis.mass) + np.zeros_like(span)
        lossless = rate == 0
        rate = np.where(lossless, 1.0, rate)
        loss = -np.expm1(-rate * span)
        slid = np.where(lossless, span, loss / rate)
        driven = np.where(lossless, span**2 / 2, (span - loss / rate) / rate)
        return cls(span, (slid, driven), (np.where(lossless, 1.0, 1 - loss), slid))

    def moved(self, speed: Array, drive: Array) -> tuple[Array, Array]:
        travel, after = self.travel, self.speed
        return speed * travel[0] + drive * travel[1], speed * after[0] + drive * after[1]


def advance(axis: Axis, speed: Array, pull: Array, step: Step) -> tuple[Array, Array]:
    """Travel and speed over a step under a constant force less offset, with stick and slip."""
    if np.ndim(axis.coulomb) == 0 and axis.coulomb == 0:
        return step.moved(speed, pull / axis.mass)
    moving, span = np.sign(speed), step.span
    held = np.abs(pull) <= axis.coulomb
    direction = np.where(moving != 0, moving, np.where(held, 0.0, np.sign(pull)))
    net = np.where(direction == 0, 0.0, pull - axis.coulomb * direction)
    travel, end = step.moved(speed, net / axis.mass)
    crossed = (direction * end < 0) & (moving != 0)
    if crossed.any():
        rate = np.asarray(axis.damping) / np.asarray(axis.mass) + np.zeros_like(speed)
        drive = net / np.asarray(axis.mass)
        safe = np.where(crossed, -drive, 1.0)
        ratio = np.where(crossed, speed / safe, 0.0)
        slow = np.abs(rate) < 1e-12
        stop = np.where(slow, ratio, np.log1p(rate * ratio) / np.where(slow, 1.0, rate))
        stop = np.clip(stop, 0.0, span)
        first, _ = Step.of(axis, stop).moved(speed, drive)
        again = np.where(held, 0.0, np.sign(pull))
        rest = np.where(again == 0, 0.0, pull - axis.coulomb * again)
        second, late = Step.of(axis, span - stop).moved(np.zeros_like(speed), rest / axis.mass)
        travel = np.where(crossed, first + second, travel)
        end = np.where(crossed, late, end)
    return travel, end


def positions(
    axis: Axis, force: Array, *, disturbance: Array | None = None, speed: float | Array = 0.0
) -> Array:
    """Position at the start of each row, shape (samples, runs), starting at zero."""

    def law(row: int, place: Array) -> Array:
        return force[row]

    return closed_loop(axis, law, force.shape, disturbance=disturbance, speed=speed)[0]


def closed_loop(
    axis: Axis,
    law: Callable[[int, Array], Array],
    shape: tuple[int, int],
    *,
    disturbance: Array | None = None,
    speed: float | Array = 0.0,
) -> tuple[Array, Array]:
    """Position and commanded force, both (samples, runs), of a force computed from position."""
    samples, runs = shape
    step = axis.sample_time
    whole = int(np.floor(axis.delay / step + 1e-9))
    part = axis.delay / step - whole
    part = 0.0 if part < 1e-9 else part
    place = np.zeros(runs)
    rate = np.zeros(runs) + speed
    out, force = np.empty(shape), np.empty(shape)
    early, late = (Step.of(axis, np.full(runs, each * step)) for each in (part, 1 - part))
    for k in range(samples):
        out[k] = place
        force[k] = law(k, place)
        extra = -np.asarray(axis.offset) + (0.0 if disturbance is None else disturbance[k])
        if part:
            travel, rate = advance(axis, rate, force[max(k - whole - 1, 0)] + extra, early)
            place = place + travel
        travel, rate = advance(axis, rate, force[max(k - whole, 0)] + extra, late)
        place = place + travel
    return out, force


def multisine(
    generator: np.random.Generator,
    *,
    samples: int,
    runs: int,
    axis: Axis,
    travel: float = 0.05,
    peak: float = 14.0,
    lines: tuple[float, ...] = (0.2, 0.35, 0.55, 0.9, 1.4, 2.3, 3.7, 5.9, 9.5),
) -> Array:
    """Forces (samples, runs) that move a frictionless axis within ±travel and ±peak, per run."""
    time = np.arange(samples)[:, None] * axis.sample_time
    motion = np.zeros((samples, runs))
    force = np.zeros((samples, runs))
    for line in lines:
        angular = 2 * np.pi * line
        phase = generator.uniform(0, 2 * np.pi, runs)
        size = 1 / angular
        motion += size * np.sin(angular * time + phase)
        force += (
            size
            * angular
            * (
                np.asarray(axis.damping) * np.cos(angular * time + phase)
                - np.asarray(axis.mass) * angular * np.sin(angular * time + phase)
            )
        )
    scale = np.minimum(travel / np.abs(motion).max(axis=0), peak / np.abs(force).max(axis=0))
    return force * scale


def counted(position: Array, count: float | Array) -> Array:
    """What an encoder of this resolution reads."""
    return np.round(position / count) * count


def logged(
    axis: Axis,
    force: Array,
    *,
    disturbance: Array | None = None,
    speed: float = 0.0,
    count: float = 6e-6,
) -> Trajectory:
    """The log of an axis under a force, shape (samples,), and another that it does not hold."""
    push = None if disturbance is None else disturbance[:, None]
    place = positions(axis, force[:, None], disturbance=push, speed=speed)[:, 0]
    time = axis.sample_time * np.arange(force.size, dtype=np.float64)
    seen = counted(place, count) if count else place
    return Trajectory(time=time, force=force, position=seen, motion="linear")


def fleet(runs: int, seed: int, seconds: float = 8.0) -> tuple[Axis, Array, Array, Array]:
    """Devices of every size in one simulation: truth, forces and positions logged, and counts.

    50 g to 20 kg, 30 ms to 5 s of time constant, one sample time and delay of 0 to 2 samples; half
    of them with Coulomb friction and unlogged force.
    """
    generator = np.random.default_rng(seed)
    step = float(generator.choice([5e-4, 1e-3, 2e-3]))
    mass = 10 ** generator.uniform(np.log10(0.05), np.log10(20), runs)
    damping = mass * 10 ** generator.uniform(-0.7, 1.5, runs)
    plain = Axis(mass=mass, damping=damping, sample_time=step)
    samples = int(seconds / step)
    force = multisine(generator, samples=samples, runs=runs, axis=plain, travel=0.04, peak=1e9)
    size = force.std(axis=0)
    rubs = generator.integers(0, 2, runs)
    axis = Axis(
        mass=mass,
        damping=damping,
        coulomb=rubs * size * generator.uniform(0, 0.3, runs),
        offset=size * generator.normal(0, 0.02, runs),
        sample_time=step,
        delay=step * float(generator.integers(0, 3)),
    )
    force = force + axis.offset
    push = rubs * size * 1e-3 * generator.standard_normal(force.shape)
    place, counts = (
        positions(axis, force, disturbance=push),
        10 ** generator.uniform(-6.3, -4.5, runs),
    )
    return axis, force, counted(place, counts), counts
