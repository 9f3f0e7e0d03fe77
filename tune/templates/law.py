"""The certified control law of haptune_params.yaml in plain Python: nothing to install.

    law = Law(parameters)                         # at rest; names as "elements.wall.mass"
    law.reset(["wall"], rest=0.0, side=1)         # before its first force: its face
    force = law.force(["wall"], period, position) # every period; a wall knows when to push

SI units. It plays what the C guard of the same profile plays. Python may pause for longer than a
period: what is missed is bridged, and more than is certified ends every contact. One file: a
program that is copied to a controller as it is.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

#: The profile that this file was written from.
PROFILE = "${digest}"

_WRAP = 2**32
#: No reading, face or sum of forces is as large.
_ENDLESS = 2.0**64
#: m/s or m/s^2 (rad): far below the rounding of any reading.
_VANISHED = 1e-30


class Status(enum.Enum):
    """What the last call came to."""

    OK = "ok"
    WAITING = "not certified with what still fades out: what is new waits for that, but for walls"
    NOT_TOGETHER = "this set, with what still fades out, is not certified as a sum"
    NOT_ENTERED = "no reset since the start, or since contacts were ended"
    NO_SIDE = "a wall that pushes only was given no side"
    NOT_FINITE = "a reading, or what comes out, is no finite number below 2^64"
    BAD_GAIN = "gain is not in [0, 1]"
    STALE = "the reading of this period was used before"
    GLITCH = "the device cannot have moved so far: the reading is not used"
    LATE = "more periods missed than are certified: reset to go on"
    PUSHING = "from a reset, which did nothing: a spring gives force"
    TOO_NARROW = "walls that push towards each other overlap, or their dampers do"


@dataclass
class LowPass:
    """x[k] = (t*x[k-1] - p*x[k-2]) + g*u[k]; what stands still comes to be 0."""

    t: float = 0.0
    p: float = 0.0
    g: float = 1.0
    now: float = 0.0
    before: float = 0.0

    def take(self, value: float) -> float:
        """Run on by one sample."""
        output = (self.t * self.now - self.p * self.before) + self.g * value
        self.before, self.now = self.now, output
        if abs(output) < _VANISHED and abs(self.before) < _VANISHED:
            self.before = self.now = 0.0
        return self.now


@dataclass
class Filter:
    """Two low-passes, one after the other, then x[k] + lead*(x[k] - x[k-1])."""

    first: LowPass
    then: LowPass
    lead: float
    now: float = 0.0

    def start(self, value: float) -> None:
        """As if the input had been this for long."""
        for each in (self.first, self.then):
            each.now = each.before = value
        self.now = value

    def take(self, value: float) -> None:
        """Run on by one sample."""
        output = self.then.take(self.first.take(value))
        self.now = output + self.lead * (output - self.then.before)


@dataclass
class Element:
    """Effects, and how the element is played; ``fade`` is its change in a period.

    ``face`` is where its spring is to rest, ``rest`` where it does; ``quiet`` and ``clear`` count
    samples in a row without force resting there and at its face.
    """

    stiffness: float
    damping: float
    mass: float
    force_level: float
    speed: float
    one_sided: bool
    fade: float
    entered: bool = False
    wanted: bool = False
    side: int = 0
    face: float = 0.0
    rest: float = 0.0
    level: float = 0.0
    force: float = 0.0
    quiet: int = 0
    clear: int = 0

    @property
    def spring(self) -> bool:
        """Whether it has a clamp."""
        return self.stiffness > 0.0

    @property
    def at_limit(self) -> bool:
        """Whether its spring is cut."""
        most = self.level * self.force_level
        return self.spring and self.force != 0.0 and abs(self.force) >= most

    @property
    def lead_time(self) -> float:
        """By which its damper is before its spring, s."""
        return self.damping / self.stiffness if self.spring else 0.0

    def end(self) -> None:
        """No force, until it is entered again."""
        self.entered = self.wanted = False
        self.level = self.force = 0.0

    def act(self, axis: Axis, *, asked: float, change: float, taps: int) -> None:
        """Go on by a reading; asked: the level it is to have, change: how far it may fade."""
        enters = asked > 0.0 and not self.wanted and self.level == 0.0
        if enters and self.spring:
            inside = self.side * (self.face - axis.last)
            self.rest = self.face if self.one_sided and not inside > 0.0 else axis.last
            self.quiet = self.clear = 0
        at_face, u = self._clamped(axis, self.face), self._clamped(axis, self.rest)
        self.quiet = min(self.quiet + 1, taps) if u == 0.0 else 0
        self.clear = min(self.clear + 1, taps) if at_face == 0.0 else 0
        if self.one_sided and self.clear >= taps:
            self.rest = self.face
        self.turn(may_rise=enters or self.quiet >= taps, asked=asked, change=change)
        self.force = -(self.level * u) if self.level > 0.0 else 0.0

    def turn(self, *, may_rise: bool, asked: float, change: float) -> None:
        """Level goes to what is asked, as far as it may."""
        if self.fade < 1.0:
            nearer = self.level + change, self.level - change
            self.level = min(nearer[0], asked) if self.level < asked else max(nearer[1], asked)
        elif not self.spring or may_rise or asked < self.level:
            self.level = asked
        self.wanted = asked > 0.0

    def crowds(self, face: float, side: int, other: Element) -> bool:
        """Whether, standing there, it and another are neither one clamp nor clear of each other."""
        here, there = self.lead_time, other.lead_time
        alike = abs(here - there) <= 1e-9 * max(here, there)
        lead = 0.0 if alike else here * self.speed + there * other.speed
        return other.side == -side and not side * (other.face - face) >= lead

    def _clamped(self, axis: Axis, rest: float) -> float:
        """K*(y - rest) + B*v + M*a; what is no number stays none."""
        u = (
            self.stiffness * (axis.last - rest) + self.damping * axis.velocity.now
        ) + self.mass * axis.acceleration.now
        low = 0.0 if self.one_sided and self.side < 0 else -self.force_level
        high = 0.0 if self.one_sided and self.side > 0 else self.force_level
        if not self.spring:
            return u
        return low if u < low else high if u > high else u


@dataclass
class Axis:
    """Velocity and acceleration of the axis; they run on whether or not anything is touched."""

    sample_time: float
    window: int
    velocity: Filter
    acceleration: Filter
    largest_change: float
    started: bool = False
    period: int = 0
    past: list[float] = field(default_factory=list[float])
    last: float = 0.0
    slope: float = 0.0
    earlier: float = 0.0
    earlier_slope: float = 0.0

    def start(self, period: int, position: float, slope: float) -> None:
        """As if the device had moved at this slope until now."""
        self.started, self.period = True, period
        self.past = [
            position - (self.window - 1 - place) * slope * self.sample_time
            for place in range(self.window)
        ]
        self.last, self.slope = position, slope
        self.earlier, self.earlier_slope = position - slope * self.sample_time, slope
        self.velocity.start(slope)
        self.acceleration.start(0.0)

    def bridge(self, steps: int, position: float) -> None:
        """Along the straight line to a reading that is some periods after the last one."""
        before = self.last
        for step in range(1, steps):
            self._take(before + (position - before) * step / steps)
        self._take(position)
        self.period = (self.period + steps) % _WRAP

    def plausible(self, steps: int, position: float) -> bool:
        """Whether a device that went on straight, from this reading or the last, could be there."""
        later, most = self.sample_time * steps, self.largest_change * steps
        line = self.last + self.slope * later
        earlier_line = self.earlier + self.earlier_slope * (later + self.sample_time)
        return abs(position - line) <= most or abs(position - earlier_line) <= most

    def _take(self, position: float) -> None:
        slope = (position - self.last) / self.sample_time
        self.velocity.take((position - self.past[0]) / (self.window * self.sample_time))
        self.acceleration.take((slope - self.slope) / self.sample_time)
        self.past = [*self.past[1:], position]
        self.earlier, self.earlier_slope = self.last, self.slope
        self.last, self.slope = position, slope


class Elements:
    """Elements of a profile and readings of axes, as laws of one axis and of several have them.

    After each call ``status`` says what it came to, ``clamped`` whether the force was cut;
    ``missed`` counts periods bridged, ``glitches`` readings that could not be and were not used.
    """

    def __init__(self, parameters: Mapping[str, Any], axes: int = 1) -> None:
        """Take the parameters by their full names, such as "elements.wall.stiffness".

        Raises ValueError for those of another profile, and for nested ones.
        """
        if "force_limit.peak" not in parameters:
            raise ValueError(
                'parameters have no "force_limit.peak": give all by full names, none nested'
            )
        told = parameters.get("digest")
        if told != PROFILE:
            raise ValueError(
                f"parameters are of profile {told}, haptune_law.py of {PROFILE}: export both again"
            )
        self.sample_time = float(parameters["sample_time"])
        self.extra_delay = int(parameters["margin.extra_delay_samples"])
        self.peak = float(parameters["force_limit.peak"])
        self.names = tuple(parameters["element_names"])
        self.elements = {name: self._element(parameters, f"elements.{name}") for name in self.names}
        self.walls = frozenset(name for name, each in self.elements.items() if each.one_sided)
        self.groups = tuple(_sets(parameters, "together", "group_names"))
        self.apart = tuple(_sets(parameters, "apart", "pair_names"))
        self.taps = int(parameters["taps"])
        self.axes = [
            Axis(
                sample_time=self.sample_time,
                window=int(parameters.get("velocity.samples", 1)),
                velocity=_filter(parameters, "velocity"),
                acceleration=_filter(parameters, "acceleration"),
                largest_change=float(parameters["largest_change"]),
            )
            for _ in range(axes)
        ]
        self.status, self.clamped = Status.OK, False
        self.missed = self.glitches = self.waiting = 0

    def certified(self, elements: Collection[str]) -> bool:
        """Whether a set is certified as a sum, walls of it on one side."""
        chosen = frozenset(elements)
        parts = chosen - self.walls, chosen & self.walls
        return (
            chosen <= self.elements.keys()
            and not any(pair <= chosen for pair in self.apart)
            and all(len(part) <= 1 or any(part <= group for group in self.groups) for part in parts)
        )

    def _read(self, period: int, position: Sequence[float]) -> int:
        """Use a reading of each axis, or none of them for any force where it is not OK.

        Gives the periods since the last one that was used.
        """
        axes, started = self.axes, self.axes[0].started
        steps = (period - axes[0].period) % _WRAP if started else 1
        gap = started and steps - 1 > self.extra_delay
        self.clamped, self.status = False, Status.OK
        if len(position) != len(axes) or not all(map(_usable, position)):
            self.status = Status.NOT_FINITE
        elif started and steps == 0:
            self.status = Status.STALE
        elif started and not gap:
            pairs = zip(axes, position, strict=True)
            if not all(axis.plausible(steps, place) for axis, place in pairs):
                self.status = Status.GLITCH
                self.glitches += 1
        if self.status is not Status.OK:
            self.waiting += 1
            if started and (self.waiting > self.extra_delay or steps > self.extra_delay):
                self.status = Status.LATE
            return steps
        for axis, place in zip(axes, position, strict=True):
            if started and not gap:
                axis.bridge(steps, place)
            else:
                slope = (place - axis.last) / (self.sample_time * steps) if gap else 0.0
                axis.start(period % _WRAP, place, slope)
        self.missed += 0 if gap else steps - 1
        self.waiting = 0
        self.status = Status.LATE if gap else Status.OK
        return steps

    def _allowed(
        self, elements: Collection[str], gain: float, together: Callable[[Collection[str]], Status]
    ) -> Collection[str]:
        """Those that may act now with what still fades out; none where status is why."""
        wanted = frozenset(elements)
        acting = {name for name, each in self.elements.items() if each.level > 0.0}
        fading = {name for name in acting if self.elements[name].fade < 1.0}
        if not all(each.entered for name, each in self.elements.items() if name in wanted):
            self.status = Status.NOT_ENTERED
        else:
            self.status = together(wanted) if 0.0 <= gain <= 1.0 else Status.BAD_GAIN
        if self.status is Status.OK and together(wanted | fading) is not Status.OK:
            wanted &= acting | self.walls
            waits = together(wanted | fading) is Status.OK
            self.status = Status.WAITING if waits else Status.NOT_TOGETHER
        return wanted

    def _end(self, reason: Status) -> None:
        """No element gives force."""
        for each in self.elements.values():
            each.wanted, each.level, each.force = False, 0.0, 0.0
        self.status = reason

    def _element(self, parameters: Mapping[str, Any], place: str) -> Element:
        fade_time = float(parameters[f"{place}.fade_time"])
        return Element(
            stiffness=float(parameters[f"{place}.stiffness"]),
            damping=float(parameters[f"{place}.damping"]),
            mass=float(parameters[f"{place}.mass"]),
            force_level=float(parameters[f"{place}.force_level"]),
            speed=float(parameters[f"{place}.speed"]),
            one_sided=bool(parameters[f"{place}.one_sided"]),
            fade=min(1.0, self.sample_time / fade_time) if fade_time else 1.0,
        )


class Law(Elements):
    """The force of a profile's elements on one axis."""

    last_force = 0.0

    def reset(self, elements: Collection[str], rest: float, side: int = 0) -> Status:
        """Before elements give their first force, and when walls are to stand elsewhere.

        Args:
            elements: their names as in element_names.
            rest: m (rad), the face of a wall; other springs rest where they are entered.
            side: to which side walls push: above 0 towards growing positions, below 0 the other
                way; others take any.
        """
        side = (side > 0) - (side < 0)
        self.status = Status.OK
        if not set(elements) <= self.elements.keys():
            self.status = Status.NOT_TOGETHER
        elif not _usable(rest):
            self.status = Status.NOT_FINITE
        chosen = [self.elements[name] for name in self.names if name in elements]
        wall = any(each.one_sided for each in chosen)
        if self.status is Status.OK and side == 0 and wall:
            self.status = Status.NO_SIDE
        if self.status is not Status.OK:
            for each in chosen:
                each.end()
            return self.status
        others = [self.elements[name] for name in self.walls.difference(elements)]
        for each in chosen:
            if each.spring and each.force != 0.0:
                self.status = Status.PUSHING
            elif each.one_sided and any(
                other.wanted and each.crowds(rest, side, other) for other in others
            ):
                self.status = Status.TOO_NARROW
            if self.status is not Status.OK:
                return self.status
        for each in chosen:
            each.entered, each.wanted = True, False
            each.side, each.face = side, float(rest)
            each.level = 0.0 if each.spring else each.level
        return self.status

    def force(
        self, elements: Collection[str], period: int, position: float, gain: float = 1.0
    ) -> float:
        """Force, N (N*m), of a certified set of elements; every period, touched or not.

        Args:
            elements: what is touched, and walls wherever the device is; what leaves the set fades
                out first if it has to.
            period: number of the period in which the position was read, one more each period.
            position: m (rad), where the device was certified: at the encoder.
            gain: 0 to 1. It falls at once; that of a spring rises when it is entered, and otherwise
                after as many samples without force as there are taps.
        """
        steps = self._read(period, [position])
        if self.status is Status.LATE:
            return self.stop()
        if self.status is not Status.OK:
            return self.last_force
        wanted = self._allowed(elements, gain, self._together)
        if self.status not in (Status.OK, Status.WAITING):
            return self._no_force(self.status)
        slow = sorted(self.elements, key=lambda name: self.elements[name].fade < 1.0)
        for name in slow:  # after every wall
            each = self.elements[name]
            pushing = any(self.elements[wall].force != 0.0 for wall in self.walls)
            change = 0.0 if pushing else each.fade * steps
            asked = gain if name in wanted else 0.0
            each.act(self.axes[0], asked=asked, change=change, taps=self.taps)
        total = 0.0
        for each in self.elements.values():
            total += each.force
            self.clamped |= each.at_limit
        if not _usable(total):
            return self._no_force(Status.NOT_FINITE)
        self.clamped |= abs(total) > self.peak
        self.last_force = max(-self.peak, min(self.peak, total))
        return self.last_force

    def stop(self) -> float:
        """No force; every contact ends until its next reset, as nothing came for too long."""
        for each in self.elements.values():
            each.end()
        return self._no_force(Status.LATE)

    def _together(self, elements: Collection[str]) -> Status:
        """Whether elements may act at once: with walls of either side alone, if there is room."""
        sides = {name: self.elements[name].side for name in self.walls.intersection(elements)}
        for side in (-1, 1):
            if not self.certified([name for name in elements if sides.get(name) != side]):
                return Status.NOT_TOGETHER
        pairs = ((self.elements[one], self.elements[other]) for one in sides for other in sides)
        narrow = any(one.side > 0 and one.crowds(one.face, 1, other) for one, other in pairs)
        return Status.TOO_NARROW if narrow else Status.OK

    def _no_force(self, reason: Status) -> float:
        self._end(reason)
        self.last_force = 0.0
        return 0.0


def _usable(number: float) -> bool:
    return abs(number) < _ENDLESS


def _sets(parameters: Mapping[str, Any], kind: str, names: str) -> Iterator[frozenset[str]]:
    return (frozenset(parameters[f"{kind}.{name}"]) for name in parameters.get(names, ()))


def _filter(parameters: Mapping[str, Any], which: str) -> Filter:
    """A filter; without coefficients it passes what it is given."""
    first, then = (
        LowPass(*(float(parameters.get(f"{which}.{key}{end}", key == "g")) for key in "tpg"))
        for end in ("", "2")
    )
    return Filter(first, then, float(parameters.get(f"{which}.lead", 0.0)))
