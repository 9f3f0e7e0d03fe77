"""JSON Schemas of the files, generated from the models that read them.

``python -m tune.schemas`` writes them anew. A schema says all that can be said of one key at a
time; what keys say together (low <= value <= high, known names in ``together``) only the reader
checks.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from identification import Device, Document, ExcitationSpec, Hardware
from tune.documents.perception import PerceptionTable
from tune.documents.profile import SafeProfile
from tune.documents.scene import Scene
from tune.rendering.vibration import ThresholdCurve
from tune.schemas.printed import export_schema, result_schema

FOLDER = Path(__file__).parent

_MODELS: dict[str, type[Document]] = {
    "hardware": Hardware,
    "device": Device,
    "scene": Scene,
    "excitation": ExcitationSpec,
    "perception": PerceptionTable,
    "vibration": ThresholdCurve,
    "profile": SafeProfile,
}


def generate() -> dict[str, str]:
    """Text of every schema by file name."""
    texts: dict[str, str] = {}
    for name, model in _MODELS.items():
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            **model.model_json_schema(by_alias=True),
            "title": f"haptune {name}.yaml",
        }
        texts[f"{name}.json"] = _text(schema)
    texts["export.json"] = _text(export_schema())
    texts["result.json"] = _text(result_schema())
    return texts


def _text(schema: dict[str, Any]) -> str:
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
