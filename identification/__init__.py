"""Identification of a haptic axis: mass and damping from a logged trajectory.

The public names load on first use, so that reading a device file does not import an estimator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification._identify import Examination, Identification, examine, identify
    from identification.device.device import (
        ByDirection,
        Covariance,
        Device,
        Gravity,
        LogRecord,
        SlopeRange,
        UnmodelledForce,
        load_device,
        named_devices,
    )
    from identification.device.hardware import Fact, ForceLimit, Hardware, Mode
    from identification.device.quantities import AnyQuantity, Box, Quantity, Tabular, quantity
    from identification.documents import (
        Document,
        Replaced,
        as_stored,
        difference_of,
        load_document,
        load_mapping,
        parse_document,
        round_to_digits,
        to_mapping,
        to_yaml,
        write_bytes,
        write_files,
        write_text,
    )
    from identification.errors import (
        Finding,
        IdentificationError,
        InvalidInputError,
        LogRefusedError,
        NotWrittenError,
        QuestionError,
        Unstated,
        UnstatedError,
        UsageError,
        printable,
    )
    from identification.estimators import METHODS, Method
    from identification.fitting import LogFit
    from identification.pictures import (
        NotebookFigure,
        devices_picture,
        excitation_picture,
        fit_picture,
        identified_picture,
        legend_above,
        log_picture,
    )
    from identification.planning import Excitation, force_text, plan_excitation
    from identification.planning.limits import ExcitationSpec, load_excitation
    from identification.plant import Plant
    from identification.readers import LogColumns, load_trajectory
    from identification.trajectory import Motion, Trajectory

#: Public names by module. No module has the name of a function (so _identify): once loaded,
#: it would take the function's place.
_HOMES = {
    "_identify": "Examination Identification examine identify",
    "device.device": (
        "ByDirection Covariance Device Gravity LogRecord SlopeRange UnmodelledForce load_device "
        "named_devices"
    ),
    "device.hardware": "Fact ForceLimit Hardware Mode",
    "device.quantities": "AnyQuantity Box Quantity Tabular quantity",
    "documents": (
        "Document Replaced as_stored difference_of load_document load_mapping parse_document "
        "round_to_digits to_mapping to_yaml write_bytes write_files write_text"
    ),
    "errors": (
        "Finding IdentificationError InvalidInputError LogRefusedError NotWrittenError "
        "QuestionError Unstated UnstatedError UsageError printable"
    ),
    "estimators": "METHODS Method",
    "fitting": "LogFit",
    "pictures": (
        "NotebookFigure devices_picture excitation_picture fit_picture identified_picture "
        "legend_above log_picture"
    ),
    "planning": "Excitation force_text plan_excitation",
    "planning.limits": "ExcitationSpec load_excitation",
    "plant": "Plant",
    "readers": "LogColumns load_trajectory",
    "trajectory": "Motion Trajectory",
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
    "QuestionError",
    "Replaced",
    "SlopeRange",
    "Tabular",
    "Trajectory",
    "UnmodelledForce",
    "Unstated",
    "UnstatedError",
    "UsageError",
    "as_stored",
    "devices_picture",
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
    "printable",
    "quantity",
    "round_to_digits",
    "to_mapping",
    "to_yaml",
    "write_bytes",
    "write_files",
    "write_text",
]


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
