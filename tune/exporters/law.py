"""The filters of a profile as coefficients, from their definitions in docs/theory.md, 1."""

from __future__ import annotations

import math
from dataclasses import dataclass

from identification import InvalidInputError
from tune.documents.profile import ElementProfile, LoopProfile, SafeProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A low-pass x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k] with g = 1 - t + p.

    One pole a: t = a, p = 0. No filter: t = p = 0.

    Attributes:
        t: sum of the poles.
        p: their product.
    """

    t: float = 0.0
    p: float = 0.0

    @property
    def gain(self) -> float:
        """g, from the very t and p that are printed, so that a steady input passes unchanged."""
        return 1 - self.t + self.p


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """How velocity and acceleration come from the readings y.

    Velocity: (y[k] - y[k-n])/(n·T) through its section. Acceleration: the backward difference of
    the backward difference, (d[k] - d[k-1])/T with d[k] = (y[k] - y[k-1])/T, through its section.

    Attributes:
        sample_time: T, s.
        window: n, 1 where there is no moving window.
        velocity: section of the velocity.
        acceleration: section of the acceleration.
    """

    sample_time: float
    window: int
    velocity: Section
    acceleration: Section


def law_of(loop: LoopProfile) -> Law:
    """The control law of a profile's loop."""
    step, ratio = loop.sample_time, loop.filter_damping_ratio
    return Law(
        sample_time=step,
        window=loop.velocity_window_samples or 1,
        velocity=_section(loop.velocity_filter_hz, loop.velocity_filter_order, ratio, step),
        acceleration=_section(
            loop.acceleration_filter_hz, loop.acceleration_filter_order, ratio, step
        ),
    )


def longest_tap(profile: SafeProfile) -> int:
    """Samples that the multipliers of the proof look back, at least one."""
    proofs = (profile.certificate.absolute_stability or {}).values()
    multipliers = (each for proof in proofs for each in (proof.free, proof.held) if each)
    taps = (tap for each in multipliers for channel in each.channels for tap in channel.taps)
    return max((tap.samples for tap in taps), default=1)


def fade_step(element: ElementProfile, sample_time: float) -> float:
    """Change of the level of an element in one period, s; 1 switches it at once.

    Raises:
        InvalidInputError: it has to fade, and the profile does not say over which time.
    """
    if element.fades and not element.fade_time:
        raise InvalidInputError(
            "profile",
            "an element with mass or a negative effect has no fade_time, and must not be switched",
            "Tune again",
        )
    return min(1.0, sample_time / element.fade_time) if element.fade_time else 1.0


def _section(cutoff: float | None, order: int, ratio: float, step: float) -> Section:
    """Poles exp(-2π·f·T), or exp(-2π·f·T·(ζ ± j·√(1-ζ²))); cut-off in Hz, step in s."""
    if cutoff is None:
        return Section()
    turn = 2 * math.pi * cutoff * step
    if order == 1:
        return Section(t=math.exp(-turn))
    size = math.exp(-ratio * turn)
    return Section(t=2 * size * math.cos(turn * math.sqrt(1 - ratio * ratio)), p=size * size)
