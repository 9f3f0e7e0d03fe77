"""The design problem as a smooth program: built symbolically once for each structure, then reused.

Unknowns are the logarithms y of the sizes and a common height t. Every constraint reads g <= 0:
Routh ratios below one and coefficients positive at each corner, delay and moment at the full gain,
forces, ripple, and height_i >= floor_i + active_i·t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.loop.coefficients import Terms
from tune.loop.loop import Loop
from tune.loop.polynomials import padded
from tune.optimisation.backends.reach import Reach
from tune.optimisation.problem import Problem
from tune.rendering.ripple import ripple_energy
from tune.rendering.routh_table import product, routh_ratios

FloatArray = NDArray[np.float64]
#: (loop of ``problem.loops.late``, column): one corner at one delay, with the hand or without.
Scenario = tuple[int, int]

#: The program keeps this much more than asked, relative, so that solvers, which end on or a little
#: beyond the boundary, end inside; it costs as much in optimality.
INSIDE = 2e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What decides the shape of the graph; equal structures share one compiled program.

    Attributes:
        signs: of the unknowns.
        moments: members by effect of each moment.
        shapes: (degree, scenarios, position bound by device or hand) of the loops.
        laws: degree of the control law, for the ripple; 0 without an encoder.
        bound: the device's own force by position binds it, hand off.
        forces: (sustained limited, peak limited).
    """

    signs: tuple[int, ...]
    moments: tuple[tuple[tuple[int, ...], ...], ...]
    shapes: tuple[tuple[int, int, bool], ...]
    laws: int
    bound: bool
    forces: tuple[bool, bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """Compiled functions of (z, p), z = (y, t).

    Attributes:
        evaluate: objective, its gradient, constraints but those of stability, their dense Jacobian.
        evaluate_all: the same with Routh's ratios before the other constraints.
        ipopt: the solver, with all constraints.
    """

    evaluate: Any
    evaluate_all: Any
    ipopt: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A problem with numbers in.

    Attributes:
        functions: shared by all problems of the structure.
        parameters: of this problem, without the stage.
        lower: of log-sizes, shape (unknowns,).
        upper: of log-sizes, shape (unknowns,).
        reach: the stability constraint, exact.
    """

    functions: Functions
    parameters: FloatArray
    reach: Reach
    lower: FloatArray
    upper: FloatArray


def program_of(problem: Problem, scenarios: Sequence[Scenario]) -> Program:
    """The program of a problem; compiles it if no problem of its structure came before.

    Args:
        problem: with all its corners.
        scenarios: those of them that the solver is shown, as (loop of ``problem.loops.late``,
            column). Their number is rounded up to a power of two, so that structures are met again.
    """
    limits = problem.limits
    columns = [
        _rounded_up([column for place, column in scenarios if place == index])
        for index in range(len(problem.loops.late))
    ]
    late = problem.loops.late
    shown = [(loop, chosen) for loop, chosen in zip(late, columns, strict=True) if chosen]
    ripple = limits.encoder_resolution is not None
    structure = Structure(
        signs=tuple(unknown.sign for unknown in problem.unknowns),
        moments=tuple(moment.members for moment in problem.moments),
        shapes=tuple((loop.degree, len(chosen), loop.held) for loop, chosen in shown),
        laws=problem.loops.nominal.degree if ripple else 0,
        bound=problem.loops.nominal.held,
        forces=(limits.continuous_force is not None, limits.peak_force is not None),
    )
    numbers: list[FloatArray] = [
        np.array([u.reference for u in problem.unknowns]),
        np.array([1 / np.log1p(u.weber) for u in problem.unknowns]),
        np.array([u.goal for u in problem.unknowns]),
    ]
    gain = problem.margin.gain * (1 + INSIDE)
    numbers += [_table(loop, gain)[:, :, chosen] for loop, chosen in shown]
    if ripple and limits.encoder_resolution is not None:
        nominal = problem.loops.nominal
        unit = limits.encoder_resolution / nominal.scales[0] / np.sqrt(12) / limits.ripple
        numbers += [_table(nominal, 1.0), _law(nominal, float(unit))]
    for moment in problem.moments:
        numbers += [
            np.array(part) * (1 + INSIDE)
            for part in (
                [r / (limits.continuous_force or 1.0) for r in moment.reach[0]],
                [r / (limits.peak_force or 1.0) for reach in moment.reach for r in reach],
            )
        ]
    return Program(
        functions=_compiled(structure),
        reach=Reach.of(problem, shown, gain),
        parameters=np.concatenate([part.ravel() for part in numbers]),
        lower=np.log([unknown.low for unknown in problem.unknowns]),
        upper=np.log([unknown.high for unknown in problem.unknowns]),
    )


def _rounded_up(columns: list[int]) -> list[int]:
    """Filled up to a power of two with the last one."""
    if not columns:
        return []
    size = 1 << (len(columns) - 1).bit_length()
    return columns + columns[-1:] * (size - len(columns))


def _parts(terms: Terms) -> FloatArray:
    return np.stack([terms.free, terms.alpha, terms.beta, terms.gamma])


def _table(loop: Loop, gain: float) -> FloatArray:
    """(4, degree+1, corners) in (K, B, M), each coefficient over its constant part's scale."""
    scales = np.stack([np.ones_like(loop.scales[0]), *(gain * np.asarray(s) for s in loop.scales)])
    table = _parts(loop.terms) * scales[:, None]
    return table.reshape(4, loop.degree + 1, -1)


def _law(loop: Loop, unit: float) -> FloatArray:
    """(4, degree+1): plant denominator, and the control law times ``unit``."""
    scales = np.array([1.0, *(unit * float(s) for s in loop.scales)])
    parts = loop.transfer
    rows = (parts.plant_denominator, parts.alpha, parts.beta, parts.gamma)
    return np.stack([padded(row, loop.degree + 1) for row in rows]) * scales[:, None]


@lru_cache(maxsize=64)
def _compiled(structure: Structure) -> Functions:
    import casadi as ca

    count = len(structure.signs)
    y, t = ca.SX.sym("y", count), ca.SX.sym("t")
    taken: list[Any] = []

    def take(*shape: int) -> Any:
        symbols = ca.SX.sym("p", int(np.prod(shape)))
        taken.append(symbols)
        return np.array([symbols[i] for i in range(symbols.shape[0])], dtype=object).reshape(shape)

    stage = [ca.SX.sym(name, size) for name, size in (("a", count), ("f", count), ("w", count + 1))]
    sizes = [ca.exp(y[i]) for i in range(count)]
    reference, per_step, goals = take(count), take(count), take(count)
    heights = [
        sign * ca.log1p(sign * size / ref) * unit - goal
        for sign, size, ref, unit, goal in zip(
            structure.signs, sizes, reference, per_step, goals, strict=True
        )
    ]
    totals = [
        [sum((structure.signs[i] * sizes[i] for i in m), 0.0) if m else None for m in members]
        for members in structure.moments
    ]
    routh: list[Any] = []
    for degree, corners, held in structure.shapes:
        table = take(4, degree + 1, corners)
        for total in totals:
            for corner in range(corners):
                coefficients = _polynomial(table[:, :, corner], total, drop=not held)
                routh += [-c for c in coefficients]
                routh += [ratio - 1 for ratio in routh_ratios(coefficients)]
    constraints: list[Any] = []
    if structure.laws:
        table, law = take(4, structure.laws + 1), take(4, structure.laws + 1)
        for total in totals:
            numerator = product(list(law[0]), _polynomial(law, total, free=False, drop=False))
            free = total[0] is None and not structure.bound
            energy = ripple_energy(
                numerator, _polynomial(table, total, drop=False), position_free=free
            )
            # An unstable loop has no energy: the logarithm says so, and is nearly linear.
            constraints.append(energy.log() / 2)
    for members in structure.moments:
        sustained, peak = take(len(members[0])), take(sum(len(m) for m in members))
        if structure.forces[0] and members[0]:
            constraints.append(_excess(sizes, members[0], sustained))
        if structure.forces[1]:
            chosen = [i for m in members for i in m]
            constraints.append(_excess(sizes, chosen, peak))
    for i, height in enumerate(heights):
        constraints.append(stage[1][i] + stage[0][i] * t - height)
    z, p = ca.vertcat(y, t), ca.vertcat(*taken, *stage)
    f = -ca.dot(stage[2], ca.vertcat(*heights, t))
    g = ca.vertcat(*constraints)
    all_g = ca.vertcat(*routh, *constraints)
    options = {
        "print_time": False,
        "error_on_fail": False,
        # An unstable setting has no ripple; the solver steps back from it.
        "show_eval_warnings": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": 1e-10,
            "max_iter": 150,
            "max_wall_time": 2.0,
            "bound_relax_factor": 0.0,
            # The Routh ratios are far from convex outside the stable set; with their exact second
            # derivatives one solve in two ends at the iteration limit, with BFGS one in fifteen.
            "hessian_approximation": "limited-memory",
        },
    }
    return Functions(
        evaluate=_evaluation("evaluate", z, p, f, g),
        evaluate_all=_evaluation("evaluate_all", z, p, f, all_g),
        ipopt=ca.nlpsol("climb", "ipopt", {"x": z, "p": p, "f": f, "g": all_g}, options),
    )


def _excess(sizes: list[Any], members: Sequence[int], reaches: Any) -> Any:
    """Logarithm of a force over its limit, nearly linear in log-sizes as the force is not."""
    total: Any = sum(sizes[i] * reach for i, reach in zip(members, reaches, strict=True))
    return total.log()


def _evaluation(name: str, z: Any, p: Any, f: Any, g: Any) -> Any:
    import casadi as ca

    slopes = ca.densify(ca.gradient(f, z)), ca.densify(ca.jacobian(g, z))
    return ca.Function(name, [z, p], [f, slopes[0], g, slopes[1]])


def _polynomial(table: Any, total: list[Any], *, free: bool = True, drop: bool = True) -> list[Any]:
    """Coefficients of one moment; without a spring the factor w is dropped if asked to."""
    start = 1 if drop and total[0] is None else 0
    rows = range(start, table.shape[1])
    return [
        sum(
            (
                table[effect + 1, k] * value
                for effect, value in enumerate(total)
                if value is not None
            ),
            table[0, k] if free else 0.0,
        )
        for k in rows
    ]
