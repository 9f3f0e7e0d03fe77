"""Documents: what stands in YAML files, validated, every complaint a sentence."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from inspect import Parameter, Signature
from os import PathLike
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from identification.documents.yaml_reading import load_mapping
from identification.errors import InvalidInputError

#: Complaints listed about one file; the rest is counted.
MOST_PROBLEMS = 8

#: Significant digits of every number in a file. Fifteen decimal digits tell any two apart, so a
#: changed digit always changes the number; nothing measured here is known to more than twelve.
DIGITS = 12

Model = TypeVar("Model", bound="Document")


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
            if item["type"] != "literal_error" or isinstance(item["input"], str | None)
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
    if item["input"] is None:
        return f"{where}: is blank; fill it in ({message.removeprefix('Value error, ')})"
    return f"{where or 'file'}: {message.removeprefix('Value error, ')} (seen: {seen[:80]})"


def load_document(model: type[Model], path: str | PathLike[str]) -> Model:
    """Read and validate one YAML file. Raises InvalidInputError."""
    return parse_document(model, load_mapping(path), path)


def round_to_digits(number: float, digits: int = DIGITS) -> float:
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
    """The document as plain YAML types, numbers rounded to DIGITS, absent keys left out."""
    content = document.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {key: _round_all(value) for key, value in content.items()}


def as_stored(document: Model) -> Model:
    """The document as it will read back from its file: certify this, not the unrounded one."""
    return type(document).model_validate(to_mapping(document))
