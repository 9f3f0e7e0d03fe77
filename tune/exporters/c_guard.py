"""A profile as a guard in C99: the certified control law and nothing but it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from importlib.resources import files
from string import Template

from identification import InvalidInputError
from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile
from tune.exporters.heading import digest, force_limit, heading, short, unit_of_force
from tune.exporters.largest_change import change_words, largest_change
from tune.exporters.law import Section, fade_step, law_of, longest_tap
from tune.exporters.names import block_comment, identifiers, inside_comment

#: Bits of the set of elements that the guard is given.
MOST_ELEMENTS = 64


def c_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_guard.h and haptune_guard.c.

    Raises:
        InvalidInputError: more elements than a set of 64 bits can hold.
    """
    if len(profile.elements) > MOST_ELEMENTS:
        raise InvalidInputError(
            "elements",
            f"the profile has {len(profile.elements)}, a guard holds {MOST_ELEMENTS}",
            "Split the scene",
        )
    values = _values(profile)
    return {
        "haptune_guard.h": filled("guard.h", values),
        "haptune_guard.c": filled("guard.c", values),
    }


def filled(name: str, values: Mapping[str, str]) -> str:
    """A template with its $-names filled in."""
    text = (files("tune") / "templates" / name).read_text(encoding="utf-8")
    return Template(text).substitute(values)


def macros(profile: SafeProfile) -> dict[str, str]:
    """The macro of each element."""
    return {
        name: f"HAPTUNE_ELEMENT_{word.upper()}"
        for name, word in identifiers(profile.elements).items()
    }


def bits(names: Iterable[str], places: Mapping[str, int]) -> int:
    """The set of some elements: the union of their bits, however often one is named."""
    found = 0
    for name in names:
        found |= 1 << places[name]
    return found


def number(value: float) -> str:
    """A double with all of its digits, as a C constant of type double."""
    text = f"{value:.17g}"
    return text if "." in text or "e" in text else text + ".0"


def _values(profile: SafeProfile) -> dict[str, str]:
    law, device, seal = law_of(profile.loop), profile.device, profile.certificate
    words = macros(profile)
    places = {name: index for index, name in enumerate(profile.elements)}
    sets = sorted({bits(moment, places) for moment in profile.moments()})
    change = largest_change(profile)
    limit, force, sealed = force_limit(profile), unit_of_force(profile), digest(profile)
    return {
        "heading": block_comment(heading(profile)),
        "tag": f"0x{sealed.removeprefix('sha256:')[:8]}u",
        "digest": sealed,
        "sample_time": number(law.sample_time),
        "extra_delay": str(int(seal.extra_delay_samples)),
        "taps": str(longest_tap(profile)),
        "window": str(law.window),
        "change": number(change),
        "change_words": inside_comment(change_words(profile)),
        "elements": "".join(
            f"#define {words[name]} (UINT64_C(1) << {places[name]}) /* {_plain(name)} */\n"
            for name in profile.elements
        ),
        "together": _listed(profile.together, words, "none, one at a time"),
        "apart": _listed(profile.apart, words, "none"),
        "count": str(len(places)),
        "length": "rad" if device.motion == "rotary" else "m",
        "force": force,
        "gain": f"{seal.gain:g}",
        "moment_count": str(len(sets)),
        "velocity_words": _words(profile.loop, "velocity"),
        "velocity": _section(law.velocity),
        "acceleration_words": _words(profile.loop, "acceleration"),
        "acceleration": _section(law.acceleration),
        "played": "".join(
            f"    {{{_effects(element, law.sample_time)}}}, /* {_plain(name)} */\n"
            for name, element in profile.elements.items()
        ),
        "known": f"0x{(1 << len(places)) - 1:x}",
        "walls": f"0x{bits(profile.walls, places):x}",
        "moments": "".join(f"    UINT64_C(0x{each:x}),\n" for each in sets),
        "peak": number(limit.peak),
    }


def _plain(name: str) -> str:
    return inside_comment(short(name))


def _listed(sets: Iterable[Iterable[str]], words: Mapping[str, str], none: str) -> str:
    lines = [" | ".join(words[name] for name in each) for each in sets] or [none]
    return "\n".join(
        textwrap.fill(line, 96, initial_indent=" *   ", subsequent_indent=" *     ")
        for line in lines
    )


def _section(section: Section) -> str:
    return ", ".join(number(value) for value in (section.t, section.p, section.gain))


def _effects(element: ElementProfile, sample_time: float) -> str:
    sizes = (element.stiffness, element.damping, element.mass)
    lead_time = element.damping / element.stiffness if element.stiffness > 0 else 0.0
    limits = (element.force_level, lead_time, element.motion.speed)
    told = ", ".join(number(each) for each in (*sizes, *limits))
    return f"{told}, {element.one_sided:d}, {number(fade_step(element, sample_time))}"


def _words(loop: LoopProfile, which: str) -> str:
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return f"moving window of {window} samples; t, p, g"
    cutoff = getattr(loop, f"{which}_filter_hz")
    if cutoff is None:
        return "no filter; t, p, g"
    order = getattr(loop, f"{which}_filter_order")
    ratio = f", damping ratio {loop.filter_damping_ratio:g}" if order == 2 else ""
    return f"order {order}, {cutoff:g} Hz{ratio}; t, p, g"
