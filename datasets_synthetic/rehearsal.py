"""Standard trials of controllers on a simulated device: does it settle, and if not, why.

All run in one batch, with the quantiser, friction, delay, force limit, modes and lag of the device.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import FloatArray, Hand, Rig, per_member
from datasets_synthetic.ending import DIES, PART, Allowed, Ending, Verdict, endings
from datasets_synthetic.law import ADVERSE, NOBODY, RANDOM, Calls, Controller
from datasets_synthetic.simulation import Recording, Truth, simulate

Mask = NDArray[np.bool_]

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
#: ... and where it is pushed beyond that, as far as that takes it no farther than a trial goes.
_BEYOND = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """What one trial begins with, the same for all devices."""

    reaches: float = 0.0  # start, in long displacements; into a wall above zero
    nears: float = 0.0  # start, in short displacements
    #: whether it begins at a walk: where no spring pulls, nothing else would move
    walks: bool = False
    pulse: float = 0.0  # of a push that is released, part of the most force that is given
    falls: bool = False  # whether it falls into a wall, or through where elements are entered
    caller: int = NOBODY  # NOBODY, RANDOM or ADVERSE
    dampers: bool = False  # whether that is all that is called

    @property
    def called(self) -> bool:
        """Whether elements are entered, left and scaled."""
        return self.caller != NOBODY and not self.dampers


_KINDS: dict[TrialName, _Kind] = {
    "release": _Kind(reaches=1.0),
    "push": _Kind(pulse=_PUSH),
    "sustained push": _Kind(pulse=_BEYOND),
    "small start": _Kind(nears=1.0, walks=True),
    "wall": _Kind(reaches=-1.0, falls=True),
    "near wall": _Kind(nears=-1.0, falls=True),
    "damper at random": _Kind(nears=-1.0, caller=RANDOM, dampers=True),
    "damper against it": _Kind(nears=-1.0, caller=ADVERSE, dampers=True),
    "calls at random": _Kind(caller=RANDOM),
    "calls against it": _Kind(caller=ADVERSE),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Condition:
    """A device and the hand on it, in which trials are played."""

    rig: Rig  # one device
    hand: Hand  # on it
    held: bool  # whether there is a hand
    other: bool = False  # whether it is another device than the one that is rehearsed on

    @property
    def rubbing(self) -> bool:
        """Whether the device has its Coulomb friction."""
        return bool(self.rig.coulomb_friction[0] > 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Play:
    """One trial of one controller in one condition."""

    name: TrialName  # of the trial
    member: int  # of the batch of controllers
    place: int  # of the condition among all of them


def _conditions(rig: Rig, hand: Hand | None, others: Sequence[Rig]) -> list[_Condition]:
    """With friction, if there is any, and without; each hands off and, if a hand is given, held.

    Other devices are played without friction.
    """
    bare = [replace(each, coulomb_friction=0.0) for each in (rig, *others)]
    hands = [(Hand(), False)] + ([] if hand is None else [(hand, True)])
    own = [rig, bare[0]] if rig.coulomb_friction[0] > 0 else bare[:1]
    return [
        _Condition(rig=some, hand=on, held=held, other=other)
        for rigs, other in ((own, False), (bare[1:], True))
        for some in rigs
        for on, held in hands
    ]


def _plays(controller: Controller, conditions: Sequence[_Condition], batch: int) -> list[_Play]:
    """Every trial of each controller.

    A program calls where there is nobody else and no friction. Dampers alone are switched beside
    springs, on the device that is rehearsed on.
    """
    rows = controller.rows(np.arange(batch))
    dampers = (rows["damping"] > 0) & (rows["stiffness"] == 0) & (rows["mass"] == 0)
    dampers = np.any(dampers & (rows["fade_time"] == 0), axis=0)
    chopped = dampers & np.any(rows["stiffness"] > 0, axis=0)
    plays: list[_Play] = []
    for name, kind in _KINDS.items():
        for place, condition in enumerate(conditions):
            alone = not (condition.rubbing or condition.held)
            suits = np.full(batch, alone and bool(controller.beside) if kind.caller else True)
            if kind.dampers:
                suits = suits & chopped & (not condition.other)
            members = np.flatnonzero(suits).tolist()
            plays += [_Play(name=name, member=member, place=place) for member in members]
    return plays


#: Where nothing else is stated a trial goes so many counts from the start, ...
_REACH = 1000.0
#: ... and where a few counts are asked for, so many.
_NEAR = 30.0
#: Part of the most force that leans on a wall, and with which the handle falls into it.
_FALL = 0.25
#: Part of the run in which the handle comes back from where it is released.
_BACK = 0.15
#: Part of the run after which a push is released, and over which it rises and falls.
_RELEASE, _RISE = 0.25, 0.05
#: Part of the run in which a program calls.
_CALLED = 0.35
#: Largest |h·p| of one integration step: damping is right to 0.5⁴/120 = 5e-4. Finer steps would
#: take minutes where motion dies within a sample.
_LARGEST_STEP = 0.5
#: Growth of the energy over that of every contact before that is taken for none: what the friction
#: of a fraction of a sample, between the wall and the reading that finds it, may make of it.
_GROWTH = 0.01
#: Counts of travel that an encoder may hide.
_HIDDEN = 2.0
#: Opposite walls stand so many times as far off as a trial goes where it does without them.
_FAR = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sizes:
    """How far, how hard and how long; arrays of one value a controller, shape (batch,)."""

    count: FloatArray  # of the encoder, m (rad)
    reach: FloatArray  # the long displacement, m (rad)
    limit: FloatArray  # of force, N (N·m)
    samples: int  # of a short run

    @classmethod
    def of(
        cls,
        rig: Rig,
        batch: int,
        *,
        reach: float | FloatArray | None,
        push: float | FloatArray | None,
        duration: float,
    ) -> _Sizes:
        """Sizes from what is given, or else from encoder and force limit; see ``rehearse``."""
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
            samples=round(duration / float(rig.sample_time[0])),
        )

    @property
    def batch(self) -> int:
        """Number of controllers."""
        return self.count.size


def _played(
    controller: Controller,
    conditions: Sequence[_Condition],
    sizes: _Sizes,
    plays: Sequence[_Play],
    *,
    samples: int,
    seeds: Sequence[int],
) -> tuple[Recording, list[str], FloatArray]:
    """Plays recorded over so many samples, what grew in each, or "", and its steady speed, m/s."""
    member = np.array([each.member for each in plays], dtype=np.intp)
    where = np.array([each.place for each in plays], dtype=np.intp)
    kinds = [_KINDS[each.name] for each in plays]

    def of(name: str) -> FloatArray:
        return np.array([getattr(kind, name) for kind in kinds], dtype=np.float64)

    rigs = Rig.batch_of([each.rig for each in conditions]).members(where)
    rows, reach = controller.rows(member), sizes.reach[member]
    # What springs give where they are cut, or all that the device can.
    levels = np.sum(np.where(rows["stiffness"] > 0, rows["level"], 0.0), axis=0)
    limit = np.minimum(sizes.limit[member], np.where(levels > 0, levels, np.inf))
    # A quarter of that brings the handle back in a part of the run.
    step = float(rigs.sample_time[0])
    run = sizes.samples * step
    reach = np.minimum(reach, _FALL * limit / _force_to_move(rigs, _BACK * run))
    # What is pushed harder than anything holds it goes so far until the push is released.
    hardest = limit + reach * _force_to_move(rigs, _RELEASE * run)
    near, falls, called = _NEAR * sizes.count[member], of("falls") > 0, of("called") > 0
    walled: Mask = np.any(rows["side"], axis=0)
    faced: Mask = np.any(rows["side"] > 0, axis=0)
    opposite = np.max(np.where(rows["side"] > 0, rows["place"], -np.inf), axis=0)
    start = of("reaches") * reach + of("nears") * near
    start = np.where(called, np.where(faced, opposite / 2, -reach), start)
    # As fast as the fall from there; a few counts are gained at a walk.
    fast = np.sqrt(2 * _FALL * limit * reach / rigs.mass)
    speed = np.where(called, fast, of("walks") * near / (_RISE * run))
    leans = np.where(called, walled & ~faced, walled | falls | (of("dampers") > 0))
    # What pulls a device away from its walls is leaned against too.
    steady: FloatArray = (_FALL * limit + np.maximum(rigs.force_offset, 0.0)) * leans
    part = np.arange(samples) / sizes.samples
    pulse = np.clip(np.minimum(part, _RELEASE - part) / _RISE, 0.0, 1.0)
    until = round(_CALLED * sizes.samples)
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
        until=until,
    )
    seen = simulate(
        rigs,
        np.zeros(samples),
        controller=replace(
            laws, stiffness=0.0, damping=0.0, mass=0.0, beside=elements, calls=calls
        ),
        hand=_hands([conditions[each.place].hand for each in plays]),
        position=start,
        velocity=speed,
        push=np.maximum(steady[:, None], np.minimum(of("pulse") * limit, hardest)[:, None] * pulse),
        watch=True,
        seed=seeds,
        largest_step=_LARGEST_STEP,
    )
    assert seen.truth is not None
    net = steady - rigs.force_offset
    # Energy within the resolution of the encoder is not counted.
    hidden, pull = _HIDDEN * rigs.encoder_resolution, np.sum(rows["stiffness"], axis=0)
    floor = np.abs(net) * hidden + 0.5 * np.abs(pull) * hidden**2
    grown = [""] * seen.batch
    with np.errstate(over="ignore", invalid="ignore"):
        for play in np.flatnonzero(falls).tolist():
            energy = _contact_energies(seen, seen.truth, play, float(net[play]))
            before = np.maximum.accumulate(energy)[:-1]
            if np.any(energy[1:] > (1 + _GROWTH) * before + floor[play]):
                ratio = float(np.max((energy[1:] - floor[play]) / before))
                grown[play] = (
                    f"a contact with the wall had {ratio:.3g} times the energy of any before"
                )
        held = seen.truth.energy - net[:, None] * seen.truth.handle
        moving = seen.truth.energy[:, 0]
        gained: FloatArray = np.max(held[:, until:], axis=1) - held[:, 0]
        more = called & ~(gained <= _GROWTH * moving + floor)
        for play in np.flatnonzero(more).tolist():
            ratio = 1 + gained[play] / moving[play]
            grown[play] = f"it is left with {ratio:.3g} times the energy it began with"
    return seen, grown, _steady_speeds(rigs, net, rows["damping"])


def _steady_speeds(rigs: Rig, net: FloatArray, damping: FloatArray) -> FloatArray:
    """Speed at which the least damping holds a net force, m/s; 0 where none is positive."""
    least = rigs.damping - np.abs(rigs.damping_asymmetry) + np.minimum(damping, 0.0).sum(axis=0)
    return np.divide(np.abs(net), least, out=np.zeros_like(net), where=least > 0)


def _force_to_move(rigs: Rig, time: float) -> FloatArray:
    """Force per distance that moves each device so far from rest within a time, s; N/m."""
    return (rigs.damping + 2 * rigs.mass / time) / time


def _contact_energies(recording: Recording, truth: Truth, play: int, net: float) -> FloatArray:
    """Energy brought to each contact with the wall at zero, J, shape (contacts,).

    This is what the handle had on reaching the wall but for the work of the net force (N) beyond
    it, which is taken off; what a damper took before the face is gone.
    """
    inside = recording.position[play] > 0
    entered = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1
    return truth.energy[play][entered] - net * truth.handle[play][entered]


def _hands(hands: Sequence[Hand]) -> Hand:
    """Hands, each of one member, as one batch."""
    return Hand(
        **{
            field.name: np.array([float(np.asarray(getattr(each, field.name))) for each in hands])
            for field in fields(Hand)
        }
    )


#: What is not at rest in the end is played again, so many times as long: what dies out slowly is
#: told from what lasts. What would be refused then, once more where a device that is let go of
#: takes longer than a trial.
_LONGER, _LONGEST = 3, 12
#: What is less than the slowest motion of the linear loop leaves, at this part of its rate, is also
#: dying out: springs may be at a thirty-second of their gain.
_AT_LEAST = 1 / 64
#: Force that keeps oscillating may be this part of the force limit unless another is stated.
_FORCE = 0.01
#: Counts that may keep oscillating, or be travelled if nothing pushes; so many times more where the
#: force of a damper is chopped.
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
    """All trials of one controller, in the order they were played."""

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
    force_allowed: float | Sequence[float] | None = None,
    seed: int = 0,
) -> tuple[Rehearsal, ...]:
    """Plays the standard trials of every controller of a batch on one device, in every condition.

    Conditions are hands off and, if a hand is given, held; with the Coulomb friction of the device
    and, because it may be less than thought, without any; other devices without any. Trials are
    releases, pushes, small starts and falls into a wall; elements beside the controller's own
    effects are also entered, left and scaled while they act. All of it is one run; what is not at
    rest in the end, and only that, is judged by a longer one.

    Args:
        rig: the truth, one device.
        controller: effects and filters, numbers or shape (batch,), about zero: walls of side -1
            have their face there. Walls of side 1 stand where they are while a program calls, and
            are out of the way before.
        hand: that holds the handle, or None for hands off only.
        others: devices with the same modes and sample time that this one may be as well.
        duration: of each trial, s; three times as long where anything is not at rest by then, and
            twelve times where it would be refused then and m/b is longer than this.
        reach: displacement of the release and height of the fall, m (rad), a number or shape
            (batch,); None for 1000 counts.
        push: the force limit that the pushes are measured by, N (N·m), a number or shape
            (batch,); None for the rig's.
        force_allowed: amplitude of the force at the end that counts as settled beside three counts
            of the readings, N (N·m), a number or shape (batch,); None for 1 % of ``push``. Within a
            count or so an encoder keeps a frictionless device moving with about the force of its
            ripple: where a ripple of r rms is accepted, allow at least 3·√2·r.
        seed: of tremor, if the hand has any.

    Returns:
        One rehearsal a controller.

    Raises:
        ValueError: more than one device, or neither an encoder nor a reach, or neither a force
            limit nor a push.
    """
    sizes = _Sizes.of(rig, controller.size(), reach=reach, push=push, duration=duration)
    conditions = _conditions(rig, hand, others)
    plays = _plays(controller, conditions, sizes.batch)
    force = _FORCE * sizes.limit
    if force_allowed is not None:
        force = np.broadcast_to(np.asarray(force_allowed, dtype=np.float64), (sizes.batch,))
    ends: dict[int, Ending] = {}
    rates = _slowest_rates(controller, conditions, sizes.batch)
    left: list[int] = list(range(len(plays)))
    slow = any(np.any(each.mass > duration * each.damping) for each in (rig, *others))
    for times in (1, _LONGER, _LONGEST) if slow else (1, _LONGER):
        samples = times * sizes.samples
        part = [plays[k] for k in left]
        seeds = [seed + k for k in left]
        seen, grown, steady = _played(
            controller, conditions, sizes, part, samples=samples, seeds=seeds
        )
        count = sizes.count[[play.member for play in part]]
        long = PART * samples * float(rig.sample_time[0])
        dies = np.maximum(DIES, np.exp(-_AT_LEAST * rates * long))
        allowed: list[Allowed] = []
        for play, travel in zip(part, steady * long / count, strict=True):
            # Where a damper is chopped, whatever force it makes of a few counts.
            chopped, k = _KINDS[play.name].dampers, play.member
            allowed.append(
                Allowed(
                    counts=_CHOPPED * _COUNTS if chopped else _COUNTS,
                    force=float(2 * sizes.limit[k] if chopped else force[k]),
                    dies=float(dies[play.place, k]),
                    steady=float(travel),
                )
            )
        found = endings(seen.position, seen.force, count, allowed)
        ends |= {k: _with(end, more) for k, end, more in zip(left, found, grown, strict=True)}
        left = [
            k for k in left if (ends[k].verdict != "settles" if times > 1 else not ends[k].at_rest)
        ]
        if not left:
            break
    return tuple(
        Rehearsal(
            trials=tuple(
                _trial(play.name, conditions[play.place], ends[k])
                for k, play in enumerate(plays)
                if play.member == member
            )
        )
        for member in range(sizes.batch)
    )


def _slowest_rates(
    controller: Controller, conditions: Sequence[_Condition], batch: int
) -> FloatArray:
    """Slowest rate at which each linear loop comes to rest, 1/s, shape (conditions, batch).

    With all elements of a controller or with none, in continuous time: what is slow is slow beside
    sampling, delay and filters. A position that nothing binds does not count.
    """
    rows = controller.rows(np.arange(batch))
    found = np.empty((len(conditions), batch))
    for place, condition in enumerate(conditions):
        rig, hand = condition.rig, condition.hand
        mass, damping, stiffness = (
            np.stack([own * np.ones(batch), own + np.sum(rows[name], axis=0)])
            for name, own in (
                ("mass", rig.mass + hand.mass),
                ("damping", rig.damping + hand.damping),
                ("stiffness", rig.stiffness + hand.stiffness),
            )
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(np.maximum(damping**2 - 4 * mass * stiffness, 0.0))
            bound = np.where(root > 0, 2 * stiffness / (damping + root), damping / (2 * mass))
        rate = np.where(stiffness > 0, bound, damping / mass)
        found[place] = np.nan_to_num(np.maximum(rate, 0.0)).min(axis=0)
    return found


def _with(ending: Ending, grown: str) -> Ending:
    """What became of a trial, judged by its energy too, a sentence if it grew."""
    if not grown or ending.verdict == "diverges":
        return ending
    return replace(ending, verdict="diverges", at_rest=False, reason=grown)


def _trial(name: TrialName, condition: _Condition, ending: Ending) -> Trial:
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
