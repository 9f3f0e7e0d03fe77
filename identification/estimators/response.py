"""Frequency response from force to acceleration, from cross spectra, with coherence and interval.

The force is that which friction, offset and forces of position leave for mass and damping. Spectra
are means over bands of a tapered transform of the whole log (Daniell; Bendat and Piersol, Random
Data, section 9.2), so each is known as well as its number of lines allows. What a feedback puts of
the noise into the force biases it where the coherence is low.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.estimators.least_squares import Regression
from identification.estimators.signals import of_rows
from identification.trajectory import ComplexArray, FloatArray

#: Bands of a decade, lines in each at least, and part of the sampling rate up to which they go.
_BANDS, _LINES, _HIGHEST = 25, 6, 0.25
#: Lines of a tapered transform are correlated with their neighbours; so many of them count.
_INDEPENDENT = 0.5
_COHERENT = 0.8  # coherence of the bands that are named


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Acceleration per force in bands of frequency, each array of shape (bands,)."""

    frequency: FloatArray  # Hz
    gain: ComplexArray  # 1/kg (1/(kg·m²))
    force: FloatArray  # rms in each line, any unit
    coherence: FloatArray  # 0 to 1
    half_width: FloatArray  # of 95 % of the gain's size, part of it; radians of its phase

    def rigid(self, values: FloatArray) -> ComplexArray:
        """The gain of a mass with damping, values[0] and values[1]."""
        turned = (2j * np.pi * self.frequency).astype(np.complex128)
        return turned / (values[0] * turned + values[1])


def response_of(table: Regression, values: FloatArray, delay: float) -> Response:
    """The response of one log with even steps, terms beside mass and damping taken off."""
    signals = table.signals
    rows = table.unfiltered(signals.position, table.motion)
    force = of_rows(table.held_force(delay).times(table.motion.moving).triangle())
    force = force - values[2:] @ rows[2:]
    pair = np.stack((force, rows[0]))[:, table.known :]
    taper = np.hanning(pair.shape[1])
    lines = np.fft.rfft((pair - pair.mean(axis=1, keepdims=True)) * taper)
    frequency = np.fft.rfftfreq(pair.shape[1], signals.step)
    last = int(np.searchsorted(frequency, _HIGHEST / signals.step))
    edges = [1]
    while edges[-1] + _LINES < last:
        edges.append(max(edges[-1] + _LINES, int(edges[-1] * 10 ** (1 / _BANDS))))
    cut = np.array(edges[:-1])
    counts = np.diff(edges)

    def mean(column: NDArray[Any]) -> NDArray[Any]:
        return np.add.reduceat(column[: edges[-1]], cut) / counts

    pull, bend = lines
    driven, answered = mean(np.abs(pull) ** 2), mean(np.abs(bend) ** 2)
    both = mean(bend * np.conj(pull))
    tiny = np.finfo(float).tiny
    coherence = np.minimum(np.abs(both) ** 2 / np.maximum(driven * answered, tiny), 1.0)
    chance = (1 - coherence) / np.maximum(coherence, tiny) / (2 * _INDEPENDENT * counts)
    return Response(
        frequency=mean(frequency),
        gain=(both / np.maximum(driven, tiny)).astype(np.complex128),
        force=np.sqrt(driven),
        coherence=coherence,
        half_width=1.96 * np.sqrt(chance),
    )


def departure_of(table: Regression, delay: float) -> str:
    """Where most of the motion of a log is not that of its rigid response, in words."""
    values = table.solve(delay)
    found = response_of(table, values, delay)
    apart = found.gain / found.rigid(values) - 1
    told = (found.coherence >= _COHERENT) & (np.abs(apart) > found.half_width)
    told &= found.frequency <= table.cut_off.frequency
    worst = int(np.argmax(np.where(told, np.abs(found.gain * apart) * found.force, 0.0)))
    if not told[worst]:
        return ""
    turned = float(np.degrees(np.angle(1 + apart[worst])))
    return (
        f". At {found.frequency[worst]:.3g} Hz force accelerates it {np.abs(1 + apart[worst]):.2f} "
        f"times as much as a rigid device, {abs(turned):.0f}° {'late' if turned < 0 else 'early'} "
        f"(coherence {found.coherence[worst]:.2f})"
    )
