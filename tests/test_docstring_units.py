"""Docstrings that give units: physical quantities among arguments and attributes name theirs."""

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


@pytest.mark.parametrize(
    ("entry", "found"),
    [
        ("mass: m of the device.", True),
        ("mass: m, kg.", False),
        ("speed: reached at last, m.", True),
        ("speed: reached at last, m/s.", False),
        ("sample_time: T.", True),
        ("sample_time: T, s.", False),
        ("velocity_filter_hz: cut-off of\n            the low-pass.", True),
        ("velocity_filter_hz: cut-off of\n            the low-pass, Hz.", False),
        ("damping: part of the critical one.", False),
        ("name: of the axis.", False),
    ],
)
@pytest.mark.parametrize("section", ["Args", "Attributes"])
def test_a_planted_entry_without_a_unit_is_found(entry: str, found: bool, section: str) -> None:
    name = entry.split(":", maxsplit=1)[0]
    text = f'"""Planted.\n\n    {section}:\n        {entry}\n    """\n'
    planted = (
        f"def planted({name}: float) -> None:\n    {text}"
        if section == "Args"
        else f"class Planted:\n    {text}    {name}: float\n"
    )
    expected = [f"{'planted' if section == 'Args' else 'Planted'} {name}"] if found else []
    assert list(without_unit(ast.parse(planted))) == expected
