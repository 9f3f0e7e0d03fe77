"""The players that ``haptune new player`` writes, driving a simulated device."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.guard import FLAGS
from tests.stepped_device import SteppedDevice

#: Plan and limits in, log text and how it ended out.
Play = Callable[[SteppedDevice, Path, dict[str, float]], tuple[str, str]]


def python_player(source: Path) -> Any:
    """The Python player as a module."""
    spec = importlib.util.spec_from_file_location("written_player", source)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["written_player"] = module  # dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


def play_in_python(source: Path) -> Play:
    """Plays through the Python player."""
    module = python_player(source)

    def play(device: SteppedDevice, plan: Path, limits: dict[str, float]) -> tuple[str, str]:
        bounds = module.Limits(**limits)
        played = module.play(device, module.load_plan(plan, bounds), bounds, clock=device)
        assert played.switched_off == (device.force == 0.0)
        end = played.end or "played to the end"
        return played.text(), end if played.switched_off else "ZERO FORCE COULD NOT BE WRITTEN"

    return play


_Read = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_double))
_Write = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double)
_Pressed = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)
_Wait = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_double)

#: A file that is played through callbacks, as the player's own main does it with its own.
_BRIDGE = """
#define PLAYER_WITHOUT_MAIN
#include "player.c"

const char *play_file(const char *plan_name, const char *log_name, double force, double travel,
    double speed, double ramp, int (*read_position)(void *, double *),
    int (*write_force)(void *, double), int (*stop_pressed)(void *),
    double (*wait_until)(void *, double));

const char *play_file(const char *plan_name, const char *log_name, double force, double travel,
    double speed, double ramp, int (*read_position)(void *, double *),
    int (*write_force)(void *, double), int (*stop_pressed)(void *),
    double (*wait_until)(void *, double))
{
    const player_limits limits = { force, travel, speed, ramp };
    const player_device device = { read_position, write_force, stop_pressed, wait_until, NULL };
    player_rows plan, log;
    FILE *file = fopen(plan_name, "r");
    const char *problem = player_load(file, &limits, &plan);
    player_end end;
    (void)device_read_position, (void)device_write_force, (void)device_stop_pressed;
    fclose(file);
    if (problem) {
        return problem;
    }
    player_rows_new(&log, plan.count + 1);
    end = player_play(&device, &plan, &limits, &log);
    file = fopen(log_name, "w");
    player_write(file, &log);
    fclose(file);
    return player_words[end];
}
"""


def compiler() -> str:
    """The C compiler of the system; without one the test is skipped."""
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler")
    return found


def play_in_c(source: Path) -> Play:
    """Plays through the C player, compiled as a library with every warning an error."""
    folder = source.parent
    (folder / "bridge.c").write_text(_BRIDGE, encoding="utf-8")
    library = folder / "bridge.so"
    command = [compiler(), *FLAGS, "-shared", "-fPIC", "-o", str(library), "bridge.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    function = ctypes.CDLL(str(library)).play_file
    function.restype = ctypes.c_char_p
    function.argtypes = [ctypes.c_char_p] * 2 + [ctypes.c_double] * 4
    function.argtypes += [_Read, _Write, _Pressed, _Wait]

    def play(device: SteppedDevice, plan: Path, limits: dict[str, float]) -> tuple[str, str]:
        def read(context: object, place: Any) -> int:
            try:
                place[0] = device.read_position()
            except OSError:
                return -1
            return 0

        def write(context: object, force: float) -> int:
            try:
                device.write_force(force)
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
