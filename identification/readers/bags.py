"""Bags of ROS 2 (MCAP): columns are fields of messages, rows are messages of one stamp."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    quote,
    refuse_long,
    refused_as,
)

#: Bytes that one chunk may unfold to; recorders write some megabytes.
_LARGEST_CHUNK = 500_000_000
#: Part of the rows that has to have a partner of the same stamp in every topic.
_FEWEST_TOGETHER = 0.5
#: Topics and fields listed in a message at most.
_MOST_LISTED = 10
#: What --time is where nobody named it: the header's stamp.
_HEADER = "time"
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
    """Columns by role, named TOPIC/FIELD such as /joint_states/position[0].

    Time is the stamp in the header of the messages, unless ``columns.time`` names a field,
    log_time or publish_time. Fields of several topics are joined where their stamps are equal.

    Raises:
        InvalidInputError: no such topic or field, topics that are not stamped together, a bag that
            cannot be read.
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
        if columns.time not in {_HEADER, *_RECORDED}:
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
        elif when == _HEADER or len(topics) > 1:
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
        what = f"{len(_items(found))} values" if _items(found) else "no number"
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
        if columns.time == _HEADER:
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
