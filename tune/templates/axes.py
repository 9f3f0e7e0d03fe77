"""The certified control law on all axes of a device, as the C guard of the same profile plays it.

    law = LawOfAxes(parameters)
    law.enter(["water"])                               # before its first force
    law.place("left", "wall", [1.0, 0.0], -0.05)       # free where normal·position is more
    force = law.force(["water"], ["left"], period, position)

Positions and forces are lists in one frame with right angles, the device's or any turned against
it: elements are the same in every direction, and a force that is cut keeps its own. All faces of a
wall that are given at once leave one convex room; those of several walls are parallel.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from haptune_law import PROFILE, Element, Elements, Status, _usable

if PROFILE != "${digest}":
    raise ImportError(f"haptune_law.py is of another profile, {PROFILE}: export both again")

#: Of a sum of squares to 1, and of a product of normals to -1 or 1.
_ROUNDING = 1e-9
#: By less than this part of all that it is made of nothing is beyond a face.
_SMALL = 1e-12
#: So much shorter that no rounding lets a vector be longer than it may be.
_SHORTER = 1.0 - 2.0**-49
#: Faces that are taken up or left on the way to the nearest point.
_MOST_TRIES = 128


@dataclass
class Face:
    """A plane at which a wall pushes along its normal, of length 1.

    It is to stand at ``offset`` and does at ``rest``; ``clear`` counts samples in a row without
    force where it is to stand.
    """

    wall: str
    normal: list[float]
    offset: float
    rest: float
    acting: bool = False
    pushing: bool = False
    clear: int = 0


class LawOfAxes(Elements):
    """The force of a profile's elements on all axes; status and counts are those of a Law."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Take the parameters as a Law does."""
        super().__init__(parameters, axes=len(parameters["axes"]))
        self.faces: dict[str, Face] = {}
        self.stop()
        self.status = Status.OK

    def enter(self, elements: Collection[str]) -> Status:
        """Before elements that are no walls give their first force."""
        known = self.elements.keys() - self.walls
        chosen = [self.elements[name] for name in elements if name in known]
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
        if wall not in self.walls or len(normal) != len(self.axes):
            self.status = Status.NOT_TOGETHER
        elif before is not None and before.pushing:
            self.status = Status.PUSHING
        elif not all(map(_usable, (*normal, offset))):
            self.status = Status.NOT_FINITE
        elif abs(_product(normal, normal) - 1.0) > _ROUNDING:
            self.status = Status.NO_SIDE
        if self.status in (Status.NOT_FINITE, Status.NO_SIDE):
            self.faces.pop(face, None)
        if self.status is not Status.OK:
            return self.status
        self.faces[face] = Face(wall, list(map(float, normal)), float(offset), float(offset))
        wanted = [name for name, each in self.faces.items() if each.acting]
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
        steps = self._read(period, position)
        if self.status is Status.LATE:
            return self.stop()
        if self.status is not Status.OK:
            return list(self.last_force)
        planes = set(faces)
        if not planes <= self.faces.keys():
            return self._no_force(Status.NOT_ENTERED)
        wanted = self._allowed(elements, gain, partial(self._fitting, planes=planes))
        if self.status not in (Status.OK, Status.WAITING):
            return self._no_force(self.status)
        self._act(wanted, planes, gain, steps)
        total = [math.fsum(sums) for sums in zip(*self.forces.values(), strict=True)]
        if not all(map(_usable, total)):
            return self._no_force(Status.NOT_FINITE)
        over = math.sqrt(_product(total, total)) > self.peak
        self.clamped = over or any(each.at_limit for each in self.elements.values())
        self.last_force, _ = _shortened(total, self.peak)
        return list(self.last_force)

    def stop(self) -> list[float]:
        """No force; every contact and face ends, as nothing came for too long."""
        self.faces.clear()
        for each in self.elements.values():
            each.end()
        self.rests = {name: [0.0] * len(self.axes) for name in self.elements}
        return self._no_force(Status.LATE)

    def _act(self, wanted: Collection[str], planes: set[str], gain: float, steps: int) -> None:
        """All go on by a reading: walls, what else is switched, and then what fades."""
        pushing = False
        order = sorted(
            self.elements.items(), key=lambda pair: (pair[0] not in self.walls, pair[1].fade < 1.0)
        )
        for name, each in order:
            own = {face for face in planes if gain > 0.0 and self.faces[face].wall == name}
            asked = gain if own or name in wanted else 0.0
            self._act_on(name, each, own, asked, 0.0 if pushing else each.fade * steps)
            pushing = pushing or (name in self.walls and each.force != 0.0)

    def _act_on(
        self, name: str, each: Element, faces: set[str], asked: float, change: float
    ) -> None:
        """One element that is the same in every direction, or a wall at a set of its faces."""
        enters = asked > 0.0 and not each.wanted and each.level == 0.0
        wall = name in self.walls
        if enters and each.spring:
            self.rests[name] = [0.0 if wall else axis.last for axis in self.axes]
            each.quiet = 0
        u = [
            (each.stiffness * (axis.last - rest) + each.damping * axis.velocity.now)
            + each.mass * axis.acceleration.now
            for axis, rest in zip(self.axes, self.rests[name], strict=True)
        ]
        if wall:
            free = self._left_free(name, each.stiffness, faces, u)
            u = [part - there for part, there in zip(u, free, strict=True)]
        u, length = _shortened(u, each.force_level if each.spring else math.inf)
        each.quiet = min(each.quiet + 1, self.taps) if length == 0.0 else 0
        each.turn(may_rise=enters or each.quiet >= self.taps, asked=asked, change=change)
        each.force = each.level * length
        self.forces[name] = [-(each.level * part) if each.level > 0.0 else 0.0 for part in u]

    def _left_free(
        self, wall: str, stiffness: float, faces: set[str], u: list[float]
    ) -> list[float]:
        """The place nearest to u in the room of a wall's faces, times its stiffness.

        New faces come without more force: where the device is behind one, or where what pushes
        leaves it, it rests there, until it has given no force where it is to stand for some time.
        """
        for name, face in self.faces.items():
            if face.wall == wall:
                face.acting, face.pushing = face.acting and name in faces, False
        chosen = [face for name, face in self.faces.items() if name in faces]
        before = [face for face in chosen if face.acting]
        free = _project(before, [stiffness * each.rest for each in before], u)
        fresh = [face for face in chosen if not face.acting]
        for face in fresh:
            there = _product(face.normal, [axis.last for axis in self.axes])
            face.rest = min(there, face.offset)
            if free != u:
                face.rest = min(face.rest, _product(face.normal, free) / stiffness)
            face.acting, face.clear = True, 0
        if fresh:
            free = _project(chosen, [stiffness * each.rest for each in chosen], u)
        size = math.sqrt(_product(u, u))
        for face in chosen:
            there, limit = _product(face.normal, free), stiffness * face.rest
            clear = there >= stiffness * face.offset
            face.clear = min(face.clear + 1, self.taps) if clear else 0
            face.rest = face.offset if face.clear >= self.taps else face.rest
            face.pushing = free != u and there - limit <= _SMALL * (size + abs(limit))
        return free

    def _fitting(self, elements: Collection[str], planes: Collection[str]) -> Status:
        """Whether faces and elements may act at once: walls along one line, each with some room."""
        if not self.certified(elements):
            return Status.NOT_TOGETHER
        chosen = [face for name, face in self.faces.items() if name in planes]
        for here in chosen:
            ahead = {*elements, here.wall}
            for there in chosen:
                turned = _product(here.normal, there.normal)
                if there.wall == here.wall:
                    continue
                if turned >= 1.0 - _ROUNDING:
                    ahead.add(there.wall)
                elif turned > _ROUNDING - 1.0:
                    return Status.NOT_TOGETHER
                elif self._crowds(here, there):
                    return Status.TOO_NARROW
            if not self.certified(ahead):
                return Status.NOT_TOGETHER
            own = [face for face in chosen if face.wall == here.wall]
            nowhere = [0.0] * len(self.axes)
            if own[0] is here and not _project(own, [each.offset for each in own], nowhere):
                return Status.TOO_NARROW
        return Status.OK

    def _crowds(self, here: Face, there: Face) -> bool:
        """Whether faces of two walls that push towards each other leave too little room."""
        other = copy.copy(self.elements[there.wall])
        other.side, other.face = -1, -there.offset
        return self.elements[here.wall].crowds(here.offset, 1, other)

    def _no_force(self, reason: Status) -> list[float]:
        self._end(reason)
        for face in self.faces.values():
            face.acting = face.pushing = False
        self.forces = {name: [0.0] * len(self.axes) for name in self.elements}
        self.last_force = [0.0] * len(self.axes)
        return list(self.last_force)


def _project(faces: Sequence[Face], limits: Sequence[float], start: Sequence[float]) -> list[float]:
    """The nearest point that is within limits along the normals of faces; [] where there is none.

    The dual active set method of Goldfarb and Idnani, Mathematical Programming 27, 1983.
    """
    point, pushes = list(start), [0.0] * len(faces)
    held: list[int] = []
    following: int | None = None
    size = math.sqrt(_product(start, start))
    for _ in range(_MOST_TRIES):
        if following is None:
            beyond = [
                0.0 if place in held else limits[place] - _product(face.normal, point)
                for place, face in enumerate(faces)
            ]
            least = [_SMALL * (size + abs(limit)) for limit in limits]
            found = [place for place, far in enumerate(beyond) if far > least[place]]
            if not found:
                return point
            following = max(found, key=beyond.__getitem__)
        normal = faces[following].normal
        square, parts = _beside([faces[place].normal for place in held], normal)
        step, dropped = math.inf, -1
        for place, part in enumerate(parts):
            if part > 0.0 and pushes[held[place]] < step * part:
                step, dropped = pushes[held[place]] / part, place
        if len(held) < len(start) and square > _SMALL:
            whole = (limits[following] - _product(normal, point)) / square
            if whole <= step:
                step, dropped = whole, -1
        elif dropped < 0:
            return []
        for place, part in zip(held, parts, strict=True):
            pushes[place] -= step * part
        pushes[following] += step
        if dropped < 0:
            held.append(following)
            following = None
        else:
            pushes[held[dropped]] = 0.0
            held[dropped] = held[-1]
            held.pop()
        moved = [(push, face.normal) for push, face in zip(pushes, faces, strict=True) if push]
        point = [
            part + math.fsum(push * normal[axis] for push, normal in moved)
            for axis, part in enumerate(start)
        ]
    return point


def _beside(
    normals: Sequence[Sequence[float]], vector: Sequence[float]
) -> tuple[float, list[float]]:
    """Of what is left of a vector beside independent normals the square, and the part of each."""
    left, basis = list(vector), list[list[float]]()
    upper, parts = list[list[float]](), list[float]()
    for normal in normals:
        rest, row = list(normal), list[float]()
        for each in basis:
            row.append(_product(each, rest))
            rest = [a - row[-1] * b for a, b in zip(rest, each, strict=True)]
        row.append(math.sqrt(_product(rest, rest)))
        basis.append([part / row[-1] for part in rest])
        upper.append(row)
        parts.append(_product(basis[-1], left))
        left = [a - parts[-1] * b for a, b in zip(left, basis[-1], strict=True)]
    for one in reversed(range(len(parts))):
        for other in range(one + 1, len(parts)):
            parts[one] -= upper[other][one] * parts[other]
        parts[one] /= upper[one][one]
    return _product(left, left), parts


def _product(one: Sequence[float], other: Sequence[float]) -> float:
    return math.fsum(a * b for a, b in zip(one, other, strict=True))


def _shortened(vector: Sequence[float], most: float) -> tuple[list[float], float]:
    """A vector of at most this length in its direction, and its length then."""
    length = math.sqrt(_product(vector, vector))
    if not length > most * _SHORTER:
        return list(vector), length
    return [part * (most * _SHORTER / length) for part in vector], most
