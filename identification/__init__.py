"""Identification of a haptic axis: mass and damping from a logged trajectory.

The public names load on first use, so that reading a device file does not import an estimator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification.device import (
        Box as Box,
    )
    from identification.device import (
        Covariance as Covariance,
    )
    from identification.device import (
        Device as Device,
    )
    from identification.device import (
        ForceLimit as ForceLimit,
    )
    from identification.device import (
        Hardware as Hardware,
    )
    from identification.device import (
        LogRecord as LogRecord,
    )
    from identification.device import (
        Quantity as Quantity,
    )
    from identification.device import (
        load_device as load_device,
    )
    from identification.device import (
        named_devices as named_devices,
    )
    from identification.device import (
        quantity as quantity,
    )
    from identification.documents import (
        Document as Document,
    )
    from identification.documents import (
        as_stored as as_stored,
    )
    from identification.documents import (
        load_document as load_document,
    )
    from identification.documents import (
        load_mapping as load_mapping,
    )
    from identification.documents import (
        parse_document as parse_document,
    )
    from identification.documents import (
        rounded as rounded,
    )
    from identification.documents import (
        to_mapping as to_mapping,
    )
    from identification.documents import (
        to_yaml as to_yaml,
    )
    from identification.errors import (
        Finding as Finding,
    )
    from identification.errors import (
        IdentificationError as IdentificationError,
    )
    from identification.errors import (
        InvalidInputError as InvalidInputError,
    )
    from identification.errors import (
        LogRefusedError as LogRefusedError,
    )
    from identification.errors import (
        NotWrittenError as NotWrittenError,
    )
    from identification.errors import (
        UsageError as UsageError,
    )
    from identification.logs import (
        LogColumns as LogColumns,
    )
    from identification.logs import (
        load_trajectory as load_trajectory,
    )
    from identification.one_axis import (
        Identification as Identification,
    )
    from identification.one_axis import (
        identify as identify,
    )
    from identification.one_log import LogFit as LogFit
    from identification.pictures import fit_picture as fit_picture
    from identification.plant import (
        Plant as Plant,
    )
    from identification.trajectory import Trajectory as Trajectory
    from identification.writing import (
        write_bytes as write_bytes,
    )
    from identification.writing import (
        write_text as write_text,
    )

_HOMES = {
    "device": (
        "Box Covariance Device ForceLimit Hardware LogRecord Quantity load_device named_devices "
        "quantity"
    ),
    "documents": (
        "Document as_stored load_document load_mapping parse_document rounded to_mapping to_yaml"
    ),
    "errors": (
        "Finding IdentificationError InvalidInputError LogRefusedError NotWrittenError UsageError"
    ),
    "logs": "LogColumns load_trajectory",
    # Not identify.py: a submodule of that name would take the place of the function.
    "one_axis": "Identification identify",
    "one_log": "LogFit",
    "pictures": "fit_picture",
    "plant": "Plant",
    "trajectory": "Trajectory",
    "writing": "write_bytes write_text",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "Box",
    "Covariance",
    "Device",
    "Document",
    "Finding",
    "ForceLimit",
    "Hardware",
    "Identification",
    "IdentificationError",
    "InvalidInputError",
    "LogColumns",
    "LogFit",
    "LogRecord",
    "LogRefusedError",
    "NotWrittenError",
    "Plant",
    "Quantity",
    "Trajectory",
    "UsageError",
    "as_stored",
    "fit_picture",
    "identify",
    "load_device",
    "load_document",
    "load_mapping",
    "load_trajectory",
    "named_devices",
    "parse_document",
    "quantity",
    "rounded",
    "to_mapping",
    "to_yaml",
    "write_bytes",
    "write_text",
]


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
