"""The standard trials as they are played: every controller, in every condition, in one batch.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device: let
go from a displacement, a push and its release, a push beyond the force limit, a start within a few
counts where friction and quantiser may sustain an oscillation, and falls into a one-sided wall from
afar and from near. Of a batch, trials are the outermost, conditions the next, controllers the
innermost.
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
from datasets_synthetic.wall import Wall

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
    """A device and the hand on it, in which every trial is played."""

    rig: Rig
    hand: Hand
    held: bool

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


def conditions_of(rig: Rig, hand: Hand | None) -> list[Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held."""
    rigs = [rig]
    if rig.coulomb_friction[0] > 0:
        rigs.append(replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0))
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    return [Condition(rig=some, hand=on, held=held) for some in rigs for on, held in hands]


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
        controller=replace(_laws(controller, _OPEN * len(conditions), sizes.batch), wall=None),
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
        _laws(behind, times * len(conditions), sizes.batch),
        push=_each([_FALL * sizes.limit] * times, len(conditions)),
        drop=_each([sizes.reach, sizes.near], len(conditions)),
        hand=_hands(conditions, times, sizes.batch),
        samples=samples,
        seed=seed,
    )


def _each(trials: Sequence[FloatArray], conditions: int) -> FloatArray:
    """One value a trial and controller, the same in every condition, shape (members,)."""
    return np.repeat(np.stack(trials)[:, None], conditions, axis=1).ravel()


def _laws(controller: Controller, times: int, batch: int) -> Controller:
    """The controllers in turn, so many times, as one batch."""
    return controller.members(np.tile(np.arange(batch), times))


def _rigs(conditions: Sequence[Condition], trials: int, batch: int) -> Rig:
    """The devices, each for every controller in turn, so many times, as one batch."""
    frictions = [float(each.rig.coulomb_friction[0]) for each in conditions]
    askew = [float(each.rig.coulomb_asymmetry[0]) for each in conditions]
    members = np.zeros(trials * len(conditions) * batch, dtype=np.intp)
    return replace(
        conditions[0].rig.members(members),
        coulomb_friction=np.tile(np.repeat(frictions, batch), trials),
        coulomb_asymmetry=np.tile(np.repeat(askew, batch), trials),
    )


def _hands(conditions: Sequence[Condition], trials: int, batch: int) -> Hand:
    """The hands likewise."""
    columns = {
        field.name: [float(np.asarray(getattr(each.hand, field.name))) for each in conditions]
        for field in fields(Hand)
    }
    return Hand(**{name: np.tile(np.repeat(one, batch), trials) for name, one in columns.items()})
