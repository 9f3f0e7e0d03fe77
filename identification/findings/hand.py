"""Did somebody hold the device while it was logged?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.findings.force_balance import ForceBalance, balance_at
from identification.findings.position_dependence import LEAST_SHARE, position_force_rms, powers_of
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Physiological tremor of hand and forearm, Hz, and the bands beside it that it is compared with
#: (Elble and Koller, Tremor, 1990).
TREMOR = (8.0, 12.0)
_BELOW, _ABOVE = (4.5, 7.0), (14.0, 20.0)
#: Half-width of the windows, s: they pass 85 % of a sine of 10 Hz.
_HALF_WIDTH = 0.03
#: Steps longer than this do not show a tremor, s.
_SLOWEST = 0.01
#: Length of the pieces of the spectrum, s: bands of 2.5 Hz hold several lines.
_PIECE = 2.0
#: The rest is this many times stronger in the band of tremor than beside it, ...
PEAK = 1.7
#: ... its power there is this part of the force's own, or it is what a force excited there leaves
#: behind, ...
_UNDRIVEN = 0.04
#: ... and its rms there is this part of the rms force.
LEAST_TREMOR = 0.015
#: Above this part of the force the hand that trembles is as much in the log as the device is.
MOST_TREMOR = 0.1
#: Slow motion of a hand, Hz, and the part of the rms force it may push with, unlogged.
SLOW = 1.0
MOST_SLOW = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlogged:
    """Forces that the log does not know, at the pace of a hand.

    Attributes:
        tremor: rms at TREMOR, N.
        peak: power there against that beside it, 0 where the force itself is strong there.
        slow: rms below 1 Hz, a force of position taken out, N.
        force: rms of the force that these are judged against, N: of its changes, or of all of it
            in motion one way, where a steady force is what keeps the device moving.
    """

    tremor: float
    peak: float
    slow: float
    force: float

    @property
    def shaking(self) -> bool:
        """Whether the tremor stands out and is more than a trace of the force."""
        return self.peak >= PEAK and self.tremor >= LEAST_TREMOR * self.force

    @property
    def much(self) -> bool:
        """Whether what pushed so is as much in the estimate as the device is."""
        shaken = self.shaking and self.tremor >= MOST_TREMOR * self.force
        return shaken or self.slow >= MOST_SLOW * self.force


def unlogged(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> Unlogged:
    """Forces at the pace of a hand that mass, damping, friction and offset leave over.

    Args:
        trajectory: the log.
        balance: its rows.
        chosen: the estimate believed; gives the delay.
    """
    tremor, peak = _tremor(trajectory, chosen)
    steady = float(np.mean(balance.force)) if balance.one_way else 0.0
    force = float(np.hypot(np.std(balance.force), steady))
    return Unlogged(tremor=tremor, peak=peak, slow=_slow(balance), force=force)


def hand(trajectory: Trajectory, balance: ForceBalance, left: Unlogged) -> tuple[Finding, ...]:
    """``hand-on-device``: forces that the log does not know, at the pace of a hand.

    Tremor alone disturbs like noise and widens the intervals: a warning. With a spring to the body,
    or as strong as the excitation, the mass and damping of the hand are in the estimate: a refusal.

    In motion one way nothing is called a hand. Ripple once a turn, a load and friction that varies
    look the same there, and a force of position is one of time; excitation.py says so instead.
    """
    if balance.one_way or not (left.shaking or left.slow >= MOST_SLOW * left.force):
        return ()
    spring = position_force_rms(balance) >= LEAST_SHARE * left.force
    refused = spring or left.much
    seen = [f"forces that {trajectory.source} does not log:"]
    if left.shaking:
        seen.append(
            f"tremor of {left.tremor:.3g} rms at {TREMOR[0]:g} to {TREMOR[1]:g} Hz, "
            f"{left.peak:.0f} times the power beside that band,"
        )
    seen.append(f"{left.slow / left.force:.0%} of the force below {SLOW:g} Hz")
    seen.append("and a spring to the body" if spring else "")
    return (
        Finding(
            code="hand-on-device",
            severity="refusal" if refused else "warning",
            seen=" ".join(seen).strip(),
            needed=f"no spring, tremor below {MOST_TREMOR if refused else LEAST_TREMOR:.1%} and "
            f"slow force below {MOST_SLOW:.0%} of the force",
            remedy="Take the hand off while logging: its mass, damping and stiffness are read as "
            "the device's.",
        ),
    )


def _tremor(trajectory: Trajectory, chosen: Estimate) -> tuple[float, float]:
    """Rms of the rest in the band of tremor, N, and its power there against that beside it.

    The latter is 0 where the force itself is so strong in the band that its rest may be an error
    of the model.
    """
    shortest = _PIECE / 2
    if trajectory.sample_time > _SLOWEST or np.ptp(trajectory.time) < shortest:
        return 0.0, 0.0
    rows = balance_at(trajectory, _HALF_WIDTH, chosen.delay)
    step = float(np.median(np.diff(rows.time)))
    piece = min(len(rows), round(_PIECE / step))
    if piece * step < shortest:
        return 0.0, 0.0
    frequency = np.fft.rfftfreq(piece, step)
    left, driven = (_density(each, step, piece) for each in (rows.unexplained(), rows.force))

    def power(density: FloatArray, band: tuple[float, float]) -> float:
        return float(np.mean(density[(frequency >= band[0]) & (frequency <= band[1])]))

    inside = power(left, TREMOR)
    beside = float(np.sqrt(power(left, _BELOW) * power(left, _ABOVE)))
    rms = float(np.sqrt(inside * (TREMOR[1] - TREMOR[0])))
    if beside == 0 or inside < _UNDRIVEN * power(driven, TREMOR):
        return rms, 0.0
    return rms, inside / beside


def _density(column: FloatArray, step: float, piece: int) -> FloatArray:
    """One-sided power spectral density of pieces that overlap by half, N²/Hz.

    Each less its mean and tapered (Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967,
    p. 70).

    Args:
        column: shape (rows,).
        step: time between rows, s.
        piece: rows of a piece.
    """
    window = np.hanning(piece + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(column, piece)[:: piece - piece // 2]
    lines = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window)
    return 2 * step / float(window @ window) * np.mean(np.abs(lines) ** 2, axis=0)


def _slow(balance: ForceBalance) -> float:
    """Rms of what is left over below SLOW, a force of position taken out, N."""
    left = balance.unexplained(powers_of(balance.position), balance.carried)
    step = float(np.median(np.diff(balance.time)))
    spectrum = np.fft.rfft(left)
    spectrum[np.fft.rfftfreq(left.size, step) > SLOW] = 0
    return float(np.std(np.fft.irfft(spectrum, left.size)))
