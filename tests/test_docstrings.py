"""Docstrings of what is exported: each reads alone, with the shapes and units of its numbers."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import haptune

ROOT = Path(__file__).parents[1]
PACKAGES = ("identification", "tune", "datasets_synthetic")
EXPORTED = {*haptune.__all__, *(n for package in PACKAGES for n in import_module(package).__all__)}


def public_classes(tree: ast.Module) -> Iterator[ast.ClassDef]:
    """Those whose names some package exports."""
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


#: Annotations of numbers.
NUMBER = re.compile(r"\bfloat\b|Array\b|ArrayLike|\bQuantity\b|\bInterval\b|\bCutoff\b")
#: Last words of the names of quantities, and the units one of which the entry has to name. A
#: force may be per unit mass, friction over stiffness a length.
UNITS = {
    r"mass|masses": r"kg",
    r"damping": r"N·s/m",
    r"stiffness|stiffnesses": r"N/m|1/s²",
    r"frequency|frequencies|cut_?offs?|hz|corner": r"Hz",
    r"rate": r"1/s|Hz",
    r"speeds?|velocity|velocities": r"m/s",
    r"acceleration|accelerations": r"m/s²",
    r"depth_at_\w+": r"m",
    r"force_step|forces?|push|pull": r"N|m/s²",
    r"friction": r"N|m",
    r"positions?|displacement|travel|penetration|depth|amplitude": r"m|counts?",
    r"time|times|delays?|duration|lag|span|step|period|age|stamps": r"s|samples?",
    r"mass_deviation|deviation|noise|rms|ripple|tremor|reach": r"s|m|m/s|m/s²|N|Hz|kg",
    r"energy": r"J",
    r"angle": r"rad",
}
#: What has no unit of its own, and says so.
OTHER = re.compile(
    r"\b(?:no unit|without unit|in the units?|parts? of|fraction|perceived|0 to 1|sample times?"
    r"|squares of a sample time|in 1/T²?|in T²/m)(?!\w)"
)


def without_unit(tree: ast.Module) -> Iterator[str]:
    """Entries of numbers named after a physical quantity that give no unit of it.

    A unit above the list, such as "SI units", holds for the attributes of a class.
    """
    for name, node in public_functions(tree):
        annotations = {
            each.arg: ast.unparse(each.annotation)
            for each in arguments_of(node)
            if each.annotation is not None
        }
        yield from _missing(name, entries(ast.get_docstring(node) or ""), annotations)
    for owner in public_classes(tree):
        text = ast.get_docstring(owner) or ""
        if not re.search(r"\bSI\b|\bunits\b", above_entries(text)):
            yield from _missing(owner.name, entries(text), dict(annotated(owner)))


def _missing(owner: str, said: dict[str, str], annotations: dict[str, str]) -> Iterator[str]:
    for name, text in said.items():
        if not NUMBER.search(annotations.get(name, "")) or OTHER.search(text):
            continue
        units = next((u for n, u in UNITS.items() if re.fullmatch(rf"(?:\w+_)?(?:{n})", name)), "")
        if units and not re.search(rf"(?<![\w/·])(?:{units})(?![\w/·²³])", text):
            yield f"{owner} {name}"


def test_physical_quantities_name_their_units() -> None:
    counted = [(path, each) for path, tree in TREES for each in without_unit(tree)]
    assert counted == []
