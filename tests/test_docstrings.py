"""Docstrings that read alone: no opening that leans on a neighbour, shapes where arrays go."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.docstrings import (
    TREES,
    above_entries,
    annotated,
    arguments_of,
    entries,
    public_classes,
    public_functions,
)

#: Openings that need the docstring before them.
LEANING = re.compile(r"(The same|Of|Likewise)\b")
ARRAY = re.compile(r"\w*Array\b|NDArray|ArrayLike")
#: The word, or a shape as it is written: (n,), (points, unknowns), (n - 1,).
SHAPE = re.compile(r"\b[Ss]hapes?\b|\(\w+(?: ?[-+] ?\d)?,(?: ?[\w .+*-]+)*\)")
Documented = ast.FunctionDef | ast.ClassDef | ast.Module


def leaning(tree: ast.Module) -> Iterator[str]:
    """Docstrings that do not read alone."""
    for node in ast.walk(tree):
        if isinstance(node, Documented):
            text = ast.get_docstring(node) or ""
            if LEANING.match(text):
                yield f"{getattr(node, 'name', 'module')}: {text.splitlines()[0]}"


def without_shape(tree: ast.Module) -> Iterator[str]:
    """Public functions and methods that take or give arrays and do not say of which shape."""
    for name, node in public_functions(tree):
        notes = [each.annotation for each in arguments_of(node)] + [node.returns]
        arrays = any(ARRAY.search(ast.unparse(note)) for note in notes if note is not None)
        if arrays and not SHAPE.search(ast.get_docstring(node) or ""):
            yield name


def attributes_without_shape(tree: ast.Module) -> Iterator[str]:
    """Public attributes that hold arrays of which neither their entry nor what stands above the
    class's list of attributes gives a shape."""
    for owner in public_classes(tree):
        text = ast.get_docstring(owner) or ""
        said, above = entries(text), above_entries(text)
        for name, annotation in annotated(owner):
            if ARRAY.search(annotation) and not SHAPE.search(said.get(name, "") + above):
                yield f"{owner.name}.{name}"


def test_no_docstring_leans_on_another() -> None:
    assert [f"{path} {each}" for path, tree in TREES for each in leaning(tree)] == []


def test_public_functions_name_the_shapes_of_their_arrays() -> None:
    counted = [(path, name) for path, tree in TREES for name in without_shape(tree)]
    assert counted == []


def test_public_classes_name_the_shapes_of_their_arrays() -> None:
    counted = [(path, name) for path, tree in TREES for name in attributes_without_shape(tree)]
    assert counted == []


@pytest.mark.parametrize("opening", ["The same with other terms.", "Of both.", "Likewise."])
def test_a_planted_opening_is_found(opening: str) -> None:
    planted = f'class Planted:\n    def method(self) -> None:\n        """{opening}"""\n'
    assert list(leaning(ast.parse(planted))) == [f"method: {opening}"]
