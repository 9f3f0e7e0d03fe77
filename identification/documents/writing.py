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


def write_text(path: str | os.PathLike[str], text: str) -> str:
    """Write a whole file or nothing; a file that stood there is kept as ``NAME.bak``.

    A symbolic link is followed: what it points to is replaced, the link stays. Permissions are
    kept, and owner and group as far as the system lets this user give files away. At every moment,
    a loss of power included, the file is whole, old or new, and where a backup was a backup is. Of
    two writers at once the last wins.

    Returns:
        A unified diff against what stood there, "" if nothing did or nothing changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    path = Path(path)
    old = write_bytes(path, text.encode("utf-8"))
    if old is None:
        return ""
    before, after = old.decode("utf-8", errors="replace").splitlines(), text.splitlines()
    if max(len(before), len(after)) > _LONGEST_DIFFERENCE:
        return f"{path.name} changed: {len(before)} lines before, {len(after)} now"
    return "\n".join(
        difflib.unified_diff(before, after, f"{path.name} (before)", path.name, lineterm="", n=1)
    )


def write_bytes(path: str | os.PathLike[str], data: bytes) -> bytes | None:
    """Write a whole file or nothing, as `write_text` does, and return what stood there if changed.

    Raises:
        NotWrittenError: with the system's reason; the old file is untouched.
    """
    try:
        target = Path(os.path.realpath(path))
        old = _standing(target)
        if old is not None and old.content == data:
            return None
        with _name_beside(target) as fresh:
            _create(fresh, data, like=None if old is None else old.status)
            if old is not None:
                _keep(target)
            fresh.replace(target)
        _sync_folder(target.parent)
    except OSError as error:
        raise NotWrittenError(Path(path), error.strerror or str(error)) from None
    return None if old is None else old.content


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


def _keep(target: Path) -> None:
    """Put what stands there in the place of its backup, in one step: there always is a backup."""
    backup = target.with_name(target.name + ".bak")
    try:
        with _name_beside(target) as kept:
            try:
                os.link(target, kept)
            except OSError:  # a file system without hard links, or a file of someone else
                shutil.copy2(target, kept)
            kept.replace(backup)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"its backup {backup.name} cannot be kept: {reason}") from None


def _sync_folder(folder: Path) -> None:
    """Force the new names to the disk, where the system can do that with a folder."""
    if sys.platform != "win32":
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
