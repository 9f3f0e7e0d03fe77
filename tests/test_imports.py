"""The one direction of data, read from the imports themselves."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("identification", "tune", "datasets_synthetic")


def _imports(path: Path) -> set[str]:
    """Full dotted names imported by a file, ``from a import b`` as a.b."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def _files(package: str) -> list[Path]:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    return files


def _ours(path: Path) -> set[str]:
    return {name for name in _imports(path) if name.split(".")[0] in PACKAGES}


@pytest.mark.parametrize("path", _files("identification"), ids=str)
def test_identification_imports_nothing_of_ours(path: Path) -> None:
    assert {name.split(".")[0] for name in _ours(path)} <= {"identification"}


@pytest.mark.parametrize("path", _files("tune"), ids=str)
def test_tune_imports_public_names_of_identification_only(path: Path) -> None:
    import identification

    for name in _ours(path):
        package, _, rest = name.partition(".")
        if package == "identification":
            assert rest in identification.__all__, f"{path} reaches into {name}"
        if package == "datasets_synthetic":
            assert path.name in {"demo.py", "rehearse.py", "simulate.py"}, f"{path} imports {name}"


@pytest.mark.parametrize("path", _files("datasets_synthetic"), ids=str)
def test_the_simulator_shares_no_algebra(path: Path) -> None:
    allowed = {
        "identification.Device",
        "identification.Hardware",
        "identification.InvalidInputError",
        "identification.Trajectory",
        "identification.load_device",
        "identification.to_yaml",
    }
    outside = {n for n in _ours(path) if not n.startswith("datasets_synthetic")}
    assert outside <= allowed


@pytest.mark.parametrize("path", _files("tune/certificate"), ids=str)
def test_the_certificate_shares_no_algebra_with_what_it_checks(path: Path) -> None:
    allowed = (
        "tune.certificate",
        "tune.documents.certified",
        "tune.documents.errors",
        "tune.documents.profile",
    )
    for name in _ours(path):
        assert name.startswith(allowed), f"{path} imports {name}"


def test_the_certificate_shares_no_algebra_when_it_runs() -> None:
    """Nor through what it imports: no plant, loop, criterion or ripple is loaded to check."""
    code = (
        "import sys, tune.certificate.check, tune.certificate.certify\n"
        "bad = [n for n in ('identification.plant', 'tune.loop.loop', 'tune.stability.verdict',"
        " 'tune.stability.criterion', 'tune.rendering.ripple', 'tune.optimisation.limits')"
        " if n in sys.modules]\n"
        "sys.exit(', '.join(bad) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
