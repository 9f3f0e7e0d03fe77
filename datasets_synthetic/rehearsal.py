"""Standard trials of controllers on a simulated device: does it settle, and if not, why.

What is played is in plays.py; here it is judged. One file: one verdict on each trial, and what it
is read from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.controller import Controller
from datasets_synthetic.ending import Allowed, Ending, Verdict, endings
from datasets_synthetic.hand import Hand
from datasets_synthetic.plays import KINDS, Condition, Play, TrialName, conditions_of, plays_of
from datasets_synthetic.rig import Rig
from datasets_synthetic.trials import Sizes, Trials

FloatArray = NDArray[np.float64]

#: What is not at rest in the end is played again, so many times as long: what dies out slowly is
#: told from what lasts.
_LONGER = 3
#: Force that keeps oscillating may be this part of the force limit unless another is stated.
_FORCE = 0.01
#: Counts that keep oscillating unless others are stated, and so many times more where the force of
#: a damper is chopped.
_COUNTS, _CHOPPED = 3.0, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One trial and how it ended.

    Attributes:
        name: of the trial.
        held: whether the hand was on the handle.
        rubbing: whether the device had its Coulomb friction, which may hide what a better oiled
            device would do.
        verdict: "settles", "keeps-oscillating" or "diverges".
        counts: amplitude of the readings at the end, in counts.
        force: amplitude of the force at the end, N (N·m).
        reason: a sentence.
    """

    name: TrialName
    held: bool
    rubbing: bool
    verdict: Verdict
    counts: float
    force: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Rehearsal:
    """All trials of one controller.

    Attributes:
        trials: in the order they were played.
    """

    trials: tuple[Trial, ...]

    @property
    def settles(self) -> bool:
        """Whether every trial settles."""
        return not self.vetoes

    @property
    def vetoes(self) -> tuple[Trial, ...]:
        """The trials that do not settle, those that diverge first."""
        bad = [trial for trial in self.trials if trial.verdict != "settles"]
        return tuple(sorted(bad, key=lambda trial: trial.verdict != "diverges"))


def rehearse(
    rig: Rig,
    controller: Controller,
    *,
    hand: Hand | None = None,
    others: Sequence[Rig] = (),
    duration: float = 3.0,
    reach: float | FloatArray | None = None,
    push: float | FloatArray | None = None,
    counts_allowed: float = _COUNTS,
    force_allowed: float | None = None,
    seed: int = 0,
) -> tuple[Rehearsal, ...]:
    """Plays the standard trials of every controller of a batch on one device, in every condition.

    Conditions are hands off and, if a hand is given, held; with the Coulomb friction of the device
    and, because it may be less than thought, without any; other devices without any. What is played
    is in plays.py: elements beside the controller's own effects are also entered, left and scaled
    while they act. All of it is one run; what is not at rest in the end, and only that, is judged
    by a longer one.

    Args:
        rig: the truth, one device.
        controller: effects and filters, numbers or shape (batch,), about zero: walls of side -1
            have their face there. Walls of side 1 stand where they are while a program calls, and
            are out of the way before.
        hand: that holds the handle, or None for hands off only.
        others: devices with the same modes and sample time that this one may be as well.
        duration: of each trial, s; three times as long where anything is not at rest by then.
        reach: displacement of the release and height of the fall, m (rad), a number or shape
            (batch,); None for 1000 counts.
        push: the force limit that the pushes are measured by, N (N·m), a number or shape
            (batch,); None for the rig's.
        counts_allowed: amplitude at the end that counts as settled, and travel if nothing pushes.
        force_allowed: likewise of the force, N (N·m); None for 1 % of ``push``. Within a count or
            so an encoder keeps a frictionless device moving with about the force of its ripple:
            where a ripple of r rms is accepted, allow at least 3·√2·r.
        seed: of tremor, if the hand has any.

    Returns:
        One rehearsal a controller.

    Raises:
        ValueError: more than one device, or neither an encoder nor a reach, or neither a force
            limit nor a push.
    """
    sizes = Sizes.of(rig, controller.size(), reach=reach, push=push, duration=duration)
    conditions = conditions_of(rig, hand, others)
    plays = plays_of(controller, conditions, sizes.batch)
    force = _FORCE * sizes.limit if force_allowed is None else np.full(sizes.batch, force_allowed)
    ends: dict[int, Ending] = {}
    left = range(len(plays))
    for samples in (sizes.played, _LONGER * sizes.played):
        part = [plays[k] for k in left]
        seeds = [seed + k for k in left]
        trials = Trials(controller, conditions, sizes, part, samples=samples, seeds=seeds)
        seen, told = trials.until(samples)
        count = sizes.count[[play.member for play in part]]
        allowed = [
            _allowed(play, counts_allowed, float(force[play.member]), sizes, pushed=bool(pushed))
            for play, pushed in zip(part, trials.pushed, strict=True)
        ]
        found = endings(seen.position, seen.force, count, allowed)
        ends |= {k: _with(end, more) for k, end, more in zip(left, found, told, strict=True)}
        left = [k for k in left if not ends[k].at_rest]
        if not left:
            break
    order = list(KINDS)
    played = sorted(range(len(plays)), key=lambda k: (order.index(plays[k].name), k))
    return tuple(
        Rehearsal(
            trials=tuple(
                _trial(plays[k].name, conditions[plays[k].place], ends[k])
                for k in played
                if plays[k].member == member
            )
        )
        for member in range(sizes.batch)
    )


def _allowed(play: Play, counts: float, force: float, sizes: Sizes, *, pushed: bool) -> Allowed:
    """What may be left: where a damper is chopped, whatever force it makes of a few counts."""
    if KINDS[play.name].dampers:
        counts, force = _CHOPPED * counts, 2 * float(sizes.limit[play.member])
    return Allowed(counts=counts, force=force, pushed=pushed)


def _with(ending: Ending, told: str) -> Ending:
    """What became of a trial, judged by its energy too, of which something is told if it grew."""
    if not told or ending.verdict == "diverges":
        return ending
    return replace(ending, verdict="diverges", at_rest=False, reason=told)


def _trial(name: TrialName, condition: Condition, ending: Ending) -> Trial:
    where = "held" if condition.held else "hands off"
    where += "" if condition.rubbing else ", without friction"
    if condition.other:
        rig = condition.rig
        where += f", at {rig.mass[0]:.4g} of mass, {rig.damping[0]:.4g} of damping and a delay of "
        where += f"{rig.delay[0]:.3g} s"
    return Trial(
        name=name,
        held=condition.held,
        rubbing=condition.rubbing,
        verdict=ending.verdict,
        counts=ending.counts,
        force=ending.force,
        reason=f"{name}, {where}: {ending.reason}.",
    )
