"""Device: one axis of a haptic device, hardware plus what was identified and from what."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations_with_replacement
from os import PathLike, fspath
from os.path import exists, isfile
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from identification.device.hardware import (
    FACTS,
    MOST_MODES,
    SHORTEST_STEP,
    Day,
    Fact,
    ForceLimit,
    Label,
    Mode,
    Resolution,
    missing_of,
    question,
)
from identification.device.quantities import (
    BOX_CONFIDENCE,
    LARGEST,
    AnyQuantity,
    Box,
    Covariance,
    Pose,
    PositiveQuantity,
    Quantity,
    direction_in_words,
    quantity,
    widen_interval,
    widening,
)
from identification.documents import Document, load_document
from identification.errors import InvalidInputError, typed
from identification.trajectory import NORMAL_95, Motion

#: kg (kg·m²): a milligram at a lever of a millimetre.
LIGHTEST = 1e-12
#: Part of a mass or damping by which directions looked at by chance may miss the extreme.
_SPARE = 1e-4
#: How many times narrower or wider than its variance says a stored interval may be: one of two logs
#: that differ is 0.36 times as wide, one of logs with few degrees of freedom or one poor log wider.
_NARROWEST, _WIDEST = 0.2, 100.0
#: Findings that are never warnings: what is identified all the same was allowed.
REFUSING = frozenset(
    {
        "controller-identified",
        "encoder-wrap",
        "few-counts",
        "force-saturated",
        "force-unit",
        "sign-flip",
    }
)
#: Where to write what is missing, unless a command knows better.
_WHERE = (
    "State them in hardware.yaml and identify with it, or in device.yaml, without 'source: log' "
    "and no longer listed under 'missing':"
)
#: Part of the friction of an axis within which it and the offset are taken as known.
_ROUGH = 0.1
#: Devices that come with haptune.
_FOLDER = Path(__file__).parent / "named"

Kind = Literal["drag", "falling", "place", "position", "memory", "drift"]
#: What each kind is called in a sentence.
KINDS: dict[Kind, str] = {
    "drag": "drag that grows faster than speed",
    "falling": "friction that falls with speed (Stribeck)",
    "place": "damping that depends on position",
    "position": "a force of position (cogging, a cable's pull)",
    "memory": "friction with a memory (presliding, cables)",
    "drift": "friction that changes while it is logged (warming)",
}


class ByDirection(Document):
    """A quantity that differs with the direction of motion.

    Attributes:
        forward: while the velocity is positive.
        backward: while the velocity is negative.
    """

    forward: AnyQuantity
    backward: AnyQuantity


class SlopeRange(Document):
    """Least and largest slope of a force: of friction over speed, or of a spring over position."""

    low: float = Field(ge=-LARGEST, le=LARGEST)
    high: float = Field(ge=-LARGEST, le=LARGEST)

    @model_validator(mode="after")
    def _ordered(self) -> SlopeRange:
        if self.low > self.high:
            raise ValueError(f"needs low <= high, not {self.low:g} and {self.high:g}")
        return self


class UnmodelledForce(Document):
    """A kind of force that a log shows and the model of the device lacks.

    Attributes:
        kind: as in KINDS.
        share: its rms over the rms of the force.
    """

    kind: Kind
    share: float = Field(ge=0)

    @property
    def words(self) -> str:
        """The kind in a sentence."""
        return KINDS[self.kind]

    @property
    def rises(self) -> bool:
        """Whether it rises with speed, so that its slopes are all that a loop feels of it."""
        return self.kind == "drag"


class LogRecord(Document):
    """One log the device was identified from, and what was let through.

    ``read_as`` tells how a file that is no plain table in SI units was understood.
    """

    source: str
    digest: str
    samples: int
    method: str
    findings: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()
    unmodelled_forces: tuple[UnmodelledForce, ...] = ()
    read_as: str = ""

    @model_validator(mode="after")
    def _allowed_what_refuses(self) -> LogRecord:
        refusing = [code for code in self.findings if code in REFUSING - {*self.allowed}]
        if refusing:
            allowed = ", ".join(self.allowed) or "nothing"
            raise ValueError(f"{', '.join(refusing)} refuses a log; allowed is {allowed}")
        return self


class Gravity(Document):
    """The weight of a load that turns with the axis: gs·sin(q) + gc·cos(q), q in rad.

    Attributes:
        sine: gs, N·m.
        cosine: gc, N·m.
    """

    sine: AnyQuantity
    cosine: AnyQuantity


def _delay_may_be_left_out(schema: dict[str, Any]) -> None:
    schema["required"].remove("delay")
    schema["properties"]["delay"]["description"] = (
        "s; left out: missing, and read as one sample time"
    )


class Device(Document):
    """One axis of a haptic device: hardware plus what was identified (device.yaml).

    m·q̈ + b(q̇)·q̇ + Fc(q̇)·sign(q̇) + k·q + gs·sin(q) + gc·cos(q) + f0 = F(t - delay), in SI units
    for linear motion; a rotary axis reads kg·m², N·m·s/rad, N·m, N·m/rad, rad.

    Attributes:
        name: of the device.
        axis: name of the axis.
        serial: serial number.
        date: of the calibration, year-month-day.
        operator: who took the logs.
        motion: "linear" or "rotary"; read as linear where it is missing.
        missing: facts that nobody stated; in a file also whatever is absent or has ``source: log``.
        sample_time: T, s.
        mass: m, kg.
        damping: b, N·s/m, of both directions together; may be negative on a compensated axis.
        coulomb_friction: Fc, N, of both directions together.
        force_offset: f0, N.
        delay: s, from command to measurement; read as one sample time where it is missing.
        encoder_resolution: m, one count at the handle.
        force_limit: N at the handle.
        modes: vibration of the mechanism, beside the rigid mass.
        current_lag: s, time constant of the current loop; left out: none.
        damping_slope: least and largest slope of friction over speed, from rest to the fastest
            speed logged, where friction is not constant damping and Coulomb friction; falling
            friction and the step at rest are left out.
        presliding_stiffness: of friction with a memory while it does not slide, N/m, above zero.
        damping_by_direction: b for q̇ > 0 and for q̇ < 0, where a log told them apart.
        friction_by_direction: Fc, not negative, for q̇ > 0 and for q̇ < 0.
        position_stiffness: k, N/m, of a force k·q towards zero; negative pushes away from it.
        gravity: gs and gc.
        covariance: joint, of everything identified together.
        axes: names of the axes of a device of several; None of one.
        poses: matrices of a device of several axes, one for each pose. Then mass and damping span
            every direction, friction and offset every axis, and one law, the same on all axes, is
            tuned for all of them.
        logs: what it was identified from.
    """

    model_config = ConfigDict(json_schema_extra=_delay_may_be_left_out)

    schema_: Literal["haptune/device/1"] = Field(default="haptune/device/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    serial: Label | None = None
    date: Day | None = None
    operator: Label | None = None
    motion: Motion = "linear"
    missing: tuple[Fact, ...] = ()
    sample_time: AnyQuantity
    mass: AnyQuantity
    damping: AnyQuantity
    coulomb_friction: AnyQuantity = quantity(0.0)
    force_offset: AnyQuantity = quantity(0.0)
    delay: AnyQuantity
    encoder_resolution: Resolution | None = None
    force_limit: ForceLimit | None = None
    modes: tuple[Mode, ...] = Field(default=(), max_length=MOST_MODES)
    current_lag: PositiveQuantity | None = None
    damping_slope: SlopeRange | None = None
    presliding_stiffness: SlopeRange | None = None
    damping_by_direction: ByDirection | None = None
    friction_by_direction: ByDirection | None = None
    position_stiffness: AnyQuantity | None = None
    gravity: Gravity | None = None
    covariance: Covariance | None = None
    axes: tuple[str, ...] | None = None
    poses: tuple[Pose, ...] | None = None
    logs: tuple[LogRecord, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _mark_what_is_missing(cls, raw: Any) -> Any:
        if not isinstance(raw, Mapping):
            return cast("object", raw)
        given = cast("Mapping[str, object]", raw)
        missing = missing_of(given)
        blank = {fact for fact in missing if given.get(fact) is None}
        stated = {key: value for key, value in given.items() if key not in blank}
        listed = given.get("missing")
        if listed is None or isinstance(listed, list | tuple):  # anything else is refused as that
            unknown = [each for each in cast("list[object]", listed or ()) if each not in FACTS]
            stated["missing"] = [*missing, *unknown]
        if "delay" in blank and "sample_time" in stated:
            step = stated["sample_time"]
            if isinstance(step, Mapping):
                step = cast("Mapping[str, object]", step).get("value")
            stated["delay"] = {"value": getattr(step, "value", step), "source": "assumed"}
        return stated

    @model_serializer(mode="wrap")
    def _leave_out_what_is_missing(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = handler(self)
        if not self.missing:
            del content["missing"]
        elif "motion" in self.missing:
            del content["motion"]
        return content

    @model_validator(mode="after")
    def _sane(self) -> Device:
        for name, least in (("sample_time", SHORTEST_STEP), ("mass", LIGHTEST)):
            low = getattr(self, name).low
            if low < least:
                raise ValueError(f"{name} must be {least:g} or more over its interval, not {low:g}")
        if self.delay.low < 0 or self.coulomb_friction.value < 0:
            raise ValueError("delay and coulomb_friction must not be negative")
        friction = self.friction_by_direction
        if friction is not None and min(friction.forward.value, friction.backward.value) < 0:
            raise ValueError(
                "friction_by_direction must not be negative, not "
                f"{friction.forward.value:g} and {friction.backward.value:g}"
            )
        limit, offset = self.force_limit, abs(self.force_offset.value)
        if self.gravity is not None:  # of which the offset is the rest, at no angle alone
            offset -= float(np.hypot(self.gravity.sine.value, self.gravity.cosine.value))
        if limit is not None and limit.source != "log" and offset > limit.peak:
            raise ValueError(
                f"force_offset is {self.force_offset.value:g}, beyond the peak {limit.peak:g} of "
                "force_limit, which would have to hold it"
            )
        self._refuse_other_covariance()
        self._refuse_other_axes()
        return self

    def _refuse_other_axes(self) -> None:
        """Raises ValueError for axes without matrices, or with what only one axis can have."""
        if self.axes is None or self.poses is None:
            if self.axes is not None or self.poses is not None:
                raise ValueError("axes and poses belong together: give both or neither")
            return
        if len(self.axes) < 2 or any(len(each.mass) != len(self.axes) for each in self.poses):
            raise ValueError(f"poses need matrices of {len(self.axes)} axes, two at least")
        pairs = tuple(combinations_with_replacement(self.axes, 2))
        names = tuple(f"{which}_{one}_{two}" for which in ("mass", "damping") for one, two in pairs)
        if any(each.covariance.parameters != names for each in self.poses):
            raise ValueError(f"the covariance of a pose needs the parameters {', '.join(names)}")
        of_one = ("modes", "current_lag", "position_stiffness", "gravity", "damping_slope")
        given = [name for name in of_one if getattr(self, name)]
        if given:
            raise ValueError(f"{', '.join(given)} are known of devices of one axis only")
        for which in ("mass", "damping"):
            found = getattr(self, which)
            low, high = self._over_directions(which, None)
            spare = _SPARE * max(abs(low), abs(high))
            if found.low > low + spare or found.high < high - spare:
                raise ValueError(
                    f"{which} is said to be {found.low:.5g} to {found.high:.5g}, its matrices have "
                    f"{low:.5g} to {high:.5g} over all directions"
                )

    def _over_directions(
        self, which: Literal["mass", "damping"], confidence: float | None
    ) -> tuple[float, float]:
        """Least and largest of any direction at any pose, with 95 % or within a joint region."""
        assert self.poses is not None
        ends = [each.extremes(which, each.deviations(confidence)) for each in self.poses]
        return min(low.value for low, _ in ends), max(high.value for _, high in ends)

    def _refuse_other_covariance(self) -> None:
        """Raises ValueError for a covariance that logs or intervals beside it contradict."""
        joint = self.covariance
        if joint is None:
            return
        samples = min((log.samples for log in self.logs), default=math.inf)
        if joint.degrees_of_freedom >= samples:
            raise ValueError(
                f"covariance has {joint.degrees_of_freedom:g} degrees_of_freedom, which no log of "
                f"{samples} samples has"
            )
        variances = np.diag(joint.matrix)
        for name, variance in zip(joint.parameters, variances, strict=True):
            found = getattr(self, name, None)
            if not isinstance(found, Quantity):
                raise ValueError(f"covariance names '{name}', which is no quantity of this device")
            if name == "coulomb_friction" and found.low <= 0:
                continue  # cut off at zero, where physics ends
            half = (found.high - found.low) / 2
            if name == "mass":  # its interval is even on a logarithmic scale
                half = found.value * math.log(found.high / found.low) / 2
            said = NORMAL_95 * math.sqrt(variance)
            # Of a log that was allowed and does not tell it the interval is cut off.
            least = min(said, found.value) if name == "mass" else said
            if not _NARROWEST * least <= half <= _WIDEST * said:
                raise ValueError(
                    f"{name} is known within ±{half:.3g}, by its covariance within ±{said:.3g}; "
                    "leave the covariance out where the interval is of other origin"
                )

    def unstated(self) -> tuple[Fact, ...]:
        """The facts of this device that nobody stated, in the order of FACTS."""
        return missing_of(dict(self))

    def assumed(self) -> tuple[str, ...]:
        """Names of the quantities that nobody knows and somebody assumed, in the file's order."""
        return tuple(key for key, item in self if getattr(item, "source", None) == "assumed")

    def require_stated(
        self,
        needed: Collection[Fact] = FACTS,
        *,
        subject: str | PathLike[str] | None = None,
        where: str = _WHERE,
    ) -> None:
        """Ask for every fact that is needed and was not stated.

        Args:
            needed: facts that are needed.
            subject: the file asked about; None names the device.
            where: a sentence that says where to write them.

        Raises:
            UnstatedError: which facts, what to write for each, and what the log suggests.
        """
        missing: list[Fact] = [fact for fact in self.unstated() if fact in needed]
        if missing:
            raise question(subject or f"device {self.name}", missing, dict(self), where)

    def simultaneous_box(self, confidence: float = BOX_CONFIDENCE) -> Box:
        """Box that holds all identified quantities at once with the given probability.

        The 95 % intervals are widened to the bounding box of the joint confidence ellipsoid
        (Hotelling's T² with the covariance's degrees of freedom; χ² when none are stored). Mass is
        widened on a logarithmic scale, because it cannot be negative; damping is left free to be
        negative, because a compensated axis may be. Where damping differs with the direction of
        motion, the box spans both directions and the common value: whatever way the device moves,
        its damping is inside. Where the slope of friction was found, the box spans all of it. The
        slope of gs·sin(q) + gc·cos(q) runs over ±√(gs² + gc²) as the axis turns: the stiffness
        spans that beside k. Of several axes it spans every direction at every pose. Sample time and
        delay are taken as stated.
        """
        factor, mass = self.widening(confidence), self.mass
        dampings = [self.damping]
        if self.damping_by_direction is not None:
            dampings += [self.damping_by_direction.forward, self.damping_by_direction.backward]
        ranges = [widen_interval(each, factor) for each in dampings]
        if self.damping_slope is not None:
            ranges.append((self.damping_slope.low, self.damping_slope.high))
        masses = (
            mass.value * (mass.low / mass.value) ** factor,
            mass.value * (mass.high / mass.value) ** factor,
        )
        if self.poses is not None:
            each = 1 - (1 - confidence) / len(self.poses)
            masses = self._over_directions("mass", each)
            ranges = [self._over_directions("damping", each)]
        return Box(
            mass=masses,
            damping=(min(low for low, _ in ranges), max(high for _, high in ranges)),
            sample_time=(self.sample_time.low, self.sample_time.high),
            delay=(self.delay.low, self.delay.high),
            position_stiffness=self._slopes(factor),
        )

    def widening(self, confidence: float = BOX_CONFIDENCE, *, least: int = 2) -> float:
        """Factor from half of a 95 % interval to half of the box of so many quantities at least."""
        count = max(least, sum(not item.exact for item in self._identified()))
        freedom = np.inf
        if self.covariance is not None:
            count = max(count, len(self.covariance.parameters))
            freedom = self.covariance.degrees_of_freedom
        return widening(count, freedom, confidence)

    def along(self, direction: Sequence[float]) -> Device:
        """One axis of several: its motion in a direction, a unit vector; one axis is itself.

        Best estimates are those of the first pose while nothing moves across. Intervals span all
        poses, and what moves across freely where all force acts along the direction.
        """
        if self.axes is None or self.poses is None:
            return self
        ends = [pose.along(direction) for pose in self.poses]
        changes: dict[str, object] = {"axis": ",".join(self.axes), "axes": None, "poses": None}
        for name, ranges in zip(("mass", "damping"), zip(*ends, strict=True), strict=True):
            low, high = min(each.low for each in ranges), max(each.high for each in ranges)
            changes[name] = quantity(ranges[0].value, low, high)
        pose, unit = self.poses[0], np.array(direction)
        changes["coulomb_friction"] = quantity(float(np.abs(unit) @ pose.coulomb_friction))
        changes["force_offset"] = quantity(float(unit @ pose.force_offset))
        return self.model_copy(update=changes)

    def by_axis(self) -> dict[str, list[Quantity]]:
        """Entries of both matrices, friction and offset of several axes, at each pose; SI units.

        Names are those of the covariance (mass_x_y, the axes in alphabetical order) and, of an
        axis, coulomb_friction_x and force_offset_x. Intervals are of 95 % each; no file holds those
        of friction and offset, which are taken as a tenth of the friction.
        """
        found: dict[str, list[Quantity]] = {}
        axes = self.axes or ()
        pairs = tuple(zip(*np.triu_indices(len(axes)), strict=True))
        for pose in self.poses or ():
            half = pose.deviations() * np.sqrt(np.diag(np.array(pose.covariance.matrix)))
            for kind, which in enumerate(("mass", "damping")):
                for place, (row, column) in enumerate(pairs):
                    one, other = sorted((axes[row], axes[column]))
                    value = float(getattr(pose, which)[row][column])
                    wide = float(half[place + kind * len(pairs)])
                    item = quantity(value, value - wide, value + wide)
                    found.setdefault(f"{which}_{one}_{other}", []).append(item)
            for place, axis in enumerate(axes):
                wide = _ROUGH * pose.coulomb_friction[place]
                for which in ("coulomb_friction", "force_offset"):
                    value = float(getattr(pose, which)[place])
                    item = quantity(value, value - wide, value + wide)
                    found.setdefault(f"{which}_{axis}", []).append(item)
        return found

    def in_words(self, direction: Sequence[float]) -> str:
        """A direction of a device of several axes in a sentence."""
        return direction_in_words(direction, self.axis.split(","))

    @property
    def slope_at_zero(self) -> float:
        """Slope of the force by position where the position is zero, k + gs, N/m; best estimate."""
        own = 0.0 if self.position_stiffness is None else self.position_stiffness.value
        return own if self.gravity is None else own + self.gravity.sine.value

    def _slopes(self, factor: float) -> tuple[float, float]:
        """(least, largest) slope of the force by position, intervals widened by a factor, N/m."""
        low = high = steepest = 0.0
        if self.position_stiffness is not None:
            low, high = widen_interval(self.position_stiffness, factor)
        if self.gravity is not None:
            parts = (
                widen_interval(part, factor) for part in (self.gravity.sine, self.gravity.cosine)
            )
            steepest = math.hypot(*(max(abs(least), abs(most)) for least, most in parts))
        return low - steepest, high + steepest

    def _identified(self) -> Iterator[Quantity]:
        """Everything a log tells, known exactly or not."""
        yield from (self.mass, self.damping, self.coulomb_friction, self.force_offset)
        for pair in (self.damping_by_direction, self.friction_by_direction):
            if pair is not None:
                yield from (pair.forward, pair.backward)
        if self.position_stiffness is not None:
            yield self.position_stiffness
        if self.gravity is not None:
            yield from (self.gravity.sine, self.gravity.cosine)


def named_devices() -> tuple[str, ...]:
    """Names of the devices that come with haptune."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


@typed
def load_device(reference: str | PathLike[str]) -> Device:
    """A device from a file, or a named one. Raises InvalidInputError."""
    name, path = fspath(reference), Path(reference)
    # The function of os.path also takes names that no file can have.
    if name in named_devices() and not isfile(path):  # noqa: PTH113
        return _named(name)
    if path.suffix == "" and not exists(path):  # noqa: PTH110
        problem = "is neither a file nor a named device"
        raise InvalidInputError(reference, problem, f"Named devices: {', '.join(named_devices())}")
    return load_document(Device, path)


@cache
def _named(name: str) -> Device:
    return load_document(Device, _FOLDER / f"{name}.yaml")
