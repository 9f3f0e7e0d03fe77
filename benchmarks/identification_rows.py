"""Identification: error of each estimator against its time, on logs with known truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.row import Row, best_seconds
from datasets_synthetic import SCENARIOS, run_batch
from identification import Trajectory
from identification.estimators import least_squares, output_error
from identification.estimators.model import Model

FloatArray = NDArray[np.float64]
Method = Callable[[Trajectory, Model, float], FloatArray]

_SEEDS = 20


def _least_squares(log: Trajectory, model: Model, delay: float) -> FloatArray:
    return least_squares.estimate(log, model, delay).values[:2]


def _output_error(log: Trajectory, model: Model, delay: float) -> FloatArray:
    return output_error.estimate(log, model, delay).values[:2]


def _differences(log: Trajectory, model: Model, delay: float) -> FloatArray:
    """What a first script does: differentiate twice, shift the force, solve."""
    step = log.sample_time
    shift = round(delay / step)
    position = log.position
    acceleration = np.diff(position, 2) / step**2
    velocity = (position[2:] - position[:-2]) / (2 * step)
    columns = [acceleration, velocity]
    columns += [np.sign(velocity)] if model.coulomb else []
    columns += [np.ones_like(velocity)] if model.offset else []
    force = np.roll(log.force, shift)[1:-1]
    keep = slice(shift, None)
    table = np.stack(columns, axis=1)[keep]
    found = np.linalg.lstsq(table, force[keep], rcond=None)[0]
    return np.asarray(found[:2], dtype=np.float64)


METHODS: dict[str, Method] = {
    "filtered least squares": _least_squares,
    "output error": _output_error,
    "plain finite differences": _differences,
}


def rows() -> Iterator[Row]:
    """Root mean square errors over seeds, without and with friction and unmodelled force."""
    for name, model in (
        ("homerehab-clean", Model(coulomb=False, offset=True)),
        ("homerehab-friction", Model(coulomb=True, offset=True)),
    ):
        scenario = SCENARIOS[name]
        rig = scenario.rig()
        truth = np.array([float(rig.mass[0]), float(rig.damping[0])])
        delay = float(rig.delay[0])
        recording = run_batch(scenario, list(range(_SEEDS)))
        logs = [recording.trajectory(member) for member in range(_SEEDS)]
        for label, method in METHODS.items():
            found = np.array([method(log, model, delay) for log in logs])
            error = np.sqrt(np.mean((found / truth - 1) ** 2, axis=0))
            yield Row(
                what=f"{label}, {name}, {len(logs[0])} samples",
                seconds=best_seconds(partial(method, logs[0], model, delay), 3),
                error=f"rms over {_SEEDS} seeds: m {error[0]:.1e}, b {error[1]:.1e}",
            )
