"""A profile as data: JSON for programs of any kind; parameters, law and thin node for ROS 2."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any, Literal, NotRequired, cast

# pydantic reads this one on every Python; it is part of what pydantic itself needs.
from typing_extensions import TypedDict

from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile
from tune.exporters.law import LAW_IN_WORDS, Estimate, largest_change, section_of
from tune.exporters.text import (
    digest,
    findings_of,
    force_limit,
    hash_comment,
    heading,
    identifiers,
    quote_yaml,
)

#: Letters of a name; the parser of ROS 2 takes texts of up to 256 bytes.
_LONGEST_TEXT = 60


class ExportedDevice(TypedDict):
    """The device that the profile is certified for."""

    name: str
    axis: str
    motion: Literal["linear", "rotary"]


class ExportedMargin(TypedDict):
    """Stable for every gain in (0, ``gain``] with so many more samples of delay."""

    name: Literal["conservative", "balanced", "firm"]
    gain: float
    extra_delay_samples: float


class NoFilter(TypedDict):
    """The difference as it is."""

    kind: Literal["none"]


class WindowFilter(TypedDict):
    """The difference over so many samples."""

    kind: Literal["window"]
    samples: int


class LowPassFilter(TypedDict):
    """x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k]; ``a`` is the pole where there is one or two equal."""

    kind: Literal["first-order", "second-order"]
    cutoff_hz: float
    a: NotRequired[float]
    damping_ratio: NotRequired[float]
    t: float
    p: float
    g: float


Filter = NoFilter | WindowFilter | LowPassFilter


class ExportedForceLimit(TypedDict):
    """What the actuator gives for long and for a moment."""

    continuous: float
    peak: float


class ExportedElement(TypedDict):
    """Effects of one element; ``fade_time`` is 0 where it is switched at once.

    ``force_level`` is the most that its spring gives, N (N·m); ``speed`` that with which it is met.
    """

    stiffness: float
    damping: float
    mass: float
    one_sided: bool
    force_level: float
    speed: float
    fade_time: float


class Exported(TypedDict):
    """A certified profile for programs of any kind.

    ``moments`` are the sets of elements that may act at once, ``apart`` pairs that never do;
    ``taps`` are samples; ``law`` says how force comes of them.
    """

    schema: Literal["haptune/export/1"]
    digest: str
    device: ExportedDevice
    scene: str
    margin: ExportedMargin
    sample_time: float
    delay_samples: float
    velocity: Filter
    acceleration: Filter
    force_limit: ExportedForceLimit
    elements: dict[str, ExportedElement]
    moments: list[list[str]]
    apart: list[list[str]]
    taps: int
    largest_change: float
    findings: dict[str, list[str]]
    law: str
    assumes: list[str]
    not_assessed: list[str]


def plain_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_profile.json: gains, filter coefficients, limits; SI units."""
    device, seal, limit = profile.device, profile.certificate, force_limit(profile)
    content: Exported = {
        "schema": "haptune/export/1",
        "digest": digest(profile),
        "device": {"name": device.name, "axis": device.axis, "motion": device.motion},
        "scene": profile.scene,
        "margin": {
            "name": profile.margin.name,
            "gain": seal.gain,
            "extra_delay_samples": seal.extra_delay_samples,
        },
        "sample_time": profile.loop.sample_time,
        "delay_samples": profile.loop.extra_delay_samples,
        "velocity": _filter(profile.loop, "velocity"),
        "acceleration": _filter(profile.loop, "acceleration"),
        "force_limit": {"continuous": limit.continuous, "peak": limit.peak},
        "elements": {name: _element(each) for name, each in profile.elements.items()},
        "moments": [list(moment) for moment in profile.moments()],
        "apart": [list(pair) for pair in profile.apart],
        "taps": seal.longest_tap,
        "largest_change": largest_change(profile),
        "findings": findings_of(profile),
        "law": LAW_IN_WORDS,
        "assumes": list(seal.assumes),
        "not_assessed": list(seal.not_assessed),
    }
    return {"haptune_profile.json": json.dumps(content, indent=2) + "\n"}


def ros2_files(profile: SafeProfile, node: str) -> dict[str, str]:
    """haptune_params.yaml, haptune_law.py and haptune_node.py.

    Parameters are only what ROS 2 can hold: numbers, texts, and lists of one kind that are not
    empty. Every text is in quotes, every float has a point, so that no reader mistakes one.
    The name of the node has its namespaces, such as /robot/haptune.
    """
    device, seal, limit = profile.device, profile.certificate, force_limit(profile)
    keys = identifiers(profile.elements)
    parameters: dict[str, Any] = {
        "digest": digest(profile),
        "device": device.name[:_LONGEST_TEXT],
        "axis": device.axis[:_LONGEST_TEXT],
        "motion": device.motion,
        "sample_time": profile.loop.sample_time,
        "delay_samples": float(profile.loop.extra_delay_samples),
        "margin": {"gain": seal.gain, "extra_delay_samples": int(seal.extra_delay_samples)},
        "velocity": _filter(profile.loop, "velocity"),
        "acceleration": _filter(profile.loop, "acceleration"),
        "taps": seal.longest_tap,
        "largest_change": largest_change(profile),
        "force_limit": {"continuous": limit.continuous, "peak": limit.peak},
        "element_names": list(keys.values()),
        "elements": {
            keys[name]: {"name": name[:_LONGEST_TEXT], **_element(element)}
            for name, element in profile.elements.items()
        },
    }
    for kind, word, sets in (
        ("together", "group", profile.together),
        ("apart", "pair", profile.apart),
    ):
        named = {f"{word}_{k}": [keys[name] for name in each] for k, each in enumerate(sets, 1)}
        if named:  # no empty lists in ROS 2
            parameters[f"{word}_names"] = list(named)
            parameters[kind] = named
    head = (
        *heading(profile),
        "",
        f"SI units. {LAW_IN_WORDS}. Moments are each element alone, any part of a group of "
        "'together', and each of these beside what is one_sided, but for the pairs of 'apart'.",
    )
    body = "\n".join(_lines({node: {"ros__parameters": parameters}}, ""))
    comment = hash_comment(heading(profile))
    templates = files("tune") / "templates"
    files_of = {"haptune_params.yaml": hash_comment(head) + body + "\n"}
    for name in ("law.py", "node.py"):
        text = (templates / name).read_text(encoding="utf-8")
        text = text.replace("${digest}", digest(profile))
        files_of[f"haptune_{name}"] = (
            f"{comment}\n{text.replace('${node}', node.rpartition('/')[2])}"
        )
    return files_of


def _element(element: ElementProfile) -> ExportedElement:
    return {
        "stiffness": element.stiffness,
        "damping": element.damping,
        "mass": element.mass,
        "one_sided": element.one_sided,
        "force_level": element.force_level,
        "speed": element.motion.speed,
        "fade_time": element.fade_time,
    }


def _filter(loop: LoopProfile, which: Estimate) -> Filter:
    """Kind, cut-off in Hz where there is one, and coefficients of one filter."""
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return {"kind": "window", "samples": window}
    cutoff = getattr(loop, f"{which}_filter_hz")
    if cutoff is None:
        return {"kind": "none"}
    section = section_of(loop, which)
    order = getattr(loop, f"{which}_filter_order")
    found: LowPassFilter = {
        "kind": "first-order" if order == 1 else "second-order",
        "cutoff_hz": cutoff,
        "t": section.t,
        "p": section.p,
        "g": section.gain,
    }
    if order == 1 or loop.filter_damping_ratio == 1:
        found["a"] = section.t / order
    if order == 2:
        found["damping_ratio"] = loop.filter_damping_ratio
    return found


def _lines(content: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield f"{indent}{key}:"
            yield from _lines(cast("Mapping[str, Any]", value), indent + "  ")
        else:
            yield f"{indent}{key}: {_scalar(value)}"


def _scalar(value: float | str | list[str]) -> str:
    """A value that YAML 1.1, YAML 1.2 and strtod read alike."""
    if isinstance(value, list):
        return f"[{', '.join(_scalar(item) for item in value)}]"
    if isinstance(value, str):
        return quote_yaml(value)
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
