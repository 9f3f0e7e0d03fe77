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


def _modules(package: str) -> dict[str, set[str]]:
    """Every module of a package by its dotted name, with those of the package it imports."""
    paths = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in _files(package)
    }
    found: dict[str, set[str]] = {}
    for module, path in paths.items():
        named = set(_imports(path))
        named |= {name.rpartition(".")[0] for name in named}
        found[module] = (named & paths.keys()) - {module}
    return found


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


@pytest.mark.parametrize("path", _files("tests/simulated"), ids=str)
def test_what_plays_the_simulator_in_tests_takes_nothing_else_of_them(path: Path) -> None:
    found = {name for name in _imports(path) if name.startswith(("tests.", "benchmarks."))}
    assert all(name.startswith(("tests.simulated.", "tests.outside_axis")) for name in found)


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_that_is_installed_imports_tests_or_benchmarks(package: str) -> None:
    for path in _files(package):
        for name in _imports(path):
            assert name.split(".")[0] not in {"tests", "benchmarks"}, f"{path} imports {name}"


def test_no_module_of_the_simulator_is_for_tests_alone() -> None:
    """The commands need every file of it that is installed."""
    import datasets_synthetic

    names = _modules("datasets_synthetic")
    used = {name for path in _files("tune") for name in _ours(path)}
    used = {name.partition(".")[2] for name in used if name.startswith("datasets_synthetic.")}
    waiting: set[str] = {getattr(datasets_synthetic, name).__module__ for name in used}
    reached: set[str] = set()
    while waiting:
        reached |= waiting
        waiting = set().union(*(names[name] for name in waiting)) - reached
    assert reached == names.keys() - {"datasets_synthetic"}


@pytest.mark.parametrize("package", ["datasets_synthetic", "tests/simulated"])
def test_the_simulator_has_no_circle(package: str) -> None:
    left = {name: set(needed) for name, needed in _modules(package).items()}
    left.pop("datasets_synthetic", None)  # loads the others when a name of them is used
    while left:
        free = {name for name, needed in left.items() if not needed & left.keys()}
        assert free, f"circle among {sorted(left)}"
        left = {name: needed for name, needed in left.items() if name not in free}


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
