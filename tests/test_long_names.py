"""Elements with names of forty letters: no table cuts them, or what stands beside them."""

import re
from pathlib import Path

import pytest

from tests.commands import haptune

#: A key in words, and a compound that cannot be broken between them.
NAMES = ("the_wall_beside_the_operating_table_left", "Durchleuchtungstischseitenwanddaempfung")
SCENE = f"elements:\n  {NAMES[0]}: {{damping: 10.0}}\n  {NAMES[1]}: {{damping: 20.0}}\n"


def _letters(text: str) -> str:
    return re.sub(r"[^a-z]", "", text.lower())


@pytest.mark.parametrize("columns", ["80", "120"])
def test_no_name_is_cut(columns: str, here: Path) -> None:
    Path("scene.yaml").write_text(SCENE, encoding="utf-8")
    tuned = haptune("tune", "homerehab", "scene.yaml", COLUMNS=columns)
    compared = haptune("compare", "profile.yaml", "profile.yaml", COLUMNS=columns)
    planned = haptune("verify", "profile.yaml", COLUMNS=columns)
    for ended in (tuned, compared, planned):
        assert ended.code == 0, ended.err
        table = ended.out[ended.out.index("─") :].partition("\n\n")[0]
        assert "…" not in table
        assert max(map(len, table.splitlines())) <= int(columns)
        first = [line[2:].partition("   ")[0] for line in table.splitlines()]
        for name in NAMES:  # a name that is too wide goes on in the lines below
            assert _letters(name) in _letters("".join(first))
    assert "pushed to 0.2 m/s" in " ".join(planned.out.split())
