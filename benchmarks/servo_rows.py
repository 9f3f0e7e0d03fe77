"""Logs of a servo: identify beside one filter on both sides and beside other peers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.row import Row, best_seconds
from benchmarks.servo_peers import multiple_shooting, one_filter, output_error, srivc
from datasets_synthetic import Servo, fit_to_limits, multisine, simulate
from identification import Hardware, Trajectory, identify, quantity
from tests.simulated.families import FAMILIES
from tests.simulated.family import Drive, Family

FloatArray = NDArray[np.float64]
Method = Callable[[Trajectory, float], FloatArray]

_SEEDS = 200
#: Peers that take seconds are measured on fewer logs, and not on long ones.
_FEW = 5
_LONG = 10_000
#: Cut-offs of which the best single one is taken, Hz.
_CUT_OFFS = (10.0, 20.0, 40.0)
#: Half range of the path, m; N/m, N·s/m and Hz of the servo.
_TRAVEL, _STIFFNESS, _DAMPING, _CUT_OFF = 0.03, 4000.0, 120.0, 100.0


def servo_family(samples: int) -> Family:
    """The family in closed loop with noise of measurement, of another length."""
    family = FAMILIES["closed-loop-measurement-noise"]

    def drive() -> Drive:
        rig = family.rig
        played = fit_to_limits(rig, multisine(rig, samples), travel=_TRAVEL, force=rig.force_limit)
        exact = replace(rig, encoder_resolution=0.0)
        start = float(played.start[0])
        path = simulate(exact, played.force, position=start).position
        servo = Servo(
            reference=path, stiffness=_STIFFNESS, damping=_DAMPING, velocity_filter_hz=_CUT_OFF
        )
        return Drive(force=np.zeros_like(path), start=start, servo=servo)

    return replace(family, name=f"servo of {samples} samples", drive=drive)


def rows() -> Iterator[Row]:
    """Root mean square errors over seeds, and times of one log."""
    for samples in (5_000, 50_000):
        yield from _rows(servo_family(samples), samples)


def _rows(family: Family, samples: int) -> Iterator[Row]:
    truth = np.array([family.truth["mass"], family.truth["damping"]])
    delay = family.truth["delay"]
    logs = family.logs(range(_SEEDS))
    best, quickest = np.full(2, np.inf), np.inf
    for cut_off in _CUT_OFFS:
        method = partial(one_filter, cut_off=cut_off)
        error, seconds = _measured(method, logs, truth, delay)
        best, quickest = np.minimum(best, error), min(quickest, seconds)
        yield _row(f"one filter at {cut_off:g} Hz", samples, error, seconds, len(logs))
    methods: dict[str, Method] = {
        "auto, delay stated": _stated,
        "auto, delay unknown": _unknown,
        "output error, scipy.optimize": output_error,
        "refined instruments": srivc,
        "multiple shooting, CasADi": multiple_shooting,
    }
    for name, method in methods.items():
        slow = method is multiple_shooting
        if slow and samples > _LONG:
            continue
        some = logs[:_FEW] if slow else logs
        error, seconds = _measured(method, some, truth, delay)
        ratio = error / best
        against = (
            f"{seconds / quickest:.0f} times one filter; errors over those of its best single "
            f"cut-off: m {ratio[0]:.2f}, b {ratio[1]:.2f}"
        )
        yield _row(name, samples, error, seconds, len(some), against)


def _measured(
    method: Method, logs: list[Trajectory], truth: FloatArray, delay: float
) -> tuple[FloatArray, float]:
    """Relative rms errors of mass and damping, shape (2,), and the time of one log, s."""
    found = np.array([method(log, delay) for log in logs])
    error = np.sqrt(np.mean((found / truth - 1) ** 2, axis=0))
    return error, best_seconds(partial(method, logs[0], delay), 3)


def _row(
    name: str, samples: int, error: FloatArray, seconds: float, count: int, against: str = ""
) -> Row:
    return Row(
        what=f"{name}, servo, {samples} samples",
        seconds=seconds,
        error=f"rms over {count} seeds: m {error[0]:.1e}, b {error[1]:.1e}",
        against=against,
    )


def _stated(log: Trajectory, delay: float) -> FloatArray:
    device = identify(log, hardware=Hardware(delay=quantity(delay))).device
    return np.array([device.mass.value, device.damping.value])


def _unknown(log: Trajectory, delay: float) -> FloatArray:
    del delay
    device = identify(log).device
    return np.array([device.mass.value, device.damping.value])
