"""Spectrum and correlation of what a model leaves of a log: the classical tests of a residual."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import NORMAL_95, Estimate
from identification.pictures.explained import Explained

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

#: Lags of the correlation that are drawn, samples.
_LAGS = 40
#: Methods whose residual is a row a sample, in the order of the log.
_ROW_A_SAMPLE = {"output-error", "innovations", "least-squares"}
#: Of the largest density, what is drawn at least.
_DECADES = 1e-7
#: Segments of Welch's spectrum, at least.
_SEGMENTS = 8


def draw_spectrum(axes: Axes, known: Explained, force: str) -> None:
    """Spectral density of the applied force and of what is left of it, by Welch's method."""
    from scipy.signal import welch

    from identification.figure import legend_above

    step = float(np.median(np.diff(known.time)))
    length = max(16, known.time.size // _SEGMENTS)
    for column, color, label in (
        (known.applied, "0.6", "applied"),
        (known.left, "tab:orange", "unexplained"),
    ):
        hertz, power = welch(column, 1 / step, nperseg=min(length, column.size))
        axes.loglog(hertz[1:], np.sqrt(power[1:]), color=color, lw=1, label=label)
    top = float(axes.get_ylim()[1])
    axes.set_ylim(_DECADES * top, top)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel(f"force, {force}/√Hz")
    legend_above(axes)


def draw_correlation(axes: Axes, known: Explained, estimate: Estimate | None) -> None:
    """Autocorrelation of the residual with the 95 % band of white noise.

    Args:
        axes: to draw on.
        known: what a model leaves, where the estimate's own residual is no row a sample.
        estimate: the one believed; None where only the device is known.
    """
    from identification.figure import legend_above

    residual, words = known.left, "unexplained force, filtered"
    if estimate is not None and estimate.method in _ROW_A_SAMPLE:
        residual, words = estimate.residual, f"residual of {estimate.method}"
    if residual.size <= _LAGS or not np.any(residual):
        axes.set_axis_off()
        return
    found = autocorrelation(residual, _LAGS)
    band = NORMAL_95 / np.sqrt(residual.size)
    axes.axhspan(-band, band, color="0.85", lw=0, label="white noise, 95 %")
    axes.vlines(np.arange(1, _LAGS + 1), 0, found[1:], color="tab:blue", lw=2)
    axes.axhline(0, color="k", lw=0.6)
    most = min(1.0, max(4 * band, 1.2 * float(np.max(np.abs(found[1:])))))
    axes.set_ylim(-most, most)
    axes.set_xlabel(f"lag, samples ({words})")
    axes.set_ylabel("correlation")
    legend_above(axes)


def autocorrelation(column: FloatArray, lags: int) -> FloatArray:
    """Autocorrelation of a column about its mean at lags 0 to ``lags``, shape (lags + 1,)."""
    centred = column - np.mean(column)
    square = float(centred @ centred)
    products = [float(centred[lag:] @ centred[: centred.size - lag]) for lag in range(lags + 1)]
    return np.array(products) / square
