"""What is played of every controller: the standard trials, in every condition that suits them.

The handle is let go from a displacement, pushed and released, pushed beyond the force limit, and
started within a few counts, where friction and quantiser may sustain an oscillation. It falls from
afar and from near into a wall; where there is none, what there is, is entered there and left again.
Where there is one, a hand leans on it. Then what a program may ask for: all is entered, left and
scaled while the device moves, at random and such that it holds less where that takes energy,
between two walls where they are given; and plain dampers are switched so for as long as it lasts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from datasets_synthetic.calls import ADVERSE, NOBODY, RANDOM
from datasets_synthetic.controller import Controller
from datasets_synthetic.hand import Hand
from datasets_synthetic.rig import Rig

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

#: Part of the most force that springs or the device give with which the handle is pushed, ...
_PUSH = 0.5
#: ... and where it is pushed beyond that.
_BEYOND = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What one trial begins with, the same for all devices.

    Attributes:
        reaches: start, in long displacements; into a wall above zero.
        nears: start, in short displacements.
        walks: whether it begins at a walk: where no spring pulls, nothing else would move.
        pulse: of a push that is released, part of the most force that is given.
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


def conditions_of(rig: Rig, hand: Hand | None, others: Sequence[Rig]) -> list[Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held.

    Other devices are played without friction.
    """
    bare = [_oiled(each) for each in (rig, *others)]
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    own = [rig, bare[0]] if rig.coulomb_friction[0] > 0 else bare[:1]
    return [
        Condition(rig=some, hand=on, held=held, other=other)
        for rigs, other in ((own, False), (bare[1:], True))
        for some in rigs
        for on, held in hands
    ]


def _oiled(rig: Rig) -> Rig:
    """The device without Coulomb friction."""
    return replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0)


def plays_of(controller: Controller, conditions: Sequence[Condition], batch: int) -> list[Play]:
    """Every trial of each controller, those in which elements come and go last.

    A program calls where there is nobody else and no friction. Dampers alone are switched beside
    springs, on the device that is rehearsed on.
    """
    rows = controller.rows(np.arange(batch))
    dampers = (rows["damping"] > 0) & (rows["stiffness"] == 0) & (rows["mass"] == 0)
    dampers = np.any(dampers & (rows["fade_time"] == 0), axis=0)
    chopped, walled = dampers & np.any(rows["stiffness"] > 0, axis=0), np.any(rows["side"], axis=0)
    plays: list[Play] = []
    for name, kind in KINDS.items():
        for place, condition in enumerate(conditions):
            alone = not (condition.rubbing or condition.held)
            suits = np.full(batch, alone and bool(controller.beside) if kind.caller else True)
            if kind.dampers:
                suits = suits & chopped & (not condition.other)
            plays += [
                Play(name=name, member=k, place=place, moving=bool(kind.caller or passes))
                for k, passes in enumerate(kind.falls & ~walled)
                if suits[k]
            ]
    return sorted(plays, key=lambda each: each.moving)
