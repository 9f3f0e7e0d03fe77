"""``haptune doctor``: what it measures, how it ends, and that it says what identify says."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from datasets_synthetic import bundled_path
from identification import examine, load_trajectory
from tests.commands import files, haptune


@pytest.fixture(autouse=True)
def _elsewhere(here: Path) -> None:
    for name in ("homerehab.csv", "homerehab.hardware.yaml"):
        shutil.copy(bundled_path(name), name)


def changed(name: str, **columns: float | None) -> str:
    """The bundled log with columns multiplied, or made missing where None, under another name."""
    lines = Path("homerehab.csv").read_text(encoding="utf-8").splitlines()
    header = lines[0].split(",")
    rows = [line.split(",") for line in lines[1:]]
    for column, factor in columns.items():
        place = header.index(column)
        for row in rows:
            row[place] = "" if factor is None else repr(float(row[place]) * factor)
    text = "\n".join([lines[0], *(",".join(row) for row in rows)])
    Path(name).write_text(text + "\n", encoding="utf-8")
    return name


def test_a_usable_log() -> None:
    ended = haptune("doctor", "homerehab.csv", "--hardware", "homerehab.hardware.yaml")
    assert ended.code == 0
    columns = np.genfromtxt("homerehab.csv", delimiter=",", skip_header=1).T
    time, force, position = columns[:3]
    lines = {line.strip().split("  ")[0]: line for line in ended.out.splitlines()}
    assert f"{time[-1]:.4g} s, {time.size} samples" in lines["length"]
    assert "1000 Hz" in lines["rate"]
    assert f"{np.ptp(position):.4g} m" in lines["travel"]
    assert f"{np.abs(force).max():.4g} N" in lines["peak force"]
    assert "6 µm" in lines["encoder count"]
    assert "usable" in ended.out
    assert "not usable" not in ended.out
    assert files() == {"homerehab.csv", "homerehab.hardware.yaml"}


def test_peak_speed_and_excited_band() -> None:
    """A motion at 0.5 and 4 Hz, known in closed form."""
    time = 1e-3 * np.arange(8000)
    turn = 2 * np.pi * np.array([0.5, 4.0])
    place = 0.03 * np.sin(turn[0] * time) + 0.004 * np.sin(turn[1] * time)
    speed = 0.03 * turn[0] * np.cos(turn[0] * time) + 0.004 * turn[1] * np.cos(turn[1] * time)
    pull = -0.03 * turn[0] ** 2 * np.sin(turn[0] * time)
    pull -= 0.004 * turn[1] ** 2 * np.sin(turn[1] * time)
    table = np.column_stack((time, 3 * pull + 10 * speed, np.rint(place / 6e-6) * 6e-6))
    np.savetxt("two.csv", table, delimiter=",", header="time,force,position", comments="")
    seen = examine(load_trajectory("two.csv"))
    assert seen.peak_speed == pytest.approx(np.abs(speed).max(), rel=0.02)
    assert seen.band[0] == pytest.approx(0.5, abs=0.2)
    assert seen.band[1] == pytest.approx(4.0, abs=0.3)
    assert seen.mass is not None
    assert seen.mass.value == pytest.approx(3.0, rel=0.02)


def test_refused_by_doctor_as_by_identify() -> None:
    turned = changed("turned.csv", force=-1.0)
    by_doctor = haptune("doctor", turned, "--json")
    by_identify = haptune("identify", turned, "--json")
    assert by_doctor.code == by_identify.code == 4
    assert by_doctor.result["findings"] == by_identify.result["findings"]
    assert by_doctor.result["status"] == "log-refused"
    assert by_doctor.result["command"] == "doctor"
    assert by_doctor.result["outputs"] == []
    assert "sign-flip" in {each["code"] for each in by_doctor.result["findings"]}
    told = haptune("doctor", turned)
    assert "not usable: sign-flip" in told.out
    assert "--force-gain" in told.err
    assert haptune("doctor", turned, "--force-gain", "-1").code == 0


def test_a_force_beyond_that_of_any_actuator_ends_in_a_refusal() -> None:
    """One reading of 1e12 N, of which no force limit can be suggested."""
    lines = Path("homerehab.csv").read_text(encoding="utf-8").splitlines()[:1002]
    time, _, *others = lines[300].split(",")
    lines[300] = ",".join((time, "1e12", *others))
    Path("glitch.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    ended = haptune("doctor", "glitch.csv")
    assert ended.code == 4
    assert "peak force        1e+12 N" in ended.out


def test_one_bad_log_does_not_hide_the_others() -> None:
    holes = changed("holes.csv", position=None)
    ended = haptune("doctor", holes, "homerehab.csv", "--json")
    assert ended.code == 4
    codes = [each["code"] for each in ended.result["findings"]]
    assert codes[0] == "non-finite"
    assert "not-stated" in codes
    told = haptune("doctor", holes, "homerehab.csv")
    assert "homerehab.csv" in told.out
    assert "usable" in told.out
