"""What loggers and spreadsheets do to CSV logs is named for what it is, with the step to take."""

import re
from pathlib import Path

import pytest

from identification import InvalidInputError, LogColumns, load_trajectory
from tests.commands import haptune, log_text

TEXT = log_text(300)
HEADER, *ROWS = TEXT.splitlines()
UNITS = "\n".join([HEADER, "s,N,m", *ROWS])

#: what is said, the step to take, the file
CASES: dict[str, tuple[str, str, bytes]] = {
    "zeros at the end": (
        "holds 512 NUL bytes, the first in line 302",
        "Log or export it again, or keep the lines before line 302",
        TEXT.encode() + bytes(512),
    ),
    "a zero inside": (
        "1 NUL byte, the first in line 2",
        "or keep the lines before line 2",
        TEXT.replace("0", "\0", 1).encode(),
    ),
    "zeros alone": (
        "holds 4096 NUL bytes, the first in line 1",
        "Log or export it again",
        bytes(4096),
    ),
    "another log above": (
        "has 2 lines above its header, which stands in line 3; the first is '0,1,2'",
        "Delete the lines above the header",
        f"0,1,2\n1,2,3\n{TEXT}".encode(),
    ),
    "half a letter of UTF-16": (
        "begins as UTF-16 text, and byte",
        "Save it as UTF-8",
        TEXT.encode("utf-16") + b"\x0a",
    ),
    "a comment above another header": (
        "has no column 'time'; it has: uhr, force, position",
        "Name the right column with --time",
        f"# rig 7\n{TEXT.replace('time', 'uhr')}".encode(),
    ),
    "names and units": (
        "'clock' in row 2, which is not a number",
        "delete rows of units, names or a summary",
        UNITS.replace("s,N,m", "clock,motor,handle\n[T],[U],[W]").encode(),
    ),
    "a mean at the end": (
        "'Mean' in row 302, which is not a number",
        "delete rows of units, names or a summary",
        f"{TEXT}Mean,0.1,0.2\n".encode(),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_it_is_named_for_what_it_is(tmp_path: Path, case: str) -> None:
    said, step, content = CASES[case]
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match=re.escape(said)) as found:
        load_trajectory(path)
    assert found.value.remedy.startswith(step) or step in found.value.remedy
    assert "\n" not in str(found.value)


def test_a_command_says_so_in_one_line(here: Path) -> None:
    Path("log.csv").write_text(UNITS.replace("s,N,m", "clock,motor,handle"), encoding="utf-8")
    ended = haptune("doctor", "log.csv")
    assert ended.code == 3
    assert ended.err.count("\n") == 1
    assert "row 2" in ended.err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TEXT.replace(".", ","), "commas stood between columns and before decimals"),
        (TEXT.replace(",", ";").replace("0.15", "0,15"), "'0,150' in row 152 .* commas and points"),
        (TEXT.replace("0.150,", "late,", 1), "'late' in row 152, which is not a number"),
        (TEXT.replace("time", "uhr"), "has no column 'time'; it has: uhr, force, position"),
        ("# " + TEXT.replace("time", "uhr"), "has no column 'time'; it has: uhr, force"),
    ],
)
def test_nothing_else_is_taken_for_it(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=said):
        load_trajectory(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_what_is_read_stays_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "log.csv"
    for text in (TEXT, "# " + TEXT, TEXT.replace("\n", "\r\n")):
        path.write_bytes(text.encode(encoding))
        assert len(load_trajectory(path, LogColumns())) == 300
