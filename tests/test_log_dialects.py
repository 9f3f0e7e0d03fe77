"""Logs as loggers and spreadsheets write them give what the plain CSV gives, and say how."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plain_table import (
    DEGREES,
    FORCE,
    MILLI,
    POSITION,
    TEXT,
    TIME,
    assert_is_the_plain_log,
    in_lines,
    load,
    table,
)

#: the file, what was understood
READ: dict[str, tuple[str | bytes, str]] = {
    "plain": (TEXT, ""),
    "tabs": (table(between="\t"), ""),
    "semicolons": (table(between=";"), ""),
    "semicolons and decimal commas": (
        table(between=";", decimal=","),
        "semicolons between columns, decimal commas",
    ),
    "tabs and decimal commas": (
        table(between="\t", decimal=","),
        "tabs between columns, decimal commas",
    ),
    "spaces": (table(between=" "), "spaces between columns"),
    "aligned by spaces": (
        in_lines(table(between="   "), lambda lines: [f"  {line} " for line in lines]),
        "spaces between columns",
    ),
    "spaces and decimal commas": (
        table(between=" ", decimal=","),
        "spaces between columns, decimal commas",
    ),
    "a marked header of spaces": ("# " + table(between=" "), "spaces between columns"),
    "commas in a marked header, spaces below": (
        table("# time, force, position", between=" "),
        "spaces between columns",
    ),
    "commas in the header, semicolons and decimal commas below": (
        table("time,force,position", between=";", decimal=","),
        "semicolons between columns, decimal commas",
    ),
    "quoted cells with decimal commas": (
        in_lines(table(between='","', decimal=","), lambda lines: [f'"{line}"' for line in lines]),
        "decimal commas",
    ),
    "lines of Windows and an open end": (
        table(between=";", decimal=",").replace("\n", "\r\n").rstrip(),
        "semicolons between columns, decimal commas",
    ),
    "UTF-8 with a mark": (TEXT.encode("utf-8-sig"), ""),
    "UTF-16 with a mark": (TEXT.encode("utf-16"), "UTF-16 text"),
    "UTF-16 without one": (TEXT.encode("utf-16-le"), "UTF-16 text"),
    "UTF-16 the other way": (TEXT.encode("utf-16-be"), "UTF-16 text"),
    "UTF-32": (TEXT.encode("utf-32"), "UTF-32 text"),
    "Excel's Unicode text": (
        table(between="\t", decimal=",").encode("utf-16"),
        "UTF-16 text, tabs between columns, decimal commas",
    ),
    "CR alone": (TEXT.replace("\n", "\r"), "lines that end in CR"),
    "comments above": (f"# rig 7\n% 2026, spring\n{TEXT}", "2 lines above the header left out"),
    "a title above": (
        f"Rig 7;recorded by hand;\n\nN;a;b;c;d\n{table(between=';', decimal=',')}",
        "semicolons between columns, decimal commas, 3 lines above the header left out",
    ),
    "comments below": (
        in_lines(TEXT, lambda lines: [lines[0], "# start", *lines[1:]]),
        "comments below the header left out",
    ),
    "blank lines": (
        in_lines(TEXT, lambda lines: [*lines[:90], "", ",,", *lines[90:], " ", ",,", ""]),
        "5 blank lines left out",
    ),
    "a blank line among decimal commas": (
        in_lines(
            table(between=";", decimal=","), lambda lines: [*lines[:90], " ; ; ", *lines[90:]]
        ),
        "semicolons between columns, decimal commas, 1 blank line left out",
    ),
    "a blank line among spaces": (
        in_lines(table(between=" "), lambda lines: [*lines, "   "]),
        "spaces between columns, 1 blank line left out",
    ),
    "a row of units": (
        in_lines(table(sizes=MILLI), lambda lines: [lines[0], "ms,mN,mm", *lines[1:]]),
        "a row of units, time from 'time [ms]' times 0.001, force from 'force [mN]' times 0.001, "
        "position from 'position [mm]' times 0.001",
    ),
    "a row of units above": (
        "s,mN,mm\n" + table(sizes=(1.0, 1e-3, 1e-3)),
        "1 line above the header left out, a row of units, time from 'time [s]', force from "
        "'force [mN]' times 0.001, position from 'position [mm]' times 0.001",
    ),
    "a commented row of units": (
        in_lines(
            table(between=" ", sizes=MILLI),
            lambda lines: [lines[0], "# [ms] [mN] [mm]", *lines[1:]],
        ),
        "spaces between columns, a row of units, time from 'time [ms]' times 0.001, force from "
        "'force [mN]' times 0.001, position from 'position [mm]' times 0.001",
    ),
    "units in the header": (
        table(("time [ms]", "force_mN", "pos (mm)"), sizes=MILLI),
        "time from 'time [ms]' times 0.001, force from 'force_mN' times 0.001, position from "
        "'pos (mm)' times 0.001",
    ),
    "units in a header of spaces": (
        table(("time [ms]", "force [mN]", "pos (mm)"), between=" ", sizes=MILLI),
        "spaces between columns, time from 'time [ms]' times 0.001, force from 'force [mN]' times "
        "0.001, position from 'pos (mm)' times 0.001",
    ),
    "a knob": (
        table(("t", "Torque [mN·m]", "Angle [°]"), sizes=DEGREES),
        "time from 't', force from 'Torque [mN·m]' times 0.001, position from 'Angle [°]' times "
        "0.0174533",
    ),
    "a knob in the Western code page": (
        table(("time / s", "torque / N·mm", "angle / °"), sizes=DEGREES).encode("cp1252"),
        "Windows-1252 text, time from 'time / s', force from 'torque / N·mm' times 0.001, position "
        "from 'angle / °' times 0.0174533",
    ),
    "microseconds and micrometres": (
        table(("time [µs]", "force [kN]", "position [µm]"), sizes=(1e-6, 1e3, 1e-6)),
        "time from 'time [µs]' times 1e-06, force from 'force [kN]' times 1000, position from "
        "'position [µm]' times 1e-06",
    ),
}


@pytest.mark.parametrize("case", READ)
def test_it_is_read_as_the_plain_log_and_said_how(tmp_path: Path, case: str) -> None:
    text, words = READ[case]
    if case == "microseconds and micrometres":  # ten digits of kN are less than those of N
        text = in_lines(str(text), lambda lines: [lines[0], *_full_digits()])
    log = load(tmp_path, text)
    assert_is_the_plain_log(log)
    assert log.read_as == words


@pytest.mark.parametrize("name", ["log.txt", "log.tsv", "LOG.CSV"])
def test_tables_of_text_have_several_endings(tmp_path: Path, name: str) -> None:
    assert_is_the_plain_log(load(tmp_path, TEXT, name))


def _full_digits() -> list[str]:
    rows = zip(TIME / 1e-6, FORCE / 1e3, POSITION / 1e-6, strict=True)
    return [",".join(f"{x:.17g}" for x in row) for row in rows]


#: what is asked for, the header, the sizes of its units, what was understood
ASKED: dict[str, tuple[dict[str, Any], str, tuple[float, float, float], str]] = {
    "a motor current": (
        {"force": "current", "force_gain": 3.5},
        "time,current [A],position",
        (1.0, 3.5, 1.0),
        "force from 'current [A]' times 3.5",
    ),
    "gains that agree with the units": (
        {"time_gain": 1e-3, "position_gain": 0.0174533},
        "time [ms],torque [Nm],position [deg]",
        (1e-3, 1.0, 0.0174533),
        "time from 'time [ms]' times 0.001, force from 'torque [Nm]', position from "
        "'position [deg]' times 0.0174533",
    ),
    "a position that counts the other way": (
        {"position_gain": -1e-3},
        "time,force,position [mm]",
        (1.0, 1.0, -1e-3),
        "position from 'position [mm]' times -0.001",
    ),
    "a unit that a gain makes known": (
        {"force_gain": 2.0},
        "time,force [parrots],position",
        (1.0, 2.0, 1.0),
        "force from 'force [parrots]' times 2",
    ),
    "names with units that were asked for": (
        {"position": "handle_mm", "force": "drive (N)"},
        "time,drive (N),handle_mm",
        (1.0, 1.0, 1e-3),
        "force from 'drive (N)', position from 'handle_mm' times 0.001",
    ),
    "an element of an array is no unit": (
        {"position": "position[0]", "force": "effort[0]"},
        "time,effort[0],position[0]",
        (1.0, 1.0, 1.0),
        "",
    ),
}


@pytest.mark.parametrize("case", ASKED)
def test_options_and_units_in_names_go_together(tmp_path: Path, case: str) -> None:
    asked, header, sizes, words = ASKED[case]
    log = load(tmp_path, table(header, sizes=sizes), **asked)
    assert_is_the_plain_log(log)
    assert log.read_as == words


def test_a_unit_in_the_header_is_stated_one_that_is_not_there_is_not(tmp_path: Path) -> None:
    assert load(tmp_path, TEXT).stated_units == frozenset()
    stated = load(tmp_path, table("time,force [N],position")).stated_units
    assert stated == {"force"}


def test_a_reference_has_the_unit_of_the_position_or_its_own(tmp_path: Path) -> None:
    for header, size in (("reference", 1e-3), ("reference [cm]", 1e-2)):
        rows = table("time,force,position [mm]", sizes=(1.0, 1.0, 1e-3)).splitlines()
        lines = [f"{line},{p / size:.10f}" for line, p in zip(rows[1:], POSITION, strict=True)]
        log = load(tmp_path, "\n".join([f"{rows[0]},{header}", *lines]))
        assert log.reference is not None
        np.testing.assert_allclose(log.reference, POSITION, atol=1e-10)
