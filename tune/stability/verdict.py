"""Stability verdict: is a loop stable, over which gains, how large may one effect become.

One criterion and one way of finding boundaries serve every combination of effects: the published
limits (6), (13), (19), (25), (28), (36) and (43) are what `largest` and `is_stable` answer when
the other effects are absent. Boundaries along A(w) + s·B(w), s > 0, are positive roots of one
polynomial in x = ω², E_A·O_B - O_A·E_B, with s = -E_A/E_B, and the ends w = 0 and w = ∞
(docs/theory.md, 3). No iteration over s, no grid: between two neighbouring crossings nothing
changes, and the criterion decides once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.documents import refuse_unknown
from tune.documents.scene import EFFECT_NAMES, EffectName, Effects
from tune.loop.loop import Factors, Loop, Parts, Terms, divided, multiplied, part_of_loops
from tune.loop.polynomials import (
    UNIT,
    ComplexArray,
    FloatArray,
    companion_roots,
    pad_coefficients,
    part_of,
    parts_on_axis,
    product,
    spread,
)
from tune.stability.criterion import ULPS, VerdictArray, judge_many, routh

#: -A/B at w = jv without expanded products: v of shape (candidates, *shape).
_Ratio = Callable[[FloatArray], Parts]

#: Roots x this far off the real axis, relative to their size, are still tried: a touching pair
#: leaves the axis by the square root of the rounding error. A false one costs one more verdict.
_NEARLY_REAL = 1e-3
#: Newton steps on (x, s); each doubles the digits that the eigenvalues left (six or more).
_POLISHES = 4
#: Newton steps on v by the ratio, the part of v they look ahead for its slope, and the part they
#: may go: the coefficients of the polynomials have found v to better than that.
_REFINEMENTS, _AHEAD, _NEAR = 2, 1e-6, 1e-3


def _candidates(
    fixed: FloatArray, varied: FloatArray, ratio: _Ratio | None, polishes: int = _POLISHES
) -> FloatArray:
    """Every s > 0 at which a crossing may happen, (candidates, loops), inf where unused."""
    x, s, _ = _crossings(fixed, varied, polishes)
    if ratio is not None and s.size:
        s = _refined(x, s, ratio)
    return _with_ends(s, fixed, varied)


def _with_ends(s: FloatArray, fixed: FloatArray, varied: FloatArray) -> FloatArray:
    """Crossings with those at w = 0 and w = ∞, inf where unused."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -fixed[[0, -1]] / varied[[0, -1]]
    points = np.concatenate([s, ends])
    points[~((points > 0) & np.isfinite(points))] = np.inf
    return points


def _crossings(
    fixed: FloatArray, varied: FloatArray, polishes: int
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Every crossing at a frequency between nothing and infinity, A and B (degree+1, loops).

    x and s are (candidates, loops), nan where unused; beside them all roots in x as they were
    found, real or not.
    """
    even, odd = zip(parts_on_axis(fixed), parts_on_axis(varied), strict=True)
    resultant = product(odd[1], even[0])
    other = product(even[1], odd[0])
    length = max(len(resultant), len(other))
    scale = pad_coefficients(np.abs(resultant), length) + pad_coefficients(np.abs(other), length)
    resultant = pad_coefficients(resultant, length) - pad_coefficients(other, length)
    resultant[np.abs(resultant) <= 4 * UNIT * scale] = 0.0
    roots = _roots_of(resultant)
    x = _real_parts(roots, _NEARLY_REAL)
    both = np.stack(
        [pad_coefficients(part, len(even[0])) for part in (even[0], odd[0], even[1], odd[1])], 1
    )
    both = both[:, :, None]
    value, _ = _values(both, x)
    with np.errstate(divide="ignore", invalid="ignore"):
        # From whichever of the even and the odd part says it best.
        said = -value[:2] / value[2:]
        by_even = np.abs(value[2:3]) >= np.abs(value[3:]) * np.sqrt(x)
        s = np.where(by_even, said[:1], said[1:])[0]
    for _ in range(polishes):
        x, s = _newton(x, s, both)
    return x, s, roots


def _refined(x: FloatArray, s: FloatArray, ratio: _Ratio) -> FloatArray:
    """s where the ratio becomes real, by Newton's method on v; unchanged where that leads away."""
    with np.errstate(all="ignore"):
        start = np.sqrt(np.where(x > 0, x, np.nan))
        v = start.copy()
        for _ in range(_REFINEMENTS):
            places = np.concatenate([v, v * (1 + _AHEAD), v * (1 - _AHEAD)])
            here, above, below = np.split(ratio(places)[1], 3)
            v -= here / (above - below) * (2 * _AHEAD * v)
        real, imaginary = ratio(v)
        good = (np.abs(v - start) <= _NEAR * start) & (np.abs(imaginary) <= _NEAR * np.abs(s))
        good &= np.abs(real - s) <= _NEAR * np.abs(s)
        return np.where(good, real, s)


def _roots_of(polynomials: FloatArray) -> ComplexArray:
    """Roots of each column, nan where there are fewer."""
    length, columns = polynomials.shape
    roots = np.full((length - 1, columns), np.nan, dtype=np.complex128)
    present = polynomials != 0
    lead = np.where(present.any(axis=0), length - 1 - np.argmax(present[::-1], axis=0), 0)
    tail = np.argmax(present, axis=0)
    for top, bottom in {(int(a), int(b)) for a, b in zip(lead, tail, strict=True)}:
        degree = top - bottom
        chosen = np.flatnonzero((lead == top) & (tail == bottom))
        if degree < 1:
            continue
        part = polynomials[bottom : top + 1, chosen]
        roots[:degree, chosen] = companion_roots(part[:-1] / part[-1])
    return roots


def _real_parts(roots: ComplexArray, nearly: float) -> FloatArray:
    """Positive real parts of the roots that are real to a part of them, nan elsewhere."""
    with np.errstate(invalid="ignore"):
        real = (roots.real > 0) & (np.abs(roots.imag) <= nearly * np.abs(roots.real))
    return np.where(real, roots.real, np.nan)


def _values(parts: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and slopes, (polynomials, candidates, loops); parts lead with the coefficients."""
    value = parts[-1] + np.zeros_like(x)
    slope = np.zeros_like(value)
    for row in parts[-2::-1]:
        slope *= x
        slope += value
        value *= x
        value += row
    return value, slope


def _newton(x: FloatArray, s: FloatArray, parts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One Newton step on the pair of equations; a step that leaves (0, 2x] is not taken."""
    value, slope = _values(parts, x)
    e_b, o_b = value[2:]
    e, o = value[:2] + s * value[2:]
    e_x, o_x = slope[:2] + s * slope[2:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = e_x * o_b - o_x * e_b
        dx = (e * o_b - o * e_b) / determinant
        ds = (e_x * o - o_x * e) / determinant
        good = np.isfinite(dx) & np.isfinite(ds) & (np.abs(dx) < 0.5 * x)
        return np.where(good, x - dx, x), np.where(good, s - ds, s)


#: A root in x this far off the axis, relative, belongs to a pair that may come to touch it.
_ALMOST_REAL = 0.7
#: Neighbouring crossings closer than this, relative, are one.
_SAME = 64 * UNIT
#: Where only a top matters, crossings beyond so many times it, after so few Newton steps, are
#: certainly beyond it; for nearer ones the intervals decide.
_BEYOND, _ROUGH_POLISHES = 1.01, 2


class Intervals(NamedTuple):
    """Open intervals of a gain or a size, stable strictly inside; shape (intervals, *shape).

    Unused entries are nan, and so is the end of an interval from 0 where what is given is not
    finite.
    """

    low: FloatArray  # lower ends; 0 where the interval is connected to zero
    high: FloatArray  # upper ends, of the same shape; inf where there is no end


def stable_intervals(
    fixed: FloatArray,
    varied: FloatArray,
    fixed_size: FloatArray,
    varied_size: FloatArray,
    ratio: _Ratio | None = None,
) -> Intervals:
    """All intervals of s in (0, ∞) on which fixed + s·varied has every root in Re w < 0.

    Fixed A and varied B are (degree+1, *shape) in ascending powers of w, the sizes the absolute
    sums behind them. With a ratio, -A/B on the axis from factors, the crossings have its digits.
    The ends ascend in s, (intervals, *shape); 0 and nan where the crossings are no finite numbers.
    """
    shape, count = fixed.shape[1:], int(np.prod(fixed.shape[1:]))
    given = (p.reshape(len(p), count) for p in (fixed, varied, fixed_size, varied_size))
    a, b, *sizes = map(np.ascontiguousarray, given)
    with np.errstate(over="ignore", invalid="ignore"):
        known = np.isfinite(np.max(np.abs(a), axis=0) * np.max(np.abs(b), axis=0))
    if not known.all():
        a, b, *sizes = (np.where(known, each, 0.0) for each in (a, b, *sizes))

    def flat(v: FloatArray) -> Parts:
        assert ratio is not None
        real, imaginary = ratio(v.reshape(len(v), *shape))
        return real.reshape(v.shape), imaginary.reshape(v.shape)

    points = _candidates(a, b, None if ratio is None else flat)
    low, high = _judged([a, b], sizes, points)
    low[0, ~known] = 0.0
    return Intervals(low.reshape(len(low), *shape), high.reshape(len(high), *shape))


class _StabilityLimits(NamedTuple):
    """How a family of polynomials, shape (loops,), ceases to be stable below or beyond some s."""

    # Upper end of the last stable interval that begins below; 0 if nothing small is stable.
    end: FloatArray
    omega: FloatArray  # of the root w = jω that crosses there, 0 and inf at the ends of the axis
    broken: NDArray[np.bool_]  # there is an unstable gap below that end
    near: FloatArray  # frequencies v, (candidates, loops), where roots cross or nearly do, or nan


def stability_limits(
    fixed: FloatArray,
    varied: FloatArray,
    fixed_size: FloatArray,
    varied_size: FloatArray,
    below: float,
) -> _StabilityLimits:
    """Where fixed + s·varied, each (degree+1, loops), ceases to be stable."""
    x, s, roots = _crossings(fixed, varied, _ROUGH_POLISHES)
    points = _with_ends(s, fixed, varied)
    low, high = _judged([fixed, varied], [fixed_size, varied_size], points.copy())
    begun = low < below
    broken = (np.sum(begun, axis=0) > 1) & (low[0] == 0)
    # Pairs that have come apart along the axis are only of interest where they leave a gap.
    with np.errstate(invalid="ignore"):
        roots[:, ~broken] = np.where(roots.imag == 0, np.nan, roots)[:, ~broken]
    end = np.where(low[0] == 0, np.max(np.where(begun, high, 0.0), axis=0), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.concatenate([x, np.zeros((1, x.shape[1])), np.full((1, x.shape[1]), np.inf)])
        away = np.nan_to_num(np.abs(points / end - 1), nan=np.inf)
        which = np.argmin(away, axis=0)[None]
        return _StabilityLimits(
            end=end,
            omega=np.sqrt(np.take_along_axis(x, which, axis=0)[0]),
            broken=broken,
            near=np.sqrt(_real_parts(roots, _ALMOST_REAL)),
        )


def _judged(
    parts: list[FloatArray], sizes: list[FloatArray], points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The stable intervals between candidates, which are sorted in place; (intervals, loops)."""
    # Up to here A + s·B is A, for all that rounding leaves of it.
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.where(sizes[1] > 0, sizes[0] / sizes[1], np.inf).min(axis=0)
    points[points <= ULPS * UNIT * alike] = np.inf
    points.sort(axis=0)
    edges = np.concatenate([np.zeros((1, points.shape[1])), points])
    after = np.concatenate([points, np.full((1, points.shape[1]), np.inf)])
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        middle = np.where(
            edges == 0,
            np.where(np.isinf(after), 1.0, after / 2),
            np.where(np.isinf(after), 2 * edges, np.sqrt(edges) * np.sqrt(after)),
        )
    empty = ~np.isfinite(edges) | ~(after > edges * (1 + _SAME))
    middle[empty] = 1.0
    stable = _verdicts(parts, sizes, middle) > 0
    stable[empty] = False
    return _merged(edges, after, stable, empty)


def _verdicts(parts: list[FloatArray], sizes: list[FloatArray], s: FloatArray) -> VerdictArray:
    coefficients = parts[0][:, None, :] + parts[1][:, None, :] * s
    return routh(coefficients, sizes[0][:, None, :] + sizes[1][:, None, :] * s)


def _merged(
    edges: FloatArray, after: FloatArray, stable: NDArray[np.bool_], empty: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Join stable neighbours; candidates that were no crossing disappear here."""
    rows = np.arange(len(edges))[:, None]
    # Each row is as stable as the last before it that is not empty.
    last = np.maximum.accumulate(np.where(empty, -1, rows), axis=0)
    inside = np.take_along_axis(stable, np.maximum(last, 0), axis=0) & (last >= 0)
    begins = inside.copy()
    begins[1:] &= ~inside[:-1]
    run = np.cumsum(begins, axis=0) - 1
    low = np.full((max(1, int(np.max(run, initial=-1)) + 1), edges.shape[1]), np.nan)
    high = low.copy()
    row, column = np.nonzero(begins)
    low[run[row, column], column] = edges[row, column]
    row, column = np.nonzero(inside & ~empty)  # row after row: the last of a run stays
    high[run[row, column], column] = after[row, column]
    return low, high


#: Points from which it is worth while to set up a judge of many.
_MANY = 64


def verdict(loop: Loop, effects: Effects) -> VerdictArray:
    """+1 stable, -1 unstable, 0 nearer to the boundary than float64 can tell.

    Of the broadcast shape of loop and effects. Without stiffness the pole of free motion is left
    out of the judgement.
    """
    given = effects.present()
    shape = np.broadcast_shapes(
        loop.terms.free.shape[1:], *(value.shape for value in given.values())
    )
    if loop.terms.free.ndim > 1 or (loop.degree != 4 and np.prod(shape) < _MANY):
        return _answered(_general, loop, effects)[0]
    present = {name: np.broadcast_to(each, shape).reshape(-1) for name, each in given.items()}
    result = judge_many(
        _table(loop, loop.terms, present),
        _table(loop, loop.sizes, present),
        tuple(present.values()),
        int(np.prod(shape)),
        position_free=loop.has_free_pole(effects),
    )
    open_ = np.flatnonzero(result == 0)
    if open_.size:
        rest = Effects(**{name: value[open_] for name, value in present.items()})
        result[open_] = _general(loop, rest)[0]
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
        where the effects as given are not certainly stable, or not finite.
    """

    def around_one(loop: Loop, effects: Effects) -> Intervals:
        intervals = stable_gains(loop, effects)
        return _pick(intervals, (intervals.low < 1) & (intervals.high > 1))

    return Intervals(*_answered(around_one, loop, effects))


def safe_gain(loop: Loop, effects: Effects) -> FloatArray:
    """Largest g such that every gain in (0, g) is stable; 0 where small gains are unstable.

    Of the broadcast shape of loop and effects; nan where one of them is not finite.
    This, not the end of the interval around 1, is the gain margin of a profile: ramps, fades and
    saturation all lower the gain (docs/theory.md, 4).
    """
    return _answered(
        lambda loop, effects: _connected_end(stable_gains(loop, effects)), loop, effects
    )[0]


def safe_up_to(loop: Loop, effects: Effects, gain: float) -> NDArray[np.bool_]:
    """True where every gain in (0, gain] is certainly stable: `safe_gain` > gain, in less time."""
    given = _by_gain(loop, effects)
    fixed, varied, *sizes = (np.ascontiguousarray(p.reshape(len(p), -1)) for p in given)
    stable = _verdicts([fixed, varied], sizes, np.full((1, fixed.shape[1]), gain))[0] > 0
    # One verdict at the top, and crossings only roughly unless one is near.
    open_ = np.flatnonzero(stable)
    if open_.size:
        points = _candidates(fixed[:, open_], varied[:, open_], None, _ROUGH_POLISHES)
        near = open_[np.any(points < _BEYOND * gain, axis=0)]
        if near.size:
            sized = sizes[0][:, near], sizes[1][:, near]
            low, high = stable_intervals(fixed[:, near], varied[:, near], *sized)
            stable[near] = (low[0] == 0) & (high[0] > gain)
    return stable.reshape(given[0].shape[1:])


def stable_gains(loop: Loop, effects: Effects) -> Intervals:
    """All intervals of gains s > 0 at which s·(K, B, M) is stable.

    Returns:
        Ends of shape (intervals, *shape), ascending; unused entries are nan.
    """
    ratio = None if loop.factors is None else _ratio(loop, loop.factors, Effects(), effects)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is told so
        return stable_intervals(*_by_gain(loop, effects), ratio)


def _by_gain(loop: Loop, effects: Effects) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A and B of A + gain·B, and the absolute sums behind them."""
    total, sizes = loop.polynomial(effects)
    free = _like(loop.terms.free, total)
    free_size = _like(loop.sizes.free, total)
    start = loop.lowest_power(effects)
    return (free[start:], (total - free)[start:], free_size[start:], (sizes - free_size)[start:])


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
        small positive value is stable, inf where there is no limit, nan where loop or effects are
        not finite.

    Raises:
        UsageError: a name of no effect.
    """
    refuse_unknown("name", "effect", name, EFFECT_NAMES)
    others = {key: getattr(effects, key) for key in EFFECT_NAMES if effects and key != name}
    return _answered(
        lambda loop, effects: _connected_end(stable_values(loop, name, effects)),
        loop,
        Effects(**others),
    )[0]


def stable_values(
    loop: Loop, name: EffectName, effects: Effects | None = None, *, sign: int = 1
) -> Intervals:
    """All stable intervals of the size of one effect, the others as given.

    Sign +1 is for positive values, -1 for the sizes of negative ones. Ends in sizes are
    (intervals, *shape), ascending, nan where unused.
    """
    others = effects or Effects()
    given = {key: getattr(others, key) for key in EFFECT_NAMES if key != name}
    base, base_size = loop.polynomial(Effects(**given))
    index = EFFECT_NAMES.index(name)
    term, size, scale = loop.terms[1:][index], loop.sizes[1:][index], loop.scales[index]
    varied = Effects(**{name: float(sign)})
    start = loop.lowest_power(Effects(**given, **{name: float(sign)}))
    return stable_intervals(
        base[start:],
        sign * _like(term * scale, base)[start:],
        base_size[start:],
        _like(size * scale, base)[start:],
        None if loop.factors is None else _ratio(loop, loop.factors, Effects(**given), varied),
    )


def _ratio(loop: Loop, factors: Factors, fixed: Effects, varied: Effects) -> _Ratio:
    """-(1 + G·C)/(G·C') on the axis, C the law of what is fixed and C' of what varies."""

    def ratio(v: FloatArray) -> Parts:
        plant, laws = factors.plant(v), factors.laws(v)

        def played(effects: Effects) -> Parts:
            """What effects make of the position of the plant."""
            total = np.zeros(v.shape), np.zeros(v.shape)
            for value, part in zip(loop.dimensionless_effects(effects), laws, strict=True):
                if value is not None:
                    total = total[0] + value * part[0], total[1] + value * part[1]
            return multiplied(plant, total)

        real, imaginary = played(fixed)
        return divided((-1 - real, -imaginary), played(varied))

    return ratio


def _general(loop: Loop, effects: Effects) -> tuple[VerdictArray]:
    coefficients, sizes = loop.polynomial(effects)
    start = loop.lowest_power(effects)
    return (routh(coefficients[start:], sizes[start:]),)


#: Points of a block: some megabytes of arrays, whatever the number of all.
_BLOCK = 4096


def _answered(
    answer: Callable[[Loop, Effects], tuple[NDArray[Any], ...]], loop: Loop, effects: Effects
) -> tuple[NDArray[Any], ...]:
    """What a function answers for each point of loop and effects, in their broadcast shape."""
    present = effects.present()
    shape = np.broadcast_shapes(
        loop.terms.free.shape[1:], *(value.shape for value in present.values())
    )
    count = int(np.prod(shape))
    if count <= _BLOCK:
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is told so
            return answer(loop, effects)
    # Many points are parted along the longest axis, and parts that are still too many again. Each
    # is computed for itself, number by number, so that what a single loop answers it answers among
    # a million too, to the last digit.
    longest = int(np.argmax(shape))
    length, behind = shape[longest], len(shape) - longest
    step = max(1, _BLOCK * length // count)
    found: list[tuple[NDArray[Any], ...]] = []
    for start in range(0, length, step):
        part = slice(start, start + step)
        chosen = {name: part_of(value, part, behind) for name, value in present.items()}
        found.append(_answered(answer, part_of_loops(loop, part, behind), Effects(**chosen)))
    return tuple(np.concatenate(parts, axis=-behind) for parts in zip(*found, strict=True))


def _table(loop: Loop, terms: Terms, present: Mapping[str, object]) -> FloatArray:
    """(degree+1, 1 + effects): what is fixed and what each effect present adds for each unit."""
    parts = zip(EFFECT_NAMES, terms[1:], loop.scales, strict=True)
    added = [part * scale for name, part, scale in parts if name in present]
    return np.stack([terms.free, *added], axis=1)


def _like(coefficients: FloatArray, total: FloatArray) -> FloatArray:
    return np.broadcast_to(spread(coefficients, total.shape[1:]), total.shape)


def _connected_end(intervals: Intervals) -> tuple[FloatArray]:
    """The end of the interval that begins at zero; 0 where none does, nan where it is not known."""
    begun = intervals.low == 0
    return (np.where(begun.any(axis=0), _pick(intervals, begun).high, 0.0)[()],)


def _pick(intervals: Intervals, wanted: NDArray[np.bool_]) -> Intervals:
    """The first wanted interval of each loop; nan where there is none."""
    low, high = intervals
    index = np.argmax(wanted, axis=0)[None]
    found = np.any(wanted, axis=0)
    return Intervals(
        np.where(found, np.take_along_axis(low, index, axis=0)[0], np.nan),
        np.where(found, np.take_along_axis(high, index, axis=0)[0], np.nan),
    )


#: Gains and sizes this close to a boundary, relative, are taken to be on it: the verdicts decide
#: at 1e-9, and a written profile is rounded to six digits anyway.
CLOSE = 1e-9
#: Sizes below this part of the top are as good as nothing.
_NOTHING = 1e-15
#: Steps at most; regula falsi needs about eight, halving alone forty for the closest asked for.
_MOST_STEPS = 80


def last_within(
    value: Callable[[float], float], limit: float, top: float, first: float = 0.0
) -> float:
    """The size up to which a growing value keeps to a limit; inf where it does so to the top.

    Narrowed on logarithms from the top, the largest size looked at, or from ``first``; where the
    limit is kept there, sizes below do not matter. A value that is nan is beyond any limit. 0 where
    no size was seen to keep it. Regula falsi with the Illinois rule (Dowell and Jarratt, BIT 11,
    1971, p. 168), halvings where a value is infinite.
    """

    def room(size: float) -> float:
        with np.errstate(all="ignore"):
            found = -float(np.log(value(size) / limit))
        return -np.inf if np.isnan(found) else found

    high, room_high = top, room(top)
    if room_high >= 0:
        return np.inf
    low, room_low = top, room_high
    if 0 < first < top:
        low, room_low = first, room(first)
    while room_low < -CLOSE:
        if low < _NOTHING * top:
            return 0.0
        high, room_high = low, room_low
        # In proportion, as the ripple of a small effect is, and a little less.
        low *= min(0.5, 0.9 * float(np.exp(room_low)) if np.isfinite(room_low) else 0.1)
        room_low = room(low)
    kept, broken, last = float(np.log(low)), float(np.log(high)), 0
    for _ in range(_MOST_STEPS):
        if broken - kept <= CLOSE:
            break
        part = 0.5
        if np.isfinite(room_low) and np.isfinite(room_high):
            part = float(np.clip(room_low / (room_low - room_high), 0.0, 1.0))
        # A step that ends on the limit must leave room on both sides to end the search.
        place = float(np.clip(kept + part * (broken - kept), kept + CLOSE / 2, broken - CLOSE / 2))
        found = room(float(np.exp(place)))
        # An end that stays twice counts half, so that both ends move.
        if found >= 0:
            kept, room_low = place, found
            room_high = room_high / 2 if last > 0 else room_high
            last = 1
        else:
            broken, room_high = place, found
            room_low = room_low / 2 if last < 0 else room_low
            last = -1
    return float(np.exp(kept))
