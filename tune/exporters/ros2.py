"""A profile for ROS 2: parameters of a node, the law in Python, and a thin node around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any, cast

from tune.documents.profile import SafeProfile
from tune.exporters.heading import digest, force_limit, heading
from tune.exporters.largest_change import largest_change
from tune.exporters.law import law_of, longest_tap
from tune.exporters.names import hash_comment, identifiers, quote_yaml
from tune.exporters.plain import LAW, filter_of

#: Letters of a name; the parser of ROS 2 takes texts of up to 256 bytes.
_LONGEST_TEXT = 60


def ros2_files(profile: SafeProfile, node: str = "haptune") -> dict[str, str]:
    """haptune_params.yaml, haptune_law.py and haptune_node.py.

    Parameters are only what ROS 2 can hold: numbers, texts, and lists of one kind that are not
    empty. Every text is in quotes, every float has a point, so that no reader mistakes one.

    Args:
        profile: certified.
        node: name of the node, with its namespaces where it has any, such as /robot/haptune.
    """
    device, seal, law = profile.device, profile.certificate, law_of(profile.loop)
    keys = identifiers(profile.elements)
    limit = force_limit(profile)
    parameters: dict[str, Any] = {
        "digest": digest(profile),
        "device": device.name[:_LONGEST_TEXT],
        "axis": device.axis[:_LONGEST_TEXT],
        "motion": device.motion,
        "sample_time": law.sample_time,
        "delay_samples": float(profile.loop.extra_delay_samples),
        "margin": {"gain": seal.gain, "extra_delay_samples": int(seal.extra_delay_samples)},
        "velocity": filter_of(profile.loop, "velocity", law.velocity),
        "acceleration": filter_of(profile.loop, "acceleration", law.acceleration),
    }
    parameters["taps"] = longest_tap(profile)
    parameters["largest_change"] = largest_change(profile)
    parameters["force_limit"] = {"continuous": limit.continuous, "peak": limit.peak}
    parameters["element_names"] = list(keys.values())
    parameters["elements"] = {
        keys[name]: {
            "name": name[:_LONGEST_TEXT],
            "stiffness": element.stiffness,
            "damping": element.damping,
            "mass": element.mass,
            "one_sided": element.one_sided,
            "force_level": element.force_level,
            "speed": element.motion.speed,
            "fade_time": element.fade_time,
        }
        for name, element in profile.elements.items()
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
        f"SI units. {LAW}. Moments are each element alone, any part of a group of 'together', and "
        "each of these beside what is one_sided, but for the pairs of 'apart'.",
    )
    body = "\n".join(_lines({node: {"ros__parameters": parameters}}, ""))
    comment = hash_comment(heading(profile))
    templates = files("tune") / "templates"
    law, thin = ((templates / name).read_text(encoding="utf-8") for name in ("law.py", "node.py"))
    return {
        "haptune_params.yaml": hash_comment(head) + body + "\n",
        "haptune_law.py": f"{comment}\n{law}",
        "haptune_node.py": f"{comment}\n{thin.replace('${node}', node.rpartition('/')[2])}",
    }


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
