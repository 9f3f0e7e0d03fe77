"""Commands as processes of their own: what they load, and what of a terminal does not stop them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import FLUID


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")


def _shell(code: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


_LOADED = (
    "import atexit, sys; from tune.cli import main\n"
    "atexit.register(lambda: print('loaded:', *sys.modules))\n"
    "sys.argv[0] = 'haptune'; main()"
)

#: Each command exits with 0, or all of it ends with the code of the first that does not.
_LOADED_BY_SEVERAL = (
    "import sys; from tune.cli import main\n"
    "for command in sys.argv[1:]:\n"
    "    sys.argv = ['haptune', *command.split()]\n"
    "    try: main()\n"
    "    except SystemExit as ended:\n"
    "        if ended.code: raise\n"
    "print('loaded:', *sys.modules)"
)


def _modules(*arguments: str) -> set[str]:
    done = _shell(_LOADED, *arguments)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


def _modules_of_several(*commands: str) -> set[str]:
    """Modules loaded when all commands have run one after the other in one process."""
    done = _shell(_LOADED_BY_SEVERAL, *commands)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


@pytest.mark.parametrize("arguments", [("--help",), ("tune", "--help"), ("--version",)], ids=str)
def test_help_is_instant(arguments: tuple[str, ...]) -> None:
    heavy = {"numpy", "scipy", "casadi", "nlopt", "polars", "matplotlib", "ruamel.yaml", "rich"}
    assert not heavy & _modules(*arguments)


def test_a_spring_alone_loads_the_solver_of_its_multiplier_only() -> None:
    """Conic programs take the form of matrices of scipy; a check loads neither."""
    heavy = {"casadi", "nlopt", "pysindy", "scipy.optimize", "polars", "matplotlib"}
    Path("scene.yaml").write_text("elements: {wall: {stiffness: max}}", encoding="utf-8")
    loaded = _modules("tune", "homerehab", "scene.yaml")
    assert "tune.optimisation" in loaded
    assert not heavy & loaded
    heavy |= {"scipy", "clarabel"}
    both = "check profile.yaml", "export profile.yaml --to c,ros2,chai3d,json"
    loaded = _modules_of_several(*both)
    assert "tune.certificate.poles" in loaded
    assert not heavy & loaded


def test_an_audit_loads_no_solver() -> None:
    gains = "--stiffness 1000 --damping 10 --mass 1 --velocity-filter 30 --acceleration-filter 30"
    loaded = _modules("audit", "homerehab", *gains.split())
    assert "tune.certificate.poles" in loaded
    assert not {"casadi", "nlopt", "pysindy", "scipy.optimize", "scipy.signal"} & loaded
