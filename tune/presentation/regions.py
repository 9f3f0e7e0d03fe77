"""The stable region of a device: its boundaries, its slice at one mass, its whole surface."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification import legend_above
from tune.documents.profile import Design, ElementProfile
from tune.documents.scene import UNITS, Effects, format_number
from tune.loop.loop import Filters, Loop, filters_of
from tune.optimisation.region import DelayedLoops, Region
from tune.stability.verdict import largest, stable_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

#: Colours that colour-blind readers tell apart.
BLUE, VERMILION = "#0072B2", "#D55E00"

#: Parts of the margin's gain at which a point is judged: every gain below is to be stable too.
_PARTS = (0.25, 0.5, 0.75, 1.0)
#: Damping of a device that has as good as none, as a scale.
_LEAST_SCALE = 1e-9
#: Dampings at which the boundaries of a slice are computed.
_PLACES = 160
#: What is drawn of a slice goes this much beyond what is played or may be.
_BEYOND = 1.15
#: Lines of the surface along damping and along mass.
_LINES = (26, 15)
#: Masses that the surface has at least, parts of the device's own, and beyond what is played.
_LIGHTER, _HEAVIER, _FURTHER = -0.3, 0.5, 1.4
#: Of the largest stiffness that is drawn, what the highest place of the surface stands above.
_ROOM = 1.05
#: Heights are told up to this many times the top, above which a page cuts them.
_OVER = 9.0
#: Ticks of an axis of the surface, about.
_TICKS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Boundaries:
    """The largest stiffness for given damping and mass, on the device of a design."""

    nominal: Loop  # at the best estimate
    corners: tuple[DelayedLoops, ...]  # of the box, at every delay up to the margin's
    gain: float  # of the margin
    damping: float  # of the device itself at its best estimate, N·s/m: a scale

    @classmethod
    def of(cls, design: Design, filters: Filters | None = None) -> Boundaries:
        """On the device, hand and filters of a design; other filters where they are given."""
        used = filters or filters_of(design.loop)
        extra = design.margin.extra_delay_samples
        region = Region.of(design.device, design.hand, extra=extra)
        return cls(
            nominal=Loop.from_parts(design.device, used),
            corners=region.loops(used, extra),
            gain=design.margin.gain,
            damping=max(abs(design.device.damping.value), _LEAST_SCALE),
        )

    def at_best(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stable stiffness on the best estimate, of the broadcast shape, N/m."""
        B, M = np.broadcast_arrays(damping, mass)
        return largest(self.nominal, "stiffness", Effects(damping=B, mass=_present(M)))

    def at_worst(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stiffness that is stable at every corner of the box and delay of the device.

        N/m, of the broadcast shape of damping and mass.
        """
        return self._least(damping, mass, (1.0,), late=False)

    def with_margin(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stiffness stable at every corner with the extra delay, at gains up to the margin.

        N/m, of the broadcast shape of damping and mass. Judged at a few gains from zero up; the
        certificate judges them all.
        """
        return self._least(damping, mass, self._gains(), late=True)

    def damping_with_margin(self, stiffness: float, damping: float, mass: float) -> float:
        """Damping up to which a stiffness and a mass keep the whole margin, from one that does.

        The damping to begin with where not even that keeps the margin.
        """
        found: list[float] = []
        for gain in self._gains():
            K, M = np.array([gain * stiffness]), np.array([gain * mass])
            others = Effects(stiffness=_present(K), mass=_present(M))
            for each in self.corners:
                low, high = stable_values(each.loop, "damping", others)
                start = gain * max(damping, 0.0)
                inside = (low <= start) & (high > start)
                found.append(float(np.min(np.max(np.where(inside, high, 0.0), axis=0))) / gain)
        return max(min(found), damping)

    def _gains(self) -> tuple[float, ...]:
        return tuple(part * self.gain for part in _PARTS)

    def _least(
        self, damping: FloatArray, mass: FloatArray | float, gains: tuple[float, ...], *, late: bool
    ) -> FloatArray:
        """Least over corners and gains, of the broadcast shape."""
        B, M = np.broadcast_arrays(damping, mass)
        gain = np.reshape(gains, (-1, *(1,) * (B.ndim + 1)))
        effects = Effects(damping=gain * B[..., None], mass=_present(gain * M[..., None]))
        found = [
            np.min(largest(each.loop, "stiffness", effects) / gain, axis=(0, -1))
            for each in self.corners
            if late or each.beyond == 0
        ]
        return np.min(found, axis=0)


def _present(values: FloatArray) -> FloatArray | None:
    """An effect that is nowhere is not there at all."""
    return values if np.any(values) else None


def draw_region(
    axes: Axes,
    boundaries: Boundaries,
    mass: float,
    damping: tuple[float, float],
    stiffness: float,
    units: dict[str, str],
) -> None:
    """Three boundaries at one mass, kg, on axes that grow as the square root.

    Damping from the least to the largest, N·s/m, and stiffness, N/m, have to be seen.
    """
    # From the least that is stable, or zero, to the largest with the whole margin.
    most = boundaries.damping_with_margin(0.0, damping[1], mass)
    least = _BEYOND * damping[0]
    most = _BEYOND * max(most, damping[1], 0.1 * boundaries.damping)
    grid = _spread(least, most, _PLACES)
    best = boundaries.at_best(grid, mass)
    worst = boundaries.at_worst(grid, mass)
    safe = boundaries.with_margin(grid, mass)
    axes.set_xscale("function", functions=(_root, _square))
    axes.set_yscale("function", functions=(_root, _square))
    axes.fill_between(grid, best, color="0.9", lw=0, label="stable, best estimate")
    axes.plot(grid, worst, color=VERMILION, lw=1.3, ls="--", label="worst corner of the box")
    axes.fill_between(grid, safe, color=BLUE, alpha=0.35, lw=0, label="with the whole margin")
    top = _BEYOND * max(float(np.max(safe)), stiffness) or float(np.max(best))
    axes.set_xlim(least, most)
    axes.set_ylim(0, top if top > 0 else 1.0)
    axes.set_xlabel(f"damping B, {units['damping']} (square-root scale)", fontsize=8)
    axes.set_ylabel(f"stiffness K, {units['stiffness']} (square-root scale)", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=6)
    axes.ticklabel_format(style="plain", useOffset=False)
    legend_above(axes)


def draw_slice(
    axes: Axes, boundaries: Boundaries, element: ElementProfile, units: dict[str, str]
) -> None:
    """The plane of one element, its place, and how far from it the boundary of the margin is."""
    K, B, M = element.stiffness, element.damping, element.mass
    draw_region(axes, boundaries, M, (min(B, 0.0), max(B, 0.0)), K, units)
    to_stiffness = float(boundaries.with_margin(np.array(B), M))
    to_damping = boundaries.damping_with_margin(K, B, M)
    words: list[str] = []
    top = float(axes.get_ylim()[1])
    if to_stiffness > K:
        axes.plot([B, B], [K, min(to_stiffness, top)], color="k", lw=0.9, ls=":")
        words.append(f"K up to {format_number(to_stiffness)} {units['stiffness']}")
    if to_damping > B:
        end = min(to_damping, float(axes.get_xlim()[1]))
        axes.plot([B, end], [K, K], color="k", lw=0.9, ls=":", clip_on=False)
        words.append(f"B up to {format_number(to_damping)} {units['damping']}")
    axes.plot([B], [K], "ko", ms=6, clip_on=False, zorder=5)
    left = " or ".join(words) or "nothing"
    plane = f"plane M = {M:.3g} {units['mass']}, the element alone"
    set_small_title(axes, f"{plane}\nleft to the whole margin, dotted: {left}")


def set_small_title(axes: Axes, words: str) -> None:
    """A title in small letters above the legend."""
    axes.set_title(words, fontsize=8, loc="left", pad=16)


def region_surface(design: Design, boundaries: Boundaries) -> dict[str, object]:
    """Stiffness over damping and mass as a page draws it; all coordinates run from 0 to 1.

    Axes grow as the square root, so that what is played stays apart from zero. Heights, with the
    whole margin and at the worst corner of the box, have one row a mass, of
    dampings of its own.
    """
    units, elements = UNITS[design.device.motion], list(design.elements.values())
    own = design.device.mass.value
    masses = [element.mass for element in elements]
    dampings = [element.damping for element in elements]
    mass_ends = (
        _FURTHER * min(_LIGHTER * own / _FURTHER, *masses),
        _FURTHER * max(_HEAVIER * own / _FURTHER, *masses),
    )
    least, scale = _FURTHER * min(0.0, *dampings), 0.1 * boundaries.damping
    M = _spread(*mass_ends, _LINES[1])
    if M[0] < 0 < M[-1]:
        M[np.argmin(np.abs(M))] = 0.0
    # Each row ends where not even a damper alone keeps the margin: there its height is zero.
    ends = [max(boundaries.damping_with_margin(0.0, 0.0, mass), scale) for mass in M]
    across = np.stack([_spread(least, end, _LINES[0]) for end in ends])
    margin = boundaries.with_margin(across, M[:, None])
    margin[:, -1] = 0.0
    worst = boundaries.at_worst(across, M[:, None])
    damping_ends = (least, max(*ends, *dampings))
    top = _ROOM * max(float(np.max(margin)), *(element.stiffness for element in elements)) or 1.0
    scales = (_Scale(*damping_ends), _Scale(*mass_ends), _Scale(0.0, top))
    names = ("damping", "B"), ("mass", "M"), ("stiffness", "K")
    return {
        "axes": [
            {"title": f"{name} {symbol}, {units[name]}", "ticks": scale.ticks()}
            for (name, symbol), scale in zip(names, scales, strict=True)
        ],
        "damping": [_rounded(scales[0].place(row)) for row in across],
        "mass": _rounded(scales[1].place(M)),
        "margin": [_rounded(scales[2].place(row)) for row in margin],
        "worst": [_rounded(scales[2].place(np.minimum(row, _OVER * top))) for row in worst],
        "elements": [
            {
                "name": name,
                "at": [
                    float(scale.place(np.array(value)))
                    for scale, value in zip(scales, (e.damping, e.mass, e.stiffness), strict=True)
                ],
            }
            for name, e in design.elements.items()
        ],
    }


@dataclass(frozen=True, slots=True)
class _Scale:
    """From a quantity to 0 to 1, as its square root."""

    least: float
    most: float

    def place(self, values: FloatArray) -> FloatArray:
        low, high = _root(np.array([self.least, self.most]))
        return (_root(values) - low) / (high - low)

    def ticks(self) -> list[tuple[float, str]]:
        """Round values that lie within: multiples of 1, 2 or 5 times a power of ten."""
        least = (self.most - self.least) / _TICKS
        power = 10.0 ** np.floor(np.log10(least))
        step = float(next(power * times for times in (1, 2, 5, 10) if power * times >= least))
        first, last = np.ceil(self.least / step), np.floor(self.most / step)
        values: FloatArray = step * np.arange(first, last + 1, dtype=np.float64)
        places = np.round(self.place(values), 4)
        return [(float(places[k]), f"{float(values[k]):.6g}") for k in range(values.size)]


def _spread(least: float, most: float, count: int) -> FloatArray:
    """Places that are even on axes that grow as the square root."""
    low, high = _root(np.array([least, most]))
    return _square(np.linspace(float(low), float(high), count))


def _root(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.sqrt(np.abs(values))


def _square(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.square(values)


def _rounded(values: FloatArray) -> list[float]:
    return [float(each) for each in np.round(values, 4)]
