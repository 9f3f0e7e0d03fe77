"""Files out under attack: interruptions at any step, full disks, other owners."""

import os
import stat
from pathlib import Path
from typing import NoReturn

import pytest

from identification import NotWrittenError, write_text
from tests.commands import FULL, failing, files
from tests.processes import needs_posix

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize("step", ["os.link", "pathlib.Path.replace"])
def test_an_interruption_at_any_step_leaves_everything_readable(
    step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_text(Path("a.yaml"), "one\n")
    write_text(Path("a.yaml"), "two\n")

    def interrupted(*_: object) -> NoReturn:
        assert Path("a.yaml.bak").read_text(encoding="utf-8") == "one\n"
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(step, interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_text(Path("a.yaml"), "three\n")
    assert Path("a.yaml").read_text(encoding="utf-8") == "two\n"
    write_text(Path("a.yaml"), "three\n")
    assert files() == {"a.yaml", "a.yaml.bak", "a.yaml.bak2"}
    assert Path("a.yaml.bak").read_text(encoding="utf-8") == "one\n"
    assert Path("a.yaml.bak2").read_text(encoding="utf-8") == "two\n"


def test_file_systems_without_links_get_a_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.link", failing(OSError(95, "Operation not supported")))
    for text in ("one\n", "two\n", "three\n"):
        write_text(Path("a.yaml"), text)
    assert Path("a.yaml.bak").read_text(encoding="utf-8") == "one\n"
    assert Path("a.yaml.bak2").read_text(encoding="utf-8") == "two\n"
    assert files() == {"a.yaml", "a.yaml.bak", "a.yaml.bak2"}


def test_a_backup_that_cannot_be_kept_is_named_and_nothing_is_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_text(Path("a.yaml"), "one\n")
    Path("a.yaml.bak").mkdir()

    monkeypatch.setattr("os.link", failing(FULL))
    monkeypatch.setattr("shutil.copy2", failing(FULL))
    with pytest.raises(NotWrittenError, match=r"its backup a\.yaml\.bak2 cannot be kept: No space"):
        write_text(Path("a.yaml"), "two\n")
    assert Path("a.yaml").read_text(encoding="utf-8") == "one\n"
    assert files() == {"a.yaml", "a.yaml.bak"}


def test_a_read_only_file_system_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """There even what is not there cannot be removed."""

    unable = failing(OSError(30, "Read-only file system"))
    with monkeypatch.context() as patched:
        patched.setattr("os.open", unable)
        patched.setattr("pathlib.Path.unlink", unable)
        with pytest.raises(NotWrittenError, match="Read-only file system"):
            write_text(Path("a.yaml"), "one\n")
    assert files() == set()


@needs_posix
def test_what_others_may_not_read_they_cannot_read_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_text(Path("a.yaml"), "one\n")
    Path("a.yaml").chmod(0o640)
    modes: list[int] = []

    def change(path: Path, mode: int) -> None:
        modes.append(stat.S_IMODE(path.stat().st_mode))
        os.chmod(path, mode)  # noqa: PTH101 - the method of the path is what is replaced

    monkeypatch.setattr("pathlib.Path.chmod", change)
    write_text(Path("a.yaml"), "two\n")
    assert modes == [0o600]
    assert stat.S_IMODE(Path("a.yaml").stat().st_mode) == 0o640
