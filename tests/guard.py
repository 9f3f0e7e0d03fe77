"""An exported C guard, compiled and driven by the compiler of the system; the law in Python."""

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import yaml

from tune import SafeProfile, export

STATUS = (
    "OK",
    "WAITING",
    "NOT_TOGETHER",
    "NOT_ENTERED",
    "NO_SIDE",
    "NOT_FINITE",
    "BAD_GAIN",
    "STALE",
    "GLITCH",
    "LATE",
    "PUSHING",
    "TOO_NARROW",
)
FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]

#: One guard behind functions that a foreign program can call.
_DOOR = """\
#include "haptune_guard.h"

static haptune_guard guard;

void door_init(void)
{
    haptune_init(&guard);
}

int door_reset(uint64_t elements, double rest, int side)
{
    return (int)haptune_reset(&guard, elements, rest, side);
}

double door_force(
    uint64_t elements, uint32_t period, double position, double gain, uint32_t *counts)
{
    const double force = haptune_force(&guard, elements, period, position, gain);
    counts[0] = (uint32_t)guard.status;
    counts[1] = (uint32_t)guard.clamped;
    counts[2] = guard.missed;
    counts[3] = guard.glitches;
    return force;
}

double door_level(unsigned index)
{
    return guard.contacts[index].level;
}
"""

#: The guard of several axes behind such functions.
_DOOR_OF_AXES = """\
#include "haptune_guard.h"

static haptune_axes device;

void door_init(void)
{
    haptune_axes_init(&device);
}

int door_enter(uint64_t elements)
{
    return (int)haptune_axes_enter(&device, elements);
}

int door_place(unsigned face, uint64_t element, const double *normal, double offset)
{
    return (int)haptune_axes_place(&device, face, element, normal, offset);
}

int door_force(uint64_t elements, uint32_t faces, uint32_t period, const double *position,
    double gain, double *force, uint32_t *counts)
{
    const haptune_status status = haptune_axes_force(
        &device, elements, faces, period, position, gain, force);
    counts[0] = (uint32_t)device.clamped;
    counts[1] = device.missed;
    counts[2] = device.glitches;
    return (int)status;
}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """What one call left behind."""

    status: str
    force: Any = 0.0  # of several axes an array, (axes,)
    clamped: bool = False
    missed: int = 0
    glitches: int = 0


@dataclass(frozen=True, slots=True)
class Enter:
    """haptune_reset."""

    elements: int
    rest: float = 0.0
    side: int = 0


@dataclass(frozen=True, slots=True)
class Push:
    """haptune_force."""

    elements: int
    period: int
    position: float
    gain: float = 1.0


enter, push = Enter, Push


class Guard:
    """A compiled guard, called in this process."""

    def __init__(self, library: Path) -> None:
        self._door = ctypes.CDLL(str(library))
        self._door.door_reset.argtypes = [ctypes.c_uint64, ctypes.c_double, ctypes.c_int]
        self._door.door_force.argtypes = [
            ctypes.c_uint64,
            ctypes.c_uint32,
            ctypes.c_double,
            ctypes.c_double,
            ctypes.c_void_p,
        ]
        self._door.door_force.restype = ctypes.c_double
        self._door.door_level.argtypes = [ctypes.c_uint]
        self._door.door_level.restype = ctypes.c_double
        self._counts = (ctypes.c_uint32 * 4)()

    def start(self) -> None:
        """haptune_init."""
        self._door.door_init()

    def call(self, call: Enter | Push) -> Reply:
        """The reply to one call."""
        if isinstance(call, Enter):
            return Reply(status=STATUS[self._door.door_reset(call.elements, call.rest, call.side)])
        force = self._door.door_force(
            call.elements, call.period, call.position, call.gain, self._counts
        )
        status, clamped, missed, glitches = self._counts
        return Reply(
            status=STATUS[status],
            force=force,
            clamped=clamped == 1,
            missed=missed,
            glitches=glitches,
        )

    def level(self, index: int) -> float:
        """How much of an element acts."""
        return self._door.door_level(index)

    def run(self, calls: Iterable[Enter | Push]) -> list[Reply]:
        """The replies to some calls after haptune_init."""
        self.start()
        return [self.call(each) for each in calls]


class GuardOfAxes:
    """A compiled guard of several axes, called in this process."""

    def __init__(self, profile: SafeProfile, folder: Path) -> None:
        folder.mkdir()
        self._door = ctypes.CDLL(str(_built(export(profile, "c"), _DOOR_OF_AXES, folder)))
        self._axes = len(profile.device.axes or ())
        #: The set of each element alone.
        self.bits = {name: 1 << place for place, name in enumerate(profile.elements)}
        numbers, count = ctypes.c_void_p, ctypes.c_uint32
        self._door.door_enter.argtypes = [ctypes.c_uint64]
        self._door.door_place.argtypes = [ctypes.c_uint, ctypes.c_uint64, numbers, ctypes.c_double]
        self._door.door_force.argtypes = [
            *(ctypes.c_uint64, count, count, numbers, ctypes.c_double, numbers, numbers)
        ]

    def start(self) -> None:
        """haptune_axes_init."""
        self._door.door_init()

    def enter(self, elements: int) -> str:
        """haptune_axes_enter."""
        return STATUS[self._door.door_enter(elements)]

    def place(self, face: int, element: int, normal: Sequence[float], offset: float) -> str:
        """haptune_axes_place."""
        pointed = (ctypes.c_double * self._axes)(*normal)
        return STATUS[self._door.door_place(face, element, pointed, offset)]

    def push(
        self, elements: int, faces: int, period: int, position: Sequence[float], gain: float = 1.0
    ) -> Reply:
        """haptune_axes_force."""
        read, force = (ctypes.c_double * self._axes)(*position), (ctypes.c_double * self._axes)()
        counts = (ctypes.c_uint32 * 3)()
        status = self._door.door_force(elements, faces, period, read, gain, force, counts)
        clamped, missed, glitches = counts
        return Reply(
            status=STATUS[status],
            force=np.array(force),
            clamped=clamped == 1,
            missed=missed,
            glitches=glitches,
        )


def module_of(folder: Path, name: str, patch: pytest.MonkeyPatch) -> Any:
    """An exported Python file as a module, found by others of its folder by its name."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    patch.setitem(sys.modules, name, module)
    # Python would take what it compiled of a file as long as this for one of the same second.
    patch.setattr(sys, "dont_write_bytecode", True)
    spec.loader.exec_module(module)
    return module


class InPython:
    """The law of the ROS 2 files, called as a guard is."""

    def __init__(self, profile: SafeProfile) -> None:
        files = export(profile, "ros2")
        self._parameters = parameters_of(files["haptune_params.yaml"])
        self._module = ModuleType("exported_law")
        sys.modules[self._module.__name__] = self._module  # dataclasses look themselves up
        exec(files["haptune_law.py"], self._module.__dict__)  # noqa: S102 - that is what is tested
        self.start()

    def start(self) -> None:
        """As after haptune_init."""
        self.law: Any = self._module.Law(self._parameters)

    def call(self, call: Enter | Push) -> Reply:
        """The reply to one call."""
        names = [name for k, name in enumerate(self.law.names) if call.elements >> k & 1]
        names += ["no element"] * (call.elements >> len(self.law.names) > 0)
        if isinstance(call, Enter):
            return Reply(status=self.law.reset(names, call.rest, call.side).name)
        force = self.law.force(names, call.period, call.position, call.gain)
        return Reply(
            status=self.law.status.name,
            force=force,
            clamped=self.law.clamped,
            missed=self.law.missed,
            glitches=self.law.glitches,
        )

    def level(self, index: int) -> float:
        """How much of an element acts."""
        return self.law.elements[self.law.names[index]].level

    def run(self, calls: Iterable[Enter | Push]) -> list[Reply]:
        """The replies to some calls after a start."""
        self.start()
        return [self.call(each) for each in calls]


def parameters_of(text: str, node: str = "haptune") -> dict[str, Any]:
    """The parameters by full name, as a reader of YAML 1.1 and then a node take them."""

    def flat(content: Mapping[str, Any], place: str) -> Iterator[tuple[str, Any]]:
        for key, item in content.items():
            if isinstance(item, dict):
                yield from flat(item, f"{place}{key}.")
            else:
                yield f"{place}{key}", item

    return dict(flat(yaml.safe_load(text)[node]["ros__parameters"], ""))


def compiler(*names: str) -> str:
    """The first of these compilers there is; skips the test where there is none."""
    found = next((name for name in names if shutil.which(name)), None)
    if found is None:
        pytest.skip(f"no compiler here: none of {', '.join(names)}")
    return found


def write(files: Mapping[str, str], folder: Path) -> None:
    """Put exported files into a folder."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def built(files: Mapping[str, str], folder: Path) -> Guard:
    """Compile without a single warning."""
    return Guard(_built(files, _DOOR, folder))


def _built(files: Mapping[str, str], door: str, folder: Path) -> Path:
    write({**files, "door.c": door}, folder)
    cc = compiler("cc", "gcc", "clang")
    shared = ["-shared", "-fPIC", "door.c", "haptune_guard.c", "-o", "guard.so"]
    subprocess.run([cc, *FLAGS, *shared], cwd=folder, check=True)
    return folder / "guard.so"


def compiles(folder: Path, *flags: str, standard: str = "c99") -> str:
    """What the compiler says to the source alone, "" where it is content."""
    cc = compiler("cc", "gcc", "clang")
    done = subprocess.run(
        [cc, *FLAGS[1:], f"-std={standard}", *flags, "-c", "haptune_guard.c"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stderr if done.returncode else ""
