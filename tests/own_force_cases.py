"""Random devices with a force of their own that depends on position, and the truth about them.

The truth is `tests.sampled_bench`: all states of one sample of the loop in a matrix, mechanism by
scipy's exponential, commands on their way and filters as difference equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from identification import Device, as_stored, parse_document
from tests.sampled_bench import SampledBench
from tune.documents.scene import FREE_TO_RIGID

Triple = tuple[float, float, float]

#: Gains looked at between nothing and the full one.
_GAINS = np.unique(np.concatenate([np.geomspace(1e-4, 1, 20), np.linspace(0.05, 1, 20)]))
_KINDS = ("spring", "spring", "spring", "spring", "none", "pushed", "either", "gravity")


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnForceCase:
    """One device, filters, and a direction in (K, B, M).

    Attributes:
        device: with intervals in every other case.
        kind: of its own force.
        velocity_filter_hz: None for no filter.
        acceleration_filter_hz: likewise.
        hand: whether a scene has a hand.
        ray: sizes about which stability ends, times ``part``.
        part: of the limit.
    """

    device: Device
    kind: str
    velocity_filter_hz: float | None
    acceleration_filter_hz: float | None
    hand: bool
    ray: Triple
    part: float

    @property
    def balanced(self) -> bool:
        """Whether nothing pushes the device away."""
        return self.kind in {"spring", "none"}

    def bench(self) -> SampledBench:
        """The device alone at its best estimate, force by position where the position is zero."""
        device = self.device
        own = 0.0 if device.position_stiffness is None else device.position_stiffness.value
        return SampledBench(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay=device.delay.value,
            current_lag=0.0 if device.current_lag is None else device.current_lag.value,
            modes=tuple(
                (m.frequency_hz.value, m.damping_ratio.value, m.at_encoder, m.at_handle)
                for m in device.modes
            ),
            own_stiffness=own if device.gravity is None else own + device.gravity.sine.value,
            velocity_filter_hz=self.velocity_filter_hz or np.inf,
            acceleration_filter_hz=self.acceleration_filter_hz or np.inf,
        )

    def corners(self) -> Iterator[SampledBench]:
        """The device alone at every corner of its box."""
        box = self.device.simultaneous_box()
        for mass, damping, own in product(
            *(dict.fromkeys(side) for side in (box.mass, box.damping, box.position_stiffness))
        ):
            yield replace(self.bench(), mass=mass, damping=damping, own_stiffness=own)

    def grasped(self) -> Iterator[SampledBench]:
        """The same in every corner of the hand's box, where there is a hand."""
        grip = FREE_TO_RIGID["linear"]
        sides = [(q.low, q.high) for q in (grip.mass, grip.damping, grip.stiffness)]
        for bench, hand in product(self.corners(), product(*sides) if self.hand else ()):
            yield replace(bench, hand=(hand[0], hand[1], hand[2]))

    def somewhere(self, chance: np.random.Generator, count: int) -> Iterator[SampledBench]:
        """Points within the box and up to one sample late, half of them in a hand if there is."""
        box = self.device.simultaneous_box()
        grip = FREE_TO_RIGID["linear"]
        for number in range(count):
            where = replace(
                self.bench(),
                mass=chance.uniform(*box.mass),
                damping=chance.uniform(*box.damping),
                own_stiffness=chance.uniform(*box.position_stiffness),
                delay=self.device.delay.value
                + chance.choice([0.0, 0.5, 1.0]) * self.device.sample_time.value,
            )
            if self.hand and number % 2:
                part = [chance.uniform(q.low, q.high) for q in (grip.mass, grip.damping)]
                stiff = float(chance.choice([grip.stiffness.low, grip.stiffness.high]))
                where = replace(where, hand=(part[0], part[1], stiff))
            yield where


def draw_case(seed: int) -> OwnForceCase:
    """A case by number."""
    chance = np.random.default_rng([20_261_122, seed])
    step = float(chance.choice([5e-4, 1e-3, 2e-3]))
    mass = float(10 ** chance.uniform(-1.5, 1))
    damping = mass * float(10 ** chance.uniform(-0.5, 1.5))
    kind = _KINDS[seed % len(_KINDS)]
    own = mass * float((2 * np.pi * 10 ** chance.uniform(-0.5, 1.2)) ** 2)
    wide = float(chance.choice([0.0, 0.01, 0.03]))

    def known(value: float, part: float = wide) -> dict[str, float]:
        reach = part * abs(value)
        return {"value": value, "low": value - reach, "high": value + reach}

    content: dict[str, Any] = {
        "motion": "linear",
        "sample_time": step,
        "mass": known(mass),
        "damping": known(damping),
        "delay": step * float(chance.choice([0.0, 1.0, 2.0, chance.uniform(0, 2)])),
        "encoder_resolution": 1e-9,
        "force_limit": {"continuous": 1e6, "peak": 1e6},
    }
    if chance.random() < 0.15:
        content["current_lag"] = 0.4 * step
    if chance.random() < 0.15:
        mode = {"frequency_hz": chance.uniform(60, 150), "damping_ratio": chance.uniform(0.02, 0.1)}
        content["modes"] = [mode | {"at_encoder": chance.uniform(-0.5, 0.5)}]
    if kind == "spring":
        content["position_stiffness"] = known(own)
    elif kind == "pushed":
        content["position_stiffness"] = known(-own)
    elif kind == "either":
        content["position_stiffness"] = {"value": 0.1 * own, "low": -0.3 * own, "high": 0.5 * own}
    elif kind == "gravity":
        turn = chance.uniform(-np.pi, np.pi)
        content["gravity"] = {"sine": own * np.sin(turn), "cosine": own * np.cos(turn)}
    cutoffs = [float(chance.uniform(30, 90)), float(chance.uniform(20, 60))]
    filtered = chance.random() < 0.6
    present = chance.integers(0, 2, 3)
    present[chance.integers(0, 3)] = 1
    sizes = present * np.array([1.0, 0.05 * step, 0.05 * step**2]) * 10 ** chance.uniform(-1, 1, 3)
    case = OwnForceCase(
        device=as_stored(parse_document(Device, content, "device.yaml")),
        kind=kind,
        velocity_filter_hz=cutoffs[0] if filtered else None,
        acceleration_filter_hz=cutoffs[1] if filtered else None,
        hand=bool(chance.random() < 0.4),
        ray=(float(sizes[0]), float(sizes[1]), float(sizes[2])),
        part=float(chance.choice([0.1, 0.25, 0.45, 0.55, 0.9, 1.2])),
    )
    # Where the loop of a device whose own force pulls it back turns unstable.
    alike = replace(case.bench(), own_stiffness=abs(case.bench().own_stiffness))
    most = 10 * mass / step**2
    return replace(
        case, ray=scaled(case.ray, case.part * min(most, unstable_gain(alike, case.ray, most)))
    )


def scaled(sizes: Triple, gain: float) -> Triple:
    """All three times a gain."""
    return sizes[0] * gain, sizes[1] * gain, sizes[2] * gain


def unstable_gain(bench: SampledBench, sizes: Triple, most: float) -> float:
    """The least gain in (0, most] at which the loop is seen to be unstable, to 1e-9; else inf."""
    gains = _GAINS * most
    outside = bench.radii(sizes, gains) >= 1
    if not outside.any():
        return float("inf")
    first = int(np.argmax(outside))
    above, below = float(gains[first]), float(gains[first - 1]) if first else 0.0
    while above - below > 1e-9 * above:
        middle = np.array([(above + below) / 2])
        above, below = (
            (float(middle[0]), below)
            if bench.radii(sizes, middle)[0] >= 1
            else (above, float(middle[0]))
        )
    return above


def stable(bench: SampledBench, sizes: Triple, most: float) -> bool:
    """Whether every gain looked at in (0, most] is stable."""
    return bool(np.all(bench.radii(sizes, _GAINS * most) < 1))
