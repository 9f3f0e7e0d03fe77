"""Files made to break the reader end in one sentence, whichever command reads them."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.commands import haptune

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
    "a date": ("reads as a date", "name: 2024-01-01\n" + SPRING),
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
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
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


@pytest.mark.parametrize("name", SCENES)
def test_scenes(name: str) -> None:
    words, text = SCENES[name]
    Path("hostile.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    _refused(words, "tune", "homerehab", "hostile.yaml")


@pytest.mark.parametrize("name", DEVICES)
def test_devices(name: str) -> None:
    words, line = DEVICES[name]
    Path("hostile.yaml").write_text(DEVICE % line, encoding="utf-8")
    _refused(words, "tune", "hostile.yaml", "spring.yaml")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("true and false", "encoder_resolution: true"),
        ("finite number", "sample_time: .inf"),
        ("anchors", "{name: &a x, axis: *a}"),
        ("1e-07 s or more", "sample_time: 0"),
        ("greater than 0", "encoder_resolution: -1"),
        ("exceeds peak", "force_limit: {continuous: 2, peak: 1}"),
    ],
)
def test_hardware(words: str, text: str) -> None:
    Path("hostile.yaml").write_text(text, encoding="utf-8")
    Path("log.csv").write_text("time,force,position\n", encoding="utf-8")
    _refused(words, "identify", "log.csv", "--hardware", "hostile.yaml")


@pytest.mark.parametrize("name", ["billion laughs", "deep lists", "5 MB", "a date", "bytes"])
def test_profiles(name: str) -> None:
    words, text = SCENES[name]
    assert isinstance(text, str)
    Path("hostile.yaml").write_text("certificate: 1\n" + text, encoding="utf-8")
    _refused(words, "check", "hostile.yaml")


def test_endless_and_special_files() -> None:
    _refused("more than", "tune", "homerehab", "/dev/zero")
    _refused("a mapping of names", "check", "/dev/null")


def test_a_byte_order_mark_and_windows_line_ends_are_no_offence() -> None:
    Path("windows.yaml").write_bytes(b"\xef\xbb\xbf" + SPRING.replace("\n", "\r\n").encode())
    assert haptune("tune", "homerehab", "windows.yaml", "--quiet").code == 0
