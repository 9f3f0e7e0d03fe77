"""Files out: whole or not at all, what stood there kept and the difference shown."""

from __future__ import annotations

import difflib
import os
import shutil
import stat
import tempfile
from pathlib import Path

from identification.errors import NotWrittenError

#: Lines up to which a difference is shown line by line; logs are longer.
_LONGEST_DIFFERENCE = 2000


def write_text(path: str | os.PathLike[str], text: str) -> str:
    """Write a whole file or nothing; a file that stood there is kept as ``NAME.bak``.

    A symbolic link is followed: what it points to is replaced, the link stays.

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
    temporary: Path | None = None
    try:
        target = Path(os.path.realpath(path))
        old = _regular(target)
        if old == data:
            return None
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        temporary = Path(name)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if old is None:
            temporary.chmod(0o666 & ~_umask())
        else:
            shutil.copymode(target, temporary)
            _keep(target, target.with_name(target.name + ".bak"))
        temporary.replace(target)
    except OSError as error:
        raise NotWrittenError(Path(path), error.strerror or str(error)) from None
    finally:  # an interruption leaves nothing behind either
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return old


def _regular(target: Path) -> bytes | None:
    """What stands there; nothing but a regular file may be replaced."""
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(mode):
        raise OSError(None, "it is a folder or a device, not a file")
    return target.read_bytes()


def _keep(target: Path, backup: Path) -> None:
    backup.unlink(missing_ok=True)
    try:
        os.link(target, backup)
    except OSError:  # a file system without hard links
        shutil.copy2(target, backup)


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
