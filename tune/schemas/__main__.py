"""``python -m tune.schemas``: write the JSON Schemas anew."""

from __future__ import annotations

from tune.schemas import FOLDER, generate

for name, text in generate().items():
    (FOLDER / name).write_text(text, encoding="utf-8", newline="\n")
