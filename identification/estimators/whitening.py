"""Whitening: how white a residual is, and the causal filter that whitens it, from its spectrum.

Tremor of a hand, cogging and friction that a model misses colour the residual in bands no moving
average of two terms can follow, and it is in these bands that mass and damping are read. The
spectrum is smoothed over a constant part of the frequency, and its inverse made causal: a filter
that looked ahead would bias an estimate in closed loop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Half-width of the smoothing, as part of the frequency, ...
_RELATIVE = 0.1
#: ... and in lines of the spectrum at least: 17 of them know a level to a quarter.
_FEWEST_LINES = 8
#: Points of the grid on which the filter is computed.
_GRID = 1 << 15
#: The filter ends where what follows has less than this part of its energy.
_NEGLIGIBLE = 1e-8
#: A spectrum is taken to reach no deeper than this part of its peak.
_SILENT = 1e-12
#: Lines of a tapered spectrum are correlated with their neighbours, by 4/9 and 1/36: so many of
#: them are independent, each of two squares.
_INDEPENDENT = 1 / (1 + 2 * (4 / 9 + 1 / 36))
#: Probability that an octave of a white residual is taken for coloured.
_CHANCE = 1e-4
#: An octave may be off by this part without a loss that matters: it costs its square in variance.
_HARMLESS = 0.1
#: Squares that a fit may take out of one octave: one for each of mass, damping, friction of two
#: directions, offset, delay and the two terms of a moving average.
_FITTED = 8


def spectrum(residual: FloatArray) -> FloatArray:
    """Periodogram without its zero frequency, tapered, shape (rows // 2,)."""
    window = np.hanning(residual.size)
    return np.abs(np.fft.rfft((residual - np.mean(residual)) * window)[1:]) ** 2


def smooth_spectrum(power: FloatArray) -> FloatArray:
    """Mean over a constant part of the frequency about each line, same shape."""
    line = np.arange(1, power.size + 1)
    half = np.maximum(_FEWEST_LINES, (_RELATIVE * line).astype(np.intp))
    low, high = np.maximum(line - 1 - half, 0), np.minimum(line + half, power.size)
    total = np.concatenate(([0.0], np.cumsum(power)))
    return (total[high] - total[low]) / (high - low)


def whiteness(residual: FloatArray) -> float:
    """Largest distance of the cumulated periodogram from the straight line of white noise.

    0 is white, 1 is all power at one end of the spectrum (Bartlett's test: Bartlett, An
    Introduction to Stochastic Processes, 1966, section 9.3.2; chance alone exceeds 1.63/√(n/2)
    once in a hundred times).

    The residual has shape (rows,), any unit; the distance has none.
    """
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2
    total = float(np.sum(power))
    if total == 0:
        return 0.0
    line = np.arange(1, power.size + 1) / power.size
    return float(np.max(np.abs(np.cumsum(power) / total - line)))


def is_coloured(residual: FloatArray, *, either_side: bool = False) -> bool:
    """Whether the level of any octave differs from the mean by more than chance and than matters.

    Octaves, because what tells damping stands in the lowest few of a thousand lines.

    Args:
        residual: shape (rows,), any unit.
        either_side: an octave that is too quiet counts as well, beyond what a fit of a few
            parameters takes out of it by itself. It makes no interval wrong, but mass and damping
            could be read more sharply there. Else only an excess counts.
    """
    from scipy.special import chdtri

    power = spectrum(residual)
    mean = float(np.mean(power))
    if mean == 0:
        return False
    end = power.size
    while end > 0:
        start = end // 2 if end > 2 * _FEWEST_LINES else 0
        freedom = 2 * (end - start) * _INDEPENDENT
        chance = float(chdtri(freedom, _CHANCE)) / freedom
        level = float(np.mean(power[start:end])) / mean
        if level > max(chance, 1 + _HARMLESS):
            return True
        if either_side and freedom > 2 * _FITTED:
            quiet = float(chdtri(freedom - _FITTED, 1 - _CHANCE)) / freedom
            if level < min(quiet, 1 - _HARMLESS):
                return True
        end = start
    return False


def whitener(residual: FloatArray) -> FloatArray:
    """Taps of the causal filter that makes a residual white, leading 1.

    The cepstrum of the smoothed spectrum, folded to positive times, is that of the minimum-phase
    response of this spectrum (Kolmogorov; Oppenheim and Schafer, Discrete-Time Signal Processing,
    section 13.5).

    The residual has shape (rows,), any unit; the taps have shape (taps,) and no unit.
    """
    from scipy.fft import irfft, rfft

    power = smooth_spectrum(spectrum(residual))
    level = np.log(np.maximum(power, _SILENT * max(float(power.max()), np.finfo(float).tiny)))
    place = np.linspace(0, level.size, _GRID // 2 + 1)
    grid = np.interp(place, np.arange(1, level.size + 1), level)
    cepstrum = irfft(grid, _GRID)
    folded = np.zeros(_GRID)
    folded[1 : _GRID // 2] = cepstrum[1 : _GRID // 2]
    # exp of minus half of twice the positive part: the inverse of the root of the spectrum.
    taps = irfft(np.exp(-rfft(folded)), _GRID)[: min(_GRID // 2, residual.size)]
    energy = np.cumsum(taps[::-1] ** 2)[::-1]
    return taps[: int(np.flatnonzero(energy >= _NEGLIGIBLE * energy[0])[-1]) + 1]
