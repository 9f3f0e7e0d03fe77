"""Feasibility of sizes, exact: limits that are kept, how large one may be, what stops it there.

And where a search begins.

Stability is looked at "late", with the margin's extra delay, or at the device's own delay alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import counted, round_to_digits
from tune.documents.profile import LimitedBy
from tune.documents.scene import Effects
from tune.loop.loop import Loop
from tune.loop.polynomials import FloatArray
from tune.optimisation.limits import DIGITS, Unknown
from tune.optimisation.problem import Combination, Problem
from tune.stability.verdict import (
    CLOSE,
    is_stable,
    last_within,
    safe_gain,
    safe_up_to,
    stable_intervals,
)

BoolArray = NDArray[np.bool_]

#: Sizes closer than this, relative, are one; also the disagreement of two solvers, in the logarithm
#: of the product, that is worth recording.
SAME = 1e-6
#: Parts by which sizes that are a little beyond are taken back.
_RETREATS = (0.0, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3)
#: Effects that are rounded either way, all ways tried.
_MOST_WAYS = 5
#: Halvings in a search along one coordinate: 2^-50 of the range.
_HALVINGS = 50
#: Steps of one unknown for a step of another, along the rays: all patterns of few unknowns, one
#: against all others of many.
_PROPORTIONS = (1.0, 4.0, 16.0)
_FEW = 3
#: Points of a ray, from one step of something to the most of anything.
_LEVELS = 24
_LOWEST = 0.1
#: Kept from the edge, in parts of the perceived steps.
_INSIDE = 0.98
#: Starts on different rays.
_STARTS = 2


def worst_gain(
    problem: Problem, combination: Combination, sizes: FloatArray, *, late: bool = True
) -> float:
    """Largest g such that every gain in (0, g) is stable at every corner and delay."""
    if combination.lone is not None:
        unknown = problem.unknowns[combination.lone]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late)
        return end / float(sizes[combination.lone])
    effects = problem.effects(combination, sizes)
    loops = problem.loops.late if late else problem.loops.present
    return min(float(np.min(safe_gain(loop, effects))) for loop in loops)


def least_margin_loops(
    problem: Problem, sizes: FloatArray, *, broken: bool = False
) -> set[tuple[int, int]]:
    """(loop of ``late``, column) of least margin, of each combination and loop, all or broken."""
    return {
        (place, int(np.argmin(gains)))
        for effects in _felt(problem, sizes[None])
        for place, loop in enumerate(problem.loops.late)
        for gains in safe_gain(loop, effects)[0]
        if not (broken and np.min(gains) > problem.margin.gain * (1 + CLOSE))
    }


def ripple(problem: Problem, combination: Combination, sizes: FloatArray) -> float | None:
    """Force ripple of a combination on the device at its best estimate, N rms; None if unknown."""
    if problem.limits.encoder_resolution is None:
        return None
    effects = problem.effects(combination, sizes)
    return float(problem.loops.ripple(effects, problem.limits.encoder_resolution))


def forces(combination: Combination, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(sustained, peak) force, N: K·penetration; the same plus |B|·speed + |M|·acceleration."""
    parts = [
        np.asarray(
            sum(sizes[i] * (reach or 0.0) for i, reach in zip(indices, reaches, strict=True))
        )
        for indices, reaches in zip(combination.members, combination.reach, strict=True)
    ]
    return parts[0], parts[0] + parts[1] + parts[2]


def is_feasible(problem: Problem, sizes: FloatArray) -> bool:
    """True where forces, rendering, ripple and stability with the whole margin hold, exactly."""
    if not bool(_keeps_linear_limits(problem, sizes)):
        return False
    if len(problem.unknowns) == 1:
        size = float(sizes[0])
        return size <= _largest_quiet_size(problem, 0, size) * (1 + CLOSE) and all(
            stable_points(problem, sizes[None], problem.margin.gain)
        )
    return bool(feasible_points(problem, sizes[None])[0])


def feasible_points(problem: Problem, points: FloatArray) -> BoolArray:
    """Feasibility of many settings at once, by the row."""
    good = passes_cheap_limits(problem, points)
    good[good] = stable_points(problem, points[good], problem.margin.gain)
    return good


def passes_cheap_limits(problem: Problem, points: FloatArray) -> BoolArray:
    """True where forces, rendering and ripple keep to their limits; stability is not looked at."""
    good = _keeps_linear_limits(problem, points.T)
    resolution = problem.limits.encoder_resolution
    if resolution is not None:
        quiet = np.ones(np.count_nonzero(good), dtype=np.bool_)
        for effects in _felt(problem, points[good], meetings=False):
            noise = problem.loops.ripple(effects, resolution)[..., 0]
            quiet &= np.all(noise <= problem.limits.ripple * (1 + CLOSE), axis=1)
        good[good] = quiet
    return good


def stable_in_doubles(problem: Problem, points: FloatArray) -> BoolArray:
    """Stability of points in a tenth of the time: asked for at the full gain only."""
    stable = np.ones(len(points), dtype=np.bool_)
    for loop in problem.loops.late:
        for effects in _felt(problem, problem.margin.gain * points):
            stable &= np.all(is_stable(loop, effects), axis=(1, 2))
    return stable


def _keeps_linear_limits(problem: Problem, sizes: FloatArray) -> BoolArray:
    """True where none asks for too much force, and all is felt; sizes are (unknowns, ...)."""
    return np.all(problem.linear.used(sizes) <= 1 + CLOSE, axis=0)


def _largest_quiet_size(problem: Problem, index: int, top: float) -> float:
    """Size of one unknown, felt alone, up to which ripple keeps to its limit; inf to the top."""
    limits, unknown = problem.limits, problem.unknowns[index]
    if limits.encoder_resolution is None:
        return np.inf
    # Up to where it is stable at all where that is less: so far it is found only once.
    end = problem.loops.end_alone(unknown.effect, unknown.sign, late=True) / problem.margin.gain
    return problem.loops.quiet_alone(
        unknown.effect,
        unknown.sign,
        resolution=limits.encoder_resolution,
        limit=limits.ripple,
        top=end if 0 < end < np.inf else top,
    )


def stable_points(
    problem: Problem, points: FloatArray, gain: float, *, late: bool = True
) -> BoolArray:
    """True of each point at which every combination is stable for every gain in (0, gain]."""
    top = gain * (1 + CLOSE)
    if len(problem.unknowns) == 1:
        unknown = problem.unknowns[0]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late)
        return end > points[:, 0] * top
    good = np.ones(len(points), dtype=np.bool_)
    for loop in problem.loops.late if late else problem.loops.present:
        for effects in _felt(problem, points):
            good &= np.all(safe_up_to(loop, effects, top), axis=(1, 2))
    return good


def _felt(problem: Problem, points: FloatArray, *, meetings: bool = True) -> Iterator[Effects]:
    """Effects of shape (points, combinations, 1): of those with a spring, of those without."""
    for sprung in (True, False):
        shares = problem.shares(sprung=sprung, meetings=meetings)
        if not len(shares) or not len(points):
            continue
        # An effect that one combination lacks is zero in it, which is the same for all but a
        # spring.
        stiffness, damping, mass = (
            (points @ part.T)[..., None] if part.any() else None for part in shares.swapaxes(0, 1)
        )
        yield Effects(stiffness=stiffness, damping=damping, mass=mass)


def largest_allowed(problem: Problem, sizes: FloatArray, index: int) -> float:
    """The largest size of one unknown that every limit allows, grown from what is given."""
    most = min(problem.unknowns[index].high, _linear_bound(problem, sizes, index))
    least = min(most, *stable_bounds(problem, sizes, [index], [most], problem.margin.gain))
    return min(least, ripple_bound(problem, sizes, index, least))


def least_beside(problem: Problem) -> FloatArray:
    """Sizes of nothing but springs at their least, which bind the position in every loop."""
    return np.array([u.low if u.effect == "stiffness" else 0.0 for u in problem.unknowns])


def _linear_bound(problem: Problem, sizes: FloatArray, index: int) -> float:
    """Size at which force is used up or something else is felt; inf where nothing is known."""
    return min(problem.linear.bounds(sizes, index).values(), default=np.inf)


def ripple_bound(problem: Problem, sizes: FloatArray, index: int, top: float) -> float:
    """Size up to which the ripple keeps to its limit, from what is given; inf if to the top."""
    if top <= 0 or problem.limits.encoder_resolution is None:
        return np.inf
    if len(problem.unknowns) == 1:
        return _largest_quiet_size(problem, index, top)
    combinations = [
        m
        for m in problem.combinations
        if not m.meeting and any(index in members for members in m.members)
    ]
    if not combinations:
        return np.inf
    trial = sizes.copy()

    def noise(size: float) -> float:
        trial[index] = size
        return max(ripple(problem, combination, trial) or 0.0 for combination in combinations)

    return last_within(noise, problem.limits.ripple, top, float(sizes[index]))


def stable_bounds(
    problem: Problem,
    sizes: FloatArray,
    indices: Sequence[int],
    tops: Sequence[float],
    gain: float,
    *,
    late: bool = True,
) -> list[float]:
    """Size up to which each of some unknowns, others as given, is stable for gains in (0, gain].

    The closed form in the coordinate at the full gain is the answer wherever the ray below it is
    stable too; where it is not (a second stable interval), the end of what is safe is halved to.
    Where others need the unknown, as a spring may need a damper, it must not be nothing at first.
    Tops are the largest sizes that matter; inf is the answer where they are stable.
    """
    if len(problem.unknowns) == 1:
        unknown = problem.unknowns[0]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late) / gain
        return [np.inf if end > top * (1 + CLOSE) else end * (1 - 4 * CLOSE) for top in tops]
    bounds = np.full(len(indices), np.inf)
    trials = np.repeat(sizes[None], len(indices), axis=0)
    trials[np.arange(len(indices)), indices] = tops
    short = np.flatnonzero(~stable_points(problem, trials, gain, late=late))
    if not short.size:
        return bounds.tolist()
    chosen = [indices[int(place)] for place in short]
    ends = _ends(problem, sizes, chosen, gain, late=late) * (1 - 4 * CLOSE)
    bounds[short] = np.clip(ends, 0.0, np.array(tops)[short])
    trials = trials[short]
    trials[np.arange(short.size), chosen] = bounds[short]
    good = stable_points(problem, trials, gain, late=late)
    for place, index, fine in zip(short, chosen, good, strict=True):
        if bounds[place] > 0 and not fine:
            top = float(bounds[place])
            bounds[place] = _halved(problem, sizes, index, top, gain, late=late)
    return bounds.tolist()


def _ends(
    problem: Problem, sizes: FloatArray, indices: Sequence[int], gain: float, *, late: bool
) -> FloatArray:
    """Where each unknown leaves the stable interval it is in, at the full gain alone."""
    ends = np.full(len(indices), np.inf)
    cases = [
        (row, combination, place)
        for row, index in enumerate(indices)
        for combination in problem.combinations
        for place, members in enumerate(combination.members)
        if index in members
    ]
    loops = problem.loops.late if late else problem.loops.present
    for sprung in (True, False):
        chosen = [case for case in cases if bool(case[1].members[0]) == sprung]
        if not chosen:
            continue
        # What other elements have of the same effect, and the totals of the other effects.
        bases: list[float] = []
        others: list[list[float]] = []
        for row, combination, place in chosen:
            totals = [
                float(sum(problem.unknowns[i].sign * sizes[i] for i in m if i != indices[row]))
                for m in combination.members
            ]
            bases.append(totals[place])
            others.append([0.0 if effect == place else t for effect, t in enumerate(totals)])
        signs = np.array([problem.unknowns[indices[row]].sign for row, _, _ in chosen])
        starts = gain * (signs * np.array(bases) + sizes[[indices[row] for row, _, _ in chosen]])
        places = [place for _, _, place in chosen]
        for loop in loops:
            limits = _ends_at(loop, gain * np.array(others), places, signs, starts, free=not sprung)
            sizes_at = limits / gain - signs * np.array(bases)
            for (row, _, _), end in zip(chosen, sizes_at, strict=True):
                ends[row] = min(ends[row], end)
    return ends


def _ends_at(
    loop: Loop,
    others: FloatArray,
    places: list[int],
    signs: FloatArray,
    starts: FloatArray,
    *,
    free: bool,
) -> FloatArray:
    """Least upper end over the corners of one loop, of the interval above each start.

    Each case has the totals of the effects that stay, (cases, 3), the place and sign of the one
    that varies and the total from where it grows; -inf where the start is not stable. In free loops
    no spring is there.
    """
    stiffness, damping, mass = (column[:, None] for column in others.T)
    fixed, fixed_size = loop.polynomial(Effects(stiffness=stiffness, damping=damping, mass=mass))
    terms, sizes = (
        np.stack([part.alpha, part.beta, part.gamma])[places] for part in (loop.terms, loop.sizes)
    )
    scales = np.stack([np.broadcast_to(scale, terms.shape[2:]) for scale in loop.scales])[places]
    varied = np.moveaxis(terms * scales[:, None] * signs[:, None, None], 0, 1)
    varied_size = np.moveaxis(sizes * scales[:, None], 0, 1)
    skip = loop.lowest_power(Effects(stiffness=None if free else stiffness))
    low, high = stable_intervals(fixed[skip:], varied[skip:], fixed_size[skip:], varied_size[skip:])
    start = starts[:, None]
    inside = (low <= np.maximum(start, 0.0)) & (high > start)
    return np.min(np.max(np.where(inside, high, -np.inf), axis=0), axis=1)


def _halved(
    problem: Problem, sizes: FloatArray, index: int, top: float, gain: float, *, late: bool
) -> float:
    """The end of what is stable from what is given on, below a size that is not."""
    trial = sizes.copy()

    def stable(size: float) -> bool:
        trial[index] = size
        return bool(stable_points(problem, trial[None], gain, late=late)[0])

    low, high = float(sizes[index]), top
    if not (0 < low < high and stable(low)):
        low = 0.0
    for _ in range(_HALVINGS):
        if high < problem.unknowns[index].low or high - low <= CLOSE * high:
            break
        middle = high / 8 if low == 0 else (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def initial_points_of(problem: Problem, count: int = _STARTS) -> list[FloatArray]:
    """Allowed settings a little inside, the best by the ranks of its unknowns first; or none."""
    unknowns, low = problem.unknowns, problem.low
    nothing = np.zeros(len(unknowns))
    most = [min(u.high, _linear_bound(problem, nothing, i)) for i, u in enumerate(unknowns)]
    least = np.array([u.steps(u.low) for u in unknowns])
    caps = np.maximum([u.steps(max(m, u.low)) for u, m in zip(unknowns, most, strict=True)], least)
    levels = np.asarray(np.geomspace(_LOWEST, float(caps.max()), _LEVELS), dtype=np.float64)
    # What is allowed is not convex; from nothing a solver may end on the wrong hill. So they are
    # the best of some rays: on each the perceived steps of the unknowns keep a proportion, from one
    # step to what each may be by itself.
    rays = _rays(len(unknowns))
    steps = np.clip(rays[:, None] * levels[:, None], least, caps).reshape(-1, len(unknowns))
    between = problem.linear.lead_points(problem.low, problem.high)
    more = [[u.steps(size) for u, size in zip(unknowns, row, strict=True)] for row in between]
    steps = np.concatenate([steps, np.array(more).reshape(-1, len(unknowns))])
    steps, places = np.unique(steps, axis=0, return_index=True)
    kept = np.flatnonzero(passes_cheap_limits(problem, _sizes(problem, steps)))
    ranks = np.array([unknown.level for unknown in unknowns])
    # The best first: by the product of the steps of the first rank, then of the next.
    logs = np.log(steps[kept])
    sums = [np.sum(logs[:, ranks == rank], axis=1) for rank in np.unique(ranks)]
    order = kept[np.lexsort([-each for each in reversed(sums)])]
    wanted = np.array([unknown.wish.kind == "value" for unknown in unknowns])
    found: list[FloatArray] = []
    ray = places // _LEVELS
    first, size = 0, 1
    while order.size > first and len(found) < count:
        chosen = order[first : first + size]
        # The best is good more often than not; the more are not, the more are looked at together.
        first, size = first + size, 2 * size
        chosen = chosen[stable_in_doubles(problem, _sizes(problem, steps[chosen]))]
        # What is met exactly stays so: then no solver has to be asked for it.
        inside = np.where(wanted & (steps[chosen] >= caps), 1.0, _INSIDE) * steps[chosen]
        points = _sizes(problem, np.maximum(inside, least))
        for place in np.flatnonzero(feasible_points(problem, points)):
            if len(found) < count and np.any(order):
                found.append(points[place])
                # The others of this ray lie below.
                order = order[(ray[order] != ray[chosen[place]]) | (np.arange(order.size) < first)]
    if not found and is_feasible(problem, low):
        return [low]
    return found


def _sizes(problem: Problem, steps: FloatArray) -> FloatArray:
    """Sizes of perceived steps, (points, unknowns), none below the least or above the most."""
    sizes = [u.size_at(column) for u, column in zip(problem.unknowns, steps.T, strict=True)]
    return np.clip(problem.linear.with_leads(np.stack(sizes, axis=1)), problem.low, problem.high)


def _rays(count: int) -> FloatArray:
    """Proportions, shape (rays, unknowns), the least of each 1."""
    if count <= _FEW:
        patterns = np.array(list(product(_PROPORTIONS, repeat=count)))
    else:
        most = np.eye(count) * (_PROPORTIONS[-1] - 1) + 1
        patterns = np.concatenate([np.ones((1, count)), most, _PROPORTIONS[-1] / most])
    return patterns[patterns.min(axis=1) == 1]


def round_sizes(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Wanted values met exactly, the rest rounded to six digits towards nothing, still allowed."""
    caps = problem.high
    met = np.array([u.wish.kind in {"value", "range"} for u in problem.unknowns]) & (
        sizes >= caps * (1 - 10 * SAME)
    )
    # Towards nothing where that is allowed; an effect that holds another may not be smaller.
    ways = np.array(list(product((0.0, 1.0), repeat=min(sizes.size, _MOST_WAYS))))
    ups = np.zeros((len(ways), sizes.size))
    ups[:, : ways.shape[1]] = ways
    for retreat in _RETREATS:
        units = 10.0 ** (np.floor(np.log10(sizes)) - DIGITS + 1)
        whole = np.floor(sizes * (1 - retreat) / units) + ups
        rounded = [[round_to_digits(float(size)) for size in row] for row in whole * units]
        trials = np.where(met, caps, np.minimum(rounded, caps))
        good = np.flatnonzero(feasible_points(problem, trials))
        if good.size:
            return trials[good[0]]
    return sizes * (1 - SAME)


#: A limit binds where it leaves less than this, relative; written values are rounded by 1e-5.
_BINDS = 1e-4
#: Limits are looked for up to so many times the size at hand, where one is as a rule, then beyond.
_NEAR = 1.01
#: Which limit is named where several bind.
_ORDER: tuple[LimitedBy, ...] = (
    "wanted",
    "range",
    "force",
    "lead",
    "rendering",
    "ripple",
    "stability",
    "gain-margin",
    "delay-margin",
    "saturation",
)


def bindings(
    problem: Problem,
    sizes: FloatArray,
    indices: Sequence[int],
    stepped_back: frozenset[int] = frozenset(),
) -> list[LimitedBy]:
    """The constraint that keeps each of some effects from being larger, the others as they are."""
    # Where effects were stepped back for the proof of clamps, this binds those that no limit meets.
    # One that is as large as was wanted is limited by that, whatever else it meets.
    bounds: dict[int, dict[LimitedBy, float]] = {
        index: {"wanted": unknown.high}
        for index in indices
        if (unknown := problem.unknowns[index]).ends_by == "wanted"
        and sizes[index] >= unknown.high * (1 - _BINDS)
    }
    near = {i: float(sizes[i]) * _NEAR for i in indices if i not in bounds}
    bounds |= _bounds(problem, sizes, near)
    open_ = [index for index, found in bounds.items() if not found]
    bounds |= {index: {"saturation": near[index]} for index in stepped_back.intersection(open_)}
    bounds |= _bounds(problem, sizes, {i: np.inf for i in open_ if i not in stepped_back})
    tightest = [sorted(bounds[index], key=_ORDER.index) for index in indices]
    return [words[0] if words else "force" for words in tightest]


def _bounds(
    problem: Problem, sizes: FloatArray, tops: dict[int, float]
) -> dict[int, dict[LimitedBy, float]]:
    """The tightest limits of each unknown, by its index and their word, that lie below its top."""
    gain = problem.margin.gain
    linear = {index: problem.linear.bounds(sizes, index) for index in tops}
    most = {i: min(top, problem.unknowns[i].high, *linear[i].values()) for i, top in tops.items()}
    late = stable_bounds(problem, sizes, [*most], [*most.values()], gain)
    bounds: dict[int, dict[LimitedBy, float]] = {}
    for (index, top), stable in zip(most.items(), late, strict=True):
        unknown = problem.unknowns[index]
        least = min(top, stable)
        noisy = ripple_bound(problem, sizes, index, least)
        found: dict[LimitedBy, float] = {**linear[index], "delay-margin": stable, "ripple": noisy}
        found[unknown.ends_by] = unknown.high
        bounds[index] = _close({w: bound for w, bound in found.items() if bound <= tops[index]})
    # Without the extra delay, or without the gain margin too, more is stable: asked for only where
    # what is asked for less binds.
    relaxed: tuple[tuple[LimitedBy, LimitedBy, float], ...] = (
        ("gain-margin", "delay-margin", gain),
        ("stability", "gain-margin", 1.0),
    )
    for word, before, full in relaxed:
        asked = [i for i, found in bounds.items() if before in found]
        ends = [bounds[i][before] * (1 + 2 * _BINDS) for i in asked]
        present = stable_bounds(problem, sizes, asked, ends, full, late=False)
        for index, stable in zip(asked, present, strict=True):
            found = bounds[index]
            found[word] = min(stable, found.get(word, np.inf))
            bounds[index] = _close(found)
    return bounds


def _close(bounds: dict[LimitedBy, float]) -> dict[LimitedBy, float]:
    """The limits that are as tight as the tightest."""
    least = min(bounds.values(), default=0.0)
    return {word: bound for word, bound in bounds.items() if bound <= least * (1 + _BINDS)}


#: Steps that are not worth a number.
_NOTHING = 1e-3
#: What is said of an effect of less than a step, of which less does not help.
TOO_LITTLE = "of a step a hand can tell"


def reasons_for_nothing(problem: Problem) -> dict[str, str]:
    """Why effects cannot be kept whatever the others are, by label; empty where all may."""
    reasons: dict[str, str] = {}
    weakest = problem.region.box.damping[0]
    gain, extra = problem.margin.gain, problem.margin.extra_delay_samples
    asked = gain / ((1 + problem.room) * (1 + problem.slack))
    limits = problem.limits
    nothing = np.zeros(len(problem.unknowns))
    # A positive damper of the same element holds an effect on a device without damping.
    damped = {u.element for u in problem.unknowns if u.effect == "damping" and u.sign > 0}
    for index, unknown in enumerate(problem.unknowns):
        if unknown.settled:
            continue
        most = problem.linear.bounds(nothing, index).get("force", np.inf)
        top = min(unknown.high, most)
        if unknown.high <= 0:
            reasons[unknown.label] = (
                f"the device may have as little as {unknown.high * gain:.4g} to take away from, "
                f"with a gain margin of {asked:g} at most {max(unknown.high, 0):.4g}"
            )
        elif unknown.low > top and (top == unknown.high or _NOTHING < unknown.steps(top) < 1):
            word = unknown.ends_by if top == unknown.high else "force"
            reasons[unknown.label] = imperceptible(unknown, top, word)
        elif unknown.low > top:
            reasons[unknown.label] = (
                f"even {unknown.low:.4g} exceeds the force limit, {limits.continuous_force:g} "
                f"continuous and {limits.peak_force:g} at the peak; at most {most:.4g} keeps to it "
                "in this motion. Ask for less"
            )
        elif weakest <= 0 and (weakest < 0 or unknown.element not in damped):
            reasons[unknown.label] = (
                f"the lowest damping of the device is {weakest:.4g}, not positive; nothing but "
                "its damping would hold this effect. Take a longer log, or add damping"
            )
        elif len(problem.unknowns) == 1:
            alone = largest_allowed(problem, nothing, 0)
            if alone >= unknown.low:
                continue
            stable = bool(stable_points(problem, np.array([[unknown.low]]), gain)[0])
            if not stable and unknown.wish.kind == "range" and unknown.wish.low:
                reasons[unknown.label] = (
                    f"even {unknown.low:.4g} is not stable with a gain margin of {asked:g} and "
                    f"{counted(extra, 'extra sample')} of delay"
                )
            else:
                word = "stability"
                if alone or stable:
                    word = bindings(problem, np.array([alone]), [0])[0]
                reasons[unknown.label] = imperceptible(unknown, alone, word)
    return reasons


def imperceptible(unknown: Unknown, size: float, word: LimitedBy) -> str:
    """What is said of a size that is less than one step, and how much one is, rounded up."""
    step = float(unknown.size_at(1.0))
    digit = 10.0 ** (np.floor(np.log10(step)) - 2)
    step = round_to_digits(float(np.floor(step / digit + 1)) * digit, 3)
    steps = min(unknown.steps(size), 0.9999)
    return (
        f"{unknown.sign * size:.4g} would be {steps:.{2 + 2 * (steps > 0.99)}g} {TOO_LITTLE}, "
        f"which is {unknown.sign * step:.4g}, limited by {word}"
    )
