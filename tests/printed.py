"""The equations of the paper as printed, by number, in 60-digit arithmetic and SI units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath

#: mpmath's numbers, real or complex.
Number = Any
DIGITS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """A device and what is rendered: m (kg), b (N·s/m), T (s), K (N/m), B (N·s/m), M (kg)."""

    m: Number
    b: Number
    T: Number
    K: Number = 0
    B: Number = 0
    M: Number = 0

    @classmethod
    def dimensionless(cls, delta: Number, alpha: Number, beta: Number, gamma: Number) -> Setting:
        """m = T = 1: b is δ, K is α, B is β and M is γ."""
        exact = (mpmath.mpf(x) for x in (delta, alpha, beta, gamma))
        b, K, B, M = exact
        return cls(m=mpmath.mpf(1), b=b, T=mpmath.mpf(1), K=K, B=B, M=M)


def equation_2(s: Setting) -> Number:
    """δ."""
    return s.b * s.T / s.m


def held_plant(s: Setting, z: Number) -> Number:
    """Z{(1 - e^(-Ts))/s · 1/(ms² + bs)} as (3) has it."""
    return _held(s, z) / ((z - 1) * (z - mpmath.exp(-equation_2(s))) * s.b**2 / s.m)


def _held(s: Setting, z: Number) -> Number:
    d = equation_2(s)
    e = mpmath.exp(-d)
    return z * (e - 1 + d) + 1 - (1 + d) * e


def equation_4(s: Setting, z: Number) -> Number:
    """Spring."""
    return 1 + s.K * held_plant(s, z)


def equation_6(s: Setting) -> Number:
    """Upper limit of K."""
    e = mpmath.exp(equation_2(s))
    return s.b**2 * (e - 1) / (s.m * e - s.m - s.T * s.b)


def equation_11(s: Setting, z: Number) -> Number:
    """Damper."""
    e = mpmath.exp(-equation_2(s))
    return 1 + s.B * _held(s, z) / (s.T * z * (z - 1) * (z - e) * s.b**2 / s.m) * (z - 1)


def equation_13(s: Setting) -> Number:
    """Upper limit of B."""
    e = mpmath.exp(equation_2(s))
    return s.T * s.b**2 * e / (s.m * e - s.m - s.T * s.b)


def equation_17(s: Setting, z: Number) -> Number:
    """Mass, the brackets being those of (18)."""
    e = mpmath.exp(-equation_2(s))
    below = s.T**2 * z**2 * (z - 1) * (z - e) * s.b**2 / s.m
    return 1 + s.M * (z - 1) ** 2 * _held(s, z) / below


def equation_19(s: Setting) -> Number:
    """Positive where stable."""
    e, x = mpmath.exp(equation_2(s)), mpmath.expm1(equation_2(s))
    m, b, T, M = s.m, s.b, s.T, s.M
    inner = M * T * b * x - m * M * x**2 + T**2 * b**2 * e**2
    return (M + T * b) * inner - M * m * T * b * e * x


def equation_23(s: Setting, z: Number) -> Number:
    """Spring and damper."""
    return 1 + (s.K + s.B * (z - 1) / (s.T * z)) * held_plant(s, z)


def equation_25(s: Setting) -> Number:
    """Upper limit of K beside B."""
    e = mpmath.exp(equation_2(s))
    m, b, T, B = s.m, s.b, s.T, s.B
    top = B * m - B * m * e + T * b**2 * e + B * T * b
    below = B * m - B * m * e + T * b**2 * e + B * T * b * e
    return b * (B + b) * (e - 1) * top / ((m * e - m - T * b) * below)


def equation_26(s: Setting, z: Number) -> Number:
    """Mass and damper."""
    law = s.B * (z - 1) / (s.T * z) + s.M * (z - 1) ** 2 / (s.T**2 * z**2)
    return 1 + law * held_plant(s, z)


def equation_28(s: Setting) -> Number:
    """Upper limit of B beside M."""
    e, x = mpmath.exp(equation_2(s)), mpmath.expm1(equation_2(s))
    m, b, T, M = s.m, s.b, s.T, s.M
    inner = M * T * b * x - M * m * x**2 + T**2 * b**2 * e**2
    top = (T * b + M) * inner - M * m * T * b * e * x
    return b * top / ((m * e - m - T * b) * (M * m * (1 - e) + M * T * b * e + T**2 * b**2 * e))


def equation_29(s: Setting, z: Number) -> Number:
    """Spring and mass."""
    return 1 + (s.K + s.M * (z - 1) ** 2 / (s.T**2 * z**2)) * held_plant(s, z)


def equations_31_to_35(s: Setting) -> tuple[Number, ...]:
    """a0 to a4."""
    e, x = mpmath.exp(equation_2(s)), mpmath.expm1(equation_2(s))
    m, b, T, K, M = s.m, s.b, s.T, s.K, s.M
    return (
        x * K * T**3 * b,
        2 * x * (T**2 * b**2 - K * T**2 * m) + 2 * K * T**3 * b * e,
        2 * x * (2 * M * T * b - K * T**2 * m) + 2 * T**2 * b**2 * (3 * e - 1) + 2 * K * T**3 * b,
        2 * x * (K * T**2 * m - 4 * M * m)
        + 2 * T**2 * b**2 * (3 * e + 1)
        + 8 * M * T * b
        - 2 * K * T**3 * b * e,
        2 * x * (4 * M * m + K * T**2 * m)
        + (e + 1) * (2 * T**2 * b**2 - 4 * M * T * b - K * T**3 * b),
    )


def equation_36(s: Setting) -> Number:
    """Positive where stable, with K > 0."""
    return _last_condition(*equations_31_to_35(s))


def equation_37(s: Setting, z: Number) -> Number:
    """All three."""
    law = s.K + s.B * (z - 1) / (s.T * z) + s.M * (z - 1) ** 2 / (s.T**2 * z**2)
    return 1 + law * held_plant(s, z)


def equations_38_to_42(s: Setting) -> tuple[Number, ...]:
    """c0 to c4."""
    e, x = mpmath.exp(equation_2(s)), mpmath.expm1(equation_2(s))
    m, b, T, K, B, M = s.m, s.b, s.T, s.K, s.B, s.M
    return (
        x * K * T**3 * b,
        2 * x * (T**2 * b**2 + B * T**2 * b - K * T**2 * m) + 2 * K * T**3 * b * e,
        2 * x * (2 * M * T * b - K * T**2 * m - 2 * B * T * m)
        + 2 * (e + 1) * B * T**2 * b
        + 2 * T**2 * b**2 * (3 * e - 1)
        + 2 * K * T**3 * b,
        2 * x * (K * T**2 * m - B * T**2 * b - 4 * M * m)
        + 2 * T**2 * b**2 * (3 * e + 1)
        + 8 * M * T * b
        - 2 * K * T**3 * b * e,
        2 * x * (4 * M * m + 2 * B * T * m + K * T**2 * m)
        + (e + 1) * (2 * T**2 * b**2 - 4 * M * T * b - K * T**3 * b - 2 * B * T**2 * b),
    )


def equation_43(s: Setting) -> Number:
    """Positive where stable, with K > 0."""
    return _last_condition(*equations_38_to_42(s))


def _last_condition(c0: Number, c1: Number, c2: Number, c3: Number, c4: Number) -> Number:
    return c1 * c2 * c3 - c4 * c1**2 - c0 * c3**2


Characteristic = Callable[[Setting, Number], Number]
