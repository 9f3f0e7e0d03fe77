"""Filters: convolution, difference equations, a low-pass, a resonance, and whitening.

The first two are what ``scipy.signal`` offers as well, whose package takes longer to load than a
log to identify. Whitening is for what colours a residual in bands that no moving average of two
terms can follow; it is causal, for a filter that looked ahead would bias an estimate in closed
loop.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from identification.trajectory import ComplexArray, FloatArray

Spectra = dict[int, ComplexArray]
#: Blocks hold this many rows, or this many kernels, whichever is longer.
_SHORTEST_BLOCK = 1 << 14
_KERNELS = 8
#: The kernel ends after this many standard deviations, where it has fallen to 4e-6 of its peak:
#: the step there lets through less noise than the second difference amplifies.
REACH = 5.0
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
#: ... or a white force for structure, which costs time alone.
_TIME_ALONE = 0.01
#: Part of the lines up to a cut-off whose upper half tells a push. Rows are a multiple of the
#: second, for a quick transform, and so many lines at least tell anything.
_SLOW, _EVEN = 0.25, 64
#: An octave may be off by this part without a loss that matters: it costs its square in variance.
_HARMLESS = 0.1
#: Squares that a fit may take out of one octave: one for each of mass, damping, friction of two
#: directions, offset, delay and the two terms of a moving average.
_FITTED = 8


def overlap_save(
    columns: FloatArray, kernel: FloatArray, spectra: Spectra | None = None
) -> FloatArray:
    """Rows with a full set of neighbours, shape (..., n) to (..., n - k + 1).

    Each block of rows is convolved in a circle and what wrapped around is left out (overlap-save:
    Oppenheim and Schafer, Discrete-Time Signal Processing, section 8.7.3). The first weight of the
    kernel is that of the newest row; its spectra are kept by length of block.
    """
    rows, lost = columns.shape[-1], kernel.size - 1
    block = min(_quick(rows), _quick(max(_SHORTEST_BLOCK, _KERNELS * kernel.size)))
    length = block - lost
    count = -(-(rows - lost) // length)
    spectra = {} if spectra is None else spectra
    if block not in spectra:
        spectra[block] = np.fft.rfft(kernel, block)
    if count == 1:
        return np.fft.irfft(np.fft.rfft(columns, block) * spectra[block], block)[..., lost:rows]
    padded = np.zeros((*columns.shape[:-1], lost + count * length))
    padded[..., :rows] = columns
    blocks = sliding_window_view(padded, block, axis=-1)[..., ::length, :]
    convolved = np.fft.irfft(np.fft.rfft(blocks) * spectra[block], block)[..., lost:]
    return convolved.reshape(*columns.shape[:-1], count * length)[..., : rows - lost]


def causal(columns: FloatArray, kernel: FloatArray) -> FloatArray:
    """Rows weighted with those before them, zero before the first, shape (..., n) to (..., n)."""
    before = np.zeros((*columns.shape[:-1], kernel.size - 1))
    return overlap_save(np.concatenate((before, columns), axis=-1), kernel)


def recursive(rows: FloatArray, *past: FloatArray | float) -> FloatArray:
    """y with y[k] + past[0]·y[k - 1] + past[1]·y[k - 2] + … = rows[k], nothing before the first.

    A triangular system with a few diagonals, solved as such: it knows no growth that would have to
    be divided out. Each weight is a number, or its value at each row.
    """
    from scipy.linalg.lapack import dtbtrs

    count = rows.shape[-1]
    band = np.ones((len(past) + 1, count), order="F")
    for back, weight in enumerate(past, start=1):
        # The diagonal below the main one begins with the row that is the first to look back so far.
        band[back, : count - back] = weight[back:] if isinstance(weight, np.ndarray) else weight
    return dtbtrs(band, np.atleast_2d(rows).T, uplo="L", diag="U")[0].T.reshape(rows.shape)


@dataclass(frozen=True, slots=True)
class Spring:
    """A mass on a spring and damper (bilinear transform, exact at the frequency)."""

    first: FloatArray  # weights of the last three values of what drives it
    last: FloatArray  # of its own

    @classmethod
    def of(cls, logarithms: FloatArray, step: float) -> Spring:
        """By the logarithms of frequency, Hz, and damping ratio."""
        omega, rate = 2 / step * np.tan(np.pi * np.exp(logarithms[0]) * step), 2 / step
        damped, square = 2 * np.exp(logarithms[1]) * omega * rate, omega**2
        first = np.array([square + damped, 2 * square, square - damped])
        last = first + rate**2 * np.array([1.0, -2.0, 1.0])
        return cls(first / last[0], last / last[0])

    def driven(self, column: FloatArray) -> FloatArray:
        """What it makes of the motion of its spring's other end, from rest."""
        before = np.pad(column - column[0], (2, 0))
        rows = self.first @ np.stack((before[2:], before[1:-1], before[:-2]))
        return recursive(rows, self.last[1], self.last[2]) + column[0]

    def ringing(self, count: int) -> FloatArray:
        """Free motions from the first and from the second sample on, shape (2, n)."""
        return recursive(np.eye(2, count), self.last[1], self.last[2])


def _quick(least: int) -> int:
    """The least length of at least this that is 4, 5 or 6 times a power of two."""
    power = 1 << max(int(least - 1).bit_length() - 3, 0)
    return next(part * power for part in (4, 5, 6, 8) if part * power >= least)


def gaussian(width: float, step: float) -> FloatArray:
    """Symmetric Gaussian weights that sum to 1, odd in number, for a standard deviation in s."""
    half = int(np.ceil(REACH * width / step))
    if half == 0:
        return np.ones(1)
    place = np.arange(-half, half + 1) * step / width
    weights = np.exp(-(place**2) / 2)
    return weights / weights.sum()


def width_of(cut_off: float) -> float:
    """Standard deviation in s of the Gaussian that passes 1/√2 of a sine at ``cut_off`` Hz."""
    return float(np.sqrt(np.log(2)) / (2 * np.pi * cut_off))


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """Zero-phase Gaussian filter without start or end effects.

    Its output is a weighted mean of input rows, so an equation that holds for every row holds for
    the filtered rows exactly; rows without a full set of neighbours are not returned.
    """

    kernel: FloatArray  # weights, shape (2·half + 1,)
    spectra: Spectra = field(default_factory=Spectra)  # of the kernel, by length of block

    @classmethod
    def at(cls, cut_off: float, step: float) -> LowPass:
        """The filter for a cut-off in Hz, where a sine keeps 1/√2, and a sample time in s."""
        return cls(kernel=gaussian(width_of(cut_off), step))

    @property
    def half(self) -> int:
        """Rows lost at each end."""
        return self.kernel.size // 2

    def __call__(self, columns: FloatArray) -> FloatArray:
        """The filtered columns, shape (..., n) to (..., n - 2·half)."""
        return overlap_save(columns, self.kernel, self.spectra)

    def continued(self, column: FloatArray) -> FloatArray:
        """The filtered column, shape (n,); its ends go on by odd reflection, which keeps slopes."""
        half = self.half
        if half == 0:
            return column
        return self(np.pad(column, half, mode="reflect", reflect_type="odd"))

    def noise_gains(self, step: float) -> tuple[float, float]:
        """Variance of filtered second and central differences per variance of the readings."""
        second = np.convolve(self.kernel, [1.0, -2.0, 1.0]) / step**2
        central = np.convolve(self.kernel, [0.5, 0.0, -0.5]) / step
        return float(second @ second), float(central @ central)


def spectrum(residual: FloatArray) -> FloatArray:
    """Periodogram without its zero frequency, tapered, shape (rows // 2,)."""
    window = np.hanning(residual.size)
    return np.abs(np.fft.rfft((residual - np.mean(residual)) * window)[1:]) ** 2


def _smooth_spectrum(power: FloatArray) -> FloatArray:
    """Mean over a constant part of the frequency about each line, same shape."""
    line = np.arange(1, power.size + 1)
    half = np.maximum(_FEWEST_LINES, (_RELATIVE * line).astype(np.intp))
    low, high = np.maximum(line - 1 - half, 0), np.minimum(line + half, power.size)
    total = np.concatenate(([0.0], np.cumsum(power)))
    return (total[high] - total[low]) / (high - low)


def whiteness(residual: FloatArray) -> float:
    """Largest distance of the cumulated periodogram from the straight line of white noise.

    0 is white, 1 is all power at one end of the spectrum (Bartlett's test: Bartlett, An
    Introduction to Stochastic Processes, 1966, section 9.3.2; chance alone exceeds 1.63/√(n/2) once
    in a hundred times).
    """
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2
    total = float(np.sum(power))
    if total == 0:
        return 0.0
    line = np.arange(1, power.size + 1) / power.size
    return float(np.max(np.abs(np.cumsum(power) / total - line)))


def is_coloured(residual: FloatArray, *, either_side: bool = False) -> bool:
    """Whether the level of any octave differs from the mean by more than chance and than matters.

    Octaves, because what tells damping stands in the lowest few of a thousand lines. With either
    side, an octave that is too quiet counts as well, beyond what a fit of a few parameters takes
    out of it by itself: it makes no interval wrong, but mass and damping could be read more sharply
    there.
    """
    return is_uneven(spectrum(residual), _CHANCE, either_side=either_side)


def is_uneven(power: FloatArray, probability: float, *, either_side: bool = False) -> bool:
    """Whether any octave of a spectrum is off as no octave of a white one in 1/probability."""
    from scipy.special import chdtri

    mean = float(np.mean(power))
    if mean == 0:
        return False
    end = power.size
    while end > 0:
        start = end // 2 if end > 2 * _FEWEST_LINES else 0
        freedom = 2 * (end - start) * _INDEPENDENT
        chance = float(chdtri(freedom, probability)) / freedom
        level = float(np.mean(power[start:end])) / mean
        if level > max(chance, 1 + _HARMLESS):
            return True
        if either_side and freedom > 2 * _FITTED:
            quiet = float(chdtri(freedom - _FITTED, 1 - probability)) / freedom
            if level < min(quiet, 1 - _HARMLESS):
                return True
        end = start
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Rest:
    """What a filtered rest of the force may hold."""

    structured: bool = True  # more than noise and a white force explain
    pushed: bool = False  # a force that moves the device by more than all that could feign it

    @classmethod
    def of(cls, rest: FloatArray, cut_off: float, noise: float, feigned: float) -> Rest:
        """From its spectrum up to the cut-off, part of the sampling rate, as if never filtered.

        Noise is that of a reading as a force of the mass, N: it grows with the fourth power of
        frequency. What is feigned is the power of a white force, N².
        """
        rows = rest.size // _EVEN * _EVEN
        lines = int(cut_off * rows)
        if lines < _EVEN:
            return cls()
        line = np.arange(1, lines + 1)
        # Of the power a taper leaves 3/8.
        unfiltered = 8 / 3 / rows * np.exp(np.log(2) * (line / lines) ** 2)
        power: FloatArray = spectrum(rest[:rows])[:lines] * unfiltered
        parasitic: FloatArray = noise**2 * (2 * np.sin(np.pi * line / rows)) ** 4
        level = parasitic + max(float(np.mean(power - parasitic)), np.finfo(float).tiny)
        last = int(_SLOW * lines)
        slow = slice(last // 2, last)
        # As if all noise of the readings were there.
        feigned += rows / (2 * last) * float(np.mean(parasitic[slow]))
        pushed = bool(np.mean(power[slow]) > feigned)
        return cls(structured=is_uneven(power / level, _TIME_ALONE), pushed=pushed)


def whitener(residual: FloatArray) -> FloatArray:
    """Taps of the causal filter that makes a residual white, leading 1.

    The cepstrum of the smoothed spectrum, folded to positive times, is that of the minimum-phase
    response of this spectrum (Kolmogorov; Oppenheim and Schafer, Discrete-Time Signal Processing,
    section 13.5).
    """
    from scipy.fft import irfft, rfft

    power = _smooth_spectrum(spectrum(residual))
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
