"""Identification by libraries: scipy's lsim and optimiser, SIPPY, nfoursid.

Each takes a log and its delay in s, a whole number of samples, and gives mass and damping, shape
(2,). What a library does not install with is said, and left out.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lsim

from benchmarks.other_methods import arriving
from identification import Trajectory

FloatArray = NDArray[np.float64]

#: Where searches begin: rate b/m, 1/s; mass 1.
_RATE = 1.0
#: Block rows of a subspace method.
_BLOCKS = 20


def lsim_output_error(trajectory: Trajectory, delay: float) -> FloatArray:
    """scipy.optimize.least_squares on the position that scipy.signal.lsim simulates."""
    place = trajectory.position
    time = trajectory.sample_time * np.arange(place.size)
    force = arriving(trajectory, delay)

    def missed(values: FloatArray) -> FloatArray:
        inverse, rate = np.exp(values[0]), np.exp(values[1])
        system: Any = (
            np.array([[0.0, 1.0], [0.0, -rate]]),
            np.array([[0.0], [inverse]]),
            np.array([[1.0, 0.0]]),
            np.zeros((1, 1)),
        )
        simulate: Any = lsim
        simulated = simulate(system, force - values[2], time, X0=values[3:], interp=False)[1]
        return np.asarray(simulated, dtype=np.float64) - place

    begun = np.array([0.0, np.log(_RATE), 0.0, float(place[0]), 0.0])
    found = least_squares(missed, begun, x_scale="jac", method="trf")
    mass = float(np.exp(-found.x[0]))
    return np.array([mass, mass * float(np.exp(found.x[1]))])


def sippy_output_error(trajectory: Trajectory, delay: float) -> FloatArray:
    """SIPPY's output error model of the differenced position: one pole, fitted by IPOPT."""
    force, speed = _differenced(trajectory, delay)
    model = _sippy(speed, force, "OE", OE_orders=[2, 1, 0], OE_mod="OPT", max_iterations=50)
    numerator = np.asarray(model.G.num[0][0], dtype=np.float64)
    denominator = np.asarray(model.G.den[0][0], dtype=np.float64)
    poles = np.roots(denominator)
    decay = float(np.max(poles.real))
    steady = float(np.sum(numerator) / np.sum(denominator))
    return _from_pole(decay, steady, trajectory.sample_time)


def sippy_subspace(trajectory: Trajectory, delay: float) -> FloatArray:
    """SIPPY's N4SID of order one, of the differenced position."""
    force, speed = _differenced(trajectory, delay)
    model = _sippy(speed, force, "N4SID", SS_fixed_order=1, SS_f=_BLOCKS, SS_p=_BLOCKS)
    return _from_state(model.A, model.B, model.C, trajectory.sample_time)


def nfoursid_subspace(trajectory: Trajectory, delay: float) -> FloatArray:
    """N4SID of order one by nfoursid, of the differenced position."""
    pandas: Any = import_module("pandas")
    module: Any = import_module("nfoursid.nfoursid")
    force, speed = _differenced(trajectory, delay)
    frame = pandas.DataFrame({"force": force, "speed": speed})
    method = module.NFourSID(
        frame, output_columns=["speed"], input_columns=["force"], num_block_rows=_BLOCKS
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        method.subspace_identification()
        model, _ = method.system_identification(rank=1)
    return _from_state(model.a, model.b, model.c, trajectory.sample_time)


def _sippy(place: FloatArray, force: FloatArray, method: str, **options: Any) -> Any:
    sippy: Any = import_module("sippy_unipi")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return sippy.system_identification(place, force, method, **options)


def _differenced(trajectory: Trajectory, delay: float) -> tuple[FloatArray, FloatArray]:
    """Force and speed, m/s, without their means: no model of these libraries has an integrator."""
    force = arriving(trajectory, delay)[1:]
    speed = np.diff(trajectory.position) / trajectory.sample_time
    return force - np.mean(force), speed - np.mean(speed)


def _from_state(A: Any, B: Any, C: Any, step: float) -> FloatArray:
    """Mass and damping of a model with one state."""
    a, b, c = (float(np.asarray(each)[0, 0]) for each in (A, B, C))
    return _from_pole(a, c * b / (1 - a), step)


def _from_pole(decay: float, steady: float, step: float) -> FloatArray:
    """Of the pole e^(-bT/m) and of the speed under a lasting force, 1/b."""
    if not 0 < decay < 1 or steady <= 0:
        return np.full(2, np.nan)
    return np.array([-step / (steady * np.log(decay)), 1 / steady])
