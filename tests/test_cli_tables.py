"""Tables lose nothing at the width of a terminal and carry no blanks into a pipe."""

import re
import shutil
from pathlib import Path

import pytest

from datasets_synthetic import bundled_path
from tests.commands import files, form, haptune
from tests.thinned import thinned

#: The second name is wider than its column.
SCENE = (
    "elements: {gate: {damping: 20.0}, the far wall behind the door: {damping: 10.0}}\n"
    "loop: {velocity_filter_hz: 50.0, acceleration_filter_hz: none}\n"
)
GIVEN = {"scene.yaml", "excitation.yaml", "log.csv"}
TABLES = (
    "identify log.csv",
    "tune homerehab scene.yaml --candidates",
    "doctor log.csv",
    "excite excitation.yaml -o force.csv",
)


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("scene.yaml").write_text(SCENE, encoding="utf-8")
    text = form("excitation", "--device", "homerehab").replace("duration: 10.0", "duration: 2.0")
    Path("excitation.yaml").write_text(text, encoding="utf-8")
    shutil.copy(bundled_path("homerehab.csv"), "log.csv")


@pytest.mark.parametrize("arguments", thinned(TABLES, 1))
def test_a_terminal_breaks_no_word_and_a_pipe_gets_no_blanks(arguments: str) -> None:
    wide = haptune(*arguments.split())
    assert wide.code == 0, wide.err
    assert not [line for line in wide.out.splitlines() if line != line.rstrip()]
    for written in files() - GIVEN:
        Path(written).unlink()
    narrow = haptune(*arguments.split(), COLUMNS="80")
    assert sorted(_words(narrow.out)) == sorted(_words(wide.out))


def test_what_a_narrow_terminal_cannot_show_side_by_side_is_said_in_words() -> None:
    narrow = " ".join(haptune("tune", "homerehab", "scene.yaml", COLUMNS="40").out.split())
    assert "- gate damping: value 20 N·s/m, steps " in narrow
    assert narrow.count(", limited by wanted") == 2


def test_no_name_is_cut() -> None:
    """One of forty letters in words, and a compound that cannot be broken between them."""
    names = ("the_wall_beside_the_operating_table_left", "Durchleuchtungstischseitenwanddaempfung")
    elements = f"{{{names[0]}: {{damping: 10.0}}, {names[1]}: {{damping: 20.0}}}}"
    text = f"elements: {elements}\nloop: {{velocity_filter_hz: 50.0}}\n"
    Path("scene.yaml").write_text(text, encoding="utf-8")
    for command in (
        "tune homerehab scene.yaml",
        "compare profile.yaml profile.yaml",
        "verify profile.yaml",
    ):
        ended = haptune(*command.split(), COLUMNS="80")
        assert ended.code == 0, ended.err
        table = ended.out[ended.out.index("─") :].partition("\n\n")[0]
        assert "…" not in table
        assert max(map(len, table.splitlines())) <= 80
        first = "".join(line[2:].partition("   ")[0] for line in table.splitlines())
        for name in names:  # a name that is too wide goes on in the lines below
            assert _letters(name) in _letters(first)
    assert "pushed to 0.2 m/s" in " ".join(ended.out.split())


def _letters(text: str) -> str:
    return re.sub(r"[^a-z]", "", text.lower())


def _words(printed: str) -> list[str]:
    """Words that are whole; rules of tables are as wide as the terminal."""
    return [word for word in printed.split() if set(word) != {"─"}]
