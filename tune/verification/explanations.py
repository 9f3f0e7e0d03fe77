"""What the controller runs instead: other laws than the profile's, tried on the same log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EFFECT_NAMES, Effects
from tune.documents.profile import LoopProfile
from tune.verification.elements import scale_effects
from tune.verification.law import Columns, fit_free, fit_scaled
from tune.verification.variants import Log, Variant, variants

FloatArray = NDArray[np.float64]

#: An explanation explains if it leaves at most this part of what the profile's law leaves.
EXPLAINS = 0.2
#: Explanations within this factor of the best are equally good; the simplest of them is named.
_EQUALLY_GOOD = 3.0
#: Effects nearer to one gain than this part are scaled alike.
MATERIAL_SIZE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """A law that explains the log.

    Attributes:
        words: what the controller does.
        remedy: what to do about it.
        moment: the elements played.
        loop: the filters it runs.
        effects: what was played.
        late: rows by which the force column lags.
        residual: rms of the force left over, N.
        material: whether it differs from the profile's by more than matters.
    """

    words: str
    remedy: str
    moment: tuple[str, ...]
    loop: LoopProfile
    effects: Effects
    late: int
    residual: float
    material: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Unscaled:
    """An explanation by effects of their own sizes, and how far they are from any one gain."""

    explanation: Explanation
    oddness: tuple[int, float]


def explain(
    log: Log, loop: LoopProfile, moments: dict[tuple[str, ...], Effects], nothing: float
) -> Explanation | None:
    """The simplest of the laws that explain the log best.

    Args:
        log: the log.
        loop: the profile's.
        moments: what may have been played.
        nothing: residual that counts as none, N.
    """
    found: list[Explanation] = []
    for variant in variants(log, loop, moments):
        best = _scaled(log, variant, moments)
        if best is not None:
            found.append(best)
    free = sorted(_free(log, loop, moments), key=lambda each: each.oddness)
    found += [each.explanation for each in free]
    if not found:
        return None
    least = max(_EQUALLY_GOOD * min(each.residual for each in found), nothing)
    return next(each for each in found if each.residual <= least)


def _scaled(
    log: Log, variant: Variant, moments: dict[tuple[str, ...], Effects]
) -> Explanation | None:
    columns = log.columns(variant.loop, variant.late)
    if columns is None:
        return None
    fits = {moment: fit_scaled(columns, effects) for moment, effects in moments.items()}
    moment = min(fits, key=lambda each: fits[each].residual)
    return Explanation(
        words=variant.words,
        remedy=variant.remedy,
        moment=moment,
        loop=variant.loop,
        effects=scale_effects(moments[moment], fits[moment].gain),
        late=variant.late,
        residual=fits[moment].residual,
        material=variant.material,
    )


def _free(
    log: Log, loop: LoopProfile, moments: dict[tuple[str, ...], Effects]
) -> Iterator[_Unscaled]:
    """Effects that are not scaled alike."""
    columns = log.columns(loop)
    if columns is None:
        return
    free = fit_free(columns)
    played = {name: float(size) for name, size in _sizes(free.effects)}
    for moment, effects in moments.items():
        stated = {name: float(size) for name, size in _sizes(effects)}
        parts = {name: played[name] / size for name, size in stated.items()}
        extra = {
            name: size
            for name, size in played.items()
            if name not in stated and not _negligible(columns, name, size)
        }
        spread = max(parts.values()) / min(parts.values()) if min(parts.values()) > 0 else np.inf
        words = ", ".join(f"{name} at {part:.4g} of the profile's" for name, part in parts.items())
        words += "".join(f", a {name} of {size:.4g} besides" for name, size in extra.items())
        explanation = Explanation(
            words=f"the effects are not scaled alike: {words}",
            remedy="Scale all effects of an element by one gain, and check the unit of each: "
            "velocity per second, acceleration per second squared.",
            moment=moment,
            loop=loop,
            effects=Effects(
                **{name: size for name, size in played.items() if name in stated or name in extra}
            ),
            late=0,
            residual=free.residual,
            material=bool(extra) or abs(spread - 1) > MATERIAL_SIZE,
        )
        yield _Unscaled(explanation=explanation, oddness=(len(extra), spread))


def _sizes(effects: Effects) -> Iterator[tuple[str, FloatArray]]:
    for name, size in zip(EFFECT_NAMES, effects.arrays(), strict=True):
        if size is not None:
            yield name, size


def _negligible(columns: Columns, name: str, size: float) -> bool:
    part = {
        "stiffness": columns.position,
        "damping": columns.velocity,
        "mass": columns.acceleration,
    }[name]
    return abs(size) * float(np.sqrt(np.mean(part * part))) < MATERIAL_SIZE * columns.scale
