"""Logs of a motor that turns one way: its own integrator, ripple, cogging and a speed servo.

Classical Runge-Kutta steps of J·ω̇ = τ + ripple(θ) - b·ω - Fc·sign(ω) - f0 under a held torque,
for many motors at once. It shares nothing with the simulator of the project.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory

Array = NDArray[np.float64]
Run = Literal["constant-torque", "constant-speed", "speed-ramps", "torque-steps"]

RUNS: tuple[Run, ...] = ("constant-torque", "constant-speed", "speed-ramps", "torque-steps")
STEP = 1e-3
_SUBSTEPS = 4


@dataclass(frozen=True, kw_only=True)
class Motors:
    """Motors of one kind, each array of shape (motors,): kg·m², N·m·s/rad, N·m, rad/s."""

    inertia: Array
    damping: Array
    friction: Array
    offset: Array
    ripple: Array
    orders: Array
    phases: Array
    speed: Array
    count: Array
    current_noise: Array

    @classmethod
    def drawn(cls, seeds: range) -> Motors:
        """A motor for each seed: 0.03 to 0.3 s of time constant, 0.8 to 24 turns a second."""
        rows: list[list[float]] = []
        orders: list[Array] = []
        phases: list[Array] = []
        for seed in seeds:
            dice = np.random.default_rng(1000 + seed)
            inertia = 10 ** dice.uniform(-5, -3)
            damping = inertia / dice.uniform(0.03, 0.3)
            speed = 10 ** dice.uniform(np.log10(5), np.log10(150))
            friction = damping * speed * dice.uniform(0.1, 1.0)
            hold = damping * speed + friction
            rows.append(
                [
                    inertia,
                    damping,
                    friction,
                    hold * dice.uniform(-0.1, 0.1),
                    hold * 10 ** dice.uniform(-2.3, -1),
                    speed,
                    2 * np.pi / dice.choice([1000, 4096, 65536]),
                    hold * 10 ** dice.uniform(-3, -1.5),
                ]
            )
            orders.append(dice.choice([1.0, 2.0, 4.0, 6.0, 7.0, 12.0, 24.0], 3, replace=False))
            phases.append(dice.uniform(0, 2 * np.pi, 3))
        inertia, damping, friction, offset, ripple, speed, count, noise = np.array(rows).T
        return cls(
            inertia=inertia,
            damping=damping,
            friction=friction,
            offset=offset,
            ripple=ripple,
            orders=np.array(orders).T,
            phases=np.array(phases).T,
            speed=speed,
            count=count,
            current_noise=noise,
        )

    def hold(self, speed: Array) -> Array:
        """Torque that keeps a speed but for the ripple, N·m."""
        return self.damping * speed + self.friction + self.offset

    def faster(self, torque: Array, angle: Array, speed: Array) -> Array:
        """Acceleration, rad/s²."""
        ripple = (
            self.ripple / len(self.orders) * np.sum(np.sin(self.orders * angle + self.phases), 0)
        )
        drag = self.damping * speed + self.friction * np.sign(speed) + self.offset
        return (torque + ripple - drag) / self.inertia


def logs(motors: Motors, run: Run, seed: int, seconds: float = 6.0) -> list[Trajectory]:
    """One log a motor, already turning when it starts; all keep turning one way."""
    dice = np.random.default_rng(seed)
    samples = round(seconds / STEP)
    size = motors.inertia.size
    angle, speed, held = np.zeros(size), motors.speed.copy(), np.zeros(size)
    integral = motors.hold(speed)
    gain = motors.inertia / 0.05
    level = np.ones(size)
    seen, played = np.empty((samples, size)), np.empty((samples, size))
    smooth = motors.speed.copy()
    for k in range(samples):
        reading = np.round(angle / motors.count) * motors.count
        if k:
            smooth += 0.2 * ((reading - seen[k - 1]) / STEP - smooth)
        if run == "constant-torque":
            torque = motors.hold(motors.speed)
        elif run == "torque-steps":
            if k % 600 == 0:
                level = dice.uniform(0.7, 1.5, size)
            torque = motors.hold(level * motors.speed)
        else:
            swing = 0.4 * np.sin(2 * np.pi * 0.25 * k * STEP) if run == "speed-ramps" else 0.0
            error = motors.speed * (1 + swing) - smooth
            integral = integral + gain * error * STEP / 0.2
            torque = integral + gain * error
        held = torque + motors.current_noise * dice.standard_normal(size)
        seen[k], played[k] = reading, held
        h = STEP / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            a = motors.faster(held, angle, speed)
            b = motors.faster(held, angle + h / 2 * speed, speed + h / 2 * a)
            c = motors.faster(held, angle + h / 2 * (speed + h / 2 * a), speed + h / 2 * b)
            d = motors.faster(held, angle + h * (speed + h / 2 * b), speed + h * c)
            angle = angle + h * speed + h * h / 6 * (a + b + c)
            speed = speed + h / 6 * (a + 2 * b + 2 * c + d)
    assert np.all(speed > 0)
    time: Array = STEP * np.arange(samples, dtype=np.float64)
    return [
        Trajectory(
            time=time, force=played[:, i], position=seen[:, i], motion="rotary", source=f"{run} {i}"
        )
        for i in range(size)
    ]
