"""Devices of several axes as simulation truth: coupled masses, dampers and dry friction by axis.

Between samples the coupled law is linear and stepped by its own map, as in ``dynamics.py``; where a
velocity turns or an axis sticks, small steps decide friction as a complementarity problem (Moreau's
time stepping: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.dynamics import fastest, maps
from datasets_synthetic.motion import Encoder
from identification import Trajectories, Trajectory

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]
#: Force of each axis from what its encoder reads, N (N·m), shape (batch, axes) both.
Law = Callable[[int, FloatArray], FloatArray]

#: Halvings of a part of a sample in which something turns: its instant to 1/16 000 of it.
_HALVINGS = 14
#: Sweeps of Gauss and Seidel for the friction of all axes in one small step.
_SWEEPS = 60
#: A delay this part of a sample off a whole number of samples is that number.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class RigOfAxes:
    """A batch of devices of several axes; arrays of shape (batch, ...), read from left to right.

    Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay), with the friction of each axis its own; an axis that
    is at rest stays there as long as friction can hold it.

    Attributes:
        mass: Λ, kg (kg·m²), shape (batch, axes, axes), symmetric and positive definite.
        damping: D, N·s/m (N·m·s/rad), of the same shape, symmetric.
        sample_time: T, s.
        delay: from command to action, s, of all axes.
        coulomb_friction: Fc, N (N·m), shape (batch, axes).
        force_offset: f0, N (N·m), shape (batch, axes).
        encoder_resolution: one count, m (rad), shape (axes,); 0 means no rounding.
        position_noise: standard deviation of a reading, m (rad).
    """

    mass: FloatArray
    damping: FloatArray
    sample_time: float
    delay: float = 0.0
    coulomb_friction: FloatArray | float = 0.0
    force_offset: FloatArray | float = 0.0
    encoder_resolution: FloatArray | float = 0.0
    position_noise: float = 0.0

    def run(
        self,
        force: FloatArray,
        *,
        law: Law | None = None,
        start: FloatArray | float = 0.0,
        speed: FloatArray | float = 0.0,
        seed: int = 0,
    ) -> Motions:
        """What is commanded and read over n samples.

        Args:
            force: N (N·m), shape (batch, n, axes); the whole command without a law, added to it
                with one.
            law: gives what a controller adds at sample k for the readings of all axes.
            start: positions at t = 0, m (rad), broadcast to (batch, axes).
            speed: velocities at t = 0, likewise.
            seed: of the noise of readings.
        """
        batch, samples, axes = force.shape
        whole = int(np.floor(self.delay / self.sample_time + _WHOLE))
        late = max(self.delay - whole * self.sample_time, 0.0)
        late = 0.0 if late < _WHOLE * self.sample_time else late
        parts = [(late, whole + 1), (self.sample_time - late, whole)]
        strides = [(_Stride.of(self, span), ago) for span, ago in parts if span > 0]
        friction = np.broadcast_to(self.coulomb_friction, (batch, axes)).astype(np.float64)
        offset = np.broadcast_to(self.force_offset, (batch, axes))
        counts = np.broadcast_to(self.encoder_resolution, (axes,)).astype(np.float64)
        encoder, chance = Encoder(counts), np.random.default_rng(seed)
        state = np.zeros((batch, 2 * axes))
        state[:, :axes], state[:, axes:] = start, speed
        commands = np.zeros((whole + 1 + samples, batch, axes))
        readings, truth = np.empty((2, samples, batch, axes))
        speeds = np.empty_like(truth)
        for k in range(samples):
            truth[k], speeds[k] = state[:, :axes], state[:, axes:]
            noise = self.position_noise * chance.standard_normal((batch, axes))
            readings[k] = encoder.read(truth[k] + noise)
            added = 0.0 if law is None else law(k, readings[k])
            commands[whole + 1 + k] = force[:, k] + added
            for stride, ago in strides:
                acting = commands[whole + 1 + k - ago] - offset
                state = stride.moved(state, acting, friction)
        return Motions(
            sample_time=self.sample_time,
            force=np.moveaxis(commands[whole + 1 :], 0, 1),
            position=np.moveaxis(readings, 0, 1),
            truth=np.moveaxis(truth, 0, 1),
            speed=np.moveaxis(speeds, 0, 1),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Motions:
    """What a batch of devices was commanded and did; arrays of shape (batch, n, axes).

    Attributes:
        sample_time: s.
        force: commanded, N (N·m).
        position: as encoders read it, m (rad).
        truth: true position, m (rad).
        speed: true velocity, m/s (rad/s).
    """

    sample_time: float
    force: FloatArray
    position: FloatArray
    truth: FloatArray
    speed: FloatArray

    def log(self, member: int = 0, axes: tuple[str, ...] = ("x", "y", "z")) -> Trajectories:
        """The log of one device. Raises LogRefusedError if it is no log."""
        time = self.sample_time * np.arange(self.force.shape[1], dtype=np.float64)
        return Trajectories(
            axes=tuple(
                Trajectory(
                    time=time,
                    force=self.force[member, :, axis],
                    position=self.position[member, :, axis],
                    axis=axes[axis],
                    motion="linear",
                    source="simulated",
                )
                for axis in range(self.force.shape[2])
            )
        )


@dataclass(frozen=True, slots=True)
class _Stride:
    """The linear law over a span, over half of it, a quarter, and so on."""

    #: changes of (q, q̇) by each of (q, q̇, force), each shape (batch, 2·axes, 3·axes)
    changes: list[FloatArray]

    @classmethod
    def of(cls, rig: RigOfAxes, span: float) -> _Stride:
        batch, axes, _ = rig.mass.shape
        law = np.zeros((batch, 3 * axes, 3 * axes))
        law[:, :axes, axes : 2 * axes] = np.eye(axes)
        law[:, axes : 2 * axes, axes : 2 * axes] = -np.linalg.solve(rig.mass, rig.damping)
        law[:, axes : 2 * axes, 2 * axes :] = np.linalg.inv(rig.mass)
        spans = np.full(batch, span, dtype=np.float64)
        found = maps(law, spans, fastest(law), _HALVINGS)
        return cls([each[:, : 2 * axes] for each in found])

    def moved(
        self,
        state: FloatArray,
        acting: FloatArray,
        friction: FloatArray,
        members: Indices | None = None,
        halving: int = 0,
    ) -> FloatArray:
        """(q, q̇) of some members after span/2^halving under held forces, through every turn."""
        members = np.arange(len(state)) if members is None else members
        later, calm = _stepped(self.changes[halving][members], state, acting, friction)
        if halving < _HALVINGS and not calm.all():
            rest = np.flatnonzero(~calm)
            half = state[rest]
            for _ in range(2):
                half = self.moved(half, acting[rest], friction[rest], members[rest], halving + 1)
            later[rest] = half
        return later


def _stepped(
    change: FloatArray, state: FloatArray, acting: FloatArray, friction: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """One step whose friction leaves no axis moving against it, and where none turned in it.

    The friction held over the step is what brings an axis to rest at its end, if that is within
    what it can give, else all of it against the motion (Gauss and Seidel, axis by axis).
    """
    axes = acting.shape[1]
    before = state[:, axes:]
    held = -friction * np.sign(before)
    slope = change[:, axes:, 2 * axes :]  # speed by force
    own = np.diagonal(slope, axis1=1, axis2=2)
    free = _after(change, state, acting)[:, axes:]
    for _ in range(_SWEEPS):
        last = held.copy()
        for axis in range(axes):
            reached = free[:, axis] + np.sum(slope[:, axis] * held, axis=1)
            wanted = held[:, axis] - reached / own[:, axis]
            held[:, axis] = np.clip(wanted, -friction[:, axis], friction[:, axis])
        if np.array_equal(last, held):
            break
    later = _after(change, state, acting + held)
    rests = np.abs(held) < friction
    later[:, axes:][rests] = 0.0
    turned = (before != 0) & (later[:, axes:] * before <= 0) & (friction > 0)
    return later, ~turned.any(axis=1)


def _after(change: FloatArray, state: FloatArray, force: FloatArray) -> FloatArray:
    return state + np.einsum("bij,bj->bi", change, np.concatenate((state, force), axis=1))
