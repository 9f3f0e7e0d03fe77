"""Simulated logs of random axes with known friction and gravity terms, and how large each is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Faults, Rig, Servo, simulate
from identification import Trajectory

FloatArray = NDArray[np.float64]

STEP = 0.001  # s
SAMPLES = 10_000
#: A term that is there is at least this part of the rms force; smaller ones are drawn again.
SMALLEST = 0.03
#: Drawn for each log wanted of a kind, as some have a term below SMALLEST.
_SPARE = 1.4


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownAxis:
    """One log and its truth.

    Attributes:
        trajectory: the log.
        delay: s.
        rotary: motion of the axis.
        shares: rms of each term that is there over the rms of the force; sine and cosine of
            gravity together as "gravity".
        reach: half the range of the motion, m or rad.
    """

    trajectory: Trajectory
    delay: float
    rotary: bool
    shares: dict[str, float]
    reach: float


def known_axes(count: int, seed: int) -> list[KnownAxis]:
    """Half linear axes, half rotary ones, each following its own multisine for 10 s at 1 kHz.

    Mass 0.05 to 20 kg or 1e-4 to 1 kg·m², m/b 0.1 to 3 s, half range 0.02 to 0.2 m or 0.2 to
    3 rad, off centre; each of Coulomb friction, offset, direction-dependent damping and a force of
    position is there in half of them, 3 to some 30 % of the rms force; encoder 5e-6 to 5e-4 of the
    half range, with noise; unlogged force of 0.1 to 5 % white and 0.1 to 2 % slow; 0 to 2 samples
    of delay. The force of position is gravity in half of the rotary axes that move 1 rad or more.
    """
    linear = _drawn(int(_SPARE * count), seed, rotary=False)
    rotary = _drawn(int(_SPARE * count), seed + 1, rotary=True)
    chosen = [*linear[: count - count // 2], *rotary[: count // 2]]
    assert len(chosen) == count
    return chosen


def _drawn(count: int, seed: int, *, rotary: bool) -> list[KnownAxis]:
    generator = np.random.default_rng(seed)

    def between(low: float, high: float) -> FloatArray:
        return low * (high / low) ** generator.random(count)

    def half() -> NDArray[np.bool_]:
        return generator.random(count) < 0.5

    mass = between(1e-4, 1.0) if rotary else between(0.05, 20.0)
    damping = mass / between(0.1, 3.0)
    reach = between(0.2, 3.0) if rotary else between(0.02, 0.2)
    position = reach[:, None] * (
        _waves(generator, count) + generator.uniform(-0.5, 0.5, (count, 1))
    )
    velocity = np.gradient(position, STEP, axis=1)
    acceleration = np.gradient(velocity, STEP, axis=1)
    smooth = mass[:, None] * acceleration + damping[:, None] * velocity

    def sized(present: NDArray[np.bool_]) -> FloatArray:
        return present * between(0.04, 0.3) * _rms(smooth)

    def signed(size: FloatArray) -> FloatArray:
        return size * generator.choice([-1.0, 1.0], count)

    coulomb, offset = sized(half()), signed(sized(half()))
    asymmetry = np.clip(signed(sized(half())) / _rms(velocity), -0.8 * damping, 0.8 * damping)
    placed = half()
    swings = placed & half() & (reach >= 1.0) & rotary
    stiffness = sized(placed & ~swings) / _rms(position)
    phase = generator.uniform(0, 2 * np.pi, (count, 1))
    gravity = sized(swings) / _rms(np.sin(position + phase))
    delay = STEP * generator.choice([0, 1, 2], count)
    count_size = reach * between(5e-6, 5e-4)
    rig = Rig(
        mass=mass,
        damping=damping,
        sample_time=STEP,
        coulomb_friction=coulomb,
        force_offset=offset,
        damping_asymmetry=asymmetry,
        stiffness=stiffness,
        gravity_sine=gravity * np.cos(phase[:, 0]),
        gravity_cosine=gravity * np.sin(phase[:, 0]),
        delay=delay,
        encoder_resolution=count_size,
        motion="rotary" if rotary else "linear",
    )
    speed = 2 * np.pi * 6  # rad/s, of the servo
    servo = Servo(
        reference=position,
        stiffness=mass * speed**2,
        damping=1.4 * mass * speed,
        velocity_filter_hz=60.0,
    )
    faults = Faults(
        position_noise=count_size * generator.uniform(0.2, 1.0, count),
        force_noise=between(1e-3, 5e-2) * _rms(smooth),
        coloured_force=between(1e-3, 2e-2) * _rms(smooth),
        correlation_time=between(0.01, 1.0),
    )
    # The servo brakes the velocity; the feed-forward gives back what it takes from the path's.
    feed = smooth + 1.4 * mass[:, None] * speed * velocity
    logged = simulate(
        rig, feed, controller=servo, faults=faults, seed=seed, position=position[:, 0]
    )
    sizes = {
        "coulomb_friction": coulomb,
        "force_offset": np.abs(offset),
        "damping_asymmetry": np.abs(asymmetry) * _rms(velocity),
        "position_stiffness": stiffness * _rms(logged.position),
        "gravity": gravity * _rms(np.sin(logged.position + phase)),
    }
    total = _rms(logged.force)
    axes = [
        KnownAxis(
            trajectory=logged.trajectory(index),
            delay=float(delay[index]),
            rotary=rotary,
            shares={
                name: float(size[index] / total[index])
                for name, size in sizes.items()
                if size[index] > 0
            },
            reach=float(reach[index]),
        )
        for index in range(count)
    ]
    return [axis for axis in axes if min(axis.shares.values(), default=1.0) >= SMALLEST]


def _waves(generator: np.random.Generator, count: int) -> FloatArray:
    """Multisines of 0.2 to 8 Hz and peak 1 that rise from rest, shape (count, SAMPLES)."""
    time = np.arange(SAMPLES) * STEP
    frequency = np.geomspace(0.2, 8.0, 16)[:, None]
    rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time, 1.0))
    waves: list[FloatArray] = []
    for _ in range(count):
        phase = generator.uniform(0, 2 * np.pi, (16, 1))
        slope = generator.uniform(0.8, 1.5)
        lines = np.cos(2 * np.pi * frequency * time + phase) / frequency**slope
        wave = np.sum(lines, axis=0) * rise
        waves.append(wave / np.max(np.abs(wave)))
    return np.stack(waves)


def _rms(series: FloatArray) -> FloatArray:
    """Along each row."""
    return np.sqrt(np.mean(series**2, axis=1))
