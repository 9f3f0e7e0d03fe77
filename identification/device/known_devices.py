"""Devices from files, and those that come with haptune."""

from __future__ import annotations

import os
from pathlib import Path

from identification.device.device import Device
from identification.documents.document import load_document
from identification.errors import InvalidInputError

_FOLDER = Path(__file__).parent / "named"


def named_devices() -> tuple[str, ...]:
    """Names of the devices that come with haptune."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def load_device(reference: str | os.PathLike[str]) -> Device:
    """A device from a file, or a named one. Raises InvalidInputError."""
    name, path = os.fspath(reference), Path(reference)
    # The function of os.path also takes names that no file can have.
    if name in named_devices() and not os.path.isfile(path):  # noqa: PTH113
        path = _FOLDER / f"{name}.yaml"
    elif path.suffix == "" and not os.path.exists(path):  # noqa: PTH110
        raise InvalidInputError(
            reference,
            "is neither a file nor a named device",
            f"Named devices: {', '.join(named_devices())}",
        )
    return load_document(Device, path)
