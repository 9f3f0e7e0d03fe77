"""Absolute stability proved over the whole box with a stated multiplier.

Springs that are one-sided or saturate are a nondecreasing function of position of slope at most K,
dampers and masses that are switched are multiplied by any θ(t) in [0, 1]. With the multiplier M of
the spring and a constant λ of each of the others, they are stable if at every frequency the
Hermitian part of diag(M/K, λ/B, ...) + (M, λ·v, ...)ᵀ·(G, G, ...) is positive definite (Zames and
Falb for the spring, the circle criterion for what is switched; docs/theory.md, 10). The second
matrix has rank one, its Hermitian part at most one negative eigenvalue, and the first is not
negative: positive definite is the same as a positive determinant,

    Π aᵢ + Σ Re(pᵢ·G)·Π_{j≠i} aⱼ - ¼|G|²·Σ_{i<j} |pᵢ - pⱼ|²·Π_{k≠i,j} aₖ > 0.

Multiplied by |D|², G = N/D, nothing is divided by what may vanish. Where nothing holds the position
M(1) = 0, and the pole of G at z = 1 is taken out of both. One file: one condition over cells, and
what it presumes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import AffineForm, ComplexArray, FloatArray, Term, real_lower_bound
from tune.certificate.branch_and_bound import Cells, Claim, Proof, branch_and_bound
from tune.certificate.mechanism import Mechanism
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.value_set import rate_of, sampled_plant, sinc
from tune.certificate.zero_exclusion import as_affine, mechanism_of, terms_of
from tune.documents.certified import Multiplier


def prove_absolute(
    region: Region,
    switched: Setting,
    steady: Setting | None,
    multiplier: Multiplier,
    claim: Claim,
    most_cells: int,
) -> Proof:
    """Show the condition everywhere in a region, for every gain up to that of the claim.

    For a smaller gain the first matrix only grows. What the device must be by itself, no pole on or
    outside the unit circle but one at z = 1 where nothing holds it, is for `open_device_failure`,
    and with steady effects for the proof of their linear loop.

    Args:
        region: the box, all of it free or all of it grounded.
        switched: stiffness of springs that are one-sided or saturate, damping and mass of what is
            switched; none negative.
        steady: damping and mass that act at any constant part from nothing to the gain; None for
            none.
        multiplier: with a constant for each of damping and mass that is switched.
        claim: gain and extra delay.
        most_cells: budget.
    """
    refusal = multiplier_failure(region, switched, multiplier)
    if refusal is not None:
        raise ValueError(refusal)
    level = 0.0 if steady is None else claim.gain
    longest = max((tap.samples for tap in multiplier.taps), default=0)

    def examine(merged: Region, cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        symbols = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
        terms = terms_of(cells, symbols)
        theta = as_affine(terms[0], cells, len(symbols))
        with np.errstate(all="ignore"):
            condition = _determinant(
                theta,
                mechanism_of(merged, terms),
                switched,
                multiplier,
                claim.gain,
                None if steady is None else (terms[1], steady),
            )
            holds = real_lower_bound(condition) > 0
        pull = np.zeros_like(cells.low)
        for index, row in enumerate(symbols):
            pull[row] = np.abs(condition.slopes[index].real)
        return holds, pull + condition.real * _bent(cells, longest)

    return branch_and_bound(region, [Claim(gain=level, extra=claim.extra)], examine, most_cells)


def multiplier_failure(region: Region, switched: Setting, multiplier: Multiplier) -> str | None:
    """Why a multiplier says nothing about a region; None where it may."""
    if switched.stiffness and not multiplier.taps and not multiplier.constant:
        return "the multiplier of the spring is nothing"
    if region.grounded and switched.stiffness and not multiplier.constant:
        return "a device that is grounded asks for a constant in the multiplier"
    if not region.grounded and multiplier.constant:
        return "a device that nothing holds asks for a multiplier without a constant"
    for name in ("damping", "mass"):
        if getattr(switched, name) and getattr(multiplier, name) is None:
            return f"the multiplier has no constant for the {name}"
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


def _bent(cells: Cells, longest: int) -> FloatArray:
    """Guess of each side's share in what is not straight: by the square of its relative width.

    Args:
        cells: any.
        longest: samples of the longest tap, by which frequency turns.
    """
    centre, width = (cells.low + cells.high) / 2, (cells.high - cells.low) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(width > 0, width / np.abs(centre), 0.0)
    # Delay and taps turn by their product with frequency.
    relative[0] += width[0] * longest
    relative[1] = width[1] / max(float(cells.high[1].max()), np.finfo(float).tiny)
    relative[2] = width[2] * centre[0]
    square = relative**2
    return square / np.maximum(square.sum(axis=0), np.finfo(float).tiny)


def _determinant(
    theta: AffineForm,
    mechanism: Mechanism,
    switched: Setting,
    multiplier: Multiplier,
    gain: float,
    steady: tuple[Term, Setting] | None,
) -> AffineForm:
    """|D|² times the determinant, both without what they have of θ where nothing is grounded."""
    plant = sampled_plant(theta, mechanism)
    step, grounded = mechanism.sample_time, mechanism.grounded
    # What the estimates have of s = jθ meets the pole of the plant.
    s = theta * 1j if grounded else theta * 0.0 + 1.0
    seen, bottom = plant.numerator, plant.denominator
    if steady is not None:
        part, setting = steady
        bottom = bottom + seen * (s * rate_of(theta, plant.half_sinc, step, setting)) * part
    sizes: list[Term] = []
    products: list[AffineForm] = []
    if switched.stiffness:
        real, product = _of_spring(theta, multiplier, grounded=grounded)
        sizes.append(real * (1 / (gain * switched.stiffness)))
        products.append(product)
    for name, constant, power in (
        ("damping", multiplier.damping, 1),
        ("mass", multiplier.mass, 2),
    ):
        value = getattr(switched, name)
        if value:
            assert constant is not None
            alone = {"stiffness": 0.0, "damping": 0.0, "mass": 0.0, name: 1.0}
            one = replace(switched, **alone)
            unit = constant * (step if power == 1 else step * step)
            sizes.append(unit * (1 / (gain * value)))
            products.append(s * rate_of(theta, plant.half_sinc, step, one) * unit)
    square, size = _squared(bottom), _squared(seen)
    loop = seen * _conjugate(bottom)
    total = square * _product(sizes)
    for i, product in enumerate(products):
        total = total + _real(loop * product) * _product(sizes, without=(i,))
    for i, j in combinations(range(len(products)), 2):
        apart = _squared(products[i] - products[j])
        total = total - size * apart * (_product(sizes, without=(i, j)) * 0.25)
    return total


def _of_spring(
    theta: AffineForm, multiplier: Multiplier, *, grounded: bool
) -> tuple[AffineForm, AffineForm]:
    """(Re M, M), or (Re M, M/(jθ)) where nothing is grounded and M has no constant."""
    real = product = theta * 0.0 + multiplier.constant
    square = _real(theta * theta)
    for tap in multiplier.taps:
        half = theta * (tap.samples / 2)
        ratio = sinc(half)
        # 1 - e^(-jx) = jx·sinc(x/2)·e^(-jx/2), and its real part 2·sin²(x/2).
        real = real + square * (ratio * ratio) * (tap.weight * tap.samples**2 / 2)
        turned = ratio * half.turn() * (tap.weight * tap.samples)
        product = product + (theta * 1j * turned if grounded else turned)
    return real, product


def _product(terms: list[Term], without: tuple[int, ...] = ()) -> Term:
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
