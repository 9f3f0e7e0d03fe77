"""The packages' exported functions and classes, parsed, and what their docstrings list."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import haptune

ROOT = Path(__file__).parents[1]
PACKAGES = ("identification", "tune", "datasets_synthetic")
#: Names of tests that plant a fault.
PLANTED = {"planted", "Planted"}
EXPORTED = PLANTED.union(haptune.__all__, *(import_module(package).__all__ for package in PACKAGES))


def public_classes(tree: ast.Module) -> Iterator[ast.ClassDef]:
    """Those whose names some package exports, or that are planted by a test."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and node.name in EXPORTED:
            yield node


def public_functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions of the module, and methods and properties of its public classes, by name."""
    owners = [("", tree.body), *((f"{each.name}.", each.body) for each in public_classes(tree))]
    for owner, body in owners:
        for node in body:
            if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
                continue
            if not owner and node.name not in EXPORTED:
                continue
            if any(ast.unparse(each) == "overload" for each in node.decorator_list):
                continue
            yield owner + node.name, node


def arguments_of(node: ast.FunctionDef) -> tuple[ast.arg, ...]:
    """Every named argument of a function."""
    return (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)


def annotated(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    """Public attributes of a class with their annotations, as written."""
    for each in node.body:
        if not isinstance(each, ast.AnnAssign) or not isinstance(each.target, ast.Name):
            continue
        if not each.target.id.startswith("_"):
            yield each.target.id, ast.unparse(each.annotation)


def above_entries(text: str) -> str:
    """What a docstring says before it lists arguments or attributes."""
    return re.split(r"^(?:Attributes|Args):$", text, flags=re.MULTILINE)[0]


def entries(text: str) -> dict[str, str]:
    """What a docstring says of each argument or attribute that it lists."""
    found: dict[str, str] = {}
    inside, name = False, ""
    for line in text.splitlines():
        if line and not line.startswith(" "):
            inside = line in {"Args:", "Attributes:"}
        elif inside and (entry := re.match(r" {4}(\w+): (.*)", line)):
            name, found[entry[1]] = entry[1], entry[2]
        elif inside and name:
            found[name] += " " + line.strip()
    return found


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Each file of the packages, parsed."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


TREES = tuple(trees())
