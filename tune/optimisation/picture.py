"""Pictures of a profile: where its elements lie in the stable region, and what they feel like."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.documents.profile import SafeProfile
from tune.loop.filters import filters_of
from tune.loop.loop import Loop
from tune.optimisation.region import Region
from tune.stability.verdict import largest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

_UNITS = {
    "linear": {"stiffness": "N/m", "damping": "N·s/m", "mass": "kg"},
    "rotary": {"stiffness": "N·m/rad", "damping": "N·m·s/rad", "mass": "kg·m²"},
}


def profile_picture(profile: SafeProfile) -> Figure:
    """Stable region in (B, K) with every element in it, beside the perceived steps of each effect.

    The boundaries are exact: the largest stiffness for each damping, for the best estimate of the
    device, for the worst corner of its box, and for that corner with the whole margin kept.
    """
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    _region(left, profile)
    _steps(right, profile)
    late = profile.margin.extra_delay_samples
    figure.suptitle(
        f"{profile.scene} on {profile.device.name}: safe for every gain up to "
        f"{profile.margin.gain:g} with {late} extra sample{'s' * (late != 1)}"
    )
    return figure


def _region(axes: Axes, profile: SafeProfile) -> None:
    units = _UNITS[profile.device.motion]
    filters = filters_of(profile.loop)
    certificate, extra = profile.certificate, profile.margin.extra_delay_samples
    nominal = Loop.from_parts(profile.device, filters)
    most = 1.05 * float(largest(nominal, "damping"))
    grid = np.linspace(0, most, 400)
    effects = Effects(damping=grid)
    axes.fill_between(
        grid, largest(nominal, "stiffness", effects), color="0.9", label="stable, best estimate"
    )
    corners = Region.of(profile.device, profile.hand, extra=extra).loops(filters, extra)

    def worst(gain: float, beyond: float) -> FloatArray:
        more = Effects(damping=gain * grid[:, None])
        found = [
            np.min(largest(late.loop, "stiffness", more), axis=-1)
            for late in corners
            if late.beyond <= beyond
        ]
        return np.min(found, axis=0) / gain

    axes.plot(grid, worst(1.0, 0), color="tab:orange", label="worst corner of the device's box")
    axes.fill_between(
        grid,
        worst(certificate.gain, extra),
        color="tab:green",
        alpha=0.35,
        label="with the whole margin",
    )
    for number, (name, element) in enumerate(profile.elements.items()):
        # The region is drawn for M = 0; an element with a mass lies in another plane.
        fill = "none" if element.mass else "black"
        axes.scatter([element.damping], [element.stiffness], s=25, facecolors=fill, edgecolors="k")
        note = name + (f", M = {element.mass:.2g} {units['mass']}" if element.mass else "")
        axes.annotate(
            note,
            (element.damping, element.stiffness),
            xytext=(6, 5 + (12 * number if element.stiffness == 0 else 0)),
            textcoords="offset points",
            fontsize=8,
        )
    axes.set_xscale("symlog", linthresh=10)
    axes.set_yscale("symlog", linthresh=100)
    axes.set_xlabel(f"virtual damping B, {units['damping']} (region drawn for M = 0)")
    axes.set_ylabel(f"virtual stiffness K, {units['stiffness']}")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=7, loc="lower right")


def _steps(axes: Axes, profile: SafeProfile) -> None:
    units = _UNITS[profile.device.motion]
    labels: list[str] = []
    steps: list[float] = []
    words: list[str] = []
    for name, element in profile.elements.items():
        for effect, reason in element.limited_by.items():
            labels.append(f"{name} {effect}")
            steps.append(element.perceived_steps.get(effect, 0.0))
            value: float = getattr(element, effect)
            why = "as wanted" if reason == "wanted" else f"limited by {reason}"
            bounce = element.contact and element.contact.restitution
            if effect == "stiffness" and bounce:
                why += f", gives back {bounce[0]:.2g} to {bounce[1]:.2g} of the speed"
            words.append(f" {value:.4g} {units[effect]}, {why}")
    places = np.arange(len(labels))[::-1]
    axes.barh(places, steps, color="tab:green", alpha=0.6)
    axes.axvline(1, color="k", lw=0.8, ls=":")
    axes.set_yticks(places, labels)
    for place, step, word in zip(places, steps, words, strict=True):
        axes.text(step, float(place), word, va="center", fontsize=7)
    axes.set_xlim(0, 2.2 * max([*steps, 1.0]))
    axes.set_xlabel("steps a hand can tell apart")
