"""How finely a log reads position: the count of its encoder, and the noise of one reading."""

from __future__ import annotations

from weakref import finalize

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Steps this many counts or fewer decide whether there is a grid; larger ones only add rounding.
_SMALL_STEPS = 50.0
#: Fewer small steps than this may lie on a grid by chance, unless there are no other steps.
_FEWEST_STEPS = 20
#: A step may miss a whole number of counts by this part of a count (printed digits).
_OFF_GRID = 0.05
#: Steps held at once.
_BLOCK = 1 << 20
#: The noise is read in the band from this part of the sampling rate to its half, ...
_BAND = 0.3
#: ... of second differences, cut to this many samples at most: more add time, not truth.
_LONGEST = 1 << 17
#: Answers by log, for as long as its columns live: everything that looks at a log asks for them.
_counts: dict[int, float | None] = {}
_noises: dict[tuple[int, int], float] = {}
#: Noise this many times the rounding of a count hides the count.
_HIDDEN = 2.0


def encoder_count(position: FloatArray) -> float | None:
    """The step all changes of position are multiples of, m; None if there is no such step.

    The position has shape (n,), m (rad).
    """
    key = id(position)
    if key in _counts:
        return _counts[key]
    count = _count_of(position)
    if _unchanging(position):
        _counts[key] = count
        finalize(position, _counts.pop, key, None)
    return count


def _unchanging(column: FloatArray) -> bool:
    """Whether nobody can write to a column, as to none of a Trajectory."""
    return column.base is None and not column.flags.writeable


def _count_of(position: FloatArray) -> float | None:
    # Below rounding of the values themselves a difference says nothing.
    floor = 16 * float(np.spacing(max(abs(position.max()), abs(position.min()))))
    blocks = [slice(i, i + _BLOCK + 1) for i in range(0, position.size - 1, _BLOCK)]
    smallest, told = np.inf, 0
    for rows in blocks:
        steps = _steps(position[rows], floor)
        told += steps.size
        smallest = min(smallest, float(steps.min(initial=np.inf)))
    if told == 0:
        return None
    small, crossed, square = 0, 0.0, 0.0
    for rows in blocks:
        steps = _steps(position[rows], floor, _SMALL_STEPS * smallest)
        whole = np.rint(steps / smallest)
        small += steps.size
        crossed += float(np.sum(steps * whole))
        square += float(np.sum(whole * whole))
    if small < min(_FEWEST_STEPS, told):
        return None
    count = crossed / square
    for rows in blocks:
        counts = _steps(position[rows], floor, _SMALL_STEPS * smallest) / count
        if np.max(np.abs(counts - np.rint(counts)), initial=0.0) >= _OFF_GRID:
            return None
    return count


def _steps(position: FloatArray, above: float, most: float = np.inf) -> FloatArray:
    """Sizes of the changes from one sample to the next that lie within some bounds, m."""
    steps = np.abs(np.diff(position))
    return steps[(steps > above) & (steps <= most)]


def position_noise(
    position: FloatArray, force: FloatArray, steps: float | FloatArray = 1.0
) -> float:
    """Standard deviation of one position reading, m, taken as white, rounding included.

    Read from the highest frequencies of the second difference, where a held force moves a device
    least; what follows the force even there is taken out first. Never below Δ/√12 of the
    encoder's count Δ (Widrow: rounding noise of a signal that crosses counts).

    Position (m or rad) and force (N or N·m) have shape (n,), the steps shape (n - 1,) or one value,
    s.
    """
    if isinstance(steps, np.ndarray) or not (_unchanging(position) and _unchanging(force)):
        return _noise_of(position, force, steps)
    key = id(position), id(force)
    if key not in _noises:
        _noises[key] = _noise_of(position, force, steps)
        for column in (position, force):
            finalize(column, _noises.pop, key, None)
    return _noises[key]


def _noise_of(position: FloatArray, force: FloatArray, steps: float | FloatArray) -> float:
    count = encoder_count(position)
    least = 0.0 if count is None else count / np.sqrt(12.0)
    middle = max(0, (position.size - _LONGEST) // 2)
    part = slice(middle, middle + _LONGEST)
    place, push = position[part], force[part]
    if isinstance(steps, np.ndarray):
        relative = (steps / np.mean(steps))[part][: place.size - 1]
        slope, uneven = np.diff(place) / relative, float(np.mean(relative**-2.0))
    else:
        slope, uneven = np.diff(place), 1.0
    window = np.hanning(place.size - 2)
    second = np.fft.rfft(np.diff(slope) * window)
    drive = np.fft.rfft((push[1:-1] + push[:-2]) / 2 * window)
    frequency = np.fft.rfftfreq(window.size)
    band = frequency >= _BAND
    second, drive, frequency = second[band], drive[band], frequency[band]
    power = float(np.sum(np.abs(drive) ** 2))
    if power > 0:
        second = second - drive * (np.sum(second * drive.conj()).real / power)
    gain = (2 * np.sin(np.pi * frequency)) ** 4 * np.sum(window**2) * uneven
    return max(least, float(np.sqrt(np.mean(np.abs(second) ** 2 / gain))))


def finest_reading(position: FloatArray, force: FloatArray) -> float:
    """Resolution of a log that does not state one: the encoder's count, m.

    If noise exceeds the rounding of that count, or there is no count, the count whose rounding
    would be as large as the noise.

    Position (m or rad) and force (N or N·m) have shape (n,).
    """
    count = encoder_count(position)
    equivalent = float(np.sqrt(12.0)) * position_noise(position, force)
    if count is not None and equivalent < _HIDDEN * count:
        return count
    return equivalent
