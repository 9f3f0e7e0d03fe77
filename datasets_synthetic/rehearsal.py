"""Standard trials of controllers on a simulated device: does it settle, and if not, why.

What is played is in trials.py; here it is judged. One file: one verdict on each trial, and what it
is read from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.bouncing import Bounces
from datasets_synthetic.controller import Controller
from datasets_synthetic.ending import Allowed, Ending, Verdict, endings
from datasets_synthetic.hand import Hand
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.trials import (
    Condition,
    Sizes,
    TrialName,
    Trials,
    conditions_of,
    trials_by_name,
)
from datasets_synthetic.wall import ADVERSE, OPEN, RANDOM

FloatArray = NDArray[np.float64]

#: Where anything is not at rest in the end, all is played on, so many times as long: what dies out
#: slowly is told from what lasts.
_LONGER = 3
#: Force that keeps oscillating may be this part of the force limit unless another is stated.
_FORCE = 0.01
#: Counts that keep oscillating unless others are stated.
_COUNTS = 3.0
#: What a trial says of a caller.
_GATES = {
    OPEN: "",
    RANDOM: ", elements entered and left and gains changed at random",
    ADVERSE: ", elements entered and left against it",
}


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
    and, because it may be less than thought, without any; other devices without any; and, where
    one-sided elements have damping, that damping shut and open at random and against the device.
    All of it is one run; the controllers with anything not at rest in the end, and only those, are
    judged by a longer one.

    Args:
        rig: the truth, one device.
        controller: effects and filters, numbers or shape (batch,); about zero for the first four
            trials, behind a wall (its own, or one at zero) for the falls.
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
    conditions = conditions_of(rig, hand, others, controller)
    force = _FORCE * sizes.limit if force_allowed is None else np.full(sizes.batch, force_allowed)
    pushed = bool(np.any(rig.force_offset) or np.any(rig.stiffness))
    allowed = [Allowed(counts=counts_allowed, force=float(f), pushed=pushed) for f in force]
    found: list[list[Ending]] = [[] for _ in allowed]
    left = np.arange(sizes.batch)
    longest = _LONGER * sizes.played
    # One plays on; of many only those that are left are played anew, by themselves.
    room = longest if sizes.batch == 1 else sizes.played
    trials = Trials(controller, conditions, sizes, room, seed)
    for samples in (sizes.played, longest):
        if samples > room:
            few = controller.members(left)
            trials = Trials(few, conditions, sizes.members(left), longest, seed)
        free, fallen = trials.until(samples)
        for place, member in enumerate(left):
            count, own = float(sizes.count[member]), [allowed[member]] * len(conditions)
            found[member] = _endings(free, place, left.size, count, own)
            found[member] += _after_falls(fallen, place, left.size, count, own)
        rest = [all(end.at_rest for end in found[member]) for member in left]
        left = left[~np.array(rest)]
        if not left.size:
            break
    names = trials_by_name(conditions)
    return tuple(
        Rehearsal(trials=tuple(_trial(*name, end) for name, end in zip(names, each, strict=True)))
        for each in found
    )


def _endings(
    recording: Recording, place: int, batch: int, count: float, allowed: Sequence[Allowed]
) -> list[Ending]:
    """What became of the trials of one controller of a batch, what is allowed by condition."""
    found: list[Ending] = []
    own = slice(place, None, batch)
    rows = range(len(recording.position[own]))
    for kind in dict.fromkeys(allowed):
        ends = endings(recording.position[own], recording.force[own], count, kind)
        found = found or ends
        found = [ends[row] if allowed[row % len(allowed)] == kind else found[row] for row in rows]
    return found


def _after_falls(
    falls: Bounces, place: int, batch: int, count: float, allowed: Sequence[Allowed]
) -> list[Ending]:
    """What became of its falls, judged by their contacts too."""
    pushed = [replace(each, pushed=True) for each in allowed]
    members = range(place, falls.recording.batch, batch)
    ends = _endings(falls.recording, place, batch, count, pushed)
    return [_with_contacts(end, falls, k) for k, end in zip(members, ends, strict=True)]


def _with_contacts(ending: Ending, falls: Bounces, member: int) -> Ending:
    """What became of a fall, judged by its contacts too."""
    if not falls.grows[member] or ending.verdict == "diverges":
        return ending
    ratio = falls.largest_ratio(member)
    return replace(
        ending,
        verdict="diverges",
        reason=f"a contact with the wall had {ratio:.3g} times the energy of any before",
    )


def _trial(name: TrialName, condition: Condition, ending: Ending) -> Trial:
    where = "held" if condition.held else "hands off"
    where += "" if condition.rubbing else ", without friction"
    where += _GATES[condition.gate]
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
