"""The mechanism in continuous time over cells, and what sampling folds of it onto one frequency.

The plant P(S), S in units of one sample, is a quotient of polynomials in S and in every parameter:
rigid mass with a spring of its own, modes, a hand that holds the handle, and the lag of the current
loop. Its aliases are looked at one by one as far as they matter; those beyond are sums of inverse
powers of S, known in closed form, and a bounded rest. One file: one transfer function, and its
aliases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import prod

import numpy as np

from tune.certificate.affine import AffineForm, FloatArray, Term, add_axis, inverse, range_of
from tune.certificate.aliases import MOST, folded_sums

#: Aliases are looked at one by one until the rest is below this part of 1/mass, or the most.
_NEGLIGIBLE = 1e-6
_MOST_ALIASES = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """What may be anywhere in a cell; numbers where it is known exactly.

    Attributes:
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay: x, in samples.
        lag: time constant of the current loop, s; exactly 0.0 for none.
        position_stiffness: of the device's own force by position, N/m; exactly 0.0 for none.
        hand: mass, damping and stiffness of the grip; None is no hand.
        modes: frequency in Hz and damping ratio of each.
        participations: (e, h) of each mode.
        grounded: a spring of device or hand holds the position.
    """

    mass: Term
    damping: Term
    sample_time: Term
    delay: AffineForm
    lag: Term
    position_stiffness: Term
    hand: tuple[Term, Term, Term] | None
    modes: tuple[tuple[Term, Term], ...]
    participations: tuple[tuple[float, float], ...]
    grounded: bool

    @property
    def free_and_rigid(self) -> bool:
        """A mass on a damper, both perhaps of device and hand together, and nothing else."""
        return not self.grounded and not self.modes and self.lag == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scaled:
    """The mechanism in units of one sample, with what its polynomials share.

    Attributes:
        mass: m/T².
        per_mass: its inverse.
        damping: b/T.
        ratio: bT/m.
        spring: k of the device itself, None for none.
        spring_ratio: kT²/m, likewise.
        lag: in samples, None for none.
        hand: (m_h/T², b_h/T, k_h) or None.
        modes: (2ζω, ω²) in samples of each.
        participations: (e, h) of each.
        grounded: as in the mechanism.
    """

    mass: Term
    per_mass: Term
    damping: Term
    ratio: Term
    spring: Term | None
    spring_ratio: Term | None
    lag: Term | None
    hand: tuple[Term, Term, Term] | None
    modes: tuple[tuple[Term, Term], ...]
    participations: tuple[tuple[float, float], ...]
    grounded: bool

    @classmethod
    def of(cls, given: Mechanism) -> Scaled:
        """What the polynomials share, computed once."""
        step = given.sample_time
        per_step = inverse(step)
        per_square = per_step * per_step
        per_mass = inverse(given.mass)
        omegas = [f * step * (2 * np.pi) for f, _ in given.modes]
        hand = given.hand
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
            modes=tuple(
                (w * zeta * 2.0, w * w) for w, (_, zeta) in zip(omegas, given.modes, strict=True)
            ),
            participations=given.participations,
            grounded=given.grounded,
        )

    def stacked(self) -> Scaled:
        """With room for an axis of aliases."""
        return Scaled(
            mass=add_axis(self.mass),
            per_mass=add_axis(self.per_mass),
            damping=add_axis(self.damping),
            ratio=add_axis(self.ratio),
            spring=None if self.spring is None else add_axis(self.spring),
            spring_ratio=None if self.spring_ratio is None else add_axis(self.spring_ratio),
            lag=None if self.lag is None else add_axis(self.lag),
            hand=self.hand
            and (add_axis(self.hand[0]), add_axis(self.hand[1]), add_axis(self.hand[2])),
            modes=tuple((add_axis(a), add_axis(b)) for a, b in self.modes),
            participations=self.participations,
            grounded=self.grounded,
        )

    def plant(self, s: AffineForm) -> tuple[Term, AffineForm]:
        """(numerator, denominator) of P at S; a denominator that vanishes at 0 is divided by S."""
        damped = s * self.mass + self.damping  # Y/S
        resonances = [s * (s + a) + c for a, c in self.modes]
        every = product_of(resonances)
        others = [product_of(resonances, without=(i,)) for i in range(len(resonances))]
        inertial: Term = 0.0
        if self.modes:
            inertial = s * (s + self.ratio)
            inertial = inertial if self.spring_ratio is None else inertial + self.spring_ratio
        numerator = every + inertial * _weighed(others, [e * e for e, _ in self.participations])
        rigid = damped * s if self.grounded else damped
        denominator = (rigid if self.spring is None else rigid + self.spring) * every
        if self.hand is not None:
            mass, damping, stiffness = self.hand
            followed = s * mass + damping
            spring = s * followed + stiffness if self.grounded else followed
            grip = spring if self.grounded else s * followed
            grasped = every + inertial * _weighed(others, [h * h for _, h in self.participations])
            denominator = denominator + spring * grasped
            if self.modes:
                numerator = numerator + grip * self._apart(resonances, others, inertial)
        if self.lag is not None:
            denominator = denominator * (s * self.lag + 1.0)
        return numerator, denominator

    def _apart(
        self, resonances: Sequence[AffineForm], others: Sequence[Term], inertial: Term
    ) -> Term:
        """How the encoder still moves where the hand holds the handle at rest."""
        moves = _weighed(others, [(e - h) ** 2 for e, h in self.participations])
        for i, j in combinations(range(len(resonances)), 2):
            (ei, hi), (ej, hj) = self.participations[i], self.participations[j]
            both = product_of(resonances, without=(i, j))
            moves = moves + inertial * both * (ei * hj - ej * hi) ** 2
        return moves * self.per_mass

    def folded(self, theta: AffineForm, delay: AffineForm) -> AffineForm:
        """Σ P(S)·e^(-2πjkx)/S over all k but 0."""
        count = self._aliases()
        total: Term = 0.0
        leading = self._leading() if self.lag is None else None
        if leading is not None:
            third, fourth = folded_sums(theta, delay)
            total = third * leading[0] + fourth * leading[1]
        if count:
            k: FloatArray = np.concatenate([np.arange(1.0, count + 1), -np.arange(1.0, count + 1)])
            k = 2 * np.pi * k[:, None]
            s = (theta.stacked() + k) * 1j
            numerator, denominator = self.stacked().plant(s)
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
        if self.hand is not None and self.hand[0] != 0.0:
            part = self.hand[0] * self.per_mass
            both = _scalar(encoder, handle)
            shared = part * both * inverse(part * _scalar(handle, handle) + 1.0)
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
        least = range_of(self.mass)[0]
        for count in range(_MOST_ALIASES):
            if self._rest(count) * least <= _NEGLIGIBLE:
                return count
        return _MOST_ALIASES

    def _rest(self, count: int) -> float:
        """Bound of what the aliases beyond ``count`` add to the leading terms.

        With the mass divided out, P = g'(M + C/S + K/S²)^-1·g/S² with M not below 1, so that what
        follows 1/S³ is at most g²·(K + ρ'²/(1-ρ))/S⁴, ρ = C/S + K/S² by norms.
        """
        least = range_of(self.mass)[0]
        handle = 1 + sum(h * h for _, h in self.participations)
        encoder = 1 + sum(e * e for e, _ in self.participations)
        damping = max(
            np.abs(range_of(self.ratio)).max(), *(range_of(a)[1] for a, _ in self.modes), 0.0
        )
        own = 0.0 if self.spring_ratio is None else float(range_of(self.spring_ratio)[1])
        spring = max(own, *(range_of(c)[1] for _, c in self.modes), 0.0)
        if self.hand is not None:
            damping += range_of(self.hand[1] * self.per_mass)[1] * handle
            spring += range_of(self.hand[2] * self.per_mass)[1] * handle
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


def _scalar(a: Sequence[float], b: Sequence[float]) -> float:
    """Scalar product."""
    return float(sum(x * y for x, y in zip(a, b, strict=True)))


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
        return MOST[power]
    return (2 * np.pi * count) ** (1 - power) / (np.pi * (power - 1))
