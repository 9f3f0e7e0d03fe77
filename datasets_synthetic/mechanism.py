"""The law of motion of a mechanism with vibration modes, current lag and a hand on its handle.

Coordinates q0 (rigid) and qi (one a mode), g = (1, e1, ..), p = (1, h1, ..):

    M·q'' + C·q' + K·q = g·Fa + p·Fp + (F0, 0, ..),    M = m·1 + mh·pp',
    C = diag(b, 2·z·w·m, ..) + bh·pp',    K = diag(k, w²·m, ..) + kh·pp',

Fa of the actuator, Fp of a hand besides its impedance, F0 on the rigid coordinate (friction, force
offset). The current loop makes Fa follow the command with tc·Fa' + Fa = F.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.hand import Hand
from datasets_synthetic.rig import Rig

FloatArray = NDArray[np.float64]

#: Inputs held over each part of a sample: command F, force F0 and force Fp.
INPUTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """Matrices of a batch; the state is (q, q', Fa), then come the three inputs.

    Attributes:
        mass: M, kg (kg·m²), shape (batch, n, n).
        damping: C, N·s/m (N·m·s/rad), shape (batch, n, n).
        stiffness: K, N/m (N·m/rad), shape (batch, n, n).
        at_encoder: g, without unit, shape (batch, n).
        at_handle: p, without unit, shape (batch, n).
        lag: tc, s, shape (batch,).
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    at_encoder: FloatArray
    at_handle: FloatArray
    lag: FloatArray

    @classmethod
    def of(cls, rig: Rig, hand: Hand, batch: int, *, damping: FloatArray) -> Mechanism:
        """The mechanism of a rig, its rigid damping given (N·s/m, shape (batch,))."""
        column = partial(per_member, batch=batch)
        mass, one = column(rig.mass), np.ones(batch)
        omegas = [2 * np.pi * column(mode.frequency_hz) for mode in rig.modes]
        ratios = [column(mode.damping_ratio) for mode in rig.modes]
        g = np.stack([one, *(column(mode.at_encoder) for mode in rig.modes)], axis=1)
        p = np.stack([one, *(column(mode.at_handle) for mode in rig.modes)], axis=1)
        lossy = [2 * z * w * mass for z, w in zip(ratios, omegas, strict=True)]
        return cls(
            mass=_matrix([mass] * g.shape[1], column(hand.mass), p),
            damping=_matrix([damping, *lossy], column(hand.damping), p),
            stiffness=_matrix(
                [column(rig.stiffness), *(w * w * mass for w in omegas)],
                column(hand.stiffness),
                p,
            ),
            at_encoder=g,
            at_handle=p,
            lag=column(rig.current_lag),
        )

    @property
    def coordinates(self) -> int:
        """Number of coordinates n."""
        return self.at_encoder.shape[1]

    @property
    def states(self) -> int:
        """Number of states: coordinates, their speeds and the actuator's force."""
        return 2 * self.coordinates + 1

    def free(self) -> FloatArray:
        """G of dz/dt = G·z with z = (q, q', Fa, F, F0, Fp), shape (batch, size, size)."""
        return self._generator(first=0)

    def held(self) -> FloatArray:
        """The matrices of `free` while the rigid coordinate does not move, in the same shape."""
        return self._generator(first=1)

    def holding(self) -> FloatArray:
        """Row L: L·z is the force that would have to hold the rigid coordinate, shape (batch, z).

        That is what pulls at it less what the other coordinates take up, with q0' = q0'' = 0.
        """
        n, held = self.coordinates, self.held()
        row = self._forces()[:, 0, :].copy()
        row -= np.einsum("bj,bjz->bz", self.mass[:, 0, :], held[:, n : 2 * n, :])
        return row

    def energy(self, state: FloatArray) -> FloatArray:
        """Energy, hand included, J, shape (n, batch); state (n, states, batch)."""
        n = self.coordinates
        q, v = state[:, :n], state[:, n : 2 * n]
        twice = np.einsum("tib,bij,tjb->tb", v, self.mass, v)
        return 0.5 * (twice + np.einsum("tib,bij,tjb->tb", q, self.stiffness, q))

    def _forces(self) -> FloatArray:
        """Rows of g·Fa + p·Fp + (F0, 0, ..) - C·q' - K·q, shape (batch, n, size)."""
        n, batch = self.coordinates, self.lag.size
        rows = np.zeros((batch, n, self.states + INPUTS))
        rows[:, :, :n] = -self.stiffness
        rows[:, :, n : 2 * n] = -self.damping
        slow = (self.lag > 0)[:, None]
        rows[:, :, 2 * n] = np.where(slow, self.at_encoder, 0.0)
        rows[:, :, 2 * n + 1] = np.where(slow, 0.0, self.at_encoder)
        rows[:, 0, 2 * n + 2] = 1.0
        rows[:, :, 2 * n + 3] = self.at_handle
        return rows

    def _generator(self, first: int) -> FloatArray:
        """G with the coordinates before ``first`` held in place."""
        n, batch = self.coordinates, self.lag.size
        size = self.states + INPUTS
        law = np.zeros((batch, size, size))
        moving = range(first, n)
        law[:, moving, [n + place for place in moving]] = 1.0
        law[:, n + first : 2 * n, :] = np.linalg.solve(
            self.mass[:, first:, first:], self._forces()[:, first:, :]
        )
        pace = np.divide(1.0, self.lag, out=np.zeros(batch), where=self.lag > 0)
        law[:, 2 * n, 2 * n] = -pace
        law[:, 2 * n, 2 * n + 1] = pace
        return law


def _matrix(diagonal: list[FloatArray], hand: FloatArray, p: FloatArray) -> FloatArray:
    """diag + hand·pp', shape (batch, n, n)."""
    matrix = hand[:, None, None] * p[:, :, None] * p[:, None, :]
    place = np.arange(p.shape[1], dtype=np.intp)
    matrix[:, place, place] += np.stack(diagonal, axis=1)
    return matrix
