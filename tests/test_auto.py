"""What identify makes of ten families of logs: the right method, and intervals that cover."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from joblib import Parallel, delayed
from numpy.typing import NDArray

from identification import Trajectory, identify
from identification.estimators.estimate import quantile
from identification.fitting import LogFit, fit_log
from tests.simulated.families import FAMILIES, POSE_FACTORS, family_named, poses
from tests.thinned import thinned

Array = NDArray[np.float64]
NAMES = ("mass", "damping")

#: Forces that the log does not know ask for innovations, and gravity taken at a noisy position.
EXPECTED = dict.fromkeys(FAMILIES, "output-error") | {
    "closed-loop-force-noise": "innovations",
    "offset-gravity": "innovations",
}
#: Intervals that hold more than 97 %: where there is no friction, the doubt of it stays in the
#: damping (test_no_tighter_interval_would_hold).
WIDE = {(name, "damping") for name in FAMILIES} - {
    ("coulomb", "damping"),
    ("directional-friction", "damping"),
}
#: Families of which one log costs seconds.
DEAREST = {"coulomb", "directional-friction"}
#: Methods a family is compared with; least squares and instruments are never near in white noise.
RIVALS = ("output-error", "innovations", "instruments", "least-squares")


def fitted(name: str, trajectory: Trajectory, method: str = "auto") -> LogFit:
    return fit_log(trajectory, family_named(name).hardware, method)


def at_once(jobs: Iterable[Any]) -> list[Any]:
    """Results of joblib's delayed calls, on all processors."""
    results: Any = Parallel(n_jobs=os.cpu_count())(jobs)
    return list(results)


def errors(name: str, fits: list[LogFit]) -> tuple[Array, Array]:
    """Errors of mass and damping, and their 95 % half-widths, shape (logs, 2) each."""
    truth = family_named(name).truth
    found = np.array([[fit.estimate.value(key) - truth[key] for key in NAMES] for fit in fits])
    half = np.array(
        [[quantile(fit.estimate) * fit.estimate.deviation(key) for key in NAMES] for fit in fits]
    )
    return found, half


@pytest.mark.parametrize("name", thinned(sorted(FAMILIES, key=DEAREST.__contains__), 4))
def test_each_family_gets_its_method_its_terms_and_its_truth(name: str) -> None:
    fits = [fitted(name, log) for log in family_named(name).logs(range(3))]
    method, _ = Counter(fit.method for fit in fits).most_common(1)[0]
    assert method == EXPECTED[name]
    error, half = errors(name, fits)
    # 2.2 half-widths of a 95 % interval: once in 100 000 for each of sixty numbers.
    assert np.all(np.abs(error) <= 2.2 * half)
    assert np.all(half <= 0.1 * np.array([family_named(name).truth[key] for key in NAMES]))
    for fit in fits:
        model = fit.estimate.model
        assert model.directional == (name == "directional-friction")
        assert model.gravity == ("pendulum" if name == "offset-gravity" else "none")


@pytest.mark.parametrize("name", thinned(["coulomb", "directional-friction"], 1))
def test_turns_are_exact_where_nothing_is_noisy(name: str) -> None:
    family = family_named(name)
    rig = replace(family.rig, encoder_resolution=0.0)
    exact = replace(family, rig=rig, faults=replace(family.faults, position_noise=0.0))
    error, _ = errors(name, [fitted(name, exact.logs([3])[0], "output-error")])
    assert np.all(np.abs(error) < 1e-5)


@pytest.mark.parametrize("seed", thinned([5032, 5175, 7006, 7277], 1))
def test_a_start_at_rest_does_not_lead_astray(seed: int) -> None:
    """Logs whose search once ran off with the velocity of a device that stands at the start."""
    fit = fitted("directional-friction", family_named("directional-friction").logs([seed])[0])
    assert fit.method == "output-error"
    assert not fit.estimate.notes
    error, half = errors("directional-friction", [fit])
    assert np.all(np.abs(error) <= 2.2 * half)


@pytest.mark.parametrize("seed", thinned([49, 23, 58, 81, 195, 199], 1))
def test_a_tremor_that_hides_in_its_octave_is_whitened(seed: int) -> None:
    """Logs whose tremor stays below chance in its octave, and empties those beside it."""
    name = "closed-loop-force-noise"
    fit = fitted(name, family_named(name).logs(range(seed, seed + 1))[0])
    assert fit.method == "innovations"
    error, half = errors(name, [fit])
    assert np.all(np.abs(error) <= 2.2 * half)
    assert half[0, 1] <= 0.04 * family_named(name).truth["damping"]


@pytest.mark.parametrize("noise", thinned([0.0, 1e-4, 1e-6], 1))
def test_gravity_is_found_however_clean_the_log(noise: float) -> None:
    family = family_named("offset-gravity")
    rig = replace(family.rig, encoder_resolution=0.0)
    clean = replace(family, rig=rig, faults=replace(family.faults, position_noise=noise))
    device = identify(clean.logs([0])[0]).device
    assert device.mass.value == pytest.approx(family.truth["mass"], rel=1e-2)
    assert device.gravity is not None


def test_friction_by_direction_reaches_the_device() -> None:
    family = family_named("directional-friction")
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
        asymmetry = truth["coulomb_asymmetry"] + truth["force_offset"]
        assert found.value == pytest.approx(truth["coulomb_friction"] + side * asymmetry, rel=0.03)


def covers_every_pose(seed: int) -> bool:
    mass = identify(poses(seed)).device.mass
    truth = family_named("open-loop-white").truth["mass"]
    return all(mass.low <= factor * truth <= mass.high for factor in POSE_FACTORS)


@pytest.mark.long
def test_the_envelope_holds_every_pose() -> None:
    # 95 % promised: fewer than 3 of 5 would happen once in 900 times.
    assert sum(covers_every_pose(seed) for seed in range(5)) >= 3


@pytest.mark.long
def test_the_envelope_holds_every_pose_in_95_of_100() -> None:
    count = 400
    hits = sum(at_once(delayed(covers_every_pose)(seed) for seed in range(100, 100 + count)))
    print(f"envelope: {hits} of {count}")
    assert hits >= count * 0.95 - 2 * np.sqrt(count * 0.95 * 0.05)


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_intervals_cover(name: str) -> None:
    """93 to 97 %; above only where WIDE says so.

    Measured over 400 seeds: mass 95.3 to 98.3 %, damping 96.3 % with friction to 99.5 % with an
    encoder only. With gravity over 240 seeds: mass 93.3 %, damping 94.6 %.
    """
    count = int(os.environ.get("HAPTUNE_SEEDS", "400"))
    logs = family_named(name).logs(range(1000, 1000 + count))
    fits = at_once(delayed(fitted)(name, log) for log in logs)
    error, half = errors(name, fits)
    coverage = np.mean(np.abs(error) <= half, axis=0)
    truth = np.array([family_named(name).truth[key] for key in NAMES])
    rmse = np.sqrt(np.mean((error / truth) ** 2, axis=0))
    print(f"{name}: coverage m {coverage[0]:.3f} b {coverage[1]:.3f}, rmse {rmse}")
    assert np.all(coverage >= 0.93 - 2 * np.sqrt(0.93 * 0.07 / count))
    for key, each in zip(NAMES, coverage, strict=True):
        assert each <= 0.97 + 2 * np.sqrt(0.97 * 0.03 / count) or (name, key) in WIDE


@pytest.mark.long
def test_no_tighter_interval_would_hold() -> None:
    """Friction of two of its own deviations, in one log of six taken for none: 96 % measured.

    With intervals a fifth tighter it was 91.8 %.
    """
    family, count = family_named("alternating-steps"), 400
    deviations = [
        fitted(family.name, log).estimate.deviation("coulomb_friction")
        for log in family.logs(range(20))
    ]
    rubbing = replace(
        family, rig=replace(family.rig, coulomb_friction=2 * float(np.median(deviations)))
    )
    logs = rubbing.logs(range(20_000, 20_000 + count))
    fits = at_once(delayed(fitted)(family.name, log) for log in logs)
    error, half = errors(family.name, fits)
    held, tighter = (float(np.mean(np.abs(error[:, 1]) <= k * half[:, 1])) for k in (1.0, 0.8))
    print(f"friction of two deviations: coverage of damping {held:.3f}, a fifth tighter {tighter}")
    assert held >= 0.93 - 2 * np.sqrt(0.93 * 0.07 / count)
    assert tighter < 0.93


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_auto_is_near_the_best_single_method(name: str) -> None:
    """RMSE of mass and of damping within 20 % of the best single method's on the same logs.

    Measured over 60 seeds: 4 % at most, in the mass in closed loop with measurement noise.
    """
    count = int(os.environ.get("HAPTUNE_SEEDS", "200"))
    logs = family_named(name).logs(range(count))
    truth = np.array([family_named(name).truth[key] for key in NAMES])
    rmse: dict[str, Array] = {}
    for method in ("auto", *RIVALS):
        fits = at_once(delayed(fitted)(name, log, method) for log in logs)
        error, _ = errors(name, fits)
        rmse[method] = np.sqrt(np.mean((error / truth) ** 2, axis=0))
        print(f"{name}, {method}: {rmse[method]}")
    best = np.min([rmse[method] for method in RIVALS], axis=0)
    # The sampling error of two RMSE; less where both are of the same method.
    assert np.all(rmse["auto"] <= 1.2 * best * (1 + 2 / np.sqrt(count)))
