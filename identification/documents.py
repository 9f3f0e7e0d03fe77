"""YAML files in and out: hostile input refused in a sentence, output whole or not at all."""

from __future__ import annotations

import difflib
import os
import tempfile
from collections.abc import Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from identification.errors import InvalidInputError, NotWrittenError

#: No device, scene or profile comes near this; a larger file is a mistake or an attack.
LARGEST_FILE = 4_000_000

#: Significant digits of every number in a file. Fifteen decimal digits tell any two apart, so a
#: changed digit always changes the number; nothing measured here is known to more than twelve.
DIGITS = 12

Model = TypeVar("Model", bound="Document")


class Document(BaseModel):
    """Base of everything stored in YAML: frozen, no unknown keys, numbers finite."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True
    )


def load_mapping(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file, read without executing, aliasing or duplicating anything.

    Raises:
        InvalidInputError: unreadable, too large, not UTF-8, not YAML, or not a mapping.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InvalidInputError(
                path, f"{path.stat().st_size} bytes, more than {LARGEST_FILE}", "Give a smaller file"
            )
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        problem = f"cannot be read ({error.strerror or error})"
        raise InvalidInputError(path, problem, "Check the name and the permissions") from None
    except UnicodeDecodeError as error:
        problem = f"byte {error.start} is not UTF-8 text"
        raise InvalidInputError(path, problem, "Give a YAML text file") from None
    try:
        yaml = YAML(typ="safe", pure=True)
        if any(getattr(event, "anchor", None) is not None for event in yaml.parse(text)):
            problem = "contains YAML anchors or aliases (& or *)"
            raise InvalidInputError(path, problem, "Write the values out")
        content: object = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        problem = "is not valid YAML: " + " ".join(str(error).split())[:300]
        raise InvalidInputError(path, problem, "Correct it at the line named") from None
    except (RecursionError, ValueError) as error:
        problem = f"is not valid YAML ({type(error).__name__}: {str(error)[:100]})"
        raise InvalidInputError(path, problem, "Simplify or correct the file") from None
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        problem = "does not hold a mapping of names to values"
        raise InvalidInputError(path, problem, "See 'haptune new' for templates")
    return content


def parse_document(model: type[Model], content: Mapping[str, Any], source: str | Path) -> Model:
    """Validate a mapping against a model, turning every complaint into a sentence.

    Raises:
        InvalidInputError: naming each key, the value seen and what is allowed.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problems = "; ".join(_sentence(dict(item)) for item in error.errors(include_url=False))
        raise InvalidInputError(
            source, problems, "Correct the keys named; 'haptune new' prints commented templates"
        ) from None


def _sentence(item: dict[str, Any]) -> str:
    where = ".".join(str(part) for part in item["loc"] if not str(part).startswith("function-"))
    seen = repr(item["input"])
    message = str(item["msg"]).removeprefix("Value error, ")
    return f"{where or 'file'}: {message} (seen: {seen[:80]})"


def load_document(model: type[Model], path: Path) -> Model:
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
    """YAML text whose floats YAML 1.1 and ROS 2 readers also see as floats (no bare 1e-3)."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 100

    def represent_float(representer: Any, value: float) -> Any:
        text = repr(value)
        if "e" in text and "." not in text:
            text = text.replace("e", ".0e")
        return representer.represent_scalar("tag:yaml.org,2002:float", text)

    def represent_list(representer: Any, items: list[Any]) -> Any:
        return representer.represent_sequence(
            "tag:yaml.org,2002:seq", items, flow_style=_short(items)
        )

    def represent_dict(representer: Any, items: dict[str, Any]) -> Any:
        return representer.represent_mapping(
            "tag:yaml.org,2002:map", items, flow_style=_short(items.values())
        )

    def represent_root(representer: Any, items: _Root) -> Any:
        return representer.represent_mapping("tag:yaml.org,2002:map", items, flow_style=False)

    yaml.representer.add_representer(float, represent_float)
    yaml.representer.add_representer(list, represent_list)
    yaml.representer.add_representer(dict, represent_dict)
    yaml.representer.add_representer(_Root, represent_root)
    stream = StringIO()
    yaml.dump(_Root(content), stream)
    heading = "".join(f"# {line}\n" for line in comment.splitlines())
    return heading + stream.getvalue()


class _Root(dict[str, Any]):
    """The outermost mapping: always one key a line."""


#: Characters of a collection that still goes on one line, keys and punctuation aside.
_ONE_LINE = 60


def _short(items: Iterable[Any]) -> bool:
    """True for a few scalars that fit on one line."""
    listed = list(items)
    return (
        bool(listed)
        and not any(isinstance(item, list | dict) for item in listed)
        and sum(len(str(item)) for item in listed) <= _ONE_LINE
    )


def write_text(path: Path, text: str) -> str:
    """Write a whole file or nothing; a file that stood there is kept as ``NAME.bak``.

    Returns:
        A unified diff against what stood there, "" if nothing did or nothing changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    temporary = ""
    try:
        old = path.read_text(encoding="utf-8", errors="replace") if path.exists() else None
        if old == text:
            return ""
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).chmod(0o666 & ~_umask())
        if old is not None:
            backup = path.with_name(path.name + ".bak")
            backup.unlink(missing_ok=True)
            os.link(path, backup)
        Path(temporary).replace(path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise NotWrittenError(path, error.strerror or str(error)) from None
    if old is None:
        return ""
    lines = difflib.unified_diff(
        old.splitlines(), text.splitlines(), f"{path.name} (before)", path.name, lineterm="", n=1
    )
    return "\n".join(lines)


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
