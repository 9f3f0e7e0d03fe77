"""The law as it is played, in plain Python: what a controller does with every reading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from tune import SafeProfile


@dataclass(slots=True, kw_only=True)
class LowPass:
    """x[k] = (t·x[k-1] - p·x[k-2]) + (1 - t + p)·u[k]."""

    t: float
    p: float
    now: float = 0.0
    before: float = 0.0

    def take(self, value: float) -> float:
        """The output after one more input."""
        output = (self.t * self.now - self.p * self.before) + (1 - self.t + self.p) * value
        self.now, self.before = output, self.now
        return output


@dataclass(slots=True, kw_only=True)
class Played:
    """One element: where it rests, to which side it pushes, how far it is faded in."""

    rest: float = 0.0
    side: int = 0
    level: float = 0.0


@dataclass(slots=True)
class PlayedLaw:
    """The force of a profile's elements on one axis, started at rest by the first reading.

    Readings are those that are good, each with the number of periods since the one before.
    """

    profile: SafeProfile
    contacts: dict[str, Played] = field(init=False)
    velocity: LowPass = field(init=False)
    acceleration: LowPass = field(init=False)
    past: list[float] = field(default_factory=list[float])
    slope: float = 0.0

    def __post_init__(self) -> None:
        loop = self.profile.loop
        self.contacts = {name: Played() for name in self.profile.elements}
        self.velocity, self.acceleration = (
            _low_pass(cutoff, order, loop.filter_damping_ratio, loop.sample_time)
            for cutoff, order in (
                (loop.velocity_filter_hz, loop.velocity_filter_order),
                (loop.acceleration_filter_hz, loop.acceleration_filter_order),
            )
        )

    def force(
        self, touched: Mapping[str, tuple[float, int]], reading: float, periods: int = 1
    ) -> float:
        """Force of what is touched, each with (rest, side), and of what still fades out."""
        before = self.past[-1] if self.past else reading
        for step in range(1, periods):
            self._take(before + (reading - before) * step / periods)
        self._take(reading)
        total = 0.0
        for name, element in self.profile.elements.items():
            contact = self.contacts[name]
            if name in touched:
                contact.rest, contact.side = touched[name]
            fade = element.fade_time
            change = periods * (min(1.0, self.profile.loop.sample_time / fade) if fade else 1.0)
            wanted = contact.level + (change if name in touched else -change)
            contact.level = min(1.0, max(0.0, wanted))
            if contact.level:
                total += contact.level * self._element(name, reading)
        limit = self.profile.device.force_limit
        assert limit is not None
        return max(-limit.peak, min(limit.peak, total))

    def _element(self, name: str, reading: float) -> float:
        element, contact = self.profile.elements[name], self.contacts[name]
        force = -(
            (element.stiffness * (reading - contact.rest) + element.damping * self.velocity.now)
            + element.mass * self.acceleration.now
        )
        if not element.one_sided:
            return force
        outside = contact.side * (contact.rest - reading) <= 0
        return 0.0 if outside or force * contact.side < 0 else force

    def _take(self, reading: float) -> None:
        step = self.profile.loop.sample_time
        window = self.profile.loop.velocity_window_samples or 1
        if not self.past:
            self.past = [reading] * window
        slope = (reading - self.past[-1]) / step
        self.velocity.take((reading - self.past[0]) / (window * step))
        self.acceleration.take((slope - self.slope) / step)
        self.past, self.slope = [*self.past[1:], reading], slope


def _low_pass(cutoff: float | None, order: int, ratio: float, step: float) -> LowPass:
    if cutoff is None:
        return LowPass(t=0.0, p=0.0)
    turn = 2 * math.pi * cutoff * step
    if order == 1:
        return LowPass(t=math.exp(-turn), p=0.0)
    size = math.exp(-ratio * turn)
    return LowPass(t=2 * size * math.cos(turn * math.sqrt(1 - ratio * ratio)), p=size * size)
