"""Devices with a mode, a lag and a hand, moved exactly under held forces by matrix exponentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Devices, each field a scalar or of shape (members,), SI.

    A mode m·q̈ + 2ζΩm·q̇ + mΩ²q moves the encoder, where the force acts, by ``at_encoder`` and the
    hand by ``at_handle``. ``lag`` is the time constant of the actuator; all members have one, or
    none.
    """

    mass: float | Array
    damping: float | Array
    sample_time: float | Array = 1e-3
    delay_samples: float | Array = 0.0
    stiffness: float | Array = 0.0
    lag: float | Array = 0.0
    mode_hz: float | Array = 50.0
    mode_damping: float | Array = 0.05
    at_encoder: float | Array = 0.0
    at_handle: float | Array = 0.0
    hand_mass: float | Array = 0.0
    hand_damping: float | Array = 0.0
    hand_stiffness: float | Array = 0.0


@dataclass(frozen=True, kw_only=True)
class Mechanism:
    """Device, mode and hand: mass, damping and stiffness, each (members, c, c), for c coordinates.

    Attributes:
        moved: what of the coordinates the encoder reads and the force drives, (members, c).
        held: what of them the hand moves with.
    """

    mass: Array
    damping: Array
    stiffness: Array
    moved: Array
    held: Array

    @classmethod
    def of(cls, axis: Axis) -> Mechanism:
        """Of fields of shape (members,); with a coordinate of the mode where any has one."""
        count = 2 if np.any(axis.at_encoder) or np.any(axis.at_handle) else 1
        one = np.ones_like(axis.mass)
        held = np.stack([one, np.asarray(axis.at_handle)], axis=1)[:, :count]
        turn = 2 * np.pi * axis.mode_hz

        def matrix(rigid: float | Array, mode: float | Array, hand: float | Array) -> Array:
            found = held[:, :, None] * held[:, None, :] * np.asarray(hand)[:, None, None]
            for place, own in enumerate((rigid, mode)[:count]):
                found[:, place, place] += own
            return found

        mode = 2 * axis.mode_damping * turn * axis.mass
        return cls(
            mass=matrix(axis.mass, axis.mass, axis.hand_mass),
            damping=matrix(axis.damping, mode, axis.hand_damping),
            stiffness=matrix(axis.stiffness, axis.mass * turn**2, axis.hand_stiffness),
            moved=np.stack([one, np.asarray(axis.at_encoder)], axis=1)[:, :count],
            held=held,
        )


def equations_of_motion(axis: Axis, mechanism: Mechanism) -> tuple[Array, Array, Array, Array]:
    """Equations of motion: states, what a force does to them, what a push does, what is read."""
    members, count = mechanism.moved.shape
    inverse = np.linalg.inv(mechanism.mass)
    lagged = bool(np.any(axis.lag))
    order = 2 * count + lagged
    moving, slow = slice(0, count), slice(count, 2 * count)
    motion = np.zeros((members, order, order))
    drive, push, reading = (np.zeros((members, order)) for _ in range(3))
    motion[:, moving, slow] = np.eye(count)
    motion[:, slow, moving] = -inverse @ mechanism.stiffness
    motion[:, slow, slow] = -inverse @ mechanism.damping
    at_encoder = np.einsum("ijk,ik->ij", inverse, mechanism.moved)
    push[:, slow] = np.einsum("ijk,ik->ij", inverse, mechanism.held)
    reading[:, moving] = mechanism.moved
    if lagged:
        motion[:, slow, -1] = at_encoder
        motion[:, -1, -1] = -1 / axis.lag
        drive[:, -1] = 1 / axis.lag
    else:
        drive[:, slow] = at_encoder
    return motion, drive, push, reading


def held_motion(motion: Array, drive: Array, span: Array) -> tuple[Array, Array]:
    """Motion over a span, and what a force held over it adds."""
    members, order = drive.shape
    both = np.zeros((members, order + 1, order + 1))
    both[:, :order, :order] = motion
    both[:, :order, order] = drive
    grown = exponential(both * span[:, None, None])
    return grown[:, :order, :order], grown[:, :order, order]


def exponential(matrices: Array) -> Array:
    """Of every matrix of a stack: Taylor's series of a small part of it, squared back."""
    size = float(np.max(np.sum(np.abs(matrices), axis=2), initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300) / 0.25))))
    small = matrices / 2.0**halvings
    grown = term = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for power in range(1, 14):
        term = term @ small / power
        grown = grown + term
    for _ in range(halvings):
        grown = grown @ grown
    return grown
