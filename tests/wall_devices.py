"""Random devices with what is played on them, as axes to play and as loops to judge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.wall_axis import Axis
from tests.wall_play import Law
from tune.loop.loop import Filters, Loop
from tune.loop.plant import HandNumbers, ModeNumbers

#: What a moment is made of: spring, damper, mass that are switched, and a mass that is not.
MOMENTS = ("spring", "spring and damper", "damper", "all three", "spring beside a mass")


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One device and one moment on it, at gain 1.

    Attributes:
        axis: of scalars.
        law: of scalars, nothing one-sided or clamped.
        kind: of `MOMENTS`.
        filters: those of the law.
    """

    axis: Axis
    law: Law
    kind: str
    filters: Filters

    def loop(self) -> Loop:
        """The loop, shape (1,), by the code under test."""
        axis = self.axis
        mode, hand = (), None
        if axis.at_encoder or axis.at_handle:
            mode = (
                ModeNumbers(
                    frequency_hz=axis.mode_hz,
                    damping_ratio=axis.mode_damping,
                    at_encoder=axis.at_encoder,
                    at_handle=axis.at_handle,
                ),
            )
        if axis.hand_mass or axis.hand_damping or axis.hand_stiffness:
            hand = HandNumbers(
                mass=axis.hand_mass, damping=axis.hand_damping, stiffness=axis.hand_stiffness
            )
        return Loop.from_numbers(
            mass=np.array([axis.mass]),
            damping=np.array([axis.damping]),
            sample_time=np.array([axis.sample_time]),
            delay_samples=np.array([axis.delay_samples]),
            filters=self.filters,
            modes=mode,
            hand=hand,
            current_lag=axis.lag,
            position_stiffness=axis.stiffness,
        )


def draw_moment(generator: np.random.Generator, kind: str) -> Moment:
    """A device of 20 g to 20 kg at 0.25 to 2 ms with up to three samples of delay, and a moment.

    Three in ten have a lag, four a mode, three a hand, two a spring of their own.
    """

    def power(low: float, high: float) -> float:
        return float(10 ** generator.uniform(low, high))

    def chance(part: float) -> bool:
        return bool(generator.random() < part)

    T = float(generator.choice([2.5e-4, 5e-4, 1e-3, 2e-3]))
    m = power(-1.7, 1.3)
    b = power(-4.0, 0.0) * m / T
    delay = float(generator.integers(4)) if chance(0.5) else float(generator.uniform(0, 3))
    moves, held = chance(0.4), chance(0.3)
    axis = Axis(
        mass=m,
        damping=b,
        sample_time=T,
        delay_samples=delay,
        stiffness=power(-6, -2) * m / T**2 if chance(0.2) else 0.0,
        lag=T * power(-1, 0.7) if chance(0.3) else 0.0,
        mode_hz=power(-2, -0.4) / T,
        mode_damping=power(-2.5, -0.5),
        at_encoder=float(generator.uniform(-1, 1)) if moves else 0.0,
        at_handle=float(generator.uniform(-1, 1)) if moves else 0.0,
        hand_mass=m * power(-2, 0) if held else 0.0,
        hand_damping=b * power(-1, 1) if held else 0.0,
        hand_stiffness=power(-6, -2) * m / T**2 if held else 0.0,
    )
    slow, slower = (power(-2.5, -0.5) / T if chance(0.7) else None for _ in range(2))
    K = 0.0 if kind == "damper" else b / T
    law = Law(
        stiffness=K,
        damping=(b if not K else K * T * power(-1, 2.5))
        if kind in {"spring and damper", "damper", "all three"}
        else 0.0,
        mass=m * power(-2, 0) if kind == "all three" else 0.0,
        steady_mass=m * power(-1.5, 0) if kind == "spring beside a mass" else 0.0,
        velocity_pole=0.0 if slow is None else float(np.exp(-2 * np.pi * slow * T)),
        acceleration_pole=0.0 if slower is None else float(np.exp(-2 * np.pi * slower * T)),
    )
    filters = Filters(velocity_filter_hz=slow, acceleration_filter_hz=slower)
    return Moment(axis=axis, law=law, kind=kind, filters=filters)
