"""Covariance that survives coloured residuals, 95 % intervals, and the envelope over several logs.

Residuals of a friction fit are never white: on a real axis the ordinary formula s²(XᵀX)⁻¹ is
several times too small. Here the log is cut into consecutive blocks and each left out in turn
(the jackknife over blocks: Künsch, Annals of Statistics 17, 1989, p. 1217; for regressions it is
the CR3 covariance of MacKinnon and White, Journal of Econometrics 29, 1985, p. 305). Whatever the
correlation inside a block, and however unevenly the blocks excite the device, it is in there.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.estimators.linear import unit_columns
from identification.estimators.model import Estimate

FloatArray = NDArray[np.float64]

#: Half-width of the 95 % interval of a normal variable, in standard deviations.
NORMAL_95 = 1.959963984540054
#: Upper end of a two-sided 95 % interval.
CONFIDENCE_ABOVE = 0.975
#: At most this many blocks: with 60, the t quantile is within 2 % of the normal one, and each
#: block of a usual log still outlasts the filter and the correlation of its residual many times.
MOST_BLOCKS = 60
#: At least this many blocks: fewer leave no degrees of freedom for a simultaneous region.
FEWEST_BLOCKS = 8
#: No log knows its forces better than this part of them: a quartz clock is off by 3e-5, and the
#: zero-order hold, the count and the amplifier are no straighter. Without it the interval of a
#: noise-free log would shrink to the rounding of the solver.
UNKNOWN_FORCE = 3e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Covariance of a linear (or linearised) fit and what it rests on.

    Attributes:
        covariance: shape (p, p), in the units of the parameters.
        degrees_of_freedom: blocks less one.
        condition: condition number of the unit-norm columns.
        inflation: shape (p,), variance inflation factors of the parameters.
    """

    covariance: FloatArray
    degrees_of_freedom: float
    condition: float
    inflation: FloatArray


def correlation_length(scores: FloatArray) -> float:
    """Samples over which a series is correlated: the sum of its autocorrelation to the first zero.

    Args:
        scores: shape (n,), mean near zero.
    """
    count = scores.size
    spectrum = np.fft.rfft(scores, 1 << int(np.ceil(np.log2(2 * count))))
    covariance = np.fft.irfft(np.abs(spectrum) ** 2)[: count // 2]
    if covariance[0] <= 0:
        return 1.0
    correlation = covariance / covariance[0]
    negative = np.flatnonzero(correlation <= 0)
    end = int(negative[0]) if negative.size else correlation.size
    return float(1 + 2 * np.sum(correlation[1:end]))


def block_count(columns: FloatArray, residual: FloatArray) -> int:
    """Blocks to cut a log into: each at least as long as the scores are correlated."""
    longest = max(correlation_length(column * residual) for column in columns.T)
    return int(np.clip(residual.size // max(longest, 1.0), FEWEST_BLOCKS, MOST_BLOCKS))


def spread(columns: FloatArray, residual: FloatArray, keep: int, *, signal: FloatArray) -> Spread:
    """Block-jackknife covariance of the first ``keep`` parameters of a least-squares fit.

    Args:
        columns: shape (n, p): regressors, or the Jacobian of a nonlinear fit.
        residual: shape (n,).
        keep: how many leading parameters are wanted; the others are nuisance.
        signal: shape (n,): what the logged force contributes; UNKNOWN_FORCE of it is in doubt.
    """
    unit, norms = unit_columns(columns)
    singular = np.linalg.svd(unit.T @ unit, compute_uv=False, hermitian=True)
    condition = float(np.sqrt(singular[0] / max(singular[-1], np.finfo(float).tiny)))
    edges = np.linspace(0, residual.size, block_count(unit, residual) + 1).astype(int)
    blocks = list(pairwise(edges.tolist()))
    normal = np.stack([unit[i:j].T @ unit[i:j] for i, j in blocks])
    right = np.stack([unit[i:j].T @ residual[i:j] for i, j in blocks])
    whole = normal.sum(axis=0)
    # The fit without block i differs from the whole fit by -(A - A_i)⁺ c_i.
    shifts = np.einsum("ijk,ik->ij", _inverse(whole - normal), right)
    count = len(blocks)
    inverse = _inverse(whole)
    inflation = np.diag(inverse)
    # Nuisance columns take up their part of the signal, so only the rest can mislead.
    nuisance = unit[:, keep:]
    if nuisance.shape[1]:
        signal = signal - nuisance @ np.linalg.lstsq(nuisance, signal, rcond=None)[0]
    floor = UNKNOWN_FORCE**2 * float(signal @ signal) * inverse
    covariance = ((count - 1) / count * (shifts.T @ shifts) + floor) / np.outer(norms, norms)
    return Spread(
        covariance=covariance[:keep, :keep],
        degrees_of_freedom=float(count - 1),
        condition=condition,
        inflation=inflation[:keep],
    )


def _inverse(normal: FloatArray) -> FloatArray:
    """Pseudo-inverse of symmetric matrices, shape (..., p, p); finite for columns alike, too."""
    return np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=np.float64)


def half_width(estimate: Estimate, name: str) -> float:
    """Half of the 95 % interval of one parameter: Student's t with the covariance's freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(estimate.degrees_of_freedom, CONFIDENCE_ABOVE)) * estimate.deviation(name)
