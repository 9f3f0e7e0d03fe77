"""Exact motion of several axes under held forces, each with its dry friction, many devices at once.

While no velocity turns the law is linear, and one map advances all devices by a sample. An axis
that turns or rests splits a sample: up to the instant of rest, then stuck or on its way, whatever
friction can hold. The axes that move are independent masses with damping in the coordinates in
which both matrices are diagonal (Golub and Van Loan, Matrix Computations, 4th edition, 8.7.1).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.estimators.signals import phi

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Turns and starts of a device in one part of a sample at most.
_MOST_EVENTS = 12
#: Newton steps to an instant of rest; the velocity is all but linear in time over a sample.
_NEWTON_STEPS = 3
#: Below this the series for the response of a device ends before the last bit.
_SMALL = 0.01
#: A delay this part of a sample beyond whole ones is whole.
_WHOLE = 1e-9
#: Samples stepped before it is looked whether anything turned.
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

    free: Indices
    rates: FloatArray  # (devices, free)
    shapes: FloatArray  # V with VᵀΛV = 1 and VᵀDV = diag(rates), (devices, free, free)
    back: FloatArray  # VᵀΛ

    @classmethod
    def of(cls, devices: DevicesOfAxes, free: Indices) -> _Pattern:
        mass, damping = (
            each[:, free[:, None], free[None, :]] for each in (devices.mass, devices.damping)
        )
        inverse = np.linalg.inv(np.linalg.cholesky(mass))
        rates, turned = np.linalg.eigh(inverse @ damping @ np.swapaxes(inverse, 1, 2))
        shapes = np.asarray(np.swapaxes(inverse, 1, 2) @ turned, dtype=np.float64)
        return cls(free, rates, shapes, np.swapaxes(shapes, 1, 2) @ mass)

    def moved(
        self, which: Indices | slice, speed: FloatArray, pull: FloatArray, span: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance, speed and acceleration of all axes after a span, shape (which, axes)."""
        free, shapes, rates = self.free, self.shapes[which], self.rates[which]
        own = _times(self.back[which], speed[:, free])
        push = _times(np.swapaxes(shapes, 1, 2), pull[:, free])
        time = span[:, None]
        one, two = _responses(rates * time)
        now = own + time * one * (push - rates * own)
        gone = time * one * own + time * time * two * push
        found = np.zeros((3, *speed.shape))
        for row, part in enumerate((gone, now, push - rates * now)):
            found[row][:, free] = _times(shapes, part)
        return found[0], found[1], found[2]


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
    grip: FloatArray = field(init=False)
    rough: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.grip = np.maximum(self.devices.friction, 0.0)
        self.rough = self.grip > 0

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
        spans = [(late, whole + 1)] if late.any() else []
        spans.append((step - late, whole))
        pulls = [
            self.force[np.maximum(np.arange(samples)[:, None] - ago, 0)] - devices.offset
            for _, ago in spans
        ]
        maps = _Maps.of([self._maps(span) for span, _ in spans])
        place, speed = devices.place.copy(), devices.speed.copy()
        # What rests is stuck until a force breaks it away.
        sense = np.where(self.rough, np.sign(speed), 0.0)
        found = np.empty((samples, *place.shape))
        found[: self.first + 1] = place
        k = self.first
        while k < samples - 1:
            if not np.any(self.rough & (sense == 0)):
                rows = slice(k, min(k + _BLOCK, samples - 1))
                pushes = [pull[rows] - self.grip * sense for pull in pulls]
                places, speeds = maps.run(place, speed, pushes)
                turned = np.any(speeds * sense < 0, axis=(1, 2))
                done = int(np.argmax(turned)) if turned.any() else len(turned)
                found[k + 1 : k + 1 + done] = places[:done]
                if done:
                    place, speed, k = places[done - 1], speeds[done - 1], k + done
                    continue
            for (span, _), pull in zip(spans, pulls, strict=True):
                place, speed, sense = self._through(place, speed, sense, pull[k], span)
            k += 1
            found[k] = place
        return found

    def _maps(self, span: FloatArray) -> FloatArray:
        """Speed by speed, by force, distance by speed, by force, (4, devices, axes, axes)."""
        count, axes = self.devices.offset.shape
        nothing = np.zeros((count, axes))
        pattern = self._pattern(np.ones(axes) > 0)
        parts = np.empty((4, count, axes, axes))
        for axis in range(axes):
            unit = np.broadcast_to(np.eye(axes)[axis], (count, axes))
            for row, (speed, pull) in enumerate(((unit, nothing), (nothing, unit))):
                gone, now, _ = pattern.moved(slice(None), speed, pull, span)
                parts[row, :, :, axis], parts[2 + row, :, :, axis] = now, gone
        return parts

    def _through(
        self,
        place: FloatArray,
        speed: FloatArray,
        sense: FloatArray,
        pull: FloatArray,
        span: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place, speed and sense of all after a span under a held force, through every turn."""
        left, sense = span.copy(), sense.copy()
        for _ in range(_MOST_EVENTS):
            needed = self._break_away(speed, sense, pull)
            gone, later, bend = self._moved(speed, sense, pull, left)
            back = later * sense < 0
            stuck = self.rough & (sense == 0)
            ends = self._needed(later, bend, pull) if stuck.any() else needed
            loose = stuck & (np.abs(ends) > self.grip)
            which = np.flatnonzero((back | loose).any(axis=1))
            if not which.size:
                return place + gone, later, sense
            instant = self._rests(speed, sense, pull, left, later, back)
            # What holds an axis changes all but evenly within a sample.
            spare, more = self.grip - np.abs(needed), np.abs(ends) - np.abs(needed)
            part = np.clip(spare / np.where(loose, more, 1.0), 0.0, 1.0)
            instant = np.where(loose, part * left[:, None], instant)[which]
            axis = np.argmin(instant, axis=1)
            until = left.copy()
            until[which] = instant[np.arange(len(which)), axis]
            gone, later, _ = self._moved(speed, sense, pull, until)
            place, speed, left = place + gone, later, left - until
            speed[which, axis] = 0.0
            sense[which, axis] = np.where(loose, np.sign(ends), 0.0)[which, axis]
        gone, later, _ = self._moved(speed, sense, pull, left)
        return place + gone, later, sense

    def _needed(self, speed: FloatArray, bend: FloatArray, pull: FloatArray) -> FloatArray:
        """Force that friction has to give each axis for this acceleration, N."""
        return pull - _times(self.devices.mass, bend) - _times(self.devices.damping, speed)

    def _moved(
        self, speed: FloatArray, sense: FloatArray, pull: FloatArray, span: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance, speed and acceleration after a span in which nothing turns or breaks away."""
        moving: NDArray[Any] = ~(self.rough & (sense == 0))
        push = pull - self.grip * sense
        codes: Indices = moving @ (1 << np.arange(moving.shape[1], dtype=np.intp))
        kinds = np.flatnonzero(np.bincount(codes))
        if kinds.size == 1:
            return self._pattern(moving[0]).moved(slice(None), speed, push, span)
        found = np.empty((3, *speed.shape))
        for kind in kinds:
            which = np.flatnonzero(codes == kind)
            pattern = self._pattern(moving[which[0]])
            found[:, which] = pattern.moved(which, speed[which], push[which], span[which])
        return found[0], found[1], found[2]

    def _break_away(self, speed: FloatArray, sense: FloatArray, pull: FloatArray) -> FloatArray:
        """Give what friction cannot hold any longer its sense, the most pulled axis first.

        Returns the force that holds what is stuck, N, zero where nothing is.
        """
        needed = np.zeros_like(speed)
        for _ in range(speed.shape[1]):
            stuck = self.rough & (sense == 0)
            if not stuck.any():
                break
            _, _, bend = self._moved(speed, sense, pull, np.zeros(len(speed)))
            needed = self._needed(speed, bend, pull)
            excess = np.where(stuck, np.abs(needed) - self.grip, 0.0)
            axis = np.argmax(excess, axis=1)
            free = np.flatnonzero(excess[np.arange(len(axis)), axis] > 0)
            if not free.size:
                break
            sense[free, axis[free]] = np.sign(needed[free, axis[free]])
        return needed

    def _rests(
        self,
        speed: FloatArray,
        sense: FloatArray,
        pull: FloatArray,
        left: FloatArray,
        later: FloatArray,
        back: NDArray[np.bool_],
    ) -> FloatArray:
        """When each axis of each device comes to rest, s; infinite where it does not."""
        instant = np.full(speed.shape, np.inf)
        for axis in np.flatnonzero(back.any(axis=0)):
            some = np.flatnonzero(back[:, axis])
            start, end = speed[some, axis], later[some, axis]
            # What has just broken away begins at zero: its return is looked for from the end.
            time = left[some] * np.where(start == 0, 1.0, start / (start - end))
            for _ in range(_NEWTON_STEPS):
                span = left.copy()
                span[some] = time
                _, now, bend = self._moved(speed, sense, pull, span)
                slope = bend[some, axis]
                slope = np.where(slope == 0, np.inf, slope)
                time = np.clip(time - now[some, axis] / slope, 0.0, left[some])
            instant[some, axis] = time
        return instant


@dataclass(frozen=True, slots=True)
class _Maps:
    """All parts of a sample as one linear map."""

    keep: FloatArray  # speed by speed before, (devices, axes, axes)
    gone: FloatArray  # distance by speed before
    faster: tuple[FloatArray, ...]  # speed by the force of each part
    further: tuple[FloatArray, ...]  # distance by the force of each part

    @classmethod
    def of(cls, parts: list[FloatArray]) -> _Maps:
        """From speed by speed and force and distance by both, of each part."""
        first = parts[0]
        if len(parts) == 1:
            return cls(first[0], first[2], (first[1],), (first[3],))
        last = parts[1]
        return cls(
            last[0] @ first[0],
            first[2] + last[2] @ first[0],
            (last[0] @ first[1], last[1]),
            (first[3] + last[2] @ first[1], last[3]),
        )

    def run(
        self, place: FloatArray, speed: FloatArray, pushes: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Places and speeds after each of some samples, (samples, devices, axes) each."""
        added, moved = np.zeros((2, *pushes[0].shape))
        for faster, further, push in zip(self.faster, self.further, pushes, strict=True):
            added += np.einsum("bij,kbj->kbi", faster, push)
            moved += np.einsum("bij,kbj->kbi", further, push)
        speeds = np.empty((pushes[0].shape[0] + 1, *speed.shape))
        speeds[0] = speed
        keep, column = self.keep, speed[:, :, None]
        for row, each in enumerate(added.reshape(*added.shape, 1), start=1):
            column = keep @ column + each
            speeds[row] = column[:, :, 0]
        steps = np.einsum("bij,kbj->kbi", self.gone, speeds[:-1]) + moved
        return place + np.cumsum(steps, axis=0), speeds[1:]
