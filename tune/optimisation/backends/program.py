"""The design problem as a smooth program: numbers for a graph that equal structures share.

Unknowns are the logarithms y of the sizes. Every constraint reads g <= 0: the reach of stability,
which gives values and slopes, and those that are compiled (`graph`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.loop.loop import Loop, Terms
from tune.loop.polynomials import pad_coefficients
from tune.optimisation.backends.graph import Functions, Structure
from tune.optimisation.backends.reach import Reach
from tune.optimisation.problem import Problem

FloatArray = NDArray[np.float64]
#: (loop of ``problem.loops.late``, column): one corner at one delay, with the hand or without.
Scenario = tuple[int, int]

#: The program keeps this much more than asked, relative, so that solvers, which end on or a little
#: beyond the boundary, end inside; it costs as much in optimality.
INSIDE = 2e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A problem with numbers in.

    Attributes:
        functions: shared by all problems of the structure.
        parameters: of this problem, without the weights of a rank, shape (parameters,); those of
            the loops come last.
        plain: how many of them belong to no loop.
        reach: of stability, with slopes of its own.
        signs: of the unknowns, shape (unknowns,).
        scales: of the steps, `Scale.parts`, shape (unknowns, 3).
        per_step: 1/ln(1 + w), no unit, shape (unknowns,).
    """

    functions: Functions
    parameters: FloatArray
    plain: int
    reach: Reach
    signs: FloatArray
    scales: FloatArray
    per_step: FloatArray

    def product(self, sizes: FloatArray, weights: FloatArray) -> tuple[float, FloatArray]:
        """The weighted sum of the logarithms of steps, and its gradient in log-sizes.

        Sizes, weights and gradient have shape (unknowns,).
        """
        top, base, corner = self.scales.T
        values = self.signs * sizes
        relative = (np.maximum(values, top) - np.maximum(0.0, top)) / base
        heights = np.log1p(relative) + (np.minimum(values, top) - np.minimum(0.0, top)) / corner
        used = weights > 0
        logs = np.log(np.where(used, np.abs(heights) * self.per_step, 1.0))
        slopes = values / base / (1 + relative) / np.where(heights == 0, 1.0, heights)
        return float(weights @ logs), weights * slopes


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
    rows = problem.linear.rows * (1 + INSIDE)
    either = np.any(rows < 0, axis=1)
    rows = np.concatenate([rows[~either], rows[either]])
    structure = Structure(
        signs=tuple(unknown.sign for unknown in problem.unknowns),
        moments=tuple(moment.members for moment in problem.moments),
        quiet=tuple(not moment.meeting for moment in problem.moments),
        ratios=tuple((i, j) for i, j, _ in problem.linear.ratios),
        shapes=tuple((loop.degree, len(chosen), loop.grounded) for loop, chosen in shown),
        laws=problem.loops.nominal.degree if ripple else 0,
        bound=problem.loops.nominal.grounded,
        linear=(int(np.sum(~either)), int(np.sum(either))),
        felt=len(problem.linear.felt),
    )
    scales = np.array([unknown.scale.parts for unknown in problem.unknowns])
    felt = [
        [one.per_step * (1 + INSIDE), *one.scale.parts, *one.given, *one.asked]
        for one in problem.linear.felt
    ]
    gain = problem.margin.gain * (1 + INSIDE)
    factors = np.array([factor for _, _, factor in problem.linear.ratios]) * (1 + INSIDE)
    numbers: list[FloatArray] = [scales, rows, factors, np.array(felt)]
    if ripple and limits.encoder_resolution is not None:
        nominal = problem.loops.nominal
        unit = limits.encoder_resolution / nominal.scales[0] / np.sqrt(12) / limits.ripple
        numbers += [_table(nominal, 1.0), _law(nominal, float(unit * (1 + INSIDE)))]
    plain = sum(part.size for part in numbers)
    numbers += [_table(loop, gain)[:, :, chosen] for loop, chosen in shown]
    return Program(
        functions=Functions(structure=structure),
        plain=plain,
        reach=Reach.of(problem, shown, gain),
        parameters=np.concatenate([part.ravel() for part in numbers]),
        signs=np.array([float(sign) for sign in structure.signs]),
        scales=scales,
        per_step=np.array([1 / np.log1p(u.scale.weber) for u in problem.unknowns]),
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
    return np.stack([pad_coefficients(row, loop.degree + 1) for row in rows]) * scales[:, None]
