"""No pole can cross the unit circle anywhere in a region: proved by splitting it into cells.

In a cell of θ, of everything not known exactly and of gains between two ends, the condition of a
crossing D + s·N = 0 cannot be met if one straight line through zero has D + s·N strictly on one
side for both end gains: then also for every gain between them. Where no line is found the cell is
split across what moves D + s·N most, until every cell is excluded or the budget is spent. With one
point known to be stable, a region without crossings is stable throughout.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tune.certificate.cells import Cells, Claim, Proof, as_form, cover, mechanism_of, terms_of
from tune.certificate.forms import ROUNDING, FloatArray, Form
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.response import Response, respond

__all__ = ["Claim", "Proof", "prove"]


def prove(region: Region, setting: Setting, claims: Sequence[Claim], most_cells: int) -> Proof:
    """Exclude crossings everywhere in a region, for several claims at once.

    Args:
        region: the box.
        setting: what is played, not nothing.
        claims: gains and extra delays.
        most_cells: budget.
    """
    return cover(region, claims, lambda merged, cells: _examine(merged, setting, cells), most_cells)


def _examine(
    region: Region, setting: Setting, cells: Cells
) -> tuple[NDArray[np.bool_], FloatArray]:
    """(no crossing in the cell, how much each side moves the loop)."""
    moving = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
    symbols = [row for row in moving if row != 1]
    terms = terms_of(cells, symbols)
    with np.errstate(all="ignore"):
        response = respond(
            as_form(terms[0], cells, len(symbols)), mechanism_of(region, terms), setting
        )
        bottom, top = _at_ends(response, cells)
        excluded = _one_sided(bottom, top)
        if response.rising is not None and region.damping[0] >= 0:
            excluded |= response.rising > 0
        pull = np.zeros_like(cells.low)
        for index, row in enumerate(symbols):
            pull[row] = np.maximum(np.abs(bottom.slopes[index]), np.abs(top.slopes[index]))
        pull[1] = np.abs(response.varied.centre) * (cells.high[1] - cells.low[1]) / 2
        return excluded, pull


def _at_ends(response: Response, cells: Cells) -> tuple[Form, Form]:
    """D + s·N at both end gains; D with its zero at θ = 0 taken out where the lower gain is 0."""
    low, high = cells.low[1], cells.high[1]
    fixed, varied, start = response.fixed, response.varied, response.start
    top = fixed + varied * high
    above = fixed + varied * low
    none = low == 0
    bottom = Form(
        np.where(none, start.centre, above.centre),
        np.where(none, start.slopes, above.slopes),
        np.where(none, start.real, above.real),
        np.where(none, start.imag, above.imag),
    )
    return bottom, top


def _one_sided(bottom: Form, top: Form) -> NDArray[np.bool_]:
    """Both forms strictly on the same side of some line through zero.

    The best line runs along an edge of one of the two sets, or square to one of the centres.
    """
    excluded = np.zeros(bottom.centre.shape, dtype=np.bool_)
    middle = bottom.centre / np.abs(bottom.centre) + top.centre / np.abs(top.centre)
    normals = [bottom.centre, top.centre, middle]
    normals += [1j * slope for form in (bottom, top) for slope in form.slopes]
    for normal in normals:
        unit = normal / np.abs(normal)
        # Turned so that the centres are on the positive side.
        unit = unit * np.where((np.conj(unit) * middle).real < 0, -1, 1)
        clear = np.minimum(_clearance(bottom, unit), _clearance(top, unit))
        excluded |= clear > 0
    return excluded


def _clearance(form: Form, unit: NDArray[np.complex128]) -> FloatArray:
    """Least distance from the line through zero with this normal; nan where there is no normal."""
    across, along = unit.real, unit.imag
    centre = across * form.centre.real + along * form.centre.imag
    slopes = np.sum(np.abs(across * form.slopes.real + along * form.slopes.imag), axis=0)
    rest = np.abs(across) * form.real + np.abs(along) * form.imag
    size = np.abs(form.centre) + np.sum(np.abs(form.slopes), axis=0)
    return centre - slopes - rest - ROUNDING * size
