"""Tuning of haptic effects: the largest perceivable K, B and M that the sampled loop can hold.

The public names load on first use, so that a verdict does not import a solver.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tune.certificate.check import CheckReport, check
    from tune.effects import Effects
    from tune.errors import (
        CheckFailedError,
        LoopError,
        NoFeasibleEffectError,
        TuneError,
    )
    from tune.loop import Filters, Loop
    from tune.optimisation import optimise
    from tune.passivity import damping_needed
    from tune.perception import PerceptionTable, Study, default_table, perceived_steps
    from tune.pictures import profile_picture
    from tune.profile import SafeProfile, load_profile
    from tune.ripple import force_ripple
    from tune.scene import Element, Scene, load_scene
    from tune.stability import gain_interval, is_stable, largest, safe_gain, stable_gains, verdict

__all__ = [
    "CheckFailedError",
    "CheckReport",
    "Effects",
    "Element",
    "Filters",
    "Loop",
    "LoopError",
    "NoFeasibleEffectError",
    "PerceptionTable",
    "SafeProfile",
    "Scene",
    "Study",
    "TuneError",
    "check",
    "damping_needed",
    "default_table",
    "force_ripple",
    "gain_interval",
    "is_stable",
    "largest",
    "load_profile",
    "load_scene",
    "optimise",
    "perceived_steps",
    "profile_picture",
    "safe_gain",
    "stable_gains",
    "verdict",
]

_HOMES = {
    "certificate.check": "CheckReport check",
    "effects": "Effects",
    "errors": "CheckFailedError LoopError NoFeasibleEffectError TuneError",
    "loop": "Filters Loop",
    # Not optimise.py: a submodule of that name would take the place of the function.
    "optimisation": "optimise",
    "passivity": "damping_needed",
    "pictures": "profile_picture",
    "perception": "PerceptionTable Study default_table perceived_steps",
    "profile": "SafeProfile load_profile",
    "ripple": "force_ripple",
    "scene": "Element Scene load_scene",
    "stability": "gain_interval is_stable largest safe_gain stable_gains verdict",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
