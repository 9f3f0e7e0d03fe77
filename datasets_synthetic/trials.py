"""The standard trials as they are played: every controller, in every condition, in one batch.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device: let
go from a displacement, a push and its release, a push beyond the force limit, a start within a few
counts where friction and quantiser may sustain an oscillation, and falls from afar and from near
into a wall, where one-sided elements only push and others fade if they have to. All are one batch,
the place of the wall nowhere for those without one: trials are the outermost, conditions the next,
controllers the innermost. One file: the trials of one batch, laid out and named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.bouncing import Bounces, bounces
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import Simulation
from datasets_synthetic.wall import ADVERSE, OPEN, RANDOM, Wall

FloatArray = NDArray[np.float64]
TrialName = Literal["release", "push", "sustained push", "small start", "wall", "near wall"]
_TRIALS: tuple[TrialName, ...] = get_args(TrialName)
#: So many of them without a wall.
_OPEN = 4

#: Where nothing else is stated a trial goes so many counts from the start, ...
_REACH = 1000.0
#: ... and where a few counts are asked for, so many.
_NEAR = 30.0
#: Push and fall into a wall use this part of the force limit, ...
_PUSH, _FALL = 0.5, 0.25
#: ... and the sustained push is beyond it by so much.
_BEYOND = 1.1
#: Part of a run in which elements are entered and left; what comes of it is judged later.
_CALLED = 0.35
#: Part of the run after which a push is released, and over which it rises and falls.
_RELEASE, _RISE = 0.25, 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A device, the hand on it and the gate of its dampers, in which every trial is played.

    Attributes:
        rig: one device.
        hand: on it.
        held: whether there is a hand.
        other: whether it is another device than the one that is rehearsed on.
        gate: what is done with the elements, OPEN, RANDOM or ADVERSE.
    """

    rig: Rig
    hand: Hand
    held: bool
    other: bool = False
    gate: int = OPEN

    @property
    def rubbing(self) -> bool:
        """Whether the device has its Coulomb friction."""
        return bool(self.rig.coulomb_friction[0] > 0)


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
    def near(self) -> FloatArray:
        """The short displacement, m (rad), shape (batch,)."""
        return _NEAR * self.count

    def members(self, which: NDArray[np.intp]) -> Sizes:
        """The trials of these controllers, shape (members,)."""
        return replace(
            self, count=self.count[which], reach=self.reach[which], limit=self.limit[which]
        )


def conditions_of(
    rig: Rig, hand: Hand | None, others: Sequence[Rig], controller: Controller
) -> list[Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held.

    Other devices are played without friction; transitions, in which elements are entered and left
    and gains fall and rise while it moves, without friction and hands off.
    """
    bare = [_oiled(each) for each in (rig, *others)]
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    rubbing = [rig] if rig.coulomb_friction[0] > 0 else []
    found = [
        Condition(rig=some, hand=on, held=held)
        for some in (*rubbing, bare[0])
        for on, held in hands
    ]
    found += [
        Condition(rig=some, hand=on, held=held, other=True)
        for some in bare[1:]
        for on, held in hands
    ]
    if controller.beside:
        found += [
            Condition(rig=bare[0], hand=Hand(), held=False, gate=gate) for gate in (RANDOM, ADVERSE)
        ]
    return found


def _oiled(rig: Rig) -> Rig:
    """The device without Coulomb friction."""
    return replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0)


def trials_by_name(conditions: Sequence[Condition]) -> list[tuple[TrialName, Condition]]:
    """Every trial of one controller, those without a wall first."""
    return [(name, each) for name in _TRIALS for each in conditions]


class Trials:
    """All trials of a batch of controllers, played up to some sample and then on."""

    __slots__ = ("_fallen", "_falls", "_run")

    def __init__(
        self,
        controller: Controller,
        conditions: Sequence[Condition],
        sizes: Sizes,
        samples: int,
        seed: int,
    ) -> None:
        """Ready to start, with so many samples at most."""
        part = np.arange(samples) / sizes.played
        pushes = np.clip(np.minimum(part, _RELEASE - part) / _RISE, 0.0, 1.0)
        none = np.zeros(sizes.batch)
        step = float(conditions[0].rig.sample_time[0])
        # A few counts are also gained at a walk: where no spring pulls, nothing else would move.
        walk = sizes.near / (_RISE * sizes.played * step)
        own = per_member(0.0 if controller.wall is None else controller.wall.place, sizes.batch)
        own = np.where(np.isinf(own), 0.0, own)
        start = [sizes.reach, none, none, sizes.near, own - sizes.reach, own - sizes.near]
        limit = sizes.limit
        push = [none, _PUSH * limit, _BEYOND * limit, none, _FALL * limit, _FALL * limit]
        nowhere = np.full(sizes.batch, -np.inf)
        place = _each([nowhere] * _OPEN + [own] * (len(_TRIALS) - _OPEN), conditions)
        rigs = _rigs(conditions, sizes.batch)
        laws = replace(_laws(controller, conditions, sizes), wall=Wall(place=place))
        pushed = _each(push, conditions)
        self._falls = slice(_OPEN * len(conditions) * sizes.batch, None)
        shape = np.where(np.isinf(place)[:, None], pushes, 1.0)
        self._fallen = {
            "place": place[self._falls],
            "net": (pushed - rigs.force_offset)[self._falls],
            "resolution": rigs.encoder_resolution[self._falls],
            "stiffness": per_member(laws.total_stiffness(), place.size)[self._falls],
        }
        self._run = Simulation(
            rigs,
            np.zeros(samples),
            controller=laws,
            hand=_hands(conditions, sizes.batch),
            position=_each(start, conditions),
            velocity=_each([none, none, none, walk, none, none], conditions),
            push=pushed[:, None] * shape,
            watch=True,
            seed=seed,
        )

    def until(self, samples: int) -> tuple[Recording, Bounces]:
        """What became of the trials without a wall and of the falls, up to this many samples."""
        seen = self._run.until(samples)
        falls = bounces(seen.members(self._falls), **self._fallen)
        return seen.members(slice(0, self._falls.start)), falls


def _each(trials: Sequence[FloatArray], conditions: Sequence[Condition]) -> FloatArray:
    """One value a trial and controller, the same in every condition, shape (members,)."""
    return np.repeat(np.stack(trials)[:, None], len(conditions), axis=1).ravel()


def _laws(controller: Controller, conditions: Sequence[Condition], sizes: Sizes) -> Controller:
    """The controllers in turn for every trial and condition, as one batch."""
    batch, calls = sizes.batch, round(_CALLED * sizes.played)
    laws = controller.members(np.tile(np.arange(batch), len(_TRIALS) * len(conditions)))
    gate = np.tile(np.repeat([each.gate for each in conditions], batch), len(_TRIALS))
    beside = tuple(replace(each, gate=gate, calls=calls) for each in laws.beside)
    return replace(laws, beside=beside)


def _rigs(conditions: Sequence[Condition], batch: int) -> Rig:
    """The devices, each for every controller in turn, once a trial, as one batch."""
    places = np.tile(np.repeat(np.arange(len(conditions)), batch), len(_TRIALS))
    return Rig.batch_of([each.rig for each in conditions]).members(places)


def _hands(conditions: Sequence[Condition], batch: int) -> Hand:
    """The hands likewise."""
    columns = {
        field.name: [float(np.asarray(getattr(each.hand, field.name))) for each in conditions]
        for field in fields(Hand)
    }
    return Hand(
        **{name: np.tile(np.repeat(one, batch), len(_TRIALS)) for name, one in columns.items()}
    )
