"""What a person has to state of a device, and the question that lists what nobody stated.

A log shows no unit, no force limit and no encoder: a force in mN changes every parameter by one
factor and no residual. These facts come from a person or a data sheet, or nothing is certified.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from os import PathLike, fspath
from typing import Literal, cast, get_args

from identification.errors import Unstated, UnstatedError

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


def missing_of(content: Mapping[str, object]) -> tuple[Fact, ...]:
    """The facts that the content of a device file does not state, in the order of FACTS.

    Missing is what stands under ``missing``, what is absent, and what has ``source: log``; but a
    delay of a log counts as stated if its interval is no wider than a sample. What somebody assumed
    is stated as that. A file without ``missing`` that has facts of a log was identified before they
    were marked, when an axis that nobody asked about was called linear: there motion is missing.
    """
    listed = content.get("missing")
    named = cast("Collection[str]", listed) if isinstance(listed, tuple | list) else ()
    found = {fact for fact in FACTS if fact in named}
    found |= {fact for fact in FACTS if content.get(fact) is None}
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
    """The error that asks for all facts missing at once.

    Args:
        subject: the file or device asked about.
        missing: at least one fact.
        content: of the device: what comes from a log is a hint for the person, which is not used.
        where: a sentence that says where to write the facts.
    """
    facts = tuple(
        Unstated(key=fact, write=_WRITE[fact], hint=_hint(fact, content.get(fact)))
        for fact in FACTS
        if fact in missing
    )
    return UnstatedError(fspath(subject), facts, where)


def _hint(fact: Fact, item: object) -> str:
    if fact not in _HINT or _part(item, "source") != "log":
        return ""
    numbers = {name: _part(item, name) for name in ("value", "low", "high", "peak")}
    return _HINT[fact].format(**numbers)
