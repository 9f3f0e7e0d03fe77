"""Random devices, hands and settings, each setting at a known part of its safe gain."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.certificate.poles import judge
from tune.certificate.region import ModeRegion, Region, Setting
from tune.certificate.worst_point import sampled_loops
from tune.certificate.zero_exclusion import Claim
from tune.documents.profile import HandBox

#: Samples of delay on top of the device's that every box is to stand.
EXTRA = 1.0
#: Gains between which a setting's limit is looked for.
_GAINS = np.geomspace(1e-3, 1e3, 61)
#: Bisections of the limit, to a part in 10⁹; roots of polynomials in z are not better.
_HALVINGS = 28
#: The limit found in doubles less this part has to hold in many digits.
_CLOSE = 2e-6
_MOST_CORNERS = 64


def around(value: float, spread: float) -> tuple[float, float]:
    return value * (1 - spread), value * (1 + spread)


def draw(seed: int, spread: float, *, with_everything: bool) -> tuple[Region, Setting]:
    """A device of 0.05 to 95 kg at 0.2 to 2 ms and a mix of effects; T is known to 1 %."""
    rng = np.random.default_rng([seed, 7])
    mass = 10 ** rng.uniform(np.log10(0.05), np.log10(95))
    step = 10 ** rng.uniform(np.log10(2e-4), np.log10(2e-3))
    damping = mass * 10 ** rng.uniform(-1, 1.5)
    samples = int(rng.integers(0, 3))
    kinds = rng.random(3) < 0.7
    if not kinds.any():
        kinds[rng.integers(0, 3)] = True
    sign = -1 if rng.random() < 0.15 else 1

    def cutoff() -> float | None:
        if rng.random() < 0.3:
            return None
        return float(10 ** rng.uniform(np.log10(20), np.log10(0.3 / step)))

    window = int(rng.integers(2, 16)) if rng.random() < 0.15 else None
    setting = Setting(
        stiffness=float(kinds[0] * 10 ** rng.uniform(-1, 0) * damping / step),
        damping=float(kinds[1] * 10 ** rng.uniform(-1, 1.5) * damping),
        mass=float(kinds[2] * sign * 10 ** rng.uniform(-1.5, 0) * mass * (0.5 if sign < 0 else 1)),
        velocity_filter_hz=None if window else cutoff(),
        acceleration_filter_hz=cutoff(),
        velocity_filter_order=int(rng.integers(1, 3)),
        acceleration_filter_order=int(rng.integers(1, 3)),
        filter_damping_ratio=float(rng.choice([1.0, 0.7071])),
        velocity_window_samples=window,
    )
    modes: tuple[ModeRegion, ...] = ()
    hand = None
    delay = (samples * step, samples * step)
    if with_everything:
        delay = (samples * step, (samples + rng.uniform(0, 0.5)) * step)
        modes = (
            ModeRegion(
                frequency_hz=around(10 ** rng.uniform(1.3, 2.5), 0.05),
                damping_ratio=around(10 ** rng.uniform(-2, -1), 0.2),
                at_encoder=float(rng.uniform(-0.7, 0.7)),
                at_handle=float(rng.uniform(-0.7, 0.7)),
            ),
        )
        hand = HandBox(mass=(0.02, 0.5), damping=(2.0, 20.0), stiffness=(50.0, 1500.0))
    region = Region(
        mass=around(mass, spread),
        damping=around(damping, spread),
        sample_time=around(step, 0.01),
        delay=delay,
        modes=modes,
        hand=hand,
    )
    return region, setting


def safe_gain(region: Region, setting: Setting, extra: float = EXTRA) -> float:
    """A gain at which every corner is stable, in many digits, near the largest; 0 if none is."""
    sides = (*region.sides(), (0.0, extra))
    free = [index for index, (low, high) in enumerate(sides) if high > low]
    corners = list(product((0, 1), repeat=len(free)))
    if len(corners) > _MOST_CORNERS:
        chosen = np.random.default_rng(0).choice(len(corners), _MOST_CORNERS, replace=False)
        corners = [corners[index] for index in chosen]
    values = np.repeat(np.mean(sides, axis=1)[:, None], len(corners), axis=1)
    for column, corner in enumerate(corners):
        for index, end in zip(free, corner, strict=True):
            values[index, column] = sides[index][end]
    points = [region.point(column[:-1], float(column[-1])) for column in values.T]
    loops = sampled_loops(region, [setting], values[:-1], values[-1])

    def stable(gain: float) -> bool:
        return all(judge(point, setting, gain).answer == "stable" for point in points)

    def stable_in_doubles(gain: float) -> bool:
        return not np.any(loops.radius(gain) > 1 + 1e-12)

    # Doubles come near to the limit at full gain; many digits settle it, and look below it too.
    index = next((i for i, g in enumerate(_GAINS) if not stable_in_doubles(float(g))), None)
    if index is None:
        return float(_GAINS[-1]) if stable(float(_GAINS[-1])) else 0.0
    low, high = float(_GAINS[max(index - 1, 0)]), float(_GAINS[index])
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable_in_doubles(middle) else (low, middle)
    for slack in (_CLOSE, 1e-4, 0.03, 0.3, 0.9):
        if stable(low * (1 - slack)):
            return low * (1 - slack)
    return 0.0


def unstable_samples(
    region: Region, setting: Setting, claim: Claim, count: int, rng: np.random.Generator
) -> int:
    """How many of so many samples of the box are unstable, half of them on edges and faces."""
    low, high = np.array((*region.sides(), (0.0, claim.extra))).T[:, :, None]
    parts = rng.random((len(low), count))
    parts[:, ::2] = np.clip(np.round(3 * parts[:, ::2] - 1, 1), 0, 1)
    bad = 0
    for chunk in np.array_split(np.arange(count), max(1, count // 1000)):
        values: NDArray[np.float64] = low * (1 - parts[:, chunk]) + high * parts[:, chunk]
        loops = sampled_loops(region, [setting], values[:-1], values[-1])
        for gain in (claim.gain, claim.gain * float(rng.uniform(0.05, 1))):
            for index in np.flatnonzero(loops.radius(gain) > 1 - 1e-9)[:5]:
                point = region.point(values[:-1, index], float(values[-1, index]))
                bad += judge(point, setting, claim.gain).answer != "stable"
    return bad
