"""The certified control law of haptune_params.yaml in plain Python: nothing to install.

    law = Law(parameters)                         # of the node, names such as "elements.wall.mass"
    law.reset(["wall"], rest=0.0, side=1)         # when elements are entered
    force = law.force(["wall"], period, position) # every period, with [] where nothing is touched

SI units. It plays what the C guard of the same profile plays. Python may pause for longer than a
period: what is missed is bridged, and more than is certified ends every contact. One file: a
program that is copied to a controller as it is.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

_WRAP = 2**32


class Status(enum.Enum):
    """What the last call came to."""

    OK = "ok"
    WAITING = "not certified with what still fades out: what is new waits for that"
    NOT_TOGETHER = "this set is not certified as a sum, or holds an unknown element"
    NOT_ENTERED = "no reset since the start, or since contacts were ended"
    NO_SIDE = "a wall that pushes only was given no side"
    NOT_FINITE = "a reading, or what comes out, is no finite number"
    BAD_GAIN = "gain is not in [0, 1]"
    STALE = "the reading of this period was used before"
    GLITCH = "the device cannot have moved so far: the reading is not used"
    LATE = "more periods missed than are certified: reset to go on"


@dataclass
class LowPass:
    """x[k] = (t*x[k-1] - p*x[k-2]) + g*u[k]."""

    t: float = 0.0
    p: float = 0.0
    g: float = 1.0
    now: float = 0.0
    before: float = 0.0

    def take(self, value: float) -> None:
        """Run on by one sample."""
        output = (self.t * self.now - self.p * self.before) + self.g * value
        self.before, self.now = self.now, output


@dataclass
class Element:
    """Effects, and where and how far the element is entered; ``fade`` is its change in a period."""

    stiffness: float
    damping: float
    mass: float
    one_sided: bool
    fade: float
    entered: bool = False
    side: int = 0
    rest: float = 0.0
    level: float = 0.0

    def faded(self, steps: int, *, wanted: bool) -> float:
        """The level some periods later."""
        change = self.fade * steps
        if wanted:
            return min(self.level + change, 1.0)
        return self.level - change if self.level > change else 0.0

    def force(self, axis: Axis) -> float:
        """-(K*(y - rest) + B*v + M*a); a wall gives none outside and never pulls."""
        force = -(
            (self.stiffness * (axis.last - self.rest) + self.damping * axis.velocity.now)
            + self.mass * axis.acceleration.now
        )
        outside = not self.side * (self.rest - axis.last) > 0.0
        return 0.0 if self.one_sided and (outside or self.side * force < 0.0) else force


@dataclass
class Axis:
    """Velocity and acceleration of the axis; they run on whether or not anything is touched."""

    sample_time: float
    window: int
    velocity: LowPass
    acceleration: LowPass
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
        self.velocity.now = self.velocity.before = slope
        self.acceleration.now = self.acceleration.before = 0.0

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


class Law:
    """The force of a profile's elements on one axis.

    After each call ``status`` says what it came to, ``clamped`` whether the force was cut;
    ``missed`` counts periods bridged, ``glitches`` readings that could not be and were not used.
    """

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Take the parameters by their full names, such as "elements.wall.stiffness"."""
        self.sample_time = float(parameters["sample_time"])
        self.extra_delay = int(parameters["margin.extra_delay_samples"])
        self.peak = float(parameters["force_limit.peak"])
        self.names = tuple(parameters["element_names"])
        self.elements = {name: self._element(parameters, f"elements.{name}") for name in self.names}
        groups = [parameters[f"together.{name}"] for name in parameters.get("group_names", ())]
        self.certified = {
            frozenset(chosen)
            for group in (*groups, *((name,) for name in self.names))
            for size in range(1, len(group) + 1)
            for chosen in combinations(group, size)
        }
        self.axis = Axis(
            sample_time=self.sample_time,
            window=int(parameters.get("velocity.samples", 1)),
            velocity=_low_pass(parameters, "velocity"),
            acceleration=_low_pass(parameters, "acceleration"),
            largest_change=float(parameters["largest_change"]),
        )
        self.status, self.clamped, self.last_force = Status.OK, False, 0.0
        self.missed = self.glitches = self.waiting = 0

    def reset(self, elements: Collection[str], rest: float, side: int = 0) -> Status:
        """Enter elements, before their first force.

        Args:
            elements: their names as in element_names.
            rest: m (rad), where springs give no force, the face of a wall.
            side: to which side walls push: above 0 towards growing positions, below 0 the other
                way; others take any.
        """
        self.status = Status.OK
        if not set(elements) <= self.elements.keys():
            self.status = Status.NOT_TOGETHER
        elif not math.isfinite(rest):
            self.status = Status.NOT_FINITE
        chosen = [self.elements[name] for name in self.names if name in elements]
        if side == 0 and any(each.one_sided for each in chosen):
            self.status = Status.NO_SIDE
        for each in chosen:
            if self.status is Status.OK:
                each.entered, each.rest = True, float(rest)
                each.side = (side > 0) - (side < 0)
            else:
                each.entered, each.level = False, 0.0
        return self.status

    def force(
        self, elements: Collection[str], period: int, position: float, gain: float = 1.0
    ) -> float:
        """Force, N (N*m), of a certified set of elements; every period, touched or not.

        Args:
            elements: what is touched; what leaves the set fades out first if it has to.
            period: number of the period in which the position was read, one more each period.
            position: m (rad), where the device was certified: at the encoder.
            gain: 0 to 1, for ramps, slow against the loop.
        """
        steps = (period - self.axis.period) % _WRAP if self.axis.started else 1
        self.clamped, self.status = False, self._read(steps, period, position)
        if self.status is Status.LATE:
            for each in self.elements.values():
                each.entered = False
            return self._no_force(Status.LATE)
        if self.status is not Status.OK:
            return self.last_force
        wanted = frozenset(elements)
        fault = self._fault(wanted, gain)
        if fault is not Status.OK:
            return self._no_force(fault)
        acting = self._acting(wanted, steps)
        if acting and acting not in self.certified:
            wanted &= self._acting(frozenset(), 0)
            self.status = Status.WAITING
        total = 0.0
        for name, each in self.elements.items():
            each.level = each.faded(steps, wanted=name in wanted)
            if each.level > 0.0:
                total += each.level * each.force(self.axis)
        total *= gain
        if not math.isfinite(total):
            return self._no_force(Status.NOT_FINITE)
        self.clamped = abs(total) > self.peak
        self.last_force = max(-self.peak, min(self.peak, total))
        return self.last_force

    def _read(self, steps: int, period: int, position: float) -> Status:
        """Use a reading; where it is not OK, the reading was not used for any force."""
        axis, fault = self.axis, Status.OK
        if not math.isfinite(position):
            fault = Status.NOT_FINITE
        elif not axis.started:
            axis.start(period % _WRAP, position, 0.0)
        elif steps == 0:
            fault = Status.STALE
        elif steps - 1 > self.extra_delay:
            slope = (position - axis.last) / (self.sample_time * steps)
            axis.start(period % _WRAP, position, slope)
            self.waiting = 0
            return Status.LATE
        elif not axis.plausible(steps, position):
            fault = Status.GLITCH
            self.glitches += 1
        else:
            axis.bridge(steps, position)
            self.missed += steps - 1
        if fault is Status.OK:
            self.waiting = 0
            return fault
        self.waiting += 1
        late = self.waiting > self.extra_delay or steps > self.extra_delay
        return Status.LATE if axis.started and late else fault

    def _fault(self, wanted: frozenset[str], gain: float) -> Status:
        if wanted and wanted not in self.certified:
            return Status.NOT_TOGETHER
        if not 0.0 <= gain <= 1.0:
            return Status.BAD_GAIN
        entered = all(self.elements[name].entered for name in wanted)
        return Status.OK if entered else Status.NOT_ENTERED

    def _acting(self, elements: frozenset[str], steps: int) -> frozenset[str]:
        """Elements that give a force some periods later, if only these are wanted until then."""
        return frozenset(
            name
            for name, each in self.elements.items()
            if each.faded(steps, wanted=name in elements) > 0.0
        )

    def _no_force(self, reason: Status) -> float:
        for each in self.elements.values():
            each.level = 0.0
        self.status, self.last_force = reason, 0.0
        return 0.0

    def _element(self, parameters: Mapping[str, Any], place: str) -> Element:
        fade_time = float(parameters[f"{place}.fade_time"])
        return Element(
            stiffness=float(parameters[f"{place}.stiffness"]),
            damping=float(parameters[f"{place}.damping"]),
            mass=float(parameters[f"{place}.mass"]),
            one_sided=bool(parameters[f"{place}.one_sided"]),
            fade=min(1.0, self.sample_time / fade_time) if fade_time else 1.0,
        )


def _low_pass(parameters: Mapping[str, Any], which: str) -> LowPass:
    """A filter; without coefficients it passes what it is given."""
    return LowPass(
        t=float(parameters.get(f"{which}.t", 0.0)),
        p=float(parameters.get(f"{which}.p", 0.0)),
        g=float(parameters.get(f"{which}.g", 1.0)),
    )
