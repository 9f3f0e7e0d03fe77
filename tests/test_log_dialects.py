"""Logs as loggers and spreadsheets write them give what the plain CSV gives, and say how.

Every file is written here from the numbers of the plain log, by formatting them otherwise.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from identification import (
    InvalidInputError,
    LogColumns,
    Trajectory,
    load_device,
    load_trajectory,
)
from identification.readers.header_units import split_name, unit_named
from tests.commands import haptune

ROWS = 300
TIME = np.arange(ROWS) * 1e-3
FORCE = 2.5 * np.sin(40 * TIME) + 0.125
POSITION = 0.01 * np.cos(33 * TIME) - 0.002
PLAIN = ("time", "force", "position")


def table(
    header: Sequence[str] | str = PLAIN,
    *,
    between: str = ",",
    decimal: str = ".",
    sizes: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> str:
    """The log as text: each column divided by the size of its unit, ten digits."""
    names = header if isinstance(header, str) else between.join(header)
    rows = zip(TIME / sizes[0], FORCE / sizes[1], POSITION / sizes[2], strict=True)
    lines = [between.join(f"{x:.10f}".replace(".", decimal) for x in row) for row in rows]
    return "\n".join([names, *lines]) + "\n"


def load(folder: Path, text: str | bytes, name: str = "log.csv", **asked: Any) -> Trajectory:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return load_trajectory(path, LogColumns(**asked))


def assert_is_the_plain_log(log: Trajectory) -> None:
    for found, true in ((log.time, TIME), (log.force, FORCE), (log.position, POSITION)):
        np.testing.assert_allclose(found, true, rtol=1e-8, atol=1e-10)


def _in_lines(text: str, change: Callable[[list[str]], list[str]]) -> str:
    return "\n".join(change(text.splitlines())) + "\n"


MILLI = (1e-3, 1e-3, 1e-3)
DEGREES = (1.0, 1e-3, math.pi / 180)
TEXT = table()

#: the file, its ending, what was understood
READ: dict[str, tuple[str | bytes, str, str]] = {
    "plain": (TEXT, ".csv", ""),
    "plain, txt": (TEXT, ".txt", ""),
    "tabs": (table(between="\t"), ".tsv", ""),
    "semicolons": (table(between=";"), ".csv", ""),
    "semicolons and decimal commas": (
        table(between=";", decimal=","),
        ".csv",
        "semicolons between columns, decimal commas",
    ),
    "tabs and decimal commas": (
        table(between="\t", decimal=","),
        ".txt",
        "tabs between columns, decimal commas",
    ),
    "spaces": (table(between=" "), ".txt", "spaces between columns"),
    "aligned by spaces": (
        _in_lines(table(between="   "), lambda lines: [f"  {line} " for line in lines]),
        ".txt",
        "spaces between columns",
    ),
    "spaces and decimal commas": (
        table(between=" ", decimal=","),
        ".txt",
        "spaces between columns, decimal commas",
    ),
    "a marked header of spaces": ("# " + table(between=" "), ".txt", "spaces between columns"),
    "commas in a marked header, spaces below": (
        table("# time, force, position", between=" "),
        ".txt",
        "spaces between columns",
    ),
    "quoted cells with decimal commas": (
        _in_lines(table(between='","', decimal=","), lambda lines: [f'"{line}"' for line in lines]),
        ".csv",
        "decimal commas",
    ),
    "lines of Windows and an open end": (
        table(between=";", decimal=",").replace("\n", "\r\n").rstrip(),
        ".csv",
        "semicolons between columns, decimal commas",
    ),
    "UTF-8 with a mark": (TEXT.encode("utf-8-sig"), ".csv", ""),
    "UTF-16 with a mark": (TEXT.encode("utf-16"), ".csv", "UTF-16 text"),
    "UTF-16 without one": (TEXT.encode("utf-16-le"), ".csv", "UTF-16 text"),
    "UTF-16 the other way": (TEXT.encode("utf-16-be"), ".csv", "UTF-16 text"),
    "UTF-32": (TEXT.encode("utf-32"), ".csv", "UTF-32 text"),
    "Excel's Unicode text": (
        table(between="\t", decimal=",").encode("utf-16"),
        ".txt",
        "UTF-16 text, tabs between columns, decimal commas",
    ),
    "CR alone": (TEXT.replace("\n", "\r"), ".csv", "lines that end in CR"),
    "comments above": (
        f"# rig 7\n% 2026, spring\n{TEXT}",
        ".csv",
        "2 lines above the header left out",
    ),
    "a title above": (
        f"Rig 7;recorded by hand;\n\nN;a;b;c;d\n{table(between=';', decimal=',')}",
        ".csv",
        "semicolons between columns, decimal commas, 3 lines above the header left out",
    ),
    "comments below": (
        _in_lines(TEXT, lambda lines: [lines[0], "# start", *lines[1:]]),
        ".csv",
        "comments below the header left out",
    ),
    "a row of units": (
        _in_lines(table(sizes=MILLI), lambda lines: [lines[0], "ms,mN,mm", *lines[1:]]),
        ".csv",
        "a row of units, time from 'time [ms]' times 0.001, force from 'force [mN]' times 0.001, "
        "position from 'position [mm]' times 0.001",
    ),
    "a row of units above": (
        "s,mN,mm\n" + table(sizes=(1.0, 1e-3, 1e-3)),
        ".csv",
        "1 line above the header left out, a row of units, time from 'time [s]', force from "
        "'force [mN]' times 0.001, position from 'position [mm]' times 0.001",
    ),
    "a commented row of units": (
        _in_lines(
            table(between=" ", sizes=MILLI),
            lambda lines: [lines[0], "# [ms] [mN] [mm]", *lines[1:]],
        ),
        ".txt",
        "spaces between columns, a row of units, time from 'time [ms]' times 0.001, force from "
        "'force [mN]' times 0.001, position from 'position [mm]' times 0.001",
    ),
    "units in the header": (
        table(("time [ms]", "force_mN", "pos (mm)"), sizes=MILLI),
        ".csv",
        "time from 'time [ms]' times 0.001, force from 'force_mN' times 0.001, position from "
        "'pos (mm)' times 0.001",
    ),
    "units in a header of spaces": (
        table(("time [ms]", "force [mN]", "pos (mm)"), between=" ", sizes=MILLI),
        ".txt",
        "spaces between columns, time from 'time [ms]' times 0.001, force from 'force [mN]' times "
        "0.001, position from 'pos (mm)' times 0.001",
    ),
    "a knob": (
        table(("t", "Torque [mN·m]", "Angle [°]"), sizes=DEGREES),
        ".csv",
        "time from 't', force from 'Torque [mN·m]' times 0.001, position from 'Angle [°]' times "
        "0.0174533",
    ),
    "a knob in the Western code page": (
        table(("time / s", "torque / N·mm", "angle / °"), sizes=DEGREES).encode("cp1252"),
        ".csv",
        "Windows-1252 text, time from 'time / s', force from 'torque / N·mm' times 0.001, position "
        "from 'angle / °' times 0.0174533",
    ),
    "microseconds and micrometres": (
        table(("time [µs]", "force [kN]", "position [µm]"), sizes=(1e-6, 1e3, 1e-6)),
        ".csv",
        "time from 'time [µs]' times 1e-06, force from 'force [kN]' times 1000, position from "
        "'position [µm]' times 1e-06",
    ),
}


@pytest.mark.parametrize("case", READ)
def test_it_is_read_as_the_plain_log_and_said_how(tmp_path: Path, case: str) -> None:
    text, ending, words = READ[case]
    if case == "microseconds and micrometres":  # ten digits of kN are less than those of N
        text = _in_lines(str(text), lambda lines: [lines[0], *_full_digits()])
    log = load(tmp_path, text, f"log{ending}")
    assert_is_the_plain_log(log)
    assert log.read_as == words


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


THOUSANDS = "time;force;position\n" + "\n".join(
    f"{k};{k % 7 + 1},{100 + k};{k % 5 + 1},{300 + k}" for k in range(ROWS)
)

#: what is asked for, the file, what is said, the step to take
REFUSED: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "a comma for two": (
        {},
        table(decimal=","),
        "has 6 cells below 3 names, as if commas stood between columns and before decimals",
        "Export it with semicolons",
    ),
    "decimals or thousands": (
        {},
        THOUSANDS,
        "column 'force' holds '1,100' in row 2, which may have a decimal comma or a separator of "
        "thousands",
        "Add --decimal comma",
    ),
    "thousands": (
        {},
        THOUSANDS.replace("3,100;1,300", "1,003,100.5;1,300"),
        "a separator of thousands",
        "export",
    ),
    "commas and points": (
        {},
        table(between=";", decimal=",").replace("0,1500000000", "0.1500000000"),
        "column 'time' holds '0.1500000000' in row 152, which is not a number with a decimal comma"
        "|commas and points before decimals",
        "alike|decimal points alone",
    ),
    "a unit nobody knows": (
        {},
        table("time,force [parrots],position"),
        "states its unit as 'parrots', which is no unit",
        "Add --force-gain X: N",
    ),
    "a unit nobody knows in a row of units": (
        {},
        _in_lines(TEXT, lambda lines: [lines[0], "s,parrots,m", *lines[1:]]),
        "a row of units, and 'parrots' is no unit of force",
        "Add --force-gain X",
    ),
    "a motor current": (
        {"force": "current"},
        table("time,current [A],position"),
        "states its unit as 'A', which depends on the device",
        "Add --force-gain X: .* torque constant times transmission",
    ),
    "a motor current nobody named": (
        {},
        table("time,current [A],position"),
        "has no column 'force'",
        'perhaps --force "current \\[A\\]"',
    ),
    "counts": (
        {},
        table("time,force,position [counts]"),
        "'counts', which depends on the device",
        "Add --position-gain X: m",
    ),
    "a gain that contradicts": (
        {"position_gain": 0.01},
        table("time,force,position [mm]"),
        "states its unit as 'mm', 0.001 m .*, and --position-gain 0.01 contradicts it",
        "Leave out --position-gain, give 0.001",
    ),
    "1 for milliseconds": (
        {"time_gain": 1.0},
        table("time [ms],force,position"),
        "'ms', 0.001 s, and --time-gain 1 contradicts it",
        "Leave out --time-gain",
    ),
    "two rows of units": (
        {},
        _in_lines(table("time [ms],force,position"), lambda rows: [rows[0], "s,N,m", *rows[1:]]),
        "column 'time \\[ms\\]' has 's' in the row of units",
        "Delete the one that is wrong",
    ),
    "newtons and degrees": (
        {},
        table("time,force [N],position [deg]"),
        "is in deg, a unit of rotary motion, and another column's unit is linear",
        "Add --position-gain X",
    ),
    "two columns that may be meant": (
        {},
        table("t,force,position").replace("t,force", "t,timestamp,force", 1),
        "several columns that may be the time: 't', 'timestamp'",
        'such as --time "t"',
    ),
    "samples above": ({}, "0,1,2\n" + TEXT, "1 line above its header", "Delete the lines"),
    "words below": (
        {},
        _in_lines(TEXT, lambda lines: [lines[0], "clock,motor,handle", *lines[1:]]),
        "'clock', 'motor', 'handle' in row 2",
        "Delete row 2",
    ),
    "a summary below comments": (
        {},
        f"# rig 7\n{TEXT}Mean,0.1,0.2\n",
        "ends with 'Mean' in row 303",
        "Delete row 303",
    ),
    "a word in a row below comments": (
        {},
        f"# rig 7\n{TEXT.replace('0.1500000000,', 'late,')}",
        "column 'time' holds 'late' in row 153",
        "Write all numbers alike",
    ),
    "a long row below comments": (
        {},
        f"# rig 7\n{TEXT}1,2,3,4\n",
        "not a table of equally long rows below line 2",
        "Export it again",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_certain_is_refused_with_what_makes_it_so(tmp_path: Path, case: str) -> None:
    asked, text, said, step = REFUSED[case]
    with pytest.raises(InvalidInputError, match=said) as found:
        load(tmp_path, text, **asked)
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


def test_a_linear_axis_needs_a_gain_for_an_angle(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(table("time,force,position [deg]", sizes=(1.0, 1.0, 0.05)), encoding="utf-8")
    with pytest.raises(InvalidInputError, match="a unit of rotary motion, and the axis is linear"):
        load_trajectory(path, motion="linear")
    # Through a transmission, 0.05 m a degree.
    log = load_trajectory(path, LogColumns(position_gain=0.05), motion="linear")
    assert_is_the_plain_log(log)


@pytest.mark.parametrize(
    ("role", "name", "stem", "size"),
    [
        ("time", "time [ms]", "time", 1e-3),
        ("time", "Zeit in s", "Zeit in s", None),
        ("force", "force_N", "force", 1.0),
        ("force", "force_n", "force_n", None),
        ("force", "force_m", "force_m", None),
        ("force", "MOTOR (N m)", "MOTOR", 1.0),
        ("force", "F / kN", "F", 1e3),
        ("position", "handle_x_mm", "handle_x", 1e-3),
        ("position", "handle_m", "handle_m", None),
        ("position", "position_m", "position", 1.0),
        ("position", "q [rev]", "q", 2 * math.pi),
        ("position", "pos [Degrees]", "pos", math.pi / 180),
        ("position", "pos[3]", "pos[3]", None),
        ("position", "pos [in]", "pos", None),
    ],
)
def test_units_in_names(role: str, name: str, stem: str, size: float | None) -> None:
    found, text = split_name(role, name)
    unit = None if text is None else unit_named(role, text)
    assert (found, None if unit is None else unit.size) == (stem, size)


def test_the_device_and_the_commands_tell_how_a_log_was_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log of a known device in ms, mN and mm with decimal commas gives the same device."""
    from datasets_synthetic import bundled_path, log_text

    monkeypatch.chdir(tmp_path)
    log = load_trajectory(bundled_path("homerehab.csv")).part(slice(0, 2000))
    Path("plain.csv").write_text(log_text(log), encoding="utf-8")
    lines = ["time [ms];force [mN];pos (mm)"]
    for line in log_text(log).splitlines()[1:]:
        cells = [float(cell) for cell in line.split(",")[:3]]
        lines.append(";".join(repr(1000 * cell).replace(".", ",") for cell in cells))
    Path("other.csv").write_text("\n".join(lines), encoding="utf-8")
    for name in ("plain", "other"):
        ended = haptune(
            "identify", f"{name}.csv", "-o", f"{name}.yaml", "--method", "least-squares"
        )
        assert ended.code == 0, ended.err
    words = (
        "semicolons between columns, decimal commas, time from 'time [ms]' times 0.001, force "
        "from 'force [mN]' times 0.001, position from 'pos (mm)' times 0.001"
    )
    assert f"other.csv: read with {words}" in ended.out
    plain, other = load_device("plain.yaml"), load_device("other.yaml")
    # Times 1000 and back moves last digits, which moves where the search for the delay ends.
    for found, true in ((other.mass, plain.mass), (other.damping, plain.damping)):
        assert found.value == pytest.approx(true.value, abs=0.01 * (true.high - true.low))
    assert [record.read_as for record in plain.logs] == [""]
    assert [record.read_as for record in other.logs] == [words]
    Path("short.csv").write_text("\n".join(lines[:1] + lines[500:900]), encoding="utf-8")
    told = haptune("doctor", "short.csv", "--json").result
    assert told["details"]["read_as"] == {"short.csv": words}


def test_units_in_the_names_of_packed_columns(tmp_path: Path) -> None:
    """Parquet as in text; archives hold arrays of any meaning, so that no other word counts."""
    path = tmp_path / "log.parquet"
    names = {"time [ms]": TIME * 1e3, "Force_mN": FORCE * 1e3, "pos (mm)": POSITION * 1e3}
    pl.DataFrame(names).write_parquet(path)
    assert_is_the_plain_log(load_trajectory(path))
    # A date carries its own unit, whatever the name says.
    moments = np.datetime64("2026-03-01T12:00", "ns") + (TIME * 1e9).round().astype(
        "timedelta64[ns]"
    )
    pl.DataFrame(names | {"time [ms]": moments}).write_parquet(path)
    assert_is_the_plain_log(load_trajectory(path))
    path = tmp_path / "log.npz"
    np.savez(path, time_ms=TIME * 1e3, force_mN=FORCE * 1e3, position_mm=POSITION * 1e3)
    assert_is_the_plain_log(load_trajectory(path))
    np.savez(path, t=TIME, force=FORCE, pos=POSITION)
    with pytest.raises(InvalidInputError, match="has no column 'time', 'position'"):
        load_trajectory(path)
