"""Dynamics between samples: a rigid device, or one with vibration modes and a lag of its current.

A linear law is stepped by classical Runge-Kutta, many steps of which are one map of the state. With
h the first step and p the fastest rate the motion is that of a law wrong by |h·p|⁴/120; rounding
adds about one part in 1e15 a doubling. No closed form of the solution is used: the simulator shares
no algebra with what it tests, and loads no scipy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import FloatArray, Hand, Rig, per_member
from datasets_synthetic.motion import Drag, Field, Part, Stride, advance

Indices = NDArray[np.intp]


#: Largest |h·p| of the first step: relative error 0.002⁴/120 = 1.3e-13.
FIRST_STEP = 0.002


def maps(
    generator: FloatArray, duration: FloatArray, rate: FloatArray, halvings: int = 0
) -> list[FloatArray]:
    """Change of the state over a duration, over half of it, a quarter, ...

    The generator G has shape (batch, size, size), the duration (s) and the fastest rate in G (1/s)
    shape (batch,). The state after duration/2^j is z + D[j]·z; each map D has the shape of G.
    """
    turns = float(np.max(np.abs(duration * rate), initial=0.0))
    doublings = max(halvings, int(np.ceil(np.log2(max(turns / FIRST_STEP, 1.0)))))
    step = (duration / 2.0**doublings)[:, None, None]
    change = _runge_kutta(generator, step)
    found = [change]
    for _ in range(doublings):
        change = 2 * change + change @ change
        found.append(change)
    return found[::-1][: halvings + 1]


def fastest(generator: FloatArray) -> FloatArray:
    """The largest rate in the law, 1/s, shape (batch,)."""
    return np.max(np.abs(np.linalg.eigvals(generator)), axis=-1)


def _runge_kutta(generator: FloatArray, step: FloatArray) -> FloatArray:
    """One step from the unit vectors, less where they started."""
    unit = np.eye(generator.shape[-1])
    first = generator @ unit
    second = generator @ (unit + 0.5 * step * first)
    third = generator @ (unit + 0.5 * step * second)
    fourth = generator @ (unit + step * third)
    return step / 6 * (first + 2 * (second + third) + fourth)


#: Inputs held over each part of a sample: command F, force F0 and force Fp.
INPUTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """Matrices of a batch; the state is (q, q', Fa), then come the three inputs."""

    mass: FloatArray  # M, kg (kg·m²), shape (batch, n, n)
    damping: FloatArray  # C, N·s/m (N·m·s/rad), shape (batch, n, n)
    stiffness: FloatArray  # K, N/m (N·m/rad), shape (batch, n, n)
    at_encoder: FloatArray  # g, without unit, shape (batch, n)
    at_handle: FloatArray  # p, without unit, shape (batch, n)
    lag: FloatArray  # tc, s, shape (batch,)

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
                [column(rig.stiffness), *(w * w * mass for w in omegas)], column(hand.stiffness), p
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

    def holding(self) -> FloatArray:
        """Row L: L·z is the force that would have to hold the rigid coordinate, shape (batch, z).

        That is what pulls at it less what the other coordinates take up, with q0' = q0'' = 0.
        """
        n, held = self.coordinates, self.generator(held=True)
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

    def generator(self, *, held: bool) -> FloatArray:
        """G of dz/dt = G·z with z = (q, q', Fa, F, F0, Fp), shape (batch, size, size).

        With the rigid coordinate free or held in place.
        """
        n, batch, first = self.coordinates, self.lag.size, int(held)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Loads:
    """Unlogged forces, held over each sample, N (N·m), shape (n, batch)."""

    device: FloatArray  # on the rigid coordinate
    handle: FloatArray  # of a hand, besides its mass, damper and spring


class RigidDynamics:
    """A rigid mass with friction, in a field or free; see motion.py."""

    def __init__(
        self, rig: Rig, hand: Hand, loads: Loads, position: FloatArray, velocity: FloatArray
    ) -> None:
        column = partial(per_member, batch=position.size)
        self._mass = column(rig.mass) + column(hand.mass)
        self._drag = _drag(rig, hand, self._mass)
        offset = column(rig.force_offset) - column(hand.stiffness) * column(hand.rest)
        #: What resists besides drag, N, at each sample.
        self._loads = np.ascontiguousarray(offset - (loads.device + loads.handle))
        self._resisted = self._loads[0]
        self._state = np.stack((position, velocity))
        self._strides: dict[int, Stride | None] = {}

    def rate(self) -> FloatArray:
        """The fastest rate that the steps of a timetable resolve, 1/s, shape (batch,)."""
        return self._drag.fastest()

    def begin(self, sample: int) -> None:
        """The unlogged forces are now those of this sample."""
        self._resisted = self._loads[sample]

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
        """Place and speed of the handle, energy of all, (n, batch); states (n, 2, batch)."""
        place, speed = states[:, 0], states[:, 1]
        energy = 0.5 * self._mass * speed**2
        field = self._drag.field
        return place, speed, energy if field is None else energy + self._mass * field.stored(place)


def _drag(rig: Rig, hand: Hand, mass: FloatArray) -> Drag:
    """Friction and field of the device with the hand on it, per unit of their common mass."""
    column = partial(per_member, batch=mass.size)
    damping, uneven = column(rig.damping) + column(hand.damping), column(rig.damping_asymmetry)
    friction = column(rig.coulomb_friction)
    rate = rate_back = damping / mass
    turning = friction > 0
    # An asymmetry is added for motion along +position and taken off for motion along -position.
    if np.any(uneven):
        rate, rate_back = (damping + uneven) / mass, (damping - uneven) / mass
        turning = turning | (uneven != 0)
    stiffness = column(rig.stiffness) + column(hand.stiffness)
    sine, cosine = column(rig.gravity_sine) / mass, column(rig.gravity_cosine) / mass
    curved = bool(np.any(sine) or np.any(cosine))
    field = None
    if curved or np.any(stiffness):
        field = Field(stiffness=stiffness / mass, sine=sine, cosine=cosine, curved=curved)
    return Drag(
        rate=rate,
        grip=friction / mass,
        rate_back=rate_back,
        turning=turning if turning.any() else None,
        field=field,
    )


#: Largest turn of the fastest oscillation between which reversals are looked for, as a multiple of
#: the largest step of a rigid device (0.02 in motion.py), for ``simulate`` sets both together.
_REVERSAL_STEP = 15.0
#: Halvings of a step within which the motion stops or breaks away: its instant to 1.5e-8 of a step.
_HALVINGS = 26


class FlexibleDynamics:
    """A batch of mechanisms in motion."""

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
        friction = column(rig.coulomb_friction)
        forward = Mechanism.of(rig, hand, batch, damping=damping + uneven)
        backward = Mechanism.of(rig, hand, batch, damping=damping - uneven)
        self._mechanism = Mechanism.of(rig, hand, batch, damping=damping)
        self._directed = bool(np.any(uneven))
        self._turning = (friction > 0) | (uneven != 0)
        self._generators = [forward.generator(held=False)]
        if self._turning.any():
            self._generators.append(forward.generator(held=True))
        if self._directed:
            self._generators.append(backward.generator(held=False))
        self._rate = np.max([fastest(each) for each in self._generators], axis=0)
        turns = np.max(
            [np.abs(np.linalg.eigvals(each).imag).max(axis=-1) for each in self._generators], axis=0
        )
        self._cut = turns / _REVERSAL_STEP if self._turning.any() else np.zeros(batch)
        self._holding = forward.holding()
        self._grip = friction
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
        self._z[:, -2] = self._base + self._forces.device[sample]
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
        """Place and speed of the handle, energy of all, (n, batch); states (n, size, batch)."""
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
        # Which turn round or break away before that.
        direction = self._direction[members]
        turned = later[:, self._mechanism.coordinates] * direction < 0
        broke = (direction == 0) & (self._way(members, later) != 0)
        stopped = (turned | broke) & self._turning[members]
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
        pulled[:, -2] -= self._grip[members] * direction
        change = _applied(found[0][halving][members], pulled)
        stuck = np.flatnonzero(direction == 0)
        if stuck.size:
            change[stuck] = _applied(found[1][halving][members[stuck]], pulled[stuck])
        back = np.flatnonzero(direction < 0)
        if self._directed and back.size:
            change[back] = _applied(found[2][halving][members[back]], pulled[back])
        return z + change

    def _decide(self, members: Indices) -> None:
        """Stuck or which way, for members at rest."""
        self._direction[members] = self._way(members, self._z[members])

    def _way(self, members: Indices, z: FloatArray) -> FloatArray:
        """Direction in which members at rest are moved: 0 where friction holds them."""
        needed = np.einsum("bz,bz->b", self._holding[members], z)
        return np.sign(needed) * (np.abs(needed) > self._grip[members])


def _applied(change: FloatArray, state: FloatArray) -> FloatArray:
    return (change @ state[:, :, None])[:, :, 0]
