"""Absolute stability proved over the whole box with a stated multiplier; docs/theory.md, 10.

With aᵢ = Re Mᵢ/(g·sᵢ) and pᵢ = Mᵢ·oᵢ the matrix of the condition is diag(a) + p·(G, G, ...), whose
second part has rank one: it is positive definite where its determinant is positive,

    Π aᵢ + Σ Re(pᵢ·G)·Π_{j≠i} aⱼ - ¼|G|²·Σ_{i<j} |pᵢ - pⱼ|²·Π_{k≠i,j} aₖ > 0.

Multiplied by |D|², G = N/D, nothing is divided by what may vanish, and a positive one has no D of
zero: what fades, at any level within G, moves no pole across the circle. Where nothing holds the
position M(1) = 0 in every clamp, of which a multiplier then has a slope Σ weight·samples of 1: with
another none would prove two clamps near θ = 0. There the pole of G is taken out of p and D, and θ²
out of every a of a clamp and out of the difference of two p.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification import counted
from tune.certificate.affine import (
    ROUNDING,
    AffineForm,
    FloatArray,
    Term,
    conjugate,
    real_lower_bound,
    real_part,
    sinc,
    sinc_beyond,
    squared_modulus,
)
from tune.certificate.region import Region, Setting, setting_of
from tune.certificate.value_set import (
    Mechanism,
    product_of,
    rate_of,
    sampled_plant,
)
from tune.certificate.zero_exclusion import (
    Cells,
    Claim,
    decide,
    initial_cells,
    mechanism_of,
    prove,
    terms_of,
    values_of,
)
from tune.documents import CheckFailedError
from tune.documents.profile import AbsoluteStability, Channel, Design, Multiplier

_TINY = float(np.finfo(float).tiny)


class _SpentError(ValueError):
    """A proof had no more cells to look at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Nonlinear:
    """What of a sum of elements is not linear, and what stands still meanwhile."""

    clamps: dict[str, Setting]  # each element with a spring, by name
    damping: Setting | None  # all that is damping only, switched at any moment; None for none
    # each element that fades and has no spring, at any constant level of its own
    steady: tuple[Setting, ...]


def _prove_absolute(
    region: Region, sum_: _Nonlinear, multiplier: Multiplier | None, claim: Claim, most_cells: int
) -> int:
    """Cells in which the condition is shown everywhere in a region, up to the gain of the claim."""
    # For a smaller gain the first matrix only grows. It says of the linear loop that no pole
    # crosses the circle, at any level of each part; by itself the device has none there, as its
    # damping and that of its modes is above zero: all that moves loses energy, springs and hands or
    # not, but for one pole at z = 1 where nothing holds the position. The region is all of it free
    # or all of it grounded; steady elements act at any part from nothing to the gain. ValueError is
    # raised where device or multiplier allow no such proof, or it was not found.
    channels = _channels(sum_, multiplier, grounded=region.grounded)
    if not min([region.damping[0], *(mode.damping_ratio[0] for mode in region.modes)]) > 0:
        raise ValueError("the device or a mode may have no damping, and what moves it may pump it")
    merged = region.merged()
    sides = 3 + len(merged.sides())
    begun = initial_cells(merged, [Claim(gain=0.0, extra=claim.extra)])
    levels = np.full((len(sum_.steady), len(begun)), claim.gain)
    begun = Cells(np.vstack([begun.low, 0 * levels]), np.vstack([begun.high, levels]))

    def examine(cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        symbols = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
        terms = terms_of(cells, symbols)
        steady = list(zip(terms[sides:], sum_.steady, strict=True))
        pull = np.zeros_like(cells.low)
        with np.errstate(all="ignore"):
            theta, mechanism = mechanism_of(merged, terms[:sides])
            found, factors = _determinant(theta, mechanism, channels, claim.gain, steady)
            condition = found.total()
            holds = (real_lower_bound(condition) > 0) | found.beyond_a_line()
            # What is not straight comes from products: by the squares of the factors' slopes.
            bent = [np.abs(each.slopes / each.centre) for each in factors]
            bent = np.nan_to_num(bent, posinf=1e3)
            shares = np.sum(bent**2, axis=0) + _TINY
        pull[symbols] = np.abs(condition.slopes.real) + condition.real * shares / shares.sum(axis=0)
        return holds, pull

    proof = decide(begun, examine, most_cells)
    if proof.doubt is not None:
        doubt = values_of(merged, proof.doubt)[:, 0]
        place = merged.point(doubt[: sides - 3], float(doubt[-1])).words()
        words = f"the condition could not be shown at {place}, {proof.cells} cells"
        raise _SpentError(words) if proof.spent else ValueError(words)
    return proof.cells


def _channels(
    sum_: _Nonlinear, multiplier: Multiplier | None, *, grounded: bool
) -> list[tuple[Setting, Channel]]:
    """Each clamp, then what is damping only, with its multiplier; clamps may share one."""
    if multiplier is None:
        raise ValueError("no multiplier is stated")
    dampers = [] if sum_.damping is None else [sum_.damping]
    last = len(multiplier.channels) - len(dampers)
    clamps, switched = multiplier.channels[:last], multiplier.channels[last:]
    own = {n: c for c in clamps for n in sum_.clamps if f" + {n} + " in f" + {c.name} + "}
    names = [" + ".join(n for n in own if own[n] is c) for c in clamps] + ["damping"] * len(dampers)
    seen = [channel.name for channel in multiplier.channels]
    if own.keys() != sum_.clamps.keys() or names != seen:
        asked = ", ".join([*sum_.clamps, *["damping"] * len(dampers)])
        raise ValueError(f"its multiplier is of {', '.join(seen) or 'nothing'}, not of {asked}")
    for name, channel in own.items():
        if bool(channel.constant) != grounded or not (channel.taps or grounded):
            least = "a constant above zero" if grounded else "taps and no constant"
            where = "is held" if grounded else "nothing holds"
            raise ValueError(f"the multiplier of {name} needs {least} where a device {where}")
    if any(channel.taps or not channel.constant for channel in switched):
        raise ValueError("the multiplier of damping that is switched is a constant above zero")
    multipliers = [*(own[name] for name in sum_.clamps), *switched]
    return list(zip([*sum_.clamps.values(), *dampers], multipliers, strict=True))


@dataclass(frozen=True, slots=True)
class _Determinant:
    """A·|D|² + Re(D̄·Q) - R, positive where the condition holds."""

    bottom: AffineForm  # D
    whole: AffineForm  # A
    beside: AffineForm  # Q
    less: AffineForm  # R

    def total(self) -> AffineForm:
        """All of it."""
        loop = real_part(conjugate(self.bottom) * self.beside)
        return self.whole * squared_modulus(self.bottom) + loop - self.less

    def beyond_a_line(self) -> NDArray[np.bool_]:
        """Whether a straight line shows it, in each cell."""
        # With A > 0 it says |2·A·D + Q| > √(|Q|² + 4·A·R), which is to be outside of a circle: so
        # is what has a line between. D is all but straight in mass, damping and stiffness, so that
        # little is lost however wide they are. The root is bounded by its tangent.
        seen = self.whole * self.bottom * 2.0 + self.beside
        square = squared_modulus(self.beside) + self.whole * self.less * 4.0
        middle = np.maximum(square.centre.real, _TINY)
        root = (square + middle) * (0.5 / np.sqrt(middle))
        shown = np.zeros(seen.centre.shape, dtype=np.bool_)
        # A line at right angles to the way to the middle, or along what moves it.
        for way in (seen.centre, *(1j * seen.slopes)):
            unit = np.conj(way) / np.maximum(np.abs(way), _TINY) * (1 - 4 * ROUNDING)
            unit *= np.where((unit * seen.centre).real < 0, -1.0, 1.0)
            centre, slopes = (unit * seen.centre).real, (unit * seen.slopes).real
            wide = np.sum(np.abs(slopes - root.slopes.real), axis=0) + root.real
            wide += np.abs(unit.real) * seen.real + np.abs(unit.imag) * seen.imag
            lost = 4 * ROUNDING * (np.abs(centre) + np.abs(root.centre.real) + wide)
            shown |= centre - root.centre.real - wide - lost > 0
        return shown & (real_lower_bound(self.whole) > 0)


def _determinant(
    theta: AffineForm,
    mechanism: Mechanism,
    channels: Sequence[tuple[Setting, Channel]],
    gain: float,
    steady: Sequence[tuple[Term, Setting]],
) -> tuple[_Determinant, list[AffineForm]]:
    """(|D|² times the determinant, what it is made of), without θ where nothing is grounded."""
    plant = sampled_plant(theta, mechanism)
    step, one, square = mechanism.sample_time, theta * 0.0 + 1.0, real_part(theta * theta)
    # What the estimates have of s = jθ meets the pole of the plant.
    s = theta * 1j if mechanism.grounded else one
    seen, bottom = plant.numerator, plant.denominator
    for level, setting in steady:
        bottom = bottom + seen * (s * rate_of(theta, plant.half_sinc, step, setting)) * level
    sizes, products, apart = (list[AffineForm]() for _ in range(3))
    for setting, channel in channels:
        size = setting.stiffness or setting.damping
        rate = one * 0.0 + rate_of(theta, plant.half_sinc, step, setting) * (1 / size)
        real, product = one * channel.constant, s * rate * channel.constant
        if setting.stiffness:
            real, slope, rest = _taps(theta, channel, normal=not mechanism.grounded)
            whole = theta * rest + slope
            if mechanism.grounded:
                real = square * real + channel.constant
                product = (theta * 1j * whole + channel.constant) * (theta * 1j * rate + 1.0)
            else:
                apart.append(rest + whole * rate * 1j)
                product = theta * apart[-1] + 1.0
        sizes.append(real * (1 / (gain * size)))
        products.append(product)
    clamps = len(apart)
    # θ² that was taken out of every clamp.
    out = square if clamps else one
    beside, less, squared = one * 0.0, one * 0.0, squared_modulus(seen)
    for i, product in enumerate(products):
        others = product_of(sizes, without=(i,))
        beside = beside + seen * product * (others if i < clamps else out * others)
    for i, j in itertools.combinations(range(len(products)), 2):
        between = apart[i] - apart[j] if j < clamps else products[i] - products[j]
        others = product_of(sizes, without=(i, j)) * 0.25
        less = less + squared * squared_modulus(between) * others
    found = _Determinant(bottom, out * product_of(sizes), beside, less)
    return found, [bottom, seen, *sizes, *products]


def _taps(
    theta: AffineForm, channel: Channel, *, normal: bool
) -> tuple[AffineForm, float, AffineForm]:
    """(Re M/θ², M/(jθ) at θ = 0, what is more of it over θ) of the taps of a multiplier."""
    # Where it is to be normal they are weighed so that the second is 1.
    slope = sum(tap.weight * tap.samples for tap in channel.taps)
    real = rest = theta * 0.0
    for tap in channel.taps:
        n, weight = tap.samples, tap.weight * tap.samples / (slope if normal else 1.0)
        # 1 - e^(-jx) = 2·sin²(x/2) + j·sin(x).
        square = sinc(theta * (n / 2))
        square = square * square * (weight * n / 2)
        real, rest = real + square, rest + sinc_beyond(theta * n) * (weight * n) - square * 1j
    return real, 1.0 if normal else slope, rest


_Combination = tuple[str, ...]
#: Multipliers by combination, its elements joined by " + ".
_Witnesses = Mapping[str, AbsoluteStability]

#: What a proof covers, by what is there.
_CLAMPED = "springs with their damping and mass that push on one side only, or are cut at a force"
_GATED = "damping switched at any moment"
_STEADY = "what fades, at any constant level of each element"
#: Cells of a proof, and as many more for each mode, with which no proof is cut short. Near the
#: resonance of a device on a stiff hand a weak wall needs 450 000; with two modes and a clock that
#: is not known well it is 2 900 000. More margin would not make them fewer.
_MOST_CELLS = 1_000_000
_REMEDY = "Ask for less stiffness or damping, or name it apart from what it is not met with"


def _is_clamped(design: Design, combination: tuple[str, ...]) -> bool:
    """Whether some clamp of a combination may be reached: that of a wall, or of a free spring."""
    chosen = [design.elements[name] for name in combination]
    return any(each.stiffness and (each.one_sided or each.cut) for each in chosen)


def clamped_combinations(design: Design) -> tuple[tuple[str, ...], ...]:
    """Combinations with a clamp that may be reached and are part of no other such combination."""
    played = {name for name in design.elements if setting_of(design, (name,))}
    combinations = [
        played.intersection(each) for each in design.combinations() if _is_clamped(design, each)
    ]
    # What is proved of them covers their parts: a clamp that never pushes is nondecreasing, what is
    # switched may stay off, and what fades may be at nothing.
    largest = [each for each in combinations if not any(each < other for other in combinations)]
    return tuple(each for each in design.combinations() if set(each) in largest)


def outermost_of(
    design: Design, combinations: Sequence[_Combination], witnesses: _Witnesses
) -> dict[_Combination, _Combination]:
    """Of each of some combinations the one whose proof is its own too."""
    # The condition is of the multipliers, of the signals K·(y + B/K·v + M/K·a) that they belong to,
    # and of each size times the gain that is stated. Where all but these products are alike and
    # none is larger, the first matrix only grows, and what fades has levels of which all were
    # looked at.
    reaches = {names: _reaches(design, names, witnesses) for names in combinations}
    # What another covers comes after it, or is its equal.
    order = sorted(combinations, key=lambda each: -sum(size for _, size in reaches[each]))
    kept: dict[tuple[object, ...], list[_Combination]] = {}
    found: dict[_Combination, _Combination] = {}
    for names in order:
        alike = kept.setdefault(tuple(part for part, _ in reaches[names]) or names, [])
        others = (each for each in alike if _covers(reaches[each], reaches[names]))
        found[names] = next(others, names)
        if found[names] == names:
            alike.append(names)
    return {names: found[names] for names in combinations}


#: What a channel or a fading element is but for its size, and its size times the stated gain.
_Reaches = list[tuple[str, float]]


def _covers(reaches: _Reaches, other: _Reaches) -> bool:
    return all(mine >= its for (_, mine), (_, its) in zip(reaches, other, strict=True))


def _reaches(design: Design, names: _Combination, witnesses: _Witnesses) -> _Reaches:
    """Each part of a combination, the larger first of those alike; empty where one is in doubt."""
    witness, sum_ = witnesses.get(" + ".join(names)), _nonlinear_parts(design, names)
    if witness is None:
        return []
    stated = [(False, witness.free), (True, witness.held)]
    there = [each is not None for _, each in stated]
    try:
        channels = [_channels(sum_, each, grounded=held) for held, each in stated if each]
    except ValueError:
        return []
    found: _Reaches = []
    for same in zip(*channels, strict=True):
        setting = same[0][0]
        size = setting.stiffness or setting.damping
        signal = [each / size for each in setting.sizes]
        multipliers = [(channel.constant, channel.taps) for _, channel in same]
        found.append((repr((signal, there, multipliers)), size * witness.gain))
    for setting in sum_.steady:
        size = max(map(abs, setting.sizes))
        found.append((repr([each / size for each in setting.sizes]), size * witness.gain))
    return sorted(found, key=lambda part: (part[0], -part[1]))


def judge_switched(
    design: Design,
    combination: _Combination,
    regions: tuple[Region, ...],
    witnesses: _Witnesses,
    most_cells: int | None = None,
    *,
    covered: bool = False,
) -> tuple[AbsoluteStability, int]:
    """What a combination is proved for in every region, by stated multipliers, and cells looked at.

    The budget of cells is for where less would be asked for instead; None for all that may help.
    Nothing is looked at for one that is covered by the proof of another. Raises CheckFailedError
    where it is not proved.
    """
    where, margin = " + ".join(combination), design.margin

    def refused(words: str) -> CheckFailedError:
        return CheckFailedError((f"{where}: {words}. Tune again",))

    witness = witnesses.get(where)
    if witness is None:
        raise refused(
            "its force may be cut or push on one side only, and no multiplier is stated that "
            "proves it stable so"
        )
    gain, extra = witness.gain, witness.extra_delay_samples
    late = counted(f"{extra:.6g}", "extra sample")
    if not gain >= margin.gain or extra != margin.extra_delay_samples:
        raise refused(
            f"absolute_stability says a gain of {gain:.6g} with {late}, the margin "
            f"asks for {margin.gain:.6g} with {margin.extra_delay_samples}"
        )
    sum_, claim, cells = _nonlinear_parts(design, combination), Claim(gain=gain, extra=extra), 0
    modes = len(design.device.modes)
    most = _MOST_CELLS * (1 + modes) if modes else most_cells or _MOST_CELLS
    for grounded, kind in ((False, "free"), (True, "held")):
        multiplier = witness.held if grounded else witness.free
        own = [region for region in regions if region.grounded == grounded]
        if (multiplier is None) == bool(own):
            words = "no multiplier is stated, and some" if own else "a multiplier is stated, and no"
            raise refused(f"absolute_stability, {kind}: {words} device or hand of the box is")
        for region in own if not covered else ():
            try:
                cells += _prove_absolute(region, sum_, multiplier, claim, most)
            except ValueError as error:
                words = (
                    f"{region.words(combination)}: not proved stable with its clamps up to a gain "
                    f"of {gain:.6g} with {late} of delay: {error}. {_REMEDY}"
                )
                raise CheckFailedError((words,), spent=isinstance(error, _SpentError)) from None
    gated, steady = (_GATED,) if sum_.damping else (), (_STEADY,) if sum_.steady else ()
    return witness.model_copy(update={"covers": (_CLAMPED, *gated, *steady)}), cells


def judge_levels(
    design: Design, combination: tuple[str, ...], regions: tuple[Region, ...], most_cells: int
) -> int:
    """Cells in which a combination is proved at every level of what fades."""
    fading = [name for name in combination if design.elements[name].fades]
    if not fading or len(combination) == 1 or _is_clamped(design, combination):
        return 0
    # On the way in and out an element is played in part, each at a level of its own in [0, 1]. For
    # one device, frequency and gain the loop D + s·N is straight in every level, so that its values
    # fill the convex hull of those where each level is 0 or 1. Alone an element goes through
    # smaller gains of itself; a combination with a clamp that may be reached is proved at any level
    # of each. The combination and each part of it are proved at their full levels before.
    corners = [
        setting_of(design, tuple(name for name in combination if name not in absent))
        for count in range(len(fading) + 1)
        for absent in itertools.combinations(fading, count)
    ]
    first, *others = [corner for corner in corners if corner is not None]
    margin, cells = design.margin, 0
    claim = Claim(gain=margin.gain, extra=float(margin.extra_delay_samples))
    for region in regions:
        proof = prove(region, first, [claim], most_cells, others, or_nothing=None in corners)
        if not proof.proved:
            words = (
                f"{region.words(combination)}: not proved stable while {', '.join(fading)} fades "
                f"in or out beside the others, within {proof.cells} cells. Ask for less, or leave "
                "it out of what is felt together"
            )
            raise CheckFailedError((words,))
        cells += proof.cells
    return cells


def _nonlinear_parts(design: Design, combination: tuple[str, ...]) -> _Nonlinear:
    """Clamps, what is damping only, and what fades without a spring."""
    played = {name: setting for name in combination if (setting := setting_of(design, (name,)))}
    clamps = {name: each for name, each in played.items() if each.stiffness}
    steady = {name for name in played if design.elements[name].fades} - clamps.keys()
    dampers = [each for name, each in played.items() if name not in {*clamps, *steady}]
    total = sum(each.damping for each in dampers)
    return _Nonlinear(
        clamps=clamps,
        damping=replace(dampers[0], damping=total) if dampers else None,
        steady=tuple(each for name, each in played.items() if name in steady),
    )
