"""The design problem as a smooth program: built symbolically once for each structure, then reused.

Unknowns are the logarithms y of the sizes. Every constraint reads g <= 0: families of them that
give values and slopes (the reach of stability), and those that are compiled: ripple, forces,
rendering, and Routh ratios below one with coefficients positive at each corner, delay and moment at
the full gain, which stand for the reach where a solver wants everything in one graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

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
        linear: rows without and with coefficients of either sign.
    """

    signs: tuple[int, ...]
    moments: tuple[tuple[tuple[int, ...], ...], ...]
    shapes: tuple[tuple[int, int, bool], ...]
    laws: int
    bound: bool
    linear: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """Functions of (y, p), compiled when first asked for and shared by equal structures."""

    structure: Structure

    @property
    def smooth(self) -> Any:
        """Constraints but those of stability, and their dense Jacobian."""
        return _smooth(replace(self.structure, shapes=()))

    @property
    def smooth_all(self) -> Any:
        """Constraints with Routh's ratios before the others, and their dense Jacobian."""
        return _smooth(self.structure)

    @property
    def ipopt(self) -> Any:
        """The solver, with all constraints; its parameters end with the weights."""
        return _ipopt(self.structure)


class Family(Protocol):
    """Constraints that are at most 0 where kept, with slopes of their own."""

    @property
    def size(self) -> int:
        """How many constraints these are."""
        ...

    def at(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Constraints, shape (constraints,), and their slopes to log-sizes, (constraints, n)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A problem with numbers in.

    Attributes:
        functions: shared by all problems of the structure.
        parameters: of this problem, without the weights of a rank; those of the loops come last.
        plain: how many of them belong to no loop.
        families: of constraints that give their own slopes; the reach of stability first.
        signs: of the unknowns, shape (unknowns,).
        references: of the steps.
        per_step: 1/ln(1 + w).
    """

    functions: Functions
    parameters: FloatArray
    plain: int
    families: tuple[Family, ...]
    signs: FloatArray
    references: FloatArray
    per_step: FloatArray

    def product(self, sizes: FloatArray, weights: FloatArray) -> tuple[float, FloatArray]:
        """The weighted sum of the logarithms of steps, and its gradient in log-sizes."""
        relative = self.signs * sizes / self.references
        heights = np.log1p(relative)
        used = weights > 0
        logs = np.log(np.where(used, np.abs(heights) * self.per_step, 1.0))
        slopes = relative / (1 + relative) / np.where(heights == 0, 1.0, heights)
        return float(weights @ logs), weights * slopes


def program_of(
    problem: Problem, scenarios: Sequence[Scenario], more: Sequence[Family] = ()
) -> Program:
    """The program of a problem; compiles it if no problem of its structure came before.

    Args:
        problem: with all its corners.
        scenarios: those of them that the solver is shown, as (loop of ``problem.loops.late``,
            column). Their number is rounded up to a power of two, so that structures are met again.
        more: families of constraints besides.
    """
    limits = problem.limits
    columns = [
        _rounded_up([column for place, column in scenarios if place == index])
        for index in range(len(problem.loops.late))
    ]
    late = problem.loops.late
    shown = [(loop, chosen) for loop, chosen in zip(late, columns, strict=True) if chosen]
    ripple = limits.encoder_resolution is not None
    rows = problem.linear.rows * (1 + INSIDE)
    either = np.any(rows < 0, axis=1)
    rows = np.concatenate([rows[~either], rows[either]])
    structure = Structure(
        signs=tuple(unknown.sign for unknown in problem.unknowns),
        moments=tuple(moment.members for moment in problem.moments),
        shapes=tuple((loop.degree, len(chosen), loop.held) for loop, chosen in shown),
        laws=problem.loops.nominal.degree if ripple else 0,
        bound=problem.loops.nominal.held,
        linear=(int(np.sum(~either)), int(np.sum(either))),
    )
    references = np.array([u.reference for u in problem.unknowns])
    gain = problem.margin.gain * (1 + INSIDE)
    numbers: list[FloatArray] = [references, rows]
    if ripple and limits.encoder_resolution is not None:
        nominal = problem.loops.nominal
        unit = limits.encoder_resolution / nominal.scales[0] / np.sqrt(12) / limits.ripple
        numbers += [_table(nominal, 1.0), _law(nominal, float(unit * (1 + INSIDE)))]
    plain = sum(part.size for part in numbers)
    numbers += [_table(loop, gain)[:, :, chosen] for loop, chosen in shown]
    return Program(
        functions=Functions(structure=structure),
        plain=plain,
        families=(Reach.of(problem, shown, gain), *more),
        parameters=np.concatenate([part.ravel() for part in numbers]),
        signs=np.array([float(sign) for sign in structure.signs]),
        references=references,
        per_step=np.array([1 / np.log1p(u.weber) for u in problem.unknowns]),
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Graph:
    """Expressions of a structure: log-sizes, parameters, weights, product of steps, constraints."""

    y: Any
    parameters: Any
    weights: Any
    product: Any
    constraints: Any


@lru_cache(maxsize=64)
def _smooth(structure: Structure) -> Any:
    """Constraints and their dense Jacobian."""
    import casadi as ca

    graph = _graph(structure)
    g = graph.constraints
    outputs = [g, ca.densify(ca.jacobian(g, graph.y))]
    return ca.Function("smooth", [graph.y, graph.parameters], outputs)


@lru_cache(maxsize=64)
def _ipopt(structure: Structure) -> Any:
    """The solver."""
    import casadi as ca

    graph = _graph(structure)
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
    task = {
        "x": graph.y,
        "p": ca.vertcat(graph.parameters, graph.weights),
        "f": -graph.product,
        "g": graph.constraints,
    }
    return ca.nlpsol("product", "ipopt", task, options)


@lru_cache(maxsize=64)
def _graph(structure: Structure) -> _Graph:
    import casadi as ca

    count = len(structure.signs)
    y, weights = ca.SX.sym("y", count), ca.SX.sym("w", count)
    taken: list[Any] = []

    def take(*shape: int) -> Any:
        symbols = ca.SX.sym("p", int(np.prod(shape)))
        taken.append(symbols)
        return np.array([symbols[i] for i in range(symbols.shape[0])], dtype=object).reshape(shape)

    sizes = [ca.exp(y[i]) for i in range(count)]
    reference, rows = take(count), take(sum(structure.linear), count)
    product_of_steps: Any = 0
    for i, (sign, size, ref) in enumerate(zip(structure.signs, sizes, reference, strict=True)):
        height: Any = sign * ca.log1p(sign * size / ref)
        product_of_steps += weights[i] * height.log()
    totals = [
        [sum((structure.signs[i] * sizes[i] for i in m), 0.0) if m else None for m in members]
        for members in structure.moments
    ]
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
    routh: list[Any] = []
    for degree, corners, held in structure.shapes:
        table = take(4, degree + 1, corners)
        for total in totals:
            for corner in range(corners):
                coefficients = _polynomial(table[:, :, corner], total, drop=not held)
                routh += [-c for c in coefficients]
                routh += [ratio - 1 for ratio in routh_ratios(coefficients)]
    for place, row in enumerate(rows):
        used: Any = sum(size * part for size, part in zip(sizes, row, strict=True))
        # In logarithms nearly linear, where a row has them.
        constraints.append(used.log() if place < structure.linear[0] else used - 1)
    return _Graph(
        y=y,
        parameters=ca.vertcat(*taken),
        weights=weights,
        product=product_of_steps,
        constraints=ca.vertcat(*routh, *constraints),
    )


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
