"""The standard trials as they are played: all in one batch.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device. One
file: the trials of one batch, laid out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.bouncing import GROWTH, contacts, energy_floor, grows, largest_ratio
from datasets_synthetic.calls import Calls
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.plays import KINDS, Condition, Play
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import Simulation

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Where nothing else is stated a trial goes so many counts from the start, ...
_REACH = 1000.0
#: ... and where a few counts are asked for, so many.
_NEAR = 30.0
#: Part of the most force that leans on a wall, and with which the handle falls into it.
_FALL = 0.25
#: Part of the run after which a push is released, and over which it rises and falls.
_RELEASE, _RISE = 0.25, 0.05
#: Part of the run in which a program calls.
_CALLED = 0.35
#: Opposite walls stand so many times as far off as a trial goes where it does without them.
_FAR = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How far, how hard and how long; arrays of one value a controller, shape (batch,).

    Attributes:
        count: of the encoder, m (rad).
        reach: the long displacement, m (rad).
        limit: of force, N (N·m).
        played: samples of a short run.
    """

    count: FloatArray
    reach: FloatArray
    limit: FloatArray
    played: int

    @classmethod
    def of(
        cls,
        rig: Rig,
        batch: int,
        *,
        reach: float | FloatArray | None,
        push: float | FloatArray | None,
        duration: float,
    ) -> Sizes:
        """Sizes from what is given, or else from encoder and force limit; see ``rehearse``.

        Reach, m (rad), and push, N (N·m), are numbers or arrays of shape (batch,).
        """
        if rig.batch != 1:
            raise ValueError(f"one device is rehearsed at a time, not {rig.batch}")
        count = float(rig.encoder_resolution[0])
        if count == 0 and reach is None:
            raise ValueError(f"{rig.name} has no encoder_resolution: give it one, or a reach")
        far = per_member(_REACH * count if reach is None else reach, batch)
        limit = per_member(float(rig.force_limit[0]) if push is None else push, batch)
        if not np.all(np.isfinite(limit)):
            raise ValueError(f"{rig.name} has no force_limit: give it one, or a push")
        return cls(
            count=per_member(count, batch) if count > 0 else far / _REACH,
            reach=far,
            limit=limit,
            played=round(duration / float(rig.sample_time[0])),
        )

    @property
    def batch(self) -> int:
        """Number of controllers."""
        return self.count.size

    @property
    def called(self) -> int:
        """Samples in which a program calls."""
        return round(_CALLED * self.played)


class Trials:
    """Trials of a batch of controllers, played up to some sample and then on.

    Attributes:
        pushed: whether something pushes to the end, or steady travel is no fault for another
            reason, shape (plays,).
    """

    __slots__ = (
        "_called",
        "_falls",
        "_net",
        "_resolution",
        "_run",
        "_stiffness",
        "_until",
        "pushed",
    )

    def __init__(
        self,
        controller: Controller,
        conditions: Sequence[Condition],
        sizes: Sizes,
        plays: Sequence[Play],
        *,
        samples: int,
        seeds: Sequence[int],
    ) -> None:
        """Ready to start, with so many samples at most."""
        member = np.array([each.member for each in plays], dtype=np.intp)
        where = np.array([each.place for each in plays], dtype=np.intp)
        kinds = [KINDS[each.name] for each in plays]

        def of(name: str) -> FloatArray:
            return np.array([getattr(kind, name) for kind in kinds], dtype=np.float64)

        rigs = Rig.batch_of([each.rig for each in conditions]).members(where)
        rows, reach = controller.rows(member), sizes.reach[member]
        # What springs give where they are cut, or all that the device can.
        levels = np.sum(np.where(rows["stiffness"] > 0, rows["level"], 0.0), axis=0)
        limit = np.minimum(sizes.limit[member], np.where(levels > 0, levels, np.inf))
        near, falls, called = _NEAR * sizes.count[member], of("falls") > 0, of("called") > 0
        walled: Mask = np.any(rows["side"], axis=0)
        faced: Mask = np.any(rows["side"] > 0, axis=0)
        opposite = np.max(np.where(rows["side"] > 0, rows["place"], -np.inf), axis=0)
        start = of("reaches") * reach + of("nears") * near
        start = np.where(called, np.where(faced, opposite / 2, -reach), start)
        # As fast as the fall from there; a few counts are gained at a walk.
        step = float(rigs.sample_time[0])
        fast = np.sqrt(2 * _FALL * limit * reach / rigs.mass)
        speed = np.where(called, fast, of("walks") * near / (_RISE * sizes.played * step))
        leans = np.where(called, walled & ~faced, walled | falls | (of("dampers") > 0))
        steady: FloatArray = _FALL * limit * leans
        part = np.arange(samples) / sizes.played
        pulse = np.clip(np.minimum(part, _RELEASE - part) / _RISE, 0.0, 1.0)
        self._until, self._called, self._falls = sizes.called, called, np.flatnonzero(falls)
        self._net, self._stiffness = steady - rigs.force_offset, np.sum(rows["stiffness"], axis=0)
        self.pushed: Mask = (self._net != 0) | (rigs.stiffness != 0) | called
        self._resolution = rigs.encoder_resolution
        laws = controller.members(member)
        far = np.where(called, rows["place"], -_FAR * reach)
        places = np.where(rows["side"] > 0, far, rows["place"])
        # What is no wall rests where a program begins to call.
        places = np.where(called & (rows["side"] == 0), start, places)
        elements = tuple(
            replace(each, place=place) for each, place in zip(laws.elements, places, strict=True)
        )
        calls = replace(
            controller.calls or Calls(),
            entrance=np.where(falls & ~walled, 0.0, -np.inf),
            caller=of("caller"),
            dampers=of("dampers"),
            until=sizes.called,
        )
        self._run = Simulation(
            rigs,
            np.zeros(samples),
            controller=replace(
                laws, stiffness=0.0, damping=0.0, mass=0.0, beside=elements, calls=calls
            ),
            hand=_hands([conditions[each.place].hand for each in plays]),
            position=start,
            velocity=speed,
            push=np.maximum(steady[:, None], (of("pulse") * limit)[:, None] * pulse),
            watch=True,
            seed=seeds,
        )

    def until(self, samples: int) -> tuple[Recording, list[str]]:
        """All that was recorded up to this many samples, and what grew of each, or nothing."""
        seen = self._run.until(samples)
        assert seen.truth is not None
        net, floor = self._net, energy_floor(self._net, self._resolution, self._stiffness)
        told = [""] * seen.batch
        with np.errstate(over="ignore", invalid="ignore"):
            for play in self._falls.tolist():
                energy = contacts(seen, play, 0.0, float(net[play]))[1]
                if grows(energy, floor[play]):
                    ratio = largest_ratio(energy, floor[play])
                    told[play] = (
                        f"a contact with the wall had {ratio:.3g} times the energy of any before"
                    )
            held = seen.truth.energy - net[:, None] * seen.truth.handle
            moving = seen.truth.energy[:, 0]
            gained: FloatArray = np.max(held[:, self._until :], axis=1) - held[:, 0]
            more = self._called & ~(gained <= GROWTH * moving + floor)
            for play in np.flatnonzero(more).tolist():
                ratio = 1 + gained[play] / moving[play]
                told[play] = f"it is left with {ratio:.3g} times the energy it began with"
        return seen, told


def _hands(hands: Sequence[Hand]) -> Hand:
    """Hands, each of one member, as one batch."""
    return Hand(
        **{
            field.name: np.array([float(np.asarray(getattr(each, field.name))) for each in hands])
            for field in fields(Hand)
        }
    )
