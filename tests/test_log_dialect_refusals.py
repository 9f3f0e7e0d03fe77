"""Tables of text that are damaged or could be read in two ways are refused, with what helps."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import InvalidInputError
from tests.plain_table import ROWS, TEXT, in_lines, load, table

THOUSANDS = "time;force;position\n" + "\n".join(
    f"{k};{k % 7 + 1},{100 + k};{k % 5 + 1},{300 + k}" for k in range(ROWS)
)

#: the file, what is said, the step to take
REFUSED: dict[str, tuple[str | bytes, str, str]] = {
    "a comma for two": (
        table(decimal=","),
        "has 6 cells below 3 names, as if commas stood between columns and before decimals",
        "Export it with semicolons",
    ),
    "decimals or thousands": (
        THOUSANDS,
        "column 'force' holds '1,100' in row 2, which may have a decimal comma or a separator of "
        "thousands",
        "Add --decimal comma",
    ),
    "thousands": (
        THOUSANDS.replace("3,100;1,300", "1,003,100.5;1,300"),
        "a separator of thousands",
        "export",
    ),
    "commas and points": (
        table(between=";", decimal=",").replace("0,1500000000", "0.1500000000"),
        "column 'time' holds '0.1500000000' in row 152, which is not a number with a decimal comma"
        "|commas and points before decimals",
        "alike|decimal points alone",
    ),
    "a unit nobody knows": (
        table("time,force [parrots],position"),
        "states its unit as 'parrots', which is no unit",
        "Add --force-gain X: N",
    ),
    "a unit nobody knows in a row of units": (
        in_lines(TEXT, lambda lines: [lines[0], "s,parrots,m", *lines[1:]]),
        "a row of units, and 'parrots' is no unit of force",
        "Add --force-gain X",
    ),
    "a motor current": (
        table("time,current [A],position"),
        "states its unit as 'A', which depends on the device",
        "Add --force-gain X: .* torque constant times transmission",
    ),
    "a motor current nobody named": (
        table("time,current [A],position"),
        "has no column 'force'",
        'perhaps --force "current \\[A\\]"',
    ),
    "counts": (
        table("time,force,position [counts]"),
        "'counts', which depends on the device",
        "Add --position-gain X: m",
    ),
    "a gain that contradicts": (
        table("time,force,position [mm]"),
        "states its unit as 'mm', 0.001 m .*, and --position-gain 0.01 contradicts it",
        "Leave out --position-gain, give 0.001",
    ),
    "1 for milliseconds": (
        table("time [ms],force,position"),
        "'ms', 0.001 s, and --time-gain 1 contradicts it",
        "Leave out --time-gain",
    ),
    "two rows of units": (
        in_lines(table("time [ms],force,position"), lambda rows: [rows[0], "s,N,m", *rows[1:]]),
        "column 'time \\[ms\\]' has 's' in the row of units",
        "Delete the one that is wrong",
    ),
    "newtons and degrees": (
        table("time,force [N],position [deg]"),
        "is in deg, a unit of rotary motion, and another column's unit is linear",
        "Add --position-gain X",
    ),
    "two columns that may be meant": (
        table("t,force,position").replace("t,force", "t,timestamp,force", 1),
        "several columns that may be the time: 't', 'timestamp'",
        'such as --time "t"',
    ),
    "another log above": (
        f"0,1,2\n1,2,3\n{TEXT}",
        "has 2 lines above its header, which stands in line 3; the first is '0,1,2'",
        "Delete the lines above the header",
    ),
    "zeros at the end": (
        TEXT.encode() + bytes(512),
        "holds 512 NUL bytes, the first in line 302",
        "Log or export it again, or keep the lines before line 302",
    ),
    "zeros alone": (
        bytes(4096),
        "holds 4096 NUL bytes, the first in line 1",
        "Log or export it again$",
    ),
    "half a letter of UTF-16": (
        TEXT.encode("utf-16") + b"\x0a",
        "begins as UTF-16 text, and byte",
        "Save it as UTF-8",
    ),
    "a comment above another header": (
        f"# rig 7\n{TEXT.replace('time', 'uhr')}",
        "has no column 'time'; it has: uhr, force, position",
        "Name the right column with --time",
    ),
    "words below": (
        in_lines(TEXT, lambda lines: [lines[0], "clock,motor,handle", *lines[1:]]),
        "'clock' in row 2",
        "delete rows of units",
    ),
    "a summary": (
        f"{TEXT}Mean,0.1,0.2\n",
        "'Mean' in row 302",
        "delete rows of units, names or a summary",
    ),
    "a summary below comments": (
        f"# rig 7\n{TEXT}Mean,0.1,0.2\n",
        "'Mean' in row 303",
        "delete rows of units",
    ),
    "a word in a row below comments": (
        f"# rig 7\n{TEXT.replace('0.1500000000,', 'late,')}",
        "column 'time' holds 'late' in row 153",
        "Write all numbers alike",
    ),
    "a long row below comments": (
        f"# rig 7\n{TEXT}1,2,3,4\n",
        "not a table of equally long rows below line 2",
        "Export it again",
    ),
}
#: What is asked for of some of them.
ASKED: dict[str, dict[str, Any]] = {
    "a motor current": {"force": "current"},
    "a gain that contradicts": {"position_gain": 0.01},
    "1 for milliseconds": {"time_gain": 1.0},
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_certain_is_refused_with_what_makes_it_so(tmp_path: Path, case: str) -> None:
    text, said, step = REFUSED[case]
    with pytest.raises(InvalidInputError, match=said) as found:
        load(tmp_path, text, **ASKED.get(case, {}))
    assert "\n" not in str(found.value)
    assert len(str(found.value)) < 600
    assert re.search(step, found.value.remedy)


def test_a_decimal_comma_that_was_stated_is_believed(tmp_path: Path) -> None:
    log = load(tmp_path, THOUSANDS, decimal="comma", time_gain=1e-3)
    np.testing.assert_allclose(log.force[:3], [1.1, 2.101, 3.102])
    with pytest.raises(InvalidInputError, match=r"'1,100' in row 2"):
        load(tmp_path, THOUSANDS, decimal="point", time_gain=1e-3)
    late = "time;force;position\n" + "0;0;0\n" * 6000 + "1;1,234;2\n"
    with pytest.raises(InvalidInputError, match=r"'1,234' in row 6002"):
        load(tmp_path, late)
