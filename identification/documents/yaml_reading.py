"""YAML in: hostile input is refused in a sentence, before anything is built from it."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, cast

from identification.errors import InvalidInputError

#: Bytes. No device, scene or profile comes near this; a larger file is a mistake or an attack.
LARGEST_FILE = 1_000_000
#: Values, keys and brackets of one file, which is what time goes by: a profile of a hundred
#: elements has half of it.
MOST_EVENTS = 20_000
#: Levels of lists and mappings; a profile has five.
DEEPEST = 32


def load_mapping(path: str | PathLike[str]) -> dict[str, Any]:
    """The mapping in a YAML file, read without executing, aliasing or duplicating anything.

    Raises:
        InvalidInputError: unreadable, too large, not UTF-8, not YAML, too deep, not a mapping, or
            with anything in it but text, numbers, true, false, lists and mappings of names.
    """
    from ruamel.yaml.error import YAMLError

    text = _read(Path(path))
    try:
        content: object = _loader().load(text)
    except _UnsafeError as error:
        problem = str(error)
        raise InvalidInputError(
            path, problem, "Write the values out, one mapping of names"
        ) from None
    except YAMLError as error:
        raise InvalidInputError(path, _yaml_sentence(error), "Correct it there") from None
    except (RecursionError, ValueError) as error:
        problem = f"is not valid YAML: {' '.join(str(error).split())[:200]}"
        raise InvalidInputError(path, problem, "Correct the file") from None
    if not isinstance(content, dict):
        problem = "does not hold a mapping of names to values"
        raise InvalidInputError(path, problem, "See 'haptune new' for templates")
    found = cast("dict[object, object]", content)
    day = found.get("date")
    if type(day) is datetime.date:  # what YAML reads as a date is one where a date belongs
        found["date"] = day.isoformat()
    strange = next(_strange_values(content, ""), None)  # pyright: ignore[reportUnknownArgumentType]
    if strange is not None:
        raise InvalidInputError(path, strange, "Write a number, a name, or text in quotes")
    return cast("dict[str, Any]", content)


def _yaml_sentence(error: Any) -> str:
    """The parser's complaint without its excerpt and its advice to programmers."""
    mark = getattr(error, "problem_mark", None)
    where = "" if mark is None else f" in line {mark.line + 1}"
    what = f"{getattr(error, 'context', None) or ''} {getattr(error, 'problem', None) or error}"
    what = what.partition(" with value ")[0]
    return f"is not valid YAML{where}: {' '.join(what.split())[:200]}"


def _read(path: Path) -> str:
    try:
        if path.is_fifo() or path.is_socket():  # nobody may ever write to it
            problem = "cannot be read (it is a pipe or a socket, not a file)"
            raise InvalidInputError(path, problem, "Write it to a file first")
        with path.open("rb") as stream:
            data = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        problem = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InvalidInputError(path, problem, "Check the name and the permissions") from None
    if len(data) > LARGEST_FILE:
        raise InvalidInputError(path, f"has more than {LARGEST_FILE} bytes", "Give a smaller file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"byte {error.start} is not UTF-8 text"
        raise InvalidInputError(path, problem, "Save it as UTF-8") from None


class _UnsafeError(Exception):
    """What makes a YAML file grow beyond its text."""


def _loader() -> Any:
    """A reader that looks at each part of a file before anything is built from it."""
    from ruamel.yaml import YAML
    from ruamel.yaml.parser import Parser

    class CheckedParser(Parser):
        number = depth = 0

        def get_event(self) -> Any:
            event = cast("Any", super().get_event())  # pyright: ignore[reportUnknownMemberType]
            kind = type(event).__name__
            self.number += 1
            self.depth += kind.endswith(("SequenceStartEvent", "MappingStartEvent"))
            self.depth -= kind.endswith(("SequenceEndEvent", "MappingEndEvent"))
            if self.number > MOST_EVENTS:
                raise _UnsafeError(f"holds more than {MOST_EVENTS} keys, values and brackets")
            if self.depth > DEEPEST:
                raise _UnsafeError(f"is nested more than {DEEPEST} levels deep")
            if getattr(event, "anchor", None) is not None:
                raise _UnsafeError("contains YAML anchors or aliases (& or *)")
            return event

    loader: Any = YAML(typ="safe", pure=True)
    loader.Parser = CheckedParser
    return loader


def _strange_values(value: object, where: str) -> Iterator[str]:
    """What a YAML reader makes of things no file of ours holds: dates, bytes, sets, other keys."""
    if isinstance(value, dict):
        for key, item in cast("dict[object, object]", value).items():
            if isinstance(key, str):
                yield from _strange_values(item, f"{where}.{key}" if where else key)
            else:
                yield f"{where or 'the file'} has the key {key!r}, which is no text"
    elif isinstance(value, list):
        for item in cast("list[object]", value):
            yield from _strange_values(item, where)
    elif isinstance(value, int) and value.bit_length() > 64:
        yield f"{where}: an integer of {value.bit_length()} bits"
    elif not isinstance(value, str | int | float | None):
        yield f"{where}: {str(value)[:40]!r} reads as a {type(value).__name__}"
