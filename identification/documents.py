"""Documents in YAML files, every complaint a sentence; files written whole or not at all."""

from __future__ import annotations

import difflib
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from inspect import Parameter, Signature
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from identification.errors import InvalidInputError, NotWrittenError, printable

#: Complaints listed about one file; the rest is counted.
_MOST_PROBLEMS = 8
#: Bytes. No device, scene or profile comes near this; a larger file is a mistake or an attack.
LARGEST_FILE = 1_000_000
#: Values, keys and brackets of one file, which is what time goes by: a profile of a hundred
#: elements has half of it.
MOST_EVENTS = 20_000
#: Levels of lists and mappings; a profile has five.
_DEEPEST = 32
#: Columns that no line of a file reaches.
_UNBROKEN = 1_000_000
#: Characters of a collection that still goes on one line: keys, values and what is between them.
_ONE_LINE = 88
#: Lines up to which a difference is shown line by line; logs are longer.
_LONGEST_DIFFERENCE = 2000
#: Significant digits of every number in a file. Fifteen decimal digits tell any two apart, so a
#: changed digit always changes the number; nothing measured here is known to more than twelve.
_DIGITS = 12
#: Gives files their names, two arguments each; nothing is imported that takes time.
_RENAME = "import os, sys\nfor k in range(1, len(sys.argv), 2): os.replace(*sys.argv[k : k + 2])"

#: What a value has to be, and the validator's names of what it is not.
_RULES = {
    "give a mapping of keys": "model_type dict_type",
    "give a list": "tuple_type list_type",
    "give a text, in quotes if it looks like a number": "string_type",
    "give true or false": "bool_type bool_parsing",
    "give a number": "float_type float_parsing",
    "give a whole number": "int_type int_parsing int_from_float",
    "give a finite number": "finite_number",
    "must be {expected}": "literal_error",
    "must be greater than {gt:g}": "greater_than",
    "must be greater than or equal to {ge:g}": "greater_than_equal",
    "must be less than {lt:g}": "less_than",
    "must be less than or equal to {le:g}": "less_than_equal",
    "has {actual_length} entries, and may have {max_length}": "too_long",
    "needs {min_length} entries, and has {actual_length}": "too_short",
    "has more than {max_length} letters": "string_too_long",
    "{error}": "value_error",
}
_RULE_OF = {kind: rule for rule, kinds in _RULES.items() for kind in kinds.split()}

_Model = TypeVar("_Model", bound="Document")


class _KeyNames:
    """Signature of a document for help(): its keys and plain defaults, without validators."""

    def __get__(self, document: object, kind: type[BaseModel]) -> Signature:
        keys: list[Parameter] = []
        for name, field in kind.model_fields.items():
            default = Parameter.empty if field.is_required() else field.get_default()
            keys.append(Parameter(field.alias or name, Parameter.KEYWORD_ONLY, default=default))
        return Signature(keys)


class Document(BaseModel):
    """Base of everything stored in YAML: frozen, no unknown keys, numbers finite."""

    model_config = ConfigDict(
        defer_build=True,
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_by_name=True,
        validate_by_alias=True,
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        cls.__signature__ = _KeyNames()  # pyright: ignore[reportAttributeAccessIssue]

    @field_validator("*", mode="wrap")
    @classmethod
    def _as_read(cls, raw: Any, valid: Callable[[Any], Any], info: ValidationInfo) -> Any:
        """True is 1 to Python; to whoever wrote the file it is a mistake. Mappings stay as read."""
        allowed = cls.model_fields[info.field_name or ""].annotation
        if _holds_flag(raw) and allowed is not bool and bool not in get_args(allowed):
            raise ValueError("true and false are neither numbers nor text")
        value = valid(raw)
        return _ReadOnly(cast("dict[str, Any]", value)) if type(value) is dict else value


class _ReadOnly(dict[str, Any]):
    """A mapping of a document, which is what was validated for as long as it lives."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("a document is read-only; model_copy(update=...) makes another one")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse  # pyright: ignore[reportAssignmentType]

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return type(self), (dict(self),)


def _holds_flag(raw: object) -> bool:
    if isinstance(raw, list | tuple):
        return any(_holds_flag(item) for item in cast("list[object]", raw))
    return isinstance(raw, bool)


def parse_document(
    model: type[_Model], content: Mapping[str, Any], source: str | PathLike[str], remedy: str = ""
) -> _Model:
    """Validate a mapping against a model, turning every complaint into a sentence with a remedy.

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
        remedy = remedy or "Correct the keys named; 'haptune new' writes commented templates"
        raise InvalidInputError(source, complaints(model, error), remedy) from None


def complaints(model: type[Document], error: ValidationError) -> str:
    """What a validator says against a document, a sentence for each key, the first few of them."""
    schemas = model.model_json_schema(by_alias=True)
    parts = {"": schemas, **schemas.get("$defs", {})}  # the keys at the top, and of what is below
    items = [dict(item) for item in error.errors(include_url=False)]
    # A word would have been another way to say it; what is wrong with this way is said.
    others = (
        each["type"] != "literal_error" or isinstance(each["input"], str | None) for each in items
    )
    telling = [item for item, tells in zip(items, others, strict=True) if tells]
    found = [_sentence(item, parts) for item in telling or items]
    problems = "; ".join(dict.fromkeys(found[:_MOST_PROBLEMS]))
    more = len(found) - _MOST_PROBLEMS
    return f"{problems}; and {more} more" if more > 0 else problems


def _sentence(item: dict[str, Any], parts: dict[str, Any]) -> str:
    location = [str(part)[:80] for part in item["loc"]]
    where = ".".join(part for part in location if not part.startswith(("function-", "literal[")))
    kind = str(item["type"])
    if kind == "missing":
        return f"{where}: is missing"
    if kind == "extra_forbidden":
        key, among = location[-1], [parts[""]] if len(location) == 1 else parts.values()
        names = dict.fromkeys(name for part in among for name in part.get("properties", {}))
        near = [name for name in names if name.startswith(f"{key}_")]
        near = near or difflib.get_close_matches(key, names, n=1)
        return f"{where}: is no key known here" + (f"; did you mean {near[0]}?" if near else "")
    message = _RULE_OF.get(kind, "is not as it must be").format_map(item.get("ctx", {}))
    given, keys = item["input"], parts.get(item.get("ctx", {}).get("class_name"), {})
    message += f": {', '.join(keys['required'])}" if "required" in keys else ""
    if given is None:
        return f"{where}: is blank; fill it in ({message})"
    # What is wrong with a mapping or a list as a whole is said with its numbers.
    if not isinstance(given, Mapping | list | tuple | BaseModel):
        if message.startswith("give a number") and str(given)[:1].isdigit():
            seconds = where.endswith(("time", "delay", "lag", "duration"))
            message += f": the number alone, in {'seconds' if seconds else 'SI units'}"
        message += f" (seen: {repr(given)[:80]})"
    return f"{where or 'file'}: {message}"


def load_document(model: type[_Model], path: str | PathLike[str]) -> _Model:
    """Read and validate one YAML file. Raises InvalidInputError."""
    return parse_document(model, load_mapping(path), path)


def round_to_digits(number: float, digits: int = _DIGITS) -> float:
    """The nearest double whose shortest decimal form has at most ``digits`` digits."""
    return float(f"{number:.{digits - 1}e}")


def _round_all(value: Any) -> Any:
    if isinstance(value, float):
        return round_to_digits(value)
    if isinstance(value, Mapping):
        return {key: _round_all(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [_round_all(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def to_mapping(document: Document) -> dict[str, Any]:
    """The document as plain YAML types, numbers rounded to twelve digits, absent keys left out."""
    return _round_all(document.model_dump(mode="json", by_alias=True, exclude_none=True))


def as_stored(document: _Model) -> _Model:
    """The document as it will read back from its file: certify this, not the unrounded one."""
    return type(document).model_validate(to_mapping(document))


def load_mapping(path: str | PathLike[str], text: str | None = None) -> dict[str, Any]:
    """The mapping in a YAML file, read without executing, aliasing or duplicating anything.

    A text is what the file is to hold; without one it is read.

    Raises:
        InvalidInputError: unreadable, too large, not UTF-8, not YAML, too deep, not a mapping, or
            with anything in it but text, numbers, true, false, lists and mappings of names.
    """
    from ruamel.yaml.error import YAMLError

    try:
        content: object = _loader().load(_read(Path(path)) if text is None else text)
    except _UnsafeError as error:
        raise InvalidInputError(path, *error.told) from None
    except YAMLError as error:
        raise InvalidInputError(path, _yaml_sentence(error), "Correct it there") from None
    except (RecursionError, ValueError):
        problem = "is not valid YAML: it holds a number that is none"
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


class _UnsafeError(Exception):
    """What makes a YAML file grow beyond its text, or too large, and what to do about it."""

    def __init__(
        self, problem: str, remedy: str = "Write the values out, one mapping of names"
    ) -> None:
        self.told = problem, remedy
        super().__init__(problem)


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
                seen = f"holds more than {MOST_EVENTS} keys, values and brackets"
                raise _UnsafeError(seen, "Give a smaller file")
            if self.depth > _DEEPEST:
                raise _UnsafeError(f"is nested more than {_DEEPEST} levels deep")
            if getattr(event, "anchor", None) is not None:
                raise _UnsafeError("contains YAML anchors or aliases (& or *)")
            return event

    loader: Any = YAML(typ="safe", pure=True)
    loader.Parser = CheckedParser
    known = loader.constructor.yaml_constructors  # a date stays as it is written, as in a table
    as_text = {"tag:yaml.org,2002:timestamp": known["tag:yaml.org,2002:str"]}
    loader.constructor.yaml_constructors = known | as_text
    return loader


def _strange_values(value: object, where: str) -> Iterator[str]:
    """What no file of ours holds: bytes, sets, other keys, letters that are not seen."""
    if isinstance(value, dict):
        for key, item in cast("dict[object, object]", value).items():
            if isinstance(key, str):
                yield from _strange_values(key, where or "the file")
                yield from _strange_values(item, f"{where}.{key}" if where else key)
            else:
                yield f"{where or 'the file'} has the key {key!r}, no text: put it in quotes"
    elif isinstance(value, list):
        for item in cast("list[object]", value):
            yield from _strange_values(item, where)
    elif isinstance(value, str) and printable(value) != value:
        yield f"{where}: '{printable(value)[:40]}' holds letters that are not seen"
    elif isinstance(value, int) and value.bit_length() > 64:
        yield f"{where}: an integer of {value.bit_length()} bits"
    elif not isinstance(value, str | int | float | None):
        yield f"{where}: {str(value)[:40]!r} reads as a {type(value).__name__}"


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
        short = not isinstance(items, _Root) and _short(items.values(), items)
        return representer.represent_mapping("tag:yaml.org,2002:map", items, flow_style=short)

    for kind, represent in (
        (float, represent_float),
        (str, represent_str),
        (list, represent_list),
        (dict, represent_dict),
        (_Root, represent_dict),
    ):
        yaml.representer.add_representer(kind, represent)
    stream = StringIO()
    yaml.dump(_Root(content), stream)
    heading = "".join(f"# {line}\n" for line in comment.splitlines())
    return heading + stream.getvalue()


class _Root(dict[str, Any]):
    """The outermost mapping: always one key a line."""


def _short(values: Iterable[Any], keys: Iterable[str] = ()) -> bool:
    """True for a few scalars that fit on one line with their keys."""
    listed = list(values)
    return (
        bool(listed)
        and not any(isinstance(item, list | dict) for item in listed)
        and sum(len(str(item)) + 2 for item in [*listed, *keys]) <= _ONE_LINE
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Replaced:
    """A file that stood where another was written.

    Attributes:
        content: what it held.
        backup: the name under which it is kept.
    """

    content: bytes
    backup: Path


def write_text(path: str | os.PathLike[str], text: str) -> Replaced | None:
    """Write a whole file or nothing; a file that stood there is kept.

    The first backup is ``NAME.bak``, the next ``NAME.bak2``, and so on: none is ever written over.
    A symbolic link is followed: what it points to is replaced, the link stays. Permissions are
    kept, and owner and group as far as the system lets this user give files away. At every moment,
    a loss of power included, the file is whole, old or new. Of two writers at once the last wins.

    Returns:
        What stood there, None if nothing did or nothing changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    return write_bytes(path, text.encode("utf-8"))


def difference_of(path: str | os.PathLike[str], replaced: Replaced, text: str) -> str:
    """The unified diff of a text against what stood in its place, or how long both are."""
    name = Path(path).name
    before = replaced.content.decode("utf-8", errors="replace").splitlines()
    after = text.splitlines()
    if max(len(before), len(after)) > _LONGEST_DIFFERENCE:
        return f"{name} changed: {len(before)} lines before, {len(after)} now"
    return "\n".join(
        difflib.unified_diff(before, after, f"{name} (before)", name, lineterm="", n=1)
    )


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Replaced | None:
    """Write a whole file or nothing, as `write_text` does, and return what stood there if changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    return write_files({Path(path): data}).get(Path(path))


def write_files(contents: Mapping[Path, bytes]) -> dict[Path, Replaced]:
    """Write files that belong together, each as `write_text` does: all of them, or none.

    All are on the disk under passing names, with their backups, before the first gets its own. A
    process of its own gives them their names, so that a kill of this one leaves the old files or
    the new ones. A loss of power in that moment may leave some of each, every one of them whole.

    Returns:
        What stood in the place of each file that did not stand there as it is.

    Raises:
        NotWrittenError: the file that cannot be written, with the system's reason; the old files
            are untouched.
    """
    path, replaced, moves = Path(), dict[Path, Replaced](), list[tuple[Path, Path, Path]]()
    with ExitStack() as passing:
        try:
            for path, data in contents.items():
                target = Path(os.path.realpath(path))
                content, status = _standing(target)
                if content == data:
                    continue
                fresh = passing.enter_context(_name_beside(target))
                _create(fresh, data, like=status)
                moves.append((path, fresh, target))
                if content is not None:
                    replaced[path] = Replaced(content=content, backup=path)
            for path, _, target in moves:
                if path in replaced:
                    replaced[path] = replace(replaced[path], backup=_keep(target))
            _rename_apart([(fresh, target) for _, fresh, target in moves])
            for path, fresh, target in moves:  # noqa: B007 - told where it cannot be written
                if fresh.exists():
                    fresh.replace(target)
        except OSError as error:
            for moved, fresh, target in moves:
                if not fresh.exists():
                    _take_back(target, replaced.get(moved))
            raise NotWrittenError(path, error.strerror or str(error)) from None
    for folder in {target.parent for _, _, target in moves}:
        _sync_folder(folder)
    return replaced


def _rename_apart(moves: list[tuple[Path, Path]]) -> None:
    """Rename several files in a process of its own, as far as there can be one."""
    if len(moves) > 1 and sys.executable:
        import subprocess

        names = [os.fspath(name) for move in moves for name in move]
        with suppress(OSError):
            subprocess.run(  # noqa: S603
                [sys.executable, "-I", "-S", "-c", _RENAME, *names],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                check=False,
            )


def _take_back(target: Path, old: Replaced | None) -> None:
    """Undo a renaming, as far as the system lets it."""
    with suppress(OSError):
        if old is None:
            target.unlink()
        else:
            old.backup.replace(target)


def _standing(target: Path) -> tuple[bytes | None, os.stat_result | None]:
    """Content and status of what stands there; nothing but a regular file may be replaced."""
    try:
        status = target.stat()
    except FileNotFoundError:
        return None, None
    if not stat.S_ISREG(status.st_mode):
        raise OSError(None, "it is a folder or a device, not a file")
    return target.read_bytes(), status


@contextmanager
def _name_beside(target: Path) -> Generator[Path]:
    """A name that nothing has, in the same folder, known before there is a file; none is left."""
    path = target.with_name(f".haptune-{secrets.token_hex(8)}")
    try:
        yield path
    finally:
        with suppress(OSError):  # where nothing may be written there is nothing
            path.unlink(missing_ok=True)


def _create(path: Path, data: bytes, *, like: os.stat_result | None) -> None:
    """Create a file and force it to the disk, with owner and permissions of another."""
    mode = 0o666 if like is None else 0o600  # what others may not read they cannot read meanwhile

    def opened(name: str, flags: int) -> int:
        return os.open(name, flags, mode)

    with open(path, "xb", opener=opened) as stream:
        stream.write(data)
        stream.flush()
        if like is not None:
            if sys.platform != "win32":
                for owner in (like.st_uid, -1):  # owner and group, else the group, else neither
                    with suppress(OSError):
                        os.chown(path, owner, like.st_gid)
                        break
            path.chmod(stat.S_IMODE(like.st_mode))
        os.fsync(stream.fileno())


def _keep(target: Path) -> Path:
    """Give what stands there a further name, the next backup's, and return that name."""
    newest = _newest_backup(target)
    if newest and _backup(target, newest).samefile(target):
        return _backup(target, newest)  # a kill between the two steps left it so
    number = newest + 1
    while True:
        backup = _backup(target, number)
        try:
            try:
                os.link(target, backup)
            except FileExistsError:  # of another writer at the same time
                number += 1
                continue
            except OSError:  # a file system without hard links, or a file of someone else
                with _name_beside(target) as kept:
                    shutil.copy2(target, kept)
                    kept.replace(backup)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OSError(
                error.errno, f"its backup {backup.name} cannot be kept: {reason}"
            ) from None
        return backup


def _backup(target: Path, number: int) -> Path:
    return target.with_name(f"{target.name}.bak{'' if number == 1 else number}")


def _newest_backup(target: Path) -> int:
    """The highest number of a backup that is there, 0 for none; the first has no number."""
    first = f"{target.name}.bak"
    newest = 0
    for name in os.listdir(target.parent):  # noqa: PTH208 - names alone, however many
        number = name.removeprefix(first)
        if name == first:
            newest = max(newest, 1)
        elif number != name and number.isascii() and number.isdecimal():
            newest = max(newest, int(number))
    return newest


def _sync_folder(folder: Path) -> None:
    """Force the new names to the disk, where the system can do that with a folder."""
    if sys.platform != "win32":
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
