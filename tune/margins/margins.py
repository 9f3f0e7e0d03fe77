"""LoopMargins: all the margins of one device with its effects, as an audit reports them."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from identification import Device
from tune.documents.effects import Effects
from tune.documents.scene import Hand
from tune.loop.filters import Filters, used_filters
from tune.loop.loop import Loop
from tune.loop.sampled_plant import LONGEST_DELAY
from tune.margins.damping import least_damping_ratio, slowest_decay
from tune.margins.delay import DelayMargin, delay_margin
from tune.margins.passivity import Passivity, passivity
from tune.margins.response import DiskMargin, disk_margin, phase_margin
from tune.stability.verdict import is_stable, safe_gain


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
