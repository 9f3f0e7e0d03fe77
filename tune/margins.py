"""Margins of one loop: gain, delay, damping, phase, disk and passivity.

**Delay.** At any one delay the verdict and the gains at which the loop turns unstable are exact
(`tune.stability.verdict`). Between two delays a and b that are both stable nothing can have
happened unless, at some frequency, the open loop L travelled as far as the sum of its distances
from the forbidden set at a and at b: the point -1, or all of (-∞, -1] where every lower gain must
be stable too. The search halves whatever this does not exclude; the first end found unstable is
then refined on the exact crossing gain.

**Disk** margins as in P. Seiler, A. Packard and P. Gahinet, "An introduction to disk margins", IEEE
Control Systems 40(5), 2020: the loop stays stable while its gain is multiplied, at all frequencies
and at once, by any complex number of the disk {(1 + (1-σ)/2·d)/(1 - (1+σ)/2·d), |d| < α}. The
largest α is 1/max|S + (σ-1)/2|.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.scene import Effects, Hand
from tune.loop.loop import ClosedLoop, Filters, Loop, closed_loops, for_each, used_filters
from tune.loop.plant import LONGEST_DELAY
from tune.loop.polynomials import (
    parts_on_axis,
    peak,
    positive_roots,
    slope,
    squared_modulus,
    value_at,
)
from tune.stability.criterion import Passivity, passivity
from tune.stability.verdict import is_stable, last_kept, safe_gain, stable_gains, verdict

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: A pole that decays by more than exp(-π) within one sample is gone before it can swing: even at
#: the Nyquist frequency its damping ratio exceeds 1/√2. The poles that delays put near z = 0 are
#: of this kind, and doubles do not hold their ratios.
_GONE_IN_A_SAMPLE = np.pi


def slowest_decay(loop: Loop, effects: Effects) -> FloatArray:
    """Decay of the slowest closed-loop pole, 1/s: everything shrinks at least like exp(-decay·t).

    Its inverse is the longest time constant. Without anything that holds the position the pole of
    free motion does not count. The poles of a filter count even where its effect is absent; leave
    such a filter out of the loop.

    Args:
        loop: of any shape; scaled by mass and sample time (`Loop.from_numbers`).
        effects: broadcast against the loop.

    Returns:
        -max Re s of the broadcast shape, with s = ln(z)/T; negative for a loop that grows.
    """
    return for_each(loop, effects, lambda one: float(np.min(-_poles_in_s(one).real)))


def least_damping_ratio(loop: Loop, effects: Effects) -> FloatArray:
    """Smallest damping ratio -Re(s)/|s| of the closed-loop poles, s = ln(z)/T; 1 does not ring.

    Poles with z nearer to 0 than exp(-π), whose ratio exceeds 0.707 in any case, are left out.
    Arguments as in `slowest_decay`; negative for a loop that grows.

    The answer has the shape of loop and effects together, and no unit.
    """
    return for_each(loop, effects, _least_ratio)


def _poles_in_s(one: ClosedLoop) -> NDArray[np.complex128]:
    """Poles s = ln(z)/T = (2/T)·artanh(w), rad/s, Im s in [-π/T, π/T]; -∞ for z = 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2 / one.sample_time * np.arctanh(one.poles()), dtype=np.complex128)


def _least_ratio(one: ClosedLoop) -> float:
    s = _poles_in_s(one)
    s = s[-s.real * one.sample_time < _GONE_IN_A_SAMPLE]
    moduli = np.abs(s)
    ratios = np.where(moduli > 0, -s.real / np.where(moduli > 0, moduli, 1.0), 0.0)
    return float(np.min(ratios, initial=1.0))


#: Samples. A path between two neighbours may be this much longer than the straight line; an arc
#: that turns by half a sample at the Nyquist frequency is 1.11 times its chord.
_PATH = 1.5
_LONGEST_STEP = 0.5
#: Samples. Unstable islands narrower than this may go unseen; steps that end unstable are halved
#: to ``_BRACKET`` before the crossing is refined inside.
_SHORTEST_STEP = 2.0**-10
_BRACKET = 2.0**-6
#: Samples to which a crossing is refined.
_REFINED = 1e-13
#: Frequencies v between the closed-loop poles and beyond; a point on every half octave or so. Where
#: L comes nearest is added: around the closed-loop poles for -1, and for lower gains where L is
#: real or nearly so.
_SPREAD = np.geomspace(1e-6, 1e5, 80)
_AROUND = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayMargin:
    """Further delay until unstable, in samples; the bound that was asked for where it is more.

    Attributes:
        every_gain: with every gain in (0, 1] stable: what a profile claims.
        full_gain: at the full gain alone; never less.
    """

    every_gain: float
    full_gain: float


def delay_margin(
    loop_at: Callable[[float], Loop], effects: Effects, *, most: float = 10.0
) -> DelayMargin:
    """How much further delay a loop bears, from its present one on.

    The loop at the delay found is on the boundary; the crossing is exact to about 1e-12 samples.
    That nothing unstable lies before it is argued from frequencies (see above), not proved in
    interval arithmetic; the certificate does that for what a profile claims.

    Args:
        loop_at: the loop of one device with so many samples of delay added, a real number.
        effects: single values.
        most: samples looked for.

    Returns:
        Samples, 0 where the loop is not certainly stable as it is, at most ``most``.
    """
    if most <= 0:
        raise ValueError(f"most must be positive, not {most:g} samples; 10 is usual")
    every = _Search(loop_at, effects, most, all_gains=True).first_unstable(0.0)
    full = _Search(loop_at, effects, most, all_gains=False).first_unstable(every)
    return DelayMargin(every_gain=every, full_gain=full)


class _At(NamedTuple):
    """A loop at one delay: is it safe, and what is needed to compare it with a neighbour."""

    delay: float
    safe: bool
    loop: ClosedLoop


@dataclass(frozen=True, slots=True)
class _Search:
    loop_at: Callable[[float], Loop]
    effects: Effects
    most: float
    all_gains: bool

    def first_unstable(self, start: float) -> float:
        """First delay after ``start`` that is not stable; ``start`` where it is not itself."""
        here = self._at(start)
        if not here.safe:
            return start
        while here.delay < self.most:
            there = self._at(min(here.delay + _LONGEST_STEP, self.most))
            while not self._reached(here, there):
                middle = (here.delay + there.delay) / 2
                if not there.safe and there.delay - here.delay <= _BRACKET:
                    return self._refined(here.delay, there.delay)
                there = self._at(middle)
            here = there
        return self.most

    def _reached(self, here: _At, there: _At) -> bool:
        """True where the whole way between two delays is taken to be stable."""
        if not there.safe:
            return False
        if there.delay - here.delay <= _SHORTEST_STEP:
            return True
        v = _frequencies(here.loop, there.loop)
        (one, first), (two, second) = (
            (open_loop, _distance(open_loop, all_gains=self.all_gains))
            for open_loop in (
                value_at(place.loop.added, v) / value_at(place.loop.open, v)
                for place in (here, there)
            )
        )
        return bool(np.all(_PATH * np.abs(two - one) <= first + second))

    def _at(self, delay: float) -> _At:
        loop = self.loop_at(delay)
        (closed,), _ = closed_loops(loop, self.effects)
        if self.all_gains:
            safe = self._distance_to_crossing(loop) > 0
        else:
            safe = bool(np.all(verdict(loop, self.effects) > 0))
        return _At(delay, safe, closed)

    def _distance_to_crossing(self, loop: Loop) -> float:
        """ln of the gain that reaches the boundary, positive where stable, negative where not.

        Continuous in the delay wherever it matters: near the delay at which it is zero.
        """
        low, high = stable_gains(loop, self.effects)
        low, high = low.reshape(-1), high.reshape(-1)
        if self.all_gains:
            ends = high[low == 0]
            return float(np.log(ends[0])) if ends.size else -np.inf
        with np.errstate(divide="ignore"):
            within = np.minimum(np.log(high), -np.log(low))
        return float(np.max(within[~np.isnan(within)], initial=-np.inf))

    def _refined(self, stable: float, unstable: float) -> float:
        """The crossing in between: secant steps on the exact gain, halvings where it jumps."""
        return last_kept(
            lambda delay: self._distance_to_crossing(self.loop_at(delay)),
            stable,
            unstable,
            room_kept=self._distance_to_crossing(self.loop_at(stable)),
            room_broken=self._distance_to_crossing(self.loop_at(unstable)),
            close=_REFINED * max(1.0, unstable),
        )


def _frequencies(*loops: ClosedLoop) -> FloatArray:
    poles = np.concatenate([loop.poles() for loop in loops])
    poles = poles[np.isfinite(poles)]
    near = np.abs(poles.imag[:, None] + _AROUND * np.abs(poles.real)[:, None])
    v = np.concatenate([_SPREAD, near.reshape(-1), np.abs(poles), *map(_nearly_real, loops)])
    return v[v > 0]


def _nearly_real(loop: ClosedLoop) -> FloatArray:
    """Frequencies v at which L crosses the real axis, or comes near to doing so."""
    mirrored = loop.open * (-1.0) ** np.arange(len(loop.open))
    _, odd = parts_on_axis(np.convolve(loop.added, mirrored))
    x = np.roots(odd[::-1])
    return np.sqrt(np.concatenate([np.abs(x), x.real[x.real > 0]])).astype(np.float64)


def _distance(open_loop: ComplexArray, *, all_gains: bool) -> FloatArray:
    """From -1, or from the whole of (-∞, -1]."""
    to_point = np.abs(1 + open_loop)
    if not all_gains:
        return to_point
    return np.where(open_loop.real < -1, np.abs(open_loop.imag), to_point)


#: Newton steps on a crossing |L| = 1 or on the top of a peak; each doubles the digits.
_POLISHES = 5
#: A Newton step longer than this, relative, leaves the neighbourhood it was started in.
_LONGEST_NEWTON = 0.1
#: |L| at a crossing is 1 within this, relative; what is not was no crossing.
_ON_CIRCLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskMargin:
    """How much complex gain, at all frequencies and at once, a loop bears; 0 where unstable.

    Attributes:
        balanced: α = 1/max|(S-T)/2|, σ = 0, at most 2: gains from (2-α)/(2+α) to (2+α)/(2-α) or
            phases up to 2·atan(α/2) alone are borne.
        balanced_hz: the critical frequency, at which that maximum lies, Hz.
        sensitivity: 1/max|S|, σ = 1: the least distance of the frequency response from -1.
        sensitivity_hz: the frequency of largest sensitivity, Hz.
    """

    balanced: float
    balanced_hz: float
    sensitivity: float
    sensitivity_hz: float


def phase_margin(loop: Loop, effects: Effects) -> FloatArray:
    """Least phase that makes the loop unstable when it turns all frequencies alike, degrees.

    The least |arg(-L)| where |L| = 1.

    Returns:
        0 to 180 of the broadcast shape; 0 where the loop is not certainly stable, inf where |L|
        is nowhere 1, so that no phase alone destabilises.
    """
    margins = for_each(loop, effects, _phase)
    return np.where(is_stable(loop, effects), margins, 0.0)


def disk_margin(loop: Loop, effects: Effects) -> DiskMargin:
    """Disk margins of one device with its effects, and the frequencies that are critical.

    Args:
        loop: of shape ().
        effects: single values.
    """
    (one,), _ = closed_loops(loop, effects)
    if not bool(is_stable(loop, effects)):
        return DiskMargin(balanced=0.0, balanced_hz=np.nan, sensitivity=0.0, sensitivity_hz=np.nan)
    # (S - T)/2 = (D - N)/(2(D + N)); D - N loses nothing that |D - N| near its peak needs.
    balanced, v = _peak_modulus((one.open - one.added) / 2, one)
    sensitivity, v_s = _peak_modulus(one.open, one)
    return DiskMargin(
        balanced=1 / balanced,
        balanced_hz=one.hertz(v),
        sensitivity=1 / sensitivity,
        sensitivity_hz=one.hertz(v_s),
    )


def _peak_modulus(numerator: FloatArray, one: ClosedLoop) -> tuple[float, float]:
    """(max |numerator/closed|, its v)."""
    poles = one.poles()
    squared, v = peak(
        lambda v: np.abs(value_at(numerator, v) / value_at(one.closed, v)) ** 2,
        squared_modulus(numerator),
        squared_modulus(one.closed),
        np.concatenate([np.abs(poles.imag), np.abs(poles)]),
    )
    return float(np.sqrt(squared)), _top(numerator, one.closed, v)


def _top(numerator: FloatArray, denominator: FloatArray, v: float) -> float:
    """The top of a peak near v: Newton on the slope of log|numerator/denominator|."""
    if not 0 < v < np.inf:
        return v
    start = v
    for _ in range(_POLISHES):
        first = second = 0.0
        for sign, p in ((1, numerator), (-1, denominator)):
            at = np.array(v)
            p0, p1, p2 = (complex(value_at(q, at)) for q in (p, slope(p), slope(slope(p))))
            if p0 == 0:
                return start
            first += sign * (1j * p1 / p0).real
            second -= sign * (p2 / p0 - (p1 / p0) ** 2).real
        step = first / second if second < 0 else np.inf
        if not abs(step) <= _LONGEST_NEWTON * v:
            return start
        v -= step
    return v


def _phase(one: ClosedLoop) -> float:
    crossings = positive_roots(squared_modulus(one.added) - squared_modulus(one.open))
    if not crossings.size:
        return np.inf
    v = np.sqrt(crossings)
    derivatives = [(p, slope(p)) for p in (one.added, one.open)]
    for _ in range(_POLISHES):
        with np.errstate(divide="ignore", invalid="ignore"):
            (n, n1), (d, d1) = ((value_at(p, v), 1j * value_at(q, v)) for p, q in derivatives)
            step = np.log(np.abs(n / d)) / (n1 / n - d1 / d).real
            good = np.abs(step) <= _LONGEST_NEWTON * v
        v = np.where(good, v - np.where(good, step, 0.0), v)
    loop = value_at(one.added, v) / value_at(one.open, v)
    on_circle = np.abs(np.abs(loop) - 1) <= _ON_CIRCLE
    return float(np.min(np.abs(np.angle(-loop[on_circle], deg=True)), initial=np.inf))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """How far one loop is from instability, at the device's best estimate.

    Where the loop is not certainly stable the margins are 0 and the critical frequency is nan;
    decay and damping ratio are told as they are, negative for a loop that grows.

    Attributes:
        gain: g, such that every gain in (0, g) is stable; inf where there is no end.
        delay: further delay, samples, with every gain in (0, 1] stable and at the full gain.
        decay: of the slowest closed-loop pole, 1/s.
        damping_ratio: the least of the closed-loop poles, at most 1.
        phase: degrees, inf where no phase alone destabilises.
        disk: balanced and sensitivity-based disk margins with their frequencies in Hz.
        passivity: Colgate and Schenkel's condition for the device in any passive hand.
    """

    gain: float
    delay: DelayMargin
    decay: float
    damping_ratio: float
    phase: float
    disk: DiskMargin
    passivity: Passivity

    @property
    def time_constant(self) -> float:
        """1/decay, s; nan for a loop that does not decay."""
        return 1 / self.decay if self.decay > 0 else nan

    @property
    def critical_frequency_hz(self) -> float:
        """Where least gain and phase together make the loop swing without end, Hz."""
        return self.disk.balanced_hz


def margins_of(
    device: Device,
    effects: Effects,
    filters: Filters | None = None,
    hand: Hand | None = None,
    *,
    extra_delay_samples: float = 0.0,
    most_delay: float = 10.0,
) -> LoopMargins:
    """All margins of one device with its effects, filters and, if any, hand.

    Args:
        device: at its best estimate.
        effects: single values; None marks an effect that is not there.
        filters: of velocity and acceleration; a filter whose effect is not there is left out.
        hand: at its best estimate; None is the bare device. Passivity is for any passive hand.
        extra_delay_samples: on top of the device's delay.
        most_delay: further samples of delay looked for; fewer where a loop so late is refused.
    """
    used = used_filters(filters or Filters(), effects)

    def loop_at(further: float) -> Loop:
        return Loop.from_parts(
            device, used, hand, extra_delay_samples=extra_delay_samples + further
        )

    loop = loop_at(0.0)
    late = device.delay.value / device.sample_time.value + extra_delay_samples
    most = min(most_delay, LONGEST_DELAY - late)
    if most > 0 and bool(is_stable(loop, effects)):
        delay = delay_margin(loop_at, effects, most=most)
    else:
        delay = DelayMargin(every_gain=0.0, full_gain=0.0)
    return LoopMargins(
        gain=float(safe_gain(loop, effects)),
        delay=delay,
        decay=float(slowest_decay(loop, effects)),
        damping_ratio=float(least_damping_ratio(loop, effects)),
        phase=float(phase_margin(loop, effects)),
        disk=disk_margin(loop, effects),
        passivity=passivity(device, effects, used, extra_delay_samples=extra_delay_samples),
    )
