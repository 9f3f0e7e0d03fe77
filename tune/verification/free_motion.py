"""Free motion in a log, from the furthest turning point to the last clear one, and its mode.

With a spring the position obeys q̈ + 2σ·q̇ + ω₀²·(q - q₀ + x_f·sign q̇) = 0, where x_f is Coulomb
friction over stiffness: between two turning points the place of rest is shifted by ±x_f, so the
envelope falls by 2·x_f in every half-cycle besides its exponential decay. The turning points are
read from the log, hence everything but σ and ω₀ is linear (B. F. Feeny and J. W. Liang, "A
decrement method for the simultaneous estimation of Coulomb and viscous friction", Journal of Sound
and Vibration 195(1), 1996, use the turning points alone). Without a spring speed decays as
q̈ + σ·q̇ = constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tune.loop.polynomials import FloatArray

#: A swing counts if it is larger than this many encoder counts, ...
_COUNTS = 4.0
#: ... than this many times the noise of a reading, ...
_NOISES = 8.0
#: ... and than this part of the largest deviation from rest.
_LEAST_SWING = 0.02
#: A swing larger than the one before it by this factor is a new push.
_GROWN = 1.05
#: So many swings, each larger than the one before, are no chance and no hand.
_GROWING = 5
#: Rows of motion that are worth looking at.
_SHORTEST = 50
#: The last part of the log tells where the handle comes to rest.
_REST = 0.05
#: Motion without turning is followed this many times as long as it takes to settle.
_TAIL = 1.5
#: Standard deviation of a normal variable over its median modulus.
_MAD = 1.4826

#: Rows the fit looks at; more of one smooth motion tell no more.
_MOST_ROWS = 3000
#: Blocks left out in turn for the interval, and Student's t at 95 % for one less.
_BLOCKS, _STUDENT = 10, 2.262
#: Damping ratios looked through; from the second on, the fast pole is beyond anything logged.
_DAMPING_RATIOS = (-0.5, 30.0)

#: Rows at which a hand may have let go that are tried. What a fit leaves there is much where it is
#: more than this many times what it leaves of later starts, and than these parts of the motion:
#: a hand that pushes on for a thirtieth of the motion leaves twice as much, and shifts the decay
#: by a fiftieth; the latest start has few rows and no later one.
_STARTS, _MORE, _SMALL, _SMALL_AT_FIRST = 30, 2.0, 1e-3, 0.02

#: What the position is a sum of for given nonlinear parameters, shape (rows, count).
_Columns = Callable[[FloatArray], FloatArray]
_BOUNDS = (np.array([-np.inf, _DAMPING_RATIOS[0]]), np.array([np.inf, _DAMPING_RATIOS[1]]))
_ANY = (np.array([-np.inf]), np.array([np.inf]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """The rows of free motion."""

    first: int  # row at which it begins
    end: int  # row after its last one
    turns: tuple[int, ...]  # rows within at which the handle turns, ``first`` not among them
    grows: bool  # whether swing after swing grew until the log ends: there is no free decay


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeMotion:
    """The mode a log shows, with half-widths of 95 % intervals."""

    frequency: float  # damped, Hz; 0 where it does not oscillate
    frequency_half: float
    decay: float  # of the envelope, or of the slowest part where it does not oscillate, 1/s
    decay_half: float
    friction: float | None  # x_f, m; None where the log does not tell it
    misfit: float  # rms of what one mode leaves, part of the rms about the mean
    fitted: FloatArray  # the fit on its rows, m, shape (rows,)
    rows: NDArray[np.intp]  # those rows of the log, shape (rows,)


def find_release(position: FloatArray, first: int) -> Release | None:
    """Free motion after row ``first``; None where nothing moves clearly.

    Nothing is free before that row: the stated release, or the last saturated row.
    """
    part = position[first:]
    if part.size < _SHORTEST:
        return None
    rest = float(np.median(part[-max(1, round(_REST * part.size)) :]))
    furthest = float(np.max(np.abs(part - rest)))
    noise, grain = _noise_and_grain(position)
    clear = max(_COUNTS * grain, _NOISES * noise, _LEAST_SWING * furthest)
    turns = _turning_points(part, clear)
    if furthest <= clear or not turns:
        return None
    start = max(range(len(turns)), key=lambda i: abs(part[turns[i]] - rest))
    kept = _decaying(part, turns[start:])
    # A hand may hold there for long; it has let go where the motion is clear.
    swing = part[kept[0] : kept[1] if len(kept) > 1 else part.size]
    begin = kept[0] + int(np.flatnonzero(np.abs(swing - swing[0]) <= clear)[-1])
    if len(kept) > 1:
        end = kept[-1] + 1
    else:
        near = np.abs(part - rest) < max(clear, _LEAST_SWING * abs(part[begin] - rest))
        moving = np.flatnonzero(~near[begin:])
        settled = int(moving[-1]) + 1 if moving.size else 1
        end = min(part.size, begin + round(_TAIL * settled))
    return Release(
        first=first + begin,
        end=first + end,
        turns=tuple(first + turn for turn in kept[1:]),
        grows=_grows(part, turns, start),
    )


def _noise_and_grain(position: FloatArray) -> tuple[float, float]:
    """Standard deviation of a reading; where that is 0 one count, if the log is of an encoder."""
    # Motion has few second differences.
    noise = float(_MAD * np.median(np.abs(np.diff(position, n=2))) / np.sqrt(6))
    values = np.unique(position)
    return noise, float(np.min(np.diff(values))) if noise == 0 and values.size > 1 else 0.0


def _turning_points(position: FloatArray, clear: float) -> list[int]:
    """Rows at which the motion turns by more than ``clear``; the first is where it sets off."""
    from scipy.signal import find_peaks

    sides: dict[int, int] = {}
    for side in (1, -1):
        # Where the motion sets off is no lower than what is before it.
        rows, _ = find_peaks(np.append(-np.inf, side * position), prominence=clear)
        sides |= dict.fromkeys((rows - 1).tolist(), side)
    turns = sorted(sides)
    # Of two equal peaks beside one another the first is the turning point.
    return turns[:1] + [b for a, b in pairwise(turns) if sides[a] != sides[b]]


def _grows(position: FloatArray, turns: list[int], start: int) -> bool:
    """Whether the furthest turning point ends a row of growing swings, at the end of the log."""
    swings = np.abs(np.diff(position[turns[: start + 1]]))[-_GROWING:]
    last = len(turns) - start <= 2
    return last and swings.size == _GROWING and bool(np.all(np.diff(swings) > 0))


def _decaying(position: FloatArray, turns: list[int]) -> list[int]:
    """The turning points before the swings grow again."""
    kept = turns[:2]
    for turn in turns[2:]:
        before = abs(position[kept[-1]] - position[kept[-2]])
        if abs(position[turn] - position[kept[-1]]) > _GROWN * before:
            break
        kept.append(turn)
    return kept


def measure_sprung(
    position: FloatArray, sample_time: float, release: Release, start: tuple[float, float]
) -> FreeMotion:
    """Frequency and decay of motion about a spring; (ω₀, σ) to start with, rad/s and 1/s.

    Friction is measured where the handle turns, which two turning points at least tell from decay.
    """
    time: FloatArray = np.arange(release.end - release.first, dtype=np.float64) * sample_time
    rows = _rows(time.size)
    if release.turns:
        turns = np.array([release.first, *release.turns])
        half = float(np.diff(turns).mean()) * sample_time
        starts = [[np.log(np.pi / half), ratio] for ratio in (0.03, 0.3, 0.7)]
        # -sign of the speed.
        senses = -np.sign(np.diff(position[turns]))
        sense = np.repeat(np.append(senses, -senses[-1]), np.diff(np.append(turns, release.end)))
    else:
        starts, sense = [[np.log(start[0]), start[1] / start[0]]], None

    def columns(theta: FloatArray) -> FloatArray:
        """Oscillation and place of rest, and friction where the handle turns."""
        w0, ratio = float(np.exp(theta[0])), float(theta[1])
        parts = [*_second_order(w0, ratio, time), np.ones(time.size)]
        if sense is not None:
            parts.append(_answer(sense, w0, ratio, sample_time))
        return np.column_stack(parts)[rows]

    return _fitted(columns, position, release.first + rows, starts, _BOUNDS, _frequency_and_decay)


def measure_unsprung(
    position: FloatArray, sample_time: float, first: int, end: int, decay: float
) -> FreeMotion:
    """Decay of speed of motion that no spring holds, Coulomb friction apart.

    From the row at which the handle is let go to the one after the last in motion; ``decay`` is σ
    to begin with, 1/s.
    """
    rows, every = _rows(end - first), _unsprung_columns(sample_time, end - first)

    def columns(theta: FloatArray) -> FloatArray:
        return every(theta)[rows]

    def told(theta: FloatArray) -> tuple[float, float]:
        return 0.0, float(np.exp(theta[0]))

    return _fitted(columns, position, first + rows, [[np.log(decay)]], _ANY, told)


def find_letting_go(
    position: FloatArray, sample_time: float, first: int, end: int, decay: float
) -> int | None:
    """The first row, from ``first`` on, from which speed falls as free motion does until ``end``.

    What a fit leaves in its worst block is that of later starts, until a hand pushes within it.
    None where it is much from the last start on.
    """
    noise, grain = _noise_and_grain(position)
    found, later = None, list[float]()
    for row in np.linspace(end - _SHORTEST, first, _STARTS).round().astype(int).tolist():
        measured, columns = position[row:end], _unsprung_columns(sample_time, end - row)
        theta, _ = _solve(columns, measured, np.array([np.log(decay)]), _ANY)
        left = measured - projected(columns(theta), measured)[0]
        worst = max(float(np.std(block)) for block in np.array_split(left, _BLOCKS))
        usual = float(np.median(later)) if later else max(noise, grain)
        small = (_SMALL if later else _SMALL_AT_FIRST) * float(np.std(measured))
        if worst > max(_MORE * usual, small):
            break
        found = row
        later.append(worst)
    return found


def _unsprung_columns(sample_time: float, count: int) -> _Columns:
    time: FloatArray = np.arange(count, dtype=np.float64) * sample_time

    def columns(theta: FloatArray) -> FloatArray:
        return np.column_stack([np.ones(count), time, -np.expm1(-np.exp(theta[0]) * time)])

    return columns


def _rows(count: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST_ROWS)).round().astype(np.intp))


def _second_order(natural: float, ratio: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two independent solutions of q̈ + 2ζω₀·q̇ + ω₀²·q = 0, of one size, smooth through ζ = 1."""
    decay = ratio * natural
    square = (1 - ratio * ratio) * natural * natural
    root = np.sqrt(abs(square))
    if square > 0:
        envelope = np.exp(-decay * time)
        return envelope * np.cos(root * time), envelope * natural * time * np.sinc(
            root * time / np.pi
        )
    slow, fast = np.exp(-(decay - root) * time), np.exp(-(decay + root) * time)
    apart = (slow - fast) / (2 * root) if root > 0 else time * slow
    return (slow + fast) / 2, natural * apart


def _answer(shift: FloatArray, natural: float, ratio: float, sample_time: float) -> FloatArray:
    """How the position follows a place of rest that jumps, from rest at zero."""
    from scipy.signal import lfilter

    decay, square = ratio * natural, (1 - ratio * ratio) * natural * natural
    root = np.sqrt(abs(square)) * sample_time
    shrink = np.exp(-decay * sample_time)
    first = 2 * shrink * (np.cos(root) if square > 0 else np.cosh(root))
    denominator = np.array([1.0, -first, shrink * shrink])
    numerator = np.array([0.0, 0.5, 0.5]) * np.sum(denominator)
    return np.asarray(lfilter(numerator, denominator, shift), dtype=np.float64)


def _solve(
    columns: _Columns,
    measured: FloatArray,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    left_out: int | None = None,
) -> tuple[FloatArray, float]:
    """(nonlinear parameters, cost) of the separable least-squares problem, one block left out."""
    from scipy.optimize import least_squares

    kept = np.ones(measured.size, dtype=np.bool_)
    if left_out is not None:
        kept[measured.size * left_out // _BLOCKS : measured.size * (left_out + 1) // _BLOCKS] = 0
    scale = float(np.std(measured)) or 1.0  # at rest

    def residual(theta: FloatArray) -> FloatArray:
        return (measured[kept] - projected(columns(theta)[kept], measured[kept])[0]) / scale

    solved = least_squares(residual, start, bounds=bounds, x_scale="jac", xtol=1e-10, max_nfev=60)
    return np.asarray(solved.x, dtype=np.float64), float(solved.cost)


def _fitted(
    columns: _Columns,
    position: FloatArray,
    rows: NDArray[np.intp],
    starts: Sequence[Sequence[float]],
    bounds: tuple[FloatArray, FloatArray],
    told: Callable[[FloatArray], tuple[float, float]],
) -> FreeMotion:
    """The best of several fits to rows of a log, with half-widths by the jackknife over blocks."""
    measured = position[rows]
    fits = (_solve(columns, measured, np.array(at), bounds) for at in starts)
    theta = min(fits, key=lambda fit: fit[1])[0]
    kept = (_solve(columns, measured, theta, bounds, left_out=k)[0] for k in range(_BLOCKS))
    values = np.array([told(each) for each in kept])
    spread = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
    halves = _STUDENT * np.sqrt((_BLOCKS - 1) / _BLOCKS * spread)
    fitted, sizes = projected(columns(theta), measured)
    frequency, decay = told(theta)
    return FreeMotion(
        frequency=frequency,
        frequency_half=float(halves[0]),
        decay=decay,
        decay_half=float(halves[1]),
        friction=float(sizes[3]) if sizes.size > 3 else None,
        misfit=float(np.sqrt(np.mean((measured - fitted) ** 2)) / np.std(measured)),
        fitted=fitted,
        rows=rows,
    )


def projected(columns: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(what of columns is nearest to what was measured, how much of each)."""
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    solution = np.asarray(np.linalg.lstsq(columns / norms, measured, rcond=None)[0], np.float64)
    return columns / norms @ solution, solution / norms


def _frequency_and_decay(theta: FloatArray) -> tuple[float, float]:
    natural, ratio = float(np.exp(theta[0])), float(theta[1])
    if abs(ratio) < 1:
        return natural * float(np.sqrt(1 - ratio * ratio)) / (2 * np.pi), natural * ratio
    # The slower pole, ω₀·(ζ - √(ζ²-1)), without cancelling.
    return 0.0, natural / (ratio + float(np.sqrt(ratio * ratio - 1)))
