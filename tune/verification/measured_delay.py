"""Measured delay: the interval a log allows, and what keeps the profile's margin over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tune.documents.effects import Effects
from tune.documents.profile import Design, LoopProfile
from tune.loop.filters import Filters
from tune.verification.consistent_loops import ConsistentLoops, MeasuredMode, Modes
from tune.verification.elements import moment_in_words, moments_of
from tune.verification.margins_kept import Kept, judge_margin
from tune.verification.measured_cutoffs import MeasuredCutoff, allowed_filters
from tune.verification.outcome import Outcome, unassessed_outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredDelay:
    """What a log tells of the delay, and whether what was played keeps its margin.

    Attributes:
        allowed: loops that move as the log shows; None where neither frequency nor decay is known.
        played: whether what was played keeps its margin on all of them; None likewise.
        filters: all that the log allows.
        outcome: "delay".
    """

    allowed: ConsistentLoops | None
    played: Kept | None
    filters: tuple[Filters, ...]
    outcome: Outcome


def judge_delay(
    profile: Design,
    loop: LoopProfile,
    moment: tuple[str, ...],
    effects: Effects,
    mode: MeasuredMode,
    cutoffs: tuple[MeasuredCutoff, ...],
) -> MeasuredDelay:
    """Find the delays a log allows and judge the profile's margin on all loops of these.

    Args:
        profile: with the box of its device and the margin to keep.
        loop: the filters that were run.
        moment: the elements played.
        effects: as played, at their gain.
        mode: of the free motion.
        cutoffs: intervals of the filters.

    Raises:
        LoopError: a delay that is too long to be judged.
    """
    if mode.frequency is None and mode.decay is None:
        return unknown_delay("neither frequency nor decay of free motion is known")
    filters = allowed_filters(loop, cutoffs)
    extra = profile.margin.extra_delay_samples
    allowed = Modes(profile.device, filters[0], effects, extra=extra).allow(mode)
    played = judge_margin(profile, moment, filters, allowed)
    return MeasuredDelay(
        allowed=allowed, played=played, filters=filters, outcome=_outcome(profile, allowed, played)
    )


def margins_of_others(
    profile: Design, seen: MeasuredDelay, say: Callable[[str], None] = lambda _: None
) -> tuple[Kept, ...]:
    """Which moments that were not played keep their margin on all loops that the log allows."""
    if seen.allowed is None or seen.played is None:
        return ()
    found: list[Kept] = []
    others = [moment for moment in moments_of(profile, None) if moment != seen.played.moment]
    for number, moment in enumerate(others, 1):
        say(f"what the log tells of {moment_in_words(moment)} ({number} of {len(others)})")
        found.append(judge_margin(profile, moment, seen.filters, seen.allowed))
    return tuple(found)


def unknown_delay(why: str) -> MeasuredDelay:
    """Nothing is known of the delay, and why."""
    return MeasuredDelay(
        allowed=None, played=None, filters=(), outcome=unassessed_outcome("delay", why)
    )


def delays_in_words(low: float, high: float) -> str:
    """A range of delays in words."""
    return f"{low:.3g} sample(s)" if low == high else f"{low:.3g} to {high:.3g} samples"


def _outcome(profile: Design, allowed: ConsistentLoops, played: Kept) -> Outcome:
    stated = delays_in_words(*allowed.stated)
    margin = profile.margin
    kept = f"gain {margin.gain:g} and {margin.extra_delay_samples:g} sample(s) kept at each"
    numbers = {
        "predicted_low": allowed.stated[0],
        "predicted_high": allowed.stated[1],
        "gain": margin.gain,
        "extra_delay_samples": margin.extra_delay_samples,
    }
    if allowed.delays is None:
        return Outcome(
            check="delay",
            verdict="disagrees",
            seen=f"no delay up to {allowed.most:g} samples explains frequency and decay",
            predicted=stated,
            tolerance="mass and damping within the box of the device",
            remedy="Identify the device again, with no hand on it.",
            numbers=numbers | {"most": allowed.most},
        )
    numbers |= {"seen_low": allowed.delays[0], "seen_high": allowed.delays[1]}
    seen = delays_in_words(*allowed.delays) + (" or more" if allowed.open_ended else "")
    if not allowed.allow_stated:
        return Outcome(
            check="delay",
            verdict="disagrees",
            seen=seen,
            predicted=stated,
            tolerance="mass and damping within the box of the device",
            remedy="Correct the delay of the device, and tune again.",
            numbers=numbers,
        )
    if played.lost_at is not None:
        return Outcome(
            check="delay",
            verdict="cannot tell",
            seen=seen,
            predicted=stated,
            tolerance=(
                f"{kept}: lost from {played.lost_at:.3g} on for {moment_in_words(played.moment)}"
            ),
            numbers=numbers | {"lost_at": played.lost_at},
        )
    return Outcome(
        check="delay",
        verdict="agrees",
        seen=seen,
        predicted=stated,
        tolerance=kept,
        numbers=numbers,
    )
