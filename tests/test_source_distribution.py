"""The source distribution holds every file of the repository, so that it passes its own tests."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
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
