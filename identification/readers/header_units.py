"""Units in the names of columns as loggers write them: time [ms], pos (mm), force_N."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from identification.trajectory import Motion

#: A unit in brackets, or behind a slash between spaces; digits alone count elements of an array.
_BRACKETED = re.compile(r"^(?P<stem>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))$")
_SLASHED = re.compile(r"^(?P<stem>.*\S)\s+/\s+(?P<unit>\S+)$")
_SUFFIXED = re.compile(r"^(?P<stem>.+?)[_ ](?P<unit>[^_ ]+)$")
#: Characters; nobody writes a unit behind more.
_LONGEST_NAME = 200
#: Words for the columns besides their own names.
WORDS = {
    "time": frozenset({"time", "t", "timestamp"}),
    "force": frozenset({"force", "torque"}),
    "position": frozenset({"position", "pos", "angle"}),
    "reference": frozenset({"reference"}),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A unit a column may be in.

    Attributes:
        text: as written.
        size: of one unit in s, N (N·m) or m (rad); None where it depends on the device.
        motion: "linear" or "rotary"; None for time and where it depends on the device.
    """

    text: str
    size: float | None
    motion: Motion | None


_TIMES = {
    1.0: "s sec second seconds",
    1e-3: "ms msec millisecond milliseconds",
    1e-6: "us usec microsecond microseconds",
    1e-9: "ns nsec nanosecond nanoseconds",
}
_FORCES: dict[Motion, dict[float, str]] = {
    "linear": {1.0: "N newton newtons", 1e-3: "mN", 1e3: "kN"},
    "rotary": {1.0: "Nm", 1e-2: "Ncm", 1e-3: "mNm Nmm", 1e3: "kNm"},
}
_PLACES: dict[Motion, dict[float, str]] = {
    "linear": {
        1.0: "m metre metres meter meters",
        1e-2: "cm",
        1e-3: "mm millimetre millimetres millimeter millimeters",
        1e-6: "um micron microns",
        0.0254: "inch inches",
    },
    "rotary": {
        1.0: "rad radian radians",
        1e-3: "mrad",
        math.pi / 180: "deg degree degrees °",
        2 * math.pi: "rev revs turn turns revolutions",
    },
}
#: What says nothing in SI without a number of the device.
_OF_DEVICE = "A mA amp amps ampere amperes V mV volt volts count counts tick ticks inc digit digits"


def _table(role: str) -> dict[str, Unit]:
    """Units of a role by their text."""
    if role == "time":
        return {
            text: Unit(text=text, size=size, motion=None)
            for size, texts in _TIMES.items()
            for text in texts.split()
        }
    found = {text: Unit(text=text, size=None, motion=None) for text in _OF_DEVICE.split()}
    for motion, sizes in (_FORCES if role == "force" else _PLACES).items():
        for size, texts in sizes.items():
            for text in texts.split():
                found[text] = Unit(text=text, size=size, motion=motion)
    return found


_UNITS = {role: _table(role) for role in ("time", "force", "position")}
_UNITS["reference"] = _UNITS["position"]


def unit_named(role: str, text: str) -> Unit | None:
    """The unit of a role that a text means, brackets or none; None where it is no known one."""
    plain = re.sub(r"[\s·⋅*.^\[\]()-]", "", text).replace("µ", "u").replace("μ", "u")
    known = _UNITS[role]
    # Case tells mN from MN; words may begin with a capital letter.
    return known.get(plain) or (known.get(plain.lower()) if len(plain) > 3 else None)


def split_name(role: str, name: str) -> tuple[str, str | None]:
    """Name of a column without its unit, and the text of the unit; None where it has none.

    Text in brackets is a unit whether it is known or not; behind ``_``, a space or a slash only a
    known one, and one of a single letter only behind a word for the role.
    """
    if len(name) > _LONGEST_NAME:
        return name, None
    found = _BRACKETED.match(name)
    if found:
        text = found["square"] if found["square"] is not None else found["round"]
        text = text.strip()
        return (name, None) if not text or text.isdigit() else (found["stem"], text)
    found = _SLASHED.match(name) or _SUFFIXED.match(name)
    if found is None or unit_named(role, found["unit"]) is None:
        return name, None
    if len(found["unit"]) == 1 and found["stem"].casefold() not in WORDS[role]:
        return name, None
    return found["stem"], found["unit"]
