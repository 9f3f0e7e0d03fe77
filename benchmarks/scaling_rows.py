"""From one element to hundreds, from one device to many: time, and the power of the number."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import pairwise
from math import log
from pathlib import Path

import numpy as np

from benchmarks.row import Row, best_seconds
from identification import load_device
from tests.fleet_logs import fleet_logs
from tune import Effects, Filters, Loop, gain_interval, is_stable, largest, optimise, study
from tune.documents.scene import Scene

_COUNTS = (1, 10, 50, 200)
_TOGETHER = (2, 5, 10)
_DEVICES, _PLAYED = 1000, 1000
_LOGS = (10, 40)
#: The command as a process of its own, that starts its workers as a user's does.
_FLEET = "import sys; from tune.cli import main; sys.argv[0] = 'haptune'; main()"


def rows() -> Iterator[Row]:
    """Elements alone, groups, devices by effects, devices by scenes, logs by workers."""
    yield from _elements()
    yield from _arrays()
    device = load_device("homerehab")
    water = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
    yield from _growing(
        "study, devices", (1, 10, 100), lambda count: study([device] * count, water, workers=1)
    )
    yield from _fleets()


def _elements() -> Iterator[Row]:
    device = load_device("homerehab")

    def tuned(scene: Callable[[int], Mapping[str, object]]) -> Callable[[int], object]:
        return lambda count: optimise(device, Scene.model_validate(scene(count)))

    yield from _growing("springs, each alone", _COUNTS, tuned(lambda n: {"elements": _springs(n)}))
    yield from _growing(
        "springs, dampers, walls", _COUNTS[:3], tuned(lambda n: {"elements": _mix(n)})
    )
    yield from _growing("equal walls in a maze", _COUNTS, tuned(lambda n: {"elements": _maze(n)}))
    yield from _growing("masses, which fade", _COUNTS[:3], tuned(lambda n: {"elements": _cups(n)}))
    together = tuned(lambda n: {"elements": _dampers(n), "together": [list(_dampers(n))]})
    yield from _growing("dampers, all together", _TOGETHER, together)


def _maze(count: int) -> dict[str, object]:
    """So many elements: walls, water and a cup."""
    wall = {"stiffness": "max", "damping": "max", "one_sided": True}
    others: dict[str, object] = {
        "water": {"damping": 10.0},
        "cup": {"damping": 30.0, "mass": "max"},
    }
    beside = others if count > len(others) else {}
    return {f"wall{k}": wall for k in range(count - len(beside))} | beside


def _springs(count: int) -> dict[str, object]:
    return {f"spring{k}": {"stiffness": 200.0 + 3000.0 * k / count} for k in range(count)}


def _dampers(count: int) -> dict[str, object]:
    return {f"water{k}": {"damping": 2.0 + 10.0 * k / count} for k in range(count)}


def _cups(count: int) -> dict[str, object]:
    """Of less than 0.7 kg the device shows less than a hand can tell, without damping beside it."""
    return {f"cup{k}": {"mass": 0.7 + 0.2 * k / count, "damping": 30.0} for k in range(count)}


def _mix(count: int) -> dict[str, object]:
    """A third of each; walls push on one side."""
    walls = {
        f"wall{k}": {"stiffness": 300.0 + 1000.0 * k / count, "damping": 3.0, "one_sided": True}
        for k in range(count // 3)
    }
    springs = _springs(-(-count // 3))
    return walls | springs | _dampers(count - len(walls) - len(springs))


def _growing(what: str, counts: tuple[int, ...], run: Callable[[int], object]) -> Iterator[Row]:
    """A row a count, with the power of the count from the one before."""
    run(counts[0])
    seconds: dict[int, float] = {}
    for count in counts:
        begun = time.process_time()
        run(count)
        seconds[count] = time.process_time() - begun
    yield Row(what=f"{what}: {counts[0]}", seconds=seconds[counts[0]], error="")
    for few, many in pairwise(counts):
        power = log(seconds[many] / seconds[few]) / log(many / few)
        yield Row(
            what=f"{what}: {many}",
            seconds=seconds[many],
            error=f"{seconds[many] / many:.2g} s each",
            against=f"the number to the power {power:.2f} from {few} on",
        )


def _arrays() -> Iterator[Row]:
    """Devices by effects, filters of order one."""
    rng = np.random.default_rng(0)
    filters = Filters(
        velocity_filter_hz=50.0, acceleration_filter_hz=30.0, acceleration_filter_order=1
    )
    K, B, M = (rng.uniform(0, most, _PLAYED) for most in (5e3, 100, 5))
    effects = Effects(stiffness=K, damping=B, mass=M)
    some = slice(_PLAYED // 20)
    few = Effects(stiffness=K[some], damping=B[some], mass=M[some])
    asked: dict[str, tuple[Callable[[Loop], object], int]] = {
        "is_stable": (lambda loop: is_stable(loop, effects), _PLAYED),
        "gain_interval": (lambda loop: gain_interval(loop, few), _PLAYED // 20),
        "largest": (lambda loop: largest(loop, "stiffness", few), _PLAYED // 20),
    }
    for delay in (1.0, 1.4):
        loop = Loop.from_numbers(
            mass=rng.uniform(0.5, 5, (_DEVICES, 1)),
            damping=rng.uniform(1, 20, (_DEVICES, 1)),
            sample_time=1e-3,
            delay_samples=delay,
            filters=filters,
        )
        for name, (answer, played) in asked.items():
            yield Row(
                what=f"{name}, {_DEVICES} devices by {played} effects, {delay:g} samples late",
                seconds=best_seconds(partial(answer, loop), 3) / (_DEVICES * played),
                error="as each alone, to the last digit",
            )


def _fleets() -> Iterator[Row]:
    """Logs by the clock, on one worker and on two in turn."""
    with tempfile.TemporaryDirectory() as folder:
        for count in _LOGS:
            here = Path(folder) / str(count)
            here.mkdir()
            fleet_logs(here, count)
            seconds = {workers: _fleet(here, workers) for workers in (1, 2)}
            for workers, each in seconds.items():
                yield Row(
                    what=f"fleet, {count} logs, {workers} worker{'s' * (workers > 1)}",
                    seconds=each,
                    error=f"{each / count:.2g} s a log by the clock",
                    against=f"{seconds[1] / each:.2f} times one worker" if workers > 1 else "",
                )


def _fleet(here: Path, workers: int) -> float:
    options = ["--scene", "scene.yaml", "--hardware", "hardware.yaml"]
    options += ["-o", f"on{workers}", "--workers", str(workers)]
    begun = time.perf_counter()
    subprocess.run(  # noqa: S603
        [sys.executable, "-c", _FLEET, "fleet", "manifest.csv", *options],
        cwd=here,
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    return time.perf_counter() - begun
