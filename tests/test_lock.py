"""What CI installs, and the lower bounds, agree with pyproject.toml on every Python promised."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
SYSTEMS = {"linux": "posix", "darwin": "posix", "win32": "nt"}


def _wanted(python: str, system: str) -> Iterator[Requirement]:
    """What is installed there, extras included."""
    world = {
        "python_version": python,
        "python_full_version": f"{python}.9",
        "sys_platform": system,
        "os_name": SYSTEMS[system],
    }
    extras = itertools.chain(*PROJECT["optional-dependencies"].values())
    for text in (*PROJECT["dependencies"], *extras):
        wanted = Requirement(text)
        if wanted.name != "haptune" and (not wanted.marker or wanted.marker.evaluate(world)):
            yield wanted


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("python", PYTHONS)
def test_the_lock_has_one_version_of_everything(python: str, system: str) -> None:
    world = {"python_full_version": f"{python}.9", "sys_platform": system}
    locked: dict[str, list[str]] = {}
    for line in (ROOT / ".ci" / "lock.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            pin = Requirement(line)
            if not pin.marker or pin.marker.evaluate(world):
                (only,) = pin.specifier
                assert only.operator == "=="
                locked.setdefault(canonicalize_name(pin.name), []).append(only.version)
    assert {len(versions) for versions in locked.values()} == {1}
    for wanted in _wanted(python, system):
        (version,) = locked[canonicalize_name(wanted.name)]
        assert wanted.specifier.contains(version), wanted


@pytest.mark.parametrize("python", PYTHONS)
def test_the_lowest_is_the_highest_bound_that_holds_there(python: str) -> None:
    pytest.importorskip("pip")
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "lowest", python],
        capture_output=True,
        text=True,
        check=True,
    )
    lowest = dict(line.split("==") for line in done.stdout.splitlines())
    test = {Requirement(text).name for text in PROJECT["optional-dependencies"]["test"]}
    base = {Requirement(text).name for text in PROJECT["dependencies"]}
    assert set(lowest) == (test | base) - {"pyright", "ruff", "scipy-stubs"}
    bounds: dict[str, list[str]] = {}
    for wanted in _wanted(python, "linux"):
        (bound,) = wanted.specifier
        bounds.setdefault(wanted.name, []).append(bound.version)
    for name, version in lowest.items():
        assert version == max(bounds[name], key=Version)


def test_ci_runs_on_every_python_promised_and_installs_the_lock() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    matrix = re.search(r"python: \[(.*)\]", workflow)
    assert matrix is not None
    assert tuple(re.findall(r"[\d.]+", matrix[1])) == PYTHONS
    assert f"for python in {' '.join(PYTHONS)}; do" in (ROOT / ".ci" / "lock").read_text()
    assert PROJECT["requires-python"] == f">={PYTHONS[0]}"
    assert "PIP_CONSTRAINT: .ci/lock.txt" in workflow
