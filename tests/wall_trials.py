"""Many members played against walls at once: which gates open when, and whose motion grows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.wall_gates import Complex, slowest_swing, transitions
from tests.wall_play import Array, Bench, Gate, Mask

#: What a gate does. ``power`` opens while the force of the element feeds the device, ``swing``
#: while it lifts the slowest-dying swing of the loop without damper and mass.
KINDS = ("open", "shut", "telegraph", "periodic", "levels", "power", "swing")
#: Parts of a run, over which the fastest motion is compared.
WINDOWS = 4
#: A motion has ended when less than this part of the first window's energy is left.
ENDED = 1e-9


class Gates:
    """One gate a channel and member, of the kinds in `KINDS`.

    Args:
        bench: what they belong to.
        kind: index of the kind, shape (members,).
        period: samples between switches on average, or of a period.
        duty: part of the period for which a periodic gate is open.
        generator: of all that is random.
    """

    def __init__(
        self,
        bench: Bench,
        kind: NDArray[np.intp],
        *,
        period: Array,
        duty: Array,
        generator: np.random.Generator,
    ) -> None:
        self._period, self._duty, self._generator = period, duty, generator
        self._of_kind = {int(each): np.flatnonzero(kind == each) for each in np.unique(kind)}
        self._open = np.ones((2, bench.members))
        self._phase = generator.random((2, bench.members))
        self._swing = _swing(bench)

    def __call__(self, k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
        """θ of dampers and masses."""
        forces = -np.stack([damper, inertia])
        found = np.ones_like(forces)
        for kind, members in self._of_kind.items():
            found[:, members] = self._opened(KINDS[kind], members, k, bench, forces[:, members])
        return found[0], found[1]

    def _opened(
        self, kind: str, members: NDArray[np.intp], k: int, bench: Bench, forces: Array
    ) -> Array | Mask | float:
        """θ of the members whose gates are of one kind."""
        if kind in {"open", "shut"}:
            return 1.0 if kind == "open" else 0.0
        if kind == "power":
            return forces * bench.pace()[members] > 0
        if kind == "swing":
            left, lift = self._swing
            along = np.einsum("ij,ij->i", left[members], bench.state.flat()[members])
            return forces * np.real(np.conj(along) * lift[members]) > 0
        period = self._period[members]
        if kind == "periodic":
            return (k / period + self._phase[:, members]) % 1.0 < self._duty[members]
        draw = self._generator.random(forces.shape)
        if kind == "levels":
            return draw
        turned = np.where(draw < 1 / period, 1 - self._open[:, members], self._open[:, members])
        self._open[:, members] = turned
        return turned


def _swing(bench: Bench) -> tuple[Complex, Complex]:
    """Left eigenvectors of the slowest-dying swings, and what a force adds to each, turned back."""
    law = replace(bench.law, one_sided=0.0, slot=0.0, wall=0.0, peak=np.inf)
    linear = Bench(bench.axis, law, bench.members, places=bench.places)
    left, value = slowest_swing(transitions(linear, 0.0, 0.0))
    force = bench.arriving(0.0)[:, :, 0]
    width = force.shape[1]
    lift = np.einsum("ij,ij->i", left[:, :width], force) + left[:, width]
    return left, lift * np.conj(value)


class Energy:
    """J, of device, mode, hand and spring above where a constant push lets them rest.

    Args:
        bench: the members.
        push: N at the hand, from outside into a wall from y = 0, shape (members,).
    """

    def __init__(self, bench: Bench, push: Array) -> None:
        parts, law = bench.mechanism, bench.law
        count, order = parts.moved.shape[1], bench.reading.shape[1]
        self._form = np.zeros((bench.members, order, order))
        self._form[:, :count, :count] = parts.stiffness / 2
        self._form[:, count : 2 * count, count : 2 * count] = parts.mass / 2
        self._paid = np.zeros((bench.members, order))
        self._paid[:, :count] = push[:, None] * parts.held
        one_sided = (np.asarray(law.one_sided) > 0) | (np.asarray(law.wall) > 0)
        self._below = np.where(one_sided, 0.0, 1.0)
        # A spring yields from here on.
        self._bend = law.peak / np.maximum(law.stiffness, np.finfo(float).tiny)
        spring = np.asarray(law.stiffness)[:, None, None]
        stiffness = parts.stiffness + spring * parts.moved[:, :, None] * parts.moved[:, None, :]
        # Without any spring nothing may push, and any positive number will do.
        alone = np.where(push == 0, 1.0, 0.0)[:, None, None]
        sunk = np.linalg.solve(
            stiffness + alone * np.eye(count), (push[:, None] * parts.held)[:, :, None]
        )[:, :, 0]
        self._rest = push * np.einsum("ij,ij->i", parts.held, sunk) / 2

    def __call__(self, bench: Bench) -> Array:
        """Now, shape (members,)."""
        law, plant = bench.law, bench.state.plant
        y = np.einsum("ij,ij->i", bench.reading, plant)
        depth = np.maximum(y - law.slot, 0.0) + self._below * np.maximum(-y - law.slot, 0.0)
        within = np.minimum(depth, self._bend)
        kept = law.stiffness * within * (depth - within / 2)
        moving = (self._form @ plant[:, :, None])[:, :, 0] - self._paid
        return np.einsum("ij,ij->i", moving, plant) + kept + self._rest


@dataclass(frozen=True, kw_only=True)
class Played:
    """How the members moved.

    Attributes:
        energies: J, as `Energy`, largest in each part of the run, shape (WINDOWS, members).
        ratio: largest energy from one entry to the next over that before, the largest of a run.
    """

    energies: Array
    ratio: Array

    def grows(self) -> Mask:
        """Members with more energy in the last part of the run than in the part before it."""
        first, before, last = self.energies[0], self.energies[-2], self.energies[-1]
        return ~((last <= before) | (last <= ENDED * first))


def play(
    bench: Bench,
    gates: Gate,
    *,
    samples: int,
    push: float | Array = 0.0,
    lateness: float = 0.0,
    missed: float = 0.0,
    generator: np.random.Generator,
) -> Played:
    """From where the bench stands, for so many samples.

    Args:
        bench: the members, started.
        gates: of theirs.
        samples: length of the run.
        push: N at the hand, constant.
        lateness: samples by which a force may come later, each anew: 0 or this, by a coin.
        missed: chance that a period is missed, never two in a row.
        generator: of what is random.
    """
    members, pushes = bench.members, np.broadcast_to(push, bench.members)
    energy = Energy(bench, np.asarray(pushes))
    late = bench.arriving(lateness) if lateness else None
    on_time = bench.arriving(0.0)
    energies = np.zeros((WINDOWS, members))
    now, before, ratio = (np.zeros(members) for _ in range(3))
    was_inside = np.zeros(members, dtype=bool)
    for k in range(samples):
        arriving = None
        if late is not None:
            arriving = np.where((generator.random(members) < 0.5)[:, None, None], late, on_time)
        gone = None
        if missed:
            gone = (generator.random(members) < missed) & (bench.state.waiting == 0)
        bench.step(k, gates, push=push, arriving=arriving, missed=gone)
        held = energy(bench)
        part = k * WINDOWS // samples
        energies[part] = np.maximum(energies[part], held)
        inside = bench.state.last > 0
        entered = inside & ~was_inside
        counts = entered & (before > ENDED * energies[0])
        ratio = np.maximum(ratio, np.where(counts, now / np.where(counts, before, 1.0), 0.0))
        before = np.where(entered, now, before)
        now = np.where(entered, held, np.maximum(now, held))
        was_inside = inside
    return Played(energies=energies, ratio=ratio)
