"""Logs of one device in four situations of noise, of any length, and the bound of each log.

The device has mass, damping, a constant force and one sample of delay; the force is held, so that
positions at the samples are exact. Nothing is shared with the estimators or with the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.signal import lfilter

from identification import Trajectory

FloatArray = NDArray[np.float64]

MASS, DAMPING, OFFSET, STEP = 3.0, 10.0, 0.1, 1e-3
#: One sample.
DELAY = STEP
TRUTH = np.array([MASS, DAMPING])
#: Lines of the force, in multiples of the first, its period in s, size of the first line, N, and
#: the power of frequency with which the others grow.
_LINES, _PERIOD, _FIRST, _GROWTH = (1, 2, 3, 5, 8, 13, 21, 34, 55), 5.0, 0.2, 0.8
#: Servo: N/m, N·s/m, Hz.
_STIFFNESS, _SERVO_DAMPING, _CUT_OFF = 4000.0, 120.0, 100.0
#: Relative step of central differences; their error is its square.
_NUDGE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What disturbs a log."""

    name: str
    servo: bool  # a servo follows the path; else the force is played in open loop
    noise: float  # standard deviation of a reading, m
    count: float = 0.0  # of the encoder, m; 0 leaves readings as they are
    push: float = 0.0  # standard deviation of a force that no log knows, held one sample, N


SITUATIONS = (
    Situation(name="open loop, white noise", servo=False, noise=2e-5),
    Situation(name="open loop, encoder of 50 µm", servo=False, noise=2.5e-6, count=5e-5),
    Situation(name="servo, noise of readings", servo=True, noise=3e-5),
    Situation(name="servo, unlogged force", servo=True, noise=3e-6, push=0.2),
)


def logs_of(situation: Situation, samples: int, seeds: range) -> list[Trajectory]:
    """One log a seed."""
    planned = _force(samples)
    path = moved(planned, MASS, DAMPING, OFFSET)
    found: list[Trajectory] = []
    for seed in seeds:
        rng = np.random.default_rng([SITUATIONS.index(situation), samples, seed])
        noise = situation.noise * rng.standard_normal(samples)
        push = situation.push * rng.standard_normal(samples)
        if situation.servo:
            force, place = _followed(path, noise, push)
        else:
            force, place = planned, moved(planned, MASS, DAMPING, OFFSET, push) + noise
        if situation.count:
            shift = situation.count * rng.uniform()  # where the count begins
            place = situation.count * np.round((place + shift) / situation.count)
        found.append(
            Trajectory(
                time=np.float64(STEP) * np.arange(samples),
                force=force,
                position=place,
                source=f"{situation.name}, {samples} samples, seed {seed}",
            )
        )
    return found


def moved(
    force: FloatArray, mass: float, damping: float, offset: float, push: FloatArray | None = None
) -> FloatArray:
    """Positions from rest under a force held from sample to sample, one sample late, m."""
    late = np.concatenate((force[:1], force[:-1])) - offset
    pushed = late if push is None else late + push
    after, driven = _model(mass, damping)
    speed = np.asarray(lfilter([0.0, driven[1, 0]], [1.0, -after[1, 1]], pushed))
    steps = after[0, 1] * speed + driven[0, 0] * pushed
    return np.concatenate(([0.0], np.cumsum(steps)[:-1]))


def bound_of(situation: Situation, log: Trajectory) -> FloatArray:
    """Least standard deviations of mass and damping of an unbiased estimate, shape (2,).

    Cramér and Rao's bound with the delay and the sizes of the noises known; constant force and
    start are estimated too. An encoder counts as white noise of its variance, count²/12.
    """
    variance = situation.noise**2 + situation.count**2 / 12

    def errors(mass: float, damping: float, offset: float) -> tuple[FloatArray, float]:
        left = log.position - moved(log.force, mass, damping, offset)
        if not situation.push:
            return left, variance
        gains, spread = _kalman(mass, damping, situation.push**2, variance)
        below = _poles(mass, damping)
        return np.asarray(lfilter(below, gains, left)), spread

    values = np.array([MASS, DAMPING, OFFSET])
    columns: list[FloatArray] = []
    logarithms: list[float] = []
    for index in range(3):
        step = _NUDGE * values[index] * np.eye(3)[index]
        (after, more), (before, less) = errors(*(values + step)), errors(*(values - step))
        columns.append((after - before) / (2 * step[index]))
        logarithms.append(float(np.log(more / less)) / (2 * step[index]))
    time = STEP * np.arange(len(log))
    start = np.stack((np.ones_like(time), -np.expm1(-DAMPING / MASS * time)))
    spread = variance
    if situation.push:
        gains, spread = _kalman(MASS, DAMPING, situation.push**2, variance)
        start = np.asarray(lfilter(_poles(MASS, DAMPING), gains, start, axis=1))
    jacobian = np.vstack((columns, start))
    size = np.linalg.norm(jacobian, axis=1)
    information = jacobian @ jacobian.T / spread
    information[:3, :3] += len(log) / 2 * np.outer(logarithms, logarithms)
    inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    return np.sqrt(np.diag(inverse)[:2])


def _model(mass: float, damping: float) -> tuple[FloatArray, FloatArray]:
    """Place and speed over one sample, shape (2, 2), and what a held force adds, shape (2, 1)."""
    rate = damping / mass
    decay, gained = float(np.exp(-rate * STEP)), float(-np.expm1(-rate * STEP) / rate)
    return (
        np.array([[1.0, gained], [0.0, decay]]),
        np.array([[(STEP - gained) / damping], [gained / mass]]),
    )


def _poles(mass: float, damping: float) -> FloatArray:
    """Denominator of the held device in falling powers of z."""
    decay = float(np.exp(-damping / mass * STEP))
    return np.array([1.0, -1 - decay, decay])


def _kalman(mass: float, damping: float, push: float, variance: float) -> tuple[FloatArray, float]:
    """Denominator of the steady innovations filter, and the variance of an innovation, m²."""
    after, driven = _model(mass, damping)
    seen = np.array([[1.0, 0.0]])
    # In units of the noise, or the equation is too far from one for its solver.
    size = np.sqrt(variance)
    scaled = np.array([[size, 0.0], [0.0, size / STEP]])
    within = np.linalg.solve(scaled, after @ scaled)
    moving = np.linalg.solve(scaled, driven)
    doubt = solve_discrete_are(
        within.T, np.array([[1.0], [0.0]]), push * moving @ moving.T, np.eye(1)
    )
    spread = 1 + float(doubt[0, 0])
    gain = within @ doubt[:, :1] / spread
    closed = within - gain @ seen
    return np.asarray(np.poly(closed), dtype=np.float64), spread * variance


def _force(samples: int) -> FloatArray:
    """Sines with Schroeder's phases, and what holds the constant force, N."""
    time = STEP * np.arange(samples)
    lines = np.array(_LINES)
    sizes = _FIRST * lines**_GROWTH
    phases = -np.pi * np.arange(lines.size) ** 2 / lines.size
    one = round(_PERIOD / STEP)
    angles = 2 * np.pi / _PERIOD * time[: min(one, samples), None] * lines + phases
    period = np.cos(angles) @ sizes
    return np.tile(period, -(-samples // period.size))[:samples] + OFFSET


def _followed(
    path: FloatArray, noise: FloatArray, push: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Force and readings of a servo that follows a path, shapes (n,)."""
    pole = float(np.exp(-2 * np.pi * _CUT_OFF * STEP))
    after, driven = _model(MASS, DAMPING)
    # State: place, speed, filtered speed of the error, error before, force under way.
    error = np.array([-1.0, 0.0, 0.0, 0.0, 0.0])
    filtered = (1 - pole) / STEP * (error - np.eye(5)[3]) + pole * np.eye(5)[2]
    force = _STIFFNESS * error + _SERVO_DAMPING * filtered
    step = np.zeros((5, 5))
    step[:2, :2], step[:2, 4:] = after, driven
    step[2], step[3], step[4] = filtered, error, force
    fresh = _STIFFNESS + _SERVO_DAMPING * (1 - pole) / STEP
    wanted = path - noise
    added = np.zeros((path.size, 5))
    added[:, :2] = (push - OFFSET)[:, None] * driven.T
    added[:, 2], added[:, 3], added[:, 4] = (1 - pole) / STEP * wanted, wanted, fresh * wanted
    states = np.empty((path.size, 5))
    state = np.array([path[0], 0.0, 0.0, 0.0, OFFSET])
    for k in range(path.size):
        states[k] = state
        state = step @ state + added[k]
    return states @ force + fresh * wanted, states[:, 0] + noise
