"""Dynamics of a simulated device from one sample to the next: a rigid mass, or a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.field import Field
from datasets_synthetic.hand import Hand
from datasets_synthetic.motion import Drag, Stride, advance
from datasets_synthetic.rig import Rig
from datasets_synthetic.timetable import Part

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Loads:
    """Unlogged forces, held over each sample, N (N·m), shape (n, batch); None for none.

    Attributes:
        device: on the rigid coordinate.
        handle: of a hand, besides its mass, damper and spring.
    """

    device: FloatArray | None
    handle: FloatArray | None


class Dynamics(Protocol):
    """A batch of devices in motion; every array shape (batch,)."""

    def rate(self) -> FloatArray:
        """The fastest rate that the steps of a timetable resolve, 1/s, shape (batch,)."""
        ...

    def begin(self, sample: int) -> None:
        """The unlogged forces are now those of this sample."""
        ...

    def move(self, acting: FloatArray, part: Part) -> None:
        """Moves on over a part of a sample, under the command in it, N (N·m), shape (batch,)."""
        ...

    def measured(self) -> FloatArray:
        """Where the encoder is, m (rad), shape (batch,)."""
        ...

    def state(self) -> FloatArray:
        """All that moves, shape (..., batch), to be copied before it moves on."""
        ...

    def seen(self, states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place and speed of the handle and the energy of all, in many states.

        Args:
            states: shape (n, ..., batch).

        Returns:
            m (rad), m/s (rad/s) and J, each shape (n, batch): energy of motion, springs and
            gravity, the hand's included.
        """
        ...


class RigidDynamics:
    """A rigid mass with friction, in a field or free; see motion.py."""

    __slots__ = ("_drag", "_forces", "_mass", "_offset", "_resisted", "_state", "_strides")

    def __init__(
        self, rig: Rig, hand: Hand, loads: Loads, position: FloatArray, velocity: FloatArray
    ) -> None:
        column = partial(per_member, batch=position.size)
        self._mass = column(rig.mass) + column(hand.mass)
        self._drag = _drag(rig, hand, self._mass)
        self._offset = column(rig.force_offset) - column(hand.stiffness) * column(hand.rest)
        there = [load for load in (loads.device, loads.handle) if load is not None]
        self._forces = sum(there[1:], start=there[0]) if there else None
        self._resisted = self._offset
        self._state = np.stack((position, velocity))
        self._strides: dict[int, Stride | None] = {}

    def rate(self) -> FloatArray:
        """The fastest rate that the steps of a timetable resolve, 1/s, shape (batch,)."""
        return self._drag.fastest()

    def begin(self, sample: int) -> None:
        """The unlogged forces are now those of this sample."""
        if self._forces is not None:
            self._resisted = self._offset - self._forces[sample]

    def move(self, acting: FloatArray, part: Part) -> None:
        """Moves on over a part of a sample, under the command in it, N (N·m), shape (batch,)."""
        pull = (acting - self._resisted) / self._mass
        stride = self._stride(part)
        alone = stride is None or self._drag.turning is not None
        for _ in range(part.steps if alone else 1):
            self._state = advance(self._state, pull, self._drag, part.step, stride)

    def measured(self) -> FloatArray:
        """Where the encoder is, m (rad), shape (batch,)."""
        return self._state[0]

    def _stride(self, part: Part) -> Stride | None:
        """The steps of a part as a linear map; None where every part differs or none is linear."""
        if part.kind is None:
            return None
        if part.kind not in self._strides:
            together = part.steps if self._drag.turning is None else 1
            self._strides[part.kind] = Stride.of(self._drag, together, part.step)
        return self._strides[part.kind]

    def state(self) -> FloatArray:
        """Position and velocity, shape (2, batch)."""
        return self._state

    def seen(self, states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place and speed of the handle and the energy of all, shape (n, batch) each.

        The states have shape (n, 2, batch).
        """
        place, speed = states[:, 0], states[:, 1]
        energy = 0.5 * self._mass * speed**2
        field = self._drag.field
        return place, speed, energy if field is None else energy + self._mass * field.stored(place)


def _drag(rig: Rig, hand: Hand, mass: FloatArray) -> Drag:
    """Friction and field of the device with the hand on it, per unit of their common mass."""
    column = partial(per_member, batch=mass.size)
    return Drag.of(
        mass=mass,
        damping=column(rig.damping) + column(hand.damping),
        coulomb_friction=column(rig.coulomb_friction),
        damping_asymmetry=column(rig.damping_asymmetry),
        coulomb_asymmetry=column(rig.coulomb_asymmetry),
        field=Field.of(
            mass=mass,
            stiffness=column(rig.stiffness) + column(hand.stiffness),
            gravity_sine=column(rig.gravity_sine),
            gravity_cosine=column(rig.gravity_cosine),
        ),
    )
