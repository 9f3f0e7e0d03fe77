"""The control law on a log: the logged force is a function of the logged positions, or it is not.

F[k] = -s·(K·y + B·v + M·a) + offset, v and a by the very filters of a profile on the positions of
the log. The offset is where the spring is relaxed. What the filters remember from before the log,
or from a contact that reset them, dies away in their own modes; each contact has columns for these,
so that no row is lost and the state at its start need not be known. One file: columns and fits of
one regression.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile

FloatArray = NDArray[np.float64]
Rows = NDArray[np.bool_]

#: Contacts with a one-sided wall that are used, the longest ones; more would only cost time.
_MOST_CONTACTS = 12
#: Rows a contact needs beyond its nuisance columns to say anything.
_SHORTEST_CONTACT = 20
#: A mode of a filter smaller than this has died away; it would only spoil the conditioning.
_DEAD = 1e-14
#: Radians a sample: two poles nearer than this are equal, their second mode is the first times t.
_EQUAL = 1e-6
#: Columns that agree to this part, relative, are one column.
_SAME = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Force and the three estimates on the rows used, what offset and old state explain taken out.

    Attributes:
        force: N, shape (n,).
        position: m, shape (n,).
        velocity: m/s, shape (n,).
        acceleration: m/s², shape (n,).
        rows: which rows of the log these are, shape (rows of the log,).
    """

    force: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    rows: Rows

    @property
    def scale(self) -> float:
        """rms of the force that position, velocity and acceleration have to explain, N."""
        return _rms(self.force)


@dataclass(frozen=True, slots=True, kw_only=True)
class LawFit:
    """What explains the force best.

    Attributes:
        gain: s, the part of the effects that was played.
        residual: rms of the force left over, N.
        left: the force left over on the rows used, N, shape (n,).
    """

    gain: float
    residual: float
    left: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeFit:
    """Stiffness, damping and mass that explain the force best, bound to nothing.

    Attributes:
        effects: what was played, single numbers.
        residual: rms of the force left over, N.
    """

    effects: Effects
    residual: float


def estimates(position: FloatArray, loop: LoopProfile) -> tuple[FloatArray, FloatArray]:
    """(velocity, acceleration) of the control law, from rest at the first reading; m/s, m/s²."""
    from scipy.signal import lfilter

    change = np.diff(position, prepend=position[0]) / loop.sample_time
    again = np.diff(change, prepend=change[0]) / loop.sample_time
    if loop.velocity_window_samples is not None:
        count = loop.velocity_window_samples
        velocity = np.asarray(lfilter(np.full(count, 1 / count), [1.0], change), dtype=np.float64)
    else:
        velocity = _low_pass(change, loop, loop.velocity_filter_hz, loop.velocity_filter_order)
    return velocity, _low_pass(
        again, loop, loop.acceleration_filter_hz, loop.acceleration_filter_order
    )


def _low_pass(
    signal: FloatArray, loop: LoopProfile, cutoff: float | None, order: int
) -> FloatArray:
    """The low-pass a profile names; docs/theory.md, 1."""
    from scipy.signal import lfilter

    if cutoff is None:
        return signal
    turn = 2 * np.pi * cutoff * loop.sample_time
    if order == 1:
        denominator = np.array([1.0, -np.exp(-turn)])
    else:
        shrink = np.exp(-turn * loop.filter_damping_ratio)
        swing = np.cos(turn * np.sqrt(1 - loop.filter_damping_ratio**2))
        denominator = np.array([1.0, -2 * shrink * swing, shrink * shrink])
    return np.asarray(lfilter([np.sum(denominator)], denominator, signal), dtype=np.float64)


def columns_of(
    force: FloatArray,
    position: FloatArray,
    loop: LoopProfile,
    used: Rows,
    *,
    late: int = 0,
) -> Columns | None:
    """The regression of one variant of the law.

    Args:
        force: N, shape (n,).
        position: m, shape (n,).
        loop: sample time and filters of the variant.
        used: rows neither saturated nor outside of a one-sided wall, shape (n,).
        late: rows by which the force column lags behind the position it answers.

    Returns:
        None where too few rows are left.
    """
    velocity, acceleration = estimates(position, loop)
    warm = 2 + abs(late) + (loop.velocity_window_samples or 1)
    answered = np.roll(force, -late)
    nuisance, rows = _nuisance(_contacts(used & np.roll(used, -late)), loop, warm, force.size)
    if np.count_nonzero(rows) < nuisance.shape[1] + _SHORTEST_CONTACT:
        return None
    basis = _orthonormal(nuisance[rows])

    def rest(column: FloatArray) -> FloatArray:
        kept = column[rows]
        return kept - basis @ (basis.T @ kept)

    return Columns(
        force=rest(answered),
        position=rest(position),
        velocity=rest(velocity),
        acceleration=rest(acceleration),
        rows=rows,
    )


def fit_scaled(columns: Columns, effects: Effects) -> LawFit:
    """The one gain at which these effects explain the force best."""
    played = np.zeros_like(columns.force)
    parts = (columns.position, columns.velocity, columns.acceleration)
    for size, part in zip(effects.arrays(), parts, strict=True):
        if size is not None:
            played = played + size * part
    energy = float(played @ played)
    gain = -float(played @ columns.force) / energy if energy > 0 else 0.0
    left = columns.force + gain * played
    return LawFit(gain=gain, residual=_rms(left), left=left)


def fit_free(columns: Columns) -> FreeFit:
    """The stiffness, damping and mass that explain the force best, each for itself."""
    parts = np.column_stack([columns.position, columns.velocity, columns.acceleration])
    sizes = np.linalg.norm(parts, axis=0)
    sizes[sizes == 0] = 1.0
    solution = np.asarray(np.linalg.lstsq(parts / sizes, -columns.force, rcond=None)[0], np.float64)
    left = columns.force + parts / sizes @ solution
    K, B, M = (float(each) for each in solution / sizes)
    return FreeFit(effects=Effects(stiffness=K, damping=B, mass=M), residual=_rms(left))


def noise_gain(effects: Effects, loop: LoopProfile) -> float:
    """rms of force per rms of white noise on every position reading, N/m."""
    knock = np.zeros(_memory(loop))
    knock[1] = 1.0  # after one row of rest, so that the knock itself is a change
    parts = (knock, *estimates(knock, loop))
    answer = np.zeros_like(knock)
    for size, part in zip(effects.arrays(), parts, strict=True):
        if size is not None:
            answer = answer + size * part
    return float(np.linalg.norm(answer))


def _memory(loop: LoopProfile) -> int:
    """Samples after which every filter has forgotten."""
    cutoffs = [f for f in (loop.velocity_filter_hz, loop.acceleration_filter_hz) if f is not None]
    slowest = min(cutoffs, default=1 / loop.sample_time) * loop.filter_damping_ratio
    forgetting = int(8 / (2 * np.pi * slowest * loop.sample_time))
    return 8 + (loop.velocity_window_samples or 0) + forgetting


def _contacts(used: Rows) -> list[tuple[int, int]]:
    """(first, end) of every stretch of rows used, the longest ones, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], used.view(np.int8), [0]])))
    pairs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    longest = sorted(pairs, key=lambda pair: pair[0] - pair[1])[:_MOST_CONTACTS]
    return sorted(pair for pair in longest if pair[1] - pair[0] > _SHORTEST_CONTACT)


def _nuisance(
    contacts: list[tuple[int, int]], loop: LoopProfile, warm: int, count: int
) -> tuple[FloatArray, Rows]:
    """(offset and modes of the filters of each contact, the rows the contacts leave)."""
    rows = np.zeros(count, dtype=np.bool_)
    columns: list[FloatArray] = [np.ones(count)]
    filters = [(loop.acceleration_filter_hz, loop.acceleration_filter_order)]
    if loop.velocity_window_samples is None:
        filters.append((loop.velocity_filter_hz, loop.velocity_filter_order))
    shaping = [(cutoff, order) for cutoff, order in dict.fromkeys(filters) if cutoff is not None]
    for first, end in contacts:
        start = min(first + warm, end)
        rows[start : max(start, end - warm)] = True
        since = np.arange(end - start, dtype=np.float64)
        for cutoff, order in shaping:
            turn = 2 * np.pi * cutoff * loop.sample_time
            for mode in _modes(turn, order, loop.filter_damping_ratio, since):
                column = np.zeros(count)
                column[start:end] = mode
                columns.append(column)
    return np.column_stack(columns), rows


def _modes(turn: float, order: int, damping_ratio: float, since: FloatArray) -> list[FloatArray]:
    """How a low-pass of 2π·f·T = ``turn`` forgets; ``since`` in samples."""
    if order == 1:
        return [np.exp(-turn * since)]
    shrink = np.exp(-turn * damping_ratio * since)
    swing = turn * np.sqrt(1 - damping_ratio**2)
    if swing < _EQUAL:
        return [shrink, shrink * since * turn]
    return [shrink * np.cos(swing * since), shrink * np.sin(swing * since)]


def _orthonormal(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the space of the columns, dead ones left out."""
    norms = np.linalg.norm(columns, axis=0)
    alive = columns[:, norms > _DEAD] / norms[norms > _DEAD]
    left, sizes, _ = np.linalg.svd(alive, full_matrices=False)
    return left[:, sizes > _SAME * sizes[0]]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values * values)))
