"""Measured control law: does the logged force follow from the positions as the profile says?

Where it does not, other laws are tried on the same log, the simplest first: shifted columns, other
filters, effects that are not scaled alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory
from tune.documents.estimators import DERIVATIVES, Derivative, filter_of
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import UNITS, Effects
from tune.loop.polynomials import FloatArray
from tune.verification.law import (
    Combination,
    Digits,
    LawFit,
    Log,
    Outcome,
    Wall,
    combination_in_words,
    compared,
    effects_of,
    fit_free,
    fit_scaled,
    rms,
    scale_effects,
    stretches,
    unassessed_outcome,
)

Combinations = dict[Combination, Effects]

#: Part of the force that may stay unexplained where no other law explains it better.
MISFIT = 0.01
#: A residual of this part of the force is none: single precision has no more digits.
_SINGLE = 1e-6
#: Rounding of slow positions is no white noise; it leaves up to this many times as much.
ROUNDING = 3.0
#: Elements whose laws fit within this factor of the best fit are told apart by their gain.
_ALIKE = 1.5
#: Force at its limit within this part is saturated.
_AT_LIMIT = 1e-6
#: Where the limit is not known: the largest force, unchanged while the handle moves by this part of
#: its reach, or by so many counts of a known encoder, is it; ...
_PLATEAU, _COUNTS = 0.05, 3.0
#: ... no force while it moves by this part is outside of a one-sided wall.
_OUTSIDE = 0.01
#: Units in which a position is often logged, as m or rad in one of them.
_UNITS = {"mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "degrees": np.pi / 180}

#: Digits after the point that are looked for in a column.
_MOST_DIGITS = 12
#: Part of a digit by which a printed number may miss a multiple of it, for it was rounded again.
_WHOLE = 1e-3

#: An explanation explains if it leaves at most this part of what the profile's law leaves.
_EXPLAINS = 0.2
#: Explanations within this factor of the best are equally good; the simplest of them is named.
_EQUALLY_GOOD = 3.0
#: A wall pushes on some rows only where that leaves at most this part of what is left else; on
#: which parts of the rows it is looked for.
_FAR_BETTER, _DEEPEST = 0.5, tuple(0.5**power for power in range(1, 10))
#: Effects nearer to one gain than this part are scaled alike.
_MATERIAL_SIZE = 0.02
#: Rows by which the force column may be early or late.
_SHIFTS = (1, -1, 2, -2)
#: Cut-offs looked through, Hz, up to this part of the sample rate, ...
_LOWEST, _HIGHEST = 1.0, 0.45
#: ... first on so many places, then between the best and its neighbours to this part.
_PLACES, _FINE = 40, 1e-4
#: Samples of the longest window looked for.
_WIDEST = 60
#: A cut-off nearer to the profile's than this part is the same to any margin.
_MATERIAL_CUTOFF = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredLaw:
    """What the controller runs, as far as the log tells."""

    elements: Combination
    loop: LoopProfile  # filters of the law that was played
    effects: Effects | None  # as played; None where no law explains the force
    gain: float  # part of the profile's effects, by its own law; nan where the law is another
    others: dict[Combination, float]  # gains at which the law is that of other elements as well
    predicted: FloatArray  # by the profile's own law at its best gain, N, nan where not used; (n,)
    log: Log  # with the rows the law was judged on
    acting: NDArray[np.bool_]  # those on which all elements act
    outcomes: tuple[Outcome, ...]  # "law" and "gain"


def judge_law(
    profile: Design,
    combinations: tuple[Combination, ...],
    trajectory: Trajectory,
    gain: float | None,
    digits: Digits,
    size: FloatArray,
) -> MeasuredLaw:
    """Compare the logged force with the law of each combination that may have been played.

    The gain is that at which it was played, or None where the user did not say. Force and position
    are printed to ``digits``; ``size`` is how large the force is in all directions, N, shape (n,).
    Where an element that fades seems to play another law, it is judged after its fade.
    """
    used = _rows_of_the_law(profile, size, trajectory.position, digits.force)
    seen = _judged(profile, combinations, trajectory, gain, digits, used)
    fades = {each: max(profile.elements[name].fade_time for name in each) for each in combinations}
    fading = tuple(each for each in combinations if fades[each])
    if fading and seen.outcomes[0].verdict == "disagrees":
        rows = int(np.ceil(max(fades.values()) / profile.loop.sample_time))
        faded = used & _faded(size, trajectory.position, rows)
        later = _judged(profile, fading, trajectory, gain, digits, faded)
        explains = later.outcomes[0].verdict == "agrees" or (later.effects and not seen.effects)
        seen = later if explains or seen.elements in fading else seen
    return _unless_cut(profile, seen, used, size, digits.force)


def _unless_cut(
    profile: Design, seen: MeasuredLaw, used: NDArray[np.bool_], size: FloatArray, digit: float
) -> MeasuredLaw:
    """The same, but where the law asks for more than a level below all limits it disagrees."""
    limit, level, law = profile.device.force_limit, float(size.max()), seen.outcomes[0]
    effects = seen.effects if law.verdict == "agrees" and seen.log.wall is None else None
    if limit is None or effects is None:
        return seen
    most = limit.continuous
    for names, gain in {seen.elements: seen.gain, **seen.others}.items():
        springs = sum(profile.elements[name].force_level for name in names) or np.inf
        most = min(most, gain * min(limit.peak, springs))
    cut = ~used & (size >= level * (1 - _AT_LIMIT) - digit)
    asked = float(np.max(np.abs(seen.log.asked(effects, seen.predicted)[cut]), initial=0.0))
    if min(most, asked - digit) <= level * (1 + _MATERIAL_SIZE):
        return seen
    unit = UNITS[profile.device.motion]["force"]
    law = replace(
        law,
        verdict="disagrees",
        seen=f"{law.seen}, but the force stays at {level:.4g} {unit} where the law asks for up to "
        f"{asked:.4g} {unit}; nothing in the profile cuts it below {most:.4g} {unit}",
        remedy="Log what the controller commands, with no limit but the profile's. If the drive "
        "gives no more, state that as force_limit of the device and tune again.",
        numbers={**law.numbers, "cut_at": level, "asked": asked, "profile_cuts_at": most},
    )
    return replace(seen, outcomes=(law, *seen.outcomes[1:]))


def _judged(
    profile: Design,
    combinations: tuple[Combination, ...],
    trajectory: Trajectory,
    gain: float | None,
    digits: Digits,
    used: NDArray[np.bool_],
) -> MeasuredLaw:
    """The law on certain rows of the log."""
    force, position = trajectory.force, trajectory.position
    log = Log(loop=profile.loop, force=force, position=position, used=used)
    combinations, log = _beside_a_wall(profile, combinations, log)
    effects = {combination: effects_of(profile, combination) for combination in combinations}
    unseen = MeasuredLaw(
        elements=combinations[0],
        loop=profile.loop,
        effects=None,
        gain=float("nan"),
        others={},
        predicted=np.full(force.size, np.nan),
        log=log,
        acting=used,
        outcomes=(),
    )
    columns = log.columns(profile.loop)
    if columns is None or columns.scale == 0:
        why = f"{np.count_nonzero(used)} rows are neither saturated, outside of the wall nor fading"
        outcome = unassessed_outcome("law", why, "Log a longer stretch, or play a lower gain.")
        return replace(unseen, outcomes=(outcome, unassessed_outcome("gain", "no law is seen")))
    fits = {combination: fit_scaled(columns, each) for combination, each in effects.items()}
    nothing = _SINGLE * columns.scale
    alike = _alike(fits, gain, nothing)
    combination = alike[0]
    fit = fits[combination]
    found = None
    if fit.residual > nothing:
        # Also where rounding would explain what is left: a law that leaves far less proves that
        # it was not rounding.
        found = _explain(log, profile.loop, effects, nothing)
        if found is not None and (
            found.residual > max(nothing, _EXPLAINS * fit.residual) or not found.law.material
        ):
            found = None
    if found is not None:
        combination, fit = found.elements, fits[found.elements]
    scaled = scale_effects(effects[combination], fit.gain)
    rounded = ROUNDING * digits.noise(scaled, profile.loop)
    # A wall that is met on few rows is judged on these as well.
    seen_on = (slice(None), columns.acting[columns.rows])
    every = ((rms(fit.left[part]), rms(columns.force[part])) for part in seen_on)
    residual, scale = max(every, key=lambda both: both[0] - MISFIT * both[1])
    agrees = found is None and residual <= max(rounded, MISFIT * scale)
    unit = UNITS[profile.device.motion]["force"]
    outcome = _law_outcome(residual, scale, found, combination, unit, agrees=agrees)
    predicted = np.full(force.size, np.nan)
    predicted[columns.rows] = force[columns.rows] - fit.left
    seen = replace(unseen, elements=combination, predicted=predicted, acting=columns.acting)
    if found is not None:
        return replace(
            seen,
            elements=found.elements,
            loop=found.law.loop,
            effects=found.effects,
            outcomes=(outcome, unassessed_outcome("gain", "the law is not the profile's")),
        )
    if not agrees:
        unsaid = unassessed_outcome("gain", "no law explains the force")
        return replace(seen, outcomes=(outcome, unsaid))
    others = {other: fits[other].gain for other in alike[1:]}
    return replace(
        seen,
        effects=scaled,
        gain=fit.gain,
        others=others,
        outcomes=(outcome, _gain_outcome(fit.gain, gain, combination, others)),
    )


def _beside_a_wall(
    profile: Design, combinations: tuple[Combination, ...], log: Log
) -> tuple[tuple[Combination, ...], Log]:
    """The same; where one fits far better with a wall that pushes on some rows only, that one."""

    def misfit(log: Log, *those: Combination) -> float:
        columns = log.columns(profile.loop)
        if columns is None or columns.scale == 0 or not columns.acting.any():
            return np.inf
        fits = (fit_scaled(columns, effects_of(profile, each)) for each in those)
        return min(fit.residual for fit in fits) / columns.scale

    parts = {
        each: tuple(tuple(n for n in each if (n in profile.walls) == of) for of in (True, False))
        for each in combinations
    }
    mixed = {each: both for each, both in parts.items() if all(both)}
    least = misfit(log, *combinations, *(others for _, others in mixed.values()))
    found = combinations, log
    if not MISFIT < least < np.inf:
        return found
    least *= _FAR_BETTER
    for (each, (walls, others)), side, part in product(mixed.items(), (1.0, -1.0), _DEEPEST):
        level = sum(profile.elements[name].force_level for name in walls) or np.inf
        own, beside = effects_of(profile, walls), effects_of(profile, others)
        wall = Wall(own=own, others=beside, level=level, side=side, part=part)
        left = misfit(split := replace(log, wall=wall), each)
        if left < least:
            least, found = left, ((each,), split)
    return found


def digits_of(profile: Design, axes: Sequence[Trajectory], direction: Sequence[float]) -> Digits:
    """What rounding to the printed digits leaves of a log in a direction, a unit vector."""
    parts = np.array(direction)
    force = parts * [_decimal_digit(each.force) for each in axes]
    position = parts * [_position_digit(profile, each.position) for each in axes]
    return Digits(force=float(np.linalg.norm(force)), position=float(np.linalg.norm(position)))


def _decimal_digit(column: FloatArray) -> float:
    """The decimal digit all values are multiples of; 0 where none of the first twelve is."""
    for power in range(_MOST_DIGITS):
        shifted = column * 10.0**power
        if np.all(np.abs(shifted - np.rint(shifted)) < _WHOLE):
            return 10.0**-power
    return 0.0


def _position_digit(profile: Design, position: FloatArray) -> float:
    """That of positions; 0 where they are whole counts, printed exactly."""
    resolution, digit = profile.device.encoder_resolution, _decimal_digit(position)
    if resolution is not None and digit > 0:
        counts = position / resolution.value
        if np.all(np.abs(counts - np.rint(counts)) * resolution.value < _WHOLE * digit):
            return 0.0
    return digit


def _rows_of_the_law(
    profile: Design, size: FloatArray, position: FloatArray, digit: float
) -> NDArray[np.bool_]:
    """Rows neither at the force limit nor outside of a one-sided wall, shape (n,)."""
    largest = float(size.max())
    limit = profile.device.force_limit
    most = np.inf if limit is None else limit.peak
    saturated = size >= most * (1 - _AT_LIMIT)
    reach = float(np.ptp(position))
    resolution = profile.device.encoder_resolution
    least = _PLATEAU * reach
    if resolution is not None:
        least = min(least, _COUNTS * resolution.value)
    saturated |= _moving(size >= largest * (1 - _AT_LIMIT) - digit, position, least)
    return ~(saturated | _moving(size == 0, position, _OUTSIDE * reach))


def _faded(size: FloatArray, position: FloatArray, rows: int) -> NDArray[np.bool_]:
    """All but so many rows from where the force sets in, and before it goes; shape (n,)."""
    kept = np.arange(size.size) >= np.argmax(size > 0) + rows
    for first, end in stretches(_moving(size == 0, position, _OUTSIDE * float(np.ptp(position)))):
        kept[max(first - rows, 0) : end + rows] = False
    return kept


def _moving(rows: NDArray[np.bool_], position: FloatArray, least: float) -> NDArray[np.bool_]:
    """Those stretches of ``rows`` over which the handle moves by at least ``least``, m."""
    kept = np.zeros(rows.size, dtype=np.bool_)
    for first, end in stretches(rows):
        kept[first:end] = np.ptp(position[first:end]) >= least
    return kept


def _alike(fits: dict[Combination, LawFit], gain: float | None, floor: float) -> list[Combination]:
    """The combinations whose laws fit best, the one of the likeliest gain first."""
    least = max(min(fit.residual for fit in fits.values()), floor)
    alike = [combination for combination, fit in fits.items() if fit.residual <= _ALIKE * least]

    def unlikely(combination: Combination) -> float:
        seen = fits[combination].gain
        if gain is not None:
            return abs(seen - gain)
        return 0.0 if 0 < seen <= 1 + _MATERIAL_SIZE else abs(seen - 1)

    return sorted(alike, key=unlikely)


def _law_outcome(
    residual: float,
    scale: float,
    found: _Explanation | None,
    combination: Combination,
    unit: str,
    *,
    agrees: bool,
) -> Outcome:
    seen = f"{residual:.2g} {unit} rms of {scale:.3g} {unit} unexplained"
    numbers = {"seen": residual, "scale": scale, "tolerance": MISFIT}
    remedy = ""
    if found is not None:
        seen += f"; {found.law.words} ({found.residual:.2g} {unit} unexplained)"
        remedy = found.law.remedy
        numbers["unexplained"] = found.residual
    elif not agrees:
        seen += "; no other filter, shift or scaling that was tried explains it"
        remedy = (
            "Log the commanded force of the haptic controller alone, with no other force in it, "
            "beside the position it was computed from, every sample."
        )
    return compared(
        "law",
        numbers,
        agrees=agrees,
        seen=seen,
        predicted=f"-gain·(K·y + B·v + M·a) of {combination_in_words(combination)} with the "
        "filters of the profile",
        tolerance=f"{MISFIT:.0%} unexplained, and no other law that explains it better",
        remedy=remedy,
    )


def _gain_outcome(
    seen: float, stated: float | None, combination: Combination, others: dict[Combination, float]
) -> Outcome:
    if stated is None:
        predicted, agrees = "above 0, at most 1", 0 < seen <= 1 + _MATERIAL_SIZE
    else:
        predicted, agrees = f"{stated:g} as stated", abs(seen / stated - 1) <= _MATERIAL_SIZE
    remedy = ""
    if seen <= 0:
        remedy = (
            "The sign of force or position is wrong, in the log or in the controller: force is "
            "what the actuator applies, positive along +position. Do not raise the gain."
        )
    elif not agrees:
        asked = 1.0 if stated is None else stated
        units = [
            name
            for name, size in _UNITS.items()
            if any(abs(seen / asked / each - 1) < _MATERIAL_SIZE for each in (size, 1 / size))
        ]
        remedy = "Check the gain, and the units of force and position."
        remedy += f" Is one of them in {units[0]}?" if units else ""
    same = "".join(
        f", or {part:.5g} of {combination_in_words(other)}" for other, part in others.items()
    )
    numbers = {"seen": seen, "tolerance": _MATERIAL_SIZE}
    numbers |= {} if stated is None else {"predicted": stated}
    numbers |= {f"seen as {combination_in_words(each)}": part for each, part in others.items()}
    return compared(
        "gain",
        numbers,
        agrees=agrees,
        seen=f"{seen:.5g} of {combination_in_words(combination)}{same}",
        predicted=predicted,
        tolerance=f"{_MATERIAL_SIZE:.0%}",
        remedy=remedy,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Variant:
    """One change of the law: what it is in words, what to do about it, whether it matters."""

    words: str
    remedy: str
    loop: LoopProfile
    late: int = 0
    material: bool = True


@dataclass(frozen=True, slots=True)
class _Explanation:
    """A law that explains the log: which, the effects played, and the rms it leaves, N."""

    law: _Variant
    elements: Combination
    effects: Effects
    residual: float


def _explain(
    log: Log, loop: LoopProfile, combinations: Combinations, nothing: float
) -> _Explanation | None:
    """The simplest of the laws that explain the log best; a residual of ``nothing`` is none."""
    found: list[_Explanation] = []
    for law in _variants(log, loop, combinations):
        columns = log.columns(law.loop, law.late)
        if columns is None:
            continue
        fits = {each: fit_scaled(columns, effects) for each, effects in combinations.items()}
        best = min(fits, key=lambda each: fits[each].residual)
        effects = scale_effects(combinations[best], fits[best].gain)
        found.append(_Explanation(law, best, effects, fits[best].residual))
    unscaled = sorted(_unscaled(log, loop, combinations), key=lambda each: each[0])
    found += [each for _, each in unscaled]
    if not found:
        return None
    least = max(_EQUALLY_GOOD * min(each.residual for each in found), nothing)
    return next(each for each in found if each.residual <= least)


def _unscaled(
    log: Log, loop: LoopProfile, combinations: Combinations
) -> Iterator[tuple[tuple[int, float], _Explanation]]:
    """Effects of their own sizes, with how far they are from any one gain."""
    columns = log.columns(loop)
    if columns is None:
        return
    free, residual = fit_free(columns)
    sizes = {name: float(size) for name, size in free.present().items()}
    sums = {
        name: abs(size) * rms(part)
        for (name, size), part in zip(sizes.items(), columns.parts, strict=True)
    }
    for combination, effects in combinations.items():
        parts = {name: sizes[name] / float(size) for name, size in effects.present().items()}
        extra = {
            name: size
            for name, size in sizes.items()
            if name not in parts and not sums[name] < _MATERIAL_SIZE * columns.scale
        }
        each = [abs(part) for part in parts.values()]
        spread = max(each) / min(each) if min(each) > 0 else np.inf
        flipped = [name for name, part in parts.items() if part < 0]
        words = ", ".join(f"{name} at {part:.4g} of the profile's" for name, part in parts.items())
        words += "".join(f", a {name} of {size:.4g} besides" for name, size in extra.items())
        law = _Variant(
            words=f"the effects are not scaled alike: {words}",
            remedy="Scale all effects of an element by one gain, and check the unit of each: "
            "velocity per second, acceleration per second squared."
            + (f" Is the sign of {' and '.join(flipped)} wrong?" if flipped else ""),
            loop=loop,
            material=bool(extra or flipped) or abs(spread - 1) > _MATERIAL_SIZE,
        )
        kept = {name: size for name, size in sizes.items() if name in {*parts, *extra}}
        yield (len(extra), spread), _Explanation(law, combination, Effects(**kept), residual)


def _variants(log: Log, loop: LoopProfile, combinations: Combinations) -> Iterator[_Variant]:
    """Every law that is tried with effects scaled alike, the simplest first."""
    for late in _SHIFTS:
        side = "late" if late > 0 else "early"
        yield _Variant(
            words=f"the force column is {abs(late)} row(s) {side}: each force answers the position "
            f"logged {abs(late)} row(s) {'before' if late > 0 else 'after'} it",
            remedy="Log each force beside the position it was computed from; if the controller "
            "itself uses an older position, add that delay to the device and tune again.",
            loop=loop,
            late=late,
        )
    run = "Run the filters of the profile, or state those you run in the scene and tune again."
    damped = any(each.damping is not None for each in combinations.values())
    heavy = any(each.mass is not None for each in combinations.values())
    both: dict[str, object] = {}
    for name, concerned in zip(DERIVATIVES, (damped, heavy), strict=True):
        if not concerned:
            continue
        bare = _bare(name)
        if any(getattr(loop, key) is not None for key in bare):
            both |= bare
            yield _Variant(
                words=f"{name} is not filtered", remedy=run, loop=loop.model_copy(update=bare)
            )
        yield from _other_filters(log, loop, combinations, name, run)
    if damped:
        yield _other_window(log, loop, combinations, run)
    if damped and heavy:
        yield _Variant(
            words="velocity and acceleration are not filtered",
            remedy=run,
            loop=loop.model_copy(update=both),
        )


def _bare(name: str) -> dict[str, object]:
    """What to change for an estimate without a filter."""
    bare: dict[str, object] = {f"{name}_filter_hz": None}
    return bare | ({"velocity_window_samples": None} if name == "velocity" else {})


def _other_filters(
    log: Log, loop: LoopProfile, combinations: Combinations, name: Derivative, remedy: str
) -> Iterator[_Variant]:
    """Other cut-offs and orders of one estimate."""
    mine, stated, order = filter_of(loop, name)
    own, told = (mine, order), _stated(loop, name)
    for kind, order in dict.fromkeys([own, ("low-pass", 1), ("low-pass", 2)]):

        def with_cutoff(hertz: float, kind: str = kind, order: int = order) -> LoopProfile:
            update = {f"{name}_filter_hz": hertz, f"{name}_filter_order": order}
            update |= {f"{name}_filter": kind}
            return loop.model_copy(update=_bare(name) | update)

        hertz = _best_cutoff(
            lambda f: _unexplained(log, with_cutoff(f), combinations), _HIGHEST / loop.sample_time
        )
        other = "" if (kind, order) == own else f" and order {order} instead of {own[1]}"
        yield _Variant(
            words=f"{name} is filtered at {hertz:.4g} Hz{other}; the profile has {told}",
            remedy=remedy,
            loop=with_cutoff(hertz),
            material=(kind, order) != own
            or stated is None
            or abs(hertz / stated - 1) > _MATERIAL_CUTOFF,
        )


def _other_window(log: Log, loop: LoopProfile, combinations: Combinations, remedy: str) -> _Variant:
    """Velocity over some last samples instead of what the profile has."""
    windows = [
        loop.model_copy(update=_bare("velocity") | {"velocity_window_samples": count})
        for count in range(2, _WIDEST + 1)
    ]
    best = min(windows, key=lambda each: _unexplained(log, each, combinations))
    return _Variant(
        words=f"velocity is taken over {best.velocity_window_samples} samples; the profile has "
        f"{_stated(loop, 'velocity')}",
        remedy=remedy,
        loop=best,
        material=best.velocity_window_samples != loop.velocity_window_samples,
    )


def _stated(loop: LoopProfile, name: Derivative) -> str:
    """What the profile has for an estimate, in words."""
    if name == "velocity" and loop.velocity_window_samples is not None:
        return f"a window of {loop.velocity_window_samples} samples"
    hertz = filter_of(loop, name).hertz
    return "no filter" if hertz is None else f"{hertz:.4g} Hz"


def _unexplained(log: Log, loop: LoopProfile, combinations: Combinations) -> float:
    """The least rms that a law leaves, N."""
    columns = log.columns(loop)
    if columns is None:
        return np.inf
    return min(fit_scaled(columns, effects).residual for effects in combinations.values())


def _best_cutoff(residual: Callable[[float], float], highest: float) -> float:
    from scipy.optimize import minimize_scalar

    places = np.geomspace(_LOWEST, highest, _PLACES)
    values = [residual(float(place)) for place in places]
    best = int(np.argmin(values))
    ends = np.log([places[max(best - 1, 0)], places[min(best + 1, _PLACES - 1)]])
    found = minimize_scalar(
        lambda logarithm: residual(float(np.exp(logarithm))),
        bounds=(ends[0], ends[1]),
        method="bounded",
        options={"xatol": _FINE},
    )
    return float(np.exp(found.x))
