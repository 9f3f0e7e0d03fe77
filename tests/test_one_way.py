"""Motion one way: what it tells and what it cannot."""

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import Finding, Trajectory
from identification.estimators.motion import distinguishable_terms
from tests.exact_axis import Axis, counted, positions
from tests.findings import findings_of

Array = NDArray[np.float64]
STEP = 1e-3


def one_way_of(trajectory: Trajectory) -> Finding:
    """The one finding about motion one way, among others; none calls it a hand."""
    findings, _ = findings_of(trajectory)
    assert "hand-on-device" not in {each.code for each in findings}, trajectory.source
    told = [each for each in findings if " only" in each.seen]
    assert [each.code for each in told] == ["not-exciting-damping"], trajectory.source
    assert "Move both ways" in told[0].remedy
    return told[0]


def pushed(tremor: float, wander: float, samples: int = 8000) -> Trajectory:
    """Steps of force one way, and what a hand adds to them: at 10 Hz and below half a hertz, N."""
    generator = np.random.default_rng(4)
    force = np.repeat(generator.choice([3.0, 4.0, 6.0], samples // 400), 400)
    time: Array = STEP * np.arange(samples, dtype=np.float64)
    phase = np.cumsum(generator.normal(10, 3, samples)) * STEP
    push = tremor * np.sqrt(2) * np.sin(2 * np.pi * phase)
    push += wander * np.sqrt(2) * np.sin(2 * np.pi * 0.37 * time)
    push += 5e-3 * generator.standard_normal(samples)
    axis = Axis(coulomb=0.8, delay=STEP)
    place = positions(axis, force[:, None], disturbance=push[:, None], speed=0.3)[:, 0]
    return Trajectory(time=time, force=force, position=counted(place, 6e-6))


@pytest.mark.parametrize(
    ("tremor", "wander", "severity", "told"),
    [
        (0.0, 0.0, "warning", "the mass is told"),
        pytest.param(0.3, 0.0, "warning", "or a hand", marks=pytest.mark.long),
        (0.0, 2.0, "refusal", "or a hand"),
    ],
)
def test_what_pushes_unlogged_one_way_is_said_and_refused_where_it_is_much(
    tremor: float, wander: float, severity: str, told: str
) -> None:
    """Of a force of 4.5 N rms; a hand may be on the device, but nothing shows that it is one."""
    found = one_way_of(pushed(tremor, wander))
    assert found.severity == severity, found.seen
    assert told in found.seen
    assert ("with nothing else on the device" in found.remedy) == (severity == "refusal")


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_noise_of_the_readings_is_no_motion_the_other_way(sense: float) -> None:
    """At 5 mm/s a step is 5 µm; readings that are noisier than that step back as often."""
    time: Array = STEP * np.arange(6000, dtype=np.float64)
    generator = np.random.default_rng(1)
    place = sense * 5e-3 * time + 2e-5 * generator.standard_normal(time.size)
    assert np.mean(np.diff(place) * sense < 0) > 0.3
    force = np.sin(2 * np.pi * 0.7 * time)
    assert not distinguishable_terms(Trajectory(time=time, force=force, position=place)).coulomb
    turning = place + 0.02 * np.sin(2 * np.pi * 0.3 * time)
    assert distinguishable_terms(Trajectory(time=time, force=force, position=turning)).coulomb
