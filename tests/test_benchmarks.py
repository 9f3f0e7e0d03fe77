"""What the benchmarks compare with is fair, and their long logs are what the simulator gives."""

import numpy as np
import pytest

from benchmarks.long_log import DAMPING, DELAY, MASS
from benchmarks.other_methods import OTHERS
from benchmarks.servo_peers import multiple_shooting, output_error, srivc
from benchmarks.servo_section import Method, servo_family
from datasets_synthetic import Rig, multisine, simulate
from identification.estimators.estimate import Model


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


@pytest.mark.parametrize("peer", [output_error, srivc, multiple_shooting])
def test_peers_on_a_servo_agree_with_each_other_and_with_the_truth(peer: Method) -> None:
    """Three fits of the simulated position, of nothing in common, to a hundredth of the error."""
    family = servo_family(1_000)
    log = family.logs([0])[0]
    found = peer(log, family.truth["delay"])
    np.testing.assert_allclose(found, [family.truth["mass"], family.truth["damping"]], rtol=5e-3)
    np.testing.assert_allclose(found, output_error(log, family.truth["delay"]), rtol=2e-5)
