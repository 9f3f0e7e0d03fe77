"""What is written reads back alike with readers of YAML 1.2 and 1.1, whatever things are named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from identification import InvalidInputError, load_mapping, to_yaml

WORDS = "wall water cup rubber feather honey sponge door lever knob stone spring".split()  # noqa: SIM905
#: What some reader takes for no text, for a mark, or for the end of a line.
NASTY = (
    *("yes", "no", "on", "Off", "y", "N", "~", "null", "true", "=", "<<", "---", "...", ""),
    *("1e3", "1_000", "0777", "0o17", "0x1f", "12:30:45", "1.0", ".5", "-.inf", "2020-01-01"),
    *("- a", "-a", "a: b", "a:b", "a #b", "#a", "a, b", "[a]", "{a}", "'", '"', "a'b", "`a", "@a"),
    *("%a", "!a", "&a", "*a", "|", "> a", "? a", "a?", ": a", ":a", "a:", "a\\b", "a  b", " a "),
    *("é ü", "日本 語", "😀", "a + b", "a\nb"),
)
#: What nobody sees, and what would steer a terminal.
HIDDEN = ("\u200b", "\ufeffx", "\x85", "\u2028", "\t", "\x7f")


def read_back(content: dict[str, Any], folder: Path) -> str:
    """The text of a mapping, after both readers found in it what was written."""
    text = to_yaml(content)
    path = folder / "file.yaml"
    path.write_bytes(text.encode())
    assert load_mapping(path) == content, text
    assert yaml.safe_load(text) == content, text
    return text


@pytest.mark.parametrize("name", [*NASTY, "x" * 200, "long " * 40], ids=ascii)
def test_a_nasty_name_reads_back_wherever_it_stands(tmp_path: Path, name: str) -> None:
    values: tuple[Any, ...] = (
        name,
        [name, name],
        {name: 1.0},
        {name: name},
        {name: {name: [name]}},
    )
    read_back({f"value {at}": value for at, value in enumerate(values)}, tmp_path)


@pytest.mark.parametrize("name", HIDDEN, ids=ascii)
def test_a_name_with_letters_that_are_not_seen_is_written_alike_and_refused(
    tmp_path: Path, name: str
) -> None:
    content = {"value": {name: [name]}}
    assert yaml.safe_load(to_yaml(content)) == content
    with pytest.raises(InvalidInputError, match="holds letters that are not seen"):
        read_back(content, tmp_path)


_NAMES = (
    st.sampled_from(NASTY)
    | st.text(st.characters(codec="utf-8").filter(str.isprintable), max_size=150)
    | st.lists(st.sampled_from((*NASTY, *WORDS)), min_size=1, max_size=5).map(" + ".join)
)


@settings(deadline=None)
@given(
    st.dictionaries(
        _NAMES,
        _NAMES
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.lists(_NAMES, max_size=4)
        | st.dictionaries(_NAMES, _NAMES, max_size=3),
        max_size=4,
    )
)
def test_random_names_read_back(
    tmp_path_factory: pytest.TempPathFactory, value: dict[str, Any]
) -> None:
    read_back({"value": value}, tmp_path_factory.mktemp("yaml"))
