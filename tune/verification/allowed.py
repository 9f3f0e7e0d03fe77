"""AllowedLoops: the devices and delays under which a loop would move as the log shows.

In free motion a delay d under a spring K looks like damping: what decays is m·q̈ + (b - K·d)·q̇ +
K·q, so one log at one gain tells b - K·d and never d alone. What it tells is the set of all
(m, b, d), m and b within the device's box, whose slow mode is the measured one. The range of d in it
is the interval of the delay; and as each d comes with its own m and b, the set says more of other
gains than that interval beside the box.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.effects import Effects
from tune.filters import Filters, used_filters
from tune.loop import LONGEST_DELAY
from tune.verification.loops_over import damped_hertz, loops_over, slow_poles

FloatArray = NDArray[np.float64]
Range = tuple[float, float]

#: Samples of delay looked through beyond the stated one, and the step of the search.
_MOST_SAMPLES = 16.0
#: Masses and dampings that stand for the box.
_MASSES, _DAMPINGS = 21, 17


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeSeen:
    """What is known of the slow mode, intervals and tolerances included; None where nothing is.

    Attributes:
        frequency: (low, high), Hz.
        decay: (low, high), 1/s.
    """

    frequency: Range | None
    decay: Range | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AllowedLoops:
    """Masses, dampings and delays whose loop has a given slow mode, each of shape (n,).

    Attributes:
        mass: kg.
        damping: N·s/m.
        delay_samples: from command to measurement.
        most: the longest delay that was looked at, samples.
        step: between the delays that were looked at, samples.
        stated: (low, high) of the device, samples.
    """

    mass: FloatArray
    damping: FloatArray
    delay_samples: FloatArray
    most: float
    step: float
    stated: Range

    @property
    def delays(self) -> Range | None:
        """(least, longest) delay, samples; None where no loop is allowed."""
        if self.delay_samples.size == 0:
            return None
        return float(self.delay_samples.min()), float(self.delay_samples.max())

    @property
    def open_ended(self) -> bool:
        """Whether the longest delay that was looked at is allowed, and so may be longer ones."""
        return self.delays is not None and self.delays[1] >= self.most

    @property
    def allow_stated(self) -> bool:
        """Whether a delay the device states is among them."""
        low, high = self.stated
        return bool(np.any((self.delay_samples >= low) & (self.delay_samples <= high)))


def allowed_loops(
    device: Device,
    filters: Filters,
    effects: Effects,
    seen: ModeSeen,
    *,
    extra: float,
    step: float = 0.5,
    fineness: float = 1.0,
) -> AllowedLoops:
    """All loops of the device's box and of any delay whose slow mode is the one seen.

    Args:
        device: with its intervals.
        filters: that were run.
        effects: as played, single numbers.
        seen: of the slow mode.
        extra: samples of delay that are to be judged beyond.
        step: between the delays looked at, samples.
        fineness: 1 for a verdict; less takes fewer masses and dampings, for planning.
    """
    box = device.simultaneous_box()
    masses = _places(np.log(box.mass), round(fineness * _MASSES))
    dampings = _places(box.damping, round(fineness * _DAMPINGS))
    mass, damping = (
        part.ravel() for part in np.meshgrid(np.exp(masses), dampings, indexing="ij")
    )
    shape = masses.size, dampings.size
    used, T = used_filters(filters, effects), device.sample_time.value
    stated = box.delay[0] / box.sample_time[1], box.delay[1] / box.sample_time[0]
    most = min(LONGEST_DELAY - extra, max(_MOST_SAMPLES, stated[1]))
    delays = np.unique([*np.arange(0.0, most + step / 2, step), *stated, device.delay.value / T])
    delays = delays[(delays <= most) | (delays <= stated[1])]
    kept: list[FloatArray] = []
    for delay in delays.tolist():
        poles = slow_poles(loops_over(device, mass, damping, delay, used), effects, T)
        inside = np.ones(mass.size, dtype=np.bool_)
        for values, wanted in ((damped_hertz(poles), seen.frequency), (-poles.real, seen.decay)):
            if wanted is not None:
                reach = _reach(values.reshape(shape)).ravel()
                inside &= (values + reach >= wanted[0]) & (values - reach <= wanted[1])
        kept.append(
            np.stack([mass[inside], damping[inside], np.full(np.count_nonzero(inside), delay)])
        )
    found = np.concatenate(kept, axis=1)
    return AllowedLoops(
        mass=found[0],
        damping=found[1],
        delay_samples=found[2],
        most=most,
        step=step,
        stated=stated,
    )


def _places(ends: Range | FloatArray, count: int) -> FloatArray:
    """Places from end to end; one where the ends are the same."""
    low, high = float(ends[0]), float(ends[1])
    return np.array([low]) if low == high else np.linspace(low, high, max(count, 3))


def _reach(values: FloatArray) -> FloatArray:
    """How far the values of a grid change halfway to its neighbours, so that none slips between."""
    reach = np.zeros_like(values)
    for axis in (0, 1):
        change = np.abs(np.diff(values, axis=axis)) / 2
        rows = np.moveaxis(change, axis, 0)
        if rows.shape[0] == 0:
            continue
        ends = [rows[0], *(np.maximum(a, b) for a, b in pairwise(rows)), rows[-1]]
        reach += np.moveaxis(np.stack(ends), 0, axis)
    return reach
