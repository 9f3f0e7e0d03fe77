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
    from identification.device.quantities import AnyQuantity, Box, Quantity, quantity
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
        write_text,
    )
    from identification.errors import (
        Finding,
        IdentificationError,
        InvalidInputError,
        LogRefusedError,
        NotWrittenError,
        Unstated,
        UnstatedError,
        UsageError,
    )
<<<<<<< HEAD
    from identification.estimators import METHODS, Method
    from identification.figure import NotebookFigure, legend_above
    from identification.fitting.one_log import LogFit
    from identification.pictures.fit import fit_picture
    from identification.pictures.identified import identified_picture, log_picture
    from identification.planning.excitation import Excitation, plan_excitation
    from identification.planning.planned_force import excitation_picture, force_text
    from identification.planning.spec import ExcitationSpec
    from identification.planning.two_stage import load_excitation
    from identification.plant import Plant
    from identification.readers import LogColumns, load_trajectory
    from identification.trajectory import Motion, Trajectory
=======
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
>>>>>>> hc

#: Public names by module. No module has the name of a function (so _identify): once loaded,
#: it would take the function's place.
_HOMES = {
    "_identify": "Examination Identification examine identify",
    "device.device": (
        "ByDirection Covariance Device Gravity LogRecord SlopeRange UnmodelledForce load_device "
        "named_devices"
    ),
    "device.hardware": "Fact ForceLimit Hardware Mode",
    "device.quantities": "AnyQuantity Box Quantity quantity",
    "documents": (
        "Document Replaced as_stored difference_of load_document load_mapping parse_document "
        "round_to_digits to_mapping to_yaml write_bytes write_text"
    ),
    "errors": (
        "Finding IdentificationError InvalidInputError LogRefusedError NotWrittenError Unstated "
        "UnstatedError UsageError"
    ),
    "estimators": "METHODS Method",
<<<<<<< HEAD
=======
    "examination": "Examination examine",
    "planning.excitation": "Excitation excitation_picture force_text plan_excitation",
    "planning.limits": "ExcitationSpec load_excitation",
    "pictures": "fit_picture identified_picture log_picture",
>>>>>>> hc
    "figure": "NotebookFigure legend_above",
    "fitting.one_log": "LogFit",
<<<<<<< HEAD
    "pictures.fit": "fit_picture",
    "pictures.identified": "identified_picture log_picture",
    "planning.excitation": "Excitation plan_excitation",
    "planning.planned_force": "excitation_picture force_text",
    "planning.spec": "ExcitationSpec",
    "planning.two_stage": "load_excitation",
=======
>>>>>>> hc
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
