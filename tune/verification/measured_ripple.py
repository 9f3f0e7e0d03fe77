"""Measured force ripple of the encoder against the closed form, above the band of motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.loop import Loop
from tune.verification.outcome import Outcome, unassessed_outcome

FloatArray = NDArray[np.float64]

#: The band begins at this many times the frequency of the motion, where nothing of it is left.
_ABOVE_MOTION = 30.0
#: And not below this part of Nyquist, where it ends; it must be at least that part of it.
_LOWEST_EDGE, _NARROWEST = 0.03, 0.5
#: Order of the Butterworth filter, run forwards and backwards.
_ORDER = 4
#: Counts a sample: slower, the rounding error is no white noise (docs/theory.md, 6).
_SLOWEST = 0.5
#: Rows in motion that are needed; periods of the band's edge left out around a turn, at which
#: friction jumps, and at the ends: within them what the filter makes of a jump falls below 1e-4.
_FEWEST_ROWS, _MARGIN = 100, 4.0
#: Time constants in which the other modes of the loop fall as far.
_RUNG = 9.0
#: Places on the upper half of the unit circle for the ripple of the band.
_PLACES = 4096
#: Seen against predicted, either way.
TOLERANCE = 0.25


def judge_ripple(
    loop: Loop,
    effects: Effects,
    resolution: float | None,
    force: FloatArray,
    position: FloatArray,
    turns: tuple[int, ...],
    sample_time: float,
    motion_hertz: float,
    ringing: float,
    force_digit: float,
    unit: str,
) -> Outcome:
    """Compare the high-frequency part of the force while the handle moves freely.

    Force and position have shape (rows,).

    Args:
        loop: at the best estimate of the device.
        effects: as played.
        resolution: one count, m; None where it is not known.
        force: N, the rows of free motion.
        position: m, the same rows.
        turns: rows of these at which the handle turns.
        sample_time: s.
        motion_hertz: the fastest the motion itself goes, Hz.
        ringing: decay of the slowest mode besides the motion, 1/s; it rings when friction turns.
        force_digit: to which the force was logged, N; 0 for all digits.
        unit: of force.
    """
    from scipy.signal import butter, sosfiltfilt, sosfreqz

    if resolution is None:
        return unassessed_outcome("ripple", "the encoder resolution is not known")
    nyquist = 0.5 / sample_time
    edge = max(_ABOVE_MOTION * motion_hertz, _LOWEST_EDGE * nyquist)
    if edge > (1 - _NARROWEST) * nyquist:
        why = f"the motion reaches {motion_hertz:.3g} Hz, no band is above"
        return unassessed_outcome("ripple", why, reached_hz=motion_hertz)
    spare = int(max(_MARGIN / edge, _RUNG / ringing) / sample_time) + 1
    if force.size < 2 * spare + _FEWEST_ROWS:
        why = f"the handle moves freely for {force.size} rows only"
        return unassessed_outcome("ripple", why, rows=force.size)
    sections = butter(_ORDER, edge / nyquist, "highpass", output="sos")
    turn = (np.arange(_PLACES) + 0.5) * np.pi / _PLACES
    _, answer = sosfreqz(sections, turn)
    weight = np.abs(np.asarray(answer)) ** 4  # forwards and backwards
    power = _force_per_position(loop, effects, turn) ** 2
    predicted = resolution * float(np.sqrt(np.mean(power * weight) / 12))
    if predicted < force_digit:
        return unassessed_outcome(
            "ripple",
            f"{predicted:.2g} {unit} are predicted, the force is logged to {force_digit:g}",
            predicted=predicted,
            force_digit=force_digit,
        )
    smooth = position - np.asarray(sosfiltfilt(sections, position))
    moving = np.abs(np.gradient(smooth)) > _SLOWEST * resolution
    still = np.flatnonzero(~moving)
    for row in (*still.tolist(), *turns):
        moving[max(0, row - spare) : row + spare] = False
    moving[:spare] = moving[-spare:] = False
    count = int(np.count_nonzero(moving))
    if count < _FEWEST_ROWS:
        why = f"the handle moves by half a count a sample or more for {count} rows only"
        return unassessed_outcome("ripple", why, rows=count)
    rapid = np.asarray(sosfiltfilt(sections, force), dtype=np.float64)[moving]
    seen = float(np.sqrt(np.mean(rapid * rapid)))
    agrees = 1 / (1 + TOLERANCE) <= seen / predicted <= 1 + TOLERANCE
    return Outcome(
        check="ripple",
        verdict="agrees" if agrees else "disagrees",
        seen=f"{seen:.3g} {unit} rms above {edge:.3g} Hz over {count} rows in motion",
        predicted=f"{predicted:.3g} {unit} rms in that band",
        tolerance=f"{TOLERANCE:.0%}",
        numbers={
            "seen": seen,
            "above_hz": edge,
            "rows": count,
            "predicted": predicted,
            "tolerance": TOLERANCE,
        },
        remedy=""
        if agrees
        else "Check the resolution of the encoder in the device, and look for noise on the "
        "position, an uneven clock or a vibration of the mechanism.",
    )


def _force_per_position(loop: Loop, effects: Effects, turn: FloatArray) -> FloatArray:
    """|C/(1 + G·C)| at angles on the unit circle, N/m, shape of ``turn``."""
    w = 1j * np.tan(turn / 2)
    parts = loop.transfer
    law = np.zeros_like(w)
    for numerator, size in zip(
        (parts.alpha, parts.beta, parts.gamma), loop.dimensionless_effects(effects), strict=True
    ):
        if size is not None:
            law = law + np.polynomial.polynomial.polyval(w, numerator) * float(size)
    closed, _ = loop.polynomial(effects)
    plant = np.polynomial.polynomial.polyval(w, parts.plant_denominator)
    below = np.polynomial.polynomial.polyval(w, closed)
    return np.abs(law * plant / below) / float(loop.scales[0])
