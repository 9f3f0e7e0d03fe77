"""Sums with clamps that may be reached, as far as they are proved absolutely stable."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from itertools import product
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.documents.profile import AbsoluteStability, Channel, Multiplier, Tap
from tune.documents.scene import EFFECT_NAMES, EffectName, Effects, Margin
from tune.loop.polynomials import ComplexArray, FloatArray
from tune.optimisation.feasibility import round_sizes
from tune.optimisation.problem import LONGER, ROOM, SLACK, Combination, Problem
from tune.stability.nonlinear import (
    Nonlinearities,
    Responses,
    absolute_gain,
    difference_at,
    is_peak,
)

if TYPE_CHECKING:
    import clarabel

    from tune.optimisation.nash import AllFound, Optimum


#: Delays of the taps, samples: all of the short ones, then each so many times the one before, up to
#: so many times the delay of the loop, or to this many.
_SHORT, _RATIO, _DELAYS, _LONG = 8, 1.3, 6, 31
#: Where those do not prove the gain that is asked for, up to so many times B/K of the clamp with
#: the most, or up to LONGER. Without delay M = 1 - 1/(1 + s·B/K) proves any sum of clamps: so many
#: times B/K hold all of that exponential, if they are not more than this many.
_LAGS, _ALL_LAGS, _LONGEST = 4, 16, 400
#: Of the points of the grid the first program sees one in so many, or where a proof failed before.
_SEEN, _SEEN_AGAIN = 192, 48
#: Programs at most.
_ROUNDS = 6
#: Weights below this part of the largest are none.
_NOTHING = 1e-9


def _find_multiplier(
    responses: Responses, parts: Nonlinearities, gain: float, ladder: list[int], seen_of: int
) -> Multiplier | None:
    """The multiplier with the most room at a gain, as far as a grid tells; None without one."""
    condition = _Condition.of(responses, parts, gain, ladder)
    slopes = _slopes(responses, parts, condition)
    # One in so many points of the grid are seen at first.
    seen = np.arange(0, condition.factors.shape[1], seen_of, dtype=np.intp)
    weights: FloatArray | None = np.empty(0)
    for _ in range(_ROUNDS):
        weights = _program(condition.matrices(seen), slopes)
        if weights is None:
            return None
        least = condition.least_eigenvalues(weights).reshape(responses.position.shape)
        short = np.flatnonzero(is_peak(-least) & (least <= 0))
        if not short.size:
            break
        seen = np.union1d(seen, short)
    return _multiplier(weights, condition.owners, parts, grounded=responses.grounded)


def _ladders(problem: Problem, parts: Nonlinearities) -> list[list[int]]:
    """Delays of the taps, samples, to be tried in turn: the longer, the longer to prove."""
    step, long = problem.region.box.sample_time[0], problem.slack < SLACK[-1]
    late = problem.region.box.delay[1] / step + problem.margin.extra_delay_samples
    tried: list[float] = [max(_LONG, _DELAYS * (late + 1))]
    arrays = [each.arrays() for _, each in parts.clamps]
    lags = [float(np.asarray(B or 0.0)) / float(np.asarray(K)) for K, B, _ in arrays]
    lag = max(lags, default=0.0) / step
    for longest in (min(_LAGS * lag, LONGER), _ALL_LAGS * lag * long):
        tried += [longest] * (tried[-1] * _RATIO < longest <= _LONGEST)
    counts = [int(np.log(longest / _SHORT) / np.log(_RATIO)) for longest in tried]
    return [
        [*range(1, _SHORT), *(round(_SHORT * _RATIO**power) for power in range(count + 1))]
        for count in counts
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Condition:
    """Hermitian part of diag(M)·(1 + loops), linear in the weights of a multiplier M.

    At each point it is turned and scaled, left^H ... right, so that it is about one for one usual
    multiplier: near θ = 0 two clamps that push against each other leave next to nothing of it.
    Channels are in units of their own size times the gain.
    """

    owners: list[tuple[int, int]]  # (channel, tap) of each weight; a constant is tap 0
    own: FloatArray  # 1 at the channel of each weight, else 0, (weights, channels)
    factors: ComplexArray  # of each weight in M, (weights, points)
    left: ComplexArray  # (points, channels, channels)
    right: ComplexArray  # likewise

    @classmethod
    def of(
        cls, responses: Responses, parts: Nonlinearities, gain: float, ladder: list[int]
    ) -> _Condition:
        loops = gain * parts.loops(responses)
        size = len(loops)
        angle = np.broadcast_to(responses.angle, loops.shape[1:]).reshape(-1)
        constant = np.ones(angle.shape, dtype=np.complex128)
        taps = {tap: difference_at(tap, angle) for tap in ladder}
        taps = {0: constant} | taps if responses.grounded else taps
        each = [taps if i < len(parts.clamps) else {0: constant} for i in range(size)]
        rows = np.eye(size) + loops.reshape(size, -1).T[..., None]
        # Of one multiplier, with equal slopes of all clamps, in its own real part.
        means = [np.mean([*own.values()], axis=0) for own in each]
        usual: ComplexArray = np.stack(means, axis=-1)
        clamps = slice(0, len(parts.clamps))
        usual[:, clamps] *= max(parts.sizes) / np.array(parts.sizes[clamps])
        half = usual[..., None] * rows / 2
        values, vectors = np.linalg.eigh(half + _adjoint(half))
        total = (vectors * np.abs(values)[:, None, :]) @ _adjoint(vectors)
        values, vectors = np.linalg.eigh(total + np.eye(size) * usual.real[..., None])
        scale = np.maximum(values, np.finfo(float).tiny)[:, None, :] ** -0.5
        left = np.asarray(vectors * scale, dtype=np.complex128)
        owners = [(index, tap) for index, own in enumerate(each) for tap in own]
        return cls(
            owners=owners,
            own=np.eye(size)[[owner for owner, _ in owners]],
            factors=np.stack([factor for own in each for factor in own.values()]),
            left=left,
            right=rows @ left,
        )

    def matrices(self, points: NDArray[np.intp]) -> ComplexArray:
        """Those of each weight at some points, (weights, points, channels, channels)."""
        multipliers = self.factors[:, points, None] * self.own[:, None]
        return _hermitian(self.left[points], multipliers, self.right[points])

    def least_eigenvalues(self, weights: FloatArray) -> FloatArray:
        """The least of the sum with these weights at every point, (points,)."""
        matrix = _hermitian(self.left, (self.factors.T * weights) @ self.own, self.right)
        return np.asarray(np.linalg.eigvalsh(matrix), dtype=np.float64)[:, 0]


def _adjoint(matrix: ComplexArray) -> ComplexArray:
    return np.conj(np.swapaxes(matrix, -1, -2))


def _hermitian(left: ComplexArray, multiplier: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Hermitian part of left^H·diag(multiplier)·right."""
    matrix = _adjoint(left) @ (multiplier[..., None] * right)
    return (matrix + _adjoint(matrix)) / 2


def _slopes(responses: Responses, parts: Nonlinearities, condition: _Condition) -> FloatArray:
    """Rows that are zero where every clamp's multiplier has the slope of the first at θ = 0."""
    # Where nothing holds the position, no others prove two clamps there. Shape (rows, unknowns).
    count = 1 if responses.grounded else len(parts.clamps)
    each = [parts.sizes[owner] / max(parts.sizes) * tap for owner, tap in condition.owners]
    own = condition.own.T
    return (own[:1] - own[1:count]) * each


def _program(table: ComplexArray, slopes: FloatArray) -> FloatArray | None:
    """Weights that sum to one with which the least eigenvalue of a table is largest, if above 0."""
    import clarabel

    count, points, *_ = table.shape
    cone, rows, unit = _cone_rows(table)
    equal, first = 1 + len(slopes), 1 + len(slopes) + count
    program = np.zeros((first + rows.shape[1], count + 1))
    program[0, :count] = 1
    # They make every row of slopes zero.
    program[1:equal, :count] = slopes
    program[equal:first, :count] = -np.eye(count)
    program[first:, :count] = -rows.T
    program[first:, -1] = np.tile(unit, points)
    target, cost = np.zeros(len(program)), np.zeros(count + 1)
    target[0], cost[-1] = 1, -1
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # Every point is in its own scale already; another one costs half the digits of long taps.
    settings.equilibrate_enable = False
    cones: list[clarabel.Cone] = [clarabel.ZeroConeT(equal), clarabel.NonnegativeConeT(count)]
    cones += [clarabel.NonnegativeConeT(points)] if cone is None else [cone] * points
    answer = clarabel.DefaultSolver(
        _sparse(np.zeros((count + 1, count + 1))), cost, _sparse(program), target, cones, settings
    ).solve()
    if answer.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        return None
    found = np.array(answer.x, dtype=np.float64)
    return np.maximum(found[:-1], 0.0) if found[-1] > -_NOTHING else None


def _sparse(matrix: FloatArray) -> SimpleNamespace:
    """What the solver reads of scipy's csc_matrix, which takes longer to import than to solve."""
    columns, rows = np.nonzero(matrix.T)
    return SimpleNamespace(
        shape=matrix.shape,
        data=matrix[rows, columns],
        indices=rows,
        indptr=np.searchsorted(columns, np.arange(len(matrix.T) + 1)),
        has_canonical_format=True,
    )


def _cone_rows(table: ComplexArray) -> tuple[clarabel.Cone | None, FloatArray, FloatArray]:
    """(cone of one point, rows of all points by unknown, what an eigenvalue adds to each row)."""
    import clarabel

    count, _, size, _ = table.shape
    if size == 1:
        return None, table.real.reshape(count, -1), np.ones(1)
    if size == 2:
        first, second, across = table[..., 0, 0].real, table[..., 1, 1].real, table[..., 0, 1]
        rows = np.stack([first + second, first - second, 2 * across.real, 2 * across.imag], axis=-1)
        return clarabel.SecondOrderConeT(4), rows.reshape(count, -1), np.array([2.0, 0, 0, 0])
    _load_lapack()
    whole = np.block([[table.real, -table.imag], [table.imag, table.real]])
    column, row = np.tril_indices(2 * size)
    scaled = whole[..., row, column] * np.where(row == column, 1.0, np.sqrt(2))
    cone = clarabel.PSDTriangleConeT(2 * size)
    return cone, scaled.reshape(count, -1), np.where(row == column, 1.0, 0.0)


@cache
def _load_lapack() -> None:
    """Load the two modules in which the solver finds LAPACK, without the package around them."""
    # All of scipy.linalg takes six times longer to import; where they are not found, the solver
    # imports it.
    package = find_spec("scipy")
    for name in ("scipy.linalg.cython_blas", "scipy.linalg.cython_lapack"):
        places = package and package.submodule_search_locations
        spec = PathFinder.find_spec(name, [f"{place}/linalg" for place in places or ()])
        if name not in sys.modules and spec is not None and spec.loader is not None:
            sys.modules[name] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])


def _multiplier(
    weights: FloatArray, owners: list[tuple[int, int]], parts: Nonlinearities, *, grounded: bool
) -> Multiplier | None:
    """Weights as channels: rows were in units of each channel's own size."""
    scaled = np.array([w * parts.sizes[i] for (i, _), w in zip(owners, weights, strict=True)])
    slope = sum(w * tap for (i, tap), w in zip(owners, scaled, strict=True) if i == 0)
    # Over the slope of the first clamp where nothing holds the position, else over the largest.
    unit = float(scaled.max()) if grounded else float(slope)
    if not unit > 0:
        return None
    scaled /= unit
    least = _NOTHING * float(scaled.max())
    channels: list[Channel] = []
    for index, name in enumerate(parts.names):
        own = [w * (owner == index) for (owner, _), w in zip(owners, scaled, strict=True)]
        mine = {tap: float(w) for (_, tap), w in zip(owners, own, strict=True) if w > least}
        constant = mine.pop(0, 0.0)
        taps = tuple(Tap(samples=tap, weight=weight) for tap, weight in mine.items())
        channels.append(Channel(name=name, constant=constant, taps=taps))
    return Multiplier(channels=tuple(channels))


#: What of a gain beyond the margin is not claimed, relative; beyond the most a margin says nothing.
_SHAVED, _MOST_GAIN = 2e-2, 1000.0
#: Parts of the gain that is asked for, at which a multiplier is looked for in turn.
_PARTS = (1.02, 1.0, 0.9, 0.7, 0.4)
#: Digits to which B/K and M/K agree where clamps act on one signal, and those of a weight.
_ALIKE, _DIGITS = 9, 6
#: Taps of less than these parts of the largest of their channel are left out, if so much of the
#: gain is kept; slopes of a tap of one sample, as parts of that of all of them.
_FAINT, _KEPT, _FIRST_TAP = (0.3, 0.03, 1e-3, 0.0), 0.99, (0.03, 1e-3)


#: A problem, its optimum, and why the rest is dropped.
Tried = tuple[Problem, "Optimum", dict[str, str]]


def prove_combinations(
    problem: Problem,
    sizes: FloatArray,
    known: AllFound | None = None,
    tries: Sequence[float] = _PARTS,
) -> AllFound:
    """The proved gain of every combination that must be absolutely stable and is part of no other.

    Sizes have shape (unknowns,), SI units; what is known is of others. Multipliers are looked for
    at these parts of the gain that is asked for, until one is found. Where no clamp, damper or
    fading element of one is larger than its like in another, the gain and multiplier of the other
    are its own too (docs/theory.md, 10); such come last.
    """
    known = known or {}
    combinations = {each.elements: each for each in problem.combinations if each.absolute}
    asked = {
        names: _nonlinearities(problem, combinations[names], sizes)
        for names in largest_sets(combinations)
    }
    parts = {names: _parts_of(*each) for names, each in asked.items()}
    found: dict[tuple[str, ...], AbsoluteStability] = {}
    alike: dict[tuple[object, ...], list[tuple[str, ...]]] = {}
    same: dict[tuple[str, ...], AbsoluteStability] = {}
    # What another covers comes after it, or is its equal.
    for names in sorted(asked, key=lambda each: -sum(part.size for part in parts[each])):
        searched = alike.setdefault(tuple(part.signal for part in parts[names]), [])
        for other in searched:
            both = [*zip(parts[other], parts[names], strict=True)]
            if all(its.size >= mine.size for its, mine in both):
                known_as = {mine.name: its.name for its, mine in both}
                order = {name: known_as[name] for name in asked[names][0].names}
                same[names] = _renamed(found[other], order)
                break
        else:
            searched.append(names)
            found[names] = _search_gain(problem, *asked[names], known.get(names), tries)
    return found | same


class _Part(NamedTuple):
    """A clamp, what is damping only, or an element that fades."""

    signal: tuple[object, ...]  # what it is but for its size
    size: float
    name: str  # of its channel, if it has one


def _parts_of(parts: Nonlinearities, steady: tuple[Effects, ...]) -> list[_Part]:
    """Every part of a sum, in the order of their signals."""
    laws = [(name, effects, 0) for name, effects in parts.clamps]
    laws += [("damping", Effects(damping=parts.damping), 1)] * bool(parts.damping)
    laws += [("", effects, 2) for effects in steady]
    found: list[_Part] = []
    for name, effects, kind in laws:
        sizes = [float(np.asarray(each or 0.0)) for each in effects.arrays()]
        size = sizes[0] or max(map(abs, sizes))
        ratios = (round_to_digits(each / size, _ALIKE) for each in sizes)
        found.append(_Part((kind, *ratios), size, name))
    return sorted(found)


def _renamed(found: AbsoluteStability, names: Mapping[str, str]) -> AbsoluteStability:
    """The same with channels in the order of new names, each of which stands for an old one."""

    def renamed(multiplier: Multiplier | None) -> Multiplier | None:
        if multiplier is None:
            return None
        old = {channel.name: channel for channel in multiplier.channels}
        channels = (old[was].model_copy(update={"name": name}) for name, was in names.items())
        return Multiplier(channels=tuple(channels))

    return found.model_copy(update={"free": renamed(found.free), "held": renamed(found.held)})


def largest_sets(combinations: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Those that are part of no other: what proves one proves its parts."""
    sets = {frozenset(each): each for each in combinations}
    return [names for each, names in sets.items() if not any(each < other for other in sets)]


def _search_gain(
    problem: Problem,
    parts: Nonlinearities,
    steady: tuple[Effects, ...],
    known: AbsoluteStability | None,
    tries: Sequence[float],
) -> AbsoluteStability:
    """The gain up to which a sum is absolutely stable; known multipliers may do."""
    margin, box, least = problem.margin, problem.region.box, problem.proved_gain
    # What acts steadily is looked at up to the gain of the margin: nothing is claimed beyond it.
    gains = [margin.gain * (1 + 2 * ROOM) if steady else _MOST_GAIN]
    multipliers: dict[bool, Multiplier | None] = {}
    seen_of = _SEEN_AGAIN if problem.slack else _SEEN
    ladders = _ladders(problem, parts)
    # All of the gain by the shortest taps that do, else as much as the longest do.
    order = [(ladder, part) for ladder in ladders for part in tries if part >= 1]
    order += [(ladders[-1], part) for part in tries if part < 1]
    for loop in problem.loops.between(margin.extra_delay_samples) if box.damping[0] > 0 else ():
        # More than the loops before have is of no use.
        most = min(min(gains) / least, 1.0)
        if most <= _NO_GAIN:
            break
        if most < 1:
            order = [(ladders[-1], part) for part in (most, *tries) if part <= most]
        responses = Responses.of(loop, steady)
        multiplier = known and (known.held if loop.grounded else known.free)
        if multiplier and tuple(one.name for one in multiplier.channels) != parts.names:
            multiplier = None  # of clamps that were one signal, or are now
        gain = 0.0 if multiplier is None else _least_gain(responses, parts, multiplier)
        for ladder, part in () if gain >= most * least else order:
            found = _find_multiplier(responses, parts, part * least, ladder, seen_of)
            if found is not None:
                reached = _least_gain(responses, parts, found)
                found, reached = _with_few_taps(responses, parts, found, reached, least)
                if multiplier is None or reached > gain:  # the known one may prove more
                    multiplier, gain = found, reached
                if gain >= least or part < 1:
                    break
        gains.append(gain)
        multipliers[loop.grounded] = multiplier
    return AbsoluteStability(
        gain=min(gains) if multipliers else 0.0,
        extra_delay_samples=float(margin.extra_delay_samples),
        free=multipliers.get(False),
        held=multipliers.get(True),
        covers=(),
    )


def _least_gain(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier, enough: float = 0.0
) -> float:
    return float(np.min(absolute_gain(responses, parts, multiplier, enough=enough)))


def _with_few_taps(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier, gain: float, least: float
) -> tuple[Multiplier, float]:
    """The multiplier without the taps that hardly change its gain, and the gain it has then."""
    # Each clamp keeps some of a tap of one sample, without which M may vanish at some frequency, as
    # taps of 3 and 6 samples do at θ = 2π/3: a proof would then have nothing to show.
    for part, first in product(_FAINT, _FIRST_TAP):
        channels = tuple(_thinned(channel, part, first) for channel in multiplier.channels)
        fewer = Multiplier(channels=channels)
        enough = max(_KEPT * gain, least if gain >= least else 0.0)
        left = _least_gain(responses, parts, fewer, enough)
        if left >= enough:
            return fewer, left
    return multiplier, gain


def _thinned(channel: Channel, part: float, first: float) -> Channel:
    """Taps of at least a part of the largest, and of one sample at least a part of the slope."""
    constant = round_to_digits(channel.constant, _DIGITS)
    if not channel.taps:
        return channel.model_copy(update={"constant": constant})
    most = max(tap.weight for tap in channel.taps)
    slope = sum(tap.weight * tap.samples for tap in channel.taps)
    weights = {1: first * slope}
    weights |= {
        tap.samples: max(tap.weight, weights.get(tap.samples, 0.0))
        for tap in channel.taps
        if tap.weight >= part * most
    }
    # Weights are rounded: their last digits differ between processors.
    taps = (Tap(samples=n, weight=round_to_digits(w, _DIGITS)) for n, w in weights.items())
    return channel.model_copy(update={"taps": tuple(taps), "constant": constant})


def _nonlinearities(
    problem: Problem, combination: Combination, sizes: FloatArray
) -> tuple[Nonlinearities, tuple[Effects, ...]]:
    """(clamps and what is damping only, elements that fade at the gain of the margin)."""
    clamps: dict[tuple[float, float], tuple[tuple[str, ...], float]] = {}
    steady: list[Effects] = []
    damping = 0.0
    values: dict[str, dict[EffectName, float]] = {name: {} for name in combination.elements}
    for index in {index for members in combination.members for index in members}:
        unknown = problem.unknowns[index]
        values[unknown.element][unknown.effect] = unknown.sign * float(sizes[index])
    for name, own in values.items():
        K, B, M = (own.get(effect, 0.0) for effect in EFFECT_NAMES)
        if K:
            # Clamps of one signal are one clamp.
            signal = (round_to_digits(B / K, _ALIKE), round_to_digits(M / K, _ALIKE))
            names, stiffness = clamps.get(signal, ((), 0.0))
            clamps[signal] = (*names, name), stiffness + K
        elif M or B < 0:
            steady.append(Effects(**{e: problem.margin.gain * v for e, v in own.items()}))
        else:
            damping += B
    found = (
        (" + ".join(names), Effects(stiffness=K, damping=K * lead or None, mass=K * lag or None))
        for (lead, lag), (names, K) in clamps.items()
    )
    return Nonlinearities(clamps=tuple(found), damping=damping), tuple(steady)


#: Tries with more room for the proof of clamps, each as much as the last two promise, at least so
#: much of what is short, and so much, each time twice as much; one that is short of more than this
#: part of the one before does not help.
_MOST_ROOMS, _LESS_ROOM, _LEAST_ROOM, _HELPS = 10, 0.7, 3e-4, 0.97
#: A last step that takes this part of a size is long; it is halved so many times.
_LONG_STEP, _MOST_HALVINGS = 0.05, 3
#: Steps of stiffness that are given up for a proof at most, how closely it is known how many, and
#: where multipliers are looked for then, as parts of the gain that is asked for.
MOST_LOST, _CLOSE_LOST, _SURE = 5.0, 0.2, (1.02, 1.0)
#: A gain as good as none.
_NO_GAIN = 0.05


def step_back(
    problem: Problem,
    linear: FloatArray,
    tuned: Callable[[float], Tried],
    dropped: Mapping[str, str],
) -> tuple[FloatArray, AllFound, tuple[str, ...]]:
    """Sizes whose clamps are proved, by what, and the combination that linear sizes prove least."""

    def proved(room: float, known: AllFound) -> tuple[FloatArray, AllFound] | None:
        less, other, also = tuned(room)
        if other.sizes is None or also != dropped:
            return None
        sizes = round_sizes(less, other.sizes)
        return sizes, prove_combinations(problem, sizes, known)

    def short_of(found: AllFound) -> float:
        return problem.proved_gain / max(min(each.gain for each in found.values()), _NO_GAIN)

    sizes, above, short, before = linear, linear, np.inf, np.inf
    room = failed = problem.room
    found = prove_combinations(problem, sizes)
    tightest = min(found, key=lambda elements: found[elements].gain)
    # More room is left to linear limits until the proof holds, or as long as that helps, and where
    # the last step was long, half of it is tried; no more may be dropped for it.
    for number in range(_MOST_ROOMS):
        short = short_of(found)
        if short <= 1 or short - 1 > _HELPS * (before - 1):
            break
        more = max(_LESS_ROOM, (room - failed) / (before - short)) * (short - 1)
        failed, room, before = room, room + max(more, _LEAST_ROOM * 2**number), short
        less = proved(room, found)
        if less is None:
            break
        above, (sizes, found) = sizes, less
    for _ in range(_MOST_HALVINGS if short <= 1 else 0):
        if np.all(above <= sizes * (1 + _LONG_STEP)):
            break
        middle = (failed + room) / 2
        half = proved(middle, found)
        if half is None:
            break
        if short_of(half[1]) > 1:
            failed, above = middle, half[0]
        else:
            room, (sizes, found) = middle, half
    return sizes, found, tightest


def soften(
    problem: Problem,
    linear: FloatArray,
    alone: Mapping[str, float],
    tuned: Callable[[float, Mapping[str, float]], Tried],
    dropped: Mapping[str, str],
) -> tuple[FloatArray, AllFound] | None:
    """Sizes whose clamps are proved, of springs softer than linear limits allow.

    By as few steps as will do; None where so many below what each has alone, or what linear limits
    allow if that is not known, do not.
    """
    springs = [
        (u, u.steps(size), max(u.steps(size) - u.steps(alone.get(u.label, size)) + MOST_LOST, 0.0))
        for u, size in zip(problem.unknowns, linear.tolist(), strict=True)
        if u.effect == "stiffness" and not u.settled
    ]
    best: tuple[FloatArray, AllFound] | None = None

    def proved(lost: float) -> tuple[FloatArray, AllFound] | None:
        most = {u.label: u.rounded_at(steps - min(lost, spare)) for u, steps, spare in springs}
        less, other, also = tuned(0.0, most)
        if other.sizes is None or also != dropped:
            return None
        sizes = round_sizes(less, other.sizes)
        found = prove_combinations(problem, sizes, best and best[1], _SURE)
        good = all(each.gain >= problem.proved_gain for each in found.values())
        return (sizes, found) if good else None

    few, many = 0.0, max((spare for _, _, spare in springs), default=0.0)
    if many:
        best = proved(many)
    while best is not None and many - few > _CLOSE_LOST:
        middle = (few + many) / 2
        found = proved(middle)
        few, many, best = (middle, many, best) if found is None else (few, middle, found)
    return best


def witness_of(found: AbsoluteStability, margin: Margin, slack: float) -> AbsoluteStability:
    """What is claimed of a combination: what was found, its gain to three decimals downwards."""
    # It is at least that of the margin; the slack is a part of what is beyond it and not claimed.
    if slack >= SLACK[-2]:
        return found.model_copy(update={"gain": margin.gain})
    gain = float(np.floor(found.gain * (1 - max(_SHAVED, slack)) * 1000) / 1000)
    return found.model_copy(update={"gain": max(gain, margin.gain)})
