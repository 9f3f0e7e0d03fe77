"""Linear filters: convolution by blocks of Fourier transforms, and difference equations.

What ``scipy.signal`` offers as well, whose package takes longer to load than a log to identify.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Spectra = dict[int, NDArray[np.complex128]]

#: Blocks hold this many rows, or this many kernels, whichever is longer.
_SHORTEST_BLOCK = 1 << 14
_KERNELS = 8


def overlap_save(
    columns: FloatArray, kernel: FloatArray, spectra: Spectra | None = None
) -> FloatArray:
    """Rows with a full set of neighbours, shape (..., n) to (..., n - k + 1).

    Each block of rows is convolved in a circle and what wrapped around is left out (overlap-save:
    Oppenheim and Schafer, Discrete-Time Signal Processing, section 8.7.3).

    Args:
        columns: shape (..., n).
        kernel: shape (k,), k at most n; the first weight is that of the newest row.
        spectra: of this kernel, by length of block; what is not there is added.
    """
    rows, lost = columns.shape[-1], kernel.size - 1
    block = min(_quick(rows), _quick(max(_SHORTEST_BLOCK, _KERNELS * kernel.size)))
    whole = block - lost
    count = -(-(rows - lost) // whole)
    spectra = {} if spectra is None else spectra
    if block not in spectra:
        spectra[block] = np.fft.rfft(kernel, block)
    if count == 1:
        return np.fft.irfft(np.fft.rfft(columns, block) * spectra[block], block)[..., lost:rows]
    padded = np.zeros((*columns.shape[:-1], lost + count * whole))
    padded[..., :rows] = columns
    blocks = sliding_window_view(padded, block, axis=-1)[..., ::whole, :]
    convolved = np.fft.irfft(np.fft.rfft(blocks) * spectra[block], block)[..., lost:]
    return convolved.reshape(*columns.shape[:-1], count * whole)[..., : rows - lost]


def causal(columns: FloatArray, kernel: FloatArray) -> FloatArray:
    """Rows weighted with those before them, zero before the first, shape (..., n) to (..., n)."""
    before = np.zeros((*columns.shape[:-1], kernel.size - 1))
    return overlap_save(np.concatenate((before, columns), axis=-1), kernel)


def recursive(rows: FloatArray, *past: FloatArray | float) -> FloatArray:
    """y with y[k] + past[0]·y[k - 1] + past[1]·y[k - 2] + … = rows[k], nothing before the first.

    A triangular system with a few diagonals, solved as such: it knows no growth that would have to
    be divided out.

    Args:
        rows: shape (n,) or (columns, n).
        past: one weight for each row back: a number, or its value at each row, shape (n,).
    """
    from scipy.linalg.lapack import dtbtrs

    count = rows.shape[-1]
    band = np.ones((len(past) + 1, count), order="F")
    for back, weight in enumerate(past, start=1):
        # The diagonal below the main one begins with the row that is the first to look back so far.
        band[back, : count - back] = weight[back:] if isinstance(weight, np.ndarray) else weight
    return dtbtrs(band, np.atleast_2d(rows).T, uplo="L", diag="U")[0].T.reshape(rows.shape)


def _quick(least: int) -> int:
    """The least length of at least this that is 4, 5 or 6 times a power of two."""
    power = 1 << max(int(least - 1).bit_length() - 3, 0)
    return next(part * power for part in (4, 5, 6, 8) if part * power >= least)
