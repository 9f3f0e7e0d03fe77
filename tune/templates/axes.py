"""The certified control law on all axes of a device, as the C guard of the same profile plays it.

    law = LawOfAxes(parameters)
    law.enter(["water"])                               # before its first force
    law.place("left", "wall", [1.0, 0.0], -0.05)       # free where normal·position is more
    force = law.force(["water"], ["left"], period, position)

Positions and forces are lists in one frame with right angles, the device's or any turned against
it: elements are the same in every direction, and a force that is cut keeps its own. Faces that are
given at once are parallel, or at right angles and of one wall.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from haptune_law import _WRAP, PROFILE, Axis, Element, Law, Status, _usable

if PROFILE != "${digest}":
    raise ImportError(f"haptune_law.py is of another profile, {PROFILE}: export both again")

#: Of a sum of squares to 1, and of a product of normals to 0 or 1.
_ROUNDING = 1e-9


@dataclass
class Face:
    """A plane at which a wall pushes along its normal, of length 1; ``wall`` is its own contact."""

    name: str
    normal: list[float]
    wall: Element


class LawOfAxes:
    """The force of a profile's elements on all axes; status and counts are those of a Law."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Take the parameters as a Law does."""
        self.names = tuple(parameters["axes"])
        self.one = Law(parameters)
        self.sample_time, self.extra_delay = self.one.sample_time, self.one.extra_delay
        self.axes = [copy.deepcopy(self.one.axis) for _ in self.names]
        self.faces: dict[str, Face] = {}
        self.stop()
        self.status = Status.OK
        self.missed = self.glitches = self.waiting = 0
        self.clamped = False

    def enter(self, elements: Collection[str]) -> Status:
        """Before elements that are no walls give their first force."""
        known = self.one.elements.keys() - self.one.walls
        chosen = [self.one.elements[name] for name in elements if name in known]
        self.status = Status.OK
        if len(chosen) < len(elements):
            self.status = Status.NOT_TOGETHER
        elif any(each.spring and each.force != 0.0 for each in chosen):
            self.status = Status.PUSHING
        else:
            for each in chosen:
                each.entered, each.wanted = True, False
                each.level = 0.0 if each.spring else each.level
        return self.status

    def place(self, face: str, wall: str, normal: Sequence[float], offset: float) -> Status:
        """Where a face stands; a new name is a new face.

        What is not certified beside faces that are wanted leaves all as it was, as does a face
        that pushes; after a normal of another length, or no number, the face has no place.
        """
        before = self.faces.get(face)
        self.status = Status.OK
        if wall not in self.one.walls or len(normal) != len(self.names):
            self.status = Status.NOT_TOGETHER
        elif before is not None and before.wall.force != 0.0:
            self.status = Status.PUSHING
        elif not all(map(_usable, (*normal, offset))):
            self.status = Status.NOT_FINITE
        elif abs(_product(normal, normal) - 1.0) > _ROUNDING:
            self.status = Status.NO_SIDE
        if self.status in (Status.NOT_FINITE, Status.NO_SIDE):
            self.faces.pop(face, None)
        if self.status is not Status.OK:
            return self.status
        element = copy.copy(self.one.elements[wall])
        element.end()
        element.entered, element.side, element.face = True, 1, float(offset)
        self.faces[face] = Face(wall, [float(each) for each in normal], element)
        wanted = [name for name, each in self.faces.items() if each.wall.wanted]
        self.status = self._fitting((), {*wanted, face})
        if self.status is not Status.OK:
            del self.faces[face]
            if before is not None:
                self.faces[face] = before
        return self.status

    def force(
        self,
        elements: Collection[str],
        faces: Collection[str],
        period: int,
        position: Sequence[float],
        gain: float = 1.0,
    ) -> list[float]:
        """Force, N (N*m), of each axis; every period, as Law.force, with faces near or far."""
        steps = (period - self.axes[0].period) % _WRAP if self.axes[0].started else 1
        self.clamped, self.status = False, self._read(steps, period, position)
        if self.status is Status.LATE:
            return self.stop()
        if self.status is not Status.OK:
            return list(self.last_force)
        wanted, planes = set(elements), set(faces)
        fault = self._fault(wanted, planes, gain)
        if fault is not Status.OK:
            return self._none(fault)
        acting = {name for name, each in self.one.elements.items() if each.level > 0.0}
        fading = {name for name in acting if self.one.elements[name].fade < 1.0}
        closing = {
            name for name, each in self.faces.items() if each.wall.level > 0 and each.wall.fade < 1
        }
        if self._fitting(wanted | fading, planes | closing) is not Status.OK:
            wanted &= acting
            if self._fitting(wanted | fading, planes | closing) is not Status.OK:
                return self._none(Status.NOT_TOGETHER)
            self.status = Status.WAITING
        self._act(wanted, planes, gain, steps)
        parts = [*self.forces.values()]
        parts += [[each.wall.force * part for part in each.normal] for each in self.faces.values()]
        total = [math.fsum(sums) for sums in zip(*parts, strict=True)]
        if not all(map(_usable, total)):
            return self._none(Status.NOT_FINITE)
        played = [*self.one.elements.values(), *(each.wall for each in self.faces.values())]
        over = math.sqrt(_product(total, total)) > self.one.peak
        self.clamped = over or any(each.at_limit for each in played)
        self.last_force, _ = _shortened(total, self.one.peak)
        return list(self.last_force)

    def stop(self) -> list[float]:
        """No force; every contact and face ends, as nothing came for too long."""
        self.faces.clear()
        for each in self.one.elements.values():
            each.end()
        self.rests = {name: [0.0] * len(self.names) for name in self.one.elements}
        return self._none(Status.LATE)

    def _act(self, wanted: set[str], planes: set[str], gain: float, steps: int) -> None:
        taps, pushing = self.one.taps, False
        for fades in (False, True):  # what fades stands still while a wall pushes
            for name, face in self.faces.items():
                if (face.wall.fade < 1.0) == fades:
                    change = 0.0 if pushing else face.wall.fade * steps
                    asked = gain if name in planes else 0.0
                    axis = _Along(self.axes, face.normal)
                    face.wall.act(axis, asked=asked, change=change, taps=taps)
                    pushing = pushing or face.wall.force != 0.0
            for name, each in self.one.elements.items():
                if name not in self.one.walls and (each.fade < 1.0) == fades:
                    change = 0.0 if pushing else each.fade * steps
                    self._act_all(name, each, gain if name in wanted else 0.0, change)

    def _act_all(self, name: str, each: Element, asked: float, change: float) -> None:
        """One element that is the same in every direction."""
        enters = asked > 0.0 and not each.wanted and each.level == 0.0
        if enters and each.spring:
            self.rests[name] = [axis.last for axis in self.axes]
            each.quiet = 0
        u = [
            (each.stiffness * (axis.last - rest) + each.damping * axis.velocity.now)
            + each.mass * axis.acceleration.now
            for axis, rest in zip(self.axes, self.rests[name], strict=True)
        ]
        u, length = _shortened(u, each.force_level if each.spring else math.inf)
        each.quiet = min(each.quiet + 1, self.one.taps) if length == 0.0 else 0
        each.turn(may_rise=enters or each.quiet >= self.one.taps, asked=asked, change=change)
        each.force = each.level * length
        self.forces[name] = [-(each.level * part) if each.level > 0.0 else 0.0 for part in u]

    def _read(self, steps: int, period: int, position: Sequence[float]) -> Status:
        """Use the readings of all axes; where it is not OK, none was used for any force."""
        axes, fault = self.axes, Status.OK
        started = axes[0].started
        gap = started and steps - 1 > self.one.extra_delay
        if len(position) != len(axes) or not all(map(_usable, position)):
            fault = Status.NOT_FINITE
        elif started and steps == 0:
            fault = Status.STALE
        elif started and not gap:
            pairs = zip(axes, position, strict=True)
            if not all(axis.plausible(steps, place) for axis, place in pairs):
                fault = Status.GLITCH
                self.glitches += 1
        if fault is not Status.OK:
            self.waiting += 1
            late = self.waiting > self.one.extra_delay or steps > self.one.extra_delay
            return Status.LATE if started and late else fault
        for axis, place in zip(axes, position, strict=True):
            if started and not gap:
                axis.bridge(steps, place)
            else:
                slope = (place - axis.last) / (self.one.sample_time * steps) if gap else 0.0
                axis.start(period % _WRAP, place, slope)
        self.missed += 0 if gap else steps - 1
        self.waiting = 0
        return Status.LATE if gap else Status.OK

    def _fault(self, wanted: set[str], planes: set[str], gain: float) -> Status:
        entered = all(each.entered for name, each in self.one.elements.items() if name in wanted)
        if not entered or not planes <= self.faces.keys():
            return Status.NOT_ENTERED
        return self._fitting(wanted, planes) if 0.0 <= gain <= 1.0 else Status.BAD_GAIN

    def _fitting(self, elements: Collection[str], planes: Collection[str]) -> Status:
        """Whether faces and elements may act at once."""
        if not self.one.certified(elements):
            return Status.NOT_TOGETHER
        chosen = [self.faces[name] for name in sorted(planes)]
        for here in chosen:
            ahead = {*elements, here.name}
            for there in chosen:
                turned = _product(here.normal, there.normal)
                if there is here:
                    continue
                if abs(turned) <= _ROUNDING or turned >= 1.0 - _ROUNDING:
                    # Two laws at right angles, or one law twice.
                    if (turned > 0.5) == (here.name == there.name):
                        return Status.NOT_TOGETHER
                    ahead |= {there.name} if turned > 0.5 else set()
                elif turned > _ROUNDING - 1.0:
                    return Status.NOT_SQUARE
                else:
                    opposite = dataclasses.replace(there.wall, face=-there.wall.face, side=-1)
                    if here.wall.crowds(here.wall.face, 1, opposite):
                        return Status.TOO_NARROW
            if not self.one.certified(ahead):
                return Status.NOT_TOGETHER
        return Status.OK

    def _none(self, reason: Status) -> list[float]:
        for each in (*self.one.elements.values(), *(face.wall for face in self.faces.values())):
            each.wanted, each.level, each.force = False, 0.0, 0.0
        self.forces = {name: [0.0] * len(self.names) for name in self.one.elements}
        self.status, self.last_force = reason, [0.0] * len(self.names)
        return list(self.last_force)


@dataclass
class _Value:
    now: float


class _Along:
    """Position, velocity and acceleration along a normal."""

    def __init__(self, axes: Sequence[Axis], normal: Sequence[float]) -> None:
        self.last = _product(normal, [axis.last for axis in axes])
        self.velocity = _Value(_product(normal, [axis.velocity.now for axis in axes]))
        self.acceleration = _Value(_product(normal, [axis.acceleration.now for axis in axes]))


def _product(one: Sequence[float], other: Sequence[float]) -> float:
    return math.fsum(a * b for a, b in zip(one, other, strict=True))


def _shortened(vector: Sequence[float], most: float) -> tuple[list[float], float]:
    """A vector of at most this length in its direction, and its length then."""
    length = math.sqrt(_product(vector, vector))
    if not length > most:
        return list(vector), length
    return [part * (most / length) for part in vector], most
