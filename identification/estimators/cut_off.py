"""Where to put the low-pass of a regression, from the log itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.low_pass import REACH, width_of

FloatArray = NDArray[np.float64]

#: Noise may make up this share of the power of the filtered acceleration; it attenuates the mass
#: by the same share.
NOISE_SHARE = 1e-4
#: The cut-off need not exceed this multiple of the frequency that holds most of the acceleration:
#: above it there is nothing to learn, only vibration modes that the model does not have.
HEADROOM = 5.0
#: ... most of its power, that is.
_MOST = 0.99
#: Highest cut-off, part of the sampling rate: central differences stay accurate below.
HIGHEST = 0.1
#: The kernel may take this part of a log, or too few independent rows are left.
LONGEST_KERNEL = 0.1
#: Cut-offs looked at, evenly spaced on a logarithmic scale.
_CANDIDATES = 40
#: Bins of frequency, evenly spaced on a logarithmic scale, for the sums over candidates.
_BINS = 400
#: Rows looked at, from the middle of the log; more add time, not truth.
_LONGEST = 1 << 17


@dataclass(frozen=True, slots=True, kw_only=True)
class CutOff:
    """A cut-off and why.

    Attributes:
        frequency: Hz.
        noise_share: share of noise in the power of the filtered acceleration, if looked at.
        reason: what set it, if it was chosen from a log.
    """

    frequency: float
    noise_share: float = 0.0
    reason: str = "low-pass as given"


def choose_cut_off(acceleration: FloatArray, step: float, noise: float) -> CutOff:
    """The highest cut-off at which noise of the position reading still does no harm.

    The lower the cut-off, the less noise in the acceleration; the higher, the more of the motion
    is used. Both powers are read from the log: noise is white in position, so its acceleration
    grows with ω⁴.

    Args:
        acceleration: unfiltered, of each inner sample, m/s², shape (rows,).
        step: mean sample time, s.
        noise: standard deviation of one position reading, m.
    """
    middle = max(0, (acceleration.size - _LONGEST) // 2)
    part = acceleration[middle : middle + _LONGEST]
    window = np.hanning(part.size)
    power = np.abs(np.fft.rfft(part * window)) ** 2
    frequency = np.fft.rfftfreq(part.size, step).astype(np.float64)
    relative = 2 * np.sin(np.pi * frequency * step)
    floor = (noise / step**2) ** 2 * np.sum(window**2) * relative**4
    highest = HIGHEST / step
    # Both reaches of the kernel together, REACH standard deviations each.
    lowest = min(highest, 2 * REACH * width_of(1.0) / (LONGEST_KERNEL * step * acceleration.size))
    candidates = np.geomspace(lowest, highest, _CANDIDATES)
    total, parasitic = _passed(frequency, candidates, np.stack((power, floor)))
    share = parasitic / np.maximum(np.maximum(total, parasitic), np.finfo(float).tiny)
    quiet = np.flatnonzero(share <= NOISE_SHARE)
    index = int(quiet[-1]) if quiet.size else int(np.argmin(share))
    chosen, why = float(candidates[index]), "position noise"
    if index == _CANDIDATES - 1:
        why = "the sampling rate"
    signal: FloatArray = (
        np.maximum(power - floor, 0.0) * np.exp(-np.log(2) * (frequency / chosen) ** 2)
    ).cumsum()
    reached = int(np.argmax(signal >= _MOST * signal[-1]))
    enough = HEADROOM * float(frequency[reached])
    if enough < chosen:
        chosen, why = max(enough, lowest), "where the motion has its power"
        index = int(np.argmin(np.abs(candidates - chosen)))
    return CutOff(
        frequency=chosen,
        noise_share=float(share[index]),
        reason=f"low-pass at {chosen:.3g} Hz, set by {why}",
    )


def _passed(frequency: FloatArray, candidates: FloatArray, powers: FloatArray) -> FloatArray:
    """What each cut-off lets through of each power, shape (powers, candidates).

    Powers are first gathered in bins far narrower than the distance of two candidates.
    """
    edges: FloatArray = (
        candidates[0] / 100 * (100 * frequency[-1] / candidates[0]) ** np.linspace(0, 1, _BINS)
    )
    where = np.searchsorted(edges, frequency[1:])
    centre = np.concatenate((edges[:1], np.sqrt(edges[1:] * edges[:-1]), edges[-1:]))
    gathered = np.stack([np.bincount(where, power[1:], minlength=centre.size) for power in powers])
    return gathered @ np.exp(-np.log(2) * (centre[:, None] / candidates) ** 2)
