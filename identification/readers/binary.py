"""Files that are no text: Parquet, MATLAB up to version 7.2, NumPy archives, Excel, bags of ROS 2.

Columns of a bag (MCAP) are fields of messages, rows are messages of one stamp.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from io import BytesIO
from itertools import islice
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast
from zipfile import ZipFile

import numpy as np

from identification.errors import InvalidInputError, counted
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    quote,
    refuse_long,
    refused_as,
)
from identification.readers.text import (
    FEWEST_COLUMNS,
    MOST_COLUMNS,
    beginning_of,
    find_table,
    read_samples,
    table_of,
)

if TYPE_CHECKING:
    import polars

#: A MATLAB v7.3 file is HDF5 behind a header of this many bytes, or HDF5 from its first byte.
_HEADER = 512
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Classes of variables that are arrays of numbers, as the file's directory calls them.
_NUMERIC = frozenset(
    [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)] + ["double", "single"]
)
#: What an array's name ends in inside a NumPy archive.
_ENDING = ".npy"
#: Kinds of numpy that are durations and dates.
_MOMENTS = "mM"
#: Readers of an array's header by the version of the format.
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_parquet(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; a time of dates or durations becomes seconds. Raises InvalidInputError."""
    import polars as pl

    remedy = "Export it again, or as CSV"
    with refused_as(path, "Parquet file", remedy, pl.exceptions.PanicException):
        types = pl.read_parquet_schema(BytesIO(content))
        wanted = column_names(path, columns, list(types), table=True)
        for role, name in wanted.items():
            kind = types[name]
            if not kind.is_numeric() and not (role == "time" and _is_moment(kind)):
                remedy = "Store it as Float64, one number in each row"
                problem = f"column '{quote(name)}' is of type {quote(str(kind))}, no real numbers"
                remedy = remedy + (", in seconds" if role == "time" else "")
                raise InvalidInputError(path, problem, remedy)
        rows = pl.scan_parquet(BytesIO(content)).select(pl.len()).collect().item()
        refuse_long(path, rows)
        table = pl.read_parquet(BytesIO(content), columns=list(dict.fromkeys(wanted.values())))
        return Reading(
            values={role: _numbers(table[name]) for role, name in wanted.items()},
            names=wanted,
            in_seconds=_is_moment(types[wanted["time"]]),
        )


def _is_moment(kind: polars.DataType) -> bool:
    """Date with time of day, or duration: types that carry their own unit of time."""
    import polars as pl

    return isinstance(kind, pl.Datetime | pl.Duration)


def _numbers(column: polars.Series) -> FloatArray:
    """A column as numbers, a missing one NaN; moments as seconds since the first."""
    import polars as pl

    if _is_moment(column.dtype):
        elapsed = column - column[0]
        # Counted in the unit of the type, which nothing rounds.
        unit = {"ms": 1e3, "us": 1e6, "ns": 1e9}[str(getattr(elapsed.dtype, "time_unit", "us"))]
        column = elapsed.to_physical().cast(pl.Float64) / unit
    return np.asarray(column.cast(pl.Float64).fill_null(float("nan")).to_numpy(), dtype=np.float64)


def read_mat(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, one variable a column. Raises InvalidInputError."""
    import scipy.io

    if content.startswith(_HDF5) or content[_HEADER : _HEADER + len(_HDF5)] == _HDF5:
        problem = "is a MATLAB file of version 7.3 (HDF5), which is not read"
        raise InvalidInputError(path, problem, "Save it with save(..., '-v7') or as CSV")
    reader: Any = scipy.io
    with refused_as(path, "MATLAB file", "Save it again with save(..., '-v7')"):
        directory: list[tuple[str, tuple[int, ...], str]] = reader.whosmat(BytesIO(content))
        present = {str(name): (shape, kind) for name, shape, kind in directory}
        structs = [quote(name) for name, (_, kind) in present.items() if kind == "struct"]
        if structs and len(present) - len(structs) < FEWEST_COLUMNS:
            problem = f"holds its columns in the struct '{structs[0]}', which is not read"
            remedy = f"Save its fields: save('{path.name}', '-struct', '{structs[0]}', '-v7')"
            raise InvalidInputError(path, problem, remedy)
        wanted = column_names(path, columns, list(present), table=False)
        # Before anything is unpacked: shapes and classes stand in the directory, ...
        for name in wanted.values():
            shape, kind = present[name]
            _refuse_shape(path, name, shape if kind in _NUMERIC else None)
        stored = reader.loadmat(BytesIO(content), variable_names=list(wanted.values()))
        values: dict[str, FloatArray] = {}
        for role, name in wanted.items():
            array: Any = stored[name]  # ... which may have lied
            is_numeric = isinstance(stored[name], np.ndarray) and array.dtype.kind in "iuf"
            _refuse_shape(path, name, array.shape if is_numeric else None)
            values[role] = np.asarray(array, dtype=np.float64).ravel()
        return Reading(values=values, names=wanted)


def _refuse_shape(path: Path, name: str, shape: tuple[int, ...] | None) -> None:
    """Refuse a stored array that is no single column, too long, or, None, not of numbers."""
    if shape is None:
        problem = f"variable '{quote(name)}' is not an array of real numbers"
        raise InvalidInputError(path, problem, "Save it as double")
    refuse_long(path, prod(shape))
    if len([size for size in shape if size != 1]) != 1:
        size = " x ".join(str(size) for size in shape) or "a single number"
        problem = f"variable '{quote(name)}' is {size}, not a single column"
        raise InvalidInputError(path, problem, "Name a variable with one value for each sample")


def read_npz(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, nothing unpickled, moments in seconds. Raises InvalidInputError."""
    remedy = "Save it again with numpy.savez(path, time=…, force=…, position=…)"
    with refused_as(path, "NumPy archive", remedy), ZipFile(BytesIO(content)) as archive:
        members = [name for name in archive.namelist() if name.endswith(_ENDING)]
        names = [name.removesuffix(_ENDING) for name in members]
        wanted = column_names(path, columns, names, table=False)
        for name in wanted.values():
            if names.count(name) > 1:
                problem = f"has two arrays named '{quote(name)}'"
                raise InvalidInputError(path, problem, "Rename one of them")
        kinds = {role: _kind(path, archive, role, name) for role, name in wanted.items()}
        values = {role: _array(archive, name, kinds[role]) for role, name in wanted.items()}
        moments = kinds["time"].kind in _MOMENTS
        return Reading(values=values, names=wanted, in_seconds=moments)


def _kind(path: Path, archive: ZipFile, role: str, name: str) -> np.dtype[Any]:
    """Type of an array, its header read before memory is spent on it."""
    with archive.open(name + _ENDING) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in _HEADERS:
            raise InvalidInputError(
                path,
                f"array '{quote(name)}' has format {version[0]}.{version[1]}, made for records",
                "Save a plain array of float64",
            )
        shape, _, kind = _HEADERS[version](stream)
    allowed = "iuf" + _MOMENTS if role == "time" else "iuf"
    if kind.kind not in allowed:
        what = "pickled Python objects" if kind.hasobject else f"of type {quote(str(kind))}"
        problem = f"array '{quote(name)}' is {what}, not of real numbers"
        raise InvalidInputError(path, problem, "Save it as an array of float64")
    _refuse_shape(path, name, shape)
    return kind


def _array(archive: ZipFile, name: str, kind: np.dtype[Any]) -> FloatArray:
    """One array of a type that was looked at; moments as seconds, one that is missing NaN."""
    with archive.open(name + _ENDING) as stream:
        stored = np.lib.format.read_array(stream, allow_pickle=False).ravel()
    if kind.kind in _MOMENTS:
        stored = (stored - stored[0]) / np.timedelta64(1, "s")
    return np.asarray(stored, dtype=np.float64)


#: Empty rows in a row; a cell far away makes a million of them.
_MOST_EMPTY = 1000
#: Rows of a sheet in which a log is looked for.
_BEGINNING = 220
#: Where workbooks count days from.
_START = datetime(1900, 1, 1)


def read_excel(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, moments in seconds, empty cells NaN. Raises InvalidInputError."""
    try:
        import openpyxl
    except ImportError:
        raise InvalidInputError(
            path,
            "is an Excel workbook, and openpyxl, which reads them, is not installed",
            'Install it with python -m pip install "haptune[excel]", or export the sheet as CSV',
        ) from None
    reader: Any = openpyxl
    with refused_as(path, "Excel workbook", "Save it again as .xlsx, or export the sheet as CSV"):
        book = reader.load_workbook(BytesIO(content), read_only=True, data_only=True)
        named: list[Any] = []
        others: list[Any] = []
        for sheet in book.worksheets:
            text, _ = _written(path, sheet, _BEGINNING)
            if find_table(path, beginning_of(text), columns) is not None:
                named.append(sheet)
            elif text.strip():
                others.append(sheet)
        if len(named) > 1:
            names = ", ".join(f"'{quote(sheet.title)}'" for sheet in named[:10])
            problem = f"has several sheets with the columns of a log: {names}"
            raise InvalidInputError(path, problem, "Keep one of them in the file")
        if not named and not others:
            raise InvalidInputError(path, "has no table on any sheet", "Export the log again")
        chosen = (named or others)[0]
        text, moments = _written(path, chosen)
        table = table_of(path, text, columns)
        reading = read_samples(path, text, table)
        notes = () if len(book.worksheets) == 1 else (f"sheet '{quote(chosen.title)}'",)
        in_seconds = table.places["time"] in moments
        return replace(reading, notes=(*notes, *reading.notes), in_seconds=in_seconds)


def _written(path: Path, sheet: Any, most: int | None = None) -> tuple[bytes, Container[int]]:
    """A sheet, so many of its rows at most, as cells between tabs; its columns of moments.

    A date, time of day or duration becomes seconds since the first of its column.
    """
    first: dict[int, timedelta] = {}

    def written(place: int, cell: Any) -> str:
        if isinstance(cell, (int, float)):
            return repr(cell)
        moment = cell
        if isinstance(moment, time):
            moment = datetime.combine(_START, moment)
        if isinstance(moment, datetime):
            moment -= _START
        if isinstance(moment, timedelta):
            return repr((moment - first.setdefault(place, moment)).total_seconds())
        return "" if cell is None else " ".join(str(cell).replace('"', "").split())

    rows = ("\t".join(map(written, range(len(row)), row)) for row in _rows(path, sheet, most))
    # Down to the last line that is not empty.
    return "\n".join(rows).rstrip("\t\n").encode() + b"\n", first


def _rows(path: Path, sheet: Any, most: int | None) -> Iterator[tuple[Any, ...]]:
    """Rows of values, so many at most, however far down cells claim to stand."""
    sheet.reset_dimensions()
    rows: Iterator[tuple[Any, ...]] = islice(sheet.iter_rows(values_only=True), most)
    empty = 0
    for count, row in enumerate(rows, 1):
        refuse_long(path, count)
        empty = 0 if any(cell is not None for cell in row) else empty + 1
        if empty > _MOST_EMPTY:
            raise InvalidInputError(
                path,
                f"has more than {_MOST_EMPTY} empty rows above a cell, from row {count - empty} on",
                "Delete what stands far below the log",
            )
        if len(row) > MOST_COLUMNS:
            raise InvalidInputError(
                path, f"has {len(row)} columns, more than {MOST_COLUMNS}", "Keep those of the log"
            )
        yield row


#: Bytes that one chunk may unfold to; recorders write some megabytes.
_LARGEST_CHUNK = 500_000_000
#: Part of the rows that has to have a partner of the same stamp in every topic.
_FEWEST_TOGETHER = 0.5
#: Topics and fields listed in a message at most.
_MOST_LISTED = 10
#: What --time is where nobody named it: the header's stamp.
_STAMP = "time"
#: Times of the record of a message that are no field of it.
_RECORDED = ("log_time", "publish_time")
_PART = re.compile(r"(?P<name>[A-Za-z]\w*)(?:\[(?P<index>\d+)\])?")
_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    """A field of the messages of a topic: its names from the outside in, each perhaps indexed."""

    topic: str
    parts: tuple[tuple[str, int | None], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Messages:
    """What the messages of one topic hold: when each was stamped, ns, and values by role."""

    stamps: list[int]
    values: dict[str, list[Any]]


def read_mcap(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, named TOPIC/FIELD: /joint_states/position[0]. Raises InvalidInputError.

    Time is the stamp in the header of the messages, unless ``columns.time`` names a field,
    log_time or publish_time. Fields of several topics are joined where their stamps are equal.
    """
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise InvalidInputError(
            path,
            "is a bag of ROS 2, and mcap and mcap-ros2-support, which read it, are not installed",
            'Install them with python -m pip install "haptune[ros]", or export the topic as CSV',
        ) from None
    remedy = "Recover it (mcap recover), or export the topic as CSV"
    with refused_as(path, "bag of ROS 2", remedy):
        reader: Any = make_reader(BytesIO(content), decoder_factories=[DecoderFactory()])
        topics = _topics(path, reader)
        fields = _fields(path, columns, topics)
        if columns.time not in {_STAMP, *_RECORDED}:
            fields["time"] = _field(path, "time", columns.time, topics)
        return _joined(path, _read(path, reader, fields, columns.time), columns)


def _topics(path: Path, reader: Any) -> dict[str, str]:
    """Names of the types of messages by topic; refuses what would unfold to too much."""
    summary = reader.get_summary()
    if summary is None:
        raise InvalidInputError(path, "has no summary: it was cut off", "Use mcap recover")
    if any(chunk.uncompressed_size > _LARGEST_CHUNK for chunk in summary.chunk_indexes):
        raise InvalidInputError(
            path, f"claims a chunk of more than {_LARGEST_CHUNK} bytes", "Record it again"
        )
    if summary.statistics is not None:
        for count in summary.statistics.channel_message_counts.values():
            refuse_long(path, count)
    return {
        channel.topic: summary.schemas[channel.schema_id].name if channel.schema_id else "no type"
        for channel in summary.channels.values()
    }


def _fields(path: Path, columns: LogColumns, topics: Mapping[str, str]) -> dict[str, _Field]:
    """The fields asked for by role, time left out."""
    asked = {"force": columns.force, "position": columns.position}
    if columns.reference is not None:
        asked["reference"] = columns.reference
    unnamed = [role for role, name in asked.items() if name == role]
    if unnamed:
        some = sorted(topics.items())[:_MOST_LISTED]
        listed = ", ".join(f"{quote(name)} ({quote(kind)})" for name, kind in some)
        options = " ".join(f"--{role} TOPIC/FIELD" for role in unnamed)
        typed = (name for name, kind in some if kind.endswith("/JointState"))
        joints, fields = next(typed, "/joint_states"), {"force": "effort[0]"}
        named = (f'--{role} "{joints}/{fields.get(role, "position[0]")}"' for role in unnamed)
        raise InvalidInputError(
            path,
            f"is a bag with the topics {listed or 'none'}, and nobody said which fields are the "
            + " and the ".join(unnamed),
            f"Add {options}, such as {' '.join(named)}",
        )
    return {role: _field(path, role, name, topics) for role, name in asked.items()}


def _field(path: Path, role: str, name: str, topics: Mapping[str, str]) -> _Field:
    """The field that TOPIC/FIELD names. Raises InvalidInputError."""
    slashed = name if name.startswith("/") else f"/{name}"
    topic = max((each for each in topics if slashed.startswith(f"{each}/")), key=len, default="")
    found = [_PART.fullmatch(part) for part in slashed[len(topic) + 1 :].split("/")]
    if not topic or None in found:
        listed = ", ".join(quote(each) for each in sorted(topics)[:_MOST_LISTED])
        problem = f"has no field '{quote(name)}'; its topics are {listed or 'none'}"
        remedy = f"Name topic and field, such as --{role} /joint_states/position[0]"
        raise InvalidInputError(path, problem, remedy)
    return _Field(
        topic=topic,
        parts=tuple(
            (part["name"], None if part["index"] is None else int(part["index"]))
            for part in found
            if part is not None
        ),
    )


def _read(path: Path, reader: Any, fields: Mapping[str, _Field], when: str) -> dict[str, _Messages]:
    """Values of all messages by topic."""
    names: dict[_Field, str | None] = {}
    found: dict[str, _Messages] = {}
    topics = sorted({field.topic for field in fields.values()})
    if when in _RECORDED and len(topics) > 1:
        raise InvalidInputError(
            path,
            f"messages of {' and '.join(quote(topic) for topic in topics)} have each their own "
            f"{when}",
            "Leave out --time: they are joined by the stamps in their headers",
        )
    for _, channel, record, message in reader.iter_decoded_messages(topics=topics):
        topic = channel.topic
        mine = {role: field for role, field in fields.items() if field.topic == topic}
        kept = found.setdefault(topic, _Messages(stamps=[], values={role: [] for role in mine}))
        if when in _RECORDED:
            kept.stamps.append(getattr(record, when))
        elif when == _STAMP or len(topics) > 1:
            kept.stamps.append(_stamp(path, topic, message))
        else:
            kept.stamps.append(len(kept.stamps))
        for role, field in mine.items():
            kept.values[role].append(_value(path, field, message))
            joint = _joint(field, message)
            if names.setdefault(field, joint) != joint:
                raise InvalidInputError(
                    path,
                    f"the order of the joints in {quote(topic)} changes: {quote(str(joint))} "
                    f"stands where {quote(str(names[field]))} stood",
                    "Record a topic in which it does not",
                )
        refuse_long(path, len(kept.stamps))
    missing = [topic for topic in topics if topic not in found]
    if missing:
        problem = f"has no messages of {quote(missing[0])}"
        raise InvalidInputError(path, problem, "Record them, or name another topic")
    return found


def _stamp(path: Path, topic: str, message: Any) -> int:
    """The stamp in the header of a message, ns."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        raise InvalidInputError(
            path,
            f"messages of {quote(topic)} have no header with a stamp",
            "Add --time TOPIC/FIELD, or --time publish_time (when they were sent) or --time "
            "log_time (when they were recorded) if these are even enough",
        )
    return _nanoseconds(stamp)


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def _value(path: Path, field: _Field, message: Any) -> Any:
    """A field as a number or a stamp. Raises InvalidInputError for anything else."""
    found: Any = message
    for name, index in field.parts:
        present: Sequence[str] = getattr(found, "__slots__", ())
        if name not in present:
            listed = ", ".join(map(quote, present[:_MOST_LISTED])) or "none"
            raise InvalidInputError(
                path,
                f"messages of {quote(field.topic)} have no field '{quote(name)}' there; they "
                f"have: {listed}",
                "Name one of these",
            )
        found = getattr(found, name)
        if index is not None:
            items = _items(found)
            if index >= len(items):
                return float("nan")
            found = items[index]
    if hasattr(found, "nanosec"):
        return found
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        what = counted(len(_items(found)), "value") if _items(found) else "no number"
        problem = f"field '{quote(field.parts[-1][0])}' of {quote(field.topic)} holds {what}"
        remedy = "Name a field of one number, with its index in brackets where there are several"
        raise InvalidInputError(path, problem, remedy)
    return found


def _joined(path: Path, found: Mapping[str, _Messages], columns: LogColumns) -> Reading:
    """Columns of the messages that have a partner of the same stamp in every topic."""
    together = set[int].intersection(*(set(each.stamps) for each in found.values()))
    most = max(len(each.stamps) for each in found.values())
    if len(together) < _FEWEST_TOGETHER * most:
        raise InvalidInputError(
            path,
            f"has {len(together)} stamps that all of {', '.join(map(quote, found))} share, of "
            f"{most}: they are not stamped together, and when a force acted is not known",
            "Log force and position in one message, or with one stamp",
        )
    values: dict[str, FloatArray] = {}
    names = {"time": columns.time, "force": columns.force, "position": columns.position}
    in_seconds = True
    for each in found.values():
        rows = [k for k, stamp in enumerate(each.stamps) if stamp in together]
        for role, column in each.values.items():
            numbers = [column[k] for k in rows]
            if role == "time":
                # Since the first, as clocks count from 1970; stamps become seconds.
                in_seconds = hasattr(numbers[0], "nanosec")
                counted = [_nanoseconds(stamp) for stamp in numbers] if in_seconds else numbers
                size = _NANOSECONDS if in_seconds else 1
                numbers = [(moment - counted[0]) / size for moment in counted]
            values[role] = np.array(numbers, dtype=np.float64)
    if "time" not in values:
        topic, first = next(iter(found.items()))
        stamps = [stamp for stamp in first.stamps if stamp in together]
        values["time"] = np.array([stamp - stamps[0] for stamp in stamps]) / _NANOSECONDS
        if columns.time == _STAMP:
            names["time"] = f"header stamp of {topic}"
    if columns.reference is not None:
        names["reference"] = columns.reference
    lost = most - len(together)
    notes = (f"{lost} of {most} messages without a partner left out",) if lost else ()
    return Reading(values=values, names=names, notes=notes, in_seconds=in_seconds)


def _joint(field: _Field, message: Any) -> str | None:
    """Name of the joint that an indexed field belongs to, where the message names its joints."""
    joints = _items(getattr(message, "name", None))
    index = field.parts[-1][1]
    return None if index is None or index >= len(joints) else str(joints[index])


def _items(found: Any) -> Sequence[Any]:
    """Elements of an array in a message; none of anything else."""
    if isinstance(found, (list, tuple)):
        return cast("Sequence[Any]", found)
    return ()
