"""Identification of a haptic device: mass and damping from a logged trajectory.

The public names load on first use, so that reading a device file does not import an estimator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification._identify import Examination, Identification, examine, identify
    from identification.device.device import (
        ByDirection,
        Device,
        Gravity,
        LogRecord,
        SlopeRange,
        UnmodelledForce,
        load_device,
        named_devices,
    )
    from identification.device.hardware import Fact, ForceLimit, Hardware, Mode
    from identification.device.quantities import (
        AnyQuantity,
        Box,
        Covariance,
        Pose,
        Quantity,
        Tabular,
        quantity,
    )
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
        counted,
        printable,
        typed,
    )
    from identification.estimators import METHODS, Method
    from identification.fitting import LogFit
    from identification.fitting.several_axes import poses_of
    from identification.pictures import (
        NotebookFigure,
        devices_picture,
        draw_directions,
        excitation_picture,
        fit_picture,
        identified_picture,
        legend_above,
        log_picture,
    )
    from identification.planning import Excitation, force_text, plan_excitation
    from identification.planning.limits import ExcitationSpec, load_excitation
    from identification.planning.several_axes import AxesExcitation, plan_axes
    from identification.plant import Plant
    from identification.readers import LOG_ENDINGS, LogColumns, load_log, load_trajectory
    from identification.trajectory import Motion, Trajectories, Trajectory

#: Public names by module. No module has the name of a function (so _identify): once loaded,
#: it would take the function's place.
_HOMES = {
    "_identify": "Examination Identification examine identify",
    "device.device": (
        "ByDirection Device Gravity LogRecord SlopeRange UnmodelledForce load_device named_devices"
    ),
    "device.hardware": "Fact ForceLimit Hardware Mode",
    "device.quantities": "AnyQuantity Box Covariance Pose Quantity Tabular quantity",
    "documents": (
        "Document Replaced as_stored difference_of load_document load_mapping parse_document "
        "round_to_digits to_mapping to_yaml write_bytes write_files write_text"
    ),
    "errors": (
        "Finding IdentificationError InvalidInputError LogRefusedError NotWrittenError "
        "QuestionError Unstated UnstatedError UsageError counted printable typed"
    ),
    "estimators": "METHODS Method",
    "fitting": "LogFit",
    "fitting.several_axes": "poses_of",
    "pictures": (
        "NotebookFigure devices_picture draw_directions excitation_picture fit_picture "
        "identified_picture legend_above log_picture"
    ),
    "planning": "Excitation force_text plan_excitation",
    "planning.limits": "ExcitationSpec load_excitation",
    "planning.several_axes": "AxesExcitation plan_axes",
    "plant": "Plant",
    "readers": "LOG_ENDINGS LogColumns load_log load_trajectory",
    "trajectory": "Motion Trajectories Trajectory",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = ["Examination", "Identification", "examine", "identify"]
__all__ += ["ByDirection", "Covariance", "Device", "Gravity", "LogRecord", "SlopeRange"]
__all__ += ["UnmodelledForce", "load_device", "named_devices"]
__all__ += ["Fact", "ForceLimit", "Hardware", "Mode"]
__all__ += ["AnyQuantity", "Box", "Pose", "Quantity", "Tabular", "quantity"]
__all__ += ["Document", "Replaced", "as_stored", "difference_of", "load_document", "load_mapping"]
__all__ += ["parse_document", "round_to_digits", "to_mapping", "to_yaml", "write_bytes"]
__all__ += ["write_files", "write_text"]
__all__ += ["Finding", "IdentificationError", "InvalidInputError", "LogRefusedError"]
__all__ += ["NotWrittenError", "QuestionError", "Unstated", "UnstatedError", "UsageError"]
__all__ += ["counted", "printable", "typed"]
__all__ += ["METHODS", "Method"]
__all__ += ["LogFit", "poses_of"]
__all__ += ["NotebookFigure", "devices_picture", "draw_directions", "excitation_picture"]
__all__ += ["fit_picture", "identified_picture", "legend_above", "log_picture"]
__all__ += ["AxesExcitation", "Excitation", "force_text", "plan_axes", "plan_excitation"]
__all__ += ["ExcitationSpec", "load_excitation"]
__all__ += ["Plant"]
__all__ += ["LOG_ENDINGS", "LogColumns", "load_log", "load_trajectory"]
__all__ += ["Motion", "Trajectories", "Trajectory"]


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
