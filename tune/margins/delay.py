"""Delay margin: how many more samples of delay, whole and parts, a loop bears.

At any one delay the verdict and the gains at which the loop turns unstable are exact (`crossings`).
Between two delays a and b that are both stable nothing can have happened unless, at some
frequency, the open loop L travelled as far as the sum of its distances from the forbidden set at a
and at b: the point -1, or all of (-∞, -1] where every lower gain must be stable too. The search
halves whatever this does not exclude; the first end found unstable is then refined on the exact
crossing gain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.closed_loop import ClosedLoop, closed_loops, value
from tune.loop.loop import Loop
from tune.stability.bracketing import last_kept
from tune.stability.peaks import parts_on_axis
from tune.stability.verdict import stable_gains, verdict

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

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


@dataclass(frozen=True, slots=True)
class _At:
    """A loop at one delay: is it safe, and what is needed to compare it with a neighbour."""

    delay: float
    safe: bool
    loop: ClosedLoop


class _Search:
    def __init__(
        self, loop_at: Callable[[float], Loop], effects: Effects, most: float, *, all_gains: bool
    ) -> None:
        self._loop_at = loop_at
        self._effects = effects
        self._most = most
        self._all_gains = all_gains

    def first_unstable(self, start: float) -> float:
        """First delay after ``start`` that is not stable; ``start`` where it is not itself."""
        here = self._at(start)
        if not here.safe:
            return start
        while here.delay < self._most:
            there = self._at(min(here.delay + _LONGEST_STEP, self._most))
            while not self._reached(here, there):
                middle = (here.delay + there.delay) / 2
                if not there.safe and there.delay - here.delay <= _BRACKET:
                    return self._refined(here.delay, there.delay)
                there = self._at(middle)
            here = there
        return self._most

    def _reached(self, here: _At, there: _At) -> bool:
        """True where the whole way between two delays is taken to be stable."""
        if not there.safe:
            return False
        if there.delay - here.delay <= _SHORTEST_STEP:
            return True
        v = _frequencies(here.loop, there.loop)
        (one, first), (two, second) = (
            (open_loop, _distance(open_loop, all_gains=self._all_gains))
            for open_loop in (_response(place.loop, v) for place in (here, there))
        )
        return bool(np.all(_PATH * np.abs(two - one) <= first + second))

    def _at(self, delay: float) -> _At:
        loop = self._loop_at(delay)
        (closed,), _ = closed_loops(loop, self._effects)
        if self._all_gains:
            safe = self._distance_to_crossing(loop) > 0
        else:
            safe = bool(np.all(verdict(loop, self._effects) > 0))
        return _At(delay, safe, closed)

    def _distance_to_crossing(self, loop: Loop) -> float:
        """ln of the gain that reaches the boundary, positive where stable, negative where not.

        Continuous in the delay wherever it matters: near the delay at which it is zero.
        """
        low, high = stable_gains(loop, self._effects)
        low, high = low.reshape(-1), high.reshape(-1)
        if self._all_gains:
            ends = high[low == 0]
            return float(np.log(ends[0])) if ends.size else -np.inf
        with np.errstate(divide="ignore"):
            within = np.minimum(np.log(high), -np.log(low))
        return float(np.max(within[~np.isnan(within)], initial=-np.inf))

    def _refined(self, stable: float, unstable: float) -> float:
        """The crossing in between: secant steps on the exact gain, halvings where it jumps."""
        return last_kept(
            lambda delay: self._distance_to_crossing(self._loop_at(delay)),
            stable,
            unstable,
            room_kept=self._distance_to_crossing(self._loop_at(stable)),
            room_broken=self._distance_to_crossing(self._loop_at(unstable)),
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


def _response(loop: ClosedLoop, v: FloatArray) -> ComplexArray:
    return value(loop.added, v) / value(loop.open, v)


def _distance(open_loop: ComplexArray, *, all_gains: bool) -> FloatArray:
    """From -1, or from the whole of (-∞, -1]."""
    to_point = np.abs(1 + open_loop)
    if not all_gains:
        return to_point
    return np.where(open_loop.real < -1, np.abs(open_loop.imag), to_point)
