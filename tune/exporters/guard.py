"""A profile as a guard in C99, the certified law and nothing but it; and for CHAI3D around it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from importlib.resources import files
from string import Template

from identification import InvalidInputError
from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile
from tune.documents.scene import EffectName
from tune.exporters.law import Estimate, change_words, fade_step, largest_change, section_of
from tune.exporters.text import (
    block_comment,
    digest,
    force_limit,
    heading,
    identifiers,
    inside_comment,
    short,
    unit_of_force,
)

#: Bits of the set of elements that the guard is given.
_MOST_ELEMENTS = 64


def c_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_guard.h and haptune_guard.c; InvalidInputError for more elements than it holds."""
    if len(profile.elements) > _MOST_ELEMENTS:
        raise InvalidInputError(
            "elements",
            f"the profile has {len(profile.elements)}, a guard holds {_MOST_ELEMENTS}",
            "Split the scene",
        )
    values = _guard_values(profile)
    return {f"haptune_{name}": _filled(name, values) for name in ("guard.h", "guard.c")}


def chai3d_files(profile: SafeProfile) -> dict[str, str]:
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
    }
    return {"haptune_chai3d.hpp": _filled("chai3d.hpp", values), **c_files(profile)}


def _largest(profile: SafeProfile, effect: EffectName) -> float:
    """The largest sum of one effect over what may act at once; 0 where none is positive."""
    sizes: dict[str, float] = {
        name: getattr(element, effect) for name, element in profile.elements.items()
    }
    return max(0.0, *(sum(sizes[name] for name in moment) for moment in profile.moments()))


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
    found = 0
    for name in names:
        found |= 1 << places[name]
    return found


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
    sets = sorted({_bits(moment, places) for moment in profile.moments()})
    return {
        **_tags(profile),
        "heading": block_comment(heading(profile)),
        "digest": digest(profile),
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
        "moment_count": str(len(sets)),
        "velocity_words": _words(loop, "velocity"),
        "velocity": _section(loop, "velocity"),
        "acceleration_words": _words(loop, "acceleration"),
        "acceleration": _section(loop, "acceleration"),
        "played": "".join(
            f"    {{{_effects(element, loop.sample_time)}}}, /* {_plain(name)} */\n"
            for name, element in profile.elements.items()
        ),
        "known": f"0x{(1 << len(places)) - 1:x}",
        "walls": f"0x{_bits(profile.walls, places):x}",
        "moments": "".join(f"    UINT64_C(0x{each:x}),\n" for each in sets),
        "peak": _number(force_limit(profile).peak),
    }


def _tags(profile: SafeProfile) -> dict[str, str]:
    """The first digits of the profile's digest, as part of a name and as a constant."""
    word = digest(profile).removeprefix("sha256:")[:8]
    return {"word": word, "tag": f"0x{word}u"}


def _plain(name: str) -> str:
    return inside_comment(short(name))


def _listed(sets: Iterable[Iterable[str]], words: Mapping[str, str], none: str) -> str:
    lines = [" | ".join(words[name] for name in each) for each in sets] or [none]
    return "\n".join(
        textwrap.fill(line, 96, initial_indent=" *   ", subsequent_indent=" *     ")
        for line in lines
    )


def _section(loop: LoopProfile, which: Estimate) -> str:
    section = section_of(loop, which)
    return _numbers(section.t, section.p, section.gain)


def _effects(element: ElementProfile, sample_time: float) -> str:
    lead_time = element.damping / element.stiffness if element.stiffness > 0 else 0.0
    sizes = _numbers(element.stiffness, element.damping, element.mass)
    limits = _numbers(element.force_level, lead_time, element.motion.speed)
    step = _number(fade_step(element, sample_time))
    return f"{sizes}, {limits}, {element.one_sided:d}, {step}"


def _words(loop: LoopProfile, which: Estimate) -> str:
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return f"moving window of {window} samples; t, p, g"
    cutoff = getattr(loop, f"{which}_filter_hz")
    if cutoff is None:
        return "no filter; t, p, g"
    order = getattr(loop, f"{which}_filter_order")
    ratio = f", damping ratio {loop.filter_damping_ratio:g}" if order == 2 else ""
    return f"order {order}, {cutoff:g} Hz{ratio}; t, p, g"
