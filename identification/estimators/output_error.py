"""Output error by variable projection: the simulated position against the measured one.

q = q0 + v0·(1 - e^(-pt))/p + (G_p[F] - f0·G_p[1] - Fc·G_p[sign q̇])/m, G_p = 1/(s(s+p)), p = b/m.
Only p is nonlinear; everything else is a linear solve inside (Golub and Pereyra, SIAM Journal on
Numerical Analysis 10, 1973, p. 413). Best where position noise is all there is; a force that the
log does not know integrates twice and ruins it, which its residual then shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.estimators import least_squares
from identification.estimators.held import Held, unknown_intervals
from identification.estimators.model import Estimate, Model
from identification.estimators.whiteness import whiteness
from identification.intervals import spread
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]
AnyArray = NDArray[np.float64] | NDArray[np.complex128]

#: Below this |δ| the φ-functions are summed as series, above it taken from expm1.
_SERIES_BELOW = 0.5
#: Terms of the series; 0.5^18/18! is far below the last bit.
_TERMS = 18
#: Imaginary step for the derivative by p·T: exact, since nothing is subtracted.
_COMPLEX_STEP = 1e-30
#: Steps of Gauss-Newton; it converges in four or five from least squares.
_MOST_STEPS = 30
#: Times a step that makes the fit worse is halved before the search ends.
_MOST_HALVINGS = 20
#: The search ends when p moves by less than this part of its own standard deviation.
_CONVERGED = 1e-4
#: A rate |p| beyond this many per sample means that the motion dies within one sample: b/m is then
#: not to be told from a position log.
_FASTEST = 2.0


def phi(delta: complex, order: int) -> complex:
    """φ_1 = (1 - e^(-δ))/δ or φ_2 = (1 - φ_1)/δ, finite at δ = 0; complex for derivatives."""
    if abs(delta) < _SERIES_BELOW:
        term, total = 1.0 + 0j, 0j
        for k in range(1, _TERMS + order):
            term /= k
            if k >= order:
                total += term
                term *= -delta
        return total
    first = complex(-np.expm1(-delta) / delta)
    return first if order == 1 else (1 - first) / delta


def response(column: Held, rate: complex, step: float) -> AnyArray:
    """G_p of a held column at the samples, shape (n,), zero and at rest at the first.

    Args:
        column: n - 1 intervals.
        rate: p = b/m, 1/s; complex for derivatives.
        step: T, s.
    """
    late = step * (1 - np.asarray(column.fraction))
    early = step - late
    gain = _push(rate, late)
    through = _decay(rate, late)
    velocity = column.late * gain[0] + column.early * _push(rate, early)[0] * through
    position = column.late * gain[1] + column.early * (
        _push(rate, early)[1] + _push(rate, early)[0] * gain[0]
    )
    return _cascade(velocity, position, rate, step, 0.0)


def coasting(count: int, rate: complex, step: float) -> AnyArray:
    """(1 - e^(-pt))/p at ``count`` samples: position after a unit velocity at the first."""
    nothing = np.zeros(count - 1)
    return _cascade(nothing, nothing, rate, step, 1.0)


def _push(rate: complex, span: FloatArray) -> tuple[AnyArray, AnyArray]:
    """Velocity and position after a unit force per mass for ``span`` s, from rest."""
    if span.ndim == 0:
        delta = rate * float(span)
        return np.asarray(span * phi(delta, 1)), np.asarray(span**2 * phi(delta, 2))
    values, where = np.unique(span, return_inverse=True)
    if values.size > 1:
        # Inside an interval p·T is small or the log useless: six terms reach the last bit.
        delta = rate * span
        return (
            span * _short_series(delta, (1, 2, 6, 24, 120, 720, 5040, 40320)),
            span**2 * _short_series(delta, (2, 6, 24, 120, 720, 5040, 40320, 362880)),
        )
    del where
    one = _push(rate, values[0])
    return np.broadcast_to(one[0], span.shape), np.broadcast_to(one[1], span.shape)
