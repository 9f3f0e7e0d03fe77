"""Lasting cycles of a device against a wall, sought as linear programs.

A spring F = -φ(y) with slope in [0, K] can play the forces f over one period of readings y exactly
when f and y - f/K, sorted alike, never fall. A damper gated by θ in [0, 1] can play u beside a
velocity v exactly when u lies between 0 and B·v. Once the order of the readings and the signs of
the velocities are guessed, from a sine, all of this is linear in the forces: a solution is a wall
and a gate under which the device never comes to rest, no matter what proof says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from tests.wall_play import Array, Bench

Complex = NDArray[np.complex128]


def responses(bench: Bench, member: int, z: Complex) -> tuple[Complex, Complex, Complex]:
    """Reading over force at z, and the estimates of velocity and acceleration over the reading."""
    law, step = bench.law, bench.time[member]
    order = bench.motion.shape[1]
    into = bench.arriving(0.0)[member]
    forced = z[:, None] ** -np.arange(bench.places) @ into.T
    pencil = z[:, None, None] * np.eye(order) - bench.motion[member]
    plant = np.linalg.solve(pencil, forced[:, :, None])[:, :, 0] @ bench.reading[member]
    rate = (1 - 1 / z) / step
    p, q = np.asarray(law.velocity_pole)[member], np.asarray(law.acceleration_pole)[member]
    return plant, (1 - p) * rate / (1 - p / z), ((1 - q) * rate / (1 - q / z)) ** 2


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """One period, each of shape (N,): reading, force of the spring, the damper and the mass."""

    reading: Array
    spring: Array
    damper: Array
    inertia: Array


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A period of ``samples`` with so many ``turns`` of the sine that gives orders and signs.

    Attributes:
        samples: N.
        turns: in one period.
        phase: rad, of the sine at the first sample.
        lead: rad, by which the sign of the velocity leads its linear response.
    """

    samples: int
    turns: int = 1
    phase: float = 0.3
    lead: float = 0.0


def cycle(bench: Bench, member: int, gain: float, guess: Guess) -> Cycle | None:
    """A lasting cycle under ``gain`` times the effects of the law, if the guess has one."""
    law, count = bench.law, guess.samples
    K, B, M = (
        gain * float(np.asarray(each)[member]) for each in (law.stiffness, law.damping, law.mass)
    )
    z = np.exp(2j * np.pi * np.arange(count) / count)
    z[0] = np.exp(1e-3j)  # the mean of the force is zero, that of the reading anything
    plant, speed, acceleration = (
        np.where(np.arange(count) > 0, each, 0.0) for each in responses(bench, member, z)
    )
    gates = [each for each in ((1, B, speed), (2, M, acceleration)) if each[1] > 0]
    rows = np.tile(-_circulant(plant), 1 + len(gates))
    sine = np.exp(
        1j * (2 * np.pi * guess.turns / count * np.arange(count) + guess.phase),
    )
    order = np.argsort(np.real(sine), kind="stable")
    own = np.eye(rows.shape[1])
    spring = own[order]
    below = [np.diff(spring, axis=0), np.diff(rows[order] - spring / K, axis=0)]
    size = spring[-1] - spring[0]
    for place, (_, limit, transfer) in enumerate(gates, start=1):
        lead = np.angle(transfer[guess.turns]) + guess.lead
        sign = np.where(np.real(sine * np.exp(1j * lead)) >= 0, 1.0, -1.0)[:, None]
        force = own[place * count : (place + 1) * count]
        below += [sign * force, sign * (limit * _circulant(transfer) @ rows - force)]
        size = size + np.sum(sign * force, axis=0)
    matrix = np.concatenate(below)
    found = linprog(
        np.zeros(matrix.shape[1]),
        A_ub=-matrix / np.max(np.abs(matrix), axis=1, keepdims=True),
        b_ub=np.zeros(len(matrix)),
        A_eq=np.stack([np.ones(matrix.shape[1]), size]),
        b_eq=[0.0, 1.0],
        bounds=(None, None),
        method="highs",
    )
    if found.x is None:
        return None
    forces = np.zeros((3, count))
    parts = np.split(found.x, 1 + len(gates))
    for which, part in zip((0, *(each[0] for each in gates)), parts, strict=True):
        forces[which] = part
    return Cycle(reading=rows @ found.x, spring=forces[0], damper=forces[1], inertia=forces[2])


def _circulant(transfer: Complex) -> Array:
    """Periodic convolution with a response given at the roots of unity."""
    impulse = np.real(np.fft.ifft(transfer))
    count = len(transfer)
    return impulse[(np.arange(count)[:, None] - np.arange(count)[None, :]) % count]
