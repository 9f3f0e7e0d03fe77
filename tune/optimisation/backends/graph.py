"""Constraints as expressions of CasADi, built and compiled once for each structure.

Ripple, forces, rendering, and Routh ratios below one with coefficients positive at each corner,
delay and moment at the full gain, which stand for the reach of stability where a solver wants
everything in one graph.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress
from typing import Any

import numpy as np

from tune.rendering.ripple import product, ripple_energy, routh_ratios


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What decides the shape of the graph; equal structures share one compiled program.

    Attributes:
        signs: of the unknowns.
        moments: members by effect of each moment.
        quiet: whether the ripple of each is bound.
        ratios: (i, j) of sizes whose ratio is bound.
        shapes: (degree, scenarios, position bound by device or hand) of the loops.
        laws: degree of the control law, for the ripple; 0 without an encoder.
        bound: the device's own force by position binds it, hand off.
        linear: rows without and with coefficients of either sign.
        felt: limits on what is felt that are no rows.
    """

    signs: tuple[int, ...]
    moments: tuple[tuple[tuple[int, ...], ...], ...]
    quiet: tuple[bool, ...]
    ratios: tuple[tuple[int, int], ...]
    shapes: tuple[tuple[int, int, bool], ...]
    laws: int
    bound: bool
    linear: tuple[int, int]
    felt: int


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
    scales, rows = take(count, 3), take(sum(structure.linear), count)
    factors, felt = take(len(structure.ratios)), take(structure.felt, 4 + 2 * count)
    product_of_steps: Any = 0
    for i, (sign, size, scale) in enumerate(zip(structure.signs, sizes, scales, strict=True)):
        product_of_steps += weights[i] * (sign * _height(sign * size, *scale)).log()
    totals = [
        [sum((structure.signs[i] * sizes[i] for i in m), 0.0) if m else None for m in members]
        for members in structure.moments
    ]
    constraints: list[Any] = []
    if structure.laws:
        table, law = take(4, structure.laws + 1), take(4, structure.laws + 1)
        for total in compress(totals, structure.quiet):
            numerator = product(list(law[0]), _polynomial(law, total, free=False, drop=False))
            free = total[0] is None and not structure.bound
            energy = ripple_energy(
                numerator, _polynomial(table, total, drop=False), position_free=free
            )
            # An unstable loop has no energy: the logarithm says so, and is nearly linear.
            constraints.append(energy.log() / 2)
    routh: list[Any] = []
    for degree, corners, grounded in structure.shapes:
        table = take(4, degree + 1, corners)
        for total in totals:
            for corner in range(corners):
                coefficients = _polynomial(table[:, :, corner], total, drop=not grounded)
                routh += [-c for c in coefficients]
                routh += [ratio - 1 for ratio in routh_ratios(coefficients)]
    for place, row in enumerate(rows):
        used: Any = sum(size * part for size, part in zip(sizes, row, strict=True))
        # In logarithms nearly linear, where a row has them.
        constraints.append(used.log() if place < structure.linear[0] else used - 1)
    constraints += [
        factor.log() + y[i] - y[j] for (i, j), factor in zip(structure.ratios, factors, strict=True)
    ]
    for per_step, *scale in felt:
        given, asked = (
            sum(size * part for size, part in zip(sizes, parts, strict=True))
            for parts in (scale[3 : 3 + count], scale[3 + count :])
        )
        apart: Any = _height(given, *scale[:3]) - _height(asked, *scale[:3])
        constraints.append(per_step * apart - 1)
    return _Graph(
        y=y,
        parameters=ca.vertcat(*taken),
        weights=weights,
        product=product_of_steps,
        constraints=ca.vertcat(*routh, *constraints),
    )


def _height(value: Any, top: Any, base: Any, corner: Any) -> Any:
    """`Scale.height`."""
    import casadi as ca

    above: Any = ca.fmax(value, top) - ca.fmax(0.0, top)
    below: Any = ca.fmin(value, top) - ca.fmin(0.0, top)
    return ca.log1p(above / base) + below / corner


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
