"""Forces that move a simulated device enough to tell its mass and damping, within its limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import simulate

FloatArray = NDArray[np.float64]

#: Lines reach from this fraction of the corner b/m, where damping rules the motion, ...
_BELOW = 0.25
#: ... to this multiple of it, where mass does.
_ABOVE = 8.0
#: Lowest line, periods per record: fewer tell little and drift far.
_FEWEST_PERIODS = 2
#: The highest line is at least this, Hz: slower motion of a slow device is lost in friction.
_FASTEST = 4.0
#: Lines asked for, spaced evenly on a logarithmic scale; coinciding ones merge.
_LINES = 16
#: The search for a scale aims at this part of the travel, ...
_AIM = 0.97
#: ... is content with this part, ...
_NEAR_ENOUGH = 0.9
#: ... and keeps the best it has after this many simulations.
_TRIES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """What to play on a batch of devices, and from where.

    Attributes:
        force: N (N·m), shape (batch, n).
        start: position at t = 0 that centres the motion about zero, m (rad), shape (batch,).
        reach: half the range of positions it visits without noise, m (rad), shape (batch,).
    """

    force: FloatArray
    start: FloatArray
    reach: FloatArray


def multisine(rig: Rig, samples: int, *, fade: float = 1.0) -> FloatArray:
    """A multisine of peak 1 about each device's corner b/m, shape (batch, samples).

    The force of each line is in proportion to √ω·|jω + b/m|, half way between equal speed and equal
    travel: slow lines show the damping, fast ones the mass, and travel and force run out together.
    Phases follow Schroeder (IEEE Transactions on Information Theory 16, 1970, p. 85): each line has
    its turn in proportion to its power, which keeps the crest low. The force rises from zero over
    ``fade`` seconds along a raised cosine, so that a device starting at rest is not thrown.
    """
    force = np.empty((rig.batch, samples))
    for member in range(rig.batch):
        corner = abs(float(rig.damping[member] / rig.mass[member]))
        step = float(rig.sample_time[member])
        duration = samples * step
        base = 2 * np.pi / duration
        lowest = min(max(_FEWEST_PERIODS, _BELOW * corner / base), samples / 16)
        highest = min(max(_ABOVE * corner / base, _FASTEST * duration), samples / 8)
        lines = np.unique(np.rint(np.geomspace(lowest, highest, _LINES)).astype(np.int64))
        amplitude = lines**0.5 * np.hypot(lines * base, corner)
        power = amplitude**2 / np.sum(amplitude**2)
        turn = np.concatenate(([0.0], np.cumsum(power)[:-1]))
        phase = -2 * np.pi * np.cumsum(np.diff(lines, prepend=lines[0]) * turn)
        spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
        spectrum[lines] = amplitude * np.exp(1j * phase)
        time = np.arange(samples) * step
        rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / fade, 1.0))
        wave = np.fft.irfft(spectrum, samples) * rise
        force[member] = wave / np.max(np.abs(wave))
    return force


def fit_to_limits(
    rig: Rig, shape: FloatArray, *, travel: ArrayLike, force: ArrayLike
) -> Excitation:
    """Scale a force shape until the device just reaches its travel or its force limit.

    False position on noise-free simulations of the rig itself, friction included, between the
    force that friction just holds and the largest allowed; the scale returned has been simulated
    and stays within both limits. The force that cancels ``rig.force_offset`` is added and counts
    against the force limit.

    Args:
        rig: the devices to move.
        shape: force of peak 1, shape (batch, n).
        travel: half the range of positions allowed, m (rad), a number or shape (batch,).
        force: largest |force| allowed, N (N·m), a number or shape (batch,).

    Raises:
        ValueError: the force limit does not exceed the device's own offset and friction, or no
            scale that moves the device keeps it within its travel.
    """
    exact = replace(rig, encoder_resolution=0.0)
    travel = np.broadcast_to(np.asarray(travel, dtype=np.float64), rig.mass.shape)
    held = rig.coulomb_friction + np.abs(rig.coulomb_asymmetry)
    room = np.minimum(force, rig.force_limit) - np.abs(rig.force_offset)
    if np.any(room <= held):
        worst = int(np.argmin(room - held))
        raise ValueError(
            f"force limit leaves {room[worst]:g} above the offset of {rig.name}; "
            f"more than its friction {held[worst]:g} is needed"
        )
    low, reached, centre = np.array(held), np.zeros_like(held), np.zeros_like(held)
    high, overshot = room.copy(), np.full_like(room, np.inf)
    scale = room.copy()
    searching = np.arange(rig.batch)
    # False position for all members at once: scipy's searches take one scalar at a time.
    for _ in range(_TRIES):
        some = exact.members(searching)
        tried = scale[searching]
        middle, reach = _range(some, _command(shape[searching], tried, some))
        within = reach <= travel[searching]
        good, bad = searching[within], searching[~within]
        low[good], reached[good], centre[good] = tried[within], reach[within], middle[within]
        high[bad], overshot[bad] = tried[~within], reach[~within]
        enough = (reached >= _NEAR_ENOUGH * travel) | (low == room)
        searching = np.flatnonzero(~enough)
        if searching.size == 0:
            break
        part = np.maximum(_AIM * travel - reached, 0.0) / (overshot - reached)
        scale = low + part * (high - low)
    if not np.all(reached > 0):
        raise ValueError(f"{rig.name} leaves its travel of {np.min(travel):g} at every force tried")
    return Excitation(force=_command(shape, low, rig), start=-centre, reach=reached)


def _command(shape: FloatArray, scale: FloatArray, rig: Rig) -> FloatArray:
    """The scaled shape with the force that cancels each device's offset, shape (batch, n)."""
    return shape * scale[:, None] + rig.force_offset[:, None]


def _range(rig: Rig, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre and half width of the positions visited from rest at zero, each shape (batch,)."""
    position = simulate(rig, force).position
    highest, lowest = position.max(axis=1), position.min(axis=1)
    return (highest + lowest) / 2, (highest - lowest) / 2
