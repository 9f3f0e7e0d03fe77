"""The glossary has every word once, in alphabetical order, with its meaning."""

import re
from pathlib import Path

TEXT = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")


def test_the_glossary_has_every_word_once_in_order() -> None:
    words = re.findall(r"^\| (?!word )(.+?) \| .+ \|$", TEXT, re.MULTILINE)
    assert len(words) > 40
    assert TEXT.count("\n| ") == len(words) + 1
    assert words == sorted(set(words), key=lambda word: re.sub(r"[\s_-]+", " ", word.lower()))
