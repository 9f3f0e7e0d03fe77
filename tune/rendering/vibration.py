"""Is the vibration that the encoder makes felt? Its spectrum against a threshold curve.

The curve is data with a source: the least displacement of a steady sinusoid that a hand detects.
Where the spectrum of the handle's displacement, divided by the curve, sums to more than 1, the
vibration is said to be felt: the energies of a band add up in the Pacinian channel.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from identification import Document, load_document
from tune.documents.effects import Effects
from tune.documents.errors import LoopError
from tune.loop.closed_loop import closed_loops, value
from tune.loop.loop import Loop
from tune.rendering.ripple import law_numerator

FloatArray = NDArray[np.float64]

#: Nodes of one panel of Gauss and Legendre's rule, between neighbouring corners of the curve and
#: resonances of the loop.
_NODES = 16
#: Halved panels agree to this, relative: far below what is known of any threshold.
_AGREE = 1e-6
#: Halvings of all panels; two are usual, since panels grow from each resonance outwards.
_MOST_HALVINGS = 6
#: Edges of panels around a pole: its distance from the axis times these.
_AROUND = 3.0 ** np.arange(-1, 12)
#: Hz. Below, no hand calls it vibration.
_LOWEST = 1.0


class ThresholdPoint(Document):
    """Least displacement that is felt at one frequency."""

    frequency_hz: float = Field(gt=0)
    displacement: float = Field(gt=0)


class ThresholdCurve(Document):
    """Vibrotactile thresholds; data that a user can replace with a file of this form.

    Attributes:
        source: where the numbers are from, and how sure that is.
        amplitude: what the displacements are: ``peak`` (zero to peak) or ``rms``.
        unit: m, of the handle.
        points: by rising frequency; straight lines between them in logarithms, held beyond them.
    """

    schema_: Literal["haptune/vibration/1"] = Field(default="haptune/vibration/1", alias="schema")
    name: str
    source: str
    amplitude: Literal["peak", "rms"]
    unit: Literal["m"] = "m"
    points: tuple[ThresholdPoint, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _rising(self) -> ThresholdCurve:
        frequencies = [point.frequency_hz for point in self.points]
        if any(b <= a for a, b in pairwise(frequencies)):
            raise ValueError("frequency_hz must rise from point to point")
        return self

    def rms(self, frequency_hz: FloatArray) -> FloatArray:
        """Threshold at given frequencies (Hz), m rms, of the same shape."""
        frequencies = np.log([point.frequency_hz for point in self.points])
        displacements = np.log([point.displacement for point in self.points])
        scale = np.sqrt(0.5) if self.amplitude == "peak" else 1.0
        return scale * np.exp(np.interp(np.log(frequency_hz), frequencies, displacements))


@cache
def default_thresholds() -> ThresholdCurve:
    """The hand around a cylinder; its source says how sure the numbers are."""
    with as_file(files("tune") / "data" / "grasped_cylinder.yaml") as path:
        return load_document(ThresholdCurve, Path(path))


def handle_spectrum(
    loop: Loop, effects: Effects, encoder_resolution: float, frequency_hz: FloatArray
) -> FloatArray:
    """Spectral density of the handle's displacement from quantisation, m²/Hz, one-sided.

    Args:
        loop: of shape (), scaled by mass and sample time.
        effects: single values of a stable setting.
        encoder_resolution: Δ, m.
        frequency_hz: above 0 to the Nyquist frequency 1/(2T), Hz.

    Returns:
        Of the shape of ``frequency_hz``; its integral is the square of `ripple.handle_vibration`.
    """
    frequency_hz = np.asarray(frequency_hz, dtype=np.float64)
    (one,), _ = closed_loops(loop, effects)
    law = law_numerator(loop, effects)
    if law is None:
        return np.zeros_like(frequency_hz)
    v = np.tan(np.pi * frequency_hz * one.sample_time)
    closed, _ = loop.polynomial(effects)
    response = value(loop.transfer.handle_numerator, v) * value(law, v) / value(closed, v)
    density = encoder_resolution**2 / 12 * 2 * one.sample_time
    return density * np.abs(response) ** 2


def vibration_in_thresholds(
    loop: Loop,
    effects: Effects,
    encoder_resolution: float,
    curve: ThresholdCurve | None = None,
) -> float:
    """Vibration of the handle from quantisation, in thresholds: above 1 it is felt.

    √∫ S(f)/threshold(f)² df from 1 Hz to the Nyquist frequency, by Gauss and Legendre's rule with
    panels halved until two agree to 1e-6.

    Args:
        loop: of shape (), a linear axis, scaled by mass and sample time.
        effects: single values of a stable setting.
        encoder_resolution: Δ, m.
        curve: thresholds; None is `default_thresholds`.

    Raises:
        LoopError: the panels do not agree; the loop rings too sharply to be safe.
    """
    chosen = curve or default_thresholds()
    (one,), _ = closed_loops(loop, effects)
    nyquist = 0.5 / one.sample_time
    lowest = min(_LOWEST, nyquist / 2)
    poles = one.poles()
    poles = poles[np.isfinite(poles)]
    reach = np.abs(poles.real)[:, None] * np.concatenate([-_AROUND, [0.0], _AROUND])
    around = np.arctan(np.abs(poles.imag[:, None] + reach)) / (np.pi * one.sample_time)
    corners = np.concatenate(
        [
            [lowest, nyquist],
            [point.frequency_hz for point in chosen.points],
            around.reshape(-1),
        ]
    )
    edges = np.unique(corners[(corners >= lowest) & (corners <= nyquist)])

    def total(edges: FloatArray) -> float:
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half = np.diff(edges)[:, None] / 2
        f = edges[:-1, None] + half * (1 + nodes)
        density = handle_spectrum(loop, effects, encoder_resolution, f) / chosen.rms(f) ** 2
        return float(np.sum(half * weights * density))

    previous = present = total(edges)
    for _ in range(_MOST_HALVINGS):
        edges = np.sort(np.concatenate([edges, (edges[1:] + edges[:-1]) / 2]))
        previous, present = present, total(edges)
        if abs(present - previous) <= _AGREE * present:
            return float(np.sqrt(present))
    raise LoopError(
        f"the vibration spectrum does not settle: {present:g} after {previous:g}; the loop rings "
        "too sharply. Give it more damping or less gain"
    )
