"""Logs of a servo: identify beside one filter on both sides and beside other peers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.identification_section import identified
from benchmarks.row import Row, best_seconds
from benchmarks.section import Section
from benchmarks.servo_peers import one_filter
from datasets_synthetic import Servo, fit_to_limits, multisine, simulate
from identification import Trajectory
from tests.simulated.families import FAMILIES
from tests.simulated.family import Drive, Family

FloatArray = NDArray[np.float64]
#: Of a log and its delay, s, or None where that is not told.
Method = Callable[[Trajectory, Any], FloatArray]

#: Samples of a log, and how many logs.
_LENGTHS = ((5_000, 200), (50_000, 40))
_TEXT = """\
A device like HomeRehab follows a path by a servo, and its encoder's noise is in the force; then a
white force of 0.2 N, which nobody logs, acts as well. Root mean square errors of mass and damping
over seeds, beside least squares on central differences with one zero-phase filter on both sides at
10, 20 and 40 Hz, of which the best single one is taken for mass and for damping apart, and `auto`
beside `--method least-squares` on the same seeds, with 95 % of seeds drawn anew (bootstrap). Peers
that fit the simulated position stand in [identification](identification.md).
"""
#: Cut-offs of which the best single one is taken, Hz.
_CUT_OFFS = (10.0, 20.0, 40.0)
#: Sets of seeds drawn for an interval.
_DRAWS = 2000
#: Half range of the path, m; N/m, N·s/m and Hz of the servo.
_TRAVEL, _STIFFNESS, _DAMPING, _CUT_OFF = 0.03, 4000.0, 120.0, 100.0


def servo_family(samples: int, *, pushed: bool = False) -> Family:
    """The family in closed loop with noise of measurement, or pushed as well, of another length."""
    family = FAMILIES["closed-loop-measurement-noise"]
    if pushed:
        family = replace(FAMILIES["closed-loop-force-noise"], hand=family.hand)

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


def measure() -> Section:
    """Root mean square errors over seeds and times of one log, at two lengths."""
    rows: list[Row] = []
    ratios: dict[str, float] = {}
    for (samples, seeds), pushed in product(_LENGTHS, (False, True)):
        family = servo_family(samples, pushed=pushed)
        log = f"{'unlogged force' if pushed else 'servo'}, {samples}"
        truth = np.array([family.truth["mass"], family.truth["damping"]])
        delay = family.truth["delay"]
        logs = family.logs(range(seeds))
        best, quickest = np.full(2, np.inf), np.inf
        for cut_off in _CUT_OFFS:
            method = partial(one_filter, cut_off=cut_off)
            errors, seconds = _measured(method, logs, truth, delay)
            best, quickest = np.minimum(best, _rms(errors)), min(quickest, seconds)
            rows.append(_row(f"one filter at {cut_off:g} Hz", log, errors, seconds))
        least, seconds = _measured(partial(identified, method="least-squares"), logs, truth, delay)
        rows.append(_row("least squares, delay stated", log, least, seconds))
        for name, known in (("stated", delay), ("unknown", None)):
            errors, seconds = _measured(identified, logs, truth, known)
            ratio = _rms(errors) / best
            against = (
                f"{seconds / quickest:.0f} times one filter; errors over those of its best single "
                f"cut-off: m {ratio[0]:.2f}, b {ratio[1]:.2f}"
            )
            if name == "stated":
                against += f"; over least squares: {_ratio(errors, least)}"
            rows.append(_row(f"auto, delay {name}", log, errors, seconds, against))
            ratios[f"auto over one filter, delay {name}, {log}"] = seconds / quickest
    return Section(
        name="servo",
        title="Logs of a servo: identify beside one filter at its best cut-off",
        text=_TEXT,
        rows=tuple(rows),
        ratios=ratios,
    )


def _measured(
    method: Method, logs: list[Trajectory], truth: FloatArray, delay: float | None
) -> tuple[FloatArray, float]:
    """Relative errors of mass and damping, shape (seeds, 2), and the time of one log, s."""
    found = np.array([method(log, delay) for log in logs])
    return found / truth - 1, best_seconds(partial(method, logs[0], delay), 3)


def _rms(errors: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(errors**2, axis=-2))


def _ratio(errors: FloatArray, others: FloatArray) -> str:
    """Ratio of two root mean squares over the same seeds with its 95 % interval, in words."""
    drawn = np.random.default_rng(0).integers(len(errors), size=(_DRAWS, len(errors)))
    ratio = _rms(errors) / _rms(others)
    low, high = np.quantile(_rms(errors[drawn]) / _rms(others[drawn]), (0.025, 0.975), axis=0)
    parts = [
        f"{name} {ratio[index]:.2f} ({low[index]:.2f} to {high[index]:.2f})"
        for index, name in enumerate("mb")
    ]
    return ", ".join(parts)


def _row(name: str, log: str, errors: FloatArray, seconds: float, against: str = "") -> Row:
    mass, damping = _rms(errors)
    return Row(
        what=f"{name}, {log} samples",
        seconds=seconds,
        error=f"rms over {len(errors)} seeds: m {mass:.1e}, b {damping:.1e}",
        against=against,
    )
