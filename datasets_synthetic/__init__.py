"""Simulated devices, logs and faults with known truth: what the other packages are tested on.

The public names load on first use, so that listing scenarios does not run a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datasets_synthetic.bundle import bundled, log_text
    from datasets_synthetic.controller import Controller
    from datasets_synthetic.devices import named_rig, rig_of
    from datasets_synthetic.excitation import Excitation, fit_to_limits, multisine
    from datasets_synthetic.fleet import Fleet, random_devices
    from datasets_synthetic.rig import Faults, Recording, Rig, simulate
    from datasets_synthetic.scenarios import (
        SCENARIOS,
        Scenario,
        run,
        run_batch,
        scenario_named,
    )

__all__ = [
    "SCENARIOS",
    "Controller",
    "Excitation",
    "Faults",
    "Fleet",
    "Recording",
    "Rig",
    "Scenario",
    "bundled",
    "fit_to_limits",
    "log_text",
    "multisine",
    "named_rig",
    "random_devices",
    "rig_of",
    "run",
    "run_batch",
    "scenario_named",
    "simulate",
]

_HOMES = {
    "bundle": "bundled log_text",
    "controller": "Controller",
    "devices": "named_rig rig_of",
    "excitation": "Excitation fit_to_limits multisine",
    "fleet": "Fleet random_devices",
    "rig": "Faults Recording Rig simulate",
    "scenarios": "SCENARIOS Scenario run run_batch scenario_named",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
