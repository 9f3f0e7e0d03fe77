"""Measured control law: does the logged force follow from the positions as the profile says?

One file: one fit of the law, and what it is held to say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.documents.profile import Design, LoopProfile
from tune.verification.decimal_digits import WHOLE, decimal_digit
from tune.verification.elements import effects_of, moment_in_words, scale_effects
from tune.verification.explanations import EXPLAINS, MATERIAL_SIZE, Explanation, explain
from tune.verification.law import LawFit, fit_scaled, noise_gain
from tune.verification.outcome import Outcome, unassessed_outcome
from tune.verification.variants import Log

FloatArray = NDArray[np.float64]

#: Part of the force that may stay unexplained where no other law explains it better.
_MISFIT = 0.01
#: A residual of this part of the force is none: single precision has no more digits.
_SINGLE = 1e-6
#: Rounding of slow positions is no white noise; it leaves up to this many times as much.
_DIGITS = 3.0
#: Elements whose laws fit within this factor of the best fit are told apart by their gain.
_ALIKE = 1.5
#: Force at its limit within this part is saturated.
_AT_LIMIT = 1e-6
#: Where the limit is not known: the largest force, unchanged while the handle moves by this part of
#: its reach, is it; ...
_PLATEAU = 0.05
#: ... no force while it moves by this part is outside of a one-sided wall.
_OUTSIDE = 0.01
#: Units in which a position is often logged, as m or rad in one of them.
_UNITS = {"mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "degrees": np.pi / 180}


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredLaw:
    """What the controller runs, as far as the log tells.

    Attributes:
        moment: the elements played.
        loop: filters of the law that was played.
        effects: as played; None where no law explains the force.
        gain: part of the profile's effects, by its own law; nan where the law is another.
        predicted: force of the profile's own law at its best gain, N, nan where not used; (n,).
        used: rows the law was judged on, shape (n,).
        outcomes: "law" and "gain".
    """

    moment: tuple[str, ...]
    loop: LoopProfile
    effects: Effects | None
    gain: float
    predicted: FloatArray
    used: NDArray[np.bool_]
    outcomes: tuple[Outcome, ...]


def judge_law(
    profile: Design,
    moments: tuple[tuple[str, ...], ...],
    force: FloatArray,
    position: FloatArray,
    gain: float | None,
    unit: str,
) -> MeasuredLaw:
    """Compare the logged force with the law of each moment.

    Args:
        profile: with the filters and sizes to expect.
        moments: that may have been played.
        force: N, shape (n,).
        position: m, shape (n,).
        gain: at which it was played, or None where the user did not say.
        unit: of force.
    """
    log = Log(force=force, position=position, used=rows_of_the_law(profile, force, position))
    effects = {moment: effects_of(profile, moment) for moment in moments}
    columns = log.columns(profile.loop)
    if columns is None or columns.scale == 0:
        why = f"{np.count_nonzero(log.used)} rows are neither saturated nor outside of the wall"
        outcome = unassessed_outcome("law", why, "Log a longer stretch, or play a lower gain.")
        return _unseen(
            profile, moments[0], log, (outcome, unassessed_outcome("gain", "no law is seen"))
        )
    fits = {moment: fit_scaled(columns, each) for moment, each in effects.items()}
    alike = _alike(fits, gain, _SINGLE * columns.scale)
    moment = alike[0]
    fit = fits[moment]
    nothing = _SINGLE * columns.scale
    found = None
    if fit.residual > nothing:
        # Also where rounding would explain what is left: a law that leaves far less proves that
        # it was not rounding.
        found = explain(log, profile.loop, effects, nothing)
        if found is not None and (
            found.residual > max(nothing, EXPLAINS * fit.residual) or not found.material
        ):
            found = None
    rounded = _DIGITS * _digits(profile, force, position, scale_effects(effects[moment], fit.gain))
    agrees = found is None and fit.residual <= max(rounded, _MISFIT * columns.scale)
    outcome = _law_outcome(fit, columns.scale, found, moment, unit, agrees=agrees)
    predicted = np.full(force.size, np.nan)
    predicted[columns.rows] = force[columns.rows] - fit.left
    if found is not None:
        return MeasuredLaw(
            moment=found.moment,
            loop=found.loop,
            effects=found.effects,
            gain=float("nan"),
            predicted=predicted,
            used=log.used,
            outcomes=(outcome, unassessed_outcome("gain", "the law is not the profile's")),
        )
    if not agrees:
        unsaid = (outcome, unassessed_outcome("gain", "no law explains the force"))
        return _unseen(profile, moment, log, unsaid)
    return MeasuredLaw(
        moment=moment,
        loop=profile.loop,
        effects=scale_effects(effects[moment], fit.gain),
        gain=fit.gain,
        predicted=predicted,
        used=log.used,
        outcomes=(
            outcome,
            _gain_outcome(fit.gain, gain, moment, {other: fits[other].gain for other in alike[1:]}),
        ),
    )


def rows_of_the_law(profile: Design, force: FloatArray, position: FloatArray) -> NDArray[np.bool_]:
    """Rows neither at the force limit nor outside of a one-sided wall, shape (n,)."""
    size = np.abs(force)
    largest = float(size.max())
    limit = profile.device.force_limit
    most = np.inf if limit is None else limit.peak
    saturated = size >= most * (1 - _AT_LIMIT)
    reach = float(np.ptp(position))
    saturated |= _moving(size >= largest * (1 - _AT_LIMIT), position, _PLATEAU * reach)
    return ~(saturated | _moving(force == 0, position, _OUTSIDE * reach))


def _moving(rows: NDArray[np.bool_], position: FloatArray, least: float) -> NDArray[np.bool_]:
    """Those stretches of ``rows`` over which the handle moves by at least ``least``, m."""
    kept = np.zeros(rows.size, dtype=np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.view(np.int8), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        kept[first:end] = np.ptp(position[first:end]) >= least
    return kept


def _alike(
    fits: dict[tuple[str, ...], LawFit], gain: float | None, floor: float
) -> list[tuple[str, ...]]:
    """The moments whose laws fit best, the one of the likeliest gain first."""
    least = max(min(fit.residual for fit in fits.values()), floor)
    alike = [moment for moment, fit in fits.items() if fit.residual <= _ALIKE * least]

    def unlikely(moment: tuple[str, ...]) -> float:
        seen = fits[moment].gain
        if gain is not None:
            return abs(seen - gain)
        return 0.0 if 0 < seen <= 1 + MATERIAL_SIZE else abs(seen - 1)

    return sorted(alike, key=unlikely)


def _digits(profile: Design, force: FloatArray, position: FloatArray, effects: Effects) -> float:
    """rms of force that rounding to the printed digits explains, N."""
    rounding = decimal_digit(force) / np.sqrt(12)
    resolution = profile.device.encoder_resolution
    digit = decimal_digit(position)
    if resolution is not None and digit > 0:
        counts = position / resolution.value
        if np.all(np.abs(counts - np.rint(counts)) * resolution.value < WHOLE * digit):
            digit = 0.0  # whole counts, printed exactly
    moved = digit / np.sqrt(12) * noise_gain(effects, profile.loop)
    return float(np.hypot(rounding, moved))


def _law_outcome(
    fit: LawFit,
    scale: float,
    found: Explanation | None,
    moment: tuple[str, ...],
    unit: str,
    *,
    agrees: bool,
) -> Outcome:
    left = f"{fit.residual:.2g} {unit} rms of {scale:.3g} {unit} unexplained"
    predicted = (
        f"-gain·(K·y + B·v + M·a) of {moment_in_words(moment)} with the filters of the profile"
    )
    tolerance = f"{_MISFIT:.0%} unexplained, and no other law that explains it better"
    numbers = {"seen": fit.residual, "scale": scale, "tolerance": _MISFIT}
    if agrees:
        return Outcome(
            check="law",
            verdict="agrees",
            seen=left,
            predicted=predicted,
            tolerance=tolerance,
            numbers=numbers,
        )
    if found is not None:
        share = f"{found.residual:.2g} {unit}"
        return Outcome(
            check="law",
            verdict="disagrees",
            seen=f"{left}; {found.words} ({share} unexplained)",
            predicted=predicted,
            tolerance=tolerance,
            remedy=found.remedy,
            numbers=numbers | {"unexplained": found.residual},
        )
    return Outcome(
        check="law",
        verdict="disagrees",
        seen=f"{left}; no other filter, shift or scaling that was tried explains it",
        predicted=predicted,
        tolerance=tolerance,
        remedy="Log the commanded force of the haptic controller alone, with no other force in it, "
        "beside the position it was computed from, every sample.",
        numbers=numbers,
    )


def _gain_outcome(
    seen: float,
    stated: float | None,
    moment: tuple[str, ...],
    others: dict[tuple[str, ...], float],
) -> Outcome:
    if stated is None:
        predicted, agrees = "above 0, at most 1", 0 < seen <= 1 + MATERIAL_SIZE
    else:
        predicted, agrees = f"{stated:g} as stated", abs(seen / stated - 1) <= MATERIAL_SIZE
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
            if any(abs(seen / asked / each - 1) < MATERIAL_SIZE for each in (size, 1 / size))
        ]
        remedy = "Check the gain, and the units of force and position. "
        remedy += f"Is one of them in {units[0]}?" if units else ""
    same = "".join(f", or {part:.5g} of {moment_in_words(other)}" for other, part in others.items())
    return Outcome(
        check="gain",
        verdict="agrees" if agrees else "disagrees",
        seen=f"{seen:.5g} of {moment_in_words(moment)}{same}",
        predicted=predicted,
        tolerance=f"{MATERIAL_SIZE:.0%}",
        remedy=remedy.strip(),
        numbers={
            "seen": seen,
            "tolerance": MATERIAL_SIZE,
            **({} if stated is None else {"predicted": stated}),
            **{f"seen as {moment_in_words(other)}": part for other, part in others.items()},
        },
    )


def _unseen(
    profile: Design, moment: tuple[str, ...], log: Log, outcomes: tuple[Outcome, ...]
) -> MeasuredLaw:
    return MeasuredLaw(
        moment=moment,
        loop=profile.loop,
        effects=None,
        gain=float("nan"),
        predicted=np.full(log.force.size, np.nan),
        used=log.used,
        outcomes=outcomes,
    )
