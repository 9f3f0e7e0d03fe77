"""Forces at the pace of a hand that the log does not know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.findings.force_balance import ForceBalance, balance_at
from identification.findings.forces import (
    LEAST_GAIN,
    LEAST_SHARE,
    carried_force,
    position_force,
    powers_of,
)
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Physiological tremor of hand and forearm, Hz, and the bands beside it that it is compared with
#: (Elble and Koller, Tremor, 1990).
TREMOR = (8.0, 12.0)
_BELOW, _ABOVE = (4.5, 7.0), (14.0, 20.0)
_HALF_WIDTH = 0.03  # half-width of the windows, s: they pass 85 % of a sine of 10 Hz
_SLOWEST = 0.01  # steps longer than this do not show a tremor, s
_PIECE = 2.0  # length of the pieces of the spectrum, s: bands of 2.5 Hz hold several lines
_PEAK = 1.7  # the rest is this many times stronger in the band of tremor than beside it, ...
#: ... its power there is this part of the force's own, or it is what a force excited there leaves
#: behind, ...
_UNDRIVEN = 0.1
#: ... what the drive's dynamics explain leaves this part of its rms, ...
_UNDRIVEN_BY_LAG = 0.1
_LEAST_TREMOR = 0.015  # ... and its rms there is this part of the rms force.
#: Above this part of the force the hand that trembles is as much in the log as the device is.
_MOST_TREMOR = 0.1
SLOW = 1.0  # slow motion of a hand, Hz, and the part of the rms force it may push with, unlogged
MOST_SLOW = 0.15
#: A force of position of this part of the force may be a spring to the body: then this part of the
#: tremor or of the slow force is enough.
_HELD, _HELD_NEEDS = 0.2, 1 / 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlogged:
    """Forces that the log does not know, at the pace of a hand."""

    tremor: float  # rms at TREMOR, N
    peak: float  # power there against that beside it, 0 where the logged force may have left it
    slow: float  # rms below 1 Hz, a force of position taken out, N
    spring: float  # rms of a force of position, N; 0 in motion one way
    #: rms of the force that these are judged against, N: of its changes, or of all of it in motion
    #: one way, where a steady force is what keeps the device moving
    force: float

    @property
    def least_tremor(self) -> float:
        """Part of the force from which a tremor is one."""
        return _LEAST_TREMOR * self._needed

    @property
    def most_slow(self) -> float:
        """Part of the force that may be slow and unlogged."""
        return MOST_SLOW * self._needed

    @property
    def _needed(self) -> float:
        return _HELD_NEEDS if self.spring >= _HELD * self.force else 1.0

    @property
    def shaking(self) -> bool:
        """Whether the tremor stands out and is more than a trace of the force."""
        return self.peak >= _PEAK and self.tremor >= self.least_tremor * self.force

    @property
    def pushing(self) -> bool:
        """Whether something pushes slowly."""
        return self.slow >= self.most_slow * self.force

    @property
    def much(self) -> bool:
        """Whether what pushed so is as much in the estimate as the device is."""
        shaken = self.shaking and self.tremor >= _MOST_TREMOR * self.force
        return shaken or self.slow >= MOST_SLOW * self.force


def unlogged(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> Unlogged:
    """Forces at the pace of a hand that mass, damping, friction and offset leave over."""
    tremor, peak = _tremor(trajectory, balance, chosen)
    steady = float(np.mean(balance.force)) if balance.one_way else 0.0
    force = float(np.hypot(np.std(balance.force), steady))
    spring = 0.0
    if not balance.one_way:
        gain, further = position_force(balance)
        carried = carried_force(balance) + (further if gain >= LEAST_GAIN else 0.0)
        spring = float(np.std(carried))
    return Unlogged(tremor=tremor, peak=peak, slow=_slow(balance), spring=spring, force=force)


def hand(trajectory: Trajectory, balance: ForceBalance, left: Unlogged) -> Iterator[Finding]:
    """``hand-on-device``: forces that the log does not know, at the pace of a hand.

    Tremor alone disturbs like noise and widens the intervals: a warning. With a spring to the body,
    or as strong as the excitation, the mass and damping of the hand are in the estimate: a refusal.

    In motion one way nothing is called a hand. Ripple once a turn, a load and friction that varies
    look the same there, and a force of position is one of time; ``excitation`` says so instead.
    """
    if balance.one_way or not (left.shaking or left.pushing):
        return
    spring = left.spring >= LEAST_SHARE * left.force
    refused = spring or left.much
    seen = [f"forces that {trajectory.source} does not log:"]
    if left.shaking:
        seen.append(
            f"tremor of {left.tremor:.3g} rms at {TREMOR[0]:g} to {TREMOR[1]:g} Hz, "
            f"{left.peak:.0f} times the power beside that band,"
        )
    seen.append(f"{left.slow / left.force:.0%} of the force below {SLOW:g} Hz")
    seen.append("and a spring to the body" if spring else "")
    yield Finding(
        code="hand-on-device",
        severity="refusal" if refused else "warning",
        seen=" ".join(seen).strip(),
        needed=f"no spring, tremor below {_MOST_TREMOR if refused else _LEAST_TREMOR:.1%} and "
        f"slow force below {left.most_slow:.0%} of the force",
        remedy="Take the hand off while logging: its mass, damping and stiffness are read as "
        "the device's.",
    )


def _tremor(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> tuple[float, float]:
    """Rms of the rest in the band of tremor, N, and its power there against that beside it.

    The latter is 0 where the force itself is so strong in the band that its rest may be an error
    of the model, or where derivatives of force and acceleration explain the rest: so a lag, a
    spring or play between motor and load show there.
    """
    shortest = _PIECE / 2
    if trajectory.sample_time > _SLOWEST or np.ptp(trajectory.time) < shortest:
        return 0.0, 0.0
    rows = replace(balance_at(trajectory, _HALF_WIDTH, chosen.delay), gravity=balance.gravity)
    step = float(np.median(np.diff(rows.time)))
    piece = min(len(rows), round(_PIECE / step))
    if piece * step < shortest:
        return 0.0, 0.0
    frequency = np.fft.rfftfreq(piece, step)

    def power(column: FloatArray, band: tuple[float, float]) -> float:
        inside = (frequency >= band[0]) & (frequency <= band[1])
        return float(np.mean(_density(column, step, piece)[inside]))

    place = rows.carried, powers_of(rows.position)
    slopes = np.gradient(np.stack((rows.force, rows.acceleration), axis=1), step, axis=0)
    left = rows.unexplained(*place)
    undriven = rows.unexplained(*place, slopes, np.gradient(slopes, step, axis=0))
    powers = [power(each, TREMOR) for each in (left, undriven)]
    beside = [np.sqrt(power(each, _BELOW) * power(each, _ABOVE)) for each in (left, undriven)]
    rms = float(np.sqrt(powers[0] * (TREMOR[1] - TREMOR[0])))
    driven = (
        min(beside) == 0
        or powers[0] < _UNDRIVEN * power(rows.force, TREMOR)
        or powers[1] < _UNDRIVEN_BY_LAG**2 * powers[0]
    )
    return rms, 0.0 if driven else float(min(p / b for p, b in zip(powers, beside, strict=True)))


def _density(column: FloatArray, step: float, piece: int) -> FloatArray:
    """One-sided power spectral density of pieces that overlap by half, N²/Hz.

    Each less its mean and tapered (Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967,
    p. 70).
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
