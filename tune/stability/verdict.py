"""Stability verdict: is a loop stable, over which gains, how large may one effect become.

One criterion and one way of finding boundaries serve every combination of effects: the published
limits (6), (13), (19), (25), (28), (36) and (43) are what `largest` and `is_stable` answer when
the other effects are absent. One file: every question about stability goes through the same two
polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.loop.coefficients import Terms
from tune.loop.factors import Factors
from tune.loop.loop import Loop
from tune.stability.batch_verdicts import judge_of
from tune.stability.criterion import VerdictArray, routh
from tune.stability.crossings import Ratio
from tune.stability.intervals import Intervals, stable_intervals, stable_up_to

FloatArray = NDArray[np.float64]
#: Points from which it is worth while to set up a judge of many.
_MANY = 64


def verdict(loop: Loop, effects: Effects) -> VerdictArray:
    """+1 stable, -1 unstable, 0 nearer to the boundary than float64 can tell.

    Args:
        loop: of shape (*shape); () for one device.
        effects: broadcast against the loop; ``None`` marks an effect that is not there, and
            without stiffness the pole of free motion is left out of the judgement.

    Returns:
        int8 array of the broadcast shape.
    """
    given = effects.arrays()
    shape = np.broadcast_shapes(
        loop.terms.free.shape[1:], *(value.shape for value in given if value is not None)
    )
    if loop.terms.free.ndim > 1 or (loop.degree != 4 and np.prod(shape) < _MANY):
        return _general(loop, effects, shape)
    present: dict[EffectName, FloatArray] = {
        name: np.broadcast_to(value, shape).reshape(-1)
        for name, value in zip(EFFECT_NAMES, given, strict=True)
        if value is not None
    }
    result = np.empty(int(np.prod(shape)), dtype=np.int8)
    judge = judge_of(
        _table(loop, loop.terms, present),
        _table(loop, loop.sizes, present),
        position_free=loop.has_free_pole(effects),
    )
    for start in range(0, result.size, judge.block):
        block = slice(start, start + judge.block)
        judge.judge(tuple(value[block] for value in present.values()), result[block])
    open_ = np.flatnonzero(result == 0)
    if open_.size:
        rest = Effects(**{name: value[open_] for name, value in present.items()})
        result[open_] = _general(loop, rest, open_.shape)
    return result.reshape(shape)


def is_stable(loop: Loop, effects: Effects) -> NDArray[np.bool_]:
    """True where the loop is certainly stable; undecided counts as unstable. See `verdict`.

    The answer has the shape of loop and effects together.
    """
    return verdict(loop, effects) > 0


def gain_interval(loop: Loop, effects: Effects) -> Intervals:
    """Stable gains around s = 1 when K, B and M are all multiplied by s.

    Returns:
        Ends of the broadcast shape: the loop is stable for every s strictly between. Both nan
        where the effects as given are not certainly stable.
    """
    intervals = stable_gains(loop, effects)
    inside = (intervals.low < 1) & (intervals.high > 1)
    return _pick(intervals, inside)


def safe_gain(loop: Loop, effects: Effects) -> FloatArray:
    """Largest g such that every gain in (0, g) is stable; 0 where small gains are unstable.

    This, not the end of the interval around 1, is the gain margin of a profile: ramps, fades and
    saturation all lower the gain (docs/theory.md, 4).
    """
    intervals = stable_gains(loop, effects)
    return np.nan_to_num(_pick(intervals, intervals.low == 0).high, nan=0.0, posinf=np.inf)


def safe_up_to(loop: Loop, effects: Effects, gain: float) -> NDArray[np.bool_]:
    """True where every gain in (0, gain] is certainly stable: `safe_gain` > gain, in less time.

    The answer has the shape of loop and effects together.
    """
    return stable_up_to(*_by_gain(loop, effects), gain)


def stable_gains(loop: Loop, effects: Effects) -> Intervals:
    """All intervals of gains s > 0 at which s·(K, B, M) is stable.

    Returns:
        Ends of shape (intervals, *shape), ascending; unused entries are nan.
    """
    ratio = None if loop.factors is None else _ratio(loop, loop.factors, Effects(), effects)
    return stable_intervals(*_by_gain(loop, effects), ratio)


def _by_gain(loop: Loop, effects: Effects) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A and B of A + gain·B, and the absolute sums behind them."""
    total, sizes = loop.polynomial(effects)
    free = _like(loop.terms.free, total)
    free_size = _like(loop.sizes.free, total)
    start = loop.lowest_power(effects)
    return (
        free[start:],
        (total - free)[start:],
        free_size[start:],
        (sizes - free_size)[start:],
    )


def largest(loop: Loop, name: EffectName, effects: Effects | None = None) -> FloatArray:
    """Largest stable value of one effect with the others as given.

    The end of the interval that is connected to zero: from zero upwards every smaller positive
    value is stable too.

    Args:
        loop: of any shape.
        name: "stiffness", "damping" or "mass".
        effects: the other effects; what they say of ``name`` itself is not read.

    Returns:
        K in N/m, B in N·s/m or M in kg, of the broadcast shape; 0 where not even an arbitrarily
        small positive value is stable, inf where there is no limit.
    """
    intervals = stable_values(loop, name, effects)
    return np.nan_to_num(_pick(intervals, intervals.low == 0).high, nan=0.0, posinf=np.inf)


def stable_values(
    loop: Loop, name: EffectName, effects: Effects | None = None, *, sign: int = 1
) -> Intervals:
    """All stable intervals of the size of one effect, the others as given.

    Args:
        loop: of any shape.
        name: the effect that varies.
        effects: the others.
        sign: +1 for positive values, -1 for the sizes of negative ones.

    Returns:
        Ends in sizes, of shape (intervals, *shape), ascending, nan where unused.
    """
    others = effects or Effects()
    given = {key: getattr(others, key) for key in EFFECT_NAMES if key != name}
    base, base_size = loop.polynomial(Effects(**given))
    index = EFFECT_NAMES.index(name)
    term = (loop.terms.alpha, loop.terms.beta, loop.terms.gamma)[index]
    size = (loop.sizes.alpha, loop.sizes.beta, loop.sizes.gamma)[index]
    scale = loop.scales[index]
    varied = Effects(**{name: float(sign)})
    start = loop.lowest_power(Effects(**given, **{name: float(sign)}))
    return stable_intervals(
        base[start:],
        sign * _like(term * scale, base)[start:],
        base_size[start:],
        _like(size * scale, base)[start:],
        None if loop.factors is None else _ratio(loop, loop.factors, Effects(**given), varied),
    )


def _ratio(loop: Loop, factors: Factors, fixed: Effects, varied: Effects) -> Ratio:
    """-(1 + G·C)/(G·C') on the axis, C the law of what is fixed and C' of what varies."""

    def ratio(v: FloatArray) -> NDArray[np.complex128]:
        plant, laws = factors.plant(v), factors.laws(v)

        def law(effects: Effects) -> NDArray[np.complex128]:
            total = np.zeros(v.shape, dtype=np.complex128)
            for value, part in zip(loop.dimensionless_effects(effects), laws, strict=True):
                if value is not None:
                    total += value * part
            return total

        return -(1 + plant * law(fixed)) / (plant * law(varied))

    return ratio


def _general(loop: Loop, effects: Effects, shape: tuple[int, ...]) -> VerdictArray:
    coefficients, sizes = loop.polynomial(effects)
    start = loop.lowest_power(effects)
    return np.broadcast_to(routh(coefficients[start:], sizes[start:]), shape)


def _table(loop: Loop, terms: Terms, present: Mapping[EffectName, object]) -> FloatArray:
    """(degree+1, 1 + effects): what is fixed and what each effect present adds for each unit."""
    parts = dict(
        zip(
            EFFECT_NAMES,
            zip((terms.alpha, terms.beta, terms.gamma), loop.scales, strict=True),
            strict=True,
        )
    )
    return np.stack([terms.free, *(parts[name][0] * parts[name][1] for name in present)], axis=1)


def _like(coefficients: FloatArray, total: FloatArray) -> FloatArray:
    missing = total.ndim - coefficients.ndim
    shaped = coefficients.reshape(coefficients.shape[0], *(1,) * missing, *coefficients.shape[1:])
    return np.broadcast_to(shaped, total.shape)


def _pick(intervals: Intervals, wanted: NDArray[np.bool_]) -> Intervals:
    """The first wanted interval of each loop; nan where there is none."""
    low, high = intervals
    index = np.argmax(wanted, axis=0)[None]
    found = np.any(wanted, axis=0)
    return Intervals(
        np.where(found, np.take_along_axis(low, index, axis=0)[0], np.nan),
        np.where(found, np.take_along_axis(high, index, axis=0)[0], np.nan),
    )
