"""Tuning as it is used: proposal, description and certificate apart, warm and at first."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

from benchmarks.row import Row, timed
from benchmarks.scenes import Case, case, certificate, description, fifty_elements, proposal
from tune.documents.scene import Scene
from tune.loop.loop import Filters
from tune.optimisation import optimise
from tune.optimisation.cutoffs import choose_filters

#: What the first proposal of a process takes, imports and compilation included.
_FRESH = """
import time
start = time.perf_counter()
from benchmarks.scenes import case, proposal
chosen = case({elements})
proposal(chosen, chosen.task())
print(time.perf_counter() - start)
"""

SPRING = {"wall": {"stiffness": "max"}}
DAMPER = {"water": {"damping": "max"}}
MASS = {"cup": {"mass": "max"}}
BLOCK = {"block": {"stiffness": "max", "damping": "max", "mass": "max"}}


def rows() -> Iterator[Row]:
    """One effect, three effects with filters over a box, fifty elements."""
    for name, elements in (("spring", SPRING), ("damper", DAMPER), ("mass", MASS)):
        yield from _parts(f"one {name}", case(elements))
    yield from _parts("K, B and M of one element, filters given", case(BLOCK))
    yield from _parts("fifty elements", fifty_elements())
    for name, elements in (("one spring", SPRING), ("K, B and M", BLOCK)):
        yield _in_a_fresh_process(name, elements)
    free = Scene.model_validate({"elements": BLOCK})
    chosen = Case(device=case(BLOCK).device, scene=free, filters=Filters())
    yield Row.of(
        "cut-offs of K, B and M chosen",
        timed(lambda: choose_filters(chosen.task(), _silent), 3),
        "1 % of the steps (tests)",
    )
    spring = case(SPRING)
    yield Row.of(
        "optimise a scene of one spring, certificate included",
        timed(lambda: optimise(spring.device, spring.scene), 3),
        "certified",
    )


def _parts(name: str, chosen: Case) -> Iterator[Row]:
    """Proposal with the device's loops at hand and without; description; certificate."""
    task = chosen.task()
    solutions = proposal(chosen, task)
    effects = sum(len(solved.problem.unknowns) for solved in solutions)
    yield Row.of(
        f"propose {name}",
        timed(lambda: proposal(chosen, task)),
        f"{effects} effects; gaps under solver",
        "loops of device and filters at hand",
    )
    yield Row.of(
        f"propose {name}, from the device on",
        timed(lambda: proposal(chosen, chosen.task())),
        "same",
    )
    design = description(chosen, task, solutions)
    yield Row.of(
        f"describe {name}",
        timed(lambda: description(chosen, task, solutions), 5),
        "margins, steps, ripple, what limits",
    )
    if not effects:
        return  # nothing is rendered well enough to be felt, so nothing is certified
    certified = certificate(chosen, task, solutions, design)
    found = certified()
    yield Row.of(f"certify {name}", timed(certified, 3), f"{found.points} points and the proof")


def _in_a_fresh_process(name: str, elements: dict[str, dict[str, str]]) -> Row:
    script = _FRESH.replace("{elements}", repr(elements))
    command = [sys.executable, "-c", script]
    times: list[float] = []
    for _ in range(3):
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603
        times.append(float(text))
    return Row(
        what=f"propose {name} in a new process",
        seconds=sorted(times)[1],
        spread=(min(times), max(times)),
        error="imports and compilation included",
        against="least and most of three",
    )


def _silent(sentence: str) -> None:
    del sentence
