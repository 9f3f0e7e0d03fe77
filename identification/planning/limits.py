"""What a play may do: limits and guesses, worst motion, and a gentle play before the full one.

A net force F/m moves a lighter device further at the same b/m, so the farthest device of a box of
mass and damping lies where either is least: only these two sides are looked at, each in levels of
equal ratio, with friction in levels and a constant force at both ends.

What is guessed may be two times wrong, and a constant force that nobody knows of makes a device
without a spring drift: f0/b metres a second, for as long as the play lasts. So the first play is
short and weak enough for all of that; its log tells mass, damping, friction and the constant force
well enough for the second to be planned within their intervals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from identification.device.device import LIGHTEST, load_device, named_devices
from identification.device.hardware import SHORTEST_STEP
from identification.device.quantities import (
    LARGEST,
    AnyQuantity,
    PositiveQuantity,
    Quantity,
    quantity,
    widen_interval,
)
from identification.documents import Document, load_document, parse_document, to_mapping
from identification.errors import InvalidInputError
from identification.estimators.signals import StepResponse
from identification.trajectory import MOST_AXES, SHORTEST, FloatArray, Motion

#: Rows of the longest force planned: three minutes at 1 kHz. A simulation steps through all of
#: them for every device of the guesses.
_MOST_SAMPLES = 200_000
#: At least this many ramps make up a signal; the rest must still have time to excite.
_FEWEST_RAMPS = 4
#: No limit is wider than friction by less than this factor: below it the device creeps and sticks.
_ABOVE_FRICTION = 1.5
#: Below this |p·h| the φ-functions are summed as series, where expm1 would cancel.
_PHI_SERIES_BELOW = 0.5
_TERMS = 17  # terms of the series: 0.5^17/17! is below the last bit


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """One device: m, b, Fc, f0 in kg, N·s/m, N, N (kg·m², N·m·s/rad, N·m, N·m)."""

    mass: float
    damping: float
    coulomb_friction: float = 0.0
    force_offset: float = 0.0

    @property
    def rate(self) -> float:
        """p = b/m, 1/s."""
        return self.damping / self.mass


def phi(delta: complex) -> tuple[complex, complex]:
    """φ1 and φ2 at δ = p·h, finite at δ = 0."""
    if abs(delta) < _PHI_SERIES_BELOW:
        second: complex = 0.0
        for k in range(_TERMS, 1, -1):
            second = (1 - delta * second) / k
        return 1 - delta * second, second
    first = complex(-np.expm1(-delta) / delta)
    return first, (1 - first) / delta


def step_response(rate: complex, span: complex) -> tuple[complex, complex]:
    """Velocity and position after a unit force per mass for ``span`` s; real for reals."""
    delta = rate * span
    first, second = phi(delta)
    if not isinstance(delta, complex):
        first, second = first.real, second.real
    return span * first, span * span * second


#: Part of the name of a column.
_AxisName = Annotated[str, Field(pattern=r"^\w+$")]


class ExcitationSpec(Document):
    """Limits, guesses and noise (excitation.yaml); SI units of the motion.

    A guess is a number or {value, low, high}: the force is designed for the value and stays within
    the limits for every device in between.

    Attributes:
        name: of the device.
        axis: name of the axis.
        axes: names of the axes of a device of several, instead of axis; limits then hold on every
            axis, and the guesses of mass and damping in every direction.
        motion: "linear" or "rotary".
        sample_time: T, s; each force is held that long.
        duration: s, ramps included.
        ramp: s, over which the force fades in, and out again.
        force: largest |force| to be played, N (N·m).
        travel: largest distance from the start, either way, m (rad).
        speed: largest speed, m/s (rad/s), or none.
        mass: guess, kg (kg·m²).
        damping: guess, N·s/m (N·m·s/rad), not negative.
        coulomb_friction: guess, N (N·m).
        force_offset: guess of the constant force that is left when all compensation works, N (N·m).
        encoder_resolution: one count, m (rad).
        position_noise: rms of what is added to the position before it is counted, m (rad).
        force_noise: rms of a white force on the device that no log knows, held one sample, N (N·m).
        delay: "known", or "unknown" if it will be estimated from the same log.
        gentle: plan a short and weak first play that is safe if the guesses are two times wrong
            and a constant force of 2 % of the limit acts that nobody planned for.
        device: file of the device as identified from a gentle play, or a named device; its mass,
            damping, friction and offset stand in for the guesses.
    """

    schema_: Literal["haptune/excitation/1"] = Field(default="haptune/excitation/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    axes: tuple[_AxisName, ...] | None = Field(default=None, min_length=2, max_length=MOST_AXES)
    motion: Motion = "linear"
    sample_time: float = Field(ge=SHORTEST_STEP, le=LARGEST)
    duration: float = Field(gt=0, le=LARGEST)
    ramp: float = Field(default=0.5, ge=0, le=LARGEST)
    force: float = Field(gt=0, le=LARGEST)
    travel: float = Field(gt=0, le=LARGEST)
    speed: float | None = Field(default=None, gt=0, le=LARGEST)
    mass: PositiveQuantity
    damping: AnyQuantity
    coulomb_friction: AnyQuantity = quantity(0.0)
    force_offset: AnyQuantity = quantity(0.0)
    encoder_resolution: float = Field(gt=0, le=LARGEST)
    position_noise: float = Field(default=0.0, ge=0, le=LARGEST)
    force_noise: float = Field(default=0.0, ge=0, le=LARGEST)
    delay: Literal["known", "unknown"] = "known"
    gentle: bool = False
    device: str | None = None

    @model_validator(mode="after")
    def _sane(self) -> ExcitationSpec:
        if self.gentle and self.device is not None:
            raise ValueError(
                f"gentle plans for a device that is guessed, {self.device} tells of one that is "
                "known; leave out gentle, or device"
            )
        if self.axes is not None and len(set(self.axes)) < len(self.axes):
            listed = ", ".join(self.axes)
            raise ValueError(f"axes are {listed}; give each a name of its own")
        if self.mass.low < LIGHTEST:
            raise ValueError(f"mass must be {LIGHTEST:g} or more, not {self.mass.low:g}")
        for name in ("damping", "coulomb_friction"):
            low = getattr(self, name).low
            if low < 0:
                raise ValueError(f"{name} must not be negative, not {low:g}")
        if not SHORTEST <= self.samples <= _MOST_SAMPLES:
            raise ValueError(
                f"{self.duration:g} s at {self.sample_time:g} s a sample are {self.samples} "
                f"samples; {SHORTEST} to {_MOST_SAMPLES} can be planned"
            )
        if self.duration < _FEWEST_RAMPS * self.ramp:
            raise ValueError(
                f"a duration of {self.duration:g} s leaves too little between two ramps of "
                f"{self.ramp:g} s; give {_FEWEST_RAMPS * self.ramp:g} s or more"
            )
        against = self.coulomb_friction.high + max(
            abs(self.force_offset.low), abs(self.force_offset.high)
        )
        if self.force < _ABOVE_FRICTION * against:
            raise ValueError(
                f"a force of {self.force:g} against friction and offset of up to {against:g} "
                f"hardly moves the device; allow {_ABOVE_FRICTION * against:g} or more"
            )
        return self

    @property
    def samples(self) -> int:
        """Samples over which the force is held."""
        return round(self.duration / self.sample_time)

    @property
    def reading_noise(self) -> float:
        """Standard deviation of one position in the log, m (rad): noise and rounding to a count."""
        return float(np.hypot(self.position_noise, self.encoder_resolution / np.sqrt(12)))

    @property
    def ranges(self) -> bool:
        """Whether any guess is more than a number."""
        guesses = (self.mass, self.damping, self.coulomb_friction, self.force_offset)
        return not all(guess.exact for guess in guesses)

    @property
    def guess(self) -> Guess:
        """The guessed device."""
        return Guess(
            mass=self.mass.value,
            damping=self.damping.value,
            coulomb_friction=self.coulomb_friction.value,
            force_offset=self.force_offset.value,
        )


_WRONG = 2.0  # mass, damping, friction may be this many times what was guessed, or this part of it
#: An unplanned constant force, as part of the force limit: what a cable, a tilt of a degree or the
#: bias of an amplifier makes.
_UNPLANNED = (0.01, 0.02)
_LEVELS = 7  # levels on a side of the box of mass and damping, and of friction
_FRICTIONS = 4
BETWEEN = 1.01  # between the levels a device may go this much farther
_SERIES_BELOW = 1e-4  # below this b·t/m series stand in for the exponential


@dataclass(frozen=True, slots=True, kw_only=True)
class Used:
    """Parts of the limits of force, travel and speed; speed 0 where it has no limit."""

    force: float
    travel: float
    speed: float

    @classmethod
    def of(
        cls,
        spec: ExcitationSpec,
        force: FloatArray,
        reach: FloatArray,
        speed: FloatArray,
        spread: float,
    ) -> Used:
        """What a force uses where devices go so far and so fast, and others the spread farther."""
        return cls(
            force=float(np.max(np.abs(force))) / spec.force,
            travel=spread * float(np.max(reach)) / spec.travel,
            speed=0.0 if spec.speed is None else spread * float(np.max(speed)) / spec.speed,
        )

    @property
    def most(self) -> float:
        """The largest of them."""
        return max(self.force, self.travel, self.speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstMotion:
    """Farthest and fastest motion of a set of devices under one force."""

    name: str  # of the set: "stated", "twice", "unplanned-1", "unplanned-2" or "both"
    words: str  # what the devices have in common
    travel: float  # largest distance from the start, either way, m (rad)
    speed: float  # m/s (rad/s)

    @classmethod
    def of(cls, name: str, words: str, reach: FloatArray, speed: FloatArray) -> WorstMotion:
        """That of devices that go so far, m (rad), and so fast, m/s (rad/s), and those between."""
        spread = BETWEEN if len(reach) > 1 else 1.0
        return cls(
            name=name,
            words=words,
            travel=spread * float(np.max(reach)),
            speed=spread * float(np.max(speed)),
        )


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

    def pulled(self, force: float) -> Region:
        """With a constant force of this size either way that nobody planned for, N."""
        low, high = self.offset
        return replace(self, offset=(low - force, high + force))

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
    """Worst travel and speed of a force over the devices that a user may really have."""
    boxes = list(regions(spec))
    devices = [region.devices() for _, _, region in boxes]
    every = list(dict.fromkeys(device for some in devices for device in some))
    place = {device: index for index, device in enumerate(every)}
    reach, speed = extremes(force[:-1], every, spec.sample_time)
    return tuple(
        WorstMotion.of(
            name, words, *(each[[place[one] for one in some]] for each in (reach, speed))
        )
        for (name, words, _), some in zip(boxes, devices, strict=True)
    )


def regions(spec: ExcitationSpec) -> Iterator[tuple[str, str, Region]]:
    """Name, words and box of the sets of devices that a user may really have."""
    stated = Region.stated(spec)
    unit = "N" if spec.motion == "linear" else "N·m"
    yield "stated", "the guesses as stated", stated
    guesses = (spec.mass, spec.damping, spec.coulomb_friction)
    mass, damping, friction = (_ends(_wrong(guess)) for guess in guesses)
    twice = replace(stated, mass=mass, damping=damping, friction=friction)
    yield "twice", f"mass, damping and friction {_WRONG:g} times wrong, either way", twice
    for part in _UNPLANNED:
        force = part * spec.force
        words = f"an unplanned constant force of {part:.0%} of the limit, {force:.3g} {unit}"
        yield f"unplanned-{100 * part:g}", words, stated.pulled(force)
    yield (
        "both",
        f"guessed {_WRONG:g} times wrong and pulled by {max(_UNPLANNED):.0%}",
        twice.pulled(max(_UNPLANNED) * spec.force),
    )


def motions_beyond(spec: ExcitationSpec, worst: Sequence[WorstMotion]) -> tuple[WorstMotion, ...]:
    """Which motions leave the travel or the speed allowed."""
    speed = spec.speed or np.inf
    return tuple(each for each in worst if each.travel > spec.travel or each.speed > speed)


def describe_impossible(spec: ExcitationSpec, used: Used) -> tuple[str, str]:
    """What no force can keep, and what to do."""
    if used.travel == used.most:
        return (
            f"however small the force, some device within the guesses moves {used.travel:.2g} "
            f"times the travel of {spec.travel:g} in {spec.duration:g} s",
            "Without a spring an unknown friction or offset makes a device drift: narrow the "
            "ranges of coulomb_friction and force_offset (gentle: true plans a first play that "
            "tells them), shorten the duration, or allow more travel",
        )
    return (
        f"no force keeps every device within the guesses below the speed of {spec.speed:g}",
        "Allow more speed, or narrow the ranges of the guesses",
    )


def extremes(force: FloatArray, devices: list[Guess], step: float) -> tuple[FloatArray, FloatArray]:
    """Largest |position| and |velocity| at the samples of d devices, from rest, shapes (d,)."""
    mass = np.array([each.mass for each in devices])
    rate = np.array([each.rate for each in devices])
    grip = np.array([each.coulomb_friction for each in devices]) / mass
    offset = np.array([each.force_offset for each in devices])
    steps = [step_response(each.rate, step) for each in devices]
    coast, fall = (np.array([each[part].real for each in steps]) for part in (0, 1))
    decay = 1 - rate * coast
    place, speed = np.zeros(mass.size), np.zeros(mass.size)
    reach, fastest = np.zeros(mass.size), np.zeros(mass.size)
    for each in force.tolist():
        drive = (each - offset) / mass
        sense = np.sign(speed)
        if not sense.all():  # at rest friction takes as much as it can, never more than there is
            sense = np.where(sense == 0, np.sign(drive) * (np.abs(drive) > grip), sense)
            drive *= sense != 0
        net = drive - grip * sense
        later = decay * speed + coast * net
        after = place + coast * speed + fall * net
        turned = np.flatnonzero(later * sense * grip < 0)
        if turned.size:
            columns = (place, speed, net, drive, grip, rate)
            after[turned], later[turned] = _turn(*(each[turned] for each in columns), step=step)
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
    *,
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
    push = StepResponse.during(before, rate)
    place = place + push.speed * speed + push.place * net
    onward = np.where(np.abs(drive) <= grip, 0.0, drive - grip * np.sign(drive))
    push = StepResponse.during(step - before, rate)
    return place + push.place * onward, push.speed * onward


def _ends(guess: Quantity) -> tuple[float, float]:
    return guess.low, guess.high


def _levels(low: float, high: float, count: int) -> list[float]:
    """From low to high, evenly in octaves where neither is zero."""
    if low == high:
        return [low]
    values = np.geomspace(low, high, count) if low > 0 else np.linspace(low, high, count)
    return [low, *values[1:-1].tolist(), high]


#: The gentle play uses at most this part of the force limit, more only where friction asks for it.
_FORCE = 0.5
#: Part of the travel that the lightest device may drift under the constant force, and in the
#: shortest play: the rest is left to the force that is planned.
_DRIFT = 0.4
_MOST_DRIFT = 0.7
_FEWEST = 1.25 * SHORTEST  # samples of the shortest play: its log must be long enough to be read
_HALVINGS = 12  # bisections of the duration: to a thousandth
_IDENTIFIED = 4  # quantities of a device that a plan rests on


def gentle_spec(spec: ExcitationSpec) -> ExcitationSpec:
    """Limits and guesses of a first play on a device that is hardly known."""
    unplanned = max(_UNPLANNED) * spec.force
    offset = quantity(
        spec.force_offset.value,
        spec.force_offset.low - unplanned,
        spec.force_offset.high + unplanned,
    )
    steady = max(abs(offset.low), abs(offset.high))
    mass, damping = _wrong(spec.mass), _wrong(spec.damping)
    # Against more friction than the force can move, nothing goes far.
    most = max(spec.coulomb_friction.high, spec.force / _ABOVE_FRICTION - steady)
    friction = _wrong(spec.coulomb_friction, most)
    force = max(_FORCE * spec.force, _ABOVE_FRICTION * (friction.high + steady))
    drift = max(offset.high - offset.value, offset.value - offset.low)
    duration = _duration(spec, drift, mass.low, damping.low)
    changes = {
        "gentle": False,
        "mass": mass.model_dump(),
        "damping": damping.model_dump(),
        "coulomb_friction": friction.model_dump(),
        "force_offset": offset.model_dump(),
        "force": min(force, spec.force),
        "duration": duration,
        "ramp": min(spec.ramp, duration / (2 * _FEWEST_RAMPS)),
    }
    return parse_document(ExcitationSpec, to_mapping(spec) | changes, "gentle excitation")


def _wrong(guess: Quantity, most: float = float("inf")) -> Quantity:
    """A guess that may be wrong by the factor, either way."""
    high = max(guess.high, min(guess.value * _WRONG, most))
    return quantity(guess.value, min(guess.low, guess.value / _WRONG), high)


def _duration(spec: ExcitationSpec, force: float, mass: float, damping: float) -> float:
    """The longest play, at most as stated, over which a constant force drifts no farther, s."""

    def drift(duration: float) -> float:
        return force / mass * step_response(damping / mass, duration)[1].real

    low, high = min(_FEWEST * spec.sample_time, spec.duration), spec.duration
    room = _DRIFT * spec.travel
    if drift(low) > _MOST_DRIFT * spec.travel:
        raise InvalidInputError(
            "gentle excitation",
            f"a constant force of {force:.3g}, {max(_UNPLANNED):.0%} of the limit and the interval "
            f"of force_offset, moves the lightest device {drift(low):.2g} in the {low:.3g} s that "
            f"a log needs at least; {_MOST_DRIFT * spec.travel:.2g} of the travel is to spare",
            "Measure the constant force and narrow force_offset, lower the force limit, allow more "
            "travel, or shorten sample_time",
        )
    if drift(high) <= room:
        return high
    if drift(low) > room:
        return low
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if drift(middle) <= room else (low, middle)
    return round(low / spec.sample_time) * spec.sample_time


def load_excitation(path: str | PathLike[str]) -> ExcitationSpec:
    """Read and validate excitation.yaml, and the device it names. Raises InvalidInputError."""
    spec = load_document(ExcitationSpec, path)
    if spec.device is None:
        return spec
    known = spec.device in named_devices()
    device = load_device(spec.device if known else Path(path).parent / spec.device)
    if device.motion != spec.motion:
        raise InvalidInputError(
            spec.device,
            f"is {device.motion}, the excitation {spec.motion}",
            "Give the device that the force is for, and its motion",
        )
    if device.axes is not None and device.axes != spec.axes:
        known, given = ", ".join(device.axes), ", ".join(spec.axes or (spec.axis,))
        raise InvalidInputError(
            spec.device,
            f"is of the axes {known}, the excitation of {given}",
            f"Give axes: [{known}], which are driven together",
        )
    if device.position_stiffness is not None or device.gravity is not None:
        raise InvalidInputError(
            spec.device,
            "has a force of position (position_stiffness or gravity), which no plan knows",
            "Level or counterbalance the axis and take off springs, then identify it again",
        )
    # The 95 % intervals of the file are widened to hold all at once with 99.9 %, as they are for
    # certificates: a play has to keep its limits on more than 95 devices of 100.
    box = device.simultaneous_box()
    factor = device.widening(least=_IDENTIFIED)
    friction, offset = device.coulomb_friction, device.force_offset
    frictions = [friction]
    if device.friction_by_direction is not None:
        pair = device.friction_by_direction
        frictions += [pair.forward, pair.backward]
    ends = [widen_interval(each, factor) for each in frictions]
    changes = {
        "mass": quantity(device.mass.value, *box.mass),
        "damping": _not_negative(device.damping.value, *box.damping),
        "coulomb_friction": _not_negative(
            friction.value, min(low for low, _ in ends), max(high for _, high in ends)
        ),
        "force_offset": quantity(offset.value, *widen_interval(offset, factor)),
    }
    stated = {name: each.model_dump() for name, each in changes.items()}
    return parse_document(ExcitationSpec, to_mapping(spec) | stated, spec.device)


def _not_negative(value: float, low: float, high: float) -> Quantity:
    return quantity(max(value, 0.0), max(low, 0.0), max(high, 0.0))
