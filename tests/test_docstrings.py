"""Docstrings of what is exported: each reads alone and names the shapes of its arrays."""

import inspect
import re
from importlib import import_module

import pytest

PACKAGES = ("haptune", "identification", "tune", "datasets_synthetic")
EXPORTED = sorted({(p, name) for p in PACKAGES for name in import_module(p).__all__})
#: Openings that need the docstring before them.
LEANING = re.compile(r"(The same|Of|Likewise)\b")
ARRAY = re.compile(r"\w*Array\b|NDArray|ArrayLike")
#: The word, or a shape as it is written: (n,), (points, unknowns), (n - 1,).
SHAPE = re.compile(r"\b[Ss]hapes?\b|\(\w+(?: ?[-+] ?\d)?,(?: ?[\w .+*-]+)*\)")


@pytest.mark.parametrize(("package", "name"), EXPORTED)
def test_an_exported_docstring_reads_alone_and_names_shapes(package: str, name: str) -> None:
    found = getattr(import_module(package), name)
    parts = [found] if callable(found) else []
    if inspect.isclass(found):
        parts += [each for key, each in vars(found).items() if key[0] != "_"]
    for part in parts:
        each = getattr(part, "fget", None) or getattr(part, "__func__", part)
        text = inspect.getdoc(each) or ""
        if not (inspect.isfunction(each) or inspect.isclass(each)):
            continue
        if not getattr(each, "__module__", "").startswith(PACKAGES):
            continue
        assert text, each
        assert not LEANING.match(text), each
        if any(ARRAY.search(str(note)) for note in each.__annotations__.values()):
            assert SHAPE.search(text), each
