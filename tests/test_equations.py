"""docs/equations.md names every item of the paper, functions that are there and tests that are."""

from __future__ import annotations

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
#: Equations, figures and tables of the paper.
EQUATIONS, FIGURES, TABLES = 43, 8, 3
#: A row: number, what, function, tests, note.
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith("| no.")
]


def test_every_item_of_the_paper_has_one_row_in_order() -> None:
    assert all(len(row) == 5 for row in ROWS)
    numbers = [row[0] for row in ROWS]
    expected = [f"({number})" for number in range(1, EQUATIONS + 1)]
    expected += [f"figure {number}" for number in range(1, FIGURES + 1)]
    expected += [f"table {number}" for number in range(1, TABLES + 1)]
    assert numbers[: len(expected)] == expected
    assert "2.8" in numbers[len(expected) :]


@pytest.mark.parametrize("name", sorted({row[2] for row in ROWS} - {"—"}))
def test_every_function_can_be_imported(name: str) -> None:
    parts = name.strip("`").split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            found = getattr(found, part)
        assert callable(found)
        return
    pytest.fail(f"{name} is nowhere")


@cache
def _tests(file: str) -> set[str]:
    """Names of the tests of a file, those of a class behind the name of the class."""
    names: set[str] = set()
    for node in ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            inside = (each.name for each in node.body if isinstance(each, ast.FunctionDef))
            names |= {f"{node.name}::{name}" for name in inside}
    return names


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_every_test_and_file_is_there(row: list[str]) -> None:
    named = re.findall(r"`(\w+\.py)::([\w:]+)`", row[3])
    assert len(named) == row[3].count("::test_") > 0
    assert all(name in _tests(file) for file, name in named)
    for path in re.findall(r"`([\w/]+\.(?:py|ipynb))`", row[4]):
        assert (ROOT / path).exists()
    if row[2] == "—":
        assert row[4], "what nothing computes needs a note"
