"""The players: a planned force played on a simulated device is a log that tells its mass."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from datasets_synthetic import named_rig
from identification import load_device
from tests.commands import haptune
from tests.guard import FLAGS
from tests.player import Play, compiler, play_in_c, play_in_python
from tests.stepped_device import Fault, SteppedDevice

STEP = 1e-3
#: Forces of a push and a pull that fade in and out, N: 0.08 m and 0.4 m/s on a device of 3 kg.
_TURN = np.linspace(0, np.pi, 601)
PUSH = np.round(8.0 * np.sin(2 * _TURN) * np.sin(_TURN) ** 2, 9)
#: Short, and of a device that is known: it takes a second to plan.
SPEC = """\
motion: linear
sample_time: 0.001
duration: 2.0
force: 14.0
travel: 0.1
mass: 3.0
damping: 10.0
coulomb_friction: 0.8
encoder_resolution: 0.000006
"""
WIDE = {"force": 14.0, "travel": 0.5, "speed": 5.0}
LANGUAGES = ("c", "python")


def plan_file(folder: Path, forces: np.ndarray, step: float = STEP) -> Path:
    rows = [f"{k * step:.9g},{force:.12g}" for k, force in enumerate(forces.tolist())]
    path = folder / "force.csv"
    path.write_text("\n".join(["time,force", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def players(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Play]:
    """Both players, as the command writes them."""
    folder, before = tmp_path_factory.mktemp("players"), Path.cwd()
    os.chdir(folder)
    try:
        for language in LANGUAGES:
            assert haptune("new", "player", "--language", language).code == 0
    finally:
        os.chdir(before)
    return {
        "c": play_in_c(folder / "player.c"),
        "python": play_in_python(folder / "player.py"),
    }


def rows_of(log: str) -> np.ndarray:
    header, *lines = log.splitlines()
    assert header == "time,force,position"
    return np.array([[float(cell) for cell in line.split(",")] for line in lines])


def test_a_plan_that_is_played_and_logged_tells_mass_and_damping(
    players: dict[str, Play], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("excitation.yaml").write_text(SPEC, encoding="utf-8")
    assert haptune("excite", "excitation.yaml", "-o", "force.csv").code == 0
    assert haptune("new", "hardware", "--device", "homerehab").code == 0
    rig = named_rig("homerehab")
    limits = {"force": 14.0, "travel": 0.1, "speed": 2.0}
    logs: list[np.ndarray] = []
    for language in LANGUAGES:
        log, end = players[language](SteppedDevice(rig), Path("force.csv"), limits)
        assert end == "played to the end"
        logs.append(rows_of(log))
        Path(f"{language}.csv").write_text(log, encoding="utf-8")
    np.testing.assert_allclose(*logs, rtol=0, atol=1e-12)
    planned = np.loadtxt("force.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(logs[0][:-1, :2], planned, rtol=0, atol=1e-9)
    ended = haptune("identify", "c.csv", "--hardware", "hardware.yaml")
    assert ended.code == 0, ended.err
    device = load_device("device.yaml")
    assert device.mass.low <= float(rig.mass[0]) <= device.mass.high
    assert device.damping.low <= float(rig.damping[0]) <= device.damping.high


#: Limits, what goes wrong, how it ends, and the first sample without force.
STOPS: dict[str, tuple[dict[str, float], Fault, str, int]] = {
    "too far": (WIDE | {"travel": 0.01}, Fault(), "travel exceeded", 0),
    "too fast": (WIDE | {"speed": 0.1}, Fault(), "too fast", 0),
    "emergency stop": (WIDE, Fault(stop_from=300), "emergency stop", 300),
    "a reading that is no number": (WIDE, Fault(nan_from=300), "not a number", 300),
    "no reading": (WIDE, Fault(read_fails_from=300), "could not be read|encoder is gone", 300),
    "a force not taken": (
        WIDE,
        Fault(write_fails_from=300, write_fails_times=2),
        "could not be written|amplifier is gone",
        300,
    ),
    "a computer that sleeps": (WIDE, Fault(late_at=300, late=0.03), "too late", 300),
}


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("case", STOPS)
def test_whatever_stops_it_the_force_is_zero_and_the_log_is_kept(
    players: dict[str, Play], tmp_path: Path, case: str, language: str
) -> None:
    limits, fault, words, sample = STOPS[case]
    device = SteppedDevice(named_rig("homerehab"), fault)
    log, end = players[language](device, plan_file(tmp_path, PUSH), limits)
    assert re.search(words, end)
    assert device.force == 0.0
    rows = rows_of(log)
    seen = sample or len(rows) - 1
    assert 50 < seen <= len(rows) <= seen + 1
    np.testing.assert_allclose(rows[:seen, 1], PUSH[:seen], atol=1e-9)
    np.testing.assert_array_equal(rows[seen:, 1], 0.0)
    np.testing.assert_allclose(rows[:, 2], device.readings[: len(rows)], atol=1e-12)
    # It stops at the first reading beyond a limit, not before and not after.
    moved = np.abs(rows[:, 2] - rows[0, 2])
    if case == "too far":
        assert moved[-1] > limits["travel"]
        assert moved[:-1].max() <= limits["travel"]
    speed = np.abs(rows[10:, 2] - rows[:-10, 2]) / 0.01
    if case == "too fast":
        assert speed[-1] > limits["speed"] >= speed[:-1].max()


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_amplifier_that_takes_no_zero_is_told_at_once(
    players: dict[str, Play], tmp_path: Path, language: str
) -> None:
    device = SteppedDevice(named_rig("homerehab"), Fault(write_fails_from=300))
    log, end = players[language](device, plan_file(tmp_path, PUSH), WIDE)
    assert "ZERO FORCE COULD NOT BE WRITTEN" in end
    assert len(rows_of(log)) == 300


#: What fills in the C program: a device that stands still, and one more sample of its clock.
_STILL_C = {
    "    *position = 0.0;\n    return -1; /* fill in */": "    *position = 0.25;\n    return 0;",
    "    (void)force;\n    return -1; /* fill in */": "    (void)force;\n    return 0;",
}
_STILL_PYTHON = {
    '        raise NotImplementedError("fill in read_position")': "        return 0.25",
    '        raise NotImplementedError("fill in write_force")': "        return None",
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_program_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, language: str) -> None:
    """As written it drives nothing and says so; filled in, it plays by the clock of the system."""
    monkeypatch.chdir(tmp_path)
    assert haptune("new", "player", "--language", language).code == 0
    source = Path("player.c" if language == "c" else "player.py")
    plan_file(tmp_path, np.sin(np.linspace(0, np.pi, 11)).round(6), 0.05)
    limits = ("--force", "2", "--travel", "0.1", "--speed", "1")

    def ran(*words: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "player.py"]
        if language == "c":
            subprocess.run([compiler(), *FLAGS, "-o", "player", "player.c", "-lm"], check=True)
            program = ["./player"]
        command = [*program, *words]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    empty = ran("force.csv", "log.csv", *limits)
    assert empty.returncode == 1
    assert "CUT THE POWER" in empty.stderr
    text = source.read_text(encoding="utf-8")
    for blank, filled in (_STILL_C if language == "c" else _STILL_PYTHON).items():
        assert text.count(blank) == 1
        text = text.replace(blank, filled)
    source.write_text(text, encoding="utf-8")
    played = ran("force.csv", "log.csv", *limits)
    assert played.returncode == 0, played.stderr
    assert "played to the end; 12 rows" in played.stderr
    rows = rows_of(Path("log.csv").read_text(encoding="utf-8"))
    np.testing.assert_array_equal(rows[:, 2], 0.25)
    # Stamps are read from the clock: never early, and no later than the play would bear.
    lateness = rows[:, 0] - 0.05 * np.arange(12)
    assert lateness.min() > -1e-6
    assert lateness.max() < 0.5
    assert ran("none.csv", "log.csv", *limits).returncode == 2
    assert ran("force.csv", "no/log.csv", *limits).returncode == 2
    assert ran("force.csv", "log.csv").returncode == 2
