"""Many members played against walls at once: which gates open when, and whose motion grows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.wall_gates import transitions
from tests.wall_play import Array, Bench, Mask

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
        self._kind = np.broadcast_to(kind, (2, bench.members))
        self._open = np.ones((2, bench.members))
        self._phase = generator.random((2, bench.members))
        self._swing = _swing(bench) if np.any(kind == KINDS.index("swing")) else None

    def __call__(self, k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
        """θ of dampers and masses."""
        forces = -np.stack([damper, inertia])
        draw = self._generator.random(forces.shape)
        self._open = np.where(draw < 1 / self._period, 1 - self._open, self._open)
        turn = (k / self._period + self._phase) % 1.0
        lifts = np.zeros(bench.members)
        if self._swing is not None:
            left, lift = self._swing
            lifts = (np.conj(np.einsum("ij,ij->i", left, bench.state.flat())) * lift).real
        choices = [
            np.ones_like(forces),
            np.zeros_like(forces),
            self._open,
            (turn < self._duty) * 1.0,
            draw,
            (forces * bench.pace() > 0) * 1.0,
            (forces * lifts > 0) * 1.0,
        ]
        found = np.choose(self._kind, choices)
        return found[0], found[1]


def _swing(bench: Bench) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Left eigenvectors of the slowest-dying swings, and what a force adds to each, turned back."""
    law = replace(bench.law, one_sided=0.0, slot=0.0, wall=0.0, peak=np.inf)
    linear = Bench(bench.axis, law, bench.members, places=bench.places)
    values, vectors = np.linalg.eig(np.swapaxes(transitions(linear, 0.0, 0.0), 1, 2))
    slow = np.argmax(np.abs(values) * (np.abs(values.imag) > 1e-9), axis=1)
    row = np.arange(bench.members)
    left, value = vectors[row, :, slow], values[row, slow]
    force = bench.arriving(0.0)[:, :, 0]
    width = force.shape[1]
    lift = np.einsum("ij,ij->i", left[:, :width], force) + left[:, width]
    return left, lift * np.conj(value)


def energy(bench: Bench, push: float | Array) -> Array:
    """J, of the rigid mass at the encoder's speed, in the spring and under the push, above rest.

    The clamp is taken for a clamp of the spring: the potential of what pulls the device back. Hands
    and modes keep some that is not counted.
    """
    law, y = bench.law, bench.state.plant[:, 0]
    both = np.where(np.asarray(law.one_sided) + law.wall > 0, 0.0, 1.0)
    # A spring keeps part of the potential; what the push pays is counted outside the walls.
    depth = np.maximum(y - law.slot, 0.0) + both * np.maximum(-y - law.slot, 0.0)
    bend = np.asarray(law.peak) / np.where(law.stiffness == 0, 1.0, law.stiffness)
    within = np.minimum(depth, bend)
    kept = law.stiffness * within * (depth - within / 2)
    paid = np.broadcast_to(push, bench.members) * y
    lowest = -(np.square(push) / np.where(law.stiffness == 0, np.inf, 2 * law.stiffness)) - push * law.slot
    return bench.axis.mass * bench.pace() ** 2 / 2 + kept - paid - lowest


@dataclass(frozen=True, kw_only=True)
class Played:
    """How the members moved.

    Attributes:
        energies: J, as `energy`, largest in each part of the run, shape (WINDOWS, members).
        contacts: how often each entered y > 0.
        ratio: largest energy from one entry to the next over that before, the largest of a run.
        largest_force: N, commanded.
    """

    energies: Array
    contacts: NDArray[np.intp]
    ratio: Array
    largest_force: Array

    def grows(self, floor: float = 0.0) -> Mask:
        """Members with more energy in the last part of the run than in the part before it."""
        first, before, last = self.energies[0], self.energies[-2], self.energies[-1]
        calm = last <= (1 + floor) * before
        return ~(calm | (last <= ENDED * first))


def play(
    bench: Bench,
    gates: Gates,
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
    members = bench.members
    late = bench.arriving(lateness) if lateness else None
    on_time = bench.arriving(0.0)
    energies = np.zeros((WINDOWS, members))
    contacts = np.zeros(members, dtype=np.intp)
    now, before, ratio, largest = (np.zeros(members) for _ in range(4))
    was_inside = np.zeros(members, dtype=bool)
    for k in range(samples):
        arriving = None
        if late is not None:
            arriving = np.where((generator.random(members) < 0.5)[:, None, None], late, on_time)
        gone = None
        if missed:
            gone = (generator.random(members) < missed) & (bench.state.waiting == 0)
        force = bench.step(k, gates, push=push, arriving=arriving, missed=gone)
        held = energy(bench, push)
        part = k * WINDOWS // samples
        energies[part] = np.maximum(energies[part], held)
        inside = bench.state.last > 0
        entered = inside & ~was_inside
        counts = entered & (before > ENDED * energies[0])
        ratio = np.maximum(ratio, np.where(counts, now / np.where(counts, before, 1.0), 0.0))
        before = np.where(entered, now, before)
        now = np.where(entered, held, np.maximum(now, held))
        contacts += entered
        was_inside = inside
        largest = np.maximum(largest, np.abs(force))
    return Played(energies=energies, contacts=contacts, ratio=ratio, largest_force=largest)
