"""Worst motion: how far and how fast a planned force may move any device of a box.

Many devices are stepped at once, in the closed form of stick_slip.py between two turns of the
velocity. A net force F/m moves a lighter device further at the same b/m, so the farthest device of
a box of mass and damping lies where either is least: only these two sides are looked at, each in
levels of equal ratio, with friction in levels and a constant force at both ends. One file: the
region, its levels and the motion of each corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.device.quantities import Quantity
from identification.planning.response import step_response
from identification.planning.spec import ExcitationSpec
from identification.planning.stick_slip import Guess

FloatArray = NDArray[np.float64]

#: Mass and damping may be this many times what was guessed, or this part of it.
WRONG = 2.0
#: An unplanned constant force, as part of the force limit: what a cable, a tilt of a degree or the
#: bias of an amplifier makes.
UNPLANNED = (0.01, 0.02)
#: Levels on a side of the box of mass and damping, and of friction.
_LEVELS = 7
_FRICTIONS = 4
#: Between the levels a device may go this much farther.
BETWEEN = 1.01
#: Below this b·t/m series stand in for the exponential.
_SERIES_BELOW = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstMotion:
    """Farthest and fastest motion of a set of devices under one force.

    Attributes:
        name: of the set: "stated", "twice", "unplanned-1", "unplanned-2" or "both".
        words: what the devices have in common.
        travel: largest distance from the start, either way, m (rad).
        speed: m/s (rad/s).
    """

    name: str
    words: str
    travel: float
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A box of devices: (low, high) of each quantity, SI."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    friction: tuple[float, float]
    offset: tuple[float, float]

    @classmethod
    def stated(cls, spec: ExcitationSpec) -> Region:
        """The intervals of the guesses."""
        return cls(
            mass=_ends(spec.mass),
            damping=_ends(spec.damping),
            friction=_ends(spec.coulomb_friction),
            offset=_ends(spec.force_offset),
        )

    def wrong(self, spec: ExcitationSpec, factor: float) -> Region:
        """Wide enough for guesses of mass and damping that are wrong by a factor, either way."""
        return Region(
            mass=_either_way(self.mass, spec.mass.value, factor),
            damping=_either_way(self.damping, spec.damping.value, factor),
            friction=self.friction,
            offset=self.offset,
        )

    def pulled(self, force: float) -> Region:
        """With a constant force of this size either way that nobody planned for, N."""
        low, high = self.offset
        return Region(
            mass=self.mass,
            damping=self.damping,
            friction=self.friction,
            offset=(low - force, high + force),
        )

    def devices(self) -> list[Guess]:
        """The devices that may go farthest."""
        masses = _levels(*self.mass, _LEVELS)
        dampings = _levels(*self.damping, _LEVELS)
        pairs = {(masses[0], damping) for damping in dampings}
        pairs |= {(mass, dampings[0]) for mass in masses}
        low, high = self.friction
        frictions: list[float] = np.unique(np.linspace(low, high, _FRICTIONS)).tolist()
        return [
            Guess(mass=mass, damping=damping, coulomb_friction=friction, force_offset=offset)
            for mass, damping in sorted(pairs)
            for friction in frictions
            for offset in sorted(set(self.offset))
        ]


def worst_motions(spec: ExcitationSpec, force: FloatArray) -> tuple[WorstMotion, ...]:
    """Worst travel and speed of a force over the devices that a user may really have.

    Args:
        spec: limits and guesses it was planned for.
        force: N (N·m), shape (n,), the last row zero.
    """
    regions = list(_regions(spec))
    devices = [region.devices() for _, _, region in regions]
    every = list(dict.fromkeys(device for some in devices for device in some))
    place = {device: index for index, device in enumerate(every)}
    reach, speed = extremes(force[:-1], every, spec.sample_time)
    found: list[WorstMotion] = []
    for (name, words, _), some in zip(regions, devices, strict=True):
        index = [place[device] for device in some]
        spread = BETWEEN if len(some) > 1 else 1.0
        found.append(
            WorstMotion(
                name=name,
                words=words,
                travel=spread * float(np.max(reach[index])),
                speed=spread * float(np.max(speed[index])),
            )
        )
    return tuple(found)


def _regions(spec: ExcitationSpec) -> Iterator[tuple[str, str, Region]]:
    stated = Region.stated(spec)
    unit = "N" if spec.motion == "linear" else "N·m"
    yield "stated", "the guesses as stated", stated
    twice = stated.wrong(spec, WRONG)
    yield "twice", f"mass and damping guessed {WRONG:g} times wrong, either way", twice
    for part in UNPLANNED:
        force = part * spec.force
        words = f"an unplanned constant force of {part:.0%} of the limit, {force:.3g} {unit}"
        yield f"unplanned-{100 * part:g}", words, stated.pulled(force)
    yield (
        "both",
        f"guessed {WRONG:g} times wrong and pulled by {max(UNPLANNED):.0%}",
        twice.pulled(max(UNPLANNED) * spec.force),
    )


def extremes(force: FloatArray, devices: list[Guess], step: float) -> tuple[FloatArray, FloatArray]:
    """Largest |position| and |velocity| at the samples of many devices, from zero and rest.

    Args:
        force: N (N·m), shape (n,), each held for a step.
        devices: d of them.
        step: s.

    Returns:
        Reach, m (rad), and speed, m/s (rad/s), each of shape (d,).
    """
    mass = np.array([each.mass for each in devices])
    rate = np.array([each.rate for each in devices])
    grip = np.array([each.coulomb_friction for each in devices]) / mass
    offset = np.array([each.force_offset for each in devices])
    coast, fall = (
        np.array(part) for part in zip(*(_push(each.rate, step) for each in devices), strict=True)
    )
    decay = 1 - rate * coast
    place, speed = np.zeros(mass.size), np.zeros(mass.size)
    reach, fastest = np.zeros(mass.size), np.zeros(mass.size)
    for each in force.tolist():
        drive = (each - offset) / mass
        sense = np.sign(np.where(speed == 0, drive, speed))
        # At rest friction takes as much as it can, never more than there is.
        net = np.where((speed == 0) & (np.abs(drive) <= grip), 0.0, drive - grip * sense)
        later = decay * speed + coast * net
        after = place + coast * speed + fall * net
        turned = np.flatnonzero(later * sense < 0)
        if turned.size:
            after[turned], later[turned] = _turn(
                place[turned],
                speed[turned],
                net[turned],
                drive[turned],
                grip[turned],
                rate[turned],
                step,
            )
        place, speed = after, later
        np.maximum(reach, np.abs(place), out=reach)
        np.maximum(fastest, np.abs(speed), out=fastest)
    return reach, fastest


def _turn(
    place: FloatArray,
    speed: FloatArray,
    net: FloatArray,
    drive: FloatArray,
    grip: FloatArray,
    rate: FloatArray,
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity after a step in which the velocity comes to zero."""
    ratio = -speed / net
    part = rate * ratio
    small = part < _SERIES_BELOW
    before = ratio * np.where(
        small, 1 - part / 2 + part**2 / 3, np.log1p(part) / np.where(small, 1.0, part)
    )
    before = np.minimum(before, step)
    near, far = _pushes(rate, before)
    place = place + near * speed + far * net
    onward = np.where(np.abs(drive) <= grip, 0.0, drive - grip * np.sign(drive))
    near, far = _pushes(rate, step - before)
    return place + far * onward, near * onward


def _pushes(rate: FloatArray, span: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity and position after a unit force per mass for ``span`` s, from rest."""
    delta = rate * span
    small = delta < _SERIES_BELOW
    safe = np.where(small, 1.0, delta)
    first = np.where(small, 1 - delta / 2 + delta**2 / 6, -np.expm1(-safe) / safe)
    second = np.where(small, 0.5 - delta / 6 + delta**2 / 24, (1 - first) / safe)
    return span * first, span**2 * second


def _push(rate: float, span: float) -> tuple[float, float]:
    near, far = step_response(rate, span)
    return near.real, far.real


def _ends(guess: Quantity) -> tuple[float, float]:
    return guess.low, guess.high


def _either_way(ends: tuple[float, float], value: float, factor: float) -> tuple[float, float]:
    return min(ends[0], value / factor), max(ends[1], value * factor)


def _levels(low: float, high: float, count: int) -> list[float]:
    """From low to high, evenly in octaves where neither is zero."""
    if low == high:
        return [low]
    values = np.geomspace(low, high, count) if low > 0 else np.linspace(low, high, count)
    return [low, *values[1:-1].tolist(), high]
