"""YAML in and out: hostile input refused in a sentence, numbers written for every reader."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from identification.errors import InvalidInputError

#: Bytes. No device, scene or profile comes near this; a larger file is a mistake or an attack.
LARGEST_FILE = 1_000_000
#: Values, keys and brackets of one file, which is what time goes by: a profile of a hundred
#: elements has a third of it.
MOST_EVENTS = 20_000
#: Levels of lists and mappings; a profile has five.
DEEPEST = 32
#: Complaints listed about one file; the rest is counted.
MOST_PROBLEMS = 8

#: Significant digits of every number in a file. Fifteen decimal digits tell any two apart, so a
#: changed digit always changes the number; nothing measured here is known to more than twelve.
DIGITS = 12

Model = TypeVar("Model", bound="Document")


class Document(BaseModel):
    """Base of everything stored in YAML: frozen, no unknown keys, numbers finite."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_by_name=True,
        validate_by_alias=True,
    )

    @field_validator("*", mode="before")
    @classmethod
    def _no_flag_for_a_number(cls, raw: Any, info: ValidationInfo) -> Any:
        """True is 1 to Python; to whoever wrote the file it is a mistake."""
        allowed = cls.model_fields[info.field_name or ""].annotation
        if _holds_flag(raw) and allowed is not bool and bool not in get_args(allowed):
            raise ValueError("true and false are no numbers")
        return raw


def _holds_flag(raw: object) -> bool:
    if isinstance(raw, list | tuple):
        return any(_holds_flag(item) for item in cast("list[object]", raw))
    return isinstance(raw, bool)


def load_mapping(path: str | PathLike[str]) -> dict[str, Any]:
    """The mapping in a YAML file, read without executing, aliasing or duplicating anything.

    Raises:
        InvalidInputError: unreadable, too large, not UTF-8, not YAML, too deep, not a mapping, or
            with anything in it but text, numbers, true, false, lists and mappings of names.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    text = _read(Path(path))
    scanner: Any = YAML(typ="safe", pure=True)
    loader: Any = YAML(typ="safe", pure=True)
    try:
        unsafe = next(_unsafe_parts(scanner.parse(text)), None)
        if unsafe is not None:
            raise InvalidInputError(path, unsafe, "Write the values out, one mapping of names")
        content: object = loader.load(text)
    except YAMLError as error:
        raise InvalidInputError(path, _yaml_sentence(error), "Correct it there") from None
    except (RecursionError, ValueError) as error:
        problem = f"is not valid YAML: {' '.join(str(error).split())[:200]}"
        raise InvalidInputError(path, problem, "Correct the file") from None
    if not isinstance(content, dict):
        problem = "does not hold a mapping of names to values"
        raise InvalidInputError(path, problem, "See 'haptune new' for templates")
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


def _unsafe_parts(events: Iterable[Any]) -> Iterator[str]:
    """What makes a YAML file grow beyond its text, found before anything is built from it."""
    depth = 0
    for number, event in enumerate(events, start=1):
        if number > MOST_EVENTS:
            yield f"holds more than {MOST_EVENTS} keys, values and brackets"
        kind = type(event).__name__
        depth += kind.endswith(("SequenceStartEvent", "MappingStartEvent"))
        depth -= kind.endswith(("SequenceEndEvent", "MappingEndEvent"))
        if depth > DEEPEST:
            yield f"is nested more than {DEEPEST} levels deep"
        if getattr(event, "anchor", None) is not None:
            yield "contains YAML anchors or aliases (& or *)"


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


def parse_document(
    model: type[Model], content: Mapping[str, Any], source: str | PathLike[str]
) -> Model:
    """Validate a mapping against a model, turning every complaint into a sentence.

    Raises:
        InvalidInputError: naming each key, the value seen and what is allowed.
    """
    schema = model.model_fields.get("schema_")
    stated = content.get("schema")
    if schema is not None and stated is not None and stated != schema.default:
        problem = f"schema is {str(stated)[:80]!r}, needed is {schema.default!r}"
        raise InvalidInputError(source, problem, "Give the right kind of file")
    try:
        return model.model_validate(content)
    except ValidationError as error:
        names = _names(model)
        items = [dict(item) for item in error.errors(include_url=False)]
        # A word would have been another way to say it; what is wrong with this way is said.
        telling = [
            item
            for item in items
            if item["type"] != "literal_error" or isinstance(item["input"], str)
        ]
        found = [_sentence(item, names) for item in telling or items]
        problems = "; ".join(dict.fromkeys(found[:MOST_PROBLEMS]))
        if len(found) > MOST_PROBLEMS:
            problems += f"; and {len(found) - MOST_PROBLEMS} more"
        raise InvalidInputError(
            source, problems, "Correct the keys named; 'haptune new' writes commented templates"
        ) from None


def _names(model: type[BaseModel]) -> tuple[str, ...]:
    """Every key that a document of this kind can hold at any level."""
    schema = model.model_json_schema(by_alias=True)
    parts = [schema, *schema.get("$defs", {}).values()]
    return tuple(dict.fromkeys(name for part in parts for name in part.get("properties", {})))


def _sentence(item: dict[str, Any], names: tuple[str, ...]) -> str:
    location = [str(part) for part in item["loc"]]
    where = ".".join(part for part in location if not part.startswith(("function-", "literal[")))
    seen = repr(item["input"])
    kind = item["type"]
    if kind == "missing":
        return f"{where}: is missing"
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(location[-1], names, n=1)
        return f"{where}: is no key known here" + (f"; did you mean {near[0]}?" if near else "")
    message = "give a mapping of keys" if kind == "model_type" else str(item["msg"])
    return f"{where or 'file'}: {message.removeprefix('Value error, ')} (seen: {seen[:80]})"


def load_document(model: type[Model], path: str | PathLike[str]) -> Model:
    """Read and validate one YAML file. Raises InvalidInputError."""
    return parse_document(model, load_mapping(path), path)


def rounded(number: float, digits: int = DIGITS) -> float:
    """The nearest double whose shortest decimal form has at most ``digits`` digits."""
    return float(f"{number:.{digits - 1}e}")


def _round_all(value: Any) -> Any:
    if isinstance(value, float):
        return rounded(value)
    if isinstance(value, Mapping):
        return {key: _round_all(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [_round_all(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def to_mapping(document: Document) -> dict[str, Any]:
    """The document as plain YAML types, numbers rounded to DIGITS, absent keys left out."""
    content = document.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {key: _round_all(value) for key, value in content.items()}


def as_stored(document: Model) -> Model:
    """The document as it will read back from its file: certify this, not the unrounded one."""
    return type(document).model_validate(to_mapping(document))


def to_yaml(content: Mapping[str, Any], comment: str = "") -> str:
    """YAML text that readers of YAML 1.1 (PyYAML, ROS 2) and 1.2 understand alike.

    Floats have a point (no bare 1e-3), texts that either version takes for something else are in
    quotes, and no line is broken: a key that goes on in the next line is no key to any reader.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import ScalarNode
    from ruamel.yaml.resolver import VersionedResolver

    yaml: Any = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False
    yaml.width = _UNBROKEN
    older: Any = VersionedResolver(version=(1, 1))

    def represent_float(representer: Any, value: float) -> Any:
        text = repr(value)
        if "e" in text and "." not in text:
            text = text.replace("e", ".0e")
        return representer.represent_scalar("tag:yaml.org,2002:float", text)

    def represent_str(representer: Any, value: str) -> Any:
        # The writer leaves "x?" and ":x" plain on one line, where readers take the mark as theirs,
        # and breaks lines at ends of lines that only some readers know, but for double quotes.
        marked = value.startswith((":", "-")) or "?" in value
        text = older.resolve(ScalarNode, value, (True, False)) == older.DEFAULT_SCALAR_TAG
        plain = None if text and not marked else "'"
        style = plain if value.isprintable() else '"'
        return representer.represent_scalar("tag:yaml.org,2002:str", value, style=style)

    def represent_list(representer: Any, items: list[Any]) -> Any:
        return representer.represent_sequence(
            "tag:yaml.org,2002:seq", items, flow_style=_short(items)
        )

    def represent_dict(representer: Any, items: dict[str, Any]) -> Any:
        return representer.represent_mapping(
            "tag:yaml.org,2002:map", items, flow_style=_short(items.values(), items)
        )

    def represent_root(representer: Any, items: _Root) -> Any:
        return representer.represent_mapping("tag:yaml.org,2002:map", items, flow_style=False)

    yaml.representer.add_representer(float, represent_float)
    yaml.representer.add_representer(str, represent_str)
    yaml.representer.add_representer(list, represent_list)
    yaml.representer.add_representer(dict, represent_dict)
    yaml.representer.add_representer(_Root, represent_root)
    stream = StringIO()
    yaml.dump(_Root(content), stream)
    heading = "".join(f"# {line}\n" for line in comment.splitlines())
    return heading + stream.getvalue()


class _Root(dict[str, Any]):
    """The outermost mapping: always one key a line."""


#: Columns that no line of a file reaches.
_UNBROKEN = LARGEST_FILE
#: Characters of a collection that still goes on one line: keys, values and what is between them.
_ONE_LINE = 88


def _short(values: Iterable[Any], keys: Iterable[str] = ()) -> bool:
    """True for a few scalars that fit on one line with their keys."""
    listed = list(values)
    return (
        bool(listed)
        and not any(isinstance(item, list | dict) for item in listed)
        and sum(len(str(item)) + 2 for item in [*listed, *keys]) <= _ONE_LINE
    )
