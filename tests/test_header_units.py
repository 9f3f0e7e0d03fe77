"""Units in the names of columns: of text, of packed tables, and as commands tell them."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from identification import InvalidInputError, LogColumns, load_device, load_trajectory
from tests.commands import haptune
from tests.plain_table import FORCE, POSITION, TIME, assert_is_the_plain_log, table


def test_a_linear_axis_needs_a_gain_for_an_angle(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(table("time,force,position [deg]", sizes=(1.0, 1.0, 0.05)), encoding="utf-8")
    with pytest.raises(InvalidInputError, match="a unit of rotary motion, and the axis is linear"):
        load_trajectory(path, motion="linear")
    # Through a transmission, 0.05 m a degree.
    log = load_trajectory(path, LogColumns(position_gain=0.05), motion="linear")
    assert_is_the_plain_log(log)


def test_the_device_and_the_commands_tell_how_a_log_was_read(here: Path) -> None:
    """A log of a known device in ms, mN and mm with decimal commas gives the same device."""
    from datasets_synthetic import bundled_path, log_text

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
