"""What identify makes of ten families of logs: the right method, and intervals that cover."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import LogFit, Method, Trajectory, identify
from tests.simulated.families import FAMILIES
from tests.thinned import thinned

Array = NDArray[np.float64]
NAMES = ("mass", "damping")

#: Forces that the log does not know ask for innovations, and gravity taken at a noisy position.
EXPECTED = dict.fromkeys(FAMILIES, "output-error") | {
    "closed-loop-force-noise": "innovations",
    "offset-gravity": "innovations",
}
#: Families of which one log costs seconds.
DEAREST = {"coulomb", "directional-friction"}


def fitted(name: str, trajectory: Trajectory, method: Method = "auto") -> LogFit:
    hardware = FAMILIES[name].hardware
    return identify(trajectory, hardware=hardware, method=method).logs[0]


def errors(name: str, fits: list[LogFit]) -> tuple[Array, Array]:
    """Errors of mass and damping, and their 95 % half-widths, shape (logs, 2) each."""
    truth = FAMILIES[name].truth
    found = np.array([[fit.estimate.value(key) - truth[key] for key in NAMES] for fit in fits])
    half = np.array([[1.96 * fit.estimate.deviation(key) for key in NAMES] for fit in fits])
    return found, half


@pytest.mark.parametrize("name", thinned(sorted(FAMILIES, key=DEAREST.__contains__), 4))
def test_each_family_gets_its_method_its_terms_and_its_truth(name: str) -> None:
    fits = [fitted(name, log) for log in FAMILIES[name].logs(range(3))]
    method, _ = Counter(fit.method for fit in fits).most_common(1)[0]
    assert method == EXPECTED[name]
    error, half = errors(name, fits)
    # 2.2 half-widths of a 95 % interval: once in 100 000 for each of sixty numbers.
    assert np.all(np.abs(error) <= 2.2 * half)
    assert np.all(half <= 0.1 * np.array([FAMILIES[name].truth[key] for key in NAMES]))
    for fit in fits:
        model = fit.estimate.model
        assert model.directional == (name == "directional-friction")
        assert model.gravity == ("pendulum" if name == "offset-gravity" else "none")


@pytest.mark.parametrize("name", thinned(["coulomb", "directional-friction"], 1))
def test_turns_are_exact_where_nothing_is_noisy(name: str) -> None:
    family = FAMILIES[name]
    rig = replace(family.rig, encoder_resolution=0.0)
    exact = replace(family, rig=rig, faults=replace(family.faults, position_noise=0.0))
    error, _ = errors(name, [fitted(name, exact.logs([3])[0], "output-error")])
    assert np.all(np.abs(error) < 1e-5)


@pytest.mark.parametrize("seed", thinned([5032, 5175, 7006, 7277], 1))
def test_a_start_at_rest_does_not_lead_astray(seed: int) -> None:
    """Logs whose search once ran off with the velocity of a device that stands at the start."""
    fit = fitted("directional-friction", FAMILIES["directional-friction"].logs([seed])[0])
    assert fit.method == "output-error"
    assert not fit.estimate.notes
    error, half = errors("directional-friction", [fit])
    assert np.all(np.abs(error) <= 2.2 * half)


@pytest.mark.parametrize("seed", thinned([49, 23, 58, 81, 195, 199], 1))
def test_a_tremor_that_hides_in_its_octave_is_whitened(seed: int) -> None:
    """Logs whose tremor stays below chance in its octave, and empties those beside it."""
    name = "closed-loop-force-noise"
    fit = fitted(name, FAMILIES[name].logs(range(seed, seed + 1))[0])
    assert fit.method == "innovations"
    error, half = errors(name, [fit])
    assert np.all(np.abs(error) <= 2.2 * half)
    assert half[0, 1] <= 0.04 * FAMILIES[name].truth["damping"]


@pytest.mark.parametrize("noise", thinned([0.0, 1e-4, 1e-6], 1))
def test_gravity_is_found_however_clean_the_log(noise: float) -> None:
    family = FAMILIES["offset-gravity"]
    rig = replace(family.rig, encoder_resolution=0.0)
    clean = replace(family, rig=rig, faults=replace(family.faults, position_noise=noise))
    device = identify(clean.logs([0])[0]).device
    assert device.mass.value == pytest.approx(family.truth["mass"], rel=1e-2)
    assert device.gravity is not None


def test_friction_by_direction_reaches_the_device() -> None:
    family = FAMILIES["directional-friction"]
    device = identify(family.logs([7])[0]).device
    truth = family.truth
    damping, friction = device.damping_by_direction, device.friction_by_direction
    assert damping is not None
    assert friction is not None
    for side, found in ((1.0, damping.forward), (-1.0, damping.backward)):
        assert found.value == pytest.approx(
            truth["damping"] + side * truth["damping_asymmetry"], rel=0.01
        )
    # The offset of the truth is part of what friction differs by.
    for side, found in ((1.0, friction.forward), (-1.0, friction.backward)):
        asymmetry = side * truth["force_offset"]
        assert found.value == pytest.approx(truth["coulomb_friction"] + asymmetry, rel=0.03)
