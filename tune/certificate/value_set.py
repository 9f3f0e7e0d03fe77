"""Value set of the characteristic function on the unit circle, over cells of the unknowns.

A pole is on the unit circle at z = e^jθ where 1 + s·C·G = 0, with the sampled plant

    G = (1 - e^-jθ) Σ P(S)·e^(-Sx)/S over S = j(θ + 2πk), all whole k,

P the plant in continuous time, x the delay in samples: what a held force does at one frequency and
at those that sampling cannot tell from it. P is a quotient of polynomials in S and in every
parameter, whatever modes, hand and lag are there, and the delay is any real number. Multiplied by
its denominator D at k = 0 the condition reads D + s·N = 0, almost straight in everything; farther
aliases are sums of inverse powers,
t_n(θ, x) = Σ e^(-2πjkx) / (j(θ + 2πk))^n over all whole k but 0, of period one in x and as smooth
in it as n allows, and a bounded rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cache, reduce
from itertools import combinations
from math import comb, factorial, prod

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import (
    ROUNDING,
    AffineForm,
    ComplexArray,
    FloatArray,
    Term,
    add_axis,
    anywhere_between,
    ends_of,
    inverse,
    modulus_bound,
    range_of,
    real_lower_bound,
    reciprocal,
    sinc,
)
from tune.certificate.region import Setting, Sizes

#: Terms of the power series in θ; without the two nearest aliases they fall like 4^-m.
_TERMS = 28
#: Absolute error of a value of t_n, n from 2 on: rounding of the Bernoulli polynomials and the
#: rest of the series, 4^-28, both times less than 2^6.
_ERROR = 1e-13
#: Aliases are looked at one by one until the rest is below this part of 1/mass, or the most.
_NEGLIGIBLE = 1e-4
_MOST_ALIASES = 12


def _most(n: int) -> float:
    """Bound of |t_n|: Σ |θ + 2πk|^-n at θ = π; for n = 1, where that diverges, its bound."""
    if n == 1:
        # t_1 = (e^(jθ(x-1/2))·h - 1)/(jθ), 0 < x < 1, h = θ/2/sin(θ/2): at most (h - 1)/θ + 1/2.
        return (np.pi / 2 - 1) / np.pi + 0.5
    odd = sum(float(j) ** -n for j in range(3, 2001, 2))
    # The rest of the odd numbers by an integral.
    rest = 1 / (2 * (n - 1)) * 1999.0 ** (1 - n)
    return (1 + 2 * (odd + rest)) / np.pi**n


_MOST_ALIASED = {n: _most(n) for n in range(1, 8)}


@cache
def _bernoulli() -> NDArray[np.float64]:
    """Row q: ascending coefficients of -B_q(y)/q!, q to the last that is needed."""
    size = _TERMS + 8
    numbers: list[Fraction] = []
    for q in range(size):
        known = sum((comb(q + 1, k) * numbers[k] for k in range(q)), Fraction(0))
        numbers.append(Fraction(1) if q == 0 else -known / (q + 1))
    table = np.zeros((size, size))
    for q in range(size):
        for k in range(q + 1):
            table[q, q - k] = -float(comb(q, k) * numbers[k] / factorial(q))
    return table


def _alias_sums(theta: FloatArray, x: FloatArray, first: int, last: int) -> list[ComplexArray]:
    """t_first .. t_last at points, θ in rad and x in samples; first >= 2."""
    fraction = x - np.floor(x)
    size = last + _TERMS
    powers = np.vander(1 - fraction, size + 1, increasing=True).T
    folded = (_bernoulli()[: size + 1, : size + 1] @ powers).astype(np.complex128)
    turn = np.exp(-2j * np.pi * fraction)
    orders = np.arange(size + 1)
    near = (2j * np.pi) ** (-orders.astype(float))[:, None] * turn
    # Aliases of k and -k carry conjugate turns and opposite signs.
    folded -= near + near.conj()
    found: list[ComplexArray] = []
    for n in range(first, last + 1):
        total = turn / (1j * (theta + 2 * np.pi)) ** n
        total += turn.conj() / (1j * (theta - 2 * np.pi)) ** n
        power = np.ones_like(theta, dtype=np.complex128)
        for m in range(_TERMS):
            total += comb(n + m - 1, m) * power * folded[n + m]
            power *= -1j * theta
        found.append(total)
    return found


def _folded_sums(theta: AffineForm, x: AffineForm) -> tuple[AffineForm, AffineForm]:
    """(t_3, t_4) as forms in θ and x, both real forms."""
    at, late = theta.centre.real, x.centre.real
    values = _alias_sums(at, late, 2, 5)
    wide_theta, wide_x = (
        np.sum(np.abs(form.slopes.real), axis=0) + form.real for form in (theta, x)
    )
    top = np.minimum(np.pi, at + wide_theta)
    forms: list[AffineForm] = []
    for n in (3, 4):
        below, here, above = values[n - 3], values[n - 2], values[n - 1]
        by_x = -below + 1j * at * here
        by_theta = -1j * n * above
        bend_x = _MOST_ALIASED[n - 2] + 2 * top * _MOST_ALIASED[n - 1] + top**2 * _MOST_ALIASED[n]
        bend_both = n * _MOST_ALIASED[n] + n * top * _MOST_ALIASED[n + 1]
        bend_theta = n * (n + 1) * _MOST_ALIASED[n + 2]
        error = (
            bend_x * wide_x**2 / 2
            + bend_both * wide_x * wide_theta
            + bend_theta * wide_theta**2 / 2
            + np.abs(by_x) * x.real
            + np.abs(by_theta) * theta.real
            + _ERROR * (1 + wide_x + wide_theta)
        )
        lost = error > _MOST_ALIASED[n]
        slopes = by_x * x.slopes.real + by_theta * theta.slopes.real
        error = np.where(lost, _MOST_ALIASED[n], error)
        forms.append(
            AffineForm(np.where(lost, 0, here), np.where(lost, 0, slopes), error, error.copy())
        )
    return forms[0], forms[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """What may be anywhere in a cell; numbers where it is known exactly."""

    mass: Term  # kg
    damping: Term  # N·s/m
    sample_time: Term  # s
    delay: AffineForm  # x, in samples
    lag: Term  # time constant of the current loop, s; exactly 0.0 for none
    position_stiffness: Term  # of the device's own force by position, N/m; exactly 0.0 for none
    hand: tuple[Term, Term, Term] | None  # mass, damping and stiffness of the grip; None is no hand
    modes: tuple[tuple[Term, Term], ...]  # frequency in Hz and damping ratio of each
    participations: tuple[tuple[float, float], ...]  # (e, h) of each mode
    grounded: bool  # a spring of device or hand holds the position
    # mass, that of the grip and its stiffness at aliases, where they are known less well; else None
    aliased: tuple[Term, Term, Term] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scaled:
    """The mechanism in units of one sample, with what its polynomials share."""

    mass: Term  # m/T²
    per_mass: Term  # T²/m
    damping: Term  # b/T
    ratio: Term  # bT/m
    spring: Term | None  # k of the device itself, None for none
    spring_ratio: Term | None  # kT²/m, likewise
    lag: Term | None  # in samples, None for none
    hand: tuple[Term, Term, Term] | None  # (m_h/T², b_h/T, k_h) or None
    share: Term  # ρ = m_h/(m + c·m_h), c = 1 + Σ h², at aliases
    stiffness: Term  # k_h at aliases
    modes: tuple[tuple[Term, Term], ...]  # (2ζω, ω²) in samples of each
    participations: tuple[tuple[float, float], ...]  # (e, h) of each
    grounded: bool  # as in the mechanism

    @classmethod
    def of(cls, given: Mechanism) -> _Scaled:
        """What the polynomials share, computed once."""
        step = given.sample_time
        per_step = inverse(step)
        per_square = per_step * per_step
        hand = given.hand
        fast = given.aliased or (given.mass, *((hand[0], hand[2]) if hand else (0.0, 0.0)))
        per_mass = reciprocal(fast[0])
        omegas = [f * step * (2 * np.pi) for f, _ in given.modes]
        free = given.position_stiffness == 0.0
        return cls(
            mass=given.mass * per_square,
            per_mass=per_mass * (step * step),
            damping=given.damping * per_step,
            ratio=given.damping * step * per_mass,
            spring=None if free else given.position_stiffness,
            spring_ratio=None if free else given.position_stiffness * (step * step) * per_mass,
            lag=None if given.lag == 0.0 else given.lag * per_step,
            hand=hand and (hand[0] * per_square, hand[1] * per_step, hand[2]),
            share=_share(fast[1], given.mass, _squares(h for _, h in given.participations)),
            stiffness=fast[2],
            modes=tuple(
                (w * zeta * 2.0, w * w) for w, (_, zeta) in zip(omegas, given.modes, strict=True)
            ),
            participations=given.participations,
            grounded=given.grounded,
        )

    def stacked(self) -> _Scaled:
        """With room for an axis of aliases."""
        return replace(
            self, **{each.name: add_axis(getattr(self, each.name)) for each in fields(self)}
        )

    def plant(self, s: AffineForm) -> tuple[Term, AffineForm]:
        """(numerator, denominator) of P at S; a denominator that vanishes at 0 is divided by S."""
        damped = s * self.mass + self.damping  # Y/S
        every, numerator, grasped, apart = self._numerators(s)
        rigid = damped * s if self.grounded else damped
        denominator = (rigid if self.spring is None else rigid + self.spring) * every
        if self.hand is not None:
            mass, damping, stiffness = self.hand
            followed = s * mass + damping
            spring = s * followed + stiffness if self.grounded else followed
            grip = spring if self.grounded else s * followed
            denominator = denominator + spring * grasped
            if self.modes:
                numerator = numerator + grip * apart * self.per_mass
        if self.lag is not None:
            denominator = denominator * (s * self.lag + 1.0)
        return numerator, denominator

    def reduced(self, s: AffineForm) -> tuple[Term, AffineForm]:
        """Both of `plant` over m + c·m_h, all the mass that a fast force moves."""
        # At high frequencies the denominator is all but the same for every hand, however wide their
        # range is.
        every, numerator, grasped, apart = self._numerators(s)
        denominator = (self._inertial(s) if self.grounded else s + self.ratio) * every
        if self.hand is not None:
            lighter = (1.0 - self.share * self.handle) * self.per_mass
            damping, stiffness = self.hand[1] * lighter, self.stiffness * lighter
            yields = s * damping + stiffness if self.grounded else damping
            inert = s * s if self.grounded else s
            # What the share is multiplied by all but vanishes: the inertia of both is one.
            numerator = (
                numerator
                + (s * s * apart - numerator * self.handle) * self.share
                + (yields if self.grounded else s * yields) * apart
            )
            denominator = (
                denominator
                + (inert * grasped - denominator * self.handle) * self.share
                + grasped * yields
            )
        if self.lag is not None:
            denominator = denominator * (s * self.lag + 1.0)
        return numerator * self.per_mass, denominator

    def _numerators(self, s: AffineForm) -> tuple[Term, Term, Term, Term]:
        """Product of the resonances, numerators of encoder and handle, and of the two apart."""
        if not self.modes:
            return 1.0, 1.0, 1.0, 0.0
        each = [s * (s + a) + c for a, c in self.modes]
        every, inertial = product_of(each), self._inertial(s)
        others = [product_of(each, without=(i,)) for i in range(len(each))]
        encoder = every + inertial * _weighed(others, [e * e for e, _ in self.participations])
        if self.hand is None:
            return every, encoder, encoder, 0.0
        handle = every + inertial * _weighed(others, [h * h for _, h in self.participations])
        # How the encoder still moves where the hand holds the handle at rest.
        apart = _weighed(others, [(e - h) ** 2 for e, h in self.participations])
        for i, j in combinations(range(len(each)), 2):
            (ei, hi), (ej, hj) = self.participations[i], self.participations[j]
            both = product_of(each, without=(i, j))
            apart = apart + inertial * both * (ei * hj - ej * hi) ** 2
        return every, encoder, handle, apart

    def _inertial(self, s: AffineForm) -> AffineForm:
        """S² + bS/m + k/m."""
        free = s * (s + self.ratio)
        return free if self.spring_ratio is None else free + self.spring_ratio

    @property
    def handle(self) -> float:
        """c = 1 + Σ h²."""
        return _squares(h for _, h in self.participations)

    def folded(self, theta: AffineForm, delay: AffineForm) -> AffineForm:
        """Σ P(S)·e^(-2πjkx)/S over all k but 0."""
        count = self._aliases()
        total: Term = 0.0
        leading = self._leading() if self.lag is None else None
        if leading is not None:
            third, fourth = _folded_sums(theta, delay)
            total = third * leading[0] + fourth * leading[1]
        if count:
            k: FloatArray = np.concatenate([np.arange(1.0, count + 1), -np.arange(1.0, count + 1)])
            k = 2 * np.pi * k[:, None]
            s = (theta.stacked() + k) * 1j
            stacked = self.stacked()
            fast = stacked.plant if self.hand is None else stacked.reduced
            numerator, denominator = fast(s)
            per_s = s.inverse()
            value = denominator.inverse() * numerator
            if not self.grounded:
                value = value * per_s
            if leading is not None:
                first, second = (add_axis(x) for x in leading)
                value = value - per_s * per_s * (first + per_s * second)
            turn = (delay.stacked() * k).turn()
            total = (value * per_s * turn).total() + total
        total = theta * 0.0 + total
        return total.widened(self._rest(count))

    def _leading(self) -> tuple[Term, Term]:
        """h0 and h1 of P = h0/S² + h1/S³ + ..., without a lag."""
        encoder = [1.0, *(e for e, _ in self.participations)]
        handle = [1.0, *(h for _, h in self.participations)]
        dampings: list[Term] = [self.damping, *(a * self.mass for a, _ in self.modes)]
        shared: Term = 0.0
        if self.hand is not None:
            shared = self.share * sum(e * h for e, h in zip(encoder, handle, strict=True))
        moved = [(g - shared * p) * self.per_mass for g, p in zip(encoder, handle, strict=True)]
        first: Term = 0.0
        second: Term = 0.0
        for g, v, c in zip(encoder, moved, dampings, strict=True):
            first = first + v * g
            second = second - v * v * c
        if self.hand is not None:
            at_hand: Term = 0.0
            for p, v in zip(handle, moved, strict=True):
                at_hand = at_hand + v * p
            second = second - at_hand * at_hand * self.hand[1]
        return first, second

    def _aliases(self) -> int:
        least = 1 / range_of(self.per_mass)[1]
        for count in range(_MOST_ALIASES):
            if self._rest(count) * least <= _NEGLIGIBLE:
                return count
        return _MOST_ALIASES

    def _rest(self, count: int) -> float:
        """Bound of what the aliases beyond ``count`` add to the leading terms."""
        least = 1 / range_of(self.per_mass)[1]
        handle, encoder = self.handle, _squares(e for e, _ in self.participations)
        damping = max(
            np.abs(range_of(self.ratio)).max(), *(range_of(a)[1] for a, _ in self.modes), 0.0
        )
        own = 0.0 if self.spring_ratio is None else float(range_of(self.spring_ratio)[1])
        spring = max(own, *(range_of(c)[1] for _, c in self.modes), 0.0)
        if self.hand is not None:
            damping += range_of(self.hand[1] * self.per_mass)[1] * handle
            spring += range_of(self.stiffness * self.per_mass)[1] * handle
        # With the mass divided out, P = g'(M + C/S + K/S²)^-1·g/S² with M not below 1, so that what
        # follows 1/S³ is at most g²·(K + ρ'²/(1-ρ))/S⁴, ρ = C/S + K/S² by norms.
        nearest = np.pi * (2 * count + 1)
        share = (damping + spring / nearest) / nearest
        if share >= 1:
            return float("inf")
        if self.lag is None:
            bend = spring + (damping + spring / nearest) ** 2 / (1 - share)
            return float(encoder * bend * _tail(5, count) / least)
        slow = range_of(self.lag)[0]
        size = min(_tail(3, count), _tail(4, count) / slow if slow > 0 else np.inf)
        return float(encoder / (1 - share) * size / least)


def _share(part: Term, whole: Term, weight: float) -> Term:
    """x/(y + weight·x) of two numbers from zero on, by its ends."""
    if not isinstance(part, AffineForm):
        return inverse(whole * (1 / part) + weight) if part else 0.0
    (low, high), (light, heavy) = ends_of(part), ends_of(whole)
    low = np.maximum(low, 0.0)
    return anywhere_between(low / (heavy + weight * low), high / (light + weight * high), part)


def _squares(parts: Iterable[float]) -> float:
    """1 + Σ x²."""
    return float(1 + sum(x * x for x in parts))


def product_of(terms: Sequence[AffineForm], without: tuple[int, ...] = ()) -> Term:
    """Product of some forms but for those at a few places; 1 if none is left."""
    chosen = [term for i, term in enumerate(terms) if i not in without]
    return prod(chosen[1:], start=chosen[0]) if chosen else 1.0


def _weighed(terms: Sequence[Term], weights: Sequence[float]) -> Term:
    total: Term = 0.0
    for term, weight in zip(terms, weights, strict=True):
        if weight:
            total = total + term * weight
    return total


def _tail(power: int, count: int) -> float:
    """Bound of Σ |θ + 2πk|^-power over |k| > count: by an integral, the summand being convex."""
    if count == 0:
        return _MOST_ALIASED[power]
    return (2 * np.pi * count) ** (1 - power) / (np.pi * (power - 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueSet:
    """Value set of D + s·N over cells; its zeros are poles on the unit circle."""

    fixed: AffineForm  # D
    varied: AffineForm  # N
    # D with its zero at θ = 0 taken out, where a spring acts on a device that is free
    start: AffineForm
    # where D is that of a free rigid mass on a damper, a lower bound of Im(N)/θ, or of Re(N)
    # where that zero is out; above zero, with a damper that is not negative, D + s·N has no zero
    # for any s > 0 however small. Shape (cells,), None elsewhere
    rising: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """The plant under a held force, N/D, or N/(s·D) where nothing holds the position; s = jθ."""

    numerator: AffineForm  # N
    denominator: AffineForm  # D
    whole: AffineForm  # D, or s·D
    aliases: AffineForm  # what sampling folds onto θ of P(S)/S
    half_sinc: AffineForm  # sinc(θ/2)


def sampled_plant(theta: AffineForm, mechanism: Mechanism) -> SampledPlant:
    """The plant over cells of θ in [0, π] and of the mechanism."""
    scaled = _Scaled.of(mechanism)
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

    Sizes are of the effects that the setting plays, where they differ from cell to cell; the plant
    is that of this angle and mechanism, where it is known.
    """
    sizes = sizes or setting.sizes
    stiffness = sizes[0]
    plant = plant or sampled_plant(theta, mechanism)
    s = theta * 1j
    # A mass on a damper, both perhaps of device and hand together, and nothing else.
    plain = not (mechanism.grounded or mechanism.modes) and mechanism.lag == 0.0
    seen, denominator, whole = plant.numerator, plant.denominator, plant.whole
    rate = rate_of(theta, plant.half_sinc, mechanism.sample_time, setting, sizes)
    if setting.stiffness:
        law = s * rate + stiffness
    elif mechanism.grounded:
        law = s * rate
    else:
        varied = seen * rate
        rising = real_lower_bound(varied) if plain else None
        # θ is out of both, and what is left of jθ turns them as it turns those with a spring.
        fixed = denominator * 1j
        return ValueSet(fixed=fixed, varied=varied * 1j, start=fixed, rising=rising)
    varied = law * seen
    if mechanism.grounded:
        return ValueSet(fixed=whole, varied=varied, start=denominator)
    rising = None
    if plain:
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
    """D + s·N at both end gains; D with its zero at θ = 0 taken out where the lower gain is 0."""
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
    """Whether zero lies outside the convex hull of affine forms: all on one side of some line."""
    excluded = np.zeros(forms[0].centre.shape, dtype=np.bool_)
    middle = np.zeros_like(forms[0].centre)
    for form in forms:
        middle = middle + form.centre / np.abs(form.centre)
    # The best line runs along an edge of one of the sets, or square to one of the centres.
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


def rate_of(
    theta: AffineForm,
    half_sinc: AffineForm,
    step: Term,
    setting: Setting,
    sizes: Sizes | None = None,
) -> Term:
    """(B·velocity + M·acceleration)/(jθ) per position; sizes as of `value_set`."""
    _, damping, mass = sizes or setting.sizes
    per_step = inverse(step)
    difference = (theta * 0.5).turn() * half_sinc
    rate: Term = 0.0
    if setting.damping:
        if setting.velocity_window_samples:
            angle = theta * (setting.velocity_window_samples / 2)
            estimate = sinc(angle) * angle.turn()
        else:
            estimate = difference * _filtered(theta, difference, step, setting, 1)
        rate = estimate * (per_step * damping)
    if setting.mass:
        estimate = (difference * difference) * _filtered(theta, difference, step, setting, 2)
        rate = rate + estimate * (theta * 1j) * (per_step * per_step * mass)
    return rate


def _filtered(
    theta: AffineForm, difference: AffineForm, step: Term, setting: Setting, power: int
) -> Term:
    """Response of a filter with the poles exp(-2π·f·T) and exp(-2π·f·T·(ζ ± j√(1-ζ²)))."""
    cutoff, order, carried = setting.estimate(power)
    if cutoff is None:
        return 1.0
    ratio = setting.filter_damping_ratio
    turn = float(np.sqrt(max(0.0, 1 - ratio * ratio)))
    unit = 1.0 if order == 1 else complex(1.0)
    single = [unit] * (order if turn == 0 or order == 1 else order - 2)
    turned = [complex(ratio, turn), complex(ratio, -turn)] * (len(single) < order)
    rates = [2 * np.pi * cutoff * each for each in (*turned, *single)]
    answers = {rate: _pole(theta, step, rate) for rate in rates}
    response = reduce(lambda one, other: one * other, (answers[rate] for rate in rates))
    if not carried:
        return response
    # 1 + ℓ·(1 - e^-jθ), where 1 - e^-jθ is jθ times the difference; a/(1 - a) of every pole.
    if isinstance(step, AffineForm):
        each = [((step * rate).exponential() + -1.0).inverse() for rate in rates]
        lag: Term = reduce(lambda one, other: one + other, each) + power / 2
    else:
        lag = float(sum((1 / np.expm1(rate * step)).real for rate in rates)) + power / 2
    return response * (difference * (theta * 1j) * lag + 1.0)


def _pole(theta: AffineForm, step: Term, rate: complex) -> AffineForm:
    """(1 - a)/(1 - a·e^-jθ) with a = exp(-rate·T)."""
    exponent = theta * 1j + step * rate
    known = not isinstance(step, AffineForm)
    top = -np.expm1(-rate * step) if known else 1.0 - (step * -rate).exponential()
    return (1.0 - (exponent * -1.0).exponential()).inverse() * top
