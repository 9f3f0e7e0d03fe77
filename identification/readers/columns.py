"""The columns of a log: which of a file they are, their units, and what makes them SI."""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from identification.errors import InvalidInputError, QuestionError, UsageError, counted, printable
from identification.trajectory import FloatArray, Motion

#: Over five hours at 1 kHz; more tells nothing new of one axis. 160 MB a column.
MOST_SAMPLES = 20_000_000
#: Column names listed in a message at most; a wrong file may have thousands.
_MOST_NAMED = 20
#: Characters of a file's own text quoted in a message at most.
_LONGEST_QUOTE = 40
#: A gain this part off the unit in the name contradicts it: 0.0174533 is degrees, 0.0175 is not.
_SAME = 1e-4
#: A unit in brackets, or behind a slash or "in"; digits alone count elements of an array.
_BRACKETED = re.compile(r"^(?P<stem>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))$")
_SLASHED = re.compile(r"^(?P<stem>.*\S)(?:\s*/\s*|\s+in\s+)(?P<unit>\S+)$")
_SUFFIXED = re.compile(r"^(?P<stem>.+?)[_ ](?P<unit>[^_ ]+)$")
#: Characters; nobody writes a unit behind more.
_LONGEST_NAME = 200
#: Names of axes where nobody gives any.
_AXES = ("x", "y", "z", "a", "b", "c")
#: Words for the columns besides their own names.
_WORDS = {
    role: frozenset(words.split())
    for role, words in {
        "time": "time t timestamp zeit zeitstempel temps tiempo tempo elapsed clock stamp x_value",
        "force": "force f torque tau effort kraft drehmoment moment fuerza forza coppia",
        "position": "position pos angle x q weg winkel lage displacement déplacement posición "
        "posizione phi theta encoder",
        "reference": "reference",
    }.items()
}
#: What says nothing in SI without a number of the device.
_OF_DEVICE = "A mA amp amps ampere amperes V mV volt volts count counts tick ticks inc digit digits"
#: Units by role, motion and size in s, N (N·m) or m (rad).
_SIZES: dict[str, dict[Motion | None, dict[float | None, str]]] = {
    "time": {
        None: {
            1.0: "s sec second seconds sek sekunde sekunden",
            1e-3: "ms msec millisecond milliseconds",
            1e-6: "us usec microsecond microseconds",
            1e-9: "ns nsec nanosecond nanoseconds",
        }
    },
    "force": {
        None: {None: _OF_DEVICE},
        "linear": {1.0: "N newton newtons", 1e-3: "mN", 1e3: "kN"},
        "rotary": {1.0: "Nm", 1e-2: "Ncm", 1e-3: "mNm Nmm", 1e3: "kNm"},
    },
    "position": {
        None: {None: _OF_DEVICE},
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
            math.pi / 180: "deg degree degrees ° º",
            2 * math.pi: "rev revs turn turns revolutions",
        },
    },
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a file holds of a log."""

    values: dict[str, FloatArray]  # columns by role, in the units of the file, shape (rows,) each
    names: dict[str, str]  # of these columns in the file, units and all
    notes: tuple[str, ...] = ()  # what had to be understood before the file was a table, in words
    in_seconds: bool = False  # time comes from dates or durations, which carry their own unit


#: SI units in one unit of a column: of one axis, or of each of several.
Gains = float | tuple[float | None, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogColumns:
    """Which columns of a file are what, and the factors that make them SI.

    Attributes:
        time: column that, times ``time_gain``, is in s; in Parquet and NPZ files a date and time or
            a duration as well.
        force: column that, times ``force_gain``, is the force on the device in N (N·m).
        position: column that, times ``position_gain``, is the position in m (rad).
        reference: set-point column in the unit of position; None takes a column named
            ``reference`` of a CSV or Parquet file if there is one. MAT and NPZ files hold arrays
            of any meaning, so there it has to be named.
        time_gain: s per unit of the column, e.g. 0.001. None takes the unit in the column's name,
            else s.
        force_gain: e.g. N per volt; negative turns the direction. None takes the unit in the
            column's name, else N (N·m); 1 states that it is. Of several axes one number for all, or
            one for each, None where it is that of the column's name.
        position_gain: e.g. m per count; applies to reference as well. None takes the unit in the
            column's name, else m (rad); 1 states that it is. Of several axes as ``force_gain``.
        axis: name of the axis; None means "x".
        decimal: "comma" or "point", what stands before the decimals of a text file; None takes what
            its cells leave no doubt about.

    Raises:
        InvalidInputError: a gain that is zero, infinite or not a number.
    """

    time: str = "time"
    force: str = "force"
    position: str = "position"
    reference: str | None = None
    time_gain: float | None = None
    force_gain: Gains = None
    position_gain: Gains = None
    axis: str | None = None
    decimal: Literal["comma", "point"] | None = None

    def by_axis(self, names: Sequence[str] | None = None) -> tuple[LogColumns, ...]:
        """The columns of each axis, where names of several are given with commas and no spaces.

        Axes are named by ``axis``, else by ``names``, else x, y, z and so on.

        Raises:
            InvalidInputError: other numbers of forces, positions, references, names or gains.
            UsageError: a column for two axes.
        """
        parts = {role: _parted(getattr(self, role)) for role in ("force", "position", "reference")}
        count = len(parts["force"])
        if max(count, len(parts["position"])) == 1:
            return (self,)
        listed = _parted(self.axis) if self.axis else tuple(names or _AXES[:count])
        sizes = {role: len(each) for role, each in {**parts, "axis": listed}.items()}
        odd = [role for role, size in sizes.items() if size != count and parts.get(role) != ("",)]
        if odd:
            problem = f"names {sizes[odd[0]]} for {counted(count, 'force')}"
            raise InvalidInputError(f"--{odd[0]}", problem, "Give one of each for every axis")
        for role in ("force", "position"):
            twice = next((each for each in parts[role] if parts[role].count(each) > 1), None)
            if twice is not None:
                problem = f"names '{quote(twice)}' for two axes"
                raise UsageError(f"--{role}", problem, "Name the column of each axis once")
        gains: dict[str, list[float | None]] = {}
        for role in ("force", "position"):
            given: Gains = getattr(self, f"{role}_gain")
            gains[role] = list(given) if isinstance(given, tuple) else [given] * count
            if len(gains[role]) != count:
                problem = f"gives {len(gains[role])} numbers for {count} axes"
                raise InvalidInputError(f"--{role}-gain", problem, "Give one, or one for each axis")
        return tuple(
            replace(
                self,
                force=parts["force"][place],
                position=parts["position"][place],
                reference=None if self.reference is None else parts["reference"][place],
                force_gain=gains["force"][place],
                position_gain=gains["position"][place],
                axis=name,
            )
            for place, name in enumerate(listed)
        )

    @property
    def stated_units(self) -> frozenset[str]:
        """Roles whose gain a person gave, be it 1."""
        gains = {"force": self.force_gain, "position": self.position_gain}
        return frozenset(role for role, gain in gains.items() if gain is not None)

    def __post_init__(self) -> None:
        for name in ("time_gain", "force_gain", "position_gain"):
            given: Gains = getattr(self, name)
            for gain in given if isinstance(given, tuple) else (given,):
                if gain is not None and (not math.isfinite(gain) or gain == 0):
                    raise InvalidInputError(
                        "--" + name.replace("_", "-"),
                        f"is {gain:g}, not a finite number other than zero",
                        "Give what one unit of the column is in SI units",
                    )


def _parted(names: str | None) -> tuple[str, ...]:
    """Names between commas; one name where a space shows that the comma belongs to it."""
    names = names or ""
    return (names,) if " " in names else tuple(names.split(","))


def column_names(
    path: Path, columns: LogColumns, present: Sequence[str], *, table: bool
) -> dict[str, str]:
    """Role (time, force, position and perhaps reference) to the column's name in the file.

    In a ``table`` of equally long columns other words for the roles count where the user gave no
    name, and one named ``reference`` belongs to the log. Raises InvalidInputError for columns that
    are not there, with those that are, and where several may be meant.
    """
    asked = {"time": columns.time, "force": columns.force, "position": columns.position}
    if columns.reference is not None or table:
        asked["reference"] = columns.reference or "reference"
    found = {
        role: _column_for(path, role, name, present, words=table) for role, name in asked.items()
    }
    if columns.reference is None and found.get("reference") is None:
        found.pop("reference", None)
    wanted = {role: name for role, name in found.items() if name is not None}
    missing = {role: asked[role] for role, name in found.items() if name is None}
    if missing:
        named = ", ".join(f"'{quote(name)}'" for name in missing.values())
        listed = ", ".join(quote(name) for name in present[:_MOST_NAMED])
        more = f" and {len(present) - _MOST_NAMED} more" if len(present) > _MOST_NAMED else ""
        left = [name for name in present if name not in wanted.values()]
        problem = f"has no column {named}; it has: {listed or 'none'}{more}"
        options = ", ".join(f"--{role}" for role in missing)
        remedy = f"Name the right column with {options}{_suggested(left, tuple(missing))}"
        if not left:
            raise InvalidInputError(path, problem, remedy)
        raise QuestionError(
            path,
            problem,
            remedy,
            question=f"Which column is the {next(iter(missing))}",
            option=next(iter(missing)),
            choices=tuple(left[:_MOST_NAMED]),
        )
    return wanted


def _suggested(present: Sequence[str], missing: Sequence[str]) -> str:
    """Options that take the columns left: by their units, or in the usual order if none has one."""
    found = [
        f'--{role} "{quote(name)}"'
        for role in missing
        for name in present[:_MOST_NAMED]
        if unit_named(role, split_name(role, name)[1] or "") is not None
    ]
    if found or len(present) != len(missing):
        return f", perhaps {' or '.join(found[:3])}" if found else ""
    in_order = (f'--{role} "{quote(name)}"' for role, name in zip(missing, present, strict=True))
    return f", perhaps {' '.join(in_order)}"


def _column_for(
    path: Path, role: str, asked: str, present: Sequence[str], *, words: bool
) -> str | None:
    """The column of the name asked for, of a place from one, with a unit, or by another word."""
    if asked in present:
        return asked
    if asked.isdecimal() and 1 <= int(asked[:6]) <= len(present):
        return present[int(asked) - 1]
    stems = {name: split_name(role, name)[0] for name in present}
    found = [name for name, stem in stems.items() if stem == asked]
    if not found and words and asked == role and role != "reference":
        found = [name for name, stem in stems.items() if stem.casefold() in _WORDS[role]]
    if len(found) > 1:
        raise QuestionError(
            path,
            f"has several columns that may be the {role}: "
            + ", ".join(f"'{quote(name)}'" for name in found[:10]),
            f'Name the right one, such as --{role} "{quote(found[0])}"',
            question=f"Which column is the {role}",
            option=role,
            choices=tuple(found[:_MOST_NAMED]),
        )
    return found[0] if found else None


def quote(text: str) -> str:
    """A file's own text, safe and short enough to print."""
    shown = printable(text[: _LONGEST_QUOTE + 1]).replace("\n", "\\n")
    return shown if len(shown) <= _LONGEST_QUOTE else shown[:_LONGEST_QUOTE] + "…"


@contextmanager
def refused_as(path: Path, kind: str, remedy: str, *panics: type[BaseException]) -> Generator[None]:
    """Refuse a file whose library raises anything: a damaged one trips the parser anywhere."""
    try:
        yield
    except InvalidInputError:
        raise
    except MemoryError:
        problem = "takes more memory to read than a file of its size may"
        raise InvalidInputError(path, problem, remedy) from None
    except (Exception, *panics):  # noqa: BLE001
        raise InvalidInputError(path, f"is not a readable {kind}", remedy) from None


def refuse_long(path: Path, samples: int) -> None:
    """Raises InvalidInputError for more samples than a log may have."""
    if samples > MOST_SAMPLES:
        problem = f"holds or claims {samples} samples, more than the {MOST_SAMPLES} that are read"
        raise InvalidInputError(path, problem, "Cut the log to a shorter part")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Unit:
    """A unit as written, its size in SI and its motion; None where these depend on the device."""

    text: str
    size: float | None
    motion: Motion | None


_UNITS = {
    role: {
        text: _Unit(text=text, size=size, motion=motion)
        for motion, sizes in motions.items()
        for size, texts in sizes.items()
        for text in texts.split()
    }
    for role, motions in _SIZES.items()
}
_UNITS["reference"] = _UNITS["position"]


def unit_named(role: str, text: str) -> _Unit | None:
    """The unit of a role that a text means, brackets or none; None where it is no known one."""
    plain = re.sub(r"[\s·⋅*.^\[\]()-]", "", text).replace("µ", "u").replace("μ", "u")
    known = _UNITS[role]
    # Case tells mN from MN; other units and words may have capital letters.
    return known.get(plain) or (
        known.get(plain.lower()) if role != "force" or len(plain) > 3 else None
    )


def split_name(role: str, name: str) -> tuple[str, str | None]:
    """Name of a column without its unit, and the text of the unit; None where it has none.

    Text in brackets is a unit whether it is known or not; behind ``_``, a space or a slash only a
    known one, and one of a single letter only behind a word for the role.
    """
    if len(name) > _LONGEST_NAME:
        return name, None
    bare = name.strip("[]() ")
    if role != "reference" and bare.casefold() not in _WORDS[role] and unit_named(role, bare):
        return role, bare  # a header that is only its unit
    found = _BRACKETED.match(name)
    if found:
        text = found["square"] if found["square"] is not None else found["round"]
        text = text.strip()
        return (name, None) if not text or text.isdigit() else (found["stem"], text)
    both = (_SLASHED.match(name), _SUFFIXED.match(name))
    found = next((each for each in both if each and unit_named(role, each["unit"])), None)
    if found is None:
        return name, None
    if len(found["unit"]) == 1 and found["stem"].casefold() not in _WORDS[role]:
        return name, None
    return found["stem"], found["unit"]


def gain_option(role: str) -> str:
    """The option that gives the gain of a role."""
    return f"--{'position' if role == 'reference' else role}-gain"


def gain_given(role: str, columns: LogColumns) -> float | None:
    """The gain of a role that a person gave. Raises InvalidInputError for those of several axes."""
    given: Gains = getattr(columns, gain_option(role)[2:].replace("-", "_"))
    if isinstance(given, tuple):
        problem = f"gives {len(given)} numbers for one axis"
        raise InvalidInputError(gain_option(role), problem, "Give one number")
    return given


#: An option for a gain and the number behind it, not where it is to be left out.
_GAIN = re.compile(r"(?<!Leave out )--(force|position)-gain\b( X\b| -?\d\S*\d| -?\d)?")


def say_gains_by_axis(remedy: str, names: Sequence[str], place: int) -> str:
    """A remedy about one of several axes: gains that it gives, as options for this axis alone."""
    before, after = "," * place, "," * (len(names) - 1 - place)
    said = _GAIN.sub(
        lambda found: f"--{found[1]}-gain {before}{(found[2] or ' X').strip()}{after}", remedy
    )
    if said == remedy:
        return remedy
    *some, last = names
    return (
        f"{said.removesuffix('.')}. Between the commas stand the gains of {', '.join(some)} and "
        f"{last}; a blank one leaves its axis as it is."
    )


def conversion_of(
    path: Path, reading: Reading, columns: LogColumns, motion: Motion | None
) -> tuple[dict[str, float], frozenset[str], tuple[str, ...]]:
    """What makes columns SI: gains given, else units in their names. Raises InvalidInputError.

    By role, the factor of the column; of "force" and "position", those whose unit a person or the
    file stated; what was understood from names, in words.
    """
    names = reading.names
    units = {
        role: None if role == "time" and reading.in_seconds else _unit_of(path, role, name, columns)
        for role, name in names.items()
    }
    _refuse_two_motions(path, names, units, columns, motion)
    gains: dict[str, float] = {}
    notes: list[str] = []
    for role, name in names.items():
        unit, given = units[role], gain_given(role, columns)
        if given is not None:
            _refuse_contradiction(path, role, name, unit, given, motion)
        named = unit.size if unit else None
        gains[role] = given if given is not None else 1.0 if named is None else named
        if role == "reference" and given is None and unit is None:
            gains[role] = gains["position"]
        if unit is not None or name != getattr(columns, role) or given not in (None, 1.0):
            words = f"{role} from '{quote(name)}'"
            notes.append(words + (f" times {gains[role]:.6g}" if gains[role] != 1 else ""))
    known = {role for role in ("force", "position") if role in names and units[role] is not None}
    return gains, columns.stated_units | known, tuple(notes)


def _si(role: str) -> str:
    return {"time": "s", "force": "N (N·m)"}.get(role, "m (rad)")


def _unit_of(path: Path, role: str, name: str, columns: LogColumns) -> _Unit | None:
    """The unit in a column's name; None if it has none, or one that a gain makes known."""
    text = split_name(role, name)[1]
    if text is None:
        return None
    unit = unit_named(role, text)
    if gain_given(role, columns) is not None or (unit is not None and unit.size is not None):
        return unit
    kind = "is no unit of it that is known" if unit is None else "depends on the device"
    how = ""
    if role == "force" and unit is not None and unit.text.lower() in {"a", "ma", "amp", "ampere"}:
        how = ", torque constant times transmission"
    problem = f"column '{quote(name)}' states its unit as '{quote(text)}', which {kind}"
    remedy = f"Add {gain_option(role)} X: {_si(role)} per unit of the column{how}"
    question = f"{_si(role)} per unit of that column{how}"
    option = gain_option(role).removeprefix("--").replace("-", "_")
    raise QuestionError(path, problem, remedy, question=question, option=option)


def _refuse_contradiction(
    path: Path, role: str, name: str, unit: _Unit | None, given: float, motion: Motion | None
) -> None:
    """Refuse a gain that is not the size of the unit in the name, whichever its sign.

    Between angles and a linear axis, or the other way round, lies a transmission: any gain may be.
    """
    if unit is None or unit.size is None or abs(abs(given) / unit.size - 1) <= _SAME:
        return
    if motion is not None and unit.motion not in {None, motion}:
        return
    option = gain_option(role)
    raise InvalidInputError(
        path,
        f"column '{quote(name)}' states its unit as '{unit.text}', {unit.size:.6g} {_si(role)}, "
        f"and {option} {given:g} contradicts it",
        f"Leave out {option}, give {math.copysign(unit.size, given):.6g}, or rename the "
        "column if its unit is wrong",
    )


def _refuse_two_motions(
    path: Path,
    names: Mapping[str, str],
    units: Mapping[str, _Unit | None],
    columns: LogColumns,
    motion: Motion | None,
) -> None:
    """Refuse a unit of another motion than the axis's, or than that of the other column."""
    meant = motion
    for role, unit in units.items():
        kind = None if unit is None or gain_given(role, columns) is not None else unit.motion
        if unit is None or kind is None:
            continue
        if meant is not None and kind != meant:
            who = "the axis is" if motion is not None else "another column's unit is"
            raise InvalidInputError(
                path,
                f"column '{quote(names[role])}' is in {unit.text}, a unit of {kind} motion, and "
                f"{who} {meant}",
                f"Add {gain_option(role)} X, {_si(role)} per {unit.text} through the transmission, "
                "or state the right motion in the hardware file",
            )
        meant = kind
