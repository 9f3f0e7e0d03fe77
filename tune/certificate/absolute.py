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

Multiplied by |D|², G = N/D, nothing is divided by what may vanish. Where nothing holds the position
M(1) = 0 in every clamp, of which a multiplier then has a slope Σ weight·samples of 1: with another
none would prove two clamps near θ = 0. There the pole of G is taken out of p and D, and θ² out of
every a of a clamp and out of the difference of two p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import AffineForm, ComplexArray, FloatArray, Term, real_lower_bound
from tune.certificate.branch_and_bound import Cells, Claim, Proof, decide, initial_cells
from tune.certificate.mechanism import Mechanism
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.value_set import rate_of, sampled_plant, sinc
from tune.certificate.zero_exclusion import as_affine, mechanism_of, terms_of
from tune.documents.certified import Channel, Multiplier


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

    @property
    def channels(self) -> list[Setting]:
        """The clamps, then what is damping only."""
        return [*self.clamps.values(), *(() if self.damping is None else (self.damping,))]


def prove_absolute(
    region: Region, sum_: Nonlinear, multiplier: Multiplier, claim: Claim, most_cells: int
) -> Proof:
    """Show the condition everywhere in a region, for every gain up to that of the claim.

    For a smaller gain the first matrix only grows. What the device must be by itself, no pole on or
    outside the unit circle but one at z = 1 where nothing holds it, is for `open_device_failure`,
    and with steady effects for the proof of their linear loop.

    Args:
        region: the box, all of it free or all of it grounded.
        sum_: clamps and damping in the order of the multiplier's channels; the steady ones act at
            any part from nothing to the gain.
        multiplier: with a channel for each.
        claim: gain and extra delay.
        most_cells: budget.

    Raises:
        ValueError: the multiplier says nothing about the region.
    """
    refusal = multiplier_failure(region, sum_, multiplier)
    if refusal is not None:
        raise ValueError(refusal)
    merged, count = region.merged(), len(sum_.steady)
    sides = 3 + len(merged.sides())
    begun = initial_cells(merged, [Claim(gain=0.0, extra=claim.extra)])
    levels = np.ones((count, len(begun))) * claim.gain
    begun = Cells(np.vstack([begun.low, 0 * levels]), np.vstack([begun.high, levels]))

    def examine(cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        symbols = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
        terms = terms_of(cells, symbols)
        theta = as_affine(terms[0], cells, len(symbols))
        with np.errstate(all="ignore"):
            condition, factors = _determinant(
                theta,
                mechanism_of(merged, terms[:sides]),
                sum_,
                multiplier,
                claim.gain,
                terms[sides:],
            )
            holds = real_lower_bound(condition) > 0
        pull = np.zeros_like(cells.low)
        for index, row in enumerate(symbols):
            pull[row] = np.abs(condition.slopes[index].real)
        shares = _bent(symbols, factors, len(cells.low))
        return holds, pull + condition.real * shares

    proof = decide(begun, examine, most_cells)
    if proof.doubt is None:
        return proof
    # Without the levels, which no point of a region has.
    kept = [*range(sides - 3), -1]
    return replace(proof, doubt=proof.doubt[kept])


def multiplier_failure(region: Region, sum_: Nonlinear, multiplier: Multiplier) -> str | None:
    """Why a multiplier says nothing about a region; None where it may."""
    names = [*sum_.clamps, *(() if sum_.damping is None else ("damping",))]
    seen = [channel.name for channel in multiplier.channels]
    if seen != names:
        return f"its multiplier is of {', '.join(seen) or 'nothing'}, not of {', '.join(names)}"
    for place, channel in enumerate(multiplier.channels):
        clamp = place < len(sum_.clamps)
        if not clamp and (channel.taps or not channel.constant):
            return "the multiplier of damping that is switched is a constant above zero"
        if clamp and region.grounded and not channel.constant:
            return f"a device that is held asks for a constant in the multiplier of {channel.name}"
        if clamp and not region.grounded and (channel.constant or not channel.taps):
            return f"a device that nothing holds asks for taps alone in that of {channel.name}"
    return None


def open_device_failure(region: Region) -> str | None:
    """Why a device may have poles by itself that the theorem does not allow; None where not.

    With damping above zero on the rigid mass and on every mode all that moves loses energy, so that
    every pole of the mechanism, bound by springs and hands or not, lies in the left half-plane, but
    one at zero where nothing holds the position; a lag is stable, the hold maps s to e^(sT), and a
    delay adds poles at z = 0.
    """
    if not region.damping[0] > 0:
        return "the device may have no damping, and what moves it freely may then pump it"
    if any(not mode.damping_ratio[0] > 0 for mode in region.modes):
        return "a vibration mode may have no damping"
    return None


def _bent(symbols: Sequence[int], factors: Sequence[AffineForm], sides: int) -> FloatArray:
    """Guess of each side's share in what is not straight: products of slopes of the factors.

    Args:
        symbols: sides that move something.
        factors: forms that are multiplied.
        sides: of the cells.
    """
    shares = np.zeros((sides, factors[0].centre.size))
    for form in factors:
        with np.errstate(all="ignore"):
            relative = np.abs(form.slopes) / np.abs(form.centre)
        shares[list(symbols)] += np.nan_to_num(relative, posinf=1e3) ** 2
    return shares / np.maximum(shares.sum(axis=0), np.finfo(float).tiny)


def _determinant(
    theta: AffineForm,
    mechanism: Mechanism,
    sum_: Nonlinear,
    multiplier: Multiplier,
    gain: float,
    levels: Sequence[Term],
) -> tuple[AffineForm, list[AffineForm]]:
    """|D|² times the determinant, without what they have of θ where nothing is grounded.

    Beside it the forms of which it is made.
    """
    plant = sampled_plant(theta, mechanism)
    step, grounded = mechanism.sample_time, mechanism.grounded
    # What the estimates have of s = jθ meets the pole of the plant.
    s = theta * 1j if grounded else theta * 0.0 + 1.0
    seen, bottom = plant.numerator, plant.denominator
    for level, setting in zip(levels, sum_.steady, strict=True):
        bottom = bottom + seen * (s * rate_of(theta, plant.half_sinc, step, setting)) * level
    clamps = len(sum_.clamps)
    sizes: list[AffineForm] = []
    products: list[AffineForm] = []
    beyond: list[AffineForm] = []
    for setting, channel in zip(sum_.channels, multiplier.channels, strict=True):
        size = setting.stiffness or setting.damping
        rate = theta * 0.0 + rate_of(theta, plant.half_sinc, step, setting) * (1 / size)
        if not setting.stiffness:
            sizes.append(theta * 0.0 + channel.constant / (gain * size))
            products.append(s * rate * channel.constant)
        elif grounded:
            real, product = _held_multiplier(theta, channel)
            sizes.append(real * (1 / (gain * size)))
            products.append(product * (theta * 1j * rate + 1.0))
        else:
            real, rest = _free_multiplier(theta, channel)
            sizes.append(real * (1 / (gain * size)))
            beyond.append(rest + rate * 1j + theta * rest * rate * 1j)
            products.append(theta * beyond[-1] + 1.0)
    # θ² that was taken out of every clamp.
    out = theta * 0.0 + 1.0 if grounded else _real(theta * theta)
    square, size = _squared(bottom), _squared(seen)
    loop = seen * _conjugate(bottom)
    total = out * square * _product(sizes)
    for i, product in enumerate(products):
        term = _real(loop * product) * _product(sizes, without=(i,))
        total = total + (term if i < clamps else out * term)
    for i, j in combinations(range(len(products)), 2):
        if j < clamps and not grounded:
            apart = _squared(beyond[i] - beyond[j])
        else:
            apart = _squared(products[i] - products[j])
        total = total - size * apart * _product(sizes, without=(i, j)) * 0.25
    return total, [bottom, seen, *sizes, *products]


def _held_multiplier(theta: AffineForm, channel: Channel) -> tuple[AffineForm, AffineForm]:
    """(Re M, M)."""
    real = product = theta * 0.0 + channel.constant
    square = _real(theta * theta)
    for tap in channel.taps:
        half = theta * (tap.samples / 2)
        ratio = sinc(half)
        # 1 - e^(-jx) = jx·sinc(x/2)·e^(-jx/2), and its real part 2·sin²(x/2).
        real = real + square * (ratio * ratio) * (tap.weight * tap.samples**2 / 2)
        product = product + theta * 1j * ratio * half.turn() * (tap.weight * tap.samples)
    return real, product


def _free_multiplier(theta: AffineForm, channel: Channel) -> tuple[AffineForm, AffineForm]:
    """(Re M/θ², (M/(jθ) - 1)/θ) of a multiplier of taps alone, its slope made 1."""
    slope = sum(tap.weight * tap.samples for tap in channel.taps)
    real = rest = theta * 0.0
    for tap in channel.taps:
        n, weight = tap.samples, tap.weight * tap.samples / slope
        ratio = sinc(theta * (n / 2))
        square = ratio * ratio
        real = real + square * (weight * n / 2)
        # (sinc(x)·e^(-jx) - 1)/θ, x = nθ/2: its parts n·(sinc(2x) - 1)/(2x) and -n/2·sinc²(x).
        rest = rest + _sinc_beyond(theta * n) * (weight * n) - square * (weight * n / 2 * 1j)
    return real, rest


def _sinc_beyond(angle: AffineForm) -> AffineForm:
    """(sin(x)/x - 1)/x of a real form; its second derivative is ∫∫ s²·sin(sx), at most 1/12."""
    x = angle.centre.real
    small = np.abs(x) < 0.1
    safe = np.where(small, 1.0, x)
    square = x * x
    # By series below 0.1, where the quotients lose digits: next terms below 1e-15.
    value = np.where(
        small,
        -x / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72))),
        (np.sin(safe) / safe - 1) / safe,
    )
    slope = np.where(
        small,
        -1
        / 6
        * (
            1
            - 3
            * square
            / 20
            * (1 - 5 * square / 126 * (1 - 7 * square / 360 * (1 - 9 * square / 770)))
        ),
        (np.cos(safe) - 2 * np.sin(safe) / safe + 1) / safe**2,
    )
    return angle.of_real(value, slope, 1 / 12)


def _product(terms: Sequence[AffineForm], without: tuple[int, ...] = ()) -> Term:
    total: Term = 1.0
    for index, term in enumerate(terms):
        if index not in without:
            total = term * total
    return total


def _conjugate(form: AffineForm) -> AffineForm:
    return AffineForm(np.conj(form.centre), np.conj(form.slopes), form.real, form.imag)


def _real(form: AffineForm) -> AffineForm:
    """The real part."""
    return AffineForm(
        _complex(form.centre), _complex(form.slopes), form.real, np.zeros_like(form.real)
    )


def _complex(values: ComplexArray) -> ComplexArray:
    return values.real.astype(np.complex128)


def _squared(form: AffineForm) -> AffineForm:
    """|x|²."""
    real, imag = _real(form), _real(form * -1j)
    return real * real + imag * imag
