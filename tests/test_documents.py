"""YAML in and out, and writing whole files or nothing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
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

#: What YAML 1.1 readers take for a float (yaml.org/type/float.html), decimal forms.
FLOAT_1_1 = re.compile(r"[-+]?([0-9][0-9_]*)\.[0-9_]*([eE][-+][0-9]+)?")


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_reads_plain_mappings(tmp_path: Path) -> None:
    text = "\ufeffname: a\nnumber: 1.0e-3\nflag: true\nnothing: null\nlist: [1, {b: 2.5}]\n"
    assert load_mapping(written(tmp_path, text)) == {
        "name": "a",
        "number": 1e-3,
        "flag": True,
        "nothing": None,
        "list": [1, {"b": 2.5}],
    }


def test_missing_files_and_folders(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.yaml", tmp_path):
        with pytest.raises(InvalidInputError, match="cannot be read"):
            load_mapping(path)


def test_every_complaint_names_its_key_and_what_was_seen() -> None:
    content: dict[str, Any] = {"sample_tme": 1.0, "delay": "late", "encoder_resolution": True}
    with pytest.raises(InvalidInputError) as caught:
        parse_document(Hardware, content, "hardware.yaml")
    text = str(caught.value)
    for part in ("hardware.yaml", "sample_tme", "did you mean sample_time", "'late'", "True"):
        assert part in text


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


# Writing


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(NotWrittenError):
        write_bytes(tmp_path / "missing" / "a.bin", b"x")
    with pytest.raises(NotWrittenError, match="folder"):
        write_bytes(tmp_path, b"x")
