"""Measured delay: loops that would move as the log shows, and what keeps its margin on them all.

In free motion a delay d under a spring K looks like damping: what decays is m·q̈ + (b - K·d)·q̇ +
K·q, so one log at one gain tells b - K·d and never d alone. What it tells is the set of all
(m, b, k, d), m, b and the device's own stiffness k within its box, whose slow mode is the measured
one. The range of d in it is the interval of the delay; and as each d comes with its own m, b and k,
the set says more of other gains than that interval beside the box.

What to play so that a log tells is found by trial, the least gain first: what the log would show of
the mode, the loops it would allow, and the margin on them, as a verification does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, count, product

import numpy as np

from identification import Device, counted, quantity
from tune.certificate.certify import refuse_unbalanced
from tune.certificate.claims import excess_over_request, impedances
from tune.certificate.region import setting_of
from tune.documents import LoopError
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop, filters_of, used_filters
from tune.loop.plant import LONGEST_DELAY, HandNumbers, ModeNumbers
from tune.loop.polynomials import ComplexArray, FloatArray
from tune.stability.verdict import safe_up_to
from tune.verification.law import (
    Combination,
    MeasuredCutoff,
    Outcome,
    Verdict,
    allowed_filters,
    combination_in_words,
    combinations_of,
    effects_of,
    scale_effects,
    unassessed_outcome,
)
from tune.verification.motion import (
    DECAY_TOLERANCE,
    MeasuredMode,
    Play,
    Prediction,
    plan_play,
    poles_by_size,
    predict,
)

Range = tuple[float, float]
#: (mass, damping, own stiffness) of loops, each of shape (n,).
_Rigid = tuple[FloatArray, FloatArray, FloatArray]

#: Imaginary parts below this part of the modulus are rounding: the pole is real.
_REAL = 1e-6
#: Samples of delay looked through beyond the stated one, and the step of the search.
_MOST_SAMPLES = 16.0
#: Masses, dampings and own stiffnesses that stand for the box, ...
_MASSES, _DAMPINGS, _STIFFNESSES = 21, 17, 5
#: ... and those, with every whole delay, at which the mode is computed: it is smooth between.
_KNOTS = 5
#: Parts of the margin's extra delay that are judged.
_PARTS = (0.5, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentLoops:
    """Devices and delays whose loop has a given slow mode, each of shape (n,)."""

    mass: FloatArray  # kg
    damping: FloatArray  # N·s/m
    position_stiffness: FloatArray  # slope of the device's own force by position, N/m
    delay_samples: FloatArray  # from command to measurement
    most: float  # the longest delay that was looked at, samples
    stated: Range  # of the device, samples

    @property
    def delays(self) -> Range | None:
        """(least, longest) delay, samples; None where no loop is allowed."""
        if self.delay_samples.size == 0:
            return None
        return float(self.delay_samples.min()), float(self.delay_samples.max())

    @property
    def open_ended(self) -> bool:
        """Whether the longest delay that was looked at is allowed, and so may be longer ones."""
        return self.delays is not None and self.delays[1] >= self.most

    @property
    def allow_stated(self) -> bool:
        """Whether a delay the device states is among them."""
        low, high = self.stated
        return bool(np.any((self.delay_samples >= low) & (self.delay_samples <= high)))


def consistent_loops(
    device: Device,
    filters: Filters,
    effects: Effects,
    seen: Iterable[MeasuredMode],
    *,
    extra: float,
    step: float = 0.5,
) -> tuple[ConsistentLoops, ...]:
    """The loops whose slow mode is the one seen, for each: of the device's box, of any delay.

    Effects are as played. So many ``extra`` samples of delay are to be judged beyond; ``step``
    between delays.
    """
    box, T = device.simultaneous_box(), device.sample_time.value
    stated = box.delay[0] / box.sample_time[1], box.delay[1] / box.sample_time[0]
    most = min(LONGEST_DELAY - extra, max(_MOST_SAMPLES, float(np.ceil(stated[1]))))
    delays = np.unique([*np.arange(0, most + step / 2, step), *stated, device.delay.value / T])
    masses, slopes = np.log(box.mass), _places(box.position_stiffness, _STIFFNESSES)
    places = delays, _places(masses, _MASSES), _places(box.damping, _DAMPINGS), slopes
    knots = np.arange(most + 1), _places(masses, _KNOTS), _places(box.damping, _KNOTS), slopes
    between = [
        _interpolated(knots, each, places) for each in _mode(device, filters, effects, knots)
    ]
    grid = np.meshgrid(*places, indexing="ij")
    found: list[ConsistentLoops] = []
    for mode in seen:
        inside = np.ones(grid[0].shape, dtype=np.bool_)
        for values, wanted in zip(between, (mode.frequency, mode.decay), strict=True):
            if wanted is not None:
                reach = _reach(values)
                inside &= (values + reach >= wanted[0]) & (values - reach <= wanted[1])
        found.append(
            ConsistentLoops(
                mass=np.exp(grid[1][inside]),
                damping=grid[2][inside],
                position_stiffness=grid[3][inside],
                delay_samples=grid[0][inside],
                most=most,
                stated=stated,
            )
        )
    return tuple(found)


def _mode(
    device: Device, filters: Filters, effects: Effects, knots: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """(frequency, Hz; decay, 1/s) at delays, logarithms of mass, dampings and own stiffnesses."""
    delays, *rigid = knots
    T, used = device.sample_time.value, used_filters(filters, effects)
    masses, damping, slope = (part.ravel() for part in np.meshgrid(*rigid, indexing="ij"))
    numbers = np.exp(masses), damping, slope
    loops = (_loops_over(device, numbers, each, used) for each in delays.tolist())
    slow = [poles_by_size(loop, effects, T)[0] for loop in loops]
    poles: ComplexArray = np.reshape(slow, [each.size for each in knots])
    swings = np.abs(poles.imag) > _REAL * np.abs(poles)
    return np.where(swings, np.abs(poles.imag), 0.0) / (2 * np.pi), -poles.real


def _loops_over(
    device: Device, rigid: _Rigid, delay: float, filters: Filters, hand: HandNumbers | None = None
) -> Loop:
    """Loops of a device whose rigid numbers vary; its modes and current lag at their best."""
    mass, damping, position_stiffness = rigid
    return Loop.from_numbers(
        mass=mass,
        damping=damping,
        sample_time=device.sample_time.value,
        delay_samples=delay,
        filters=filters,
        modes=tuple(ModeNumbers.of(mode) for mode in device.modes),
        hand=hand,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        position_stiffness=position_stiffness,
    )


def _interpolated(
    knots: tuple[FloatArray, ...], values: FloatArray, places: tuple[FloatArray, ...]
) -> FloatArray:
    """Values at all combinations of places, between the knots linear in each direction."""
    from scipy.interpolate import make_interp_spline

    for axis, (known, wanted) in enumerate(zip(knots, places, strict=True)):
        if known.size > 1:
            values = make_interp_spline(known, values, k=1, axis=axis)(wanted)
    return values


def _places(ends: Range | FloatArray, count: int) -> FloatArray:
    """Places from end to end; one where the ends are the same."""
    low, high = float(ends[0]), float(ends[1])
    return np.array([low]) if low == high else np.linspace(low, high, count)


def _reach(values: FloatArray) -> FloatArray:
    """How far values change halfway to the next place in the box, so that none slips between."""
    reach = np.zeros_like(values)
    for axis in (1, 2, 3):
        if values.shape[axis] > 1:
            reach += np.abs(np.gradient(values, axis=axis)) / 2
    return reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Whether one combination keeps its margin."""

    elements: Combination  # that act together
    # the least delay, samples, at which an allowed loop does not keep it; None where every one does
    lost_at: float | None


def judge_margin(
    profile: Design, combination: Combination, filters: tuple[Filters, ...], loops: ConsistentLoops
) -> Kept:
    """Whether a combination keeps the margin of its profile on some loops, under all filters.

    Every gain in (0, g] must be stable, and every gain in (0, 1] with half and all of the extra
    delay, without a hand and with every corner of the hand's box. Dampings are the ends of what is
    allowed with each mass and own stiffness, delays whole samples and the ends.
    """
    margin, effects = profile.margin, effects_of(profile, combination)
    used = dict.fromkeys(used_filters(each, effects) for each in filters)
    hands: list[HandNumbers | None] = [None]
    if profile.hand is not None:
        ends = ((each.low, each.high) for _, each in profile.hand)
        hands += [HandNumbers(*corner) for corner in dict.fromkeys(product(*ends))]
    tasks = [(0.0, margin.gain), *((part * margin.extra_delay_samples, 1.0) for part in _PARTS)]

    def keeps(delay: float) -> bool:
        rigid = _extremes(loops, delay)
        judged = product(used, hands, tasks)
        built = (
            (_loops_over(profile.device, rigid, delay + further, each, hand), gain)
            for each, hand, (further, gain) in judged
        )
        return all(np.all(safe_up_to(loop, effects, gain)) for loop, gain in built)

    lost = (delay for delay in _judged_delays(loops) if not keeps(delay))
    return Kept(elements=combination, lost_at=next(lost, None))


def _judged_delays(allowed: ConsistentLoops) -> list[float]:
    """The shortest and the longest delay and the whole samples between, samples, ascending."""
    delays = np.unique(allowed.delay_samples)
    ends = np.isin(delays, (delays.min(initial=np.inf), delays.max(initial=0.0)))
    return delays[ends | (delays % 1 == 0)].tolist()


def _extremes(allowed: ConsistentLoops, delay: float) -> _Rigid:
    """(mass, damping, own stiffness), of each first and last the ends of damping, at one delay."""
    here = allowed.delay_samples == delay
    parts = allowed.mass[here], allowed.damping[here], allowed.position_stiffness[here]
    order = np.lexsort((parts[1], parts[2], parts[0]))
    mass, damping, slope = (part[order] for part in parts)
    new = (np.diff(mass) > 0) | (np.diff(slope) > 0)
    ends = np.concatenate([[True], new]) | np.concatenate([new, [True]])
    return mass[ends], damping[ends], slope[ends]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredDelay:
    """What a log tells of the delay, and whether what was played keeps its margin."""

    # loops that move as the log shows; None where neither frequency nor decay is known
    allowed: ConsistentLoops | None
    kept: Kept | None  # on all of them; None likewise
    filters: tuple[Filters, ...]  # all that the log allows
    outcome: Outcome  # "delay"


def judge_delay(
    profile: Design,
    loop: LoopProfile,
    combination: Combination,
    effects: Effects,
    mode: MeasuredMode,
    cutoffs: tuple[MeasuredCutoff, ...],
) -> MeasuredDelay:
    """Find the delays a log allows and judge the profile's margin on all loops of these.

    LoopError where a delay is too long to be judged. Effects are as played, at their gain.
    """
    if mode.frequency is None and mode.decay is None:
        return unknown_delay("neither frequency nor decay of free motion is known")
    filters = allowed_filters(loop, cutoffs)
    extra = profile.margin.extra_delay_samples
    (allowed,) = consistent_loops(profile.device, filters[0], effects, [mode], extra=extra)
    kept = judge_margin(profile, combination, filters, allowed)
    return MeasuredDelay(
        allowed=allowed, kept=kept, filters=filters, outcome=_outcome(profile, allowed, kept)
    )


def margins_of_others(
    profile: Design, seen: MeasuredDelay, say: Callable[[str], None] = lambda _: None
) -> tuple[Kept, ...]:
    """Which combinations that were not played keep their margin on all loops a log allows."""
    if seen.allowed is None or seen.kept is None:
        return ()
    found: list[Kept] = []
    others = [each for each in combinations_of(profile, None) if each != seen.kept.elements]
    for number, combination in enumerate(others, 1):
        say(
            f"what the log tells of {combination_in_words(combination)} ({number} of {len(others)})"
        )
        found.append(judge_margin(profile, combination, seen.filters, seen.allowed))
    return tuple(found)


def unknown_delay(why: str) -> MeasuredDelay:
    """Nothing is known of the delay, and why."""
    outcome = unassessed_outcome("delay", why)
    return MeasuredDelay(allowed=None, kept=None, filters=(), outcome=outcome)


def _outcome(profile: Design, allowed: ConsistentLoops, kept: Kept) -> Outcome:
    def in_words(delays: Range) -> str:
        low, high = delays
        return counted(f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}", "sample")

    margin = profile.margin
    late = counted(f"{margin.extra_delay_samples:g}", "sample")
    numbers = {
        "predicted_low": allowed.stated[0],
        "predicted_high": allowed.stated[1],
        "gain": margin.gain,
        "extra_delay_samples": margin.extra_delay_samples,
    }
    verdict: Verdict = "disagrees"
    tolerance = "mass and damping within the box of the device"
    remedy = ""
    if allowed.delays is None:
        seen = f"no delay up to {allowed.most:g} samples explains frequency and decay"
        remedy = "Identify the device again, with no hand on it."
        numbers["most"] = allowed.most
    else:
        seen = in_words(allowed.delays) + (" or more" if allowed.open_ended else "")
        numbers |= {"seen_low": allowed.delays[0], "seen_high": allowed.delays[1]}
        claim = f"gain {margin.gain:g} and {late} kept at each"
        if not allowed.allow_stated:
            remedy = "Correct the delay of the device, and tune again."
        elif kept.lost_at is not None:
            verdict = "cannot tell"
            lost = f"lost from {kept.lost_at:.3g} on for {combination_in_words(kept.elements)}"
            tolerance = f"{claim}: {lost}"
            numbers["lost_at"] = kept.lost_at
        else:
            verdict, tolerance = "agrees", claim
    return Outcome(
        check="delay",
        verdict=verdict,
        seen=seen,
        predicted=in_words(allowed.stated),
        tolerance=tolerance,
        remedy=remedy,
        numbers=numbers,
    )


#: Gains that are tried, the least first.
_GAINS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0)
#: Other elements that are tried where an element's own motion does not tell.
_MOST_OTHERS = 5
#: Parts of a wall's damping, and of its stiffness, of which a spring that would tell has one.
_PARTS_OF_WALLS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.1)
#: Half-width of the measured frequency and decay as they are usually found, relative.
_USUAL_HALF = 0.02
#: Planning looks at whole samples of delay.
_STEP = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to play for one combination."""

    elements: Combination  # to be verified
    play: Play | None  # that tells; None where nothing does
    why: str  # what is wrong with playing the combination itself; "" where that tells
    add: str = ""  # an element that would tell, as a scene has it, where none does; "" for none

    def words(self, motion: str) -> str:
        """One or two sentences, for a "linear" or "rotary" axis."""
        name = combination_in_words(self.elements)
        if self.play is None:
            said = f"{name} cannot be verified: {self.why}; no other element tells its delay either"
            return said + (
                f": add `{self.add}`, which pulls too, to the scene, told apart from every wall, "
                "tune again and ask once more"
                if self.add
                else ""
            )
        if not self.why:
            return self.play.words(motion)
        return (
            f"{name} itself does not tell: {self.why}; for the delay {self.play.words(motion)}, "
            f"for law and filters {name}"
        )


def advise(
    profile: Design,
    targets: tuple[Combination, ...] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Advice, ...]:
    """What to play for each target, None for all: itself, else another element that tells of it.

    Raises CheckFailedError for a device that no effect can be certified on.
    """
    refuse_unbalanced(profile.device)
    every = combinations_of(profile, None)
    targets = every if targets is None else targets
    # A spring tells a delay best, unless it never pulls.
    singles = sorted(
        (each for each in every if len(each) == 1),
        key=lambda each: (each[0] in profile.walls, -profile.elements[each[0]].stiffness),
    )
    walls = [each for each in singles if each[0] in profile.walls][:_MOST_OTHERS]
    springs = [(each, cache(partial(_allowed_loops, each))) for each in _springs(profile, walls)]
    allowed = cache(partial(_allowed_loops, profile))
    found: list[Advice] = []
    for number, target in enumerate(targets, 1):
        say(
            f"looking for what tells of {combination_in_words(target)} ({number} of {len(targets)})"
        )
        play, why = _least_play(profile, [target], target, allowed)
        if play is None:
            others = [each for each in singles if each != target][:_MOST_OTHERS]
            play, _ = _least_play(profile, others, target, allowed)
        told = (
            each
            for each, loops in springs
            if _least_play(each, [(next(reversed(each.elements)),)], target, loops)[0]
        )
        add = "" if play else next(map(_as_in_a_scene, told), "")
        found.append(Advice(elements=target, play=play, why=why, add=add))
    return tuple(found)


def _springs(profile: Design, walls: Sequence[Combination]) -> list[Design]:
    """The profile with a spring more, of a name not in use: such as may be had, and pulls too.

    With a wall's damping or parts of it, as stiff as a hand gets what is asked for, at most as the
    wall: less damping swings longer.
    """
    found: list[Design] = []
    names = chain(["spring"], (f"spring_{number}" for number in count(2)))
    free = next(name for name in names if name not in profile.elements)
    for part, (wall, *_) in product(_PARTS_OF_WALLS, walls):
        own = profile.elements[wall]
        for stiffness in own.stiffness * np.array(_PARTS_OF_WALLS):
            sizes = {"stiffness": float(stiffness), "damping": part * own.damping}
            spring = own.model_copy(update={**sizes, "one_sided": False})
            trial = profile.model_copy(update={"elements": {**profile.elements, free: spring}})
            setting = setting_of(trial, (free,))
            if setting and not excess_over_request(trial, free, impedances(trial, setting)):
                found.append(trial)
                break
    return found


def _as_in_a_scene(profile: Design) -> str:
    """The last element, as stiff as may be."""
    name, spring = [*profile.elements.items()][-1]
    damping = f", damping: {spring.damping:.4g}" * bool(spring.damping)
    return f"{name}: {{stiffness: max{damping}}}"


def _least_play(
    profile: Design,
    players: Sequence[Combination],
    target: Combination,
    allowed: Callable[[Combination, float], tuple[ConsistentLoops, ...]],
) -> tuple[Play | None, str]:
    """(the play of least gain that tells of the target, why there is none)."""
    why, likely = "", None
    for gain, player in product(_GAINS, players):
        try:
            play, hindered = plan_play(profile, player, gain)
            if play is None:
                why = why or hindered
                continue
            filters = (filters_of(profile.loop),)
            kept = (
                judge_margin(profile, target, filters, loops).lost_at is None
                for loops in allowed(player, gain)
            )
            if next(kept):
                if all(kept):
                    return play, ""
                likely = likely or play
        except LoopError as error:
            why = str(error)
            continue
        why = "delays that do not keep the margin look the same in its motion"
    return likely, "" if likely is not None else why


def _allowed_loops(
    profile: Design, player: Combination, gain: float
) -> tuple[ConsistentLoops, ...]:
    """What a log would allow of the device at its best estimate, and with its least damping."""
    device, effects = profile.device, scale_effects(effects_of(profile, player), gain)
    least = device.model_copy(update={"damping": quantity(device.damping.low)})
    devices = (device, least) if device.damping.low < device.damping.value else (device,)
    seen = (_expected(predict(each, profile.loop, effects)) for each in devices)
    extra = profile.margin.extra_delay_samples
    filters = filters_of(profile.loop)
    return consistent_loops(device, filters, effects, seen, extra=extra, step=_STEP)


def _expected(prediction: Prediction) -> MeasuredMode:
    """The mode as a log would show it."""
    nominal = prediction.nominal
    hertz = (prediction.frequency_tolerance + _USUAL_HALF) * nominal.frequency
    slack = (DECAY_TOLERANCE + _USUAL_HALF) * nominal.decay
    swings = nominal.frequency - hertz, nominal.frequency + hertz
    return MeasuredMode(
        frequency=swings if nominal.frequency else None,
        decay=(nominal.decay - slack, nominal.decay + slack),
    )
