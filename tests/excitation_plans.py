"""Specifications of planned forces, and the simulated devices they are for."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Rig
from identification import (
    Excitation,
    ExcitationSpec,
    parse_document,
    plan_excitation,
)

Array = NDArray[np.float64]
STEP = 0.001

LIMITS: dict[str, dict[str, Any]] = {
    "homerehab": {
        "mass": 3.0,
        "damping": 10.0,
        "force": 14.0,
        "travel": 0.1,
        "speed": 1.0,
        "encoder_resolution": 6e-6,
        "position_noise": 3e-6,
    },
    "stylus": {
        "mass": 0.05,
        "damping": 0.2,
        "force": 0.9,
        "travel": 0.05,
        "speed": 0.6,
        "encoder_resolution": 2e-5,
        "position_noise": 1e-5,
    },
    "knob": {
        "motion": "rotary",
        "mass": 1e-4,
        "damping": 5e-4,
        "force": 0.05,
        "travel": 1.0,
        "speed": 15.0,
        "encoder_resolution": 7.7e-4,
        "position_noise": 3.9e-4,
    },
}
#: Hz; what one would try by hand: slow, usual, wide, and about a corner of a hertz or so.
RANGES = ((0.1, 2.0), (0.1, 10.0), (0.2, 20.0), (0.5, 10.0), (1.0, 5.0))


def spec(name: str = "homerehab", duration: float = 4.0, **others: Any) -> ExcitationSpec:
    given = {"sample_time": STEP, "duration": duration, "ramp": 0.3} | LIMITS[name] | others
    return parse_document(ExcitationSpec, given, "spec")


@cache
def planned(name: str, duration: float = 3.0, friction: float = 0.0) -> Excitation:
    return plan_excitation(spec(name, duration, coulomb_friction=friction))


def rig_of(plan: ExcitationSpec, **others: Any) -> Rig:
    given: dict[str, Any] = {
        "mass": plan.mass.value,
        "damping": plan.damping.value,
        "coulomb_friction": plan.coulomb_friction.value,
        "sample_time": plan.sample_time,
    }
    return Rig(**(given | others))
