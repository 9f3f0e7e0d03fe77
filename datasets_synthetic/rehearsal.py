"""Standard trials of a controller on a simulated device: does it settle, and if not, why.

All of them run with the quantiser, friction, delay, force limit, modes and lag of the device: let
go from a displacement, a push and its release, a push beyond the force limit, a start within a few
counts where friction and quantiser may sustain an oscillation, and falls into a one-sided wall from
afar and from near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.bouncing import Bounces, bounce
from datasets_synthetic.controller import Controller
from datasets_synthetic.ending import Allowed, Ending, Verdict, endings
from datasets_synthetic.hand import Hand
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import simulate
from datasets_synthetic.wall import Wall

FloatArray = NDArray[np.float64]
TrialName = Literal["release", "push", "sustained push", "small start", "wall", "near wall"]
_TRIALS: tuple[TrialName, ...] = get_args(TrialName)

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
#: Where anything is not at rest in the end, all is played again for so many times as long: what
#: dies out slowly is told from what lasts.
_LONGER = 3
#: Force that keeps oscillating may be this part of the force limit unless another is stated.
_FORCE = 0.01
#: Counts that keep oscillating unless others are stated.
_COUNTS = 3.0


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
    duration: float = 3.0,
    reach: float | None = None,
    push: float | None = None,
    counts_allowed: float = _COUNTS,
    force_allowed: float | None = None,
    seed: int = 0,
) -> Rehearsal:
    """Plays the standard trials of a controller on one device, in every condition.

    Conditions are hands off and, if a hand is given, held; with the Coulomb friction of the device
    and, because it may be less than thought, without any.

    Args:
        rig: the truth, one device.
        controller: effects and filters; about zero for the first four trials, behind a one-sided
            wall (its own, or one that may pull) for the falls.
        hand: that holds the handle, or None for hands off only.
        duration: of each trial, s; three times as long where anything is not at rest by then.
        reach: displacement of the release and height of the fall, m (rad); None for 1000 counts.
        push: the force limit that the pushes are measured by, N (N·m); None for the rig's.
        counts_allowed: amplitude at the end that counts as settled, and travel if nothing pushes.
        force_allowed: likewise of the force, N (N·m); None for 1 % of ``push``. Within a count or
            so an encoder keeps a frictionless device moving with about the force of its ripple:
            where a ripple of r rms is accepted, allow at least 3·√2·r.
        seed: of tremor, if the hand has any.

    Raises:
        ValueError: more than one device, or neither an encoder nor a reach, or neither a force
            limit nor a push.
    """
    count, limit = _units(rig, reach, push)
    reach = _REACH * count if reach is None else reach
    allowed = Allowed(
        counts=counts_allowed,
        force=_FORCE * limit if force_allowed is None else force_allowed,
        pushed=bool(np.any(rig.force_offset)),
    )
    step = float(rig.sample_time[0])
    sizes = _Sizes(reach=reach, near=_NEAR * count, limit=limit, played=round(duration / step))
    conditions = _conditions(rig, hand)
    played: list[tuple[TrialName, _Condition]] = [
        (name, each) for name in _TRIALS for each in conditions
    ]
    found: list[Ending] = []
    for times in (1, _LONGER):
        samples = times * sizes.played
        position, force = _open(controller, conditions, sizes, samples, seed)
        falls = _falls(controller, conditions, sizes, samples, seed)
        found = endings(position, force, count, allowed)
        pushed = replace(allowed, pushed=True)
        fallen = endings(falls.recording.position, falls.recording.force, count, pushed)
        found += [_with_contacts(ending, falls, place) for place, ending in enumerate(fallen)]
        if all(ending.at_rest for ending in found):
            break
    return Rehearsal(
        trials=tuple(
            _trial(name, each, ending) for (name, each), ending in zip(played, found, strict=True)
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Condition:
    """A device and the hand on it, in which every trial is played."""

    rig: Rig
    hand: Hand
    held: bool

    @property
    def rubbing(self) -> bool:
        return bool(self.rig.coulomb_friction[0] > 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sizes:
    """Long and short displacements, m (rad), the force limit, N (N·m), samples of a short run."""

    reach: float
    near: float
    limit: float
    played: int


def _conditions(rig: Rig, hand: Hand | None) -> list[_Condition]:
    rigs = [rig]
    if rig.coulomb_friction[0] > 0:
        rigs.append(replace(rig, coulomb_friction=0.0, coulomb_asymmetry=0.0))
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    return [_Condition(rig=some, hand=on, held=held) for some in rigs for on, held in hands]


def _units(rig: Rig, reach: float | None, push: float | None) -> tuple[float, float]:
    """One count, m (rad), and the force limit, N (N·m), of what is given."""
    if rig.batch != 1:
        raise ValueError(f"one device is rehearsed at a time, not {rig.batch}")
    count = float(rig.encoder_resolution[0])
    limit = float(rig.force_limit[0]) if push is None else push
    if count == 0 and reach is None:
        raise ValueError(f"{rig.name} has no encoder_resolution: give it one, or a reach")
    if not np.isfinite(limit):
        raise ValueError(f"{rig.name} has no force_limit: give it one, or a push")
    return count if count > 0 else float(reach or 0.0) / _REACH, limit


def _open(
    controller: Controller,
    conditions: Sequence[_Condition],
    sizes: _Sizes,
    samples: int,
    seed: int,
) -> tuple[FloatArray, FloatArray]:
    """Readings and forces of the trials without a wall, each in every condition in turn."""
    part = np.arange(samples) / sizes.played
    shape = np.clip(np.minimum(part, _RELEASE - part) / _RISE, 0.0, 1.0)
    heights = np.array([0.0, _PUSH, _BEYOND, 0.0]) * sizes.limit
    start = np.array([sizes.reach, 0.0, 0.0, sizes.near])
    # A few counts are also gained at a walk: where no spring pulls, nothing else would move.
    step = float(conditions[0].rig.sample_time[0])
    speed = np.array([0.0, 0.0, 0.0, sizes.near / (_RISE * sizes.played * step)])
    recording = simulate(
        _rigs(conditions, start.size),
        np.zeros(samples),
        controller=replace(controller, wall=None),
        hand=_hands(conditions, start.size),
        position=np.repeat(start, len(conditions)),
        velocity=np.repeat(speed, len(conditions)),
        push=np.repeat(heights, len(conditions))[:, None] * shape,
        seed=seed,
    )
    return recording.position, recording.force


def _falls(
    controller: Controller,
    conditions: Sequence[_Condition],
    sizes: _Sizes,
    samples: int,
    seed: int,
) -> Bounces:
    """Falls into the wall from afar and from near, each in every condition in turn."""
    return bounce(
        _rigs(conditions, 2),
        replace(controller, wall=controller.wall or Wall()),
        push=_FALL * sizes.limit,
        drop=np.repeat([sizes.reach, sizes.near], len(conditions)),
        hand=_hands(conditions, 2),
        samples=samples,
        seed=seed,
    )


def _rigs(conditions: Sequence[_Condition], times: int) -> Rig:
    """The devices in turn, so many times, as one batch."""
    frictions = [float(each.rig.coulomb_friction[0]) for each in conditions]
    askew = [float(each.rig.coulomb_asymmetry[0]) for each in conditions]
    return replace(
        conditions[0].rig.members(np.zeros(times * len(conditions), dtype=np.intp)),
        coulomb_friction=np.tile(frictions, times),
        coulomb_asymmetry=np.tile(askew, times),
    )


def _hands(conditions: Sequence[_Condition], times: int) -> Hand:
    """The hands in turn, so many times, as one batch."""
    return Hand(
        **{
            field.name: np.tile(
                [float(np.asarray(getattr(each.hand, field.name))) for each in conditions], times
            )
            for field in fields(Hand)
        }
    )


def _with_contacts(ending: Ending, falls: Bounces, member: int) -> Ending:
    """What became of a fall, judged by its contacts too."""
    if not falls.grows[member] or ending.verdict == "diverges":
        return ending
    ratio = falls.largest_ratio(member)
    return replace(
        ending,
        verdict="diverges",
        reason=f"a contact with the wall had {ratio:.3g} times the energy of the one before",
    )


def _trial(name: TrialName, condition: _Condition, ending: Ending) -> Trial:
    where = "held" if condition.held else "hands off"
    where += "" if condition.rubbing else ", without friction"
    return Trial(
        name=name,
        held=condition.held,
        rubbing=condition.rubbing,
        verdict=ending.verdict,
        counts=ending.counts,
        force=ending.force,
        reason=f"{name}, {where}: {ending.reason}.",
    )
