"""Identification: error of each estimator against its time, on logs with known truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_methods import OTHERS
from benchmarks.row import Row, best_seconds
from datasets_synthetic import SCENARIOS, run_batch
from identification import Hardware, IdentificationError, Trajectory, identify, quantity
from identification.estimators import ESTIMATORS
from identification.estimators.model import Model
from identification.fitting.prepared_log import PreparedLog
from tests.simulated.families import FAMILIES

FloatArray = NDArray[np.float64]
Method = Callable[[Trajectory, Model, float], FloatArray]

_SEEDS = 20
#: The easy ones, by name of the scenario ...
_EASY = ("homerehab-clean", "homerehab-friction")
#: ... and of the families those that part the methods.
_HARD = ("closed-loop-force-noise", "alternating-steps")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """Logs of one device that differ by their noise.

    Attributes:
        name: of the scenario or family.
        logs: one for each seed.
        truth: mass and damping, shape (2,).
        delay: s.
        model: the terms the device has.
    """

    name: str
    logs: Sequence[Trajectory]
    truth: FloatArray
    delay: float
    model: Model


def _cases() -> Iterator[_Case]:
    seeds = list(range(_SEEDS))
    for name in _EASY:
        rig = SCENARIOS[name].rig()
        recording = run_batch(SCENARIOS[name], seeds)
        yield _Case(
            name=name,
            logs=[recording.trajectory(member) for member in seeds],
            truth=np.array([float(rig.mass[0]), float(rig.damping[0])]),
            delay=float(rig.delay[0]),
            model=Model(coulomb=bool(rig.coulomb_friction[0] > 0), offset=True),
        )
    for name in _HARD:
        family = FAMILIES[name]
        yield _Case(
            name=name,
            logs=family.logs(seeds),
            truth=np.array([family.truth["mass"], family.truth["damping"]]),
            delay=family.truth["delay"],
            model=Model(coulomb=family.truth["coulomb_friction"] > 0, offset=True),
        )


def _ours(name: str, log: Trajectory, model: Model, delay: float) -> FloatArray:
    found = PreparedLog.of(log, model, quantity(delay)).fit(name)
    return np.array([found.value("mass"), found.value("damping")])


def _auto(log: Trajectory, model: Model, delay: float) -> FloatArray:
    """The verb itself, which chooses the terms as well as the estimator."""
    del model
    device = identify(log, hardware=Hardware(delay=quantity(delay))).device
    return np.array([device.mass.value, device.damping.value])


def rows() -> Iterator[Row]:
    """Root mean square errors over seeds."""
    methods: dict[str, Method] = {name: partial(_ours, name) for name in ESTIMATORS}
    methods |= {"auto, all of identify": _auto} | OTHERS
    for case in _cases():
        for label, method in methods.items():
            yield _row(case, label, method)


def _row(case: _Case, label: str, method: Method) -> Row:
    found: list[FloatArray] = []
    refusals: list[IdentificationError] = []
    for log in case.logs:
        try:
            found.append(method(log, case.model, case.delay))
        except IdentificationError as refusal:
            refusals.append(refusal)
    what = f"{label}, {case.name}, {len(case.logs[0])} samples"
    if not found:
        return Row(what=what, seconds=0.0, error=f"refused: {str(refusals[0])[:60]}")
    error = np.sqrt(np.mean((np.array(found) / case.truth - 1) ** 2, axis=0))
    text = f"rms over {len(found)} seeds: m {error[0]:.1e}, b {error[1]:.1e}"
    if refusals:
        return Row(what=what, seconds=0.0, error=f"{text}; {len(refusals)} refused")
    action = partial(method, case.logs[0], case.model, case.delay)
    return Row(what=what, seconds=best_seconds(action, 3), error=text)
