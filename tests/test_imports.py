"""The one direction of data, read from the imports themselves."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: What people write and read; no algebra.
_DOCUMENTS = ("profile", "scene", "CheckFailedError")
PACKAGES = ("identification", "tune", "datasets_synthetic")


@cache
def _imports(path: Path) -> frozenset[str]:
    """Full dotted names that a file imports: a.b for ``from a import b``, or x.b of a as x."""
    found: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    packages: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if not alias.asname}
            packages |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    within: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in packages:
                found.add(f"{packages[node.value.id]}.{node.attr}")
                within.add(node.value)
        elif isinstance(node, ast.Name) and node.id in packages and node not in within:
            found.add(packages[node.id])
    return frozenset(found)


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
            allowed = {"preparation.py", "profiles.py"}
            assert path.name in allowed, f"{path} imports {name}"


@pytest.mark.parametrize(
    "path", [*_files("datasets_synthetic"), *_files("tests/simulated")], ids=str
)
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
    allowed = ("tune.certificate", "identification.Device", "identification.to_mapping")
    allowed += tuple(f"tune.documents.{name}" for name in _DOCUMENTS)
    for name in _ours(path):
        assert name.startswith(allowed), f"{path} imports {name}"


def test_the_certificate_shares_no_algebra_when_it_runs() -> None:
    """Nor through what it imports: no plant, loop, criterion or ripple is loaded to check."""
    code = (
        "import sys, tune.certificate.check, tune.certificate.certify\n"
        "bad = [n for n in ('identification.plant', 'tune.loop.loop', 'tune.stability.verdict',"
        " 'tune.stability.criterion', 'tune.rendering', 'tune.optimisation.feasibility')"
        " if n in sys.modules]\n"
        "sys.exit(', '.join(bad) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
