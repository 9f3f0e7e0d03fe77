"""The source distribution holds every file of the repository, so that it passes its own tests."""

from __future__ import annotations

import base64
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: What setuptools adds.
MADE = {"PKG-INFO", "setup.cfg"}


def _tracked() -> set[str]:
    """Files under version control; skips where there is none, as in an unpacked distribution."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("no version control here to compare with")
    listed = subprocess.run(
        [git, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {name for name in listed.stdout.split("\0") if (ROOT / name).is_file()}


def test_every_file_under_version_control_is_in_it(tmp_path: Path) -> None:
    tracked = _tracked()
    source = tmp_path / "source"
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    code = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    made = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    (archive,) = tmp_path.glob("haptune-*.tar.gz")
    with tarfile.open(archive) as stored:
        names = [member.name for member in stored.getmembers() if member.isfile()]
    held = {name.partition("/")[2] for name in names}
    assert {name for name in held if ".egg-info/" not in name} - MADE == tracked


def test_a_commit_is_packed_to_the_same_bytes_wherever_it_is_built(tmp_path: Path) -> None:
    _tracked()
    found: list[dict[str, bytes]] = []
    for name, mask, world in (
        ("one", 0o022, {"TZ": "UTC", "LC_ALL": "C", "PYTHONHASHSEED": "1"}),
        ("other", 0o077, {"TZ": "Asia/Tokyo", "LC_ALL": "C.UTF-8", "SOURCE_DATE_EPOCH": "1"}),
    ):
        made = subprocess.run(
            [sys.executable, ROOT / ".ci" / "distributions.py", tmp_path / name],
            cwd=tmp_path,
            env=os.environ | world,
            umask=mask,
            capture_output=True,
            text=True,
            check=False,
        )
        assert made.returncode == 0, made.stderr
        found.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert found[0] == found[1]
    (wheel,) = (tmp_path / "one").glob("*.whl")
    (archive,) = (tmp_path / "one").glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as packed:
        (record,) = (name for name in packed.namelist() if name.endswith("RECORD"))
        rows = [row.split(",") for row in packed.read(record).decode().splitlines()]
        held = {name: packed.read(name) for name in packed.namelist()}
    assert {row[0] for row in rows} == set(held)
    for name, digest, _ in rows:
        if digest:
            told = base64.urlsafe_b64encode(hashlib.sha256(held[name]).digest()).decode()
            assert digest == f"sha256={told.rstrip('=')}"
    with tarfile.open(archive) as stored:
        source = {each.name.partition("/")[2] for each in stored.getmembers()}
        assert len({(each.mtime, each.uid, each.uname) for each in stored.getmembers()}) == 1
    assert {"pyproject.toml", "tests/test_source_distribution.py", ".ci/lock.txt"} <= source
