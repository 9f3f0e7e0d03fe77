"""The standard trials as they are played: every controller, in every condition, in one batch.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device: let
go from a displacement, a push and its release, a push beyond the force limit, a start within a few
counts where friction and quantiser may sustain an oscillation, and falls from afar and from near
into a wall; where there is none, what there is, is entered there and left again. Where there is
one, a hand leans on it. Then what a program may ask for: all is entered, left and scaled while the
device moves, at random and such that it holds less where that takes energy, between two walls where
they are given; and plain dampers switched so for as long as it lasts. One file: the trials of one
batch, laid out and named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import per_member
from datasets_synthetic.bouncing import Bounces, bounces
from datasets_synthetic.calls import ADVERSE, NOBODY, RANDOM, Calls
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import Simulation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
TrialName = Literal[
    "release",
    "push",
    "sustained push",
    "small start",
    "wall",
    "near wall",
    "damper at random",
    "damper against it",
    "calls at random",
    "calls against it",
]

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
#: Part of the run in which a program calls.
_CALLED = 0.35
#: Opposite walls stand so many times as far off as a trial goes where it does without them.
_FAR = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What one trial begins with, the same for all devices.

    Attributes:
        reaches: start, in long displacements; into a wall above zero.
        nears: start, in short displacements.
        walks: whether it begins at a walk: where no spring pulls, nothing else would move.
        pulse: of a push that is released, part of the force limit.
        falls: whether it falls into a wall, or through where elements are entered.
        caller: NOBODY, RANDOM or ADVERSE.
        dampers: whether that is all that is called.
    """

    reaches: float = 0.0
    nears: float = 0.0
    walks: bool = False
    pulse: float = 0.0
    falls: bool = False
    caller: int = NOBODY
    dampers: bool = False

    @property
    def called(self) -> bool:
        """Whether elements are entered, left and scaled."""
        return self.caller != NOBODY and not self.dampers


KINDS: dict[TrialName, Kind] = {
    "release": Kind(reaches=1.0),
    "push": Kind(pulse=_PUSH),
    "sustained push": Kind(pulse=_BEYOND),
    "small start": Kind(nears=1.0, walks=True),
    "wall": Kind(reaches=-1.0, falls=True),
    "near wall": Kind(nears=-1.0, falls=True),
    "damper at random": Kind(nears=-1.0, caller=RANDOM, dampers=True),
    "damper against it": Kind(nears=-1.0, caller=ADVERSE, dampers=True),
    "calls at random": Kind(caller=RANDOM),
    "calls against it": Kind(caller=ADVERSE),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A device and the hand on it, in which trials are played.

    Attributes:
        rig: one device.
        hand: on it.
        held: whether there is a hand.
        other: whether it is another device than the one that is rehearsed on.
    """

    rig: Rig
    hand: Hand
    held: bool
    other: bool = False

    @property
    def rubbing(self) -> bool:
        """Whether the device has its Coulomb friction."""
        return bool(self.rig.coulomb_friction[0] > 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """One trial of one controller in one condition.

    Attributes:
        name: of the trial.
        member: of the batch of controllers.
        place: of the condition among all of them.
        moving: whether elements come and go.
    """

    name: TrialName
    member: int
    place: int
    moving: bool


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


def conditions_of(rig: Rig, hand: Hand | None, others: Sequence[Rig]) -> list[Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held.

    Other devices are played without friction.
    """
    bare = [_oiled(each) for each in (rig, *others)]
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    rubbing = [rig] if rig.coulomb_friction[0] > 0 else []
    return [
        Condition(rig=some, hand=on, held=held, other=other)
        for some, other in (*((each, False) for each in (*rubbing, bare[0])), *((each, True) for each in bare[1:]))
        for on, held in hands
    ]


def _oiled(rig: Rig) -> Rig:
    """The device without Coulomb friction."""
    return replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0)


def plays_of(controller: Controller, conditions: Sequence[Condition], batch: int) -> list[Play]:
    """Every trial of each controller, those in which elements come and go last.

    Calls are played hands off, without friction; dampers alone are switched on the device that is
    rehearsed on, beside springs.
    """
    walls = _any_of(controller, batch, lambda each: np.not_equal(each.side, 0))
    springs = _any_of(controller, batch, lambda each: np.greater(each.stiffness, 0))
    dampers = _any_of(controller, batch, lambda each: np.greater(each.damping, 0) & np.equal(each.stiffness, 0) & np.equal(each.mass, 0) & np.equal(each.fade_time, 0))
    some = bool(controller.beside)
    plays: list[Play] = []
    for name, kind in KINDS.items():
        for place, condition in enumerate(conditions):
            alone = not (condition.rubbing or condition.held)
            suits = np.full(batch, True)
            if kind.dampers:
                suits = springs & dampers & (alone and not condition.other)
            elif kind.called:
                suits = np.full(batch, alone and some)
            moving = np.full(batch, True) if kind.caller else ~walls & kind.falls
            plays += [
                Play(name=name, member=int(k), place=place, moving=bool(moving[k]))
                for k in np.flatnonzero(suits)
            ]
    return sorted(plays, key=lambda each: each.moving)


class Trials:
    """Trials of a batch of controllers, played up to some sample and then on."""

    __slots__ = ("_called", "_fallen", "_falls", "_run", "until_called")

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
