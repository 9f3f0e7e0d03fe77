"""What a run was made on: processor, system's libraries, date."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

#: Whose versions stand beside the numbers.
_PACKAGES = (
    "haptune",
    "numpy",
    "scipy",
    "casadi",
    "nlopt",
    "python-flint",
    "polars",
    "pysindy",
    "control",
    "slycot",
    "sippy_unipi",
    "nfoursid",
)


def machine() -> str:
    """Processor, where the system tells it, architecture and number of cores."""
    about = Path("/proc/cpuinfo")
    lines = about.read_text(encoding="utf-8").splitlines() if about.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or "unnamed processor"
    return f"{name}, {platform.machine()}, {os.cpu_count()} cores"


def versions() -> dict[str, str]:
    """Python's and those of the libraries that are installed."""
    found = {"Python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def today() -> str:
    """The date, UTC."""
    return datetime.now(UTC).date().isoformat()
