"""Dynamics of a mechanism with vibration modes, current lag and a hand on its handle.

Between reversals of the rigid coordinate the law is linear and its forces are held: propagation.py
gives one map for each part of a sample. With Coulomb friction, or damping that differs by
direction, a part is cut into steps short beside the fastest oscillation; a step within which the
rigid coordinate stops or breaks away is halved again and again, so that the instant is met to 2^-26
of the step (1.5e-8), and there the direction is decided anew. Two reversals within one step, at
most 0.3 rad of the fastest oscillation, pass unseen.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.dynamics import Loads
from datasets_synthetic.hand import Hand
from datasets_synthetic.mechanism import INPUTS, Mechanism
from datasets_synthetic.propagation import fastest, fastest_oscillation, maps
from datasets_synthetic.rig import Rig
from datasets_synthetic.timetable import Part

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Largest turn of the fastest oscillation between which reversals are looked for, as a multiple of
#: the largest step of a rigid device (0.02 in motion.py), for ``simulate`` sets both together.
_REVERSAL_STEP = 15.0
#: Halvings of a step within which the motion stops or breaks away: its instant to 1.5e-8 of a step.
_HALVINGS = 26


class FlexibleDynamics:
    """A batch of mechanisms in motion."""

    __slots__ = (
        "_base",
        "_cut",
        "_directed",
        "_direction",
        "_forces",
        "_generators",
        "_grip",
        "_holding",
        "_known",
        "_mechanism",
        "_push",
        "_rate",
        "_turning",
        "_z",
    )

    def __init__(
        self, rig: Rig, hand: Hand, loads: Loads, position: FloatArray, velocity: FloatArray
    ) -> None:
        batch = position.size
        column = partial(per_member, batch=batch)
        if np.any(rig.gravity_sine) or np.any(rig.gravity_cosine):
            raise ValueError(
                f"{rig.name} has gravity that turns with the position and also modes or a current "
                "lag; only one of the two is simulated: leave the modes and the lag out"
            )
        damping, uneven = column(rig.damping), column(rig.damping_asymmetry)
        friction, askew = column(rig.coulomb_friction), column(rig.coulomb_asymmetry)
        forward = Mechanism.of(rig, hand, batch, damping=damping + uneven)
        backward = Mechanism.of(rig, hand, batch, damping=damping - uneven)
        self._mechanism = Mechanism.of(rig, hand, batch, damping=damping)
        self._directed = bool(np.any(uneven))
        self._turning = (friction > 0) | (uneven != 0)
        self._generators = [forward.free()]
        if self._turning.any():
            self._generators.append(forward.held())
        if self._directed:
            self._generators.append(backward.free())
        self._rate = np.max([fastest(each) for each in self._generators], axis=0)
        turns = np.max([fastest_oscillation(each) for each in self._generators], axis=0)
        self._cut = turns / _REVERSAL_STEP if self._turning.any() else np.zeros(batch)
        self._holding = forward.holding()
        self._grip = (friction + askew, friction - askew)
        self._base = -column(rig.force_offset)
        self._push = column(hand.stiffness) * column(hand.rest)
        self._forces = loads
        self._known: dict[int, list[list[FloatArray]]] = {}
        n = self._mechanism.coordinates
        self._z = np.zeros((batch, self._mechanism.states + INPUTS))
        self._z[:, 0], self._z[:, n] = position, velocity
        self._z[:, -2], self._z[:, -1] = self._base, self._push
        self._direction = np.where(self._turning, np.sign(velocity), 1.0)

    def rate(self) -> FloatArray:
        """The fastest rate that the steps of a timetable resolve, 1/s, shape (batch,)."""
        return self._cut

    def begin(self, sample: int) -> None:
        """The unlogged forces are now those of this sample."""
        if self._forces.device is not None:
            self._z[:, -2] = self._base + self._forces.device[sample]
        if self._forces.handle is not None:
            self._z[:, -1] = self._push + self._forces.handle[sample]

    def move(self, acting: FloatArray, part: Part) -> None:
        """Moves on over a part of a sample, under the command in it, N (N·m), shape (batch,)."""
        self._z[:, -3] = acting
        found = self._maps(part)
        if not self._turning.any():
            for _ in range(part.steps):
                self._z += _applied(found[0][0], self._z)
            return
        everyone: Indices = np.arange(self._turning.size, dtype=np.intp)
        self._decide(np.flatnonzero(self._turning & (self._direction == 0)))
        for _ in range(part.steps):
            self._slide(everyone, 0, found)

    def measured(self) -> FloatArray:
        """Where the encoder is, m (rad), shape (batch,)."""
        weights = self._mechanism.at_encoder
        return np.einsum("bi,bi->b", weights, self._z[:, : weights.shape[1]])

    def state(self) -> FloatArray:
        """Coordinates, their speeds, the actuator's force and what acts, shape (size, batch)."""
        return self._z.T

    def seen(self, states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place and speed of the handle and the energy of all, shape (n, batch) each.

        The states have shape (n, size, batch).
        """
        n, at_handle = self._mechanism.coordinates, self._mechanism.at_handle
        place = np.einsum("bi,tib->tb", at_handle, states[:, :n])
        speed = np.einsum("bi,tib->tb", at_handle, states[:, n : 2 * n])
        return place, speed, self._mechanism.energy(states)

    def _maps(self, part: Part) -> list[list[FloatArray]]:
        """Maps of one step of a part, by law and halving; alike parts are computed once."""
        if part.kind is not None and part.kind in self._known:
            return self._known[part.kind]
        halvings = _HALVINGS if self._turning.any() else 0
        found = [maps(law, part.step, self._rate, halvings) for law in self._generators]
        if part.kind is not None:
            self._known[part.kind] = found
        return found

    def _slide(self, members: Indices, halving: int, found: list[list[FloatArray]]) -> None:
        """Moves members on by one step/2^halving, through any stops and starts."""
        later = self._after(members, halving, found)
        stopped = self._interrupted(members, later)
        calm = members[~stopped]
        self._z[calm] = later[~stopped]
        rest = members[stopped]
        if rest.size == 0:
            return
        if halving < _HALVINGS:
            self._slide(rest, halving + 1, found)
            self._slide(rest, halving + 1, found)
            return
        self._z[rest] = later[stopped]
        self._z[rest, self._mechanism.coordinates] = 0.0
        self._decide(rest)

    def _after(self, members: Indices, halving: int, found: list[list[FloatArray]]) -> FloatArray:
        """State one step/2^halving later if the direction of each member stays as it is."""
        z, direction = self._z[members], self._direction[members]
        pulled = z.copy()
        pulled[:, -2] -= np.where(
            direction > 0, self._grip[0][members], -self._grip[1][members]
        ) * np.abs(direction)
        change = _applied(found[0][halving][members], pulled)
        stuck = np.flatnonzero(direction == 0)
        if stuck.size:
            change[stuck] = _applied(found[1][halving][members[stuck]], pulled[stuck])
        back = np.flatnonzero(direction < 0)
        if self._directed and back.size:
            change[back] = _applied(found[2][halving][members[back]], pulled[back])
        return z + change

    def _interrupted(self, members: Indices, later: FloatArray) -> NDArray[np.bool_]:
        """Which members turn round or break away before ``later``."""
        direction = self._direction[members]
        turned = later[:, self._mechanism.coordinates] * direction < 0
        broke = (direction == 0) & (self._way(members, later) != 0)
        return (turned | broke) & self._turning[members]

    def _decide(self, members: Indices) -> None:
        """Stuck or which way, for members at rest."""
        self._direction[members] = self._way(members, self._z[members])

    def _way(self, members: Indices, z: FloatArray) -> FloatArray:
        """Direction in which members at rest are moved: 0 where friction holds them."""
        needed = np.einsum("bz,bz->b", self._holding[members], z)
        forward, backward = (grip[members] for grip in self._grip)
        return np.where(needed > forward, 1.0, np.where(needed < -backward, -1.0, 0.0))


def _applied(change: FloatArray, state: FloatArray) -> FloatArray:
    return (change @ state[:, :, None])[:, :, 0]
