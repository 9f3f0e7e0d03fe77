"""Files out: whole or not at all, what stood there kept and the difference shown."""

from __future__ import annotations

import difflib
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from identification.errors import NotWrittenError

#: Lines up to which a difference is shown line by line; logs are longer.
_LONGEST_DIFFERENCE = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class _Standing:
    """A regular file as it stands: its content, its owner and permissions."""

    content: bytes
    status: os.stat_result


@dataclass(frozen=True, slots=True, kw_only=True)
class Replaced:
    """A file that stood where another was written.

    Attributes:
        content: what it held.
        backup: the name under which it is kept.
    """

    content: bytes
    backup: Path


def write_text(path: str | os.PathLike[str], text: str) -> Replaced | None:
    """Write a whole file or nothing; a file that stood there is kept.

    The first backup is ``NAME.bak``, the next ``NAME.bak2``, and so on: none is ever written over.
    A symbolic link is followed: what it points to is replaced, the link stays. Permissions are
    kept, and owner and group as far as the system lets this user give files away. At every moment,
    a loss of power included, the file is whole, old or new. Of two writers at once the last wins.

    Returns:
        What stood there, None if nothing did or nothing changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    return write_bytes(path, text.encode("utf-8"))


def difference_of(path: str | os.PathLike[str], replaced: Replaced, text: str) -> str:
    """The unified diff of a text against what stood in its place, or how long both are."""
    name = Path(path).name
    before = replaced.content.decode("utf-8", errors="replace").splitlines()
    after = text.splitlines()
    if max(len(before), len(after)) > _LONGEST_DIFFERENCE:
        return f"{name} changed: {len(before)} lines before, {len(after)} now"
    return "\n".join(
        difflib.unified_diff(before, after, f"{name} (before)", name, lineterm="", n=1)
    )


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Replaced | None:
    """Write a whole file or nothing, as `write_text` does, and return what stood there if changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    backup = Path(path)
    try:
        target = Path(os.path.realpath(path))
        old = _standing(target)
        if old is not None and old.content == data:
            return None
        with _name_beside(target) as fresh:
            _create(fresh, data, like=None if old is None else old.status)
            if old is not None:
                backup = _keep(target)
            fresh.replace(target)
        _sync_folder(target.parent)
    except OSError as error:
        raise NotWrittenError(Path(path), error.strerror or str(error)) from None
    return None if old is None else Replaced(content=old.content, backup=backup)


def _standing(target: Path) -> _Standing | None:
    """What stands there; nothing but a regular file may be replaced."""
    try:
        status = target.stat()
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise OSError(None, "it is a folder or a device, not a file")
    return _Standing(content=target.read_bytes(), status=status)


@contextmanager
def _name_beside(target: Path) -> Generator[Path]:
    """A name that nothing has, in the same folder; nothing of that name is left behind.

    The name is known before there is a file, so that an interruption cannot come in between.
    """
    path = target.with_name(f".haptune-{secrets.token_hex(8)}")
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _create(path: Path, data: bytes, *, like: os.stat_result | None) -> None:
    """Create a file and force it to the disk, with owner and permissions of another."""
    mode = 0o666 if like is None else 0o600  # what others may not read they cannot read meanwhile

    def opened(name: str, flags: int) -> int:
        return os.open(name, flags, mode)

    with open(path, "xb", opener=opened) as stream:
        stream.write(data)
        stream.flush()
        if like is not None:
            _give(path, like)
            path.chmod(stat.S_IMODE(like.st_mode))
        os.fsync(stream.fileno())


def _give(path: Path, like: os.stat_result) -> None:
    """Owner and group of another file, else its group, else neither: as the system allows."""
    if sys.platform != "win32":
        for owner in (like.st_uid, -1):
            with suppress(OSError):
                os.chown(path, owner, like.st_gid)
                return


def _keep(target: Path) -> Path:
    """Give what stands there a further name, the next backup's, and return that name."""
    newest = _newest_backup(target)
    if newest and _backup(target, newest).samefile(target):
        return _backup(target, newest)  # a kill between the two steps left it so
    number = newest + 1
    while True:
        backup = _backup(target, number)
        try:
            try:
                os.link(target, backup)
            except FileExistsError:  # of another writer at the same time
                number += 1
                continue
            except OSError:  # a file system without hard links, or a file of someone else
                with _name_beside(target) as kept:
                    shutil.copy2(target, kept)
                    kept.replace(backup)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OSError(
                error.errno, f"its backup {backup.name} cannot be kept: {reason}"
            ) from None
        return backup


def _backup(target: Path, number: int) -> Path:
    return target.with_name(f"{target.name}.bak{'' if number == 1 else number}")


def _newest_backup(target: Path) -> int:
    """The highest number of a backup that is there, 0 for none; the first has no number."""
    first = f"{target.name}.bak"
    newest = 0
    for name in os.listdir(target.parent):  # noqa: PTH208 - names alone, however many
        number = name.removeprefix(first)
        if name == first:
            newest = max(newest, 1)
        elif number != name and number.isascii() and number.isdecimal():
            newest = max(newest, int(number))
    return newest


def _sync_folder(folder: Path) -> None:
    """Force the new names to the disk, where the system can do that with a folder."""
    if sys.platform != "win32":
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
