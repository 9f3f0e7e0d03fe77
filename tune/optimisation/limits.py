"""Unknowns of the design problem, and the limits on them: linear ones, nearly linear, stability.

A linear row reads a·sizes <= 1: forces of the stated motions, what a hand must feel, walls' leads.

Stability is how far the gain is from where it ends. With the sizes fixed, the loop is stable for
gains up to some g; ln g is exact, and so is its slope: the root that crosses at w = jω keeps to the
axis when effects and gain change together. That no gap opens below g is a constraint of its own.

Gaps are unstable gains between stable ones. With L the open loop, a gain s is on the boundary where
s·L = -1. Below the gain that is asked for L must not reach the negative real axis at all: a gap
opens where the phase of -L, at one of its least or greatest values over frequency, touches zero.
That phase is smooth in the sizes where the end of the stable gains jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.documents.perception import Scale
from tune.documents.profile import LimitedBy
from tune.documents.scene import EffectName, Wish
from tune.loop.loop import Loop
from tune.loop.polynomials import ComplexArray, FloatArray
from tune.rendering import IN_MOTION, PLACES, Band, Shares
from tune.stability.verdict import stability_limits

_Table = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


_LinearWord = Literal["force", "rendering", "lead"]
#: Of the step within which an effect has to be felt; the rest is for the digits of what is written.
_OF_A_STEP = 0.997
#: Mass is felt within this factor of what is commanded, docs/tuning.md; part of this limit, and of
#: that on damping taken away, kept to be sure.
_ALIKE, _KEPT = 1.2, 2e-3
#: Sizes over the least, in proportions of which rows are told apart for solvers.
_DIRECTIONS = (0.0, 1.0, 16.0)
#: Significant digits of a written effect; what is lost is 1e-5 at most.
DIGITS = 6
#: Newton's method ends where it moves by less, relative.
_SAME = 1e-14
#: Walls to begin a search with: so many, up to so many times the least stiffness, with dampers at
#: these parts of the way from the least to the most.
_WALLS, _STIFFEST, _BETWEEN = 64, 1e6, (0.05, 0.5, 0.95)
#: Newton steps on the frequency, and the part of it that one may go.
_STEPS, _STRIDE = 6, 0.3
#: An extreme is found where the next step would be less than this part of the frequency.
_FOUND = 1e-6
#: The constraint where nothing is near to touching: kept by a radian.
_CLEAR = -1.0
#: ln g counts as at most this: what is further away limits nothing.
_FAR = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """One effect of one element whose size is looked for."""

    element: str
    effect: EffectName
    sign: int  # -1 where something is taken away from the device
    low: float  # least size that is kept, SI: one perceived step, or where a range begins
    high: float  # largest size wanted or physically sensible
    wish: Wish
    scale: Scale  # of the commanded size, of which a share is rendered at the motions people make
    # rank; what is settled is level -1, wanted values are level 0, then twice the priorities of the
    # elements, the damping of a wall after its stiffness
    level: int
    # steps that it gives up at most for what its own element has of the next rank
    yields: float = 0.0
    weight: float = 1.0  # exponent of its steps in the product, more than 1 where it is favoured

    @property
    def settled(self) -> bool:
        """Whether its size was found before, beside which others are looked for."""
        return self.level < 0

    @property
    def label(self) -> str:
        """Name for messages and keys, element.effect."""
        return f"{self.element}.{self.effect}"

    def steps(self, size: float) -> float:
        """Perceived steps of a size."""
        return self.scale.steps(self.sign * size)

    @property
    def ends_by(self) -> LimitedBy:
        """What its largest size comes from: the wish, or all that a device may be made to lose."""
        if self.sign < 0 and (self.wish.high is None or self.high < abs(self.wish.high)):
            return "gain-margin"
        return "wanted" if self.wish.kind == "value" else "range"

    def size_at(self, steps: float | FloatArray) -> FloatArray:
        """The size that is perceived as so many steps, of their shape."""
        given = np.asarray(steps, dtype=np.float64)
        return self.sign * self.scale.value_at(given, self.sign)

    def rounded_at(self, steps: float) -> float:
        """The size of so many steps, to the digits that are written, at least the least kept."""
        return max(round_to_digits(float(self.size_at(max(steps, 0.0))), DIGITS), self.low)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendering:
    """One end of the step within which an element's mass or damping is felt, at some frequencies.

    Parasitic parts are included (docs/theory.md, 8): with κ of a mass, ν of a damper and so on,
    m + κM + νB lies within a step of m + M and b + κ'B + ρM + ηK of b + B. Where steps are ratios
    this is linear in the sizes.
    """

    scale: Scale  # of what is felt
    least: float  # total that may be asked for, with the device's own
    # what each size is felt as, shape (frequencies, unknowns), no unit or that of one over another
    given: FloatArray
    asked: FloatArray  # what each size asks for, shape (unknowns,), likewise
    sign: int  # 1 of the upper end, -1 of the lower
    telling: NDArray[np.intp]  # frequencies that solvers are shown

    @property
    def bent(self) -> bool:
        """Whether what a step allows is not in proportion to what is asked for."""
        return bool(np.any(self.asked)) and self._straight_from > self.least

    @property
    def _straight_from(self) -> float:
        """Beyond this one step reaches from a total to a multiple of it."""
        return self.scale.corner * (1 + self.scale.weber)

    @property
    def per_step(self) -> float:
        """What a difference of heights, `Scale.height`, uses of the limit."""
        return self.sign / (_OF_A_STEP * float(np.log1p(self.scale.weber)))

    def used(self, sizes: FloatArray) -> FloatArray:
        """What sizes of shape (unknowns, ...) use of it, 1 is all: shape (frequencies, ...)."""
        felt, asked = (np.tensordot(part, sizes, axes=1) for part in (self.given, self.asked))
        return self.per_step * (self.scale.height(felt) - self.scale.height(asked))

    def rows(self, asked: float) -> FloatArray:
        """The tangents where so much is asked for, as every a of a·sizes <= 1."""
        # What one step reaches upwards is convex in what is asked for, what it reaches downwards is
        # concave: what a tangent allows is allowed.
        slope, reach = self._tangents(np.array(asked))
        return (self.given - slope * self.asked) / reach

    def _tangents(self, asked: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slope and height over the device's own of the tangents where so much is asked for."""
        own, corner = self.scale.reference, self.scale.corner
        place = np.minimum(own + asked, max(own, self._straight_from))
        end = place + self.scale.value_from(place, _OF_A_STEP, self.sign)
        slope = np.maximum(end, corner) / np.maximum(place, corner)
        return slope, end - own - slope * (place - own)

    def bound(self, sizes: FloatArray, index: int) -> float:
        """How large one size may be beside the others, by Newton's method from zero; inf if any."""
        asked = float(self.asked[index])
        far = np.exp(1 / self.per_step) if asked > 0 else 1.0
        binding = self.sign * (self.given[:, index] - far * asked) > 0
        if not binding.any():
            return np.inf
        rest = sizes.copy()
        rest[index] = 0.0
        most, before = np.zeros(int(binding.sum())), -1.0
        while np.any(most > before * (1 + _SAME)):
            before = most
            slope, reach = self._tangents(float(self.asked @ rest) + asked * most)
            rows = (self.given[binding] - slope[:, None] * self.asked) / reach[:, None]
            most = np.maximum(most, (1 - rows @ rest) / rows[:, index])
        return float(most.min())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proportion:
    """Rows a·sizes <= 1; they say nothing where the mass of this number, if any, is not there."""

    rows: FloatArray
    telling: NDArray[np.intp]
    mass: int = -1


def _telling(rows: FloatArray, units: FloatArray) -> NDArray[np.intp]:
    """Rows that are the largest in one of some directions of the sizes, whose units these are."""
    # As many for all filters, so some may be there twice.
    there = np.flatnonzero(units)
    return np.argmax(rows[:, there] @ (_ratios(there.size) * units[there]).T, axis=0)


@cache
def _ratios(count: int) -> FloatArray:
    """Directions of so many sizes, the least of those that are there being one."""
    ratios = np.array(list(product(_DIRECTIONS, repeat=count)))
    return ratios[np.where(ratios > 0, ratios, np.inf).min(axis=1, initial=np.inf) == 1]


def renderings(
    unknowns: Sequence[Unknown],
    shares: Shares,
    scale: Callable[[str, EffectName], Scale],
    walls: Collection[str],
) -> Iterator[Rendering | Proportion]:
    """Mass and damping felt of every element against what it asks for, as limits or as rows.

    In motions damping within one step and mass within a factor `_ALIKE`, or a step where none is
    asked for. Beyond, mass from none to twice of it and of parasitic damping no more than a step
    and the mass's own impedance; with the device's own no damping is negative (docs/theory.md, 8).
    Nobody moves in a wall, which asks for nothing of it; the profile says what is felt of one.
    """
    turn = 2 * np.pi * PLACES
    adds: dict[EffectName, dict[EffectName, Band]] = {
        "mass": {"mass": shares.mass, "damping": shares.mass_of_damping},
        "damping": {
            "damping": shares.damping,
            "mass": shares.damping_of_mass,
            "stiffness": shares.damping_of_stiffness,
        },
    }
    for name in dict.fromkeys(u.element for u in unknowns if u.element not in walls):
        mine = [(i, u) for i, u in enumerate(unknowns) if u.element == name]
        mass = next((i for i, u in mine if u.effect == "mass"), None)
        for felt, parts in adds.items():
            own = scale(name, felt)
            least = own.reference - sum(u.high for _, u in mine if (u.effect, u.sign) == (felt, -1))
            units, asked = np.zeros((2, len(unknowns)))
            given = np.zeros((PLACES.size, len(unknowns)))
            for index, unknown in mine:
                if unknown.effect in parts:
                    units[index] = unknown.low
                    given[:, index] = unknown.sign * parts[unknown.effect].places
                    asked[index] = unknown.sign * (unknown.effect == felt)
            if felt == "mass" and mass is not None:
                yield from _proportions(given * unknowns[mass].sign, mass, units)
                continue
            most = given.copy() if felt == "damping" else given[IN_MOTION]
            if felt == "damping":
                rows = -given / ((1 - _KEPT) * own.reference)
                yield Proportion(rows=rows, telling=_telling(rows, units))
                if mass is not None:
                    most[~IN_MOTION, mass] -= turn[~IN_MOTION]
            for rows, sign in ((most, 1), (given[IN_MOTION], -1)):
                yield Rendering(
                    scale=own,
                    least=least,
                    given=rows,
                    asked=asked,
                    sign=sign,
                    telling=_telling(sign * rows, units),
                )


def _proportions(given: FloatArray, mass: int, units: FloatArray) -> Iterator[Proportion]:
    """Rows that keep the mass felt between parts and multiples of the mass commanded."""
    for inside, low, high in ((IN_MOTION, 1 / _ALIKE, _ALIKE), (~IN_MOTION, 0.0, 2.0)):
        for sign, part in ((1, high), (-1, -low)):
            rows = sign * given[inside]
            rows[:, mass] -= part - _KEPT
            # What they leave beside a mass is within what they keep to be of the least mass.
            rows /= _KEPT / 2 * units[mass]
            yield Proportion(rows=rows, telling=_telling(rows, units), mass=mass)


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """Elements felt at once: which unknowns add up, and the motion of each element."""

    elements: tuple[str, ...]
    # indices of unknowns, for K, B and M
    members: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    # (penetration, m; speed, m/s; acceleration, m/s²) for each unknown, in the order of
    # ``members``; None where the force is cut by a clamp and bounds nothing
    reach: tuple[tuple[float | None, ...], tuple[float | None, ...], tuple[float | None, ...]]
    # the combination must be absolutely stable: the clamp of one of its springs may be reached, as
    # that of a wall always is
    absolute: bool = False
    meeting: bool = False  # a wall is met beside other elements; its ripple is told, not bound

    @property
    def lone(self) -> int | None:
        """The only unknown of the combination, None where there are several or none."""
        found = [index for indices in self.members for index in indices]
        return found[0] if len(found) == 1 else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearLimits:
    """Rows a·sizes <= 1, ratios of two sizes, and what is felt where steps are no ratios."""

    rows: FloatArray  # shape (rows, unknowns)
    forces: int  # so many rows, the first, are limits of force; the others are of what is felt
    masses: NDArray[np.intp]  # the unknown without which a row says nothing, -1 for none
    # rows that solvers are shown; the others are kept where these are, as a rule
    shown: NDArray[np.intp]
    felt: tuple[Rendering, ...] = ()  # limits on what is felt that are no rows
    # (spring, damper, least and most of damping over stiffness, s) of walls
    leads: tuple[tuple[int, int, float, float], ...] = ()

    @classmethod
    def of(
        cls,
        forces: Iterable[FloatArray],
        unknowns: int,
        felt: Iterable[Rendering | Proportion] = (),
        leads: Iterable[tuple[int, int, float, float]] = (),
    ) -> LinearLimits:
        """The limits of rows of forces, of what is felt, as many for all filters, and of leads."""
        limits = list(felt)
        bent = tuple(one for one in limits if isinstance(one, Rendering) and one.bent)
        # A row of forces without a positive coefficient never binds.
        bounding = [row for row in forces if np.any(row > 0)]
        rows = [np.array(bounding).reshape(len(bounding), unknowns)]
        masses, shown = [np.full(len(bounding), -1)], [np.arange(len(bounding))]
        for one in limits:
            if one not in bent:
                shown.append(sum(map(len, rows)) + one.telling)
                rows.append(one.rows(0.0) if isinstance(one, Rendering) else one.rows)
                mass = -1 if isinstance(one, Rendering) else one.mass
                masses.append(np.full(len(rows[-1]), mass))
        return cls(
            rows=np.concatenate(rows),
            forces=len(bounding),
            masses=np.concatenate(masses).astype(np.intp),
            shown=np.concatenate(shown).astype(np.intp),
            felt=bent,
            leads=tuple(leads),
        )

    @property
    def ratios(self) -> list[tuple[int, int, float]]:
        """(i, j, factor): factor·size i <= size j, two of each lead."""
        leads = self.leads
        return [pair for K, B, low, high in leads for pair in ((K, B, low), (B, K, 1 / high))]

    def lead_points(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Walls of all stiffnesses with dampers between their least and most, the rest at least."""
        found: list[FloatArray] = []
        for K, B, least, most in self.leads:
            first, last = float(low[K]), float(min(high[K], _STIFFEST * low[K]))
            springs = np.asarray(np.geomspace(first, last, _WALLS), dtype=np.float64)
            for part in _BETWEEN:
                points = np.tile(low, (_WALLS, 1))
                points[:, K] = springs
                points[:, B] = springs * least ** (1 - part) * most**part
                found.append(np.clip(points, low, high))
        return np.concatenate(found) if found else np.empty((0, low.size))

    def with_leads(self, points: FloatArray) -> FloatArray:
        """Points with the dampers of walls moved to between their least and most."""
        points = points.copy()
        for K, B, least, most in self.leads:
            points[:, B] = np.clip(points[:, B], least * points[:, K], most * points[:, K])
        return points

    def used(self, sizes: FloatArray) -> FloatArray:
        """What sizes of shape (unknowns, ...) use of each limit, 1 is all: shape (limits, ...)."""
        used = np.tensordot(self.rows, sizes, axes=1)
        tied = self.masses >= 0
        used[tied] *= sizes[self.masses[tied]] > 0
        tiny = np.finfo(float).tiny
        found = [factor * sizes[i] / np.maximum(sizes[j], tiny) for i, j, factor in self.ratios]
        parts = [used, *([np.stack(found)] if found else []), *(o.used(sizes) for o in self.felt)]
        return np.concatenate(parts)

    def bounds(self, sizes: FloatArray, index: int) -> dict[_LinearWord, float]:
        """How large one unknown may be beside the others as they are, by the limit; inf if any."""
        found: dict[_LinearWord, float] = {}
        for i, j, factor in self.ratios:
            if i == index and sizes[j] > 0:
                found["lead"] = min(found.get("lead", np.inf), float(sizes[j]) / factor)
        for one in self.felt:
            found["rendering"] = min(found.get("rendering", np.inf), one.bound(sizes, index))
        rest = sizes.copy()
        rest[index] = 0.0
        spare = 1 - self.rows @ rest
        said = (self.masses < 0) | (self.masses == index) | (sizes[self.masses] > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(said & (self.rows[:, index] > 0), spare / self.rows[:, index], np.inf)
        parts: tuple[tuple[_LinearWord, FloatArray], ...] = (
            ("force", left[: self.forces]),
            ("rendering", left[self.forces :]),
        )
        for word, ends in parts:
            least = float(np.min(ends, initial=np.inf))
            if least < np.inf:
                found[word] = min(found.get(word, np.inf), max(0.0, least))
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StabilityLimits:
    """Stability as constraints that are at most 0 where the margin is kept, at some corners."""

    # of each loop with corners, (fixed, varied and their sizes), of shapes (degree+1, corners) and
    # (3, degree+1, corners) in K, B and M
    tables: tuple[_Table, ...]
    grounded: tuple[bool, ...]  # whether device or hand bind the position, by loop
    # what each unknown adds to K, B and M of the combinations with a spring and of those without,
    # shape (combinations, 3, unknowns) each
    shares: tuple[FloatArray, FloatArray]
    gain: float  # up to which it must be stable

    @property
    def size(self) -> int:
        """How many constraints these are."""
        combinations = sum(len(shares) for shares in self.shares)
        return 2 * combinations * sum(table[0].shape[1] for table in self.tables)

    def at(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Constraints, shape (constraints,), and their slopes to log-sizes, (constraints, n)."""
        values: list[FloatArray] = [np.empty(0)]
        slopes: list[FloatArray] = [np.empty((0, sizes.size))]
        for table, grounded in zip(self.tables, self.grounded, strict=True):
            for shares, sprung in zip(self.shares, (True, False), strict=True):
                if len(shares):
                    skip = 0 if sprung or grounded else 1
                    value, slope = _margin(table, shares * sizes, skip, self.gain)
                    values.append(value.ravel())
                    slopes.append(slope.reshape(-1, sizes.size))
        return np.concatenate(values), np.concatenate(slopes)


def _margin(
    table: _Table, parts: FloatArray, skip: int, gain: float
) -> tuple[FloatArray, FloatArray]:
    """ln(gain) - ln g and the phase of the nearest gap, and their slopes to log-sizes.

    Parts are what each unknown adds to K, B and M, (combinations, 3, unknowns); powers of w below
    ``skip`` are left out. Shapes (2, combinations, corners) and the same with unknowns behind.
    """
    fixed, effects, fixed_size, effect_sizes = table
    totals = parts.sum(axis=2)
    varied = np.einsum("me,ekc->kmc", totals, effects)[skip:]
    varied_size = np.einsum("me,ekc->kmc", np.abs(totals), effect_sizes)[skip:]
    shape = varied.shape
    spread = [np.broadcast_to(part[skip:, None], shape) for part in (fixed, fixed_size)]
    together = (spread[0], varied, spread[1], varied_size)
    free, law, free_size, law_size = (part.reshape(shape[0], -1) for part in together)
    found = stability_limits(free, law, free_size, law_size, gain)
    gap, place = _gap_phase(free, law, found.near, gain, found.broken)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = np.stack([np.log(gain / found.end), gap])
        # P(w) = A + g·ΣE·B_E with w = jω keeps its root on the axis: the changes by ln g, by each
        # E and by ω add up to nothing.
        powers = _powers(found.omega, shape[0])
        orders = np.arange(1.0, shape[0])[:, None]
        turn: ComplexArray = np.sum(
            orders * (free + found.end * law)[1:] * powers[:-1] * 1j, axis=0
        )
        # Where the root crosses at the end of the axis all is real, and nothing can turn.
        still = (found.omega == 0) | np.isinf(found.omega)
        across = np.where(still, -1j, np.conj(turn)).reshape(shape[1:])[..., None]
        change = _changes(effects[:, skip:], powers.reshape(shape), parts)
        whole = change.sum(axis=2, keepdims=True)
        slope = np.imag(change * across) / np.imag(whole * across)
        powers = _powers(place, shape[0])
        change = _changes(effects[:, skip:], powers.reshape(shape), parts)
        whole = change.sum(axis=2, keepdims=True)
        alone: ComplexArray = np.sum(free * powers, axis=0)
        towards = np.sign(np.angle(whole / alone.reshape(whole.shape) * -1))
        opens = np.where(found.broken, 1.0, -1.0).reshape(whole.shape)
        turning = opens * towards * np.imag(change / whole)
    slopes = np.stack([slope, turning])
    value = np.nan_to_num(value, nan=_FAR, posinf=_FAR, neginf=-_FAR).reshape(2, *shape[1:])
    slopes[~((np.abs(value) < _FAR) & np.all(np.isfinite(slopes), axis=3))] = 0.0
    return np.clip(value, -_FAR, _FAR), slopes


def _powers(omega: FloatArray, count: int) -> ComplexArray:
    """Powers of jω from 0 on, (count, loops); beyond ω = 1 all over the highest of them."""
    exponents = np.arange(count)[:, None]
    # No angle between them notices.
    small = np.where(omega > 1, 1.0, omega) ** exponents
    large = np.where(omega > 1, 1 / omega, 1.0) ** (count - 1 - exponents)
    return small * large * 1j ** (exponents % 4)


def _changes(effects: FloatArray, powers: ComplexArray, parts: FloatArray) -> ComplexArray:
    """What each unknown adds to the polynomial, (combinations, corners, unknowns)."""
    each = np.einsum("ekc,kmc->mce", effects, powers)
    return np.einsum("mce,mei->mci", each, parts)


def corner_table(loop: Loop, chosen: list[int]) -> _Table:
    """The table of `StabilityLimits` of a loop at some columns."""
    scales = np.stack([np.broadcast_to(s, loop.terms.free.shape[1:]) for s in loop.scales])
    terms, sizes = (
        np.stack([part.alpha, part.beta, part.gamma])[..., chosen] * scales[:, None, chosen]
        for part in (loop.terms, loop.sizes)
    )
    return loop.terms.free[:, chosen], terms, loop.sizes.free[:, chosen], sizes


def _gap_phase(
    free: FloatArray, law: FloatArray, near: FloatArray, gain: float, broken: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """How far the phase of loops is beyond touching, rad, and at which frequency v.

    The loops without effects and what the effects add have coefficients of shape (degree+1, loops),
    ascending powers of w; frequencies near a gap have shape (candidates, loops), nan where unused.
    At most 0 where no gap is open, below the gain that is asked for; v is nan where none is near.
    """
    near = near[np.any(np.isfinite(near), axis=1)]
    if not len(near):
        return np.full(broken.shape, _CLEAR), np.full(broken.shape, np.nan)
    v, both = near.copy(), np.stack([free, law], axis=1)[:, :, None]
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            slope, curve, _ = _phase(both, v)
            step = np.clip(slope / curve, -_STRIDE * v, _STRIDE * v)
            v = v - step
        slope, curve, loop = _phase(both, v)
        phase = np.angle(-loop)
        found = (np.abs(slope / curve) <= _FOUND * v) & (np.abs(loop) * gain > 1)
        # Bent away from zero it does not touch yet; bent the other way it crosses twice, which in
        # a loop without a gap it may do at higher gains only.
        open_ = phase * curve < 0
        value = np.where(open_, np.abs(phase), -np.abs(phase))
        value = np.where(found & (open_ == broken), value, -np.inf)
    # Of open gaps the narrowest: others are the bends of the phase far from the axis.
    chosen = np.where(broken, np.argmin(np.where(value > 0, value, np.inf), axis=0), 0)
    chosen = np.where(broken, chosen, np.argmax(value, axis=0))[None]
    best = np.take_along_axis(value, chosen, axis=0)[0]
    place = np.take_along_axis(v, chosen, axis=0)[0]
    near_one = best > _CLEAR
    return np.where(near_one, best, _CLEAR), np.where(near_one, place, np.nan)


def _phase(both: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """(slope and second derivative to v of the phase of L, L) at w = jv."""
    # Both polynomials of L = law/free have shape (degree+1, 2, 1, loops).
    (a, b), (a1, b1), (a2, b2) = _derivatives(both, v)
    slope = np.real(b1 / b - a1 / a)
    curve = -np.imag((b2 / b - (b1 / b) ** 2) - (a2 / a - (a1 / a) ** 2))
    return slope, curve, b / a


def _derivatives(part: FloatArray, v: FloatArray) -> tuple[ComplexArray, ...]:
    """Polynomials and two derivatives to w at w = jv, v of shape (candidates, loops)."""
    w = v * 1j
    value = np.zeros(np.broadcast_shapes(part.shape[1:], v.shape), dtype=np.complex128)
    first, second = value.copy(), value.copy()
    for row in part[::-1]:
        second = second * w + 2 * first
        first = first * w + value
        value = value * w + row
    return value, first, second
