"""The picture of the architecture and the tables beside it show the imports as they are."""

from __future__ import annotations

import re

from tests.architecture_picture import DOCS, shown_graphs, table
from tests.test_architecture import floors


def test_the_picture_is_of_these_imports() -> None:
    """If not: ``python -m tests.architecture_picture`` draws it anew."""
    assert (DOCS / "architecture.csv").read_text(encoding="utf-8") == table(shown_graphs())


def test_every_room_is_in_the_picture() -> None:
    picture = (DOCS / "architecture.svg").read_text(encoding="utf-8")
    for rooms in shown_graphs().values():
        assert [room for room in rooms if f">{room}<" not in picture] == []


def test_the_tables_have_every_room_on_its_floor() -> None:
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    for package, rooms in shown_graphs().items():
        (section,) = re.findall(rf"## The rooms of `{package}`\n(.*?)(?=\n## |\Z)", text, re.DOTALL)
        rows = re.findall(r"^\| (\d+) \| (`.+?`) \|", section, re.MULTILINE)
        told = {room: int(floor) for floor, names in rows for room in re.findall(r"`(.+?)`", names)}
        assert told == floors(rooms)
