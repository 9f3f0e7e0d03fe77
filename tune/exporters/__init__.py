"""Certified profiles as files for controllers.

``export`` compares the digest of the profile; the command re-checks the certificate first.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from string import Template
from typing import Any, Literal, NotRequired, cast, get_args

# pydantic reads this one on every Python; it is part of what pydantic itself needs.
from typing_extensions import TypedDict

from identification import InvalidInputError, UsageError, to_mapping, typed
from tune.documents import refuse_unknown
from tune.documents.estimators import Derivative, Estimator, filter_of
from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile, signed_content
from tune.documents.scene import EffectName
from tune.exporters.law import (
    NOT_A_SAFETY_FUNCTION,
    block_comment,
    change_words,
    fade_step,
    findings_of,
    force_limit,
    hash_comment,
    heading,
    identifiers,
    inside_comment,
    largest_change,
    law_in_words,
    quote_yaml,
    short,
    unit_of_force,
)

__all__ = ["NOT_A_SAFETY_FUNCTION", "TARGETS", "Target", "export", "refuse_strange_node"]

Target = Literal["ros2", "c", "chai3d", "json"]
TARGETS: tuple[Target, ...] = get_args(Target)

#: Bits of the set of elements that the guard is given.
_MOST_ELEMENTS = 64


def _c_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_guard.h and haptune_guard.c; InvalidInputError for more elements than it holds."""
    if len(profile.elements) > _MOST_ELEMENTS:
        raise InvalidInputError(
            "elements",
            f"the profile has {len(profile.elements)}, a guard holds {_MOST_ELEMENTS}",
            "Split the scene",
        )
    values = _guard_values(profile)
    return {
        f"haptune_guard.{end}": _filled(
            f"guard.{end}", values | {"of_axes": _for_axes(f"axes.{end}", profile, values)}
        )
        for end in ("h", "c")
    }


def _for_axes(name: str, profile: SafeProfile, values: Mapping[str, str]) -> str:
    """A template of what only devices of several axes have; "" for one axis."""
    return "" if profile.device.axes is None else _filled(name, values)


def _axes(profile: SafeProfile) -> dict[str, str]:
    names = profile.device.axes or ()
    return {"axes": _plain(", ".join(names)), "axis_count": str(len(names))}


def _chai3d_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_chai3d.hpp and the guard that it plays damping and mass with.

    Materials are springs of linear axes (N/m); on a rotary axis the guard plays everything.
    """
    limit, words = force_limit(profile), _macros(profile)
    rotary = profile.device.motion == "rotary"
    springs = [
        f"    case {words[name]}:\n"
        f"        material->setStiffness({_number(element.stiffness)} / workspace_scale);\n"
        f"        return true;\n"
        for name, element in profile.elements.items()
        if element.stiffness > 0 and element.damping == 0 and element.mass == 0 and not rotary
    ]
    kind, load = ("Angular", "Torque") if rotary else ("Linear", "Force")
    values = {
        **_tags(profile),
        "max_force": f"m_max{kind}{load}",
        "max_stiffness": f"m_max{kind}Stiffness",
        "max_damping": f"m_max{kind}Damping",
        "stiffness": _number(_largest(profile, "stiffness")),
        "damping": _number(_largest(profile, "damping")),
        "heading": block_comment(heading(profile)),
        "continuous": _number(limit.continuous),
        "peak": _number(limit.peak),
        "springs": "".join(springs),
        "what": "Torque (N*m)" if rotary else "Force (N)",
        **_axes(profile),
    }
    header = _filled("chai3d.hpp", values | {"of_axes": _for_axes("axes.hpp", profile, values)})
    return {"haptune_chai3d.hpp": header, **_c_files(profile)}


def _largest(profile: SafeProfile, effect: EffectName) -> float:
    """The largest sum of one effect over what may act at once; 0 where none is positive."""
    sizes: dict[str, float] = {
        name: getattr(element, effect) for name, element in profile.elements.items()
    }
    return max(0.0, *(sum(sizes[name] for name in names) for names in profile.combinations()))


def _filled(name: str, values: Mapping[str, str]) -> str:
    """A template with its $-names filled in."""
    text = (files("tune") / "templates" / name).read_text(encoding="utf-8")
    return Template(text).substitute(values)


def _macros(profile: SafeProfile) -> dict[str, str]:
    """The macro of each element."""
    return {
        name: f"HAPTUNE_ELEMENT_{word.upper()}"
        for name, word in identifiers(profile.elements).items()
    }


def _bits(names: Iterable[str], places: Mapping[str, int]) -> int:
    """The set of some elements: the union of their bits, however often one is named."""
    return sum(1 << places[name] for name in set(names))


def _number(value: float) -> str:
    """A double with all of its digits, as a C constant of type double."""
    text = f"{value:.17g}"
    return text if "." in text or "e" in text else text + ".0"


def _numbers(*values: float) -> str:
    return ", ".join(_number(value) for value in values)


def _guard_values(profile: SafeProfile) -> dict[str, str]:
    loop, seal = profile.loop, profile.certificate
    words = _macros(profile)
    places = {name: index for index, name in enumerate(profile.elements)}
    sets = sorted({_bits(names, places) for names in profile.combinations()})
    return {
        **_tags(profile),
        "heading": block_comment(heading(profile)),
        "digest": profile.digest,
        "sample_time": _number(loop.sample_time),
        "extra_delay": str(int(seal.extra_delay_samples)),
        "taps": str(seal.longest_tap),
        "window": str(loop.velocity_window_samples or 1),
        "change": _number(largest_change(profile)),
        "change_words": inside_comment(change_words(profile)),
        "elements": "".join(
            f"#define {words[name]} (UINT64_C(1) << {places[name]}) /* {_plain(name)} */\n"
            for name in profile.elements
        ),
        "together": _listed(profile.together, words, "none, one at a time"),
        "apart": _listed(profile.apart, words, "none"),
        "count": str(len(places)),
        "length": "rad" if profile.device.motion == "rotary" else "m",
        "force": unit_of_force(profile),
        "gain": f"{seal.gain:g}",
        "combination_count": str(len(sets)),
        "velocity_words": _words(loop, "velocity"),
        "velocity": _sections(loop, "velocity"),
        "acceleration_words": _words(loop, "acceleration"),
        "acceleration": _sections(loop, "acceleration"),
        "played": "".join(
            f"    {{{_effects(element, loop.sample_time)}}}, /* {_plain(name)} */\n"
            for name, element in profile.elements.items()
        ),
        "known": f"0x{(1 << len(places)) - 1:x}",
        "walls": f"0x{_bits(profile.walls, places):x}",
        "combinations": "".join(f"    UINT64_C(0x{each:x}),\n" for each in sets),
        "peak": _number(force_limit(profile).peak),
        **_axes(profile),
    }


def _tags(profile: SafeProfile) -> dict[str, str]:
    """The first digits of the profile's digest, as part of a name and as a constant."""
    word = profile.digest.removeprefix("sha256:")[:8]
    return {"word": word, "tag": f"0x{word}u"}


def _plain(name: str) -> str:
    return inside_comment(short(name))


def _listed(sets: Iterable[Iterable[str]], words: Mapping[str, str], none: str) -> str:
    lines = [" | ".join(words[name] for name in each) for each in sets] or [none]
    return "\n".join(
        textwrap.fill(line, 96, initial_indent=" *   ", subsequent_indent=" *     ")
        for line in lines
    )


def _sections(loop: LoopProfile, which: Derivative) -> str:
    behind = Estimator.of(loop, which, loop.sample_time)
    rows = (f"{{{_numbers(each.t, each.p, each.gain)}}}" for each in (behind.first, behind.then))
    return f"{{{', '.join(rows)}}}, {_number(behind.lead)}"


def _effects(element: ElementProfile, sample_time: float) -> str:
    lead_time = element.damping / element.stiffness if element.stiffness > 0 else 0.0
    sizes = _numbers(element.stiffness, element.damping, element.mass)
    limits = _numbers(element.force_level, lead_time, element.motion.speed)
    step = _number(fade_step(element, sample_time))
    return f"{sizes}, {limits}, {element.one_sided:d}, {step}"


def _words(loop: LoopProfile, which: Derivative) -> str:
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return f"moving window of {window} samples; t, p, g, lead"
    kind, cutoff, order = filter_of(loop, which)
    if cutoff is None:
        return "no filter; t, p, g, lead"
    ratio = f", damping ratio {loop.filter_damping_ratio:g}" if order >= 2 else ""
    words = "order" if kind == "low-pass" else "tracking, states"
    return f"{words} {order}, {cutoff:g} Hz{ratio}; t, p, g, lead"


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
    """x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k]; ``a`` is the pole where there is one or two equal.

    A tracking filter has its ``states``, and may have a second section behind the first and a
    ``lead``: it gives x[k] + lead·(x[k] - x[k-1]), in samples.
    """

    kind: Literal["first-order", "second-order", "tracking"]
    cutoff_hz: float
    states: NotRequired[int]
    a: NotRequired[float]
    damping_ratio: NotRequired[float]
    t: float
    p: float
    g: float
    t2: NotRequired[float]
    p2: NotRequired[float]
    g2: NotRequired[float]
    lead: NotRequired[float]


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

    ``combinations`` are the sets of elements that may act at once, ``apart`` pairs that never do;
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
    combinations: list[list[str]]
    apart: list[list[str]]
    taps: int
    largest_change: float
    findings: dict[str, list[str]]
    law: str
    assumes: list[str]
    not_assessed: list[str]


def _plain_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_profile.json: gains, filter coefficients, limits; SI units."""
    device, seal, limit = profile.device, profile.certificate, force_limit(profile)
    content: Exported = {
        "schema": "haptune/export/1",
        "digest": profile.digest,
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
        "combinations": [list(names) for names in profile.combinations()],
        "apart": [list(pair) for pair in profile.apart],
        "taps": seal.longest_tap,
        "largest_change": largest_change(profile),
        "findings": findings_of(profile),
        "law": law_in_words(profile),
        "assumes": list(seal.assumes),
        "not_assessed": list(seal.not_assessed),
    }
    return {"haptune_profile.json": json.dumps(content, indent=2) + "\n"}


def _ros2_files(profile: SafeProfile, node: str) -> dict[str, str]:
    """A package that colcon and pip install: parameters, law, node, and what makes it one.

    Parameters are only what ROS 2 can hold: numbers, texts, and lists of one kind that are not
    empty. Every text is in quotes, every float has a point, so that no reader mistakes one.
    The name of the node has its namespaces, such as /robot/haptune.
    """
    device, seal, limit = profile.device, profile.certificate, force_limit(profile)
    keys = identifiers(profile.elements)
    parameters: dict[str, Any] = {
        "digest": profile.digest,
        "device": device.name[:_LONGEST_TEXT],
        "axis": device.axis[:_LONGEST_TEXT],
        **({} if device.axes is None else {"axes": list(device.axes)}),
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
        f"SI units. {law_in_words(profile)}. Combinations are each element alone, any part of a "
        "group of 'together', and each of these beside what is one_sided, but for the pairs of "
        "'apart'.",
    )
    body = "\n".join(_lines({node: {"ros__parameters": parameters}}, ""))
    comment = hash_comment(heading(profile))
    filled = {"digest": profile.digest, "node": node.rpartition("/")[2]}
    files_of = {"haptune_params.yaml": hash_comment(head) + body + "\n"}
    more = () if device.axes is None else ("axes", "node_of_axes")
    for name in ("law", "node", *more):
        files_of[f"haptune_{name}.py"] = f"{comment}\n{_filled(f'{name}.py', filled)}"
    plain = "\n".join(heading(profile)).replace("--", "- -").replace("--", "- -")
    plain = plain.replace("&", "&amp;").replace("<", "&lt;")
    return files_of | {
        "package.xml": _filled("package.xml", {"heading": plain}),
        "setup.cfg": _filled(
            "setup.cfg",
            {
                "heading": comment.rstrip("\n"),
                "modules": "".join(f"    haptune_{name}\n" for name in more),
                "programs": "    haptune_node_of_axes = haptune_node_of_axes:run\n" * bool(more),
            },
        ),
        "setup.py": f"{comment}\nfrom setuptools import setup\n\nsetup()\n",
        "haptune_controller": comment,  # what the index of ROS 2 finds the package by
    }


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


def _filter(loop: LoopProfile, which: Derivative) -> Filter:
    """Kind, cut-off in Hz where there is one, and coefficients of one filter."""
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return {"kind": "window", "samples": window}
    kind, cutoff, order = filter_of(loop, which)
    if cutoff is None:
        return {"kind": "none"}
    behind = Estimator.of(loop, which, loop.sample_time)
    section, then = behind.first, behind.then
    found: LowPassFilter = {
        "kind": "first-order" if order == 1 else "second-order",
        "cutoff_hz": cutoff,
        "t": section.t,
        "p": section.p,
        "g": section.gain,
    }
    if kind == "tracking":
        found["kind"], found["states"] = "tracking", order
        found["t2"], found["p2"], found["g2"] = then.t, then.p, then.gain
        found["lead"] = behind.lead
    if order == 1 or loop.filter_damping_ratio == 1:
        found["a"] = section.t / min(order, 2)
    if order >= 2:
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


#: A node's name, or all of it from the root.
_NODE = re.compile(r"[A-Za-z_]\w*|(/[A-Za-z_]\w*)+", re.ASCII)


def refuse_strange_node(node: str) -> None:
    """Raise UsageError for what ROS 2 takes for no name of a node."""
    if not _NODE.fullmatch(node):
        remedy = "Give letters, digits and _, none beginning with a digit, namespaces before it as "
        raise UsageError("--node", f"{node!r} is no name of a node", remedy + "in /robot/haptune")


_WRITERS: dict[Target, Callable[[SafeProfile], dict[str, str]]] = {
    "c": _c_files,
    "chai3d": _chai3d_files,
    "json": _plain_files,
}


@typed
def export(profile: SafeProfile, target: Target, *, node: str = "haptune") -> dict[str, str]:
    """Texts of the files of one target, by file name.

    Args:
        profile: certified; check the file it comes from first with ``tune.check``.
        target: ros2 (parameters, law, node), c (guard), chai3d (materials and guard) or json.
        node: name of the node of ROS 2, with its namespaces where it has any.

    Raises:
        CheckFailedError: it was changed after it was certified.
        UnstatedError: facts of the device that nobody stated.
        InvalidInputError: the profile does not fit the target, or does not say how what must not be
            switched fades.
        UsageError: no such target, no name of a node.
    """
    refuse_unknown("--to", "target", target, TARGETS)
    refuse_strange_node(node)
    signed_content(to_mapping(profile), f"the profile of {profile.scene}")
    profile.device.require_stated()
    for element in profile.elements.values():
        fade_step(element, profile.loop.sample_time)
    return _ros2_files(profile, node) if target == "ros2" else _WRITERS[target](profile)
