"""The law of a profile as numbers and in words; what every file of it says; harmless names.

Names of elements become identifiers, and any text a comment or a quoted text that nothing in it can
end.
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Iterable
from itertools import chain, count

from identification import ForceLimit, InvalidInputError, counted
from tune.documents.profile import ElementProfile, SafeProfile

#: The line through two readings, each rounded to a count, and the rounding of the third.
_COUNTS = 2.0

#: The law in words, where it is not exported as code.
LAW_IN_WORDS = (
    "u = stiffness*(y - rest) + damping*v + mass*a of each element and F = -level*u, u clamped to "
    "+-force_level where there is stiffness, and at 0 where it is one_sided and would pull; the "
    "sum of F is cut at the peak force. level is the gain, 0 to 1, of what is wanted and 0 of what "
    "is not: it gets there over fade_time, s, if there is one, and not while one that is one_sided "
    "pushes; else it falls at once, and with stiffness it rises only as the element is entered or "
    "after taps samples in a row without force. With stiffness an element that is entered rests "
    "at y; one that is one_sided only if y is behind its face, and after taps samples without "
    "force at its face there again. No face or rest moves under force. What acts at once, what "
    "fades out included, is one of the combinations; with one_sided elements on both sides it is "
    "one without those of either side, and their faces do not overlap and, where damping/stiffness "
    "differs, lie as far apart as the sum of damping/stiffness*speed. "
    "x[k] = (t*x[k-1] - p*x[k-2]) + g*u[k] for both filters, which run on every reading of the "
    "axis, and where two x in a row are below 1e-30 both are 0; one with a lead puts x through "
    "t2, p2 and g2 likewise and gives x[k] + lead*(x[k] - x[k-1]) of what comes out. A reading "
    "farther than largest_change times the periods passed from the straight line through the last "
    "two, and from the one of one period earlier, like one that is missing, holds the force and "
    "is bridged by a straight line"
)
_OF_AXES = (
    "; y, v, a, u and F are vectors of all axes in one frame with right angles, whose length is "
    "clamped and cut; what is one_sided takes from u the place x nearest to it where n*x is at "
    "least stiffness*rest for the normal n of each of its faces, those of several elements being "
    "parallel; a new face rests behind that place and where the device is"
)


def law_in_words(profile: SafeProfile) -> str:
    """The law of a profile, of one axis or several."""
    return LAW_IN_WORDS + (_OF_AXES if profile.device.axes is not None else "")


def fade_step(element: ElementProfile, sample_time: float) -> float:
    """Change of the level of an element in one period, s; 1 switches it at once."""
    if element.fades and not element.fade_time:
        raise InvalidInputError(
            "profile",
            "an element with mass or a negative effect has no fade_time, and must not be switched",
            "Tune again",
        )
    return min(1.0, sample_time / element.fade_time) if element.fade_time else 1.0


def largest_change(profile: SafeProfile) -> float:
    """What a device can do to its speed in one period, as travel in that period, m (rad).

    It may come to rest from the fastest speed that an element states, and be thrown by the peak
    force at its least mass; a vibration mode lets the encoder move sum(e²) times more. Two counts
    of the encoder are added. A reading farther from the straight line is not of the device.
    """
    device = profile.device
    resolution = device.encoder_resolution
    step = profile.loop.sample_time
    lively = 1 + sum(mode.at_encoder**2 for mode in device.modes)
    thrown = force_limit(profile).peak * lively / device.simultaneous_box().mass[0] * step
    counts = 0.0 if resolution is None else _COUNTS * resolution.value
    return (_fastest(profile) + thrown) * step + counts


def change_words(profile: SafeProfile) -> str:
    """What the largest change is made of, as a sentence."""
    rotary = profile.device.motion == "rotary"
    return (
        f"Made of the fastest speed stated, {_fastest(profile):g} {'rad/s' if rotary else 'm/s'}, "
        "lost at once, the peak force on the least mass, and two counts of the encoder."
    )


def _fastest(profile: SafeProfile) -> float:
    return max(element.motion.speed for element in profile.elements.values())


#: What an integrator has to read before anything else; in ASCII.
NOT_A_SAFETY_FUNCTION = (
    "Not a safety function. A certified profile says that the control loop is stable under the "
    "assumptions written here. It limits no force, speed or travel in the sense of machine safety, "
    "notices no fault of the device, and replaces no emergency stop, no risk assessment and no "
    "protective measure that a standard asks for (such as ISO 12100, ISO 13849, ISO 14971 or "
    "IEC 60601)."
)
#: Letters of a name in a comment.
_SHORT = 60
#: Letters of an identifier, before a number that tells it from others.
_LONGEST = 40
#: Columns of a comment.
_WIDTH = 96

#: Words of C, C++ and Python, and what YAML 1.1 reads as something else than text.
_WORDS = """
    alignas alignof and asm assert async auto await bool break case catch char class const continue
    def default del delete do double elif else enum except explicit export extern false finally
    float for friend from global goto if import in inline int is lambda long mutable n namespace new
    no none nonlocal not null nullptr off on operator or pass private protected public raise
    register restrict return short signed sizeof static struct switch template this throw true try
    typedef typename union unsigned using virtual void volatile while with xor y yes yield
"""
_RESERVED = frozenset(_WORDS.split())


def short(name: str) -> str:
    """A name in quotes, cut where it is very long."""
    return quote_yaml(name if len(name) <= _SHORT else name[: _SHORT - 3] + "...")


def unit_of_force(profile: SafeProfile) -> str:
    """N or N*m, in ASCII."""
    return "N*m" if profile.device.motion == "rotary" else "N"


def force_limit(profile: SafeProfile) -> ForceLimit:
    """What the actuator gives; UnstatedError where nobody stated it."""
    profile.device.require_stated(("force_limit",))
    limit = profile.device.force_limit
    assert limit is not None
    return limit


def heading(profile: SafeProfile) -> tuple[str, ...]:
    """Lines of text without comment marks."""
    device, seal, margin = profile.device, profile.certificate, profile.margin
    limit, force = force_limit(profile), unit_of_force(profile)
    rotary = device.motion == "rotary"

    def between(bounds: tuple[float, float]) -> str:
        low, high = bounds
        return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"

    return (
        "Written by haptune from a certified profile. Do not edit: tune and export again.",
        NOT_A_SAFETY_FUNCTION,
        "",
        f"profile digest: {profile.digest}",
        f"device: {short(device.name)}, axis {short(device.axis)}, {device.motion}; "
        f"scene {short(profile.scene)}",
        f"margin: {margin.name}: stable for every gain in (0, {seal.gain:g}] with up to "
        f"{counted(f'{seal.extra_delay_samples:g}', 'extra sample')} of delay",
        f"certified for: mass {between(seal.mass)} {'kg*m^2' if rotary else 'kg'}, damping "
        f"{between(seal.damping)} {'N*m*s/rad' if rotary else 'N*s/m'}, sample time "
        f"{between(seal.sample_time)} s, delay {counted(between(seal.delay_samples), 'sample')} "
        f"(together {100 * seal.confidence:g} %)",
        f"force limit: {limit.continuous:g} {force} continuous, {limit.peak:g} {force} peak",
        *(
            f"findings about the log {short(source)}: {', '.join(codes) or 'none'}"
            for source, codes in findings_of(profile).items()
        ),
        "method: " + seal.method,
        "assumes:",
        *(f"- {each}" for each in seal.assumes),
        "not assessed:",
        *(f"- {each}" for each in seal.not_assessed),
    )


def findings_of(profile: SafeProfile) -> dict[str, list[str]]:
    """Codes of what was found about each log, by its name; marked where they had to be allowed."""
    return {
        record.source: [
            f"{code} (allowed)" if code in record.allowed else code for code in record.findings
        ]
        for record in profile.device.logs
    }


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """A different identifier for each name; a name that is one already keeps it.

    Small ASCII letters, digits and single underscores; no word of C, C++, Python or YAML.
    """
    wanted = {name: _identifier(name) for name in names}
    found = {name: name for name, word in wanted.items() if name == word}
    for name, word in wanted.items():
        if name not in found:
            numbered = chain([word], (f"{word}_{number}" for number in count(2)))
            found[name] = next(each for each in numbered if each not in found.values())
    return {name: found[name] for name in wanted}


def _identifier(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:_LONGEST].strip("_")
    if not word or word[0].isdigit() or word in _RESERVED:
        return f"element_{word}".rstrip("_")
    return word


def quote_yaml(text: str) -> str:
    """A text in double quotes as YAML takes it, ASCII only."""

    def quoted(letter: str) -> str:
        code = ord(letter)
        if letter in '"\\':
            return "\\" + letter
        if 0x20 <= code < 0x7F:
            return letter
        if code <= 0xFF:
            return f"\\x{code:02x}"
        return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"

    return '"' + "".join(quoted(letter) for letter in text) + '"'


def block_comment(lines: Iterable[str]) -> str:
    """A C comment; nothing in the lines can end it."""
    body = "".join(f" * {line}".rstrip() + "\n" for line in _wrapped(lines))
    return f"/*\n{body} */\n"


def hash_comment(lines: Iterable[str]) -> str:
    """Comment lines of YAML."""
    return "".join(f"# {line}".rstrip() + "\n" for line in _wrapped(lines))


def inside_comment(text: str) -> str:
    """One line of ASCII that neither ends nor begins a C comment, nor continues a line."""
    plain = " ".join(text.encode("ascii", "backslashreplace").decode().split())
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /").rstrip("\\")


def _wrapped(lines: Iterable[str]) -> Iterable[str]:
    for line in lines:
        indent = "    " if line.startswith("- ") else ""
        yield from textwrap.wrap(inside_comment(line), _WIDTH, subsequent_indent=indent) or [""]
