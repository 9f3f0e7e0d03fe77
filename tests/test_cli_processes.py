"""Commands as processes of their own: what they load, and what of a terminal does not stop them."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.usefixtures("here")

#: Each command exits with 0, or all of it ends with the code of the first that does not.
_LOADED = (
    "import sys; from tune.cli import main\n"
    "for command in sys.argv[1:]:\n"
    "    sys.argv = ['haptune', *command.split()]\n"
    "    try: main()\n"
    "    except SystemExit as ended:\n"
    "        if ended.code: raise\n"
    "print('loaded:', *sys.modules)"
)


def _modules(*commands: str) -> set[str]:
    """Modules loaded when all commands have run one after the other in one process."""
    command = [sys.executable, "-c", _LOADED, *commands]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


def test_help_is_instant() -> None:
    heavy = {"numpy", "scipy", "casadi", "nlopt", "polars", "matplotlib", "ruamel.yaml", "rich"}
    assert not heavy & _modules("--help", "tune --help", "--version")


def test_a_spring_alone_loads_the_solver_of_its_multiplier_only() -> None:
    """Conic programs take the form of matrices of scipy; a check loads neither."""
    heavy = {"casadi", "nlopt", "pysindy", "scipy.optimize", "polars", "matplotlib"}
    Path("scene.yaml").write_text("elements: {wall: {stiffness: max}}", encoding="utf-8")
    loaded = _modules("tune homerehab scene.yaml")
    assert "tune.optimisation" in loaded
    assert not heavy & loaded
    loaded = _modules("check profile.yaml", "export profile.yaml --to c,ros2,chai3d,json")
    assert "tune.certificate.poles" in loaded
    assert not (heavy | {"scipy", "clarabel"}) & loaded


def test_an_audit_loads_no_solver() -> None:
    gains = "--stiffness 1000 --damping 10 --mass 1 --velocity-filter 30 --acceleration-filter 30"
    loaded = _modules(f"audit homerehab {gains}")
    assert "tune.certificate.poles" in loaded
    assert not {"casadi", "nlopt", "pysindy", "scipy.optimize", "scipy.signal"} & loaded
