"""Faults of the recording alone: what a good log becomes when it is written, read or cut badly."""

from dataclasses import replace

import numpy as np

from tests.simulated.catalogue.raw import RawLog


def counted(log: RawLog, counts: float) -> RawLog:
    """Read by an encoder with so few counts over the whole travel."""
    step = float(np.ptp(log.position)) / counts
    return replace(log, position=np.rint(log.position / step) * step)


def clipped(log: RawLog, part: float) -> RawLog:
    """Force that the amplifier, and the log, cut at this part of its peak."""
    limit = part * float(np.max(np.abs(log.force)))
    return replace(log, force=np.clip(log.force, -limit, limit))


def in_units(log: RawLog, *, force: float = 1.0, position: float = 1.0) -> RawLog:
    """Force and position multiplied, as other units do."""
    return replace(log, force=log.force * force, position=log.position * position)


def in_counts(log: RawLog, *, force: int, position: int) -> RawLog:
    """Whole numbers up to ``force`` and ``position`` at the peaks."""
    return replace(
        log,
        force=np.rint(log.force / np.max(np.abs(log.force)) * force),
        position=np.rint(log.position / np.max(np.abs(log.position)) * position),
    )


def dropped(log: RawLog, part: float, seed: int, gap: float = 0.0) -> RawLog:
    """Rows lost at random, and all rows of a gap of so many seconds in the middle."""
    keep = np.random.default_rng(seed).random(log.time.size) >= part
    keep[[0, -1]] = True
    middle = (log.time[0] + log.time[-1]) / 2
    return log.rows(keep & (np.abs(log.time - middle) > gap / 2))


def renumbered(log: RawLog, part: float, seed: int) -> RawLog:
    """Rows lost at random, the others numbered anew."""
    kept = dropped(log, part, seed)
    return replace(kept, time=log.time[: kept.time.size])


def repeated(log: RawLog, part: float, seed: int) -> RawLog:
    """Rows written twice at random, all numbered anew."""
    generator, count = np.random.default_rng(seed), log.time.size
    again = generator.choice(count, int(part * count), replace=False)
    rows = np.sort(np.append(np.arange(count), again))[:count]
    return replace(log, force=log.force[rows], position=log.position[rows])


def backward(log: RawLog, rows: int, by: float, seed: int) -> RawLog:
    """Stamps that go back by ``by`` s in so many rows; a clock set to 0 midway if that is none."""
    time = log.time.copy()
    if rows:
        place = np.random.default_rng(seed).choice(time.size - 2, rows, replace=False) + 1
        time[place] -= by
    else:
        time[time.size // 2 :] -= time[time.size // 2]
    return replace(log, time=time)


def wrapped(log: RawLog, span: float) -> RawLog:
    """Position as a counter reports it whose range is this part of the travel."""
    span = span * float(np.ptp(log.position))
    start = float(np.min(log.position)) - 0.05 * span
    return replace(log, position=start + np.mod(log.position - start, span))


def with_holes(log: RawLog, rows: int, seed: int, *, infinite: bool = False) -> RawLog:
    """Values that are missing in so many rows, of force and of position in turn."""
    place = np.random.default_rng(seed).choice(log.time.size, rows, replace=False)
    force, position = log.force.copy(), log.position.copy()
    force[place[::2]] = np.nan
    position[place[1::2]] = np.inf if infinite else np.nan
    return replace(log, force=force, position=position)


def weakened(log: RawLog, part: float) -> RawLog:
    """The actuator gives this part less, or more, of what is logged after two thirds of the log.

    The same motion under a logged force that is larger: every parameter changes by one factor.
    """
    later = np.arange(log.time.size) > 2 * log.time.size // 3
    return replace(log, force=np.where(later, log.force * (1 + part), log.force))
