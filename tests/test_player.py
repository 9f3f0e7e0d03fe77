"""The players: a planned force played on a simulated device is a log that tells its mass."""

import ctypes
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import load_device
from tests.commands import haptune
from tests.exact_axis import Axis, Step, advance, counted
from tests.guard import FLAGS, compiler, module_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """What goes wrong, and from which sample on; by default nothing ever does."""

    nan_from: int = 10**9
    read_fails_from: int = 10**9
    write_fails_from: int = 10**9
    write_fails_times: int = 10**9
    stop_from: int = 10**9
    late_at: int = 10**9
    late: float = 0.0


class SteppedDevice:
    """Rigid axes, of which the last may fail; their clock stands still but for ``wait_until``."""

    def __init__(self, fault: Fault = Fault(), axes: int = 1) -> None:
        self._fault = fault
        self._place, self._speed, self._failed, self._due = np.zeros(axes), np.zeros(axes), 0, 0
        #: What acts still, a sample late; it has friction of 0.8 N.
        self._sent = np.zeros(axes)
        #: Samples gone by, forces written last, and every reading of the last axis.
        self.sample, self.forces = 0, [0.0] * axes
        self.readings: list[float] = []

    def read_positions(self) -> list[float]:
        """The encoders' readings, m."""
        if self._due >= self._fault.read_fails_from:
            raise OSError("the encoder is gone")
        readings = counted(self._place, 6e-6).tolist()
        if self._due >= self._fault.nan_from:
            return [*readings[:-1], float("nan")]
        self.readings.append(readings[-1])
        return readings

    def write_forces(self, forces: list[float]) -> None:
        """The forces from now on, N."""
        fails = self._failed < self._fault.write_fails_times
        if self._due >= self._fault.write_fails_from and fails:
            self._failed += 1
            raise OSError("the amplifier is gone")
        self.forces = forces

    def stop_pressed(self) -> bool:
        """Whether the emergency stop is pressed."""
        return self._due >= self._fault.stop_from

    def wait_until(self, due: float) -> float:
        """Let the device move up to a time, s; returns the time it is."""
        self._due = round(due / STEP)
        late = self._fault.late if self._due == self._fault.late_at else 0.0
        axis = Axis(coulomb=0.8)
        step = Step.of(axis, np.full(self._place.shape, STEP))
        for _ in range(self.sample, round((due + late) / STEP)):
            travel, self._speed = advance(axis, self._speed, self._sent, step)
            self._place = self._place + travel
            self._sent = np.array(self.forces)
            self.sample += 1
        return self.sample * STEP


STEP = 1e-3
#: Plan and limits in, log text and how it ended out.
Play = Callable[[SteppedDevice, Path, dict[str, float]], tuple[str, str]]


def play_in_python(source: Path) -> Play:
    """Plays through the Python player."""
    with pytest.MonkeyPatch.context() as patch:
        module = module_of(source.parent, source.stem, patch)

    def play(device: SteppedDevice, plan: Path, limits: dict[str, float]) -> tuple[str, str]:
        bounds = module.Limits(**limits)
        played = module.play(device, module.load_plan(plan, bounds), bounds, clock=device)
        assert played.switched_off == (not any(device.forces))
        end = played.end or "played to the end"
        return played.text(), end if played.switched_off else "ZERO FORCE COULD NOT BE WRITTEN"

    return play


_Numbers = ctypes.POINTER(ctypes.c_double)
_Read = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int, _Numbers)
_Write = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int, _Numbers)
_Pressed = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)
_Wait = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_double)

#: A file that is played through callbacks, as the player's own main does it with its own.
_BRIDGE = """
#define PLAYER_WITHOUT_MAIN
#include "player.c"

const char *play_file(const char *plan_name, const char *log_name, double force, double travel,
    double speed, double ramp, int (*read_positions)(void *, int, double *),
    int (*write_forces)(void *, int, const double *), int (*stop_pressed)(void *),
    double (*wait_until)(void *, double))
{
    const player_limits limits = { force, travel, speed, ramp };
    const player_device device = { read_positions, write_forces, stop_pressed, wait_until, NULL };
    player_rows plan, log;
    FILE *file = fopen(plan_name, "r");
    const char *problem = player_load(file, &limits, &plan);
    player_end end;
    (void)device_read_positions, (void)device_write_forces, (void)device_stop_pressed;
    fclose(file);
    if (problem) {
        return problem;
    }
    player_rows_new(&log, plan.count + 1, plan.axes);
    end = player_play(&device, &plan, &limits, &log);
    file = fopen(log_name, "w");
    player_write(file, &log);
    fclose(file);
    return player_words[end];
}
"""


def play_in_c(source: Path) -> Play:
    """Plays through the C player, compiled as a library with every warning an error."""
    folder = source.parent
    (folder / "bridge.c").write_text(_BRIDGE, encoding="utf-8")
    shared = ["-shared", "-fPIC", "-o", "bridge.so", "bridge.c", "-lm"]
    subprocess.run([compiler("cc", "gcc"), *FLAGS, *shared], cwd=folder, check=True)
    function = ctypes.CDLL(str(folder / "bridge.so")).play_file
    function.restype = ctypes.c_char_p
    function.argtypes = [ctypes.c_char_p] * 2 + [ctypes.c_double] * 4
    function.argtypes += [_Read, _Write, _Pressed, _Wait]

    def play(device: SteppedDevice, plan: Path, limits: dict[str, float]) -> tuple[str, str]:
        def read(context: object, axes: int, places: Any) -> int:
            try:
                for axis, place in enumerate(device.read_positions()):
                    places[axis] = place
            except OSError:
                return -1
            return 0

        def write(context: object, axes: int, forces: Any) -> int:
            try:
                device.write_forces(forces[:axes])
            except OSError:
                return -1
            return 0

        log = plan.with_suffix(".log.csv")
        end = function(
            str(plan).encode(),
            str(log).encode(),
            limits["force"],
            limits["travel"],
            limits["speed"],
            limits.get("ramp", 0.0),
            _Read(read),
            _Write(write),
            _Pressed(lambda context: int(device.stop_pressed())),
            _Wait(lambda context, due: device.wait_until(due)),
        ).decode()
        return log.read_text(encoding="utf-8") if log.exists() else "", end

    return play


#: Forces of a push and a pull that fade in and out, N: 0.08 m and 0.4 m/s on a device of 3 kg.
_TURN = np.linspace(0, np.pi, 601)
PUSH = np.round(8.0 * np.sin(2 * _TURN) * np.sin(_TURN) ** 2, 9)
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
#: What the columns of so many axes end with.
NAMES = {1: ("",), 2: ("_x", "_y")}


def plan_file(folder: Path, forces: np.ndarray, step: float = STEP, axes: int = 1) -> Path:
    """Of two axes the first gets a hundredth."""
    columns = [step * np.arange(len(forces)), *[0.01 * forces] * (axes - 1), forces]
    path = folder / "force.csv"
    header = ",".join(["time", *(f"force{axis}" for axis in NAMES[axes])])
    np.savetxt(path, np.transpose(columns), "%.12g", ",", header=header, comments="")
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
    return {"c": play_in_c(folder / "player.c"), "python": play_in_python(folder / "player.py")}


def rows_of(log: str, axes: int = 1) -> np.ndarray:
    header, *lines = log.splitlines()
    names = [f"{role}{axis}" for role in ("force", "position") for axis in NAMES[axes]]
    assert header == ",".join(["time", *names])
    return np.array([[float(cell) for cell in line.split(",")] for line in lines])


def test_a_plan_that_is_played_and_logged_tells_mass_and_damping(
    players: dict[str, Play], here: Path
) -> None:
    Path("excitation.yaml").write_text(SPEC, encoding="utf-8")
    assert haptune("excite", "excitation.yaml", "-o", "force.csv").code == 0
    assert haptune("new", "hardware", "--device", "homerehab").code == 0
    limits = {"force": 14.0, "travel": 0.1, "speed": 2.0}
    logs: list[np.ndarray] = []
    for language in LANGUAGES:
        log, end = players[language](SteppedDevice(), Path("force.csv"), limits)
        assert end == "played to the end"
        logs.append(rows_of(log))
        Path(f"{language}.csv").write_text(log, encoding="utf-8")
    np.testing.assert_allclose(*logs, rtol=0, atol=1e-12)
    planned = np.loadtxt("force.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(logs[0][:-1, :2], planned, rtol=0, atol=1e-9)
    identify = ("identify", "c.csv", "--hardware", "hardware.yaml", "--method", "instruments")
    ended = haptune(*identify)
    assert ended.code == 0, ended.err
    device = load_device("device.yaml")
    assert device.mass.low <= 3.0 <= device.mass.high
    assert device.damping.low <= 10.0 <= device.damping.high


#: Limits, what goes wrong, how it ends, and the first sample without force.
STOPS: dict[str, tuple[dict[str, float], Fault, str, int]] = {
    "nothing": (WIDE, Fault(), "played to the end", PUSH.size),
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
@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("case", STOPS)
def test_whatever_stops_it_the_force_is_zero_and_the_log_is_kept(
    players: dict[str, Play], tmp_path: Path, case: str, axes: int, language: str
) -> None:
    """Of two axes the first is hardly pushed, and what happens to the other stops both."""
    limits, fault, words, sample = STOPS[case]
    device = SteppedDevice(fault, axes)
    log, end = players[language](device, plan_file(tmp_path, PUSH, axes=axes), limits)
    assert re.search(words, end)
    assert device.forces == [0.0] * axes
    rows = rows_of(log, axes)
    seen = sample or len(rows) - 1
    assert 50 < seen <= len(rows) <= seen + 1
    np.testing.assert_allclose(rows[:seen, axes], PUSH[:seen], atol=1e-8)
    np.testing.assert_allclose(rows[:seen, 1], PUSH[:seen] * 0.01 ** (axes - 1), atol=1e-8)
    np.testing.assert_array_equal(rows[seen:, 1 : axes + 1], 0.0)
    np.testing.assert_allclose(rows[:, -1], device.readings[: len(rows)], atol=1e-12)
    assert axes == 1 or np.ptp(rows[:, 4]) > 20 * np.ptp(rows[:, 3])
    # It stops at the first reading beyond a limit, not before and not after.
    moved = np.abs(rows[:, -1] - rows[0, -1])
    if case == "too far":
        assert moved[-1] > limits["travel"]
        assert moved[:-1].max() <= limits["travel"]
    speed = np.abs(rows[10:, -1] - rows[:-10, -1]) / 0.01
    if case == "too fast":
        assert speed[-1] > limits["speed"] >= speed[:-1].max()


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(
    "text",
    [
        "time,force_x,force_y\n0,0\n0.001,0\n",
        "time,force_x,force_y\n0,0,0\n0.001,20,0\n0.002,0,0\n",
        "time,force_x,force_y\n0,0,0\n0.001,1,1\n0.002,0,1\n",
        "time,force_x,force_y\n0,0,0\n0.001,1,1N\n0.002,0,0\n",
        "time,force_x,force_y\n0,0,0\n0.001,1,1,5\n0.002,0,0\n",
    ],
)
def test_a_plan_of_other_columns_or_beyond_the_limits_is_not_played(
    players: dict[str, Play], tmp_path: Path, language: str, text: str
) -> None:
    device, plan = SteppedDevice(axes=2), tmp_path / "force.csv"
    plan.write_text(text, encoding="utf-8")
    try:
        log, end = players[language](device, plan, WIDE)
    except ValueError as error:
        log, end = "", str(error)
    assert log == ""
    assert re.search("begin with|number|beyond --force|zero force", end)


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_amplifier_that_takes_no_zero_is_told_at_once(
    players: dict[str, Play], tmp_path: Path, language: str
) -> None:
    device = SteppedDevice(Fault(write_fails_from=300))
    log, end = players[language](device, plan_file(tmp_path, PUSH), WIDE)
    assert "ZERO FORCE COULD NOT BE WRITTEN" in end
    assert len(rows_of(log)) == 300


#: What fills in a program: a device that stands still and keeps every force in a file.
FILLED = {
    "c": (
        ("= 0.0;\n    return PLAYER_FILL_IN;", "= 0.25;\n    return 0;"),
        (
            "(void)context, (void)axes;\n    (void)forces;\n    return PLAYER_FILL_IN;",
            """FILE *file = fopen("forces", "a");
    (void)context, (void)axes;
    fprintf(file, "%g\\n", forces[0]);
    return fclose(file);""",
        ),
    ),
    "python": (
        ('raise NotImplementedError("fill in read_positions")', "return [0.25]"),
        (
            'raise NotImplementedError("fill in write_forces")',
            """with open("forces", "a") as file:
            file.write(f"{forces[0]}\\n")""",
        ),
    ),
}
LIMITS = ("--force", "2", "--travel", "0.1", "--speed", "1")


def written(language: str, filled: int = 2) -> list[str]:
    """The command of a player in the current folder, of whose blanks so many are filled in."""
    assert haptune("new", "player", "--language", language).code == 0
    source = Path("player.c" if language == "c" else "player.py")
    text = source.read_text(encoding="utf-8")
    for blank, code in FILLED[language][:filled]:
        assert text.count(blank) == 1
        text = text.replace(blank, code)
    source.write_text(text, encoding="utf-8")
    if language == "python":
        return [sys.executable, "player.py"]
    cc = compiler("cc", "gcc")
    subprocess.run([cc, *FLAGS, "-o", "player", "player.c", "-lm"], check=True)
    return ["./player"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_program_itself(here: Path, language: str) -> None:
    """As written it drives nothing and says so; filled in, it plays by the clock of the system."""
    plan_file(here, np.sin(np.linspace(0, np.pi, 11)).round(6), 0.05)

    def ran(program: list[str], *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*program, *words], capture_output=True, text=True, check=False)

    for filled, name in enumerate(("read_positions", "write_forces")):
        empty = ran(written(language, filled), "force.csv", "log.csv", *LIMITS)
        assert empty.returncode == 2
        assert re.search(f"no device yet: fill in (device_)?{name}\n", empty.stderr)
        assert not Path("log.csv").exists()
    program = written(language)
    played = ran(program, "force.csv", "log.csv", *LIMITS)
    assert played.returncode == 0, played.stderr
    assert "played to the end; 12 rows" in played.stderr
    rows = rows_of(Path("log.csv").read_text(encoding="utf-8"))
    np.testing.assert_array_equal(rows[:, 2], 0.25)
    # Stamps are read from the clock: never early, and no later than the play would bear.
    lateness = rows[:, 0] - 0.05 * np.arange(12)
    assert lateness.min() > -1e-6
    assert lateness.max() < 0.5
    assert ran(program, "none.csv", "log.csv", *LIMITS).returncode == 2
    assert ran(program, "force.csv", "no/log.csv", *LIMITS).returncode == 2
    assert ran(program, "force.csv", "log.csv").returncode == 2
    # What is no limit is refused before anything moves, with its value.
    for limit in ("nan", "inf", "-1", "0", "100mm", ""):
        for place in (3, 5, 7) if limit == "nan" else (3,):
            changed = [*LIMITS, "--ramp", "0"]
            changed[place] = limit
            refused = ran(program, "force.csv", "none.csv", *changed)
            assert refused.returncode == 2, (changed, refused.stderr)
            assert limit in refused.stderr
    assert not Path("none.csv").exists()


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_terminal_that_goes_leaves_no_force_on(here: Path, language: str) -> None:
    """Whatever asks it to end or to stop, twice as a closed terminal may; the log is kept."""
    program, forces = written(language), Path("forces")
    plan_file(here, np.sin(np.linspace(0, np.pi, 401)).round(6), 0.02)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP"):
        asked = getattr(signal, name)
        forces.write_text("")
        # A parent may have told it not to mind.
        before = signal.signal(asked, signal.SIG_DFL)
        command = [*program, "force.csv", "log.csv", *LIMITS]
        played = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        signal.signal(asked, before)
        end = time.monotonic() + 20
        while time.monotonic() < end and forces.stat().st_size < 30:
            time.sleep(0.01)
        played.send_signal(asked)
        played.send_signal(asked)
        _, told = played.communicate(timeout=20)
        assert played.returncode == 1, name
        assert "stopped: emergency stop" in told
        kept = [float(line) for line in forces.read_text("utf-8").split()]
        assert kept[-1] == 0.0 < kept[-2]
        assert len(rows_of(Path("log.csv").read_text("utf-8"))) == len(kept) - 1
