"""YAML in and out: hostile files, nasty names, whole files or nothing."""

import re
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from identification import (
    Device,
    Hardware,
    InvalidInputError,
    NotWrittenError,
    as_stored,
    load_document,
    load_mapping,
    parse_document,
    quantity,
    round_to_digits,
    to_mapping,
    to_yaml,
    write_bytes,
    write_text,
)
from tests.commands import haptune

#: What YAML 1.1 readers take for a float (yaml.org/type/float.html), decimal forms.
FLOAT_1_1 = re.compile(r"[-+]?([0-9][0-9_]*)\.[0-9_]*([eE][-+][0-9]+)?")


def test_reads_plain_mappings(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    text = "\ufeffname: a\nnumber: 1.0e-3\nflag: true\nnothing: null\nlist: [1, {b: 2.5}]\n"
    path.write_text(text, encoding="utf-8")
    assert load_mapping(path) == {
        "name": "a",
        "number": 1e-3,
        "flag": True,
        "nothing": None,
        "list": [1, {"b": 2.5}],
    }


def test_the_wrong_kind_of_file_is_said_first() -> None:
    with pytest.raises(InvalidInputError, match=r"haptune/scene/1.*haptune/hardware/1"):
        parse_document(Hardware, {"schema": "haptune/scene/1", "elements": {}}, "x.yaml")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_rounding_is_idempotent_and_close(number: float) -> None:
    once = round_to_digits(number)
    assert round_to_digits(once) == once
    assert once == pytest.approx(number, rel=1e-11, abs=5e-324)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_read_as_floats_in_every_dialect(number: float) -> None:
    text = to_yaml({"a": number}).removeprefix("a:").strip()
    assert FLOAT_1_1.fullmatch(text)
    assert float(text) == number


def test_a_stored_document_is_a_fixed_point(tmp_path: Path) -> None:
    device = Device(
        sample_time=quantity(1e-3),
        mass=quantity(1 / 3, 0.333, 0.3334),
        damping=quantity(2 / 3),
        delay=quantity(1 / 700, source="log"),
    )
    stored = as_stored(device)
    assert stored != device
    assert as_stored(stored) == stored
    path = tmp_path / "device.yaml"
    write_text(path, to_yaml(to_mapping(device)))
    assert load_document(Device, path) == stored


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(NotWrittenError):
        write_bytes(tmp_path / "missing" / "a.bin", b"x")
    with pytest.raises(NotWrittenError, match="folder"):
        write_bytes(tmp_path, b"x")


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


@settings(max_examples=40)
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


SPRING = "elements: {wall: {stiffness: max}}\n"
LAUGHS = "a: &a [l, l, l, l, l, l, l, l, l]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    for old, new in zip("abcdefgh", "bcdefghi")  # noqa: B905
)

#: words of the sentence, a scene file
SCENES: dict[str, tuple[str, str | bytes]] = {
    "billion laughs": ("anchors or aliases", LAUGHS),
    "a merged alias": ("anchors or aliases", "a: &a {stiffness: max}\nelements: {w: {<<: *a}}"),
    "a python object": ("constructor", "elements: !!python/object/apply:os.system ['true']"),
    "an unknown tag": ("constructor", "elements: !mine {}"),
    "deep lists": ("32 levels deep", "elements: " + "[" * 10_000 + "]" * 10_000),
    "deep blocks": ("32 levels deep", "\n".join(" " * k + "a:" for k in range(200))),
    "5 MB": ("more than 1000000 bytes", SPRING + "#" * 5_000_000),
    "a repeated key": ('duplicate key "elements"', SPRING + SPRING),
    "not a mapping": ("a mapping of names", "- 1\n- 2\n"),
    "two documents": ("not valid YAML", SPRING + "---\n" + SPRING),
    "a number for a key": ("key 3", "elements: {3: {stiffness: max}}"),
    "bytes": ("reads as a bytes", "name: !!binary aGVsbG8=\n" + SPRING),
    "a control character": ("not valid YAML", "name: a\x00b\n" + SPRING),
    "binary": ("not UTF-8", bytes(range(128, 256))),
    "not a number": ("finite number", "elements: {w: {stiffness: .nan}}"),
    "infinity": ("finite number", "elements: {w: {stiffness: max, speed: .inf}}"),
    "too large for a float": ("finite number", "elements: {w: {stiffness: 1e999}}"),
    "a thousand digits": ("integer of", "elements: {w: {stiffness: 1" + "0" * 1000 + "}}"),
    "beyond physics": ("beyond 1e-09 to 1e+09", "elements: {w: {stiffness: 1e+300}}"),
    "true for a wish": ("true and false", "elements: {w: {stiffness: true}}"),
}
DEVICE = (
    "{motion: linear, sample_time: 0.001, mass: 3, damping: 10, encoder_resolution: 0.00001, "
    "force_limit: {continuous: 14, peak: 28}, %s}"
)
DEVICES = {
    "true for a quantity": ("true and false", "force_offset: true"),
    "true inside a quantity": ("true and false", "force_offset: {value: true}"),
    "text for a quantity": ("give a number or {value", "force_offset: '3'"),
    "nan for a quantity": ("finite number", "force_offset: .nan"),
    "nan inside a quantity": ("finite number", "force_offset: {value: 1, low: .nan, high: 2}"),
    "true in a matrix": (
        "true and false",
        "covariance: {parameters: [mass], matrix: [[true]], degrees_of_freedom: 9}",
    ),
    "a delay of years": ("±1e+09", "delay: 1e12"),
    "a million samples": ("at most 20", "delay: 1000"),
}


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("spring.yaml").write_text(SPRING, encoding="utf-8")


def _refused(words: str, *command: str) -> None:
    started = time.perf_counter()
    ended = haptune(*command)
    assert ended.code == 3, ended
    assert words in ended.err
    assert len(ended.err.splitlines()) == 1
    assert len(ended.err) < 1000
    assert ended.out == ""
    assert time.perf_counter() - started < 5


def _yaml(text: str | bytes) -> None:
    Path("hostile.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())


@pytest.mark.parametrize("name", SCENES)
def test_scenes(name: str) -> None:
    words, text = SCENES[name]
    _yaml(text)
    _refused(words, "tune", "homerehab", "hostile.yaml")


@pytest.mark.parametrize("name", DEVICES)
def test_devices(name: str) -> None:
    words, line = DEVICES[name]
    _yaml(DEVICE % line)
    _refused(words, "tune", "hostile.yaml", "spring.yaml")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("true and false", "encoder_resolution: true"),
        ("finite number", "sample_time: .inf"),
        ("1e-07 s or more", "sample_time: 0"),
        ("greater than 0", "encoder_resolution: -1"),
        ("exceeds peak", "force_limit: {continuous: 2, peak: 1}"),
    ],
)
def test_hardware(words: str, text: str) -> None:
    _yaml(text)
    Path("log.csv").write_text("time,force,position\n", encoding="utf-8")
    _refused(words, "identify", "log.csv", "--hardware", "hostile.yaml")


def test_endless_and_special_files() -> None:
    _refused("more than", "tune", "homerehab", "/dev/zero")
    _refused("a mapping of names", "check", "/dev/null")
