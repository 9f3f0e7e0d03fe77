"""JSON Schemas of the files, generated from the models that read them.

``python -m tune.schemas`` writes them anew. A schema says all that can be said of one key at a
time; what keys say together (low <= value <= high, known names in ``together``) only the reader
checks. Those of what programs read, exports and results, come from typed dictionaries.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from identification import Device, Document, ExcitationSpec, Hardware
from tune.documents.manifest import Manifest
from tune.documents.perception import PerceptionTable
from tune.documents.profile import SafeProfile
from tune.documents.results import DETAILS, Result
from tune.documents.scene import Scene
from tune.exporters import Exported

_DIALECT = "https://json-schema.org/draft/2020-12/schema"

_MODELS: dict[str, type[Document]] = {
    "hardware": Hardware,
    "device": Device,
    "scene": Scene,
    "manifest": Manifest,
    "excitation": ExcitationSpec,
    "perception": PerceptionTable,
    "profile": SafeProfile,
}


def generate() -> dict[str, str]:
    """Text of every schema by file name."""
    schemas: dict[str, dict[str, Any]] = {
        name: model.model_json_schema(by_alias=True) | {"title": f"haptune {name}.yaml"}
        for name, model in _MODELS.items()
    }
    schemas |= {"export": _export_schema(), "result": _result_schema()}
    return {
        f"{name}.json": json.dumps({"$schema": _DIALECT, **each}, indent=2, ensure_ascii=False)
        + "\n"
        for name, each in schemas.items()
    }


def _export_schema() -> dict[str, Any]:
    """The schema of haptune/export/1: nothing is allowed that it does not name."""
    schema = TypeAdapter(Exported).json_schema(mode="serialization")
    for each in (schema, *schema["$defs"].values()):
        each["additionalProperties"] = False
    return schema | {"title": "haptune_profile.json"}


def _result_schema() -> dict[str, Any]:
    """The schema of haptune/result/1: details by command, nothing that it does not name."""
    kinds: dict[str, Any] = {"Result": Result} | {each.__name__: each for each in DETAILS.values()}
    adapters = [(name, "serialization", TypeAdapter(kind)) for name, kind in kinds.items()]
    places, schema = TypeAdapter.json_schemas(adapters)  # pyright: ignore[reportArgumentType]
    definitions: dict[str, Any] = schema["$defs"]
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
    return {**result, "title": "result of a haptune command", "$defs": definitions}


if __name__ == "__main__":
    for name, text in generate().items():
        (Path(__file__).parent / name).write_text(text, encoding="utf-8", newline="\n")
