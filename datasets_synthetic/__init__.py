"""Simulated devices, logs and faults with known truth: what the other packages are tested on.

The public names load on first use, so that listing scenarios does not run a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datasets_synthetic.bouncing import Bounces, bounce
    from datasets_synthetic.bundle import bundled, log_text
    from datasets_synthetic.clock import Clock
    from datasets_synthetic.controller import Controller, Servo
    from datasets_synthetic.devices import named_rig, rig_of
    from datasets_synthetic.excitation import Excitation, fit_to_limits, multisine
    from datasets_synthetic.experiment import Limit, limit_by_experiment
    from datasets_synthetic.families import (
        FAMILIES,
        POSE_FACTORS,
        family_named,
        pose_logs,
        poses,
    )
    from datasets_synthetic.family import Drive, Family
    from datasets_synthetic.faults import Faults
    from datasets_synthetic.fleet import Fleet, random_devices
    from datasets_synthetic.hand import Hand
    from datasets_synthetic.recording import Recording, Truth
    from datasets_synthetic.rehearsal import Rehearsal, Trial, rehearse
    from datasets_synthetic.rig import Rig
    from datasets_synthetic.ripple import ripple_by_simulation
    from datasets_synthetic.scenarios import (
        SCENARIOS,
        Scenario,
        run,
        run_batch,
        scenario_named,
    )
    from datasets_synthetic.simulation import simulate
    from datasets_synthetic.vibration import Vibration
    from datasets_synthetic.wall import Wall

__all__ = [
    "FAMILIES",
    "POSE_FACTORS",
    "SCENARIOS",
    "Bounces",
    "Clock",
    "Controller",
    "Drive",
    "Excitation",
    "Family",
    "Faults",
    "Fleet",
    "Hand",
    "Limit",
    "Recording",
    "Rehearsal",
    "Rig",
    "Scenario",
    "Servo",
    "Trial",
    "Truth",
    "Vibration",
    "Wall",
    "bounce",
    "bundled",
    "family_named",
    "fit_to_limits",
    "limit_by_experiment",
    "log_text",
    "multisine",
    "named_rig",
    "pose_logs",
    "poses",
    "random_devices",
    "rehearse",
    "rig_of",
    "ripple_by_simulation",
    "run",
    "run_batch",
    "scenario_named",
    "simulate",
]

_HOMES = {
    "bouncing": "Bounces bounce",
    "bundle": "bundled log_text",
    "clock": "Clock",
    "controller": "Controller Servo",
    "devices": "named_rig rig_of",
    "excitation": "Excitation fit_to_limits multisine",
    "experiment": "Limit limit_by_experiment",
    "families": "FAMILIES POSE_FACTORS family_named pose_logs poses",
    "family": "Drive Family",
    "faults": "Faults",
    "fleet": "Fleet random_devices",
    "hand": "Hand",
    "recording": "Recording Truth",
    "rehearsal": "Rehearsal Trial rehearse",
    "rig": "Rig",
    "ripple": "ripple_by_simulation",
    "scenarios": "SCENARIOS Scenario run run_batch scenario_named",
    "simulation": "simulate",
    "vibration": "Vibration",
    "wall": "Wall",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
