"""Docstrings that read alone: no opening that leans on a neighbour, shapes where arrays go."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("identification", "tune", "datasets_synthetic")
#: Openings that need the docstring before them.
LEANING = re.compile(r"(The same|Of|Likewise)\b")
ARRAY = re.compile(r"\w*Array\b|NDArray|ArrayLike")
#: The word, or a shape as it is written: (n,), (points, unknowns), (n - 1,).
SHAPE = re.compile(r"\bshapes?\b|\(\w+(?: ?[-+] ?\d)?,(?: ?[\w .+*-]+)*\)")
Documented = ast.FunctionDef | ast.ClassDef | ast.Module


def leaning(tree: ast.Module) -> Iterator[str]:
    """Docstrings that do not read alone."""
    for node in ast.walk(tree):
        if isinstance(node, Documented):
            text = ast.get_docstring(node) or ""
            if LEANING.match(text):
                yield f"{getattr(node, 'name', 'module')}: {text.splitlines()[0]}"


def without_shape(tree: ast.Module) -> Iterator[str]:
    """Public functions that take or give arrays and do not say of which shape."""
    for node in tree.body:
        if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
            continue
        if any(ast.unparse(each) == "overload" for each in node.decorator_list):
            continue
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        notes = [each.annotation for each in arguments] + [node.returns]
        arrays = any(ARRAY.search(ast.unparse(note)) for note in notes if note is not None)
        if arrays and not SHAPE.search(ast.get_docstring(node) or ""):
            yield node.name


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Each file of the packages, parsed."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


TREES = tuple(trees())


def test_no_docstring_leans_on_another() -> None:
    assert [f"{path} {each}" for path, tree in TREES for each in leaning(tree)] == []


def test_public_functions_name_the_shapes_of_their_arrays() -> None:
    counted = [(path, name) for path, tree in TREES for name in without_shape(tree)]
    assert counted == []


@pytest.mark.parametrize("opening", ["The same with other terms.", "Of both.", "Likewise."])
def test_a_planted_opening_is_found(opening: str) -> None:
    planted = f'class Planted:\n    def method(self) -> None:\n        """{opening}"""\n'
    assert list(leaning(ast.parse(planted))) == [f"method: {opening}"]


def test_a_planted_function_without_a_shape_is_found() -> None:
    planted = (
        'def bare(column: FloatArray) -> float:\n    """Mean of a column, N."""\n'
        'def told(column: FloatArray) -> float:\n    """Mean of a column, N, shape (n,)."""\n'
        'def drawn(column: FloatArray) -> float:\n    """Mean of a column (n - 1,), N."""\n'
        'def _own(column: FloatArray) -> float:\n    """Mean of a column, N."""\n'
        'def plain(number: float) -> float:\n    """A number, doubled."""\n'
    )
    assert list(without_shape(ast.parse(planted))) == ["bare"]
