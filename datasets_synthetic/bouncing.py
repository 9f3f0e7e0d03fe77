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
        energy = self.energy[member]
        if energy.size < 2:
            return 0.0
        return float(np.max((energy[1:] - self.floor[member]) / _largest_before(energy)))


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
        controller: effects behind a wall (``Controller.wall``).
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
    wall = controller.wall
    if wall is None or np.any(np.isinf(wall.place)):
        raise ValueError("there is no wall to fall into: give the controller a wall at a place")
    batch = max(rig.batch, controller.size(), *hand.sizes(), np.size(push), np.size(drop))
    column = partial(per_member, batch=batch)
    place, pushed = column(wall.place), column(push)
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
    return bounces(
        recording,
        place=place,
        net=pushed - column(rig.force_offset),
        resolution=column(rig.encoder_resolution),
        stiffness=column(controller.total_stiffness()),
    )


def bounces(
    recording: Recording,
    *,
    place: FloatArray,
    net: FloatArray,
    resolution: FloatArray,
    stiffness: FloatArray,
) -> Bounces:
    """What handles that were watched brought to their walls.

    Args:
        recording: of all of it.
        place: of each wall, m (rad), shape (batch,).
        net: force towards the wall in front of it, N (N·m), likewise.
        resolution: of the encoder, m (rad), likewise.
        stiffness: of all that acts behind the wall, N/m (N·m/rad), likewise.
    """
    members = range(recording.batch)
    with np.errstate(over="ignore", invalid="ignore"):
        count = _COUNTS * resolution
        floor = np.abs(net) * count + 0.5 * np.abs(stiffness) * count**2
        found = [contacts(recording, member, place[member], net[member]) for member in members]
        finite = np.all(np.isfinite(recording.position), axis=1)
        energy = tuple(each for _, each in found)
        grows = [
            not finite[member]
            or bool(np.any(each[1:] > (1 + GROWTH) * _largest_before(each) + floor[member]))
            for member, each in enumerate(energy)
        ]
    return Bounces(
        time=tuple(each for each, _ in found),
        energy=energy,
        floor=floor,
        grows=np.array(grows),
        recording=recording,
    )


def _largest_before(energy: FloatArray) -> FloatArray:
    """Most energy of all contacts before each but the first, J."""
    return np.maximum.accumulate(energy)[:-1]


def contacts(
    recording: Recording, member: int, place: float, net: float
) -> tuple[FloatArray, FloatArray]:
    """Time (s) of each sample that finds the wall, and the energy (J) brought there.

    Until then the wall gives no force, so this is what the handle had on reaching ``place`` (m) but
    for the work of the ``net`` force (N) beyond it, which is taken off.

    Both answers have shape (contacts,).
    """
    assert recording.truth is not None
    inside = recording.position[member] > place
    entered = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1
    truth = recording.truth
    energy = truth.energy[member][entered] - net * (truth.handle[member][entered] - place)
    return recording.instants(member)[entered], energy
