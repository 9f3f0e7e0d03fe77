"""An axis under friction that the model lacks, integrated by means of its own.

Many devices run side by side, one per seed. Each sample is cut into SUBSTEPS: velocity is taken
implicitly through Coulomb friction (a device may stand still), everything else explicitly, and the
position by the mean of both velocities. Nothing of the simulator or of the estimators is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification import Hardware, Trajectory

FloatArray = NDArray[np.float64]
Kind = Literal["plain", "quadratic", "cubic", "stribeck", "place", "cogging", "cable", "presliding"]

T = 0.001
SUBSTEPS = 8
COUNT = 6e-6
PEAK = 28.0
SHARES = {"weak": 0.03, "middle": 0.08, "strong": 0.25}
#: rms force and speed of the motions below, from which strengths are made; N, m/s, m.
_FORCE, _SPEED, _TRAVEL = 3.6, 0.12, 0.08


@dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    """Forces beside Coulomb friction and constant damping, each against the motion, SI.

    Attributes:
        quadratic: N·s²/m², of v|v|.
        cubic: N·s³/m³, of v³.
        stribeck: N, static above sliding friction, falling over ``stribeck_speed``.
        stribeck_speed: m/s.
        place: part of the damping by which it varies with position.
        wave: m, of that and of the cogging.
        cogging: N.
        cable: N/m, of a bundle (Bouc and Wen), ...
        cable_width: m, which yields this far.
        presliding: N/m, stiffness of the friction before it slides (Dahl); 0 means at once.
    """

    quadratic: float = 0.0
    cubic: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 0.03
    place: float = 0.0
    wave: float = 0.05
    cogging: float = 0.0
    cable: float = 0.0
    cable_width: float = 0.01
    presliding: float = 0.0


def friction_of(kind: Kind, share: float) -> Friction:
    """About this share of the force outside the model."""
    force = share * _FORCE
    return {
        "plain": Friction(),
        "quadratic": Friction(quadratic=force / (1.7 * _SPEED**2)),
        "cubic": Friction(cubic=force / (3.9 * _SPEED**3)),
        "stribeck": Friction(stribeck=2.2 * force),
        "place": Friction(place=min(0.9, force * 1.41 / (10.0 * _SPEED))),
        "cogging": Friction(cogging=1.41 * force, wave=0.02),
        "cable": Friction(cable=force / 0.008, cable_width=0.01),
        "presliding": Friction(presliding=0.8 / (0.02 * share)),
    }[kind]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """One log of one device and the truth about it.

    Attributes:
        trajectory: what was logged.
        mass: kg.
        damping: N·s/m, of the constant part.
        least_slope: of friction over speed from rest to the fastest seen, falling part left out.
        greatest_slope: the largest.
        share: rms of what the model lacks over the rms of the force.
        friction: what acted.
        coulomb: N.
    """

    trajectory: Trajectory
    mass: float
    damping: float
    least_slope: float
    greatest_slope: float
    share: float
    friction: Friction
    coulomb: float


def hardware() -> Hardware:
    """What a person knows of these devices."""
    return Hardware.model_validate(
        {
            "motion": "linear",
            "sample_time": T,
            "delay": T,
            "encoder_resolution": COUNT,
            "force_limit": {"continuous": 14.0, "peak": PEAK},
        }
    )


@dataclass(slots=True, kw_only=True)
class State:
    """Of all devices at once, each of shape (devices,)."""

    position: FloatArray
    velocity: FloatArray
    bundle: FloatArray
    bristle: FloatArray


def record(
    friction: Friction, seeds: range, *, servo: bool, seconds: float = 10.0
) -> list[Recorded]:
    """Logs of devices near HomeRehab's, one for each seed."""
    chances = [np.random.default_rng((seed, 77)) for seed in seeds]
    mass = np.array([3.0 * chance.uniform(0.7, 1.3) for chance in chances])
    damping = np.array([10.0 * chance.uniform(0.7, 1.3) for chance in chances])
    coulomb = np.array([0.8 * chance.uniform(0.5, 1.5) for chance in chances])
    count = round(seconds / T)
    time: FloatArray = T * np.arange(count, dtype=np.float64)
    if servo:
        goal = np.stack([_tones(time, chance, 0.3, 4.0, power=-1.0) for chance in chances])
        goal *= _TRAVEL / np.max(np.abs(goal), axis=1, keepdims=True)
    else:
        goal = np.stack([_tones(time, chance, 0.5, 12.0, power=0.0) for chance in chances])
        goal *= 14.0 / np.max(np.abs(goal), axis=1, keepdims=True)
    zero = np.array([chance.uniform(-0.5, 0.5) for chance in chances])
    force, position, extra = _run(friction, mass, damping, coulomb, goal, zero, servo=servo)
    logs: list[Recorded] = []
    for row in range(len(seeds)):
        reading = np.rint(position[row] / COUNT + zero[row]) * COUNT
        speed = np.diff(position[row]) / T
        least, greatest = _slopes(friction, damping[row], float(np.max(np.abs(speed))))
        acting = extra[row]
        logs.append(
            Recorded(
                trajectory=Trajectory(
                    time=time,
                    force=force[row],
                    position=reading,
                    reference=goal[row] if servo else None,
                    source=f"log {seeds[row]}",
                ),
                mass=float(mass[row]),
                damping=float(damping[row]),
                least_slope=least,
                greatest_slope=greatest,
                share=float(np.std(acting) / np.std(force[row])),
                friction=friction,
                coulomb=float(coulomb[row]),
            )
        )
    return logs


def _tones(
    time: FloatArray, chance: np.random.Generator, low: float, high: float, *, power: float
) -> FloatArray:
    frequencies = np.geomspace(low, high, 14)
    phases = chance.uniform(0, 2 * np.pi, frequencies.size)
    waves = np.sin(2 * np.pi * np.outer(frequencies, time) + phases[:, None])
    fade = np.minimum(1.0, np.minimum(time, time[-1] - time) / 0.3)
    return (frequencies**power) @ waves * fade


def _run(
    friction: Friction,
    mass: FloatArray,
    damping: FloatArray,
    coulomb: FloatArray,
    goal: FloatArray,
    offset: FloatArray,
    *,
    servo: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force commanded, true position and force of friction outside the model, each (devices, n)."""
    devices, count = goal.shape
    zero = np.zeros(devices)
    state = State(
        position=zero.copy(), velocity=zero.copy(), bundle=zero.copy(), bristle=zero.copy()
    )
    forces, positions, extras = (np.zeros((devices, count)) for _ in range(3))
    step = T / SUBSTEPS
    acting = zero
    slow, last = zero.copy(), np.rint(offset) * COUNT
    for k in range(count):
        positions[:, k] = state.position
        if servo:
            reading = np.rint(state.position / COUNT + offset) * COUNT
            slow += 0.12 * ((reading - last) / T - slow)
            last = reading
            rate = (goal[:, k] - goal[:, k - 1]) / T if k else zero
            command = 3000.0 * (goal[:, k] - reading) + 90.0 * (rate - slow)
            command = np.clip(command, -PEAK, PEAK)
        else:
            command = goal[:, k]
        forces[:, k] = command
        mean = zero
        for _ in range(SUBSTEPS):
            extra = advance(state, friction, mass, damping, coulomb, acting, step)
            mean = mean + extra / SUBSTEPS
        extras[:, k] = mean
        acting = command  # one sample of delay
    return forces, positions, extras


def advance(
    state: State,
    friction: Friction,
    mass: FloatArray,
    damping: FloatArray,
    coulomb: FloatArray,
    force: FloatArray,
    step: float,
) -> FloatArray:
    """One substep; returns the force of friction outside the model."""
    v, x = state.velocity, state.position
    extra = friction.quadratic * v * np.abs(v) + friction.cubic * v**3
    hold = coulomb
    if friction.stribeck:
        hold = coulomb + friction.stribeck * np.exp(-((v / friction.stribeck_speed) ** 2))
        extra = extra + (hold - coulomb) * np.sign(v)
    if friction.place:
        extra = extra + friction.place * damping * v * np.sin(2 * np.pi * x / friction.wave)
    if friction.cogging:
        extra = extra + friction.cogging * np.sin(2 * np.pi * x / friction.wave)
    if friction.cable:
        extra = extra + friction.cable * state.bundle
    if friction.presliding:
        extra = extra + coulomb * (state.bristle - np.sign(v))
        push = force - damping * v - coulomb * state.bristle
        moved = v + step * push / mass
    else:
        smooth = extra - (hold - coulomb) * np.sign(v)
        free = v + step * (force - damping * v - smooth) / mass
        moved = np.sign(free) * np.maximum(np.abs(free) - step * hold / mass, 0.0)
    travel = step * (v + moved) / 2
    if friction.cable:
        width = friction.cable_width
        sense = np.sign(travel * state.bundle)
        state.bundle = state.bundle + travel * (
            1 - (0.5 + 0.5 * sense) * (state.bundle / width) ** 2
        )
    if friction.presliding:
        rate = friction.presliding * np.abs(travel) / coulomb
        state.bristle = np.sign(travel) + (state.bristle - np.sign(travel)) * np.exp(-rate)
        state.bristle = np.clip(state.bristle, -1.0, 1.0)
    state.velocity = moved
    state.position = x + travel
    return extra


def _slopes(friction: Friction, damping: float, fastest: float) -> tuple[float, float]:
    """Least and greatest slope of friction over speed, falling friction left out."""
    speed = np.linspace(0.0, fastest, 400)
    slope = damping + 2 * friction.quadratic * speed + 3 * friction.cubic * speed**2
    return (
        float(slope.min()) - friction.place * damping,
        float(slope.max()) + friction.place * damping,
    )
