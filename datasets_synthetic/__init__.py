"""Simulated devices, logs and faults with known truth: what the other packages are tested on.

The public names load on first use, so that listing scenarios does not run a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datasets_synthetic.bouncing import Bounces, bounce
    from datasets_synthetic.bundle import bundled_path, log_text
    from datasets_synthetic.calls import Calls
    from datasets_synthetic.clock import Clock
    from datasets_synthetic.controller import Controller, Element, Servo
    from datasets_synthetic.devices import named_rig, rig_of
    from datasets_synthetic.excitation import Excitation, fit_to_limits, multisine
    from datasets_synthetic.faults import Faults
    from datasets_synthetic.hand import Hand
    from datasets_synthetic.recording import Recording, Truth
    from datasets_synthetic.rehearsal import Rehearsal, Trial, rehearse
    from datasets_synthetic.rig import Rig
    from datasets_synthetic.scenarios import (
        SCENARIOS,
        Scenario,
        run,
        run_batch,
        scenario_named,
    )
    from datasets_synthetic.simulation import simulate
    from datasets_synthetic.vibration import Vibration

__all__ = [
    "SCENARIOS",
    "Bounces",
    "Calls",
    "Clock",
    "Controller",
    "Element",
    "Excitation",
    "Faults",
    "Hand",
    "Recording",
    "Rehearsal",
    "Rig",
    "Scenario",
    "Servo",
    "Trial",
    "Truth",
    "Vibration",
    "bounce",
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
    "bouncing": "Bounces bounce",
    "bundle": "bundled_path log_text",
    "calls": "Calls",
    "clock": "Clock",
    "controller": "Controller Element Servo",
    "devices": "named_rig rig_of",
    "excitation": "Excitation fit_to_limits multisine",
    "faults": "Faults",
    "hand": "Hand",
    "recording": "Recording Truth",
    "rehearsal": "Rehearsal Trial rehearse",
    "rig": "Rig",
    "scenarios": "SCENARIOS Scenario run run_batch scenario_named",
    "simulation": "simulate",
    "vibration": "Vibration",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
