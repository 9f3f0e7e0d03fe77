"""Source distribution and wheel of a commit: the same bytes wherever and whenever they are built.

    python .ci/distributions.py FOLDER [COMMIT]

Times are the commit's; owners, permissions and order of what is packed are fixed. setuptools (its
version is in the wheel) and Python (its zlib) have to be the same: .ci/build takes those of CI.
"""

from __future__ import annotations

import gzip
import io
import os
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
_BUILD = "import sys, setuptools.build_meta as m; getattr(m, 'build_' + sys.argv[1])(sys.argv[2])"


def main(folder: Path, commit: str = "HEAD") -> list[Path]:
    """Build both into a folder."""
    epoch = int(_git("log", "-1", "--format=%ct", commit))
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        with tarfile.open(fileobj=io.BytesIO(_git("archive", "--format=tar", commit))) as packed:
            packed.extractall(work / "source", filter="data")
        _run(work / "source", "sdist", work, epoch)
        (sdist,) = work.glob("*.tar.gz")
        _repack_sdist(sdist, folder / sdist.name, epoch)
        with tarfile.open(folder / sdist.name) as packed:  # the wheel is of what is given away
            packed.extractall(work, filter="data")
        _run(work / sdist.name.removesuffix(".tar.gz"), "wheel", work, epoch)
        (wheel,) = work.glob("*.whl")
        _repack_wheel(wheel, folder / wheel.name, epoch)
    return [folder / sdist.name, folder / wheel.name]


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout


def _run(source: Path, kind: str, folder: Path, epoch: int) -> None:
    """Let setuptools build one, in a world of its own."""
    world = {"SOURCE_DATE_EPOCH": str(epoch), "TZ": "UTC", "LC_ALL": "C", "PYTHONHASHSEED": "0"}
    done = subprocess.run(
        [sys.executable, "-c", _BUILD, kind, str(folder)],
        cwd=source,
        env=os.environ | world,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"the {kind} was not built:\n{done.stderr}")


def _mode(executable: bool) -> int:
    return 0o755 if executable else 0o644


def _repack_sdist(old: Path, new: Path, epoch: int) -> None:
    with (
        tarfile.open(old) as before,
        new.open("wb") as stream,
        gzip.GzipFile("", "wb", 9, stream, mtime=epoch) as pressed,
        tarfile.open(fileobj=pressed, mode="w", format=tarfile.PAX_FORMAT) as after,
    ):
        for member in sorted(before.getmembers(), key=lambda each: each.name):
            if member.isfile():
                fixed = tarfile.TarInfo(member.name)
                fixed.size, fixed.mtime = member.size, epoch
                fixed.mode = _mode(bool(member.mode & 0o100))
                after.addfile(fixed, before.extractfile(member))


def _repack_wheel(old: Path, new: Path, epoch: int) -> None:
    date = time.gmtime(epoch)[:6]
    with (
        zipfile.ZipFile(old) as before,
        zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as after,
    ):
        for member in before.infolist():  # its order is sorted, what describes it last
            fixed = zipfile.ZipInfo(member.filename, date)
            fixed.create_system = 3
            executable = bool(member.external_attr >> 16 & 0o100)
            fixed.external_attr = (0o100000 | _mode(executable)) << 16
            fixed.compress_type = zipfile.ZIP_DEFLATED
            after.writestr(fixed, before.read(member))


if __name__ == "__main__":
    for made in main(Path(sys.argv[1]), *sys.argv[2:]):
        print(made)
