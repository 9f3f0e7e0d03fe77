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

__all__ = ["Clock", "Faults", "Hand", "Rig", "Vibration", "named_rig", "rig_of"]
__all__ += ["Calls", "Controller", "Servo", "VirtualElement"]
__all__ += ["Rehearsal", "Trial", "rehearse"]
__all__ += ["SCENARIOS", "ForceSignal", "Scenario", "bundled_path", "fit_to_limits"]
__all__ += ["log_text", "multisine", "run", "scenario_named"]
__all__ += ["Motions", "Recording", "RigOfAxes", "Truth", "simulate"]
