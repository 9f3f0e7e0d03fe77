"""Many different true devices, each with a force that moves it enough: the calibration test bed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import (
    Faults,
    ForceSignal,
    Recording,
    Rig,
    fit_to_limits,
    multisine,
    simulate,
)

FloatArray = NDArray[np.float64]

#: True devices are drawn between these, evenly on a logarithmic scale.
_MASS = (0.05, 20.0)  # kg
_TIME_CONSTANT = (0.05, 5.0)  # m/b, s
_TRAVEL = (0.02, 0.2)  # half range, m
_ACCELERATION = (5.0, 30.0)  # peak force over mass, m/s²
_RESOLUTION = (1e-6, 5e-5)  # m
#: And from these, each equally likely.
_SAMPLE_TIMES = (0.0005, 0.001, 0.002)  # s
_DELAYS = (0, 1, 2)  # samples
#: An encoder is no coarser than this part of the half range the device is moved through.
_COARSEST = 1 / 1000
#: Half of the devices have Coulomb friction, this part of their peak excitation.
_FRICTION = (0.01, 0.05)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """A batch of random devices and what to play on them.

    Attributes:
        rig: the truth, ``rig.batch`` devices; sample times differ, numbers of samples do not.
        excitation: force, shape (batch, n), and start, shape (batch,).
    """

    rig: Rig
    excitation: ForceSignal

    def logs(self, *, faults: Faults | None = None, seed: int = 0) -> Recording:
        """One open-loop log of n samples for each device."""
        return simulate(
            self.rig,
            self.excitation.force,
            faults=faults,
            seed=seed,
            position=self.excitation.start,
        )


def random_devices(count: int, seed: int, *, samples: int = 20_000) -> Fleet:
    """A fleet of ``count`` linear devices, each excited up to its travel or its peak force.

    Mass 0.05 to 20 kg and time constant m/b 0.05 to 5 s, both log-uniform; sample time 0.5, 1 or
    2 ms; delay 0, 1 or 2 samples; encoder 1e-6 to 5e-5 m, at most a thousandth of the half range
    moved;
    Coulomb friction in half of them, 1 to 5 % of the peak force played.

    Args:
        count: number of devices.
        seed: of the draw; the fleet depends on count, seed and samples only.
        samples: length of every log, n.
    """
    generator = np.random.default_rng(seed)

    def drawn(bounds: tuple[float, float]) -> FloatArray:
        low, high = bounds
        return low * (high / low) ** generator.random(count)

    mass, time_constant, travel = drawn(_MASS), drawn(_TIME_CONSTANT), drawn(_TRAVEL)
    sample_time = generator.choice(_SAMPLE_TIMES, count)
    smooth = Rig(
        mass=mass,
        damping=mass / time_constant,
        sample_time=sample_time,
        delay=generator.choice(_DELAYS, count) * sample_time,
        force_limit=mass * drawn(_ACCELERATION),
        name="random device",
    )
    shape = multisine(smooth, samples)
    ideal = fit_to_limits(smooth, shape, travel=travel, force=np.inf)
    played = np.max(np.abs(ideal.force), axis=1)
    rubbing = replace(
        smooth,
        coulomb_friction=np.where(generator.random(count) < 0.5, drawn(_FRICTION), 0.0) * played,
    )
    excitation = fit_to_limits(rubbing, shape, travel=travel, force=played)
    resolution = np.minimum(drawn(_RESOLUTION), _COARSEST * excitation.reach)
    return Fleet(rig=replace(rubbing, encoder_resolution=resolution), excitation=excitation)
