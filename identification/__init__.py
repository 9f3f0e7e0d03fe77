"""Identification of a haptic axis: mass and damping from a logged trajectory.

The public names load on first use, so that reading a device file does not import an estimator. One
file: the list of public names.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification._identify import (
        Identification as Identification,
    )
    from identification._identify import (
        identify as identify,
    )
    from identification.device.box import (
        Box as Box,
    )
    from identification.device.device import (
        ByDirection as ByDirection,
    )
    from identification.device.device import (
        Device as Device,
    )
    from identification.device.device import (
        Gravity as Gravity,
    )
    from identification.device.evidence import (
        Covariance as Covariance,
    )
    from identification.device.evidence import (
        LogRecord as LogRecord,
    )
    from identification.device.friction import (
        SlopeRange as SlopeRange,
    )
    from identification.device.friction import (
        UnmodelledForce as UnmodelledForce,
    )
    from identification.device.hardware import (
        ForceLimit as ForceLimit,
    )
    from identification.device.hardware import (
        Hardware as Hardware,
    )
    from identification.device.hardware import Mode as Mode
    from identification.device.known_devices import (
        load_device as load_device,
    )
    from identification.device.known_devices import (
        named_devices as named_devices,
    )
    from identification.device.quantities import (
        AnyQuantity as AnyQuantity,
    )
    from identification.device.quantities import (
        Quantity as Quantity,
    )
    from identification.device.quantities import (
        quantity as quantity,
    )
    from identification.device.stated import Fact as Fact
    from identification.documents.document import Document as Document
    from identification.documents.document import as_stored as as_stored
    from identification.documents.document import load_document as load_document
    from identification.documents.document import parse_document as parse_document
    from identification.documents.document import round_to_digits as round_to_digits
    from identification.documents.document import to_mapping as to_mapping
    from identification.documents.writing import (
        Replaced as Replaced,
    )
    from identification.documents.writing import (
        difference_of as difference_of,
    )
    from identification.documents.writing import (
        write_bytes as write_bytes,
    )
    from identification.documents.writing import (
        write_text as write_text,
    )
    from identification.documents.yaml_reading import load_mapping as load_mapping
    from identification.documents.yaml_writing import to_yaml as to_yaml
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
        Unstated as Unstated,
    )
    from identification.errors import (
        UnstatedError as UnstatedError,
    )
    from identification.errors import (
        UsageError as UsageError,
    )
    from identification.estimators import (
        METHODS as METHODS,
    )
    from identification.estimators import (
        Method as Method,
    )
    from identification.examination import (
        Examination as Examination,
    )
    from identification.examination import (
        examine as examine,
    )
    from identification.figure import NotebookFigure as NotebookFigure
    from identification.figure import legend_above as legend_above
    from identification.fitting.one_log import LogFit as LogFit
    from identification.pictures import fit_picture as fit_picture
    from identification.pictures import identified_picture as identified_picture
    from identification.pictures import log_picture as log_picture
    from identification.planning.excitation import (
        Excitation as Excitation,
    )
    from identification.planning.excitation import excitation_picture as excitation_picture
    from identification.planning.excitation import force_text as force_text
    from identification.planning.excitation import (
        plan_excitation as plan_excitation,
    )
    from identification.planning.limits import (
        ExcitationSpec as ExcitationSpec,
    )
    from identification.planning.limits import load_excitation as load_excitation
    from identification.plant import (
        Plant as Plant,
    )
    from identification.readers.logs import (
        LogColumns as LogColumns,
    )
    from identification.readers.logs import (
        load_trajectory as load_trajectory,
    )
    from identification.trajectory import Motion as Motion
    from identification.trajectory import Trajectory as Trajectory

#: Public names by module. No module has the name of a function (so _identify): once loaded,
#: it would take the function's place.
_HOMES = {
    "device.box": "Box",
    "device.device": "ByDirection Device Gravity",
    "device.evidence": "Covariance LogRecord",
    "documents.document": (
        "Document as_stored load_document parse_document round_to_digits to_mapping"
    ),
    "documents.yaml_reading": "load_mapping",
    "documents.yaml_writing": "to_yaml",
    "errors": (
        "Finding IdentificationError InvalidInputError LogRefusedError NotWrittenError "
        "Unstated UnstatedError UsageError"
    ),
    "estimators": "METHODS Method",
    "examination": "Examination examine",
    "planning.excitation": "Excitation excitation_picture force_text plan_excitation",
    "planning.limits": "ExcitationSpec load_excitation",
    "pictures": "fit_picture identified_picture log_picture",
    "figure": "NotebookFigure legend_above",
    "device.hardware": "ForceLimit Hardware Mode",
    "device.known_devices": "load_device named_devices",
    "readers.logs": "LogColumns load_trajectory",
    "device.friction": "SlopeRange UnmodelledForce",
    "_identify": "Identification identify",
    "fitting.one_log": "LogFit",
    "plant": "Plant",
    "device.quantities": "AnyQuantity Quantity quantity",
    "device.stated": "Fact",
    "trajectory": "Motion Trajectory",
    "documents.writing": "Replaced difference_of write_bytes write_text",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "METHODS",
    "AnyQuantity",
    "Box",
    "ByDirection",
    "Covariance",
    "Device",
    "Document",
    "Examination",
    "Excitation",
    "ExcitationSpec",
    "Fact",
    "Finding",
    "ForceLimit",
    "Gravity",
    "Hardware",
    "Identification",
    "IdentificationError",
    "InvalidInputError",
    "LogColumns",
    "LogFit",
    "LogRecord",
    "LogRefusedError",
    "Method",
    "Mode",
    "Motion",
    "NotWrittenError",
    "NotebookFigure",
    "Plant",
    "Quantity",
    "Replaced",
    "SlopeRange",
    "Trajectory",
    "UnmodelledForce",
    "Unstated",
    "UnstatedError",
    "UsageError",
    "as_stored",
    "difference_of",
    "examine",
    "excitation_picture",
    "fit_picture",
    "force_text",
    "identified_picture",
    "identify",
    "legend_above",
    "load_device",
    "load_document",
    "load_excitation",
    "load_mapping",
    "load_trajectory",
    "log_picture",
    "named_devices",
    "parse_document",
    "plan_excitation",
    "quantity",
    "round_to_digits",
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
