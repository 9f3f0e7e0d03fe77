"""Frequency and decay of free motion, measured: one damped mode and the friction that stops it.

With a spring the position obeys q̈ + 2σ·q̇ + ω₀²·(q - q₀ + x_f·sign q̇) = 0, where x_f is Coulomb
friction over stiffness: between two turning points the place of rest is shifted by ±x_f, so the
envelope falls by 2·x_f in every half-cycle besides its exponential decay. The turning points are
read from the log, hence everything but σ and ω₀ is linear (B. F. Feeny and J. W. Liang, "A
decrement method for the simultaneous estimation of Coulomb and viscous friction", Journal of Sound
and Vibration 195(1), 1996, use the turning points alone). Without a spring speed decays as
q̈ + σ·q̇ = constant. One file: one fit, with a spring or without.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.verification.release import Release

FloatArray = NDArray[np.float64]

#: Rows the fit looks at; more of one smooth motion tell no more.
_MOST_ROWS = 3000
#: Blocks left out in turn for the interval, and Student's t at 95 % for one less.
_BLOCKS, _STUDENT = 10, 2.262
#: Damping ratios looked through; from the second on, the fast pole is beyond anything logged.
_DAMPING_RATIOS = (-0.5, 30.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeMotion:
    """The mode a log shows.

    Attributes:
        frequency: damped, Hz; 0 where it does not oscillate.
        frequency_half: half-width of its 95 % interval, Hz.
        decay: of the envelope, or of the slowest part where it does not oscillate, 1/s.
        decay_half: half-width of its 95 % interval, 1/s.
        friction: x_f, Coulomb friction over stiffness, m; None where the log does not tell it.
        misfit: rms of what one mode leaves, part of the rms about the mean.
        fitted: the fit on its rows, m, shape (rows,).
        rows: those rows of the log, shape (rows,).
    """

    frequency: float
    frequency_half: float
    decay: float
    decay_half: float
    friction: float | None
    misfit: float
    fitted: FloatArray
    rows: NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class Linear:
    """What the position is a sum of for given nonlinear parameters.

    Attributes:
        columns: with sizes to be found, shape (rows, count).
        known: with its size, m, shape (rows,).
    """

    columns: FloatArray
    known: FloatArray


_Columns = Callable[[FloatArray], Linear]
_BOUNDS = (np.array([-np.inf, _DAMPING_RATIOS[0]]), np.array([np.inf, _DAMPING_RATIOS[1]]))


def measure_sprung(
    position: FloatArray,
    sample_time: float,
    release: Release,
    start: tuple[float, float],
    known_friction: tuple[float, float, float],
) -> FreeMotion:
    """Frequency and decay of motion about a spring.

    Friction is measured from the second turning point on. Before, nothing tells it from decay; what
    is known of it is taken, and its range widens the intervals.

    Args:
        position: m, shape (n,).
        sample_time: s.
        release: rows of free motion.
        start: (ω₀, σ) to begin with, rad/s and 1/s.
        known_friction: x_f of the device: value, low and high, m.
    """
    rows = _rows(release.end - release.first)
    measured = position[release.first : release.end][rows]
    if release.turns:
        half = float(np.diff([release.first, *release.turns]).mean()) * sample_time
        starts = [(np.pi / half, 0.03), (np.pi / half, 0.3), (np.pi / half, 0.7)]
    else:
        starts = [(start[0], start[1] / start[0])]
    told = len(release.turns) > 1
    choices = (None,) if told else known_friction if release.turns else (0.0,)
    built = [_sprung_columns(position, sample_time, release, rows, each) for each in choices]
    best = [_best(columns, measured, starts) for columns in built]
    columns, theta = built[0], best[0]
    values = [
        _frequency_and_decay(_solve(columns, measured, theta, _BOUNDS, left_out=block)[0])
        for block in range(_BLOCKS)
    ]
    answers = np.array([_frequency_and_decay(each) for each in best])
    halves = _half_widths(np.array(values)) + np.max(np.abs(answers - answers[0]), axis=0)
    fitted, solution = _fitted(columns(theta), measured)
    frequency, decay = (float(each) for each in answers[0])
    return FreeMotion(
        frequency=frequency,
        frequency_half=float(halves[0]),
        decay=decay,
        decay_half=float(halves[1]),
        friction=float(solution[3]) if told else None,
        misfit=_misfit(measured, fitted),
        fitted=fitted,
        rows=release.first + rows,
    )


def _best(columns: _Columns, measured: FloatArray, starts: list[tuple[float, float]]) -> FloatArray:
    """Nonlinear parameters of the best fit from several starts (ω₀, ζ)."""
    fits = [_solve(columns, measured, np.array([np.log(w), ratio]), _BOUNDS) for w, ratio in starts]
    return min(fits, key=lambda fit: fit[1])[0]


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

    def columns(theta: FloatArray) -> Linear:
        w0, ratio = float(np.exp(theta[0])), float(theta[1])
        parts = [*_second_order(w0, ratio, time), np.ones(time.size)]
        known = np.zeros(rows.size)
        if sense is not None and friction != 0:
            answer = _answer(sense, w0, ratio, sample_time)
            if friction is None:
                parts.append(answer)
            else:
                known = friction * answer[rows]
        return Linear(columns=np.column_stack(parts)[rows], known=known)

    return columns


def measure_unsprung(
    position: FloatArray, sample_time: float, first: int, end: int, decay: float
) -> FreeMotion:
    """Decay of speed of motion that no spring holds, Coulomb friction apart.

    Args:
        position: m, shape (n,).
        sample_time: s.
        first: row at which the handle is let go.
        end: row after the last one in motion.
        decay: σ to begin with, 1/s.
    """
    time: FloatArray = np.arange(end - first, dtype=np.float64) * sample_time
    rows = _rows(time.size)

    def columns(theta: FloatArray) -> Linear:
        falling = -np.expm1(-np.exp(theta[0]) * time)
        parts = np.column_stack([np.ones(time.size), time, falling])
        return Linear(columns=parts[rows], known=np.zeros(rows.size))

    bounds = (np.array([-np.inf]), np.array([np.inf]))
    measured = position[first:end][rows]
    theta = _solve(columns, measured, np.log([decay]), bounds)[0]
    values = np.array(
        [
            np.exp(_solve(columns, measured, theta, bounds, left_out=block)[0])
            for block in range(_BLOCKS)
        ]
    )
    fitted, _ = _fitted(columns(theta), measured)
    return FreeMotion(
        frequency=0.0,
        frequency_half=0.0,
        decay=float(np.exp(theta[0])),
        decay_half=float(_half_widths(values)[0]),
        friction=None,
        misfit=_misfit(measured, fitted),
        fitted=fitted,
        rows=first + rows,
    )


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
        parts = columns(theta)
        wanted = measured[kept] - parts.known[kept]
        return (wanted - _projected(parts.columns[kept], wanted)[0]) / scale

    solved = least_squares(residual, start, bounds=bounds, x_scale="jac", xtol=1e-10, max_nfev=60)
    return np.asarray(solved.x, dtype=np.float64), float(solved.cost)


def _fitted(parts: Linear, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(fit, m; sizes of the columns)."""
    fitted, sizes = _projected(parts.columns, measured - parts.known)
    return fitted + parts.known, sizes


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


def _half_widths(values: FloatArray) -> FloatArray:
    """95 % half-widths from leaving out one block after the other (jackknife)."""
    spread = values - values.mean(axis=0)
    variance = (_BLOCKS - 1) / _BLOCKS * np.sum(spread * spread, axis=0)
    return np.asarray(_STUDENT * np.sqrt(variance), dtype=np.float64)


def _misfit(measured: FloatArray, fitted: FloatArray) -> float:
    return float(np.sqrt(np.mean((measured - fitted) ** 2)) / np.std(measured))
