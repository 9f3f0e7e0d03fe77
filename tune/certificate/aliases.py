"""Aliasing: sums of inverse powers over all frequencies that sampling folds onto one.

t_n(θ, x) = Σ e^(-2πjkx) / (j(θ + 2πk))^n over all whole k but 0, for θ in [0, π]. It has period one
in x, the delay in samples, and is as smooth in it as n allows.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import comb, factorial

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import AffineForm, ComplexArray, FloatArray

#: Terms of the power series in θ; without the two nearest aliases they fall like 4^-m.
_TERMS = 28
#: Absolute error of a value of t_n, n from 2 on: rounding of the Bernoulli polynomials and the
#: rest of the series, 4^-28, both times less than 2^6.
_ERROR = 1e-13


def most(n: int) -> float:
    """Bound of |t_n|: Σ |θ + 2πk|^-n at θ = π; for n = 1, where that diverges, its bound."""
    if n == 1:
        # t_1 = (e^(jθ(x-1/2))·h - 1)/(jθ), 0 < x < 1, h = θ/2/sin(θ/2): at most (h - 1)/θ + 1/2.
        return (np.pi / 2 - 1) / np.pi + 0.5
    odd = sum(float(j) ** -n for j in range(3, 2001, 2))
    # The rest of the odd numbers by an integral.
    rest = 1 / (2 * (n - 1)) * 1999.0 ** (1 - n)
    return (1 + 2 * (odd + rest)) / np.pi**n


MOST = {n: most(n) for n in range(1, 8)}


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


def sums(theta: FloatArray, x: FloatArray, first: int, last: int) -> list[ComplexArray]:
    """t_first .. t_last at points; first >= 2.

    θ (rad) and x (samples) have shape (points,), and so has each sum; none has a unit.
    """
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


def folded_sums(theta: AffineForm, x: AffineForm) -> tuple[AffineForm, AffineForm]:
    """(t_3, t_4) as forms in θ and x, both real forms."""
    at, late = theta.centre.real, x.centre.real
    values = sums(at, late, 2, 5)
    wide_theta, wide_x = (
        np.sum(np.abs(form.slopes.real), axis=0) + form.real for form in (theta, x)
    )
    top = np.minimum(np.pi, at + wide_theta)
    forms: list[AffineForm] = []
    for n in (3, 4):
        below, here, above = values[n - 3], values[n - 2], values[n - 1]
        by_x = -below + 1j * at * here
        by_theta = -1j * n * above
        bend_x = MOST[n - 2] + 2 * top * MOST[n - 1] + top**2 * MOST[n]
        bend_both = n * MOST[n] + n * top * MOST[n + 1]
        bend_theta = n * (n + 1) * MOST[n + 2]
        error = (
            bend_x * wide_x**2 / 2
            + bend_both * wide_x * wide_theta
            + bend_theta * wide_theta**2 / 2
            + np.abs(by_x) * x.real
            + np.abs(by_theta) * theta.real
            + _ERROR * (1 + wide_x + wide_theta)
        )
        lost = error > MOST[n]
        slopes = by_x * x.slopes.real + by_theta * theta.slopes.real
        error = np.where(lost, MOST[n], error)
        forms.append(
            AffineForm(np.where(lost, 0, here), np.where(lost, 0, slopes), error, error.copy())
        )
    return forms[0], forms[1]
