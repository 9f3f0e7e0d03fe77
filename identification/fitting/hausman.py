"""Hausman's test of two estimates of one log, and the joint region of mass and damping.

Hausman's test tells whether an efficient and a robust estimate of one log say the same. Where the
model is right both are, and the efficient one leaves no error that the robust one could share: the
variance of their difference is the difference of their variances (Hausman, Econometrica 46, 1978,
p. 1251). So a robust answer that is hardly known contradicts nothing, and one that is as sharp as
the efficient one contradicts at once.
"""

from __future__ import annotations

import numpy as np

from identification.estimators.estimate import Estimate

#: The square of the difference by its variance, of two parameters, that chance exceeds as often as
#: a normal variable three of its deviations: -2·log(0.0027).
CONTRADICTED = 11.83
#: Each variance is known to some 18 % (sixty blocks left out in turn), so their difference is not
#: told from zero below this part of the larger one.
_RESOLVED = 0.25
_FAR = 1e6  # deviations beyond which it does not matter how many they are


def region(estimate: Estimate) -> float:
    """Area of the joint region of mass and damping, up to a factor all estimates share."""
    joint = estimate.covariance[:2, :2]
    return float(np.sqrt(max(np.linalg.det(joint), 0.0)))


def statistic(efficient: Estimate, robust: Estimate) -> float:
    """Square of the difference of mass and damping by its variance; χ² of 2 if the model is right.

    In directions in which the efficient one is not the sharper of the two, nothing is known of
    what they share, and the largest variance their difference can have is taken.
    """
    size = np.sqrt(np.maximum(np.diag(robust.covariance)[:2], np.finfo(float).tiny))
    scale = np.outer(size, size)
    apart = (efficient.values[:2] - robust.values[:2]) / size
    values, vectors = np.linalg.eigh(robust.covariance[:2, :2] / scale)
    # Directions in which the robust variance is 1; one that rounding left without any keeps a bit.
    axes = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    shares, turned = np.linalg.eigh(axes.T @ (efficient.covariance[:2, :2] / scale) @ axes)
    shares = np.maximum(shares, 0.0)
    moved = (axes @ turned).T @ apart
    deviation = np.where(
        shares < 1, np.sqrt(np.maximum(1 - shares, _RESOLVED)), 1 + np.sqrt(shares)
    )
    return float(np.sum(np.minimum(np.abs(moved) / deviation, _FAR) ** 2))


def contradiction(efficient: Estimate, robust: Estimate) -> str:
    """What an efficient estimate says that a robust one excludes; "" if it excludes nothing."""
    if statistic(efficient, robust) <= CONTRADICTED:
        return ""
    return ", ".join(
        f"{name} {efficient.value(name):.4g} instead of {robust.value(name):.4g}"
        for name in ("mass", "damping")
    )
