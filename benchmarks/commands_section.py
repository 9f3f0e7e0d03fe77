"""Whole commands as multiples of the imports they cannot do without."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median, quantiles

from benchmarks.row import Row
from benchmarks.section import Section

#: Runs of each, in turn.
_TURNS = 11
#: The libraries that all of the work needs, and those of one spring.
_LIBRARIES = "import numpy, casadi, scipy.optimize"
_FEW = "import numpy, flint, typer"
_RUN = "from tune.cli import main; main()"

_TEXT = """\
Commands as they are typed, each a process of its own, on the bundled log and the scene of the
demo, in multiples of a process that only imports numpy, casadi and scipy.optimize (`import`; for
one spring: numpy, flint and typer). Median of 11 runs in turn, so that a slow spell is shared;
quartiles in brackets; time of the processor, user and system.
"""


def measure() -> Section:
    """Times of the commands and of the imports, in turn."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        commands = _prepared(folder)
        times: dict[str, list[float]] = {each: [] for each in commands}
        for turn in range(_TURNS + 1):
            for each, (command, _) in commands.items():
                took = _seconds(command, folder)
                if turn:  # the first fills caches of the system
                    times[each].append(took)
    middle = {each: median(values) for each, values in times.items()}
    ratios: dict[str, float] = {}
    rows: list[Row] = []
    for each, (_, base) in commands.items():
        low, _, high = quantiles(times[each], n=4, method="inclusive")
        words = ""
        if base:
            ratios[f"{each} over {base}"] = ratio = middle[each] / middle[base]
            words = f"{ratio:.2f} times {base}"
        rows.append(Row(what=each, seconds=middle[each], spread=(low, high), error=words))
    return Section(
        name="commands",
        title="Commands: multiples of the imports",
        text=_TEXT,
        rows=tuple(rows),
        ratios=ratios,
    )


def _prepared(folder: Path) -> dict[str, tuple[list[str], str]]:
    """Each command with what it is a multiple of; the files they need are written."""
    from datasets_synthetic import bundled_path

    log, hardware = str(bundled_path("homerehab.csv")), str(bundled_path("homerehab.hardware.yaml"))
    spring = "schema: haptune/scene/1\nname: spring\nelements: {wall: {stiffness: max}}\n"
    (folder / "spring.yaml").write_text(spring, encoding="utf-8")
    _seconds(_haptune("new", "scene", "-o", "scene.yaml"), folder)
    stated = ["--hardware", hardware]
    calibrate = _haptune("calibrate", log, *stated, "--scene", "scene.yaml", "-o", "profile.yaml")
    identify = _haptune("identify", log, *stated, "-o", "device.yaml")
    for command in (calibrate, identify):
        _seconds(command, folder)
    demo = _haptune("tune", "device.yaml", "scene.yaml", "-o", "tuned.yaml")
    one = _haptune("tune", "homerehab", "spring.yaml", "-o", "spring-profile.yaml")
    imports, few = "import", "import of one spring"
    return {
        imports: ([sys.executable, "-c", _LIBRARIES], ""),
        few: ([sys.executable, "-c", _FEW], ""),
        "calibrate": (calibrate, imports),
        "tune, scene of the demo": (demo, imports),
        "identify": (identify, imports),
        "check": (_haptune("check", "profile.yaml"), imports),
        "tune, one spring": (one, few),
    }


def _haptune(*words: str) -> list[str]:
    return [sys.executable, "-c", _RUN, *words]


def _seconds(command: list[str], folder: Path) -> float:
    """Time of the processor of one process and its children."""
    before = os.times()
    # Compiled once and kept, as an installation is.
    kept = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    done = subprocess.run(  # noqa: S603
        command, cwd=folder, env=kept, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[3:])}: {done.stderr[-400:]}")
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
