"""The glossary is whole: every word has its files, and they have the word."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: Folders of methods. Others are in the table of docs/architecture.md.
METHODS = (
    "identification/estimators",
    "identification/fitting",
    "identification/structure",
    "identification/planning",
    "identification/findings",
    "tune/loop",
    "tune/stability",
    "tune/margins",
    "tune/rendering",
    "tune/optimisation",
    "tune/optimisation/backends",
    "tune/certificate",
    "tune/verification",
    "datasets_synthetic",
)
PACKAGES = ("identification", "tune", "datasets_synthetic")


def glossary(text: str) -> dict[str, tuple[str, list[str]]]:
    """Meaning and files of each word."""
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (`.+`) \|$", text, re.MULTILINE)
    return {word: (meaning, re.findall(r"`([^`]+)`", files)) for word, meaning, files in rows}


def plain(text: str) -> str:
    """Lower case, words parted by one blank, however they are joined in code or prose."""
    return re.sub(r"[\s_-]+", " ", text.lower())


def complaints(text: str) -> list[str]:
    """What is wrong with a glossary: words without a file, out of order or twice."""
    words = glossary(text)
    named = {file for _, files in words.values() for file in files}
    found = [f"{file} is not there" for file in sorted(named) if not (ROOT / file).is_file()]
    for word, (_, files) in words.items():
        texts = [(ROOT / file).read_text("utf-8") for file in files if (ROOT / file).is_file()]
        if not any(plain(word) in plain(each) for each in texts):
            found.append(f"no file of {word} has the word")
    ordered = sorted(words, key=plain)
    if list(words) != ordered:
        found.append("words are not in alphabetical order")
    if text.count("\n| ") != len(words) + 1:
        found.append("a word stands twice, or a row has no file")
    return found


TEXT = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def test_the_glossary_is_whole() -> None:
    assert len(glossary(TEXT)) > 80
    assert complaints(TEXT) == []


def test_every_other_folder_is_in_the_plan() -> None:
    """A folder or a file at the top of a package is a method's, or the architecture names it."""
    plan = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    for package in PACKAGES:
        for path in (ROOT / package).iterdir():
            place = path.relative_to(ROOT).as_posix()
            code = path.suffix == ".py" or (path.is_dir() and any(path.glob("*.py")))
            if code and path.stem != "__init__" and not place.startswith(METHODS):
                room = f"`{path.stem}`"
                assert place in plan or room in plan, place


@pytest.mark.parametrize(
    ("planted", "complaint"),
    [
        (("`tune/certificate/affine.py`", "`tune/certificate/gone.py`"), "gone.py is not there"),
        (("| Hausman's test |", "| Hausman's riddle |"), "no file of Hausman's riddle"),
        (("| absolute stability |", "| zzz |"), "alphabetical"),
    ],
)
def test_a_planted_fault_is_found(planted: tuple[str, str], complaint: str) -> None:
    assert planted[0] in TEXT
    assert any(complaint in each for each in complaints(TEXT.replace(*planted)))
