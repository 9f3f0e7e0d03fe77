"""Simulated devices, logs and faults with known truth: what the other packages are tested on.

The public names load on first use, so that listing scenarios does not run a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datasets_synthetic.device import Clock, Faults, Hand, Rig, Vibration, named_rig, rig_of
    from datasets_synthetic.law import Calls, Controller, Servo, VirtualElement
    from datasets_synthetic.rehearsal import Rehearsal, Trial, rehearse
    from datasets_synthetic.scenarios import (
        SCENARIOS,
        ForceSignal,
        Scenario,
        bundled_path,
        fit_to_limits,
        log_text,
        multisine,
        run,
        run_batch,
        scenario_named,
    )
    from datasets_synthetic.simulation import Recording, Truth, simulate

__all__ = [
    "SCENARIOS",
    "Calls",
    "Clock",
    "Controller",
    "Faults",
    "ForceSignal",
    "Hand",
    "Recording",
    "Rehearsal",
    "Rig",
    "Scenario",
    "Servo",
    "Trial",
    "Truth",
    "Vibration",
    "VirtualElement",
    "bundled_path",
    "fit_to_limits",
    "log_text",
    "multisine",
    "named_rig",
    "rehearse",
    "rig_of",
    "run",
    "run_batch",
    "scenario_named",
    "simulate",
]

_HOMES = {
    "device": "Clock Faults Hand Rig Vibration named_rig rig_of",
    "law": "Calls Controller VirtualElement Servo",
    "rehearsal": "Rehearsal Trial rehearse",
    "scenarios": "SCENARIOS ForceSignal Scenario bundled_path fit_to_limits log_text multisine run"
    " run_batch scenario_named",
    "simulation": "Recording Truth simulate",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
