"""JSON Schemas of what programs read: results of commands, and profiles exported as JSON."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from tune.documents.results import DETAILS, Result
from tune.exporters.exported import Exported

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def export_schema() -> dict[str, Any]:
    """The schema of haptune/export/1: nothing is allowed that it does not name."""
    schema = TypeAdapter(Exported).json_schema(mode="serialization")
    for each in (schema, *schema["$defs"].values()):
        each["additionalProperties"] = False
    return {"$schema": _DIALECT, **schema, "title": "haptune_profile.json"}


def result_schema() -> dict[str, Any]:
    """The schema of haptune/result/1: details by command, nothing that it does not name."""
    kinds: dict[str, Any] = {"Result": Result} | {each.__name__: each for each in DETAILS.values()}
    adapters = [(name, "serialization", TypeAdapter(kind)) for name, kind in kinds.items()]
    places, whole = TypeAdapter.json_schemas(adapters)  # pyright: ignore[reportArgumentType]
    definitions: dict[str, Any] = whole["$defs"]
    for each in definitions.values():
        if "properties" in each:
            each["additionalProperties"] = False
    place: Any = places["Result", "serialization"]["$ref"]
    result = definitions.pop(place.rpartition("/")[2])
    result["properties"]["command"] = {"enum": list(DETAILS)}
    result["properties"]["details"] = {"type": "object"}
    result["allOf"] = [
        {
            "if": {"properties": {"command": {"const": command}}},
            "then": {"properties": {"details": places[kind.__name__, "serialization"]}},
        }
        for command, kind in DETAILS.items()
    ]
    return {
        "$schema": _DIALECT,
        **result,
        "title": "result of a haptune command",
        "$defs": definitions,
    }
