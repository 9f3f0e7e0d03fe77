"""The stable region over damping and mass as a surface of stiffness, in numbers a page can draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import UNITS
from tune.documents.profile import Design
from tune.presentation.boundaries import Boundaries

FloatArray = NDArray[np.float64]

#: Lines of the surface along damping and along mass.
_LINES = (26, 15)
#: Masses that are drawn at least, parts of the device's own, and beyond those that are played.
_LIGHTER, _HEAVIER, _BEYOND = -0.3, 0.5, 1.4
#: Of the largest stiffness that is drawn, what the highest place of the surface stands above.
_ROOM = 1.05
#: Ticks of an axis, about.
_TICKS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One axis of the picture: what it measures and where its ticks stand, from 0 to 1."""

    title: str
    ticks: tuple[tuple[float, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """One element in the picture."""

    name: str
    at: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """Stiffness over damping and mass; all coordinates run from 0 to 1.

    Axes grow as the square root, so that what is played stays apart from zero.

    Attributes:
        axes: damping, mass, stiffness.
        damping: of the lines, in rising order, 0 to 1.
        mass: of the lines, in rising order, 0 to 1.
        margin: height with the whole margin, one row a mass.
        worst: height at the worst corner of the box, cut at the top.
        elements: where each is.
    """

    axes: tuple[Axis, Axis, Axis]
    damping: tuple[float, ...]
    mass: tuple[float, ...]
    margin: tuple[tuple[float, ...], ...]
    worst: tuple[tuple[float, ...], ...]
    elements: tuple[Place, ...]


def region_surface(design: Design, boundaries: Boundaries) -> Surface:
    """The surface of a design, its elements beside it."""
    units, played = UNITS[design.device.motion], list(design.elements.values())
    own = design.device.mass.value
    masses = [element.mass for element in played]
    dampings = [element.damping for element in played]
    mass_ends = (
        _BEYOND * min(_LIGHTER * own / _BEYOND, *masses),
        _BEYOND * max(_HEAVIER * own / _BEYOND, *masses),
    )
    most = boundaries.damping_with_margin(0.0, max(0.0, *dampings), 0.0)
    damping_ends = (_BEYOND * min(0.0, *dampings), max(1.05 * most, 0.1 * boundaries.damping))
    B, M = (
        _spread(*ends, count) for ends, count in zip((damping_ends, mass_ends), _LINES, strict=True)
    )
    across, along = np.meshgrid(B, M)
    margin = boundaries.with_margin(across, along)
    worst = boundaries.at_worst(across, along)
    stiffness = [element.stiffness for element in played]
    top = _ROOM * max(float(np.max(margin)), *stiffness) or 1.0
    scales = (_Scale(*damping_ends), _Scale(*mass_ends), _Scale(0.0, top))
    return Surface(
        axes=(
            Axis(title=f"damping B, {units['damping']}", ticks=scales[0].ticks()),
            Axis(title=f"mass M, {units['mass']}", ticks=scales[1].ticks()),
            Axis(title=f"stiffness K, {units['stiffness']}", ticks=scales[2].ticks()),
        ),
        damping=_rounded(scales[0].place(B)),
        mass=_rounded(scales[1].place(M)),
        margin=tuple(_rounded(scales[2].place(row)) for row in margin),
        worst=tuple(_rounded(scales[2].place(np.minimum(row, top))) for row in worst),
        elements=tuple(
            Place(
                name=name,
                at=(
                    float(scales[0].place(np.array(element.damping))),
                    float(scales[1].place(np.array(element.mass))),
                    float(scales[2].place(np.array(element.stiffness))),
                ),
            )
            for name, element in design.elements.items()
        ),
    )


@dataclass(frozen=True, slots=True)
class _Scale:
    """From a quantity to 0 to 1, as its square root."""

    least: float
    most: float

    def place(self, values: FloatArray) -> FloatArray:
        low, high = _root(np.array([self.least, self.most]))
        return (_root(values) - low) / (high - low)

    def ticks(self) -> tuple[tuple[float, str], ...]:
        """Round values that lie within."""
        step = _round_step((self.most - self.least) / _TICKS)
        first, last = np.ceil(self.least / step), np.floor(self.most / step)
        values: FloatArray = step * np.arange(first, last + 1, dtype=np.float64)
        places = np.round(self.place(values), 4)
        return tuple(
            (float(places[index]), f"{float(values[index]):.6g}") for index in range(values.size)
        )


def _round_step(least: float) -> float:
    """1, 2 or 5 times a power of ten, not below a number."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * times for times in (1, 2, 5, 10) if power * times >= least))


def _spread(least: float, most: float, count: int) -> FloatArray:
    """Places that are even on a scale, zero among them where it is inside."""
    low, high = _root(np.array([least, most]))
    places: FloatArray = np.linspace(float(low), float(high), count)
    if least < 0 < most:
        places[np.argmin(np.abs(places))] = 0.0
    return np.sign(places) * np.square(places)


def _root(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.sqrt(np.abs(values))


def _rounded(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(each) for each in np.round(values, 4))
