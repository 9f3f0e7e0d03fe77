"""Absolute stability proved over the whole box with a stated multiplier.

An element with a spring is one nondecreasing function of u = K·y + B·v + M·a, zero at nothing and
of slope at most 1; what is damping only is multiplied by any θ(t) in [0, 1]. With a multiplier of
each, a constant for damping, they are stable if at every frequency the Hermitian part of

    Mᵢ·(δᵢⱼ/(g·sᵢ) + oᵢ·G)

is positive definite, sᵢ being K or B and sᵢ·oᵢ the law (Zames and Falb; the circle criterion for
what is switched; docs/theory.md, 10). With aᵢ = Re Mᵢ/(g·sᵢ) and pᵢ = Mᵢ·oᵢ that is
diag(a) + p·(G, G, ...): the second matrix has rank one, its Hermitian part at most one negative
eigenvalue, and the first is not negative, so that positive definite is a positive determinant,

    Π aᵢ + Σ Re(pᵢ·G)·Π_{j≠i} aⱼ - ¼|G|²·Σ_{i<j} |pᵢ - pⱼ|²·Π_{k≠i,j} aₖ > 0.

Multiplied by |D|², G = N/D, nothing is divided by what may vanish, and a positive one has no D of
zero: what fades, at any level within G, moves no pole across the circle. Where nothing holds the
position M(1) = 0 in every clamp, of which a multiplier then has a slope Σ weight·samples of 1: with
another none would prove two clamps near θ = 0. There the pole of G is taken out of p and D, and θ²
out of every a of a clamp and out of the difference of two p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import (
    AffineForm,
    FloatArray,
    Term,
    conjugate,
    real_lower_bound,
    real_part,
    squared_modulus,
)
from tune.certificate.branch_and_bound import Cells, Claim, decide, initial_cells
from tune.certificate.mechanism import Mechanism, product_of
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.value_set import rate_of, sampled_plant, sinc, sinc_beyond
from tune.certificate.zero_exclusion import as_affine, mechanism_of, terms_of
from tune.documents.certified import Channel, Multiplier

_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, slots=True, kw_only=True)
class Nonlinear:
    """What of a sum of elements is not linear, and what stands still meanwhile.

    Attributes:
        clamps: each element with a spring, by name.
        damping: all that is damping only, switched at any moment; None for none.
        steady: each element that fades and has no spring, at any constant level of its own.
    """

    clamps: dict[str, Setting]
    damping: Setting | None
    steady: tuple[Setting, ...]


def prove_absolute(
    region: Region, sum_: Nonlinear, multiplier: Multiplier | None, claim: Claim, most_cells: int
) -> int:
    """Show the condition everywhere in a region, for every gain up to that of the claim.

    For a smaller gain the first matrix only grows. It says of the linear loop that no pole crosses
    the circle, at any level of each part; by itself the device has none there, as its damping and
    that of its modes is above zero: all that moves loses energy, springs and hands or not, but for
    one pole at z = 1 where nothing holds the position.

    Args:
        region: the box, all of it free or all of it grounded.
        sum_: what is played; its steady elements act at any part from nothing to the gain.
        multiplier: with a channel for each clamp, or one for several, and for damping.
        claim: gain and extra delay.
        most_cells: budget.

    Returns:
        Cells looked at.

    Raises:
        ValueError: device or multiplier allow no such proof, or it was not found.
    """
    channels = _channels(region, sum_, multiplier)
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
        theta = as_affine(terms[0], cells, len(symbols))
        steady = list(zip(terms[sides:], sum_.steady, strict=True))
        pull = np.zeros_like(cells.low)
        with np.errstate(all="ignore"):
            condition, factors = _determinant(
                theta, mechanism_of(merged, terms[:sides]), channels, claim.gain, steady
            )
            # What is not straight comes from products: by the squares of the factors' slopes.
            bent = [np.abs(each.slopes / each.centre) for each in factors]
            bent = np.nan_to_num(bent, posinf=1e3)
            shares = np.sum(bent**2, axis=0) + _TINY
        pull[symbols] = np.abs(condition.slopes.real) + condition.real * shares / shares.sum(axis=0)
        return real_lower_bound(condition) > 0, pull

    proof = decide(begun, examine, most_cells)
    if proof.doubt is not None:
        place = merged.point(proof.doubt[:-1, 0], float(proof.doubt[-1, 0])).words()
        raise ValueError(f"the condition could not be shown at {place}, {proof.cells} cells")
    return proof.cells


def _channels(
    region: Region, sum_: Nonlinear, multiplier: Multiplier | None
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
        if bool(channel.constant) != region.grounded or not (channel.taps or region.grounded):
            least = "a constant above zero" if region.grounded else "taps and no constant"
            where = "is held" if region.grounded else "nothing holds"
            raise ValueError(f"the multiplier of {name} needs {least} where a device {where}")
    if any(channel.taps or not channel.constant for channel in switched):
        raise ValueError("the multiplier of damping that is switched is a constant above zero")
    multipliers = [*(own[name] for name in sum_.clamps), *switched]
    return list(zip([*sum_.clamps.values(), *dampers], multipliers, strict=True))


def _determinant(
    theta: AffineForm,
    mechanism: Mechanism,
    channels: Sequence[tuple[Setting, Channel]],
    gain: float,
    steady: Sequence[tuple[Term, Setting]],
) -> tuple[AffineForm, list[AffineForm]]:
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
    loop, squared = seen * conjugate(bottom), squared_modulus(seen)
    total = out * squared_modulus(bottom) * product_of(sizes)
    for i, product in enumerate(products):
        term = real_part(loop * product) * product_of(sizes, without=(i,))
        total = total + (term if i < clamps else out * term)
    for i, j in combinations(range(len(products)), 2):
        between = apart[i] - apart[j] if j < clamps else products[i] - products[j]
        others = product_of(sizes, without=(i, j)) * 0.25
        total = total - squared * squared_modulus(between) * others
    return total, [bottom, seen, *sizes, *products]


def _taps(
    theta: AffineForm, channel: Channel, *, normal: bool
) -> tuple[AffineForm, float, AffineForm]:
    """(Re M/θ², M/(jθ) at θ = 0, what is more of it over θ) of the taps of a multiplier.

    Where it is to be normal they are weighed so that the second is 1.
    """
    slope = sum(tap.weight * tap.samples for tap in channel.taps)
    real = rest = theta * 0.0
    for tap in channel.taps:
        n, weight = tap.samples, tap.weight * tap.samples / (slope if normal else 1.0)
        # 1 - e^(-jx) = 2·sin²(x/2) + j·sin(x).
        square = sinc(theta * (n / 2))
        square = square * square * (weight * n / 2)
        real, rest = real + square, rest + sinc_beyond(theta * n) * (weight * n) - square * 1j
    return real, 1.0 if normal else slope, rest
