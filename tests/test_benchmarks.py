"""What the benchmarks compare with is fair, and their long logs are what the simulator gives."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchmarks.long_log import DAMPING, DELAY, MASS, long_log
from benchmarks.other_methods import OTHERS, arriving
from benchmarks.servo_peers import multiple_shooting, one_filter, output_error, srivc
from benchmarks.servo_section import Method, servo_family
from benchmarks.situations import DELAY as LATE
from benchmarks.situations import SITUATIONS, TRUTH, bound_of, logs_of
from datasets_synthetic import Rig, multisine, simulate
from identification import Trajectory
from identification.estimators.estimate import Model
from tests.estimates import estimate_by
from tests.thinned import thinned


@pytest.mark.parametrize(
    ("name", "friction", "tolerance"),
    [
        # A plain script takes the held force where the sample is, half a sample early.
        ("finite differences", 0.0, 0.08),
        ("finite differences", 0.8, 0.08),
        ("ARX", 0.0, 1e-5),
        # The sign of the velocity changes inside a step.
        ("ARX", 0.8, 0.03),
        ("pysindy", 0.0, 1e-3),
        # ... and a smoothed velocity changes its sign elsewhere.
        ("pysindy", 0.8, 0.06),
    ],
)
def test_without_noise_every_method_finds_the_truth(
    name: str, friction: float, tolerance: float
) -> None:
    """So what the table shows is noise, not a mistake in what is compared with."""
    rig = Rig(
        mass=MASS,
        damping=DAMPING,
        delay=DELAY,
        sample_time=1e-3,
        coulomb_friction=friction,
        force_offset=0.1,
    )
    log = simulate(rig, 14 * multisine(rig, 4000) + 0.1).trajectory()
    found = OTHERS[name](log, Model(coulomb=friction > 0, offset=True), DELAY)
    np.testing.assert_allclose(found, [MASS, DAMPING], rtol=tolerance)


@pytest.mark.long
@pytest.mark.parametrize("uneven", thinned([True, False], 1))
def test_a_long_log_is_what_the_simulator_gives(uneven: bool) -> None:
    log = long_log(12_000, uneven=uneven)
    assert len(log) == 12_000
    steps = np.diff(log.time)
    assert bool(np.ptp(steps) > 1e-4) is uneven
    np.testing.assert_allclose(log.force[5_000:10_000], log.force[:5_000])
    # One period on, the device has moved as before, to the noise of two readings of 5 um.
    again = log.position[5_000:10_000] - log.position[:5_000]
    assert np.std(again) == pytest.approx(5e-6 * np.sqrt(2), rel=0.05)
    found = estimate_by("least-squares", log, Model(), DELAY)
    assert found.value("mass") == pytest.approx(MASS, rel=2e-3)
    assert found.value("damping") == pytest.approx(DAMPING, rel=2e-2)


def test_a_delayed_force_does_not_come_round() -> None:
    """A force moved by whole samples: the first rows repeat the first value, none comes round."""
    rows = np.arange(300.0)
    log = Trajectory(time=rows * 1e-3, force=rows + 5, position=np.sin(rows / 9))
    np.testing.assert_array_equal(arriving(log, 2e-3)[:4], [5, 5, 5, 6])
    assert arriving(log, 2e-3)[-1] == 302


@pytest.mark.parametrize("peer", [output_error, srivc, multiple_shooting])
def test_peers_on_a_servo_agree_with_each_other_and_with_the_truth(peer: Method) -> None:
    """Three fits of the simulated position, of nothing in common, to a hundredth of the error."""
    family = servo_family(1_000)
    log = family.logs([0])[0]
    found = peer(log, family.truth["delay"])
    np.testing.assert_allclose(found, [family.truth["mass"], family.truth["damping"]], rtol=5e-3)
    np.testing.assert_allclose(found, output_error(log, family.truth["delay"]), rtol=2e-5)


def test_one_filter_on_both_sides_finds_the_truth_roughly() -> None:
    family = servo_family(4_000)
    found = one_filter(family.logs([0])[0], family.truth["delay"], 10.0)
    np.testing.assert_allclose(found, [family.truth["mass"], family.truth["damping"]], rtol=1e-2)


@pytest.mark.skipif(sys.platform != "linux", reason="a process is copied and its time limited")
def test_a_method_is_ended_after_its_time_and_keeps_its_answers() -> None:
    from benchmarks.limited import answers

    def count(turns: int) -> int:
        return sum(range(turns))

    found = answers(count, [10, 10**10], budget=0.5, least=2, longest=1.0)
    assert found.values == (45,)
    assert answers(count, [10**10], budget=0.5, longest=1.0).trouble == "did not finish in 1 s"
    assert "TypeError" in answers(len, [3], budget=0.5).trouble


@pytest.mark.long
@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda each: each.name)
def test_an_efficient_method_reaches_the_bound_of_the_benchmark(situation: object) -> None:
    """Output error under white noise of readings; the innovations fit under forces."""
    assert situation in SITUATIONS
    chosen = SITUATIONS[SITUATIONS.index(situation)]  # type: ignore[arg-type]
    logs = logs_of(chosen, 5_000, range(60))
    bound = bound_of(chosen, logs[0])
    method = "innovations" if chosen.push else "output-error"
    found = [estimate_by(method, log, Model(coulomb=False), LATE).values[:2] for log in logs]
    ratios = np.sqrt(np.mean((np.array(found) - TRUTH) ** 2, axis=0)) / bound
    # 60 seeds leave each ratio open by 9 %, thrice; exact rounding tells more than white noise.
    least = 0.5 if chosen.count else 0.73
    assert np.all(ratios > least)
    assert np.all(ratios < 1.27)
