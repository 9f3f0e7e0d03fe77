"""The words of every file: which profile, what is certified and what is not; harmless names.

Names of elements become identifiers, and any text a comment or a quoted text that nothing in it
can end.
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Iterable

from identification import ForceLimit
from tune.documents.profile import SafeProfile

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


def digest(profile: SafeProfile) -> str:
    """The digest of the profile as it was read, or as it would be written."""
    return profile.digest or profile.signed().digest


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
        f"profile digest: {digest(profile)}",
        f"device: {short(device.name)}, axis {short(device.axis)}, {device.motion}; "
        f"scene {short(profile.scene)}",
        f"margin: {margin.name}: stable for every gain in (0, {seal.gain:g}] with up to "
        f"{seal.extra_delay_samples:g} extra samples of delay",
        f"certified for: mass {between(seal.mass)} {'kg*m^2' if rotary else 'kg'}, damping "
        f"{between(seal.damping)} {'N*m*s/rad' if rotary else 'N*s/m'}, sample time "
        f"{between(seal.sample_time)} s, delay {between(seal.delay_samples)} samples "
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
    taken = set(found.values())
    for name, word in wanted.items():
        if name in found:
            continue
        free, number = word, 1
        while free in taken:
            number += 1
            free = f"{word}_{number}"
        found[name] = free
        taken.add(free)
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
