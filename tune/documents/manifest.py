"""The manifest of a fleet: which devices there are, and the files of each."""

from __future__ import annotations

import csv
import re
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from identification import Document, InvalidInputError, load_mapping, parse_document

#: What a serial number may be, since it names files too.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
#: What parts the logs of one device in a table.
_BETWEEN = "|"
#: Separators of tables; the one met most often in the header is meant.
_SEPARATORS = ",;\t"
#: What is done about a row that makes no sense.
_REMEDY = "Correct it there; 'haptune fleet --help' says what a row holds"
#: Bytes of a table, some hundred thousand devices.
_LARGEST = 50_000_000


def _several(raw: object) -> object:
    """One log is a list of one."""
    return (raw,) if isinstance(raw, str) else raw


class FleetEntry(Document):
    """One axis of one device: its logs, or the file of a device identified before.

    Attributes:
        serial: serial number, which names its files; letters, digits and . _ -.
        axis: name of the axis, where a device has several.
        log: logs of the axis, of which the device is identified.
        device: device.yaml, or the name of a known device, instead of logs.
        hardware: hardware.yaml, instead of the one that all share.
        scene: scene.yaml, instead of the one that all share.
        date: of the calibration, year-month-day.
        operator: who took the logs.
    """

    serial: str
    axis: str | None = None
    log: Annotated[tuple[str, ...], BeforeValidator(_several)] = ()
    device: str | None = None
    hardware: str | None = None
    scene: str | None = None
    date: str | None = None
    operator: str | None = None

    @field_validator("serial", "axis")
    @classmethod
    def _names_a_file(cls, name: str | None) -> str | None:
        if name is not None and not _NAME.fullmatch(name):
            raise ValueError(
                f"{name!r} cannot name a file: letters, digits, . _ and -, at most 64, beginning "
                "with a letter or digit"
            )
        return name

    @property
    def name(self) -> str:
        """What its files are called."""
        return self.serial if self.axis is None else f"{self.serial}-{self.axis}"


class Manifest(Document):
    """The devices of a fleet (manifest.yaml, or a table with a row each).

    Attributes:
        devices: in the order of the table of results.
    """

    schema_: Literal["haptune/manifest/1"] = Field(default="haptune/manifest/1", alias="schema")
    devices: tuple[FleetEntry, ...] = Field(json_schema_extra={"minItems": 1})

    @field_validator("devices")
    @classmethod
    def _told_apart(cls, devices: tuple[FleetEntry, ...]) -> tuple[FleetEntry, ...]:
        if not devices:
            raise ValueError("there is none; give each device a row")
        seen = set[str]()
        for entry in devices:
            # A file system may not tell capital letters.
            if (name := entry.name.casefold()) in seen:
                raise ValueError(f"{entry.name} stands there twice; give each axis a name")
            if bool(entry.log) == (entry.device is not None):
                has = "both" if entry.log else "neither"
                raise ValueError(f"{entry.name} needs either log or device, and has {has}")
            seen.add(name)
        return devices


def load_manifest(path: str | PathLike[str]) -> Manifest:
    """Read a manifest, YAML by its name, else a table with a header; blank cells are not stated.

    Raises:
        InvalidInputError: a file that cannot be read, or makes no sense.
    """
    source = Path(path)
    if source.suffix.lower() in {".yaml", ".yml"}:
        return parse_document(Manifest, load_mapping(source), source, _REMEDY)
    rows = _rows_of(source)
    lines = {str(place): line for place, line in enumerate(rows)}
    try:
        return parse_document(Manifest, {"devices": [*rows.values()]}, source, _REMEDY)
    except InvalidInputError as error:
        where = re.compile(r"(^|; )devices\.(\d+)\.")
        told = where.sub(lambda at: f"{at[1]}line {lines[at[2]]}, column ", error.problem)
        raise InvalidInputError(source, told, error.remedy) from None


def _rows_of(source: Path) -> dict[int, dict[str, Any]]:
    """Each row that is not blank, by the line of the file in which it ends."""
    try:
        if source.stat().st_size > _LARGEST:
            problem = f"has more than {_LARGEST} bytes"
            raise InvalidInputError(source, problem, "Split it into several")
        text = source.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInputError(source, "is not UTF-8", "Save it as CSV in UTF-8") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InvalidInputError(source, f"cannot be read: {reason}", "Check its name") from None
    lines = text.splitlines()
    header = lines[0] if lines else ""
    reader = csv.DictReader(lines, delimiter=max(_SEPARATORS, key=header.count))
    names = reader.fieldnames = [each.strip().lower() for each in reader.fieldnames or ()]
    strange = [name for name in names if name not in FleetEntry.model_fields]
    if strange or "serial" not in names:
        known = ", ".join(FleetEntry.model_fields)
        seen = f"has a column {strange[0]!r}" if strange else "has no column 'serial'"
        raise InvalidInputError(source, seen, f"Name its columns {known}; serial must be there")
    for name in names:
        if names.count(name) > 1:
            remedy = f"Give it once; {_BETWEEN} stands between several logs of one device"
            raise InvalidInputError(source, f"column {name!r} stands there twice", remedy)
    rows: dict[int, dict[str, Any]] = {}
    for row in reader:
        # What stands beyond the header is under None.
        if None in row:
            seen = f"has more cells than columns in line {reader.line_num}"
            raise InvalidInputError(source, seen, "Quote what holds a separator")
        given = {key: cell.strip() for key, cell in row.items() if cell and cell.strip()}
        if given:
            logs = [each.strip() for each in given.get("log", "").split(_BETWEEN)]
            log = {"log": [each for each in logs if each]} if any(logs) else {}
            rows[reader.line_num] = given | log
    return rows
