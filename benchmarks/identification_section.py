"""Identification: error over Cramér and Rao's bound against time, four noises, three lengths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from benchmarks.library_peers import (
    lsim_output_error,
    nfoursid_subspace,
    sippy_output_error,
    sippy_subspace,
)
from benchmarks.limited import LONGEST, answers
from benchmarks.other_methods import OTHERS
from benchmarks.section import Cell, Section
from benchmarks.servo_peers import multiple_shooting, one_filter, output_error, srivc
from benchmarks.situations import DELAY, SITUATIONS, TRUTH, bound_of, logs_of
from identification import Hardware, Method, Trajectory, identify, quantity
from identification.estimators import ESTIMATORS
from identification.estimators.estimate import Model
from identification.fitting import PreparedLog

FloatArray = NDArray[np.float64]

#: Samples, situations and seeds.
_LENGTHS = (
    (5_000, SITUATIONS, 20),
    (50_000, SITUATIONS, 6),
    (1_000_000, (SITUATIONS[0], SITUATIONS[3]), 2),
)
#: Time in which a first answer is repeated, s.
_BUDGET = 1.0
#: A longer log is not asked of a method that would need so long by its time on a shorter one, s.
_HOPELESS = 20.0
#: The next length over this one, at least.
_TIMES = 10
_MODEL = Model(coulomb=False, offset=True)

_TEXT = """\
One device (3 kg, 10 N·s/m, a constant force of 0.1 N, one sample of delay at 1 kHz), four
situations of noise, three lengths of log. The error is the root mean square over seeds of the
errors of mass and damping, each over its Cramér–Rao bound (constant force and start unknown,
sizes of the noises known): 1 is what no unbiased estimator goes below, up to the scatter of few
seeds. The bound of an encoder takes rounding as white noise, which exact rounding may go below.
Every method is told the delay except "auto, delay unknown". Peers are told the model: mass,
damping, constant force. `auto` is what `identify` does: it is not told the model, asks the log
for friction and for more, and gives findings and intervals; its estimate carries what the terms
cost that this device does not have.

Every method answers the same seeds; one that does not get through them all has no error. Each
error has its 95 % interval from the number of seeds, and only what lies outside of another's
counts. Errors below 1 are drawn there and count as equal. A long log repeats one period:
the rounding of an encoder repeats with it and does not average out, so that its errors stay
above that bound.

Time is of one log, the second time it is answered, in a process of its own that is ended after
20 s. A method that did not finish a length is not asked a longer one.
"""

_REASONS = {
    "auto": "it is not told the model: it tries every estimator and tests for friction, delay, "
    "structure and whiteness before it believes one, and states intervals; a method that is told "
    "which model and which noise it has needs neither.",
    "least-squares": "a method of filtered derivatives does not weigh the lines as white noise "
    "of position asks for; its place is where forces disturb, and the table of `auto` chooses "
    "among all.",
    "instruments": "filtered derivatives, as least-squares; exact for any noise, efficient for "
    "few.",
    "innovations": "it fits the sizes of two noises beside the model; where there is only one, "
    "output error needs less.",
    "output-error": "the peer's model is of this very device (no friction, no direction, delay "
    "of whole samples), which the peer solves with fewer passes over the log; where forces "
    "disturb, methods that allow for them are more accurate.",
    "auto, delay unknown": "as `auto`, and it finds the delay as well.",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """A method, and whether it is ours."""

    name: str
    method: Callable[[Trajectory], FloatArray]
    ours: bool = False


def _entries() -> Iterator[_Entry]:
    for name in ESTIMATORS:
        yield _Entry(name=name, method=partial(_ours, name=name), ours=True)
    for name, delay in (("auto", DELAY), ("auto, delay unknown", None)):
        yield _Entry(name=name, method=partial(identified, delay=delay), ours=True)
    late: dict[str, Callable[..., FloatArray]] = {
        f"one filter, {hertz:g} Hz": partial(one_filter, cut_off=hertz)
        for hertz in (10.0, 20.0, 40.0)
    }
    late |= {
        "output error, recursion": output_error,
        "output error, lsim": lsim_output_error,
        "SRIVC": srivc,
        "multiple shooting, CasADi": multiple_shooting,
    }
    if find_spec("sippy_unipi") is not None:
        late |= {"SIPPY, output error": sippy_output_error, "SIPPY, N4SID": sippy_subspace}
    if find_spec("nfoursid") is not None:
        late |= {"nfoursid": nfoursid_subspace}
    for name, method in late.items():
        yield _Entry(name=name, method=partial(method, delay=DELAY))
    for name in ("pysindy", "ARX", "finite differences"):
        yield _Entry(name=name, method=partial(OTHERS[name], model=_MODEL, delay=DELAY))


def measure() -> Section:
    """Every method in every situation at every length."""
    cells: list[Cell] = []
    hopeless: dict[tuple[str, str], str] = {}
    for samples, situations, seeds in _LENGTHS:
        for situation in situations:
            logs = logs_of(situation, samples, range(seeds))
            bound = bound_of(situation, logs[0])
            for entry in _entries():
                key = (situation.name, entry.name)
                case = f"{situation.name}, {samples} samples"
                asked = Cell(case=case, method=entry.name, ours=entry.ours)
                if key in hopeless:
                    cells.append(replace(asked, note=hopeless[key]))
                    continue
                cell = _measured(asked, entry.method, logs, bound)
                cells.append(cell)
                if cell.seconds is None:
                    hopeless[key] = "not asked: did not finish a shorter log"
                elif cell.seconds * _TIMES > _HOPELESS:
                    hopeless[key] = f"not asked: {cell.seconds:.1f} s for {samples} samples"
    return Section(
        name="identification",
        title="Identification: error over the bound, against time",
        text=_TEXT,
        cells=tuple(cells),
        error="rms of errors over the Cramér–Rao bound",
        floor=1.0,
        reasons=_REASONS,
        ratios=_ratios(cells),
        shown=(
            f"{SITUATIONS[0].name}, 5000 samples",
            f"{SITUATIONS[3].name}, 5000 samples",
            f"{SITUATIONS[0].name}, 1000000 samples",
        ),
    )


def _measured(
    asked: Cell,
    method: Callable[[Trajectory], FloatArray],
    logs: list[Trajectory],
    bound: FloatArray,
) -> Cell:
    """The cell of a method with its answers."""
    found = answers(method, logs, budget=_BUDGET, least=len(logs))
    if not found.values:
        return replace(asked, note=found.trouble)
    values: FloatArray = np.array(found.values, dtype=np.float64)
    seconds = float(np.median(np.array(found.seconds, dtype=np.float64)))
    if not np.all(np.isfinite(values)):
        return replace(asked, seconds=seconds, note="no mass: its model has no such pole")
    if len(values) < len(logs):
        note = f"{len(values)} of {len(logs)} seeds in {LONGEST:g} s"
        return replace(asked, seconds=seconds, note=note)
    parts = np.sqrt(np.mean(((values - TRUTH) / bound) ** 2, axis=0))
    note = f"m {parts[0]:.3g}, b {parts[1]:.3g} over {len(values)} seeds"
    note += f"; {found.megabytes:.0f} MB" if found.megabytes >= 1 else ""
    note += f"; {found.trouble}" if found.trouble else ""
    error = float(np.linalg.norm(parts) / np.sqrt(2))
    # A mean of squares of two parameters over seeds.
    free = 2 * len(values)
    low, high = error * np.sqrt(free / chdtri(free, [0.025, 0.975]))
    interval = (float(low), float(high))
    return replace(asked, seconds=seconds, error=error, interval=interval, note=note)


def _ratios(cells: list[Cell]) -> dict[str, float]:
    """Times of ours over one filter at 20 Hz, of the shorter logs in open loop."""
    by = {(cell.case, cell.method): cell.seconds for cell in cells}
    ratios: dict[str, float] = {}
    for samples in (5_000, 50_000):
        case = f"{SITUATIONS[0].name}, {samples} samples"
        plain = by.get((case, "one filter, 20 Hz"))
        for method in (*ESTIMATORS, "auto"):
            seconds = by.get((case, method))
            if plain and seconds:
                ratios[f"{method} over one filter, {samples} samples"] = seconds / plain
    return ratios


def _ours(log: Trajectory, name: str) -> FloatArray:
    found = PreparedLog.of(log, _MODEL, quantity(DELAY)).fit(name)
    return np.array([found.value("mass"), found.value("damping")])


def identified(log: Trajectory, delay: float | None, method: Method = "auto") -> FloatArray:
    """Mass and damping, shape (2,), as `identify` finds them with a delay, s, or told of none."""
    known = None if delay is None else Hardware(delay=quantity(delay))
    device = identify(log, hardware=known, method=method).device
    return np.array([device.mass.value, device.damping.value])
