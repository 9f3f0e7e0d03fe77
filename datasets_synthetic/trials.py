"""The standard trials as they are played: every controller, in every condition, in one batch.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device: let
go from a displacement, a push and its release, a push beyond the force limit, a start within a few
counts where friction and quantiser may sustain an oscillation, and falls from afar and from near
into a wall, where one-sided elements only push and others fade if they have to. Of a batch, trials
are the outermost, conditions the next, controllers the innermost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.bouncing import Bounces, bounce
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.members import per_member
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import simulate
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
        gate: of the dampers of one-sided elements, OPEN, RANDOM or ADVERSE.
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
        """Of what is given, or else of the rig's encoder and force limit; see ``rehearse``."""
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
        """The short displacement, m (rad)."""
        return _NEAR * self.count

    def members(self, which: NDArray[np.intp]) -> Sizes:
        """Of these controllers."""
        return replace(
            self, count=self.count[which], reach=self.reach[which], limit=self.limit[which]
        )


def conditions_of(
    rig: Rig, hand: Hand | None, others: Sequence[Rig], controller: Controller
) -> list[Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held.

    Other devices are played without friction; gates without friction and hands off.
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
    if any(each.one_sided and np.any(each.damping) for each in controller.beside):
        found += [
            Condition(rig=bare[0], hand=Hand(), held=False, gate=gate) for gate in (RANDOM, ADVERSE)
        ]
    return found


def _oiled(rig: Rig) -> Rig:
    """The device without Coulomb friction."""
    return replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0)


def named(conditions: Sequence[Condition]) -> list[tuple[TrialName, Condition]]:
    """Every trial of one controller, those without a wall first."""
    return [(name, each) for name in _TRIALS for each in conditions]


def play_freely(
    controller: Controller,
    conditions: Sequence[Condition],
    sizes: Sizes,
    samples: int,
    seed: int,
) -> Recording:
    """The trials without a wall."""
    part = np.arange(samples) / sizes.played
    shape = np.clip(np.minimum(part, _RELEASE - part) / _RISE, 0.0, 1.0)
    none = np.zeros(sizes.batch)
    step = float(conditions[0].rig.sample_time[0])
    # A few counts are also gained at a walk: where no spring pulls, nothing else would move.
    speed = sizes.near / (_RISE * sizes.played * step)
    start = _each([sizes.reach, none, none, sizes.near], len(conditions))
    push = _each([none, _PUSH * sizes.limit, _BEYOND * sizes.limit, none], len(conditions))
    return simulate(
        _rigs(conditions, _OPEN, sizes.batch),
        np.zeros(samples),
        controller=replace(_laws(controller, conditions, _OPEN, sizes.batch), wall=None),
        hand=_hands(conditions, _OPEN, sizes.batch),
        position=start,
        velocity=_each([none, none, none, speed], len(conditions)),
        push=push[:, None] * shape,
        seed=seed,
    )


def play_falls(
    controller: Controller,
    conditions: Sequence[Condition],
    sizes: Sizes,
    samples: int,
    seed: int,
) -> Bounces:
    """Falls into the wall from afar and from near."""
    times = len(_TRIALS) - _OPEN
    behind = replace(controller, wall=controller.wall or Wall())
    return bounce(
        _rigs(conditions, times, sizes.batch),
        _laws(behind, conditions, times, sizes.batch),
        push=_each([_FALL * sizes.limit] * times, len(conditions)),
        drop=_each([sizes.reach, sizes.near], len(conditions)),
        hand=_hands(conditions, times, sizes.batch),
        samples=samples,
        seed=seed,
    )


def _each(trials: Sequence[FloatArray], conditions: int) -> FloatArray:
    """One value a trial and controller, the same in every condition, shape (members,)."""
    return np.repeat(np.stack(trials)[:, None], conditions, axis=1).ravel()


def _laws(
    controller: Controller, conditions: Sequence[Condition], times: int, batch: int
) -> Controller:
    """The controllers in turn for every condition, so many times, as one batch."""
    laws = controller.members(np.tile(np.arange(batch), times * len(conditions)))
    gate = np.tile(np.repeat([each.gate for each in conditions], batch), times)
    beside = tuple(replace(e, gate=gate) if e.one_sided else e for e in laws.beside)
    return replace(laws, beside=beside)


def _rigs(conditions: Sequence[Condition], trials: int, batch: int) -> Rig:
    """The devices, each for every controller in turn, so many times, as one batch."""
    places = np.tile(np.repeat(np.arange(len(conditions)), batch), trials)
    rigs = [each.rig for each in conditions]
    return Rig.batch_of(rigs).members(places)


def _hands(conditions: Sequence[Condition], trials: int, batch: int) -> Hand:
    """The hands likewise."""
    columns = {
        field.name: [float(np.asarray(getattr(each.hand, field.name))) for each in conditions]
        for field in fields(Hand)
    }
    return Hand(**{name: np.tile(np.repeat(one, batch), trials) for name, one in columns.items()})
