"""Named scenarios: device, excitation, faults and seed that together make one log.

One file: the list of scenarios and what runs one of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from datasets_synthetic.controller import Controller
from datasets_synthetic.devices import named_rig
from datasets_synthetic.excitation import Excitation, fit_to_limits, multisine
from datasets_synthetic.faults import Faults
from datasets_synthetic.recording import Recording
from datasets_synthetic.rig import Rig
from datasets_synthetic.simulation import simulate
from identification import InvalidInputError, Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Everything a simulated log depends on.

    Attributes:
        name: as in ``haptune simulate NAME``.
        description: one sentence for a list of scenarios.
        device: a named device.
        duration: s.
        travel: half the range of positions the excitation may use, m (rad).
        force: largest |force| the excitation may use, N (N·m); 0 plays no force.
        force_step: resolution of the played force, N (N·m); what is logged is what is played.
        coulomb_friction: N (N·m), or None for the device's own.
        faults: noise, its fields plain numbers.
        controller: virtual effects in closed loop, or None.
        velocity: at t = 0, m/s (rad/s).
        seed: of the noise, unless another is asked for.
    """

    name: str
    description: str
    device: str
    duration: float
    travel: float
    force: float
    force_step: float = 0.001
    coulomb_friction: float | None = None
    faults: Faults = field(default_factory=Faults)
    controller: Controller | None = None
    velocity: float = 0.0
    seed: int = 0

    def rig(self) -> Rig:
        """The true device, one member."""
        rig = named_rig(self.device)
        if self.coulomb_friction is None:
            return rig
        return replace(rig, coulomb_friction=self.coulomb_friction)

    def excitation(self) -> Excitation:
        """The force played (the same for every seed), shape (1, n), and where it starts."""
        return _excitation(self)


def scenario_named(name: str) -> Scenario:
    """The scenario of that name. Raises InvalidInputError with the names there are."""
    if name not in SCENARIOS:
        known = ", ".join(SCENARIOS)
        raise InvalidInputError(name, "is not a scenario", f"Scenarios: {known}")
    return SCENARIOS[name]


def run(scenario: str | Scenario, *, seed: int | None = None) -> Trajectory:
    """The log of one scenario, a Trajectory of round(duration/T) samples.

    Args:
        scenario: a name in SCENARIOS or a Scenario.
        seed: of the noise; None means the scenario's own.

    Raises:
        InvalidInputError: no such scenario.
    """
    chosen = scenario_named(scenario) if isinstance(scenario, str) else scenario
    return run_batch(chosen, (chosen.seed if seed is None else seed,)).trajectory()


def run_batch(scenario: str | Scenario, seeds: Sequence[int]) -> Recording:
    """One log for each seed, in one simulation; member j is ``run(scenario, seed=seeds[j])``.

    Raises:
        InvalidInputError: no such scenario.
    """
    chosen = scenario_named(scenario) if isinstance(scenario, str) else scenario
    excitation = chosen.excitation()
    recording = simulate(
        chosen.rig(),
        excitation.force,
        controller=chosen.controller,
        faults=chosen.faults,
        seed=seeds,
        position=excitation.start,
        velocity=chosen.velocity,
    )
    return replace(recording, source=f"simulated {chosen.name}")


@lru_cache(maxsize=32)
def _excitation(scenario: Scenario) -> Excitation:
    rig = scenario.rig()
    samples = round(scenario.duration / float(rig.sample_time[0]))
    if scenario.force == 0:
        return Excitation(force=np.zeros((1, samples)), start=np.zeros(1), reach=np.zeros(1))
    found = fit_to_limits(
        rig, multisine(rig, samples), travel=scenario.travel, force=scenario.force
    )
    step = scenario.force_step
    return replace(found, force=np.rint(found.force / step) * step)


_ALL = (
    Scenario(
        name="homerehab",
        description="The bundled log: HomeRehab for 8 s with friction, encoder, delay and noise.",
        device="homerehab",
        duration=8.0,
        travel=0.05,
        force=14.0,
        faults=Faults(force_noise=0.005),
        seed=1,
    ),
    Scenario(
        name="homerehab-clean",
        description="HomeRehab for 20 s within 50 mm and 14 N; encoder with a third of a count "
        "of noise, delay, no friction.",
        device="homerehab",
        duration=20.0,
        travel=0.05,
        force=14.0,
        coulomb_friction=0.0,
        faults=Faults(position_noise=2e-6),
    ),
    Scenario(
        name="homerehab-friction",
        description="The same with 0.8 N of Coulomb friction and 5 mN rms of unlogged force.",
        device="homerehab",
        duration=20.0,
        travel=0.05,
        force=14.0,
        coulomb_friction=0.8,
        faults=Faults(force_noise=0.005),
        seed=2,
    ),
    Scenario(
        name="homerehab-wall",
        description="Closed loop: HomeRehab starts at 0.3 m/s in a soft spring and damper.",
        device="homerehab",
        duration=2.0,
        travel=0.05,
        force=0.0,
        faults=Faults(force_noise=0.005),
        controller=Controller(stiffness=500.0, damping=5.0, velocity_filter_hz=50.0),
        velocity=0.3,
        seed=3,
    ),
    Scenario(
        name="emps-open-loop",
        description="The EMPS carriage for 20 s in open loop, its friction and offset included.",
        device="emps",
        duration=20.0,
        travel=0.12,
        force=200.0,
        force_step=0.01,
        faults=Faults(force_noise=0.5),
        seed=4,
    ),
    Scenario(
        name="stylus",
        description="An illustrative light desktop stylus for 15 s within 40 mm and 0.9 N.",
        device="stylus",
        duration=15.0,
        travel=0.04,
        force=0.9,
        force_step=0.0001,
        faults=Faults(force_noise=0.0005),
        seed=5,
    ),
    Scenario(
        name="knob",
        description="An illustrative rotary knob for 15 s within 1.5 rad and 0.05 N·m.",
        device="knob",
        duration=15.0,
        travel=1.5,
        force=0.05,
        force_step=0.00001,
        faults=Faults(force_noise=0.00002),
        seed=6,
    ),
)

#: Every named scenario, in the order to show them.
SCENARIOS: Mapping[str, Scenario] = MappingProxyType({each.name: each for each in _ALL})
