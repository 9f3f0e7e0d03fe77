"""Solvers that propose (IPOPT, SLSQP), and the smooth program that they are shown.

What they propose is never trusted: `feasibility` checks it exactly. Unknowns are the logarithms y
of the sizes. Every constraint reads g <= 0: the limits of stability, which give values and slopes,
and expressions of CasADi, compiled once for each structure: ripple, forces, rendering, and Routh
ratios below one with coefficients positive at each corner, delay and combination at the full gain,
which stand for the limits of stability where a solver wants everything in one graph.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress
from typing import Any, cast

import numpy as np

from tune.loop.loop import Loop
from tune.loop.polynomials import FloatArray, convolve, pad_coefficients
from tune.optimisation.limits import StabilityLimits, corner_table
from tune.optimisation.problem import Problem
from tune.rendering import ripple_energy
from tune.stability.criterion import routh_ratios

#: (loop of ``problem.loops.late``, column): one corner at one delay, with the hand or without.
Scenario = tuple[int, int]
#: The program keeps this much more than asked, relative, so that solvers, which end on or a little
#: beyond the boundary, end inside; it costs as much in optimality.
_INSIDE = 2e-8
#: An interior point method wants to start away from the boundary: this much lower, in log-sizes.
_RETREAT = 1.0
#: Evaluations allowed; they end a bad problem, and the same one on every machine.
_EVALUATIONS = 100
#: s, far beyond any solve that ends: only one that hangs meets it, however busy the machine is.
_SECONDS = 120.0
#: How far it may go from its start, in log-sizes: far away the slopes at the start say nothing.
_STRIDE = 3.0
#: Times it may go that far.
_STRIDES = 6
#: What a constraint that cannot be evaluated counts as: clearly violated, still a number.
_UNREACHABLE = 1e3
#: A constraint is kept if broken by less: programs ask for more than is needed.
_KEPT = 1e-9
#: How far inside all limits is far enough, and what part of the violation a step must take off.
_DEEP, _STUCK = 0.02, 1e-2


#: A point of a climb that is not good is this much worse than the start, and points at most.
_CLIFF, _MOST_POINTS = 5.0, 60
#: Points after which a climb that comes to nothing ends.
_PATIENCE = 18
#: What a row without any use of its limit uses, so that it has a logarithm.
_NOTHING = 1e-30


@dataclass(frozen=True, slots=True, kw_only=True)
class _Structure:
    """What decides the shape of the graph; equal structures share compiled functions of (y, p)."""

    signs: tuple[int, ...]
    combinations: tuple[tuple[tuple[int, ...], ...], ...]  # members by effect of each combination
    quiet: tuple[bool, ...]  # whether the ripple of each is bound
    ratios: tuple[tuple[int, int], ...]  # (i, j) of sizes whose ratio is bound
    # (degree, scenarios, position bound by device or hand) of the loops
    shapes: tuple[tuple[int, int, bool], ...]
    laws: int  # degree of the control law, for the ripple; 0 without an encoder
    bound: bool  # the device's own force by position binds it, hand off
    linear: int  # rows
    felt: int  # limits on what is felt that are no rows


@lru_cache(maxsize=64)
def _smooth(structure: _Structure) -> Any:
    """Constraints, Routh's ratios of the loops before the others, and their dense Jacobian."""
    import casadi as ca

    y, parameters, _, _, constraints = _graph(structure)
    outputs = [constraints, ca.densify(ca.jacobian(constraints, y))]
    return ca.Function("smooth", [y, parameters], outputs)


@lru_cache(maxsize=64)
def _ipopt(structure: _Structure) -> Any:
    """The solver, with all constraints; its parameters end with the weights."""
    import casadi as ca

    y, parameters, weights, product, constraints = _graph(structure)
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
            "max_wall_time": _SECONDS,
            "bound_relax_factor": 0.0,
            # The Routh ratios are far from convex outside the stable set; with their exact second
            # derivatives one solve in two ends at the iteration limit, with BFGS one in fifteen.
            "hessian_approximation": "limited-memory",
        },
    }
    task = {"x": y, "p": ca.vertcat(parameters, weights), "f": -product, "g": constraints}
    return ca.nlpsol("product", "ipopt", task, options)


@lru_cache(maxsize=64)
def _graph(structure: _Structure) -> tuple[Any, Any, Any, Any, Any]:
    """Expressions of log-sizes, parameters, weights, product of steps and constraints."""
    import casadi as ca

    count = len(structure.signs)
    y, weights = ca.SX.sym("y", count), ca.SX.sym("w", count)
    taken: list[Any] = []

    def matrix(rows: int, columns: int) -> Any:
        symbols = ca.SX.sym("p", columns, rows)
        taken.append(ca.vec(symbols))
        return ca.transpose(symbols)

    def take(*shape: int) -> Any:
        column = matrix(int(np.prod(shape)), 1)
        return np.array(column.elements(), dtype=object).reshape(shape)

    sizes, signs = ca.exp(y), ca.DM(structure.signs)
    scales, used, room = matrix(count, 3), *(matrix(structure.linear, count) for _ in range(2))
    factors, felt = matrix(len(structure.ratios), 1), matrix(structure.felt, 4 + 2 * count)
    heights = signs * _height(signs * sizes, scales)
    product_of_steps = ca.dot(weights, ca.log(heights))
    values = (signs * sizes).elements()
    totals = [
        [sum((values[i] for i in m), 0.0) if m else None for m in members]
        for members in structure.combinations
    ]
    constraints: list[Any] = []
    if structure.laws:
        table, law = take(4, structure.laws + 1), take(4, structure.laws + 1)
        for total in compress(totals, structure.quiet):
            numerator = convolve(list(law[0]), _polynomial(law, total, free=False, drop=False))
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
    # What uses a limit against what makes room, in logarithms nearly linear.
    constraints.append(ca.log(used @ sizes + _NOTHING) - ca.log(room @ sizes + 1))
    for place, (i, j) in enumerate(structure.ratios):
        constraints.append(ca.log(factors[place]) + y[i] - y[j])
    given, asked = (
        _height(felt[:, 4 + first : 4 + first + count] @ sizes, felt[:, 1:4])
        for first in (0, count)
    )
    constraints.append(felt[:, 0] * (given - asked) - 1)
    return y, ca.vertcat(*taken), weights, product_of_steps, ca.vertcat(*routh, *constraints)


def _height(values: Any, scales: Any) -> Any:
    """`Scale.height` of a column of values, `Scale.parts` of each as columns."""
    import casadi as ca

    top, base, corner = ca.horzsplit(scales)
    above: Any = ca.fmax(values, top) - ca.fmax(0, top)
    below: Any = ca.fmin(values, top) - ca.fmin(0, top)
    return ca.log1p(above / base) + below / corner


def _polynomial(table: Any, total: list[Any], *, free: bool = True, drop: bool = True) -> list[Any]:
    """Coefficients of one combination; without a spring the factor w is dropped if asked to."""
    start = 1 if drop and total[0] is None else 0
    there = [(effect, value) for effect, value in enumerate(total, 1) if value is not None]
    return [
        sum((table[effect, k] * value for effect, value in there), table[0, k] if free else 0.0)
        for k in range(start, table.shape[1])
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A problem with numbers in."""

    structure: _Structure
    # of this problem, without the weights of a rank; those of the loops come last
    parameters: FloatArray
    plain: int  # how many of them belong to no loop
    stability: StabilityLimits  # limits with slopes of their own
    signs: FloatArray
    scales: FloatArray  # of the steps, `Scale.parts`, shape (unknowns, 3)
    per_step: FloatArray  # 1/ln(1 + w) of each unknown

    def product(self, sizes: FloatArray, weights: FloatArray) -> tuple[float, FloatArray]:
        """The weighted sum of the logarithms of steps, and its gradient in log-sizes."""
        top, base, corner = self.scales.T
        values = self.signs * sizes
        relative = (np.maximum(values, top) - np.maximum(0.0, top)) / base
        heights = np.log1p(relative) + (np.minimum(values, top) - np.minimum(0.0, top)) / corner
        used = weights > 0
        logs = np.log(np.where(used, np.abs(heights) * self.per_step, 1.0))
        slopes = values / base / (1 + relative) / np.where(heights == 0, 1.0, heights)
        return float(weights @ logs), weights * slopes


def program_of(problem: Problem, scenarios: Sequence[Scenario]) -> Program:
    """The program of a problem; compiles it if no problem of its structure came before."""
    limits = problem.limits
    shown: list[tuple[Loop, list[int]]] = []
    for index, loop in enumerate(problem.loops.late):
        if columns := [column for place, column in scenarios if place == index]:
            # Up to a power of two, so that structures are met again.
            size = 1 << (len(columns) - 1).bit_length()
            shown.append((loop, columns + columns[-1:] * (size - len(columns))))
    ripple = limits.encoder_resolution is not None
    rows = problem.linear.rows[problem.linear.shown] * (1 + _INSIDE)
    structure = _Structure(
        signs=tuple(unknown.sign for unknown in problem.unknowns),
        combinations=tuple(combination.members for combination in problem.combinations),
        quiet=tuple(not combination.meeting for combination in problem.combinations),
        ratios=tuple((i, j) for i, j, _ in problem.linear.ratios),
        shapes=tuple((loop.degree, len(chosen), loop.grounded) for loop, chosen in shown),
        laws=problem.loops.nominal.degree if ripple else 0,
        bound=problem.loops.nominal.grounded,
        linear=len(rows),
        felt=sum(one.telling.size for one in problem.linear.felt),
    )
    scales = np.array([unknown.scale.parts for unknown in problem.unknowns])
    felt = [
        [one.per_step * (1 + _INSIDE), *one.scale.parts, *given, *one.asked]
        for one in problem.linear.felt
        for given in one.given[one.telling]
    ]
    gain = problem.margin.gain * (1 + _INSIDE)
    factors = np.array([factor for _, _, factor in problem.linear.ratios]) * (1 + _INSIDE)
    used, room = np.maximum(rows, 0.0), np.maximum(-rows, 0.0)
    numbers: list[FloatArray] = [scales, used, room, factors, np.array(felt)]
    if ripple and limits.encoder_resolution is not None:
        nominal = problem.loops.nominal
        unit = limits.encoder_resolution / nominal.scales[0] / np.sqrt(12) / limits.ripple
        numbers += [_table(nominal, 1.0), _law(nominal, float(unit * (1 + _INSIDE)))]
    plain = sum(part.size for part in numbers)
    numbers += [_table(loop, gain)[:, :, chosen] for loop, chosen in shown]
    stability = StabilityLimits(
        tables=tuple(corner_table(loop, chosen) for loop, chosen in shown),
        grounded=tuple(loop.grounded for loop, _ in shown),
        shares=(problem.shares(sprung=True), problem.shares(sprung=False)),
        gain=gain,
    )
    return Program(
        structure=structure,
        plain=plain,
        stability=stability,
        parameters=np.concatenate([part.ravel() for part in numbers]),
        signs=np.array([float(sign) for sign in structure.signs]),
        scales=scales,
        per_step=np.array([1 / np.log1p(u.scale.weber) for u in problem.unknowns]),
    )


def _table(loop: Loop, gain: float) -> FloatArray:
    """(4, degree+1, corners) in (K, B, M), each coefficient over its constant part's scale."""
    scales = np.stack([np.ones_like(loop.scales[0]), *(gain * np.asarray(s) for s in loop.scales)])
    terms = loop.terms
    table = np.stack([terms.free, terms.alpha, terms.beta, terms.gamma]) * scales[:, None]
    return table.reshape(4, loop.degree + 1, -1)


def _law(loop: Loop, unit: float) -> FloatArray:
    """(4, degree+1): plant denominator, and the control law times ``unit``."""
    scales = np.array([1.0, *(unit * float(s) for s in loop.scales)])
    parts = loop.transfer
    rows = (parts.plant_denominator, parts.alpha, parts.beta, parts.gamma)
    return np.stack([pad_coefficients(row, loop.degree + 1) for row in rows]) * scales[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rank:
    """What is raised at one rank, and between which ends of log-sizes."""

    weights: FloatArray  # of the logarithms of steps in the sum that is maximised
    lower: FloatArray  # of log-sizes; equal to ``upper`` where a size is fixed
    upper: FloatArray
    # judge stability by Routh's ratios at the full gain instead of by the exact limits, for they
    # are smooth where two branches of its boundary meet. Some solvers always do.
    routh: bool = False


class Evaluation:
    """Objective and constraints at one point y of log-sizes, without overhead: the last is kept.

    Attributes:
        value: minus the weighted sum of the logarithms of steps; slope is its gradient.
        constraints: at most 0 where kept; jacobian are their slopes, (constraints, unknowns).
    """

    def __init__(self, program: Program, rank: Rank) -> None:
        count = program.signs.size
        structure = program.structure if rank.routh else replace(program.structure, shapes=())
        function = _smooth(structure)
        smooth = int(function.numel_out(0))
        self._program = program
        self._weights = rank.weights
        # Routh's ratios stand for the limits of stability.
        self._stability = None if rank.routh else program.stability
        total = smooth + (0 if self._stability is None else self._stability.size)
        self._y = np.full(count, np.nan)
        plain = None if rank.routh else program.plain
        self._parameters = np.ascontiguousarray(program.parameters[:plain])
        self._smooth = np.empty(smooth)
        # CasADi stores by columns.
        self._columns = np.empty((count, smooth))
        self.value = np.nan
        self.slope: FloatArray = np.empty(count)
        self.constraints: FloatArray = np.empty(total)
        self.jacobian: FloatArray = np.zeros((total, count))
        self._buffer, self._evaluate = function.buffer()
        for place, given in enumerate((self._y, self._parameters)):
            self._buffer.set_arg(place, memoryview(cast("Any", given)))
        for place, answer in enumerate((self._smooth, self._columns)):
            self._buffer.set_res(place, memoryview(cast("Any", answer)))

    def at(self, y: FloatArray) -> Evaluation:
        """Itself, evaluated at log-sizes y."""
        if not np.array_equal(y, self._y):
            self._y[:] = y
            sizes = np.exp(y)
            value, slope = self._program.product(sizes, self._weights)
            self.value, self.slope[:] = -value, -slope
            if self._smooth.size:
                self._evaluate()
            self.constraints[: self._smooth.size] = self._smooth
            self.jacobian[: self._smooth.size] = self._columns.T
            if self._stability is not None:
                values, slopes = self._stability.at(sizes)
                self.constraints[self._smooth.size :] = values
                self.jacobian[self._smooth.size :] = slopes
        return self


class Ipopt:
    """Interior-point proposals through CasADi; they end a little beyond or before the boundary."""

    name = "ipopt"

    def propose(self, program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
        """Log-sizes from a start, after 150 iterations or 2 s at most; None where it gave up."""
        answer = _ipopt(program.structure)(
            x0=np.clip(start - _RETREAT, rank.lower, rank.upper),
            p=np.concatenate([program.parameters, rank.weights]),
            lbx=rank.lower,
            ubx=rank.upper,
            lbg=-np.inf,
            ubg=0.0,
        )
        proposal = np.asarray(answer["x"], dtype=np.float64).ravel()
        return proposal if np.all(np.isfinite(proposal)) else None


@dataclass(frozen=True, slots=True)
class Slsqp:
    """Sequential quadratic proposals, with the exact limits of stability."""

    tolerance: float = 1e-13  # of the sum of logarithms of steps, at which a search ends
    name: str = "slsqp"

    def propose(self, program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
        """Log-sizes from a start; None where it gave up."""
        program_at = Evaluation(program, rank)
        best: list[tuple[float, FloatArray]] = []  # kept in case nlopt ends by rounding

        def objective(y: FloatArray, gradient: FloatArray) -> float:
            here = program_at.at(y)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.slope)
            return here.value if np.isfinite(here.value) else _UNREACHABLE

        def constraints(result: FloatArray, y: FloatArray, gradient: FloatArray) -> None:
            here = program_at.at(y)
            result[:] = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.jacobian)
            value = objective(y, np.empty(0))
            if np.all(result <= _KEPT) and (not best or value < best[0][0]):
                best[:] = [(value, np.array(y))]

        y: FloatArray | None = start
        for _ in range(_STRIDES):
            lower, upper = _around(rank, start)
            rows = program_at.constraints.size
            y = _searched(objective, constraints, rows, start, lower, upper, self.tolerance)
            if y is None or not _stopped_short(y, rank, lower, upper):
                break
            start = y
        if best and (y is None or best[0][0] < objective(y, np.empty(0))):
            y = best[0][1]
        return y if y is not None and np.all(np.isfinite(y)) else None


#: One solver.
Backend = Slsqp | Ipopt


def least_violation(program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
    """Log-sizes at which the most broken constraint is as little broken as can be found."""
    program_at = Evaluation(program, rank)

    # Minimises t, the last of z, with every constraint at most t; t stops a little inside.
    def objective(z: FloatArray, gradient: FloatArray) -> float:
        if gradient.size:
            gradient[:] = 0.0
            gradient[-1] = 1.0
        return float(z[-1])

    def constraints(result: FloatArray, z: FloatArray, gradient: FloatArray) -> None:
        here = program_at.at(z[:-1])
        rows = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
        result[:] = rows - z[-1]
        if gradient.size:
            gradient[:, :-1] = np.nan_to_num(here.jacobian)
            gradient[:, -1] = -1.0

    y: FloatArray | None = None
    for _ in range(_STRIDES):
        lower, upper = _around(rank, start)
        rows = program_at.at(np.clip(start, lower, upper)).constraints
        worst = float(np.clip(np.nan_to_num(np.max(rows), nan=10.0), -_DEEP, 10.0))
        ends = np.append(lower, -_DEEP), np.append(upper, _UNREACHABLE)
        begin = np.append(start, worst)
        z = _searched(objective, constraints, rows.size, begin, *ends, relative=_STUCK)
        if z is None or not np.all(np.isfinite(z)):
            break
        y = z[:-1]
        if not _stopped_short(y, rank, lower, upper) or z[-1] <= -_DEEP:
            break
        start = y
    return y


def _around(rank: Rank, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of log-sizes that a search from a start looks at."""
    lower = np.maximum(rank.lower, np.minimum(start, rank.upper) - _STRIDE)
    upper = np.minimum(rank.upper, np.maximum(start, rank.lower) + _STRIDE)
    return lower, upper


def _stopped_short(y: FloatArray, rank: Rank, lower: FloatArray, upper: FloatArray) -> bool:
    """True where a search went as far as it was allowed to."""
    down, up = (y <= lower) & (lower > rank.lower), (y >= upper) & (upper < rank.upper)
    return bool(np.any(down | up))


def _searched(
    objective: Callable[[FloatArray, FloatArray], float],
    constraints: Callable[[FloatArray, FloatArray, FloatArray], None],
    rows: int,
    start: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    tolerance: float = 1e-6,
    *,
    relative: float = 0.0,
) -> FloatArray | None:
    """Where SLSQP ends: a step gains less than either tolerance; None where it fails."""
    import nlopt

    solver = nlopt.opt(nlopt.LD_SLSQP, start.size)
    solver.set_lower_bounds(lower)
    solver.set_upper_bounds(upper)
    solver.set_min_objective(objective)
    if rows:
        solver.add_inequality_mconstraint(constraints, np.full(rows, _KEPT))
    solver.set_maxeval(_EVALUATIONS)
    solver.set_maxtime(_SECONDS)
    solver.set_xtol_rel(1e-12)
    solver.set_ftol_abs(tolerance)
    solver.set_ftol_rel(relative)
    try:
        return np.asarray(solver.optimize(np.clip(start, lower, upper)), dtype=np.float64)
    except Exception:  # noqa: BLE001 - its classes differ between versions; None says it failed
        return None


def climb(
    value: Callable[[Sequence[float]], float],
    start: Sequence[float],
    ends: Sequence[tuple[float, float]],
    *,
    stride: float,
    gain: float,
    apart: float,
    known: float,
) -> list[float]:
    """The best point that a simplex meets which walks from a good start (Nelder and Mead).

    It asks for no slopes, which have edges where one limit takes over from another. A value is
    minus infinity where a point is not good. The simplex is a stride wide at first; the climb ends
    where its values differ by less than the gain or its places by less than ``apart``, or where it
    is farther from what is known from elsewhere, after some points, than it has come.
    """
    import nlopt

    low, high = (np.array(side) for side in zip(*ends, strict=True))
    begin = np.clip(np.array(start), low, high)
    met = [(value(begin.tolist()), begin.tolist())]
    if not np.isfinite(met[0][0]):
        return met[0][1]

    def met_at(place: FloatArray, _: FloatArray) -> float:
        met.append((value(place.tolist()), place.tolist()))
        if len(met) == _PATIENCE and 2 * max(met)[0] < met[0][0] + known:
            raise nlopt.ForcedStop
        return max(met[-1][0], met[0][0] - _CLIFF)

    solver = nlopt.opt(nlopt.LN_NELDERMEAD, begin.size)
    solver.set_lower_bounds(low)
    solver.set_upper_bounds(high)
    solver.set_max_objective(met_at)
    solver.set_initial_step(np.where(begin + stride > high, -stride, stride))
    solver.set_ftol_abs(gain)
    solver.set_xtol_abs(apart)
    solver.set_maxeval(_MOST_POINTS)
    with suppress(nlopt.ForcedStop):
        solver.optimize(begin)
    return max(met)[1]
