"""Walls, dampers and masses as they are played, on devices integrated exactly between samples.

Force is held from sample to sample, so a device with lag, one vibration mode and a hand moves by
the matrix exponential of its equations of motion: there is no step size. Members run side by side.
Nothing of the loops, estimators or simulators under test is used.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tests.wall_axis import Axis, Mechanism, equations_of_motion, held_motion

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Given = TypeVar("Given", Axis, "Law")


@dataclass(frozen=True, kw_only=True)
class Law:
    """What the controller plays, each field a scalar or of shape (members,).

    Force is -clamp(K·φ(y) + θ₁·B·v + θ₂·M·a) - N·a. ``wall`` plays
    -clamp(max(0, K·y + θ₁·B·v + θ₂·M·a)) while y > 0 and nothing outside.

    Attributes:
        stiffness: K, slope of φ.
        damping: B.
        mass: M.
        steady_mass: N, never switched and outside wall and clamp.
        velocity_pole: of the filter behind the backward difference.
        acceleration_pole: of the two filters behind two backward differences.
        one_sided: φ is zero for y < 0.
        slot: m, φ is zero up to here.
        wall: pushes only, and only inside.
        peak: N, of the clamp.
    """

    stiffness: float | Array = 0.0
    damping: float | Array = 0.0
    mass: float | Array = 0.0
    steady_mass: float | Array = 0.0
    velocity_pole: float | Array = 0.0
    acceleration_pole: float | Array = 0.0
    one_sided: float | Array = 0.0
    slot: float | Array = 0.0
    wall: float | Array = 0.0
    peak: float | Array = np.inf


def stacked(given: Given, members: int) -> Given:
    """Every field with shape (members,)."""
    return type(given)(
        **{
            each.name: np.broadcast_to(np.asarray(getattr(given, each.name), float), members)
            for each in fields(given)
        }
    )


@dataclass(frozen=True, kw_only=True)
class State:
    """Of all members: plant (members, n), forces under way (members, L), the rest (members,).

    Attributes:
        plant: positions, then velocities, then the force behind the lag.
        forces: commanded, the latest first.
        last: reading.
        speed: estimate of the velocity.
        first: velocity behind the first filter of the acceleration.
        second: estimate of the acceleration.
        waiting: periods missed since the last reading.
    """

    plant: Array
    forces: Array
    last: Array
    speed: Array
    first: Array
    second: Array
    waiting: NDArray[np.intp]

    def flat(self) -> Array:
        """One row a member, of all that the next sample depends on."""
        estimates = [self.last, self.speed, self.first, self.second]
        return np.concatenate([self.plant, self.forces, np.stack(estimates, axis=1)], axis=1)


class Gate(Protocol):
    """Opens dampers and masses: θ₁ and θ₂ in [0, 1], each of shape (members,), at sample k."""

    def __call__(self, k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
        """Told B·v and M·a of this sample; ``bench.state`` is still that before it."""
        ...


def open_gate(k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
    """Everything is felt all the time."""
    return np.ones_like(damper), np.ones_like(inertia)


class Bench:
    """Devices under their laws, one sample after another.

    Attributes:
        axis: the devices.
        law: what is played on them.
        members: how many.
        places: of forces under way that are kept; more than the longest delay.
        state: where they are.
    """

    def __init__(self, axis: Axis, law: Law, members: int = 1, *, places: int = 0) -> None:
        self.axis, self.law, self.members = stacked(axis, members), stacked(law, members), members
        self.time = np.asarray(self.axis.sample_time)
        self._delay = np.asarray(self.axis.delay_samples)
        self.places = places or int(np.max(self._delay)) + 3
        self.mechanism = Mechanism.of(self.axis)
        self._matrix, self._drive, push, self.reading = equations_of_motion(
            self.axis, self.mechanism
        )
        self.motion, self._fall = held_motion(self._matrix, push, self.time)
        self._on_time = self.arriving(0.0)
        self.start(0.0, 0.0)

    def start(self, position: float | Array, velocity: float | Array) -> None:
        """Free and unforced until now, with the estimates of such a motion."""
        zero = np.zeros(self.members)
        v = zero + velocity
        plant = np.zeros(self.reading.shape)
        plant[:, 0] = position
        plant[:, self.reading.shape[1] // 2] = v
        self.state = State(
            plant=plant,
            forces=np.zeros((self.members, self.places)),
            last=plant[:, 0] - v * self.time,
            speed=v,
            first=v,
            second=zero,
            waiting=np.zeros(self.members, dtype=np.intp),
        )

    def arriving(self, late: float | Array) -> Array:
        """What every force under way does over one sample if it comes so many samples later."""
        delay = self._delay + late
        whole = np.floor(delay + 1e-12).astype(int)
        part = np.clip(delay - whole, 0.0, None) * self.time
        early = held_motion(self._matrix, self._drive, part)[1]
        after, fresh = held_motion(self._matrix, self._drive, self.time - part)
        into = np.zeros((self.members, self.motion.shape[1], self.places))
        row = np.arange(self.members)
        into[row, :, whole] = fresh
        into[row, :, whole + 1] += np.einsum("ijk,ik->ij", after, early)
        return into

    def pace(self) -> Array:
        """Velocity at the encoder."""
        count = self.motion.shape[1] // 2
        plant = self.state.plant
        return np.einsum("ij,ij->i", self.reading[:, :count], plant[:, count : 2 * count])

    def command(self, y: Array, damper: Array, inertia: Array) -> Array:
        """Force asked for."""
        law = self.law
        side = np.where(law.one_sided, 0.0, np.minimum(y + law.slot, 0.0))
        spring = law.stiffness * (np.maximum(y - law.slot, 0.0) + side)
        inside = np.where(y > 0, np.maximum(law.stiffness * y + damper + inertia, 0.0), 0.0)
        total = np.where(law.wall, inside, spring + damper + inertia)
        return -np.clip(total, -law.peak, law.peak)

    def step(
        self,
        k: int,
        gate: Gate = open_gate,
        *,
        push: float | Array = 0.0,
        arriving: Array | None = None,
        missed: Mask | None = None,
    ) -> Array:
        """Goes on by one sample; returns the force commanded, shape (members,).

        Args:
            k: number of the sample, for the gate.
            gate: of dampers and masses.
            push: N at the hand, until the next sample.
            arriving: as `arriving`, where a sample comes later than the device's own delay.
            missed: members whose controller misses this period: the force before stands, and the
                next reading is joined to the last by a straight line.
        """
        s, law = self.state, self.law
        y = np.einsum("ij,ij->i", self.reading, s.plant)
        speed, first, second = self._estimates(y)
        damper, inertia = law.damping * speed, law.mass * second
        gates = gate(k, self, damper, inertia)
        force = self.command(y, gates[0] * damper, gates[1] * inertia) - law.steady_mass * second
        state = replace(
            s,
            last=y,
            speed=speed,
            first=first,
            second=second,
            waiting=np.zeros(self.members, dtype=np.intp),
        )
        if missed is not None:
            force, state = np.where(missed, s.forces[:, 0], force), _missing(missed, s, state)
        forces = np.concatenate([force[:, None], s.forces[:, :-1]], axis=1)
        plant = (
            (self.motion @ s.plant[:, :, None])[:, :, 0]
            + ((self._on_time if arriving is None else arriving) @ forces[:, :, None])[:, :, 0]
            + self._fall * np.broadcast_to(push, self.members)[:, None]
        )
        self.state = replace(state, plant=plant, forces=forces)
        return force

    def _estimates(self, y: Array) -> tuple[Array, Array, Array]:
        """Velocity, velocity behind one filter of the acceleration, acceleration."""
        s, p, q = self.state, self.law.velocity_pole, self.law.acceleration_pole
        rate = (y - s.last) / ((1 + s.waiting) * self.time)
        speed, first, second = s.speed, s.first, s.second
        for passed in range(1 + int(np.max(s.waiting))):
            then = speed, first, second
            speed = rate + p * (speed - rate)
            first = rate + q * (first - rate)
            turn = (first - then[1]) / self.time
            second = turn + q * (second - turn)
            if passed:
                now = passed <= s.waiting
                speed, first, second = (
                    np.where(now, new, old)
                    for new, old in zip((speed, first, second), then, strict=True)
                )
        return speed, first, second


def _missing(missed: Mask, before: State, now: State) -> State:
    """The estimates before, for members whose period was missed."""
    kept = {
        name: np.where(missed, getattr(before, name), getattr(now, name))
        for name in ("last", "speed", "first", "second")
    }
    return replace(now, **kept, waiting=np.where(missed, before.waiting + 1, 0))
