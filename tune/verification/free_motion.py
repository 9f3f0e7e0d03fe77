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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

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

#: What the position is a sum of for given nonlinear parameters: (columns with sizes to be found,
#: shape (rows, count); what is known with its size, m, shape (rows,)).
_Columns = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
_BOUNDS = (np.array([-np.inf, _DAMPING_RATIOS[0]]), np.array([np.inf, _DAMPING_RATIOS[1]]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """The rows of free motion."""

    first: int  # row at which it begins
    end: int  # row after its last one
    turns: tuple[int, ...]  # rows within at which the handle turns, ``first`` not among them
    deviation: float  # of the first row from rest, m
    clear: float  # smallest swing that is told from noise and counts, m
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
    # Standard deviation of a reading from second differences, of which motion has few; without
    # noise the least distance of two different readings, one count if the log is of an encoder.
    noise = float(_MAD * np.median(np.abs(np.diff(position, n=2))) / np.sqrt(6))
    values = np.unique(position)
    grain = float(np.min(np.diff(values))) if noise == 0 and values.size > 1 else 0.0
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
        deviation=float(part[begin]) - rest,
        clear=clear,
        grows=_grows(part, turns, start),
    )


def _turning_points(position: FloatArray, clear: float) -> list[int]:
    """Rows at which the motion turns by more than ``clear``; the first is where it sets off.

    A turning point that spans several equal readings is in their middle, the first at their end.
    """

    def middle(row: int) -> int:
        last = row
        while last + 1 < position.size and position[last + 1] == position[row]:
            last += 1
        return (row + last) // 2

    found: list[int] = []
    low = high = 0
    rising: bool | None = None
    for row, place in enumerate(position.tolist()):
        if place > position[high] or (rising is None and place == position[high]):
            high = row
        if place < position[low] or (rising is None and place == position[low]):
            low = row
        if rising is not False and position[high] - place > clear:
            found.append(high if rising is None else middle(high))
            rising, low = False, row
        elif rising is not True and place - position[low] > clear:
            found.append(low if rising is None else middle(low))
            rising, high = True, row
    return found


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
    position: FloatArray,
    sample_time: float,
    release: Release,
    start: tuple[float, float],
    known_friction: tuple[float, float, float],
) -> FreeMotion:
    """Frequency and decay of motion about a spring; (ω₀, σ) to start with, rad/s and 1/s.

    Friction is measured from the second turning point on. Before, nothing tells it from decay; what
    is known of x_f, its value, low and high, m, is taken, and its range widens the intervals.
    """
    rows = _rows(release.end - release.first)
    measured = position[release.first : release.end][rows]
    if release.turns:
        half = float(np.diff([release.first, *release.turns]).mean()) * sample_time
        starts = [[np.log(np.pi / half), ratio] for ratio in (0.03, 0.3, 0.7)]
    else:
        starts = [[np.log(start[0]), start[1] / start[0]]]
    measurable = len(release.turns) > 1
    choices = (None,) if measurable else known_friction if release.turns else (0.0,)
    built = [_sprung_columns(position, sample_time, release, rows, each) for each in choices]
    fits = ((_solve(each, measured, np.array(at), _BOUNDS) for at in starts) for each in built)
    best = [min(every, key=lambda fit: fit[1])[0] for every in fits]
    columns, theta = built[0], best[0]
    answers = np.array([_frequency_and_decay(each) for each in best])
    halves = _half_widths(columns, measured, theta, _BOUNDS, _frequency_and_decay)
    halves = halves + np.max(np.abs(answers - answers[0]), axis=0)
    fitted, solution, misfit = _fitted(columns(theta), measured)
    frequency, decay = (float(each) for each in answers[0])
    return FreeMotion(
        frequency=frequency,
        frequency_half=float(halves[0]),
        decay=decay,
        decay_half=float(halves[1]),
        friction=float(solution[3]) if measurable else None,
        misfit=misfit,
        fitted=fitted,
        rows=release.first + rows,
    )


def measure_unsprung(
    position: FloatArray, sample_time: float, first: int, end: int, decay: float
) -> FreeMotion:
    """Decay of speed of motion that no spring holds, Coulomb friction apart.

    From the row at which the handle is let go to the one after the last in motion; ``decay`` is σ
    to begin with, 1/s.
    """
    time: FloatArray = np.arange(end - first, dtype=np.float64) * sample_time
    rows = _rows(time.size)

    def columns(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        falling = -np.expm1(-np.exp(theta[0]) * time)
        parts = np.column_stack([np.ones(time.size), time, falling])
        return parts[rows], np.zeros(rows.size)

    bounds = (np.array([-np.inf]), np.array([np.inf]))
    measured = position[first:end][rows]
    theta = _solve(columns, measured, np.log([decay]), bounds)[0]
    fitted, _, misfit = _fitted(columns(theta), measured)
    return FreeMotion(
        frequency=0.0,
        frequency_half=0.0,
        decay=float(np.exp(theta[0])),
        decay_half=float(_half_widths(columns, measured, theta, bounds, np.exp)[0]),
        friction=None,
        misfit=misfit,
        fitted=fitted,
        rows=first + rows,
    )


def _rows(count: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST_ROWS)).round().astype(np.intp))


def _sprung_columns(
    position: FloatArray,
    sample_time: float,
    release: Release,
    rows: NDArray[np.intp],
    friction: float | None,
) -> _Columns:
    """Oscillation, place of rest, and friction: a column of its own, or of known x_f."""
    time: FloatArray = np.arange(release.end - release.first, dtype=np.float64) * sample_time
    sense = _friction(position, release)

    def columns(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        w0, ratio = float(np.exp(theta[0])), float(theta[1])
        parts = [*_second_order(w0, ratio, time), np.ones(time.size)]
        known = np.zeros(rows.size)
        if sense is not None and friction != 0:
            answer = _answer(sense, w0, ratio, sample_time)
            if friction is None:
                parts.append(answer)
            else:
                known = friction * answer[rows]
        return np.column_stack(parts)[rows], known

    return columns


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


def _friction(position: FloatArray, release: Release) -> FloatArray | None:
    """-sign of the speed, from the turning points; None where the handle does not turn."""
    if not release.turns:
        return None
    force = np.empty(release.end - release.first)
    bounds = [release.first, *release.turns]
    for begin, end in zip(bounds, [*bounds[1:], release.end], strict=True):
        if begin == bounds[-1]:
            force[begin - release.first :] = np.sign(position[begin] - position[bounds[-2]])
        else:
            sense = np.sign(position[begin] - position[end])
            force[begin - release.first : end - release.first] = sense
    return force


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
    scale = float(np.std(measured))

    def residual(theta: FloatArray) -> FloatArray:
        parts, known = columns(theta)
        wanted = measured[kept] - known[kept]
        return (wanted - _projected(parts[kept], wanted)[0]) / scale

    solved = least_squares(residual, start, bounds=bounds, x_scale="jac", xtol=1e-10, max_nfev=60)
    return np.asarray(solved.x, dtype=np.float64), float(solved.cost)


def _fitted(
    parts: tuple[FloatArray, FloatArray], measured: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """(fit, m; sizes of the columns; what is left, part of the rms about the mean)."""
    columns, known = parts
    fitted, sizes = _projected(columns, measured - known)
    fitted = fitted + known
    misfit = float(np.sqrt(np.mean((measured - fitted) ** 2)) / np.std(measured))
    return fitted, sizes, misfit


def _projected(columns: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
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


def _half_widths(
    columns: _Columns,
    measured: FloatArray,
    theta: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    quantities: Callable[[FloatArray], ArrayLike],
) -> FloatArray:
    """95 % half-widths of what is told, leaving out one block after the other (jackknife)."""
    kept = (_solve(columns, measured, theta, bounds, left_out=k)[0] for k in range(_BLOCKS))
    values = np.array([quantities(each) for each in kept], dtype=np.float64)
    spread = values - values.mean(axis=0)
    variance = (_BLOCKS - 1) / _BLOCKS * np.sum(spread * spread, axis=0)
    return np.asarray(_STUDENT * np.sqrt(variance), dtype=np.float64)
