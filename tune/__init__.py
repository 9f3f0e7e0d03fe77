"""Tuning of haptic effects: the largest perceivable K, B and M that the sampled loop can hold.

The public names load on first use, so that a verdict does not import a solver.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tune.certificate.check import CheckReport as CheckReport
    from tune.certificate.check import check as check
    from tune.effects import Effects as Effects
    from tune.errors import CheckFailedError as CheckFailedError
    from tune.errors import LoopError as LoopError
    from tune.errors import NoFeasibleEffectError as NoFeasibleEffectError
    from tune.errors import SceneError as SceneError
    from tune.errors import TuneError as TuneError
    from tune.loop import Filters as Filters
    from tune.loop import Loop as Loop
    from tune.optimise import optimise as optimise
    from tune.passivity import damping_needed as damping_needed
    from tune.perception import PerceptionTable as PerceptionTable
    from tune.perception import Study as Study
    from tune.perception import default_table as default_table
    from tune.perception import perceived_steps as perceived_steps
    from tune.profile import SafeProfile as SafeProfile
    from tune.profile import load_profile as load_profile
    from tune.ripple import force_ripple as force_ripple
    from tune.scene import Element as Element
    from tune.scene import Scene as Scene
    from tune.scene import load_scene as load_scene
    from tune.stability import gain_interval as gain_interval
    from tune.stability import is_stable as is_stable
    from tune.stability import largest as largest
    from tune.stability import safe_gain as safe_gain
    from tune.stability import stable_gains as stable_gains
    from tune.stability import verdict as verdict

_HOMES = {
    "certificate.check": "CheckReport check",
    "effects": "Effects",
    "errors": "CheckFailedError LoopError NoFeasibleEffectError SceneError TuneError",
    "loop": "Filters Loop",
    "optimise": "optimise",
    "passivity": "damping_needed",
    "perception": "PerceptionTable Study default_table perceived_steps",
    "profile": "SafeProfile load_profile",
    "ripple": "force_ripple",
    "scene": "Element Scene load_scene",
    "stability": "gain_interval is_stable largest safe_gain stable_gains verdict",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = sorted(_HOME_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
