"""Simulated devices, logs and faults with known truth: what the other packages are tested on."""

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
    scenario_named,
)
from datasets_synthetic.simulation import Motions, Recording, RigOfAxes, Truth, simulate

__all__ = [
    "SCENARIOS",
    "Calls",
    "Clock",
    "Controller",
    "Faults",
    "ForceSignal",
    "Hand",
    "Motions",
    "Recording",
    "Rehearsal",
    "Rig",
    "RigOfAxes",
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
    "scenario_named",
    "simulate",
]
