"""Tuning of haptic effects: the largest perceivable K, B and M that the sampled loop can hold.

The public names load on first use, so that a verdict does not import a solver. Nothing is imported
before, so that the command is ready to be interrupted at once.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # what checkers of types take for true
    from typing import Any

    from tune.certificate.check import CheckReport, check
    from tune.documents import CheckFailedError, LoopError, NoFeasibleEffectError, TuneError
    from tune.documents.perception import PerceptionTable, Scale, default_table
    from tune.documents.profile import SafeProfile, load_profile
    from tune.documents.scene import Effects, Element, Scene, load_scene
    from tune.exporters import export
    from tune.judging import Audit, Change, Comparison, audit, compare
    from tune.loop.loop import Filters, Loop
    from tune.margins import LoopMargins, margins_of
    from tune.optimisation import Alternative, candidates, compare_candidates, optimise, what_if
    from tune.optimisation.calibration import calibrate
    from tune.optimisation.study import study
    from tune.presentation.pictures import profile_picture, profile_sheet, region_picture
    from tune.rendering import count_jump, force_ripple
    from tune.stability.criterion import Passivity, damping_needed
    from tune.stability.verdict import (
        gain_interval,
        is_stable,
        largest,
        safe_gain,
        stable_gains,
        verdict,
    )
    from tune.verification import Verification, verify

__all__ = ["Audit", "Change", "Comparison", "audit", "compare"]
__all__ += ["CheckReport", "check"]
__all__ += ["CheckFailedError", "LoopError", "NoFeasibleEffectError", "TuneError"]
__all__ += ["PerceptionTable", "Scale", "default_table"]
__all__ += ["SafeProfile", "load_profile"]
__all__ += ["Effects", "Element", "Scene", "load_scene"]
__all__ += ["export"]
__all__ += ["Filters", "Loop"]
__all__ += ["LoopMargins", "margins_of"]
__all__ += ["Alternative", "candidates", "compare_candidates", "optimise", "what_if"]
__all__ += ["calibrate", "study"]
__all__ += ["profile_picture", "profile_sheet", "region_picture"]
__all__ += ["count_jump", "force_ripple"]
__all__ += ["Passivity", "damping_needed"]
__all__ += ["gain_interval", "is_stable", "largest", "safe_gain", "stable_gains", "verdict"]
__all__ += ["Verification", "verify"]

#: Public names by module. No module or folder here has the name of a verb (audit, export,
#: optimise): once loaded, it would take the function's place.
_HOMES = {
    "judging": "Audit Change Comparison audit compare",
    "certificate.check": "CheckReport check",
    "documents": "CheckFailedError LoopError NoFeasibleEffectError TuneError",
    "documents.perception": "PerceptionTable Scale default_table",
    "documents.profile": "SafeProfile load_profile",
    "documents.scene": "Effects Element Scene load_scene",
    "exporters": "export",
    "loop.loop": "Filters Loop",
    "margins": "LoopMargins margins_of",
    "optimisation": "Alternative candidates compare_candidates optimise what_if",
    "optimisation.calibration": "calibrate",
    "optimisation.study": "study",
    "presentation.pictures": "profile_picture profile_sheet region_picture",
    "rendering": "count_jump force_ripple",
    "stability.criterion": "Passivity damping_needed",
    "stability.verdict": "gain_interval is_stable largest safe_gain stable_gains verdict",
    "verification": "Verification verify",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
