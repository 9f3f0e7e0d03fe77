"""Value set of the characteristic function on the unit circle, over cells of the unknowns.

A pole is on the unit circle at z = e^jθ where 1 + s·C·G = 0, with the sampled plant

    G = (1 - e^-jθ) Σ P(S)·e^(-Sx)/S over S = j(θ + 2πk), all whole k,

P the plant in continuous time, x the delay in samples: what a held force does at one frequency and
at those that sampling cannot tell from it. P is a quotient of polynomials in S and in every
parameter, whatever modes, hand and lag are there, and the delay is any real number. Multiplied by
its denominator D at k = 0 the condition reads D + s·N = 0, almost straight in everything; farther
aliases are sums of inverse powers and a bounded rest. One file: plant, law and aliases are factors
of one value set.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import (
    ROUNDING,
    AffineForm,
    FloatArray,
    Term,
    inverse,
    modulus_bound,
    real_lower_bound,
)
from tune.certificate.mechanism import Mechanism, Scaled
from tune.certificate.point import Setting, Sizes

#: (sin(x)/x - 1)/x by powers of x², next term 1e-15 at 0.1; beyond it the quotient keeps digits.
_SERIES, _SHORT = np.array([1 / 362_880, -1 / 5040, 1 / 120, -1 / 6]), 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueSet:
    """Value set of D + s·N over cells; its zeros are poles on the unit circle.

    Attributes:
        fixed: D.
        varied: N.
        start: D with its zero at θ = 0 taken out, where a spring acts on a device that is free.
        rising: where D is that of a free rigid mass on a damper, a lower bound of Im(N)/θ, or of
            Re(N) where that zero is out; above zero, with a damper that is not negative, D + s·N
            has no zero for any s > 0 however small. Shape (cells,), None elsewhere.
    """

    fixed: AffineForm
    varied: AffineForm
    start: AffineForm
    rising: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """The plant under a held force, N/D, or N/(s·D) where nothing holds the position; s = jθ.

    Attributes:
        numerator: N.
        denominator: D.
        whole: D, or s·D.
        aliases: what sampling folds onto θ of P(S)/S.
        half_sinc: sinc(θ/2).
    """

    numerator: AffineForm
    denominator: AffineForm
    whole: AffineForm
    aliases: AffineForm
    half_sinc: AffineForm


def sampled_plant(theta: AffineForm, mechanism: Mechanism) -> SampledPlant:
    """The plant over cells of θ in [0, π] and of the mechanism."""
    scaled = Scaled.of(mechanism)
    s = theta * 1j
    numerator, denominator = scaled.plant(s)
    whole = denominator if mechanism.grounded else denominator * s
    half_sinc = sinc(theta * 0.5)
    held_force = half_sinc * (theta * (mechanism.delay + 0.5)).turn()
    aliases = scaled.folded(theta, mechanism.delay)
    return SampledPlant(
        numerator=held_force * (numerator + whole * s * aliases),
        denominator=denominator,
        whole=whole,
        aliases=aliases,
        half_sinc=half_sinc,
    )


def value_set(
    theta: AffineForm,
    mechanism: Mechanism,
    setting: Setting,
    sizes: Sizes | None = None,
    plant: SampledPlant | None = None,
) -> ValueSet:
    """Value set of D + s·N over cells of θ in [0, π] and of the mechanism.

    Args:
        theta: angle of z.
        mechanism: everything that is not known exactly.
        setting: which effects are played, and their filters.
        sizes: of these effects, where they differ from cell to cell, each of shape (cells,).
        plant: of this angle and mechanism, where it is known.
    """
    sizes = sizes or setting.sizes
    stiffness = sizes[0]
    plant = plant or sampled_plant(theta, mechanism)
    s = theta * 1j
    seen, denominator, whole = plant.numerator, plant.denominator, plant.whole
    rate = rate_of(theta, plant.half_sinc, mechanism.sample_time, setting, sizes)
    if setting.stiffness:
        law = s * rate + stiffness
    elif mechanism.grounded:
        law = s * rate
    else:
        varied = seen * rate
        rising = real_lower_bound(varied) if mechanism.free_and_rigid else None
        # θ is out of both, and what is left of jθ turns them as it turns those with a spring.
        fixed = denominator * 1j
        return ValueSet(fixed=fixed, varied=varied * 1j, start=fixed, rising=rising)
    varied = law * seen
    if mechanism.grounded:
        return ValueSet(fixed=whole, varied=varied, start=denominator)
    rising = None
    if mechanism.free_and_rigid:
        # N = (K + jθ·rate)·sinc·e^(-jφ)·(1 + jθ·D·aliases) with φ = θ(x + 1/2): the imaginary part
        # of what K is multiplied by is not below -φ - θ·|D·aliases|.
        late = modulus_bound(mechanism.delay + 0.5) + modulus_bound(whole) * modulus_bound(
            plant.aliases
        )
        rising = real_lower_bound(seen * rate) - stiffness * late
    return ValueSet(fixed=whole, varied=varied, start=denominator * 1j, rising=rising)


def gain_vertices(
    response: ValueSet, low: FloatArray, high: FloatArray
) -> tuple[AffineForm, AffineForm]:
    """D + s·N at both end gains; D with its zero at θ = 0 taken out where the lower gain is 0.

    The gains have shape (cells,) and no unit.
    """
    fixed, varied, start = response.fixed, response.varied, response.start
    top = fixed + varied * high
    above = fixed + varied * low
    none = low == 0
    bottom = AffineForm(
        np.where(none, start.centre, above.centre),
        np.where(none, start.slopes, above.slopes),
        np.where(none, start.real, above.real),
        np.where(none, start.imag, above.imag),
    )
    return bottom, top


def excludes_zero(*forms: AffineForm) -> NDArray[np.bool_]:
    """Whether zero lies outside the convex hull of affine forms: all on one side of some line.

    The best line runs along an edge of one of the sets, or square to one of the centres.

    The centre of each form and the answer have shape (cells,).
    """
    excluded = np.zeros(forms[0].centre.shape, dtype=np.bool_)
    middle = np.zeros_like(forms[0].centre)
    for form in forms:
        middle = middle + form.centre / np.abs(form.centre)
    normals = [*(form.centre for form in forms), middle]
    normals += [1j * slope for form in forms for slope in form.slopes]
    for normal in normals:
        unit = normal / np.abs(normal)
        # Turned so that the centres are on the positive side.
        unit = unit * np.where((np.conj(unit) * middle).real < 0, -1, 1)
        clear = reduce(np.minimum, (_clearance(form, unit) for form in forms))
        excluded |= clear > 0
    return excluded


def _clearance(form: AffineForm, unit: NDArray[np.complex128]) -> FloatArray:
    """Least distance from the line through zero with this normal; nan where there is no normal."""
    across, along = unit.real, unit.imag
    centre = across * form.centre.real + along * form.centre.imag
    slopes = np.sum(np.abs(across * form.slopes.real + along * form.slopes.imag), axis=0)
    rest = np.abs(across) * form.real + np.abs(along) * form.imag
    size = np.abs(form.centre) + np.sum(np.abs(form.slopes), axis=0)
    return centre - slopes - rest - ROUNDING * size


def sinc(angle: AffineForm) -> AffineForm:
    """sin(x)/x of a real form."""
    x = angle.centre.real
    small = np.abs(x) < 1e-4
    safe = np.where(small, 1.0, x)
    value = np.where(small, 1 - x * x / 6, np.sin(safe) / safe)
    # The slope by its series below 0.1, where the quotient loses digits: next term 1e-15.
    short = np.abs(x) < 0.1
    other = np.where(short, 1.0, x)
    slope = np.where(
        short,
        -x / 3 * (1 - x * x / 10 * (1 - x * x / 28 * (1 - x * x / 54))),
        (np.cos(other) - np.sin(other) / other) / other,
    )
    return angle.of_real(value, slope, 1 / 3)


def sinc_beyond(angle: AffineForm) -> AffineForm:
    """(sin(x)/x - 1)/x of a real form; its second derivative is ∫∫ s²·sin(sx), at most 1/12."""
    x = angle.centre.real
    short = np.abs(x) < _SHORT
    safe = np.where(short, 1.0, x)
    ratio = np.sin(safe) / safe
    value = np.where(short, x * np.polyval(_SERIES, x * x), (ratio - 1) / safe)
    slopes = np.polyval(_SERIES * [7, 5, 3, 1], x * x)
    slope = np.where(short, slopes, (np.cos(safe) - 2 * ratio + 1) / safe**2)
    return angle.of_real(value, slope, 1 / 12)


def rate_of(
    theta: AffineForm,
    half_sinc: AffineForm,
    step: Term,
    setting: Setting,
    sizes: Sizes | None = None,
) -> Term:
    """(B·velocity + M·acceleration)/(jθ) per position; arguments as of ``value_set``."""
    _, damping, mass = sizes or setting.sizes
    per_step = inverse(step)
    difference = (theta * 0.5).turn() * half_sinc
    rate: Term = 0.0
    if setting.damping:
        if setting.velocity_window_samples:
            angle = theta * (setting.velocity_window_samples / 2)
            estimate = sinc(angle) * angle.turn()
        else:
            estimate = difference * _low_pass(
                theta,
                step,
                setting.velocity_filter_hz,
                setting.velocity_filter_order,
                setting.filter_damping_ratio,
            )
        rate = estimate * (per_step * damping)
    if setting.mass:
        estimate = (difference * difference) * _low_pass(
            theta,
            step,
            setting.acceleration_filter_hz,
            setting.acceleration_filter_order,
            setting.filter_damping_ratio,
        )
        rate = rate + estimate * (theta * 1j) * (per_step * per_step * mass)
    return rate


def _low_pass(
    theta: AffineForm, step: Term, cutoff: float | None, order: int, ratio: float
) -> Term:
    """Response of a filter with the poles exp(-2π·f·T) or exp(-2π·f·T·(ζ ± j√(1-ζ²)))."""
    if cutoff is None:
        return 1.0
    if order == 1:
        return _pole(theta, step, 2 * np.pi * cutoff)
    turn = float(np.sqrt(max(0.0, 1 - ratio * ratio)))
    first = _pole(theta, step, 2 * np.pi * cutoff * complex(ratio, turn))
    if turn == 0:
        return first * first
    return first * _pole(theta, step, 2 * np.pi * cutoff * complex(ratio, -turn))


def _pole(theta: AffineForm, step: Term, rate: complex) -> AffineForm:
    """(1 - a)/(1 - a·e^-jθ) with a = exp(-rate·T)."""
    exponent = theta * 1j + step * rate
    known = not isinstance(step, AffineForm)
    top = -np.expm1(-rate * step) if known else 1.0 - (step * -rate).exponential()
    return (1.0 - (exponent * -1.0).exponential()).inverse() * top
