"""What a person states of an axis before a log is taken, and the question for what is missing.

A log shows no unit, no force limit and no encoder: a force in mN changes every parameter by one
factor and no residual. These facts come from a person or a data sheet, or nothing is certified.
"""

from __future__ import annotations

import datetime
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Annotated, Any, Literal, cast, get_args

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from identification.device.quantities import (
    LARGEST,
    AnyQuantity,
    PositiveQuantity,
    Quantity,
    Source,
    quantity,
    widest,
)
from identification.documents import Document
from identification.errors import Finding, Unstated, UnstatedError
from identification.trajectory import LOST, NORMAL_95, Motion, Trajectory, finest_reading

#: Part of the steps between stamps that the stored interval of the sample time holds.
_PART = 0.95
#: Characters of a name; more is a text.
_LONGEST = 120
#: s: a loop of 10 MHz.
SHORTEST_STEP = 1e-7
#: m (rad): a count finer than an atom's nucleus.
_FINEST_COUNT = 1e-15
#: Modes that one axis may state; each adds two to the degree of the loop.
MOST_MODES = 4
#: A stated mode within this factor of the frequency of one found is that one.
AS_STATED = 1.2
#: A participation beyond it belongs to another choice of the rigid mass.
_LARGEST_PARTICIPATION = 100.0

Fact = Literal["motion", "sample_time", "delay", "encoder_resolution", "force_limit"]
#: In the order in which they are asked for.
FACTS: tuple[Fact, ...] = get_args(Fact)

#: What to write for each. Numbers stand beside what they are right for, so that nobody takes over
#: those of another device.
_WRITE: dict[Fact, str] = {
    "motion": "motion: linear (kg, N·s/m, N, m) or motion: rotary (kg·m², N·m·s/rad, N·m, rad)",
    "sample_time": "sample_time: the period of the control loop in s, such as 0.001 for a loop of "
    "1 kHz, whatever the log was written with",
    "delay": "delay: s from command to measurement, 0 where there is none, such as 0.001 for one "
    "sample of a loop of 1 kHz; {value: …, low: …, high: …} where it is not exact",
    "encoder_resolution": "encoder_resolution: one count at the handle in m (rad), such as "
    "0.000767 rad for 8192 counts a turn without a gear",
    "force_limit": "force_limit: {continuous: …, peak: …} of the actuator at the handle in N (N·m) "
    "by its data sheet, such as {continuous: 14.0, peak: 28.0} for 14 N for long and 28 N for a "
    "moment",
}
#: What a log suggests, filled in with its numbers.
_HINT: dict[Fact, str] = {
    "sample_time": "the log steps by {value:.6g} s",
    "delay": "the log allows {low:.4g} to {high:.4g} s",
    "encoder_resolution": "the finest reading of position in the log is {value:.4g}",
    "force_limit": "the largest force in the log is {peak:.4g}; if that is not N (N·m) but volts, "
    "amperes or mN, identify again with --force-gain, N (N·m) per unit of the column",
}


def _one_line(raw: object) -> object:
    if isinstance(raw, int | float):
        raise ValueError("put it in quotes; a number loses its leading zeros")
    if isinstance(raw, str) and not (raw.strip() and raw.isprintable()):
        raise ValueError("give one line of text, or leave the key out")
    return raw


def _iso_date(raw: object) -> object:
    try:
        return datetime.date.fromisoformat(str(raw)).isoformat()
    except ValueError:
        raise ValueError("give a date as year-month-day, such as 2026-11-22") from None


def _no_finer(count: Quantity) -> Quantity:
    if count.source != "log" and count.low < _FINEST_COUNT:  # a log's is a hint, and any
        raise ValueError(f"must be {_FINEST_COUNT:g} or more over its interval, not {count.low:g}")
    return count


def _of_all_axes(raw: object) -> object:
    parts: Iterable[object] = getattr(raw, "values", lambda: [raw])()
    if any(isinstance(each, list | tuple) for each in parts):
        raise ValueError("give one for all axes: the coarsest count, the smallest force limit")
    return raw


#: What an encoder can tell, m (rad).
Resolution = Annotated[PositiveQuantity, BeforeValidator(_of_all_axes), AfterValidator(_no_finer)]
#: One line of text.
Label = Annotated[str, BeforeValidator(_one_line), Field(max_length=_LONGEST)]
#: A day as year-month-day (ISO 8601).
Day = Annotated[str, BeforeValidator(_iso_date), Field(json_schema_extra={"format": "date"})]


class Mode(Document):
    """One vibration mode of the mechanism, in generalised coordinates.

    m·(q̈ᵢ + 2·ζ·ω·q̇ᵢ + ω²·qᵢ) = e·F - h·F_hand beside the rigid coordinate of mass m; the encoder
    reads q₀ + Σ e·qᵢ and the handle moves by q₀ + Σ h·qᵢ. A motor of mass m₁ and a handle of mass
    m₂ on a spring have e = √(m₂/m₁) and h = -√(m₁/m₂).

    Attributes:
        frequency_hz: ω/2π, Hz, without damping.
        damping_ratio: ζ.
        at_encoder: e, the participation where the motor pulls and the encoder reads.
        at_handle: h, the participation at the handle; left out: the same as at_encoder.
    """

    frequency_hz: PositiveQuantity
    damping_ratio: PositiveQuantity
    at_encoder: float = Field(ge=-_LARGEST_PARTICIPATION, le=_LARGEST_PARTICIPATION)
    at_handle: float = Field(
        ge=-_LARGEST_PARTICIPATION,
        le=_LARGEST_PARTICIPATION,
        description="left out: the same as at_encoder",
    )

    @model_validator(mode="before")
    @classmethod
    def _grip_at_the_encoder(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and "at_handle" not in raw and "at_encoder" in raw:
            return {**raw, "at_handle": raw["at_encoder"]}  # pyright: ignore[reportUnknownVariableType]
        return raw  # pyright: ignore[reportUnknownVariableType]

    @model_validator(mode="after")
    def _underdamped(self) -> Mode:
        if self.damping_ratio.high >= 1:
            raise ValueError(
                f"damping_ratio must be below 1 over its interval, not {self.damping_ratio.high:g}"
                "; what does not vibrate is no mode"
            )
        return self


class ForceLimit(Document):
    """What the actuator can give at the handle, of several axes in any direction, N (N·m)."""

    continuous: float = Field(ge=0, le=LARGEST)
    peak: float = Field(ge=0, le=LARGEST)
    source: Source | None = None

    @model_validator(mode="before")
    @classmethod
    def _one(cls, raw: object) -> object:
        return _of_all_axes(raw)

    @model_validator(mode="after")
    def _ordered(self) -> ForceLimit:
        if self.continuous > self.peak:
            raise ValueError(f"continuous {self.continuous:g} exceeds peak {self.peak:g}")
        return self


class Hardware(Document):
    """What is known before a log is taken (hardware.yaml); every key optional.

    A key that is absent or blank is not stated. Before anything is certified, motion, sample time,
    encoder resolution and force limit must be, and the delay unless the log tells it.

    Attributes:
        name: of the device.
        axis: name of the axis.
        serial: serial number.
        date: of the calibration, year-month-day.
        operator: who takes the logs.
        motion: "linear" (N, m) or "rotary" (N·m, rad); None where nobody stated it.
        sample_time: s, of the control loop.
        delay: s, from command to measurement.
        encoder_resolution: m (rad), one count at the handle.
        force_limit: N (N·m) at the handle.
        modes: vibration of the mechanism.
        current_lag: s, time constant of the current loop, if it is slow.
        axes: names of the axes of a device of several, in the order of their columns; the facts
            hold for each of them.
    """

    schema_: Literal["haptune/hardware/1"] = Field(default="haptune/hardware/1", alias="schema")
    name: str = "device"
    axis: Label = "x"
    serial: Label | None = None
    date: Day | None = None
    operator: Label | None = None
    motion: Motion | None = None
    sample_time: AnyQuantity | None = None
    delay: AnyQuantity | None = None
    encoder_resolution: Resolution | None = None
    force_limit: ForceLimit | None = None
    modes: tuple[Mode, ...] = Field(default=(), max_length=MOST_MODES)
    current_lag: PositiveQuantity | None = None
    axes: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _sane(self) -> Hardware:
        if self.sample_time is not None and self.sample_time.low < SHORTEST_STEP:
            raise ValueError(
                f"sample_time must be {SHORTEST_STEP:g} s or more, not {self.sample_time.low:g} s"
            )
        if self.delay is not None and self.delay.low < 0:
            raise ValueError(f"delay must not be negative, not {self.delay.low:g} s")
        return self


def missing_of(content: Mapping[str, object]) -> tuple[Fact, ...]:
    """The facts that the content of a device file does not state, in the order of FACTS.

    Missing is what stands under ``missing``, what is absent, and what has ``source: log``; but a
    delay of a log counts as stated if its interval is no wider than a sample. What somebody assumed
    is stated as that. A file without ``missing`` that has facts of a log was identified before they
    were marked, when an axis that nobody asked about was called linear: there motion is missing.
    """
    listed = content.get("missing")
    named = cast("Collection[str]", listed) if isinstance(listed, tuple | list) else ()
    found = {fact for fact in FACTS if fact in named or content.get(fact) is None}
    for fact in ("sample_time", "encoder_resolution", "force_limit"):
        if _part(content.get(fact), "source") == "log":
            found |= {fact} if "missing" in content or not content.get("logs") else {fact, "motion"}
    if not _tells_delay(content):
        found.add("delay")
    return tuple(fact for fact in FACTS if fact in found)


def _tells_delay(content: Mapping[str, object]) -> bool:
    delay, step = content.get("delay"), content.get("sample_time")
    if _part(delay, "source") != "log":
        return True
    value = _part(delay, "value")
    ends = [_part(delay, name) for name in ("low", "high")]
    low, high = (value if end is None else end for end in ends)
    width = _part(step, "value") if _part(step, "value") is not None else step
    if not all(isinstance(each, int | float) for each in (low, high, width)):
        return True  # what is no number is refused as that
    return cast("float", high) - cast("float", low) <= cast("float", width)


def _part(item: object, name: str) -> object:
    """One entry of a quantity, as it stands in a file or as a document."""
    if isinstance(item, Mapping):
        return cast("Mapping[str, object]", item).get(name)
    return getattr(item, name, None)


def question(
    subject: str | PathLike[str],
    missing: Collection[Fact],
    content: Mapping[str, object],
    where: str,
) -> UnstatedError:
    """The error that asks for all facts missing at once, and hints at what comes from a log."""
    facts = tuple(
        Unstated(key=fact, write=_WRITE[fact], hint=_hint(fact, content.get(fact)))
        for fact in missing
    )
    return UnstatedError(fspath(subject), facts, where)


def _hint(fact: Fact, item: object) -> str:
    if fact not in _HINT or _part(item, "source") != "log":
        return ""
    numbers = {name: _part(item, name) for name in ("value", "low", "high", "peak")}
    return _HINT[fact].format(**numbers)


def mark_stated(known: Quantity | None) -> Quantity | None:
    """What the hardware states, marked so; what it only assumes stays assumed."""
    if known is None or known.source is not None:
        return known
    return known.model_copy(update={"source": "hardware"})


def is_near(found: Quantity, stated: Quantity, factor: float = AS_STATED) -> bool:
    """Whether a value found is within a factor of the interval stated."""
    return stated.low / factor <= found.value <= stated.high * factor


def held_modes(stated: Sequence[Mode], found: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes stated, each widened to what logs show of it, and those of logs beside them."""
    held = list(stated)
    for seen in found:
        near = [each for each in held if is_near(seen.frequency_hz, each.frequency_hz)]
        if not near:
            held.append(seen)
            continue
        known = near[0]
        hull: dict[str, object] = {
            name: widest(getattr(known, name), [getattr(seen, name)])
            for name in ("frequency_hz", "damping_ratio")
        }
        if seen.at_encoder > abs(known.at_encoder):
            hull["at_encoder"] = float(np.copysign(seen.at_encoder, known.at_encoder))
        held[held.index(known)] = known.model_copy(update=hull)
    return tuple(held)


@dataclass(frozen=True, slots=True, kw_only=True)
class SuggestedFacts:
    """What logs suggest of the facts that a person has to state."""

    logs: tuple[Trajectory, ...]
    #: read from them, s, each with its standard deviation; none where it was stated
    delays: tuple[tuple[float, float], ...]

    def sample_time(self, hardware: Hardware) -> Quantity:
        """The sample time stated, or the mean and spread of the steps between stamps, s."""
        known = mark_stated(hardware.sample_time)
        if known is not None:
            return known
        logs = [np.asarray(log.steps) for log in self.logs]
        # Lost rows are long steps of the log, not of the loop.
        usual = [steps[steps <= LOST * np.median(steps)] for steps in logs]
        means = [float(np.mean(steps)) for steps in usual]
        low = min(float(np.quantile(steps, (1 - _PART) / 2)) for steps in usual)
        high = max(float(np.quantile(steps, (1 + _PART) / 2)) for steps in usual)
        value = float(np.mean(means))
        return quantity(value, min(low, value), max(high, value), source="log")

    def delay(self, hardware: Hardware) -> Quantity:
        """The delay stated with what contradicts it, or what logs allow up to a sample at least.

        A loop that computes between reading and commanding is later than one that plays a plan.
        """
        known = mark_stated(hardware.delay)
        if known is not None and not self.delays:
            return known
        least = self.sample_time(Hardware()).value
        low = min(value - NORMAL_95 * deviation for value, deviation in self.delays)
        high = max(value + NORMAL_95 * deviation for value, deviation in self.delays)
        if known is not None:  # contradicted: whichever is right
            ends = {"low": max(min(low, known.low), 0.0), "high": max(high, known.high)}
            return known.model_copy(update=ends)
        value = max(value for value, _ in self.delays)
        return quantity(max(value, least), max(low, 0.0), max(high, least), source="log")

    def of_device(self, hardware: Hardware, motion: Motion | None) -> dict[str, Any]:
        """What a device has of its hardware and, where that states nothing, of its logs."""
        return {
            **{name: getattr(hardware, name) for name in ("name", "serial", "date", "operator")},
            "motion": motion or "linear",
            "missing": () if motion else ("motion",),
            "sample_time": self.sample_time(hardware),
            "delay": self.delay(hardware),
            "encoder_resolution": mark_stated(hardware.encoder_resolution)
            or quantity(self._resolution(), source="log"),
        }

    def _resolution(self) -> float:
        """The coarsest of the finest readings of position, m (rad)."""
        return max(finest_reading(log.position, log.force) for log in self.logs)

    def _largest_force(self) -> float:
        """The largest force logged, in its unit."""
        return max(float(np.max(np.abs(log.force))) for log in self.logs)

    def force_limit(self) -> ForceLimit:
        """The largest force logged, N (N·m), as far as there are such; no limit of an actuator."""
        peak = min(self._largest_force(), LARGEST)
        return ForceLimit(continuous=peak, peak=peak, source="log")

    def not_stated(self, hardware: Hardware) -> Iterator[Finding]:
        """``not-stated``: facts that no hardware file states, and what the logs suggest of them."""
        facts: list[str] = []
        if self.logs[0].motion is None:
            # Whether an axis turns cannot be seen: radians and metres are numbers.
            travel = max(float(np.ptp(log.position)) for log in self.logs)
            which = f"position spans {travel:.4g}, which may be m or rad"
            facts.append(f"motion: linear or motion: rotary ({which})")
        if hardware.force_limit is None:
            reached = self._largest_force()
            facts.append(f"force_limit (the log reaches {reached:.4g}, in its unit)")
        if hardware.encoder_resolution is None:
            facts.append(f"encoder_resolution ({self._resolution():.4g} by the log)")
        if facts and hardware.delay is None:  # alone it need not be stated
            given = self.delay(hardware)
            facts.append(f"delay ({given.low * 1e3:.4g} to {given.high * 1e3:.4g} ms by the log)")
        if facts:
            yield Finding(
                code="not-stated",
                seen="nobody states " + ", ".join(facts),
                needed="facts from a data sheet, in N, m (N·m, rad) and s, before anything is "
                "certified",
                remedy="State them in the hardware file (--hardware).",
            )
