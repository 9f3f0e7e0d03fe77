"""Measured delay: loops that would move as the log shows, and what keeps its margin on them all.

In free motion a delay d under a spring K looks like damping: what decays is m·q̈ + (b - K·d)·q̇ +
K·q, so one log at one gain tells b - K·d and never d alone. What it tells is the set of all
(m, b, k, d), m, b and the device's own stiffness k within its box, whose slow mode is the measured
one. The range of d in it is the interval of the delay; and as each d comes with its own m, b and k,
the set says more of other gains than that interval beside the box.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import Effects, Hand
from tune.loop.loop import Filters, Loop, used_filters
from tune.loop.plant import LONGEST_DELAY, HandNumbers, ModeNumbers
from tune.loop.polynomials import companion_roots
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
    unassessed_outcome,
)
from tune.verification.motion import MeasuredMode

FloatArray = NDArray[np.float64]
Range = tuple[float, float]
#: (mass, damping, own stiffness) of loops, each of shape (n,).
_Rigid = tuple[FloatArray, FloatArray, FloatArray]

#: A pole nearer than this to w = -1, z = 0, is over within a sample: a delay leaves it.
_GONE = 1e-6
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


class Modes:
    """The slow mode under some effects, of any loop of a device's box and of any delay."""

    def __init__(
        self, device: Device, filters: Filters, effects: Effects, *, extra: float, step: float = 0.5
    ) -> None:
        """Computes it at the knots, for effects as played.

        So many ``extra`` samples of delay are to be judged beyond; ``step`` between delays.
        """
        box, T = device.simultaneous_box(), device.sample_time.value
        stated = box.delay[0] / box.sample_time[1], box.delay[1] / box.sample_time[0]
        most = min(LONGEST_DELAY - extra, max(_MOST_SAMPLES, float(np.ceil(stated[1]))))
        delays = np.unique([*np.arange(0, most + step / 2, step), *stated, device.delay.value / T])
        masses, slopes = np.log(box.mass), _places(box.position_stiffness, _STIFFNESSES)
        self._places = delays, _places(masses, _MASSES), _places(box.damping, _DAMPINGS), slopes
        knots = _places(masses, _KNOTS), _places(box.damping, _KNOTS)
        self._knots = np.arange(most + 1), *knots, slopes
        self._values = _mode(device, filters, effects, self._knots)
        self.most, self.stated = most, stated

    def allow(self, seen: MeasuredMode) -> ConsistentLoops:
        """The loops whose slow mode is the one seen."""
        grid = np.meshgrid(*self._places, indexing="ij")
        inside = np.ones(grid[0].shape, dtype=np.bool_)
        for values, wanted in zip(self._values, (seen.frequency, seen.decay), strict=True):
            if wanted is not None:
                between = _interpolated(self._knots, values, self._places)
                reach = _reach(between)
                inside &= (between + reach >= wanted[0]) & (between - reach <= wanted[1])
        return ConsistentLoops(
            mass=np.exp(grid[1][inside]),
            damping=grid[2][inside],
            position_stiffness=grid[3][inside],
            delay_samples=grid[0][inside],
            most=self.most,
            stated=self.stated,
        )


def _mode(
    device: Device, filters: Filters, effects: Effects, knots: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """(frequency, Hz; decay, 1/s) at delays, logarithms of mass, dampings and own stiffnesses."""
    delays, *rigid = knots
    T, used = device.sample_time.value, used_filters(filters, effects)
    masses, damping, slope = (part.ravel() for part in np.meshgrid(*rigid, indexing="ij"))
    numbers = np.exp(masses), damping, slope
    loops = (_loops_over(device, numbers, each, used) for each in delays.tolist())
    poles = np.stack([_slow_poles(loop, effects, T) for loop in loops])
    poles = poles.reshape(tuple(each.size for each in knots))
    swings = np.abs(poles.imag) > _REAL * np.abs(poles)
    return np.where(swings, np.abs(poles.imag), 0.0) / (2 * np.pi), -poles.real


def _loops_over(
    device: Device, rigid: _Rigid, delay: float, filters: Filters, hand: HandNumbers | None = None
) -> Loop:
    """Loops of a device whose rigid numbers vary; its modes and current lag at their best.

    LoopError for a delay, in samples, that is too long.
    """
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


def _slow_poles(loop: Loop, effects: Effects, sample_time: float) -> NDArray[np.complex128]:
    """The pole of least modulus of each loop, 1/s, shape (n,); free motion does not count."""
    closed, _ = loop.polynomial(effects)
    closed = closed[loop.lowest_power(effects) :]
    w = companion_roots(closed[:-1] / closed[-1])
    poles = np.full(w.shape, np.inf, dtype=np.complex128)
    alive = np.abs(1 + w) > _GONE
    poles[alive] = 2 / sample_time * np.arctanh(w[alive])
    return poles[np.argmin(np.abs(poles), axis=0), np.arange(w.shape[1])]


def _interpolated(
    knots: tuple[FloatArray, ...], values: FloatArray, places: tuple[FloatArray, ...]
) -> FloatArray:
    """Values at all combinations of places, between the knots linear in each direction."""
    for axis, (known, wanted) in enumerate(zip(knots, places, strict=True)):
        along = np.tensordot(_weights(known, wanted), values, axes=(1, axis))
        values = np.moveaxis(along, 0, axis)
    return values


def _weights(knots: FloatArray, places: FloatArray) -> FloatArray:
    """What each knot has in the value at each place, shape (places, knots); one knot has all."""
    if knots.size == 1:
        return np.ones((places.size, 1))
    first = np.clip(np.searchsorted(knots, places) - 1, 0, knots.size - 2)
    part = (places - knots[first]) / (knots[first + 1] - knots[first])
    weights, rows = np.zeros((places.size, knots.size)), np.arange(places.size)
    weights[rows, first], weights[rows, first + 1] = 1 - part, part
    return weights


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
    """Whether one combination keeps its margin.

    Attributes:
        elements: that act together.
        lost_at: the least delay, samples, at which an allowed loop does not keep the margin; None
            where every one keeps it.
    """

    elements: Combination
    lost_at: float | None


class MarginJudge:
    """Whether one combination keeps the margin of a profile, on any loops; what is known is kept.

    Every gain in (0, g] must be stable, and every gain in (0, 1] with the extra delay of the
    margin, half of it and all of it; without a hand and with every corner of the hand's box. Of
    each mass and own stiffness the least and the largest damping that is allowed are judged, at
    whole samples of delay and at the shortest and the longest delay.
    """

    def __init__(self, profile: Design, combination: Combination) -> None:
        """Takes a profile and elements felt together."""
        margin = profile.margin
        self._profile, self._combination = profile, combination
        self._effects = effects_of(profile, combination)
        self._hands = _hands_of(profile.hand)
        self._tasks = [(0.0, margin.gain)]
        self._tasks += [(part * margin.extra_delay_samples, 1.0) for part in _PARTS]
        #: Gain up to which all of the loops were found stable, or the least at which they were not.
        self._known: dict[tuple[object, ...], tuple[float, float]] = {}

    def judge(self, filters: tuple[Filters, ...], allowed: ConsistentLoops) -> Kept:
        """Judge all allowed loops, at the gain of the profile, under all filters."""
        delays = _judged_delays(allowed)
        lost = (delay for delay in delays if not self._keeps(filters, allowed, delay))
        return Kept(elements=self._combination, lost_at=next(lost, None))

    def keeps_all(self, filters: tuple[Filters, ...], allowed: ConsistentLoops) -> bool:
        """Whether the margin is kept on every loop; the longest delays, likely lost, go first."""
        delays = _judged_delays(allowed)[::-1]
        return all(self._keeps(filters, allowed, delay) for delay in delays)

    def _keeps(self, filters: tuple[Filters, ...], allowed: ConsistentLoops, delay: float) -> bool:
        """Whether the margin is kept on every loop of one delay, samples."""
        rigid = _extremes(allowed, delay)
        used = dict.fromkeys(used_filters(each, self._effects) for each in filters)
        return all(
            self._stable(rigid, delay + further, each, hand, gain)
            for each in used
            for hand in self._hands
            for further, gain in self._tasks
        )

    def _stable(
        self, rigid: _Rigid, delay: float, filters: Filters, hand: HandNumbers | None, gain: float
    ) -> bool:
        """Whether all loops of these masses, dampings and own stiffnesses are stable up to it."""
        which = (*(part.tobytes() for part in rigid), delay, filters, hand)
        up_to, not_at = self._known.get(which, (0.0, np.inf))
        if up_to < gain < not_at:
            loop = _loops_over(self._profile.device, rigid, delay, filters, hand)
            stable = np.all(safe_up_to(loop, self._effects, gain))
            up_to, not_at = (gain, not_at) if stable else (up_to, gain)
            self._known[which] = up_to, not_at
        return gain <= up_to


def _hands_of(hand: Hand | None) -> tuple[HandNumbers | None, ...]:
    """No hand, and every corner of a box of hands."""
    if hand is None:
        return (None,)
    ends = ((each.low, each.high) for each in (hand.mass, hand.damping, hand.stiffness))
    return (None, *(HandNumbers(*corner) for corner in dict.fromkeys(product(*ends))))


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
    """What a log tells of the delay, and whether what was played keeps its margin.

    Attributes:
        allowed: loops that move as the log shows; None where neither frequency nor decay is known.
        kept: whether what was played keeps its margin on all of them; None likewise.
        filters: all that the log allows.
        outcome: "delay".
    """

    allowed: ConsistentLoops | None
    kept: Kept | None
    filters: tuple[Filters, ...]
    outcome: Outcome


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
    allowed = Modes(profile.device, filters[0], effects, extra=extra).allow(mode)
    kept = MarginJudge(profile, combination).judge(filters, allowed)
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
        found.append(MarginJudge(profile, combination).judge(seen.filters, seen.allowed))
    return tuple(found)


def unknown_delay(why: str) -> MeasuredDelay:
    """Nothing is known of the delay, and why."""
    outcome = unassessed_outcome("delay", why)
    return MeasuredDelay(allowed=None, kept=None, filters=(), outcome=outcome)


def _outcome(profile: Design, allowed: ConsistentLoops, kept: Kept) -> Outcome:
    def in_words(delays: Range) -> str:
        low, high = delays
        return f"{low:.3g} sample(s)" if low == high else f"{low:.3g} to {high:.3g} samples"

    margin = profile.margin
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
        claim = f"gain {margin.gain:g} and {margin.extra_delay_samples:g} sample(s) kept at each"
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
