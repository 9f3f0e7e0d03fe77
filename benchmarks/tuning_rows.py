"""Tuning: time of proposal and certificate, gap of each solver to the best known height."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.row import Row, best_seconds
from identification import load_device
from tune.backends import Backend
from tune.backends.casadi_ import Ipopt
from tune.backends.nlopt_ import Slsqp
from tune.certificate.certify import certify
from tune.climb import climb, closed_form
from tune.loop import Filters
from tune.optimisation import optimise
from tune.perception import default_table
from tune.problem import Job, Problem, pose
from tune.scene import Scene


def _problem(elements: dict[str, dict[str, str]]) -> Problem:
    device = load_device("homerehab")
    scene = Scene.model_validate({"elements": elements})
    return pose(
        Job.of(device, scene, default_table()),
        elements=list(elements),
        filters=Filters(velocity_hz=50.0, acceleration_hz=30.0),
    )


def rows() -> Iterator[Row]:
    """One effect, three effects by each solver, a certificate, a whole scene."""
    single = _problem({"wall": {"stiffness": "max"}})
    yield Row(
        what="propose one effect over a box, closed form",
        seconds=best_seconds(lambda: closed_form(single)),
        error="exact",
    )
    joint = _problem({"block": {"stiffness": "max", "damping": "max", "mass": "max"}})
    solvers: tuple[Backend, ...] = (Ipopt(), Slsqp())
    found = {solver.name: _height(joint, [solver]) for solver in solvers}
    best = max(*found.values(), _height(joint, solvers))
    for solver in solvers:
        yield Row(
            what=f"propose K, B and M over a box, {solver.name}",
            seconds=best_seconds(lambda chosen=solver: climb(joint, [chosen]), 3),
            error=f"gap {1 - found[solver.name] / best:.1e} of the smallest number of steps",
        )
    device = load_device("homerehab")
    scene = Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})
    profile = optimise(device, scene)
    yield Row(
        what="certify one element over the corners",
        seconds=best_seconds(lambda: certify(profile), 3),
        error=f"{profile.certificate.points} points, certified roots",
    )
    yield Row(
        what="optimise a scene of one spring, certificate included",
        seconds=best_seconds(lambda: optimise(device, scene), 3),
        error="exact",
    )


def _height(problem: Problem, solvers: tuple[Backend, ...] | list[Backend]) -> float:
    sizes = climb(problem, solvers).sizes
    assert sizes is not None
    return float(np.min([u.steps(float(s)) for u, s in zip(problem.unknowns, sizes, strict=True)]))
