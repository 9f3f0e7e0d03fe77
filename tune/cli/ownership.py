"""Owner of a file."""

from __future__ import annotations

from pathlib import Path


def owner_of(path: Path) -> str | None:
    """Owner and group of a file by number; None where there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return f"user {status.st_uid}, group {status.st_gid}"
