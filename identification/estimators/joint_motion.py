"""Exact motion of several axes under held forces, each with its dry friction, many devices at once.

While no velocity turns the law is linear, and one map advances all devices by a sample. An axis
that turns or rests splits a sample: up to the instant of rest, then stuck or on its way, whatever
friction can hold. The axes that move are independent masses with damping in the coordinates in
which both matrices are diagonal (Golub and Van Loan, Matrix Computations, 4th edition, 8.7.1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.estimators.signals import phi
from identification.trajectory import BoolArray, FloatArray, IndexArray

#: Turns and starts of a device in one part of a sample at most.
_MOST_EVENTS = 12
#: Newton steps to an instant of rest; the velocity is all but linear in time over a sample.
_NEWTON_STEPS = 3
#: A step this part of what is left of the sample is the last.
_FINE = 1e-8
#: Below this the series for the response of a device ends before the last bit.
_SMALL = 0.01
#: A delay this part of a sample beyond whole ones is whole.
_WHOLE = 1e-9
#: Samples stepped at once, after which it is looked whether anything turned.
_BLOCK = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class DevicesOfAxes:
    """Parameters of devices of several axes, shape (devices, ...)."""

    mass: FloatArray  # Λ, kg, shape (devices, axes, axes), positive definite
    damping: FloatArray  # D, N·s/m, of the same shape
    friction: FloatArray  # Fc, N, shape (devices, axes); not positive: none
    offset: FloatArray  # f0, N, shape (devices, axes)
    delay: FloatArray  # s, shape (devices,)
    speed: FloatArray  # at the first sample, m/s, shape (devices, axes)
    place: FloatArray  # at the first sample, m, shape (devices, axes)

    def positions(self, force: FloatArray, step: float, first: int) -> FloatArray:
        """Positions at each sample, m, shape (n, devices, axes), under forces, N, shape (n, axes).

        Before the log its first force acted. Motion begins at sample ``first``, with the start of
        the devices; earlier samples have it too.
        """
        return _Run(self, force, step, first).positions()


@dataclass(frozen=True, slots=True)
class _Pattern:
    """Devices some axes of which stand: those that move, in diagonal coordinates."""

    free: IndexArray
    rates: FloatArray  # (devices, free)
    shapes: FloatArray  # V with VᵀΛV = 1 and VᵀDV = diag(rates), (devices, free, free)
    back: FloatArray  # VᵀΛ
    pushed: FloatArray  # force that holds what stands by all forces, (devices, axes, axes)
    slowed: FloatArray  # ... and by the speeds

    @classmethod
    def of(cls, devices: DevicesOfAxes, free: IndexArray) -> _Pattern:
        square = (slice(None), free[:, None], free)
        mass, damping = devices.mass[square], devices.damping[square]
        inverse = np.linalg.inv(np.linalg.cholesky(mass))
        rates, turned = np.linalg.eigh(inverse @ damping @ np.swapaxes(inverse, 1, 2))
        shapes = np.asarray(np.swapaxes(inverse, 1, 2) @ turned, dtype=np.float64)
        light = np.zeros_like(devices.mass)  # Λ⁻¹ of what moves
        light[square] = shapes @ np.swapaxes(shapes, 1, 2)
        taken = devices.mass @ light
        pushed, slowed = np.eye(len(taken[0])) - taken, taken @ devices.damping - devices.damping
        return cls(free, rates, shapes, np.swapaxes(shapes, 1, 2) @ mass, pushed, slowed)

    def held(self, which: IndexArray | slice, speed: FloatArray, push: FloatArray) -> FloatArray:
        """Force that holds the axes that stand, N, shape (which, axes)."""
        return _times(self.pushed[which], push) + _times(self.slowed[which], speed)

    def moved(
        self, which: IndexArray | slice, speed: FloatArray, pull: FloatArray, span: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Distance and speed of all axes after a span, shape (which, axes)."""
        own, push = self._own(which, speed, pull)
        shapes, rates, time = self.shapes[which], self.rates[which], span[:, None]
        one, two = _responses(rates * time)
        found = np.zeros((2, *speed.shape))
        found[0][:, self.free] = _times(shapes, time * (one * own + time * two * push))
        found[1][:, self.free] = _times(shapes, own + time * one * (push - rates * own))
        return found[0], found[1]

    def rest(
        self,
        which: IndexArray,
        axis: int,
        speed: FloatArray,
        pull: FloatArray,
        time: FloatArray,
        left: FloatArray,
    ) -> FloatArray:
        """When an axis comes to rest within what is left, s, shape (which,), by Newton steps."""
        own, push = self._own(which, speed, pull)
        shape, rates = self.shapes[which, np.searchsorted(self.free, axis)], self.rates[which]
        for _ in range(_NEWTON_STEPS):
            one, _ = _responses(rates * time[:, None])
            now = own + time[:, None] * one * (push - rates * own)
            slope = np.sum(shape * (push - rates * now), axis=1)
            move = np.sum(shape * now, axis=1) / np.where(slope == 0, np.inf, slope)
            before, time = time, np.clip(time - move, 0.0, left)
            if np.all(np.abs(time - before) <= _FINE * left):
                break  # the next step would be as small as the square of this one
        return time

    def _own(
        self, which: IndexArray | slice, speed: FloatArray, pull: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Speeds and forces in the coordinates of those that move."""
        turned = np.swapaxes(self.shapes[which], 1, 2)
        return _times(self.back[which], speed[:, self.free]), _times(turned, pull[:, self.free])


def _responses(delta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """φ1 and φ2 of ``phi``, by fewer terms where all are small, as within a sample."""
    if np.max(np.abs(delta), initial=0.0) > _SMALL:
        one, two, _ = phi(delta)
        return one, two
    two = 0.5 - delta / 6 * (1 - delta / 4 * (1 - delta / 5 * (1 - delta / 6 * (1 - delta / 7))))
    return 1 - delta * two, two


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return (matrices @ vectors[:, :, None])[:, :, 0]


@dataclass(slots=True)
class _Run:
    """Devices on their way through a log."""

    devices: DevicesOfAxes
    force: FloatArray
    step: float
    first: int
    patterns: dict[bytes, _Pattern] = field(default_factory=dict[bytes, _Pattern])
    blocks: dict[bytes, _Block] = field(default_factory=dict[bytes, "_Block"])
    grip: FloatArray = field(init=False)
    rough: BoolArray = field(init=False)
    bits: IndexArray = field(init=False)

    def __post_init__(self) -> None:
        self.grip = np.maximum(self.devices.friction, 0.0)
        self.rough = self.grip > 0
        self.bits = 1 << np.arange(self.grip.shape[1])

    def _pattern(self, moving: NDArray[Any]) -> _Pattern:
        key = moving.tobytes()
        if key not in self.patterns:
            self.patterns[key] = _Pattern.of(self.devices, np.flatnonzero(moving))
        return self.patterns[key]

    def positions(self) -> FloatArray:
        """See `DevicesOfAxes.positions`."""
        devices, step = self.devices, self.step
        samples = len(self.force)
        whole = np.floor(devices.delay / step + _WHOLE).astype(np.intp)
        late = np.maximum(devices.delay - whole * step, 0.0)
        late = np.where(late < _WHOLE * step, 0.0, late)
        parts = [(late, whole + 1)] if late.any() else []
        parts.append((step - late, whole))
        spans = [span for span, _ in parts]
        # One part of a sample after another, shape (devices, samples, parts, axes).
        sent = np.arange(samples)[:, None] - np.stack([ago for _, ago in parts], axis=1)[:, None]
        pulls = self.force[np.maximum(sent, 0)] - devices.offset[:, None, None]
        place, speed = devices.place.copy(), devices.speed.copy()
        # What rests is stuck until a force breaks it away.
        sense = np.where(self.rough, np.sign(speed), 0.0)
        found = np.empty((samples, *place.shape))
        found[: self.first + 1] = place
        k, every = self.first, np.arange(len(place))
        while k < samples - 1:
            moving = ~self._stuck(slice(None), sense)
            if np.all(moving == moving[0]):
                ahead = pulls[:, k : min(k + _BLOCK, samples - 1)]
                places, speeds = self._block(moving[0], spans).run(speed, sense, ahead, self.grip)
                if done := places.shape[1]:
                    found[k + 1 : k + 1 + done] = np.swapaxes(place[:, None] + places, 0, 1)
                    place, speed, k = found[k + done], speeds, k + done
                    continue
            for part, span in enumerate(spans):
                given = place, speed, sense, pulls[:, k, part], span
                place, speed, sense = self._through(every, *given)
            k += 1
            found[k] = place
        return found

    def _stuck(self, some: IndexArray | slice, sense: FloatArray) -> BoolArray:
        """Which axes of some devices stand; without friction none does."""
        return self.rough[some] & (sense == 0)

    def _block(self, moving: NDArray[Any], spans: list[FloatArray]) -> _Block:
        key = moving.tobytes()
        if key not in self.blocks:
            self.blocks[key] = _Block.of(self.devices, self._pattern(moving), spans)
        return self.blocks[key]

    def _through(
        self,
        some: IndexArray,
        place: FloatArray,
        speed: FloatArray,
        sense: FloatArray,
        pull: FloatArray,
        left: FloatArray,
        events: int = 0,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place, speed and sense after a span, s, under a held force, through every turn in it."""
        sense, needed = self._broken_away(some, speed, sense, pull)
        gone, later = self._moved(some, speed, sense, pull, left)
        back = later * sense < 0
        grip, stuck = self.grip[some], self._stuck(some, sense)
        ends = self._held(some, later, sense, pull) if stuck.any() else needed
        loose = stuck & (np.abs(ends) > grip)
        which = np.flatnonzero((back | loose).any(axis=1))
        place = place + gone
        if not which.size or events == _MOST_EVENTS:
            return place, later, sense
        # What holds an axis changes all but evenly within a sample.
        spare, more = (grip - np.abs(needed))[which], (np.abs(ends) - np.abs(needed))[which]
        part = np.clip(spare / np.where(loose[which], more, 1.0), 0.0, 1.0)
        turning, begin, left = some[which], (speed[which], sense[which], pull[which]), left[which]
        rests = self._rests(turning, *begin, left, later[which], back[which])
        instant = np.where(loose[which], part * left[:, None], rests)
        first = np.arange(which.size), np.argmin(instant, axis=1)
        until = instant[first]
        so_far, now = self._moved(turning, *begin, until)
        now[first] = 0.0
        begin[1][first] = np.where(loose, np.sign(ends), 0.0)[which][first]
        here = place[which] - gone[which] + so_far
        place[which], later[which], sense[which] = self._through(
            turning, here, now, *begin[1:], left - until, events + 1
        )
        return place, later, sense

    def _held(
        self, some: IndexArray, speed: FloatArray, sense: FloatArray, pull: FloatArray
    ) -> FloatArray:
        """Force that friction has to give each axis that stands, N, (some, axes)."""
        push, found = pull - self.grip[some] * sense, np.empty_like(speed)
        for rows, pattern in self._kinds(some, sense):
            found[rows] = pattern.held(some[rows], speed[rows], push[rows])
        return found

    def _moved(
        self,
        some: IndexArray,
        speed: FloatArray,
        sense: FloatArray,
        pull: FloatArray,
        span: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Distance and speed after a span in which nothing turns or breaks away."""
        push, found = pull - self.grip[some] * sense, np.empty((2, *speed.shape))
        for rows, pattern in self._kinds(some, sense):
            found[:, rows] = pattern.moved(some[rows], speed[rows], push[rows], span[rows])
        return found[0], found[1]

    def _kinds(
        self, some: IndexArray, sense: FloatArray
    ) -> Iterator[tuple[IndexArray | slice, _Pattern]]:
        """Rows of devices by which of their axes move."""
        moving = ~self._stuck(some, sense)
        codes = moving @ self.bits
        if np.all(codes == codes[0]):
            yield slice(None), self._pattern(moving[0])
            return
        for code in np.flatnonzero(np.bincount(codes)):
            rows = np.flatnonzero(codes == code)
            yield rows, self._pattern(moving[rows[0]])

    def _broken_away(
        self, some: IndexArray, speed: FloatArray, sense: FloatArray, pull: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Senses with those of what friction cannot hold, and the force on what is stuck, N."""
        sense, needed = sense.copy(), np.zeros_like(speed)
        for _ in range(speed.shape[1]):
            stuck = self._stuck(some, sense)
            if not stuck.any():
                break
            needed = self._held(some, speed, sense, pull)
            excess = np.where(stuck, np.abs(needed) - self.grip[some], 0.0)
            axis = np.argmax(excess, axis=1)
            free = np.flatnonzero(excess[np.arange(len(axis)), axis] > 0)
            if not free.size:
                break
            sense[free, axis[free]] = np.sign(needed[free, axis[free]])
        return sense, needed

    def _rests(
        self,
        some: IndexArray,
        speed: FloatArray,
        sense: FloatArray,
        pull: FloatArray,
        left: FloatArray,
        later: FloatArray,
        back: BoolArray,
    ) -> FloatArray:
        """When each axis of each device comes to rest, s; infinite where it does not."""
        push, instant = pull - self.grip[some] * sense, np.full(speed.shape, np.inf)
        for kind, pattern in self._kinds(some, sense):
            rows = np.arange(len(some))[kind]
            for axis in np.flatnonzero(back[rows].any(axis=0)).tolist():
                those = rows[back[rows, axis]]
                start, end = speed[those, axis], later[those, axis]
                # What has just broken away begins at zero: its return is looked for from the end.
                time = left[those] * np.where(start == 0, 1.0, start / (start - end))
                given = some[those], axis, speed[those], push[those]
                instant[those, axis] = pattern.rest(*given, time, left[those])
        return instant


@dataclass(frozen=True, slots=True)
class _Block:
    """Some samples as one linear map, while no axis turns, comes to rest or breaks away."""

    parts: int  # of a sample
    #: (speeds, distances) after each part by (start speed, forces of the parts), shape (devices, 2,
    #: steps·axes, axes + steps·axes)
    maps: FloatArray
    stuck: IndexArray
    pattern: _Pattern

    @classmethod
    def of(cls, devices: DevicesOfAxes, pattern: _Pattern, spans: list[FloatArray]) -> _Block:
        """Of the axes of a pattern, for samples of these parts, s, shape (devices,)."""
        count, axes = devices.offset.shape
        nothing = np.zeros((count, axes))
        parts = np.empty((len(spans), 4, count, axes, axes))
        for part, span in zip(parts, spans, strict=True):
            for axis in range(axes):
                unit = np.broadcast_to(np.eye(axes)[axis], (count, axes))
                for row, (speed, pull) in enumerate(((unit, nothing), (nothing, unit))):
                    gone, now = pattern.moved(slice(None), speed, pull, span)
                    part[row, :, :, axis], part[2 + row, :, :, axis] = now, gone
        steps = _BLOCK * len(spans)
        maps = np.zeros((count, 2, steps, axes, axes * (steps + 1)))
        speed, place = np.zeros((2, count, axes, maps.shape[-1]))
        speed[:, :, :axes] = np.eye(axes)
        for step in range(steps):
            keep, faster, gone, further = parts[step % len(spans)]
            own = slice(axes * (step + 1), axes * (step + 2))
            place, speed = place + gone @ speed, keep @ speed
            place[:, :, own] += further
            speed[:, :, own] += faster
            maps[:, 0, step], maps[:, 1, step] = speed, place
        return cls(
            parts=len(spans),
            maps=maps.reshape(count, 2, steps * axes, -1),
            stuck=np.setdiff1d(np.arange(axes, dtype=np.intp), pattern.free),
            pattern=pattern,
        )

    def run(
        self, speed: FloatArray, sense: FloatArray, pulls: FloatArray, grip: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Distances after each sample, (devices, samples, axes), and the speed after the last.

        Of as many samples as nothing happens in, which may be none. Pulls have shape (devices,
        samples, parts, axes).
        """
        count, samples, parts, axes = pulls.shape
        steps = samples * parts
        pushes = (pulls - (grip * sense)[:, None, None]).reshape(count, steps, axes)
        given = np.concatenate((speed[:, None], pushes), axis=1).reshape(count, 1, -1, 1)
        maps = self.maps[:, :, : steps * axes, : given.shape[2]]
        found = (maps @ given).reshape(count, 2, steps, axes)
        speeds, places = found[:, 0], found[:, 1]
        ends = (speeds * sense[:, None] < 0).any(axis=(0, 2))
        if self.stuck.size:
            before = np.concatenate((speed[:, None], speeds[:, :-1]), axis=1)
            pushed, slowed = (
                np.swapaxes(each, 1, 2) for each in (self.pattern.pushed, self.pattern.slowed)
            )
            for each in (before, speeds):
                held = pushes @ pushed + each @ slowed
                loose = np.abs(held[..., self.stuck]) > grip[:, None, self.stuck]
                ends |= loose.any(axis=(0, 2))
        done = int(np.argmax(ends)) // parts if ends.any() else samples
        last = done * parts
        return places[:, parts - 1 : last : parts], speeds[:, last - 1] if done else speed
