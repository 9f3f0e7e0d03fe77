"""haptune: from a logged trajectory to a safe haptic controller profile.

The eight verbs and the documents they take and give; `identification` and `tune` have the rest.
Names load on first use, so that importing this costs nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # what checkers of types take for true
    from types import ModuleType
    from typing import Any

    from identification import Device, Hardware, Trajectory, identify, load_device, load_trajectory
    from tune import (
        Effects,
        Filters,
        SafeProfile,
        Scene,
        audit,
        calibrate,
        check,
        export,
        load_profile,
        load_scene,
        optimise,
        study,
        verify,
    )

__all__ = ["audit", "calibrate", "check", "export", "identify", "optimise", "study", "verify"]
__all__ += ["Device", "Effects", "Filters", "Hardware", "SafeProfile", "Scene", "Trajectory"]
__all__ += ["load_device", "load_profile", "load_scene", "load_trajectory"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        import identification

        tune = own_tune()
        return getattr(tune if name in tune.__all__ else identification, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


def own_tune() -> ModuleType:
    """The package ``tune`` of haptune; another project installs one of that name too.

    Raises:
        ImportError: the other project's stands in its place.
    """
    import tune

    if "optimise" not in getattr(tune, "__all__", ()):
        raise ImportError(
            f"{tune.__file__} belongs to another project that installs a package named tune. "
            "Install haptune into a virtual environment of its own"
        )
    return tune
