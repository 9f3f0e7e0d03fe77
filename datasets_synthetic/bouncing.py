"""Dropping a handle into a wall: the energy it brings to each contact must not grow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import simulate

FloatArray = NDArray[np.float64]

#: Growth of the energy over that of every contact before that is taken for none: what the friction
#: of a fraction of a sample, between the wall and the reading that finds it, may make of it.
GROWTH = 0.01
#: Counts of travel that an encoder may hide: energy below what the push and the spring do over
#: them is not counted.
_COUNTS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounces:
    """What each device brought to its contacts with the wall, one entry a device.

    Attributes:
        time: of the sample that found each contact, s, shape (contacts,) of each device.
        energy: of motion and springs on reaching the wall, J, the work of the push taken off;
            shape (contacts,) of each device.
        floor: energy within the resolution of the encoder, J, shape (batch,).
        grows: whether a contact had more energy than any before it, by more than ``GROWTH`` and
            the floor; also where the motion became infinite; shape (batch,).
        recording: of all of it.
    """

    time: tuple[FloatArray, ...]
    energy: tuple[FloatArray, ...]
    floor: FloatArray
    grows: NDArray[np.bool_]
    recording: Recording

    def speed(self, mass: float, member: int = 0) -> FloatArray:
        """Speed at each contact of a rigid mass of this energy, m/s (rad/s), shape (contacts,)."""
        return np.sqrt(2 * self.energy[member] / mass)

    def largest_ratio(self, member: int = 0) -> float:
        """Largest energy of a contact, less the floor, over the most of any before; 0 for none."""
        return largest_ratio(self.energy[member], self.floor[member])


def bounce(
    rig: Rig,
    controller: Controller,
    *,
    push: float | FloatArray,
    drop: float | FloatArray,
    hand: Hand | None = None,
    samples: int = 4000,
    seed: int = 0,
) -> Bounces:
    """Lets a constant push carry each handle from rest into its wall, again and again.

    Args:
        rig: the devices: delay, quantiser, friction and force limit are theirs.
        controller: effects with a wall above its face (``side`` -1).
        push: of the hand towards the wall, N (N·m), positive, a number or shape (batch,).
        drop: how far before the wall it starts, m (rad), positive, a number or shape (batch,).
        hand: whose mass, damper and spring are on the handle; its spring is relaxed at the start
            of the wall unless ``rest`` says otherwise.
        samples: of the run.
        seed: of tremor, if the hand has any.

    Raises:
        ValueError: there is no wall to fall into.
    """
    hand = hand or Hand()
    faces = [each.place for each in controller.elements if np.all(np.less(each.side, 0))]
    if not faces:
        raise ValueError("there is no wall to fall into: give the controller an element of side -1")
    batch = max(rig.batch, controller.size(), *hand.sizes(), np.size(push), np.size(drop))
    column = partial(per_member, batch=batch)
    place, pushed = column(faces[0]), column(push)
    recording = simulate(
        rig,
        np.zeros(samples),
        controller=controller,
        hand=hand,
        position=place - column(drop),
        push=np.broadcast_to(pushed[:, None], (batch, samples)),
        watch=True,
        seed=seed,
    )
    net = pushed - column(rig.force_offset)
    floor = energy_floor(net, column(rig.encoder_resolution), column(controller.total_stiffness()))
    found = [contacts(recording, k, place[k], net[k]) for k in range(batch)]
    finite = np.all(np.isfinite(recording.position), axis=1)
    more = [grows(energy, least) for (_, energy), least in zip(found, floor, strict=True)]
    return Bounces(
        time=tuple(each for each, _ in found),
        energy=tuple(each for _, each in found),
        floor=floor,
        grows=~finite | more,
        recording=recording,
    )


def energy_floor(net: FloatArray, resolution: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Energy within the resolution of the encoder, J, shape (batch,).

    Args:
        net: force in front of the wall, N (N·m), shape (batch,).
        resolution: of the encoder, m (rad), likewise.
        stiffness: of all that acts, N/m (N·m/rad), likewise.
    """
    count = _COUNTS * resolution
    return np.abs(net) * count + 0.5 * np.abs(stiffness) * count**2


def grows(energy: FloatArray, floor: float) -> bool:
    """Whether a contact had clearly more energy than any before it, J, shape (contacts,)."""
    return bool(np.any(energy[1:] > (1 + GROWTH) * _largest_before(energy) + floor))


def largest_ratio(energy: FloatArray, floor: float) -> float:
    """Largest energy of a contact, J, shape (contacts,), less the floor, over the most before.

    0 where there was one contact or none.
    """
    if energy.size < 2:
        return 0.0
    return float(np.max((energy[1:] - floor) / _largest_before(energy)))


def _largest_before(energy: FloatArray) -> FloatArray:
    """Most energy of all contacts before each but the first, J."""
    return np.maximum.accumulate(energy)[:-1]


def contacts(
    recording: Recording, member: int, place: float, net: float
) -> tuple[FloatArray, FloatArray]:
    """Time (s) of each sample that finds the wall, and the energy (J) brought there.

    This is what the handle had on reaching ``place`` (m) but for the work of the ``net`` force (N)
    beyond it, which is taken off; what a damper took before the face is gone.

    Both answers have shape (contacts,).
    """
    assert recording.truth is not None
    inside = recording.position[member] > place
    entered = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1
    truth = recording.truth
    energy = truth.energy[member][entered] - net * (truth.handle[member][entered] - place)
    return recording.instants(member)[entered], energy
