"""The ten families and the three poses: what differs by seed, what does not, and what is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Clock, simulate
from identification import InvalidInputError
from tests.simulated.families import FAMILIES, POSE_FACTORS, family_named, pose_logs, poses
from tests.simulated.family import Family
from tests.thinned import thinned

FloatArray = NDArray[np.float64]

#: Families in open loop whose only fault of size is white noise on the position, and which
#: quantities beyond mass, damping, offset and delay have to be found with them.
BEYOND: dict[str, tuple[str, ...]] = {
    "open-loop-white": (),
    "encoder-only": (),
    "coulomb": ("coulomb_friction",),
    "directional-friction": ("coulomb_friction", "damping_asymmetry"),
    "alternating-steps": (),
    "dropped-samples": (),
    "fractional-delay": (),
    "offset-gravity": ("gravity_sine", "gravity_cosine"),
}
CLOSED = ("closed-loop-measurement-noise", "closed-loop-force-noise")
WHITE = tuple(name for name in BEYOND if name != "encoder-only")
#: Families of which one log costs most: they come last.
DEAREST = {"directional-friction", "offset-gravity"}
Z95 = 1.959963984540054


def test_the_ten_families_of_the_plan_are_there() -> None:
    assert set(FAMILIES) == {*BEYOND, *CLOSED}
    for name, family in FAMILIES.items():
        assert family_named(name) is family
        assert family.description.endswith(".")
    with pytest.raises(InvalidInputError, match="fractional-delay"):
        family_named("fractional")


@pytest.mark.parametrize("name", thinned(FAMILIES, 3))
def test_a_log_depends_on_its_seed_only(name: str) -> None:
    family = FAMILIES[name]
    first, second, third = family.logs([5, 6, 2])
    alone = family.logs([6])[0]
    for (column, values), (_, again) in zip(second.columns(), alone.columns(), strict=True):
        np.testing.assert_array_equal(values, again, err_msg=column)
    assert np.array_equal(first.time, third.time) == (name != "dropped-samples")
    if first.position.shape == third.position.shape:
        assert np.any(first.position != third.position)
    assert first.source == f"simulated {name}"


@pytest.mark.parametrize("name", thinned(sorted(BEYOND, key=DEAREST.__contains__), 5))
def test_open_loop_logs_differ_in_what_was_measured_only(name: str) -> None:
    family = FAMILIES[name]
    recording = family.recordings(range(40))[0]
    assert np.all(recording.force == recording.force[0])
    assert recording.reference is None
    scatter = np.std(recording.position, axis=0)
    expected = np.hypot(float(family.faults.position_noise), _count(family) / np.sqrt(12))
    if name in WHITE:
        # Standard deviations of 40 values: 11 % of error each, far less in the mean.
        assert np.mean(scatter) == pytest.approx(expected, rel=0.03)
    else:
        assert np.mean(scatter) < _count(family)


def _count(family: Family) -> float:
    return float(family.rig.encoder_resolution[0])


@pytest.mark.parametrize("name", thinned(WHITE, 2))
def test_quantisation_of_the_white_families_is_white(name: str) -> None:
    """Noise of half a count or more; what the encoder adds is then no function of the motion."""
    family = FAMILIES[name]
    assert float(family.faults.position_noise) >= _count(family) / 2
    drive = family.drive()
    exact = simulate(
        replace(family.rig, encoder_resolution=0.0),
        drive.force,
        clock=None if family.clock is None else Clock(steps=family.clock.steps),
        position=drive.start,
    ).position[0]
    error = family.recordings(range(40))[0].position - exact
    # 36 000 values at least: sampling error of a correlation 0.005.
    neighbours = np.mean(error[:, 1:] * error[:, :-1]) / np.mean(error**2)
    assert abs(neighbours) < 0.02
    assert abs(np.mean(error)) < 0.02 * np.std(error)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_loop_logs_follow_their_logged_reference(name: str) -> None:
    family = FAMILIES[name]
    logs = family.logs([0, 1])
    for log in logs:
        assert log.reference is not None
        # A servo of 5.8 Hz on a path that reaches 4 Hz: it follows, but late.
        assert np.corrcoef(log.reference, log.position)[0, 1] > 0.9
        assert np.max(np.abs(log.position)) < 2 * np.max(np.abs(log.reference))
        assert np.max(np.abs(log.force)) < float(family.rig.force_limit[0])
    np.testing.assert_array_equal(logs[0].reference, logs[1].reference)
    assert np.any(logs[0].force != logs[1].force)


def test_each_family_has_its_imperfection() -> None:
    truths = {name: family.truth for name, family in FAMILIES.items()}
    for name, truth in truths.items():
        rubs = name in {"coulomb", "directional-friction"}
        assert (truth["coulomb_friction"] > 0) == rubs
        assert (truth["damping_asymmetry"] > 0) == (name == "directional-friction")
        assert (truth["coulomb_asymmetry"] > 0) == (name == "directional-friction")
        assert (truth["gravity_sine"] > 0) == (name == "offset-gravity")
        assert (truth["force_offset"] > 0) == (name == "offset-gravity")
    assert truths["fractional-delay"]["delay"] == 0.0004
    assert truths["directional-friction"]["damping"] == 10.0
    assert _count(FAMILIES["encoder-only"]) == 5e-5
    disturbed = FAMILIES["closed-loop-force-noise"]
    assert disturbed.faults.force_noise == 0.2
    assert disturbed.hand is not None
    assert disturbed.hand.mass == 0.0
    steps = np.diff(FAMILIES["alternating-steps"].logs([0])[0].time)
    np.testing.assert_allclose(steps[:4], [0.010, 0.012, 0.010, 0.012], rtol=1e-9)
    lost = [4000 - len(log) for log in FAMILIES["dropped-samples"].logs(range(20))]
    assert np.mean(lost) == pytest.approx(120, abs=4 * np.sqrt(120 / 20))


def test_only_what_the_descriptions_say_is_stated() -> None:
    stated = {name for name, family in FAMILIES.items() if family.hardware is not None}
    assert stated == {"encoder-only", "alternating-steps"}
    known = FAMILIES["alternating-steps"].hardware
    assert known is not None
    assert known.delay is not None
    assert known.delay.value == FAMILIES["alternating-steps"].truth["delay"]
    coarse = FAMILIES["encoder-only"].hardware
    assert coarse is not None
    assert coarse.delay is None


@pytest.mark.parametrize("name", thinned(sorted(BEYOND, key=DEAREST.__contains__), 6))
def test_intervals_at_the_statistical_limit_are_neither_nothing_nor_everything(name: str) -> None:
    """95 % half widths of mass and damping by Cramér and Rao, from derivatives of the simulation.

    Every other unknown of the family is free, the start included; the asymmetry of Coulomb friction
    is the offset under another name.
    """
    family = FAMILIES[name]
    drive = family.drive()
    rig = replace(family.rig, encoder_resolution=0.0)
    clock = None if family.clock is None else Clock(steps=family.clock.steps)

    unknowns = [
        key
        for key in ("mass", "damping", "force_offset", "delay", *BEYOND[name])
        if key != "delay" or family.truth["delay"] > 0
    ]
    count = len(unknowns) + 2  # and position and speed at the start
    steps = np.array([1e-4 * (family.truth[key] or 1.0) for key in unknowns] + [1e-6, 1e-6])
    apart = np.concatenate((np.diag(steps), -np.diag(steps)))  # a member each, up and down
    position = simulate(
        replace(rig, **{key: family.truth[key] + apart[:, j] for j, key in enumerate(unknowns)}),
        drive.force,
        clock=clock,
        position=drive.start + apart[:, -2],
        velocity=apart[:, -1],
    ).position
    jacobian = (position[:count] - position[count:]).T / (2 * steps)
    sizes = np.linalg.norm(jacobian, axis=0)
    normalised = jacobian / sizes
    noise = np.hypot(float(family.faults.position_noise), _count(family) / np.sqrt(12))
    deviations = noise * np.sqrt(np.diag(np.linalg.inv(normalised.T @ normalised))) / sizes
    for key, deviation in zip(("mass", "damping"), deviations[:2], strict=True):
        assert 1e-4 < Z95 * deviation / family.truth[key] < 0.1, key


def test_poses_are_one_axis_whose_masses_differ_by_ten_percent() -> None:
    """Against superposed step responses of each mass, one sample late: what is left is noise."""
    assert POSE_FACTORS == (0.95, 1.0, 1.05)
    family = FAMILIES["open-loop-white"]
    logs = poses(4)
    noise = np.hypot(float(family.faults.position_noise), _count(family) / np.sqrt(12))
    damping = family.truth["damping"]
    residuals: list[FloatArray] = []
    for factor, log in zip(POSE_FACTORS, logs, strict=True):
        mass = 3.0 * factor
        late = np.maximum(log.time - 0.001, 0.0)
        response = (late + mass / damping * np.expm1(-damping / mass * late)) / damping
        changes = np.diff(log.force, prepend=0.0)
        motion = np.convolve(changes, response)[: len(log)]
        left = log.position - motion - family.drive().start
        assert np.std(left) == pytest.approx(noise, rel=0.05)
        assert log.axis == family.rig.axis
        residuals.append(left)
    # 4 000 samples each: sampling error of a correlation 0.016.
    alike = np.asarray(np.corrcoef(residuals)) - np.eye(3)
    assert np.max(np.abs(alike)) < 0.07
    np.testing.assert_array_equal(logs[0].force, logs[2].force)
    again, other = pose_logs([4, 5])
    for one, two, three in zip(logs, again, other, strict=True):
        np.testing.assert_array_equal(one.position, two.position)
        assert np.any(one.position != three.position)
