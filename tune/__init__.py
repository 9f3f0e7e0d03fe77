"""Tuning of haptic effects: the largest perceivable K, B and M that the sampled loop can hold.

The public names load on first use, so that a verdict does not import a solver. Nothing is imported
before, so that the command is ready to be interrupted at once.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # what checkers of types take for true
    from typing import Any

    from tune.certificate.check import CheckReport, check
    from tune.damping_margin import least_damping_ratio, slowest_decay
    from tune.delay_search import DelayMargin, delay_margin
    from tune.effects import Effects
    from tune.errors import (
        CheckFailedError,
        LoopError,
        NoFeasibleEffectError,
        TuneError,
    )
    from tune.loop import Filters, Loop
    from tune.margins import LoopMargins, margins_of
    from tune.optimisation import optimise
    from tune.passivity import Passivity, damping_needed
    from tune.perception import PerceptionTable, Study, default_table, perceived_steps
    from tune.pictures import profile_picture
    from tune.profile import SafeProfile, load_profile
    from tune.response_margins import DiskMargin, disk_margin, phase_margin
    from tune.ripple import CountJump, count_jump, force_ripple, handle_vibration
    from tune.scene import Element, Scene, load_scene
    from tune.stability import gain_interval, is_stable, largest, safe_gain, stable_gains, verdict
    from tune.vibration import ThresholdCurve, default_thresholds, felt_vibration

__all__ = [
    "CheckFailedError",
    "CheckReport",
    "CountJump",
    "DelayMargin",
    "DiskMargin",
    "Effects",
    "Element",
    "Filters",
    "Loop",
    "LoopError",
    "LoopMargins",
    "NoFeasibleEffectError",
    "Passivity",
    "PerceptionTable",
    "SafeProfile",
    "Scene",
    "Study",
    "ThresholdCurve",
    "TuneError",
    "check",
    "count_jump",
    "damping_needed",
    "default_table",
    "default_thresholds",
    "delay_margin",
    "disk_margin",
    "felt_vibration",
    "force_ripple",
    "gain_interval",
    "handle_vibration",
    "is_stable",
    "largest",
    "least_damping_ratio",
    "load_profile",
    "load_scene",
    "margins_of",
    "optimise",
    "perceived_steps",
    "phase_margin",
    "profile_picture",
    "safe_gain",
    "slowest_decay",
    "stable_gains",
    "verdict",
]

_HOMES = {
    "certificate.check": "CheckReport check",
    "damping_margin": "least_damping_ratio slowest_decay",
    "delay_search": "DelayMargin delay_margin",
    "effects": "Effects",
    "errors": "CheckFailedError LoopError NoFeasibleEffectError TuneError",
    "loop": "Filters Loop",
    "margins": "LoopMargins margins_of",
    # Not optimise.py: a submodule of that name would take the place of the function.
    "optimisation": "optimise",
    "passivity": "Passivity damping_needed",
    "pictures": "profile_picture",
    "perception": "PerceptionTable Study default_table perceived_steps",
    "profile": "SafeProfile load_profile",
    "response_margins": "DiskMargin disk_margin phase_margin",
    "ripple": "CountJump count_jump force_ripple handle_vibration",
    "scene": "Element Scene load_scene",
    "stability": "gain_interval is_stable largest safe_gain stable_gains verdict",
    "vibration": "ThresholdCurve default_thresholds felt_vibration",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
