"""Every key that a profile can hold, from its JSON Schema, and what a forger may write there."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from tests.commands import digest_of
from tune import SafeProfile

Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One key of a profile."""

    path: Path
    value: Any
    schema: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(str(part) for part in self.path)


@functools.cache
def _schema() -> dict[str, Any]:
    return SafeProfile.model_json_schema(by_alias=True)


def _branches(schema: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The ways in which a schema can be met, references followed."""
    if "$ref" in schema:
        return _branches(_schema()["$defs"][schema["$ref"].rpartition("/")[2]])
    each = schema.get("anyOf")
    return [found for one in each for found in _branches(one)] if each else [dict(schema)]


def fields(
    content: Any, schema: Mapping[str, Any] | None = None, path: Path = ()
) -> Iterator[Field]:
    """Every key of a profile, those that its schema allows and the file leaves out among them."""
    branches = _branches(_schema() if schema is None else schema)
    if path:
        yield Field(path=path, value=content, schema=schema or {})
    if isinstance(content, dict):
        whole = next((b for b in branches if b.get("type") == "object"), {})
        known: dict[str, Any] = whole.get("properties", {})
        other = whole.get("additionalProperties") or {}
        for name in dict.fromkeys((*known, *content)):
            yield from fields(content.get(name), known.get(name, other), (*path, name))
    elif isinstance(content, list):
        items = next((b.get("items", {}) for b in branches if b.get("type") == "array"), {})
        for place, item in enumerate(content[:2]):
            yield from fields(item, items, (*path, place))


#: What stands for nothing when it is taken away.
GONE = "taken away"


def forgeries(field: Field) -> list[Any]:
    """Values that a forger may write in the place of what a profile says."""
    value = field.value
    found: list[Any] = [] if value is None else [GONE]
    words = [word for b in _branches(field.schema) for word in (b.get("enum") or [])]
    if value is None:
        examples = {"number": 1.0, "integer": 1, "string": "forged", "array": [], "object": {}}
        types = [b.get("type") for b in _branches(field.schema)]
        found += [examples[kind] for kind in types if kind in examples] + words[:1]
    elif isinstance(value, bool):
        found += [not value]
    elif isinstance(value, int | float):
        changed = value + 1 if isinstance(value, int) else value * 1.05 or 1.0
        found += [changed, value * 0.95 or -1.0, -value, value * 1e8 or 1e8]
    elif isinstance(value, str):
        found += [value + " forged", "", *words]
    elif isinstance(value, list):
        found += [[], [*value, *value[:1]], value[:-1]]
        if not any(isinstance(each, float) for each in value):  # numbers may be alike
            found.append(value[::-1])
    else:
        first = next(iter(value), "")
        found += [{}, {**value, "forged": value.get(first, 1.0)}]
    return [each for each in found if each is GONE or each != value]


def forged(content: Mapping[str, Any], field: Field, value: Any) -> dict[str, Any]:
    """A profile with one key changed and the digest that belongs to it."""
    changed: Any = copy.deepcopy(dict(content))
    place: Any = changed
    for key in field.path[:-1]:
        place = place[key]
    if value is GONE:
        del place[field.path[-1]]
    else:
        place[field.path[-1]] = value
    if field.path != ("digest",):
        changed["digest"] = digest_of(changed)
    return changed
