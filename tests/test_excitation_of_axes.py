"""Forces planned for several axes together, played on devices that the plan does not know."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Motions, RigOfAxes, bundled_path
from identification import (
    AxesExcitation,
    ExcitationSpec,
    Hardware,
    InvalidInputError,
    UsageError,
    identify,
    parse_document,
    plan_axes,
    plan_excitation,
    to_yaml,
)
from tests.commands import haptune
from tests.planar import COLUMNS, pose_of, tangled

FloatArray = NDArray[np.float64]
STEP, COUNT = 1e-3, 6e-6
LIMITS: dict[str, Any] = {
    "name": "planar",
    "axes": ["x", "y"],
    "sample_time": STEP,
    "duration": 2.0,
    "ramp": 0.3,
    "force": 9.0,
    "travel": 0.04,
    "speed": 1.0,
    "mass": {"value": 3.0, "low": 2.0, "high": 4.5},
    "damping": {"value": 10.0, "low": 8.0, "high": 14.0},
    "coulomb_friction": {"value": 0.5, "low": 0.4, "high": 0.6},
    "encoder_resolution": COUNT,
}


def spec(**given: Any) -> ExcitationSpec:
    return parse_document(ExcitationSpec, LIMITS | given, "spec")


@cache
def planned() -> AxesExcitation:
    return plan_axes(spec())


def played(
    plan: AxesExcitation, mass: FloatArray, damping: FloatArray, friction: FloatArray
) -> Motions:
    """On devices of two axes, shape (devices, 2, 2), with one friction of both, (devices,)."""
    rig = RigOfAxes(
        mass=mass,
        damping=damping,
        sample_time=plan.spec.sample_time,
        coulomb_friction=np.stack((friction, friction), axis=1),
        encoder_resolution=COUNT,
    )
    return rig.run(np.repeat(plan.force[None], len(mass), axis=0), seed=1)


def test_axes_have_lines_of_their_own_and_all_limits_are_kept() -> None:
    """Any device of the guesses, coupled as it may be; somewhere nearly all of a limit is used."""
    plan = planned()
    assert not {*plan.lines[0].tolist()} & {*plan.lines[1].tolist()}
    assert np.all(plan.force[[0, -1]] == 0)
    assert np.max(np.abs(plan.force)) <= 9.0
    assert 0.9 < plan.used.travel <= 1.0
    chance = np.random.default_rng(34)
    mass = np.stack([tangled(chance, 2, 2.25, 2.0) for _ in range(12)])
    damping = np.stack([tangled(chance, 2, 1.75, 8.0) for _ in range(12)])
    seen = played(plan, mass, damping, chance.uniform(0.4, 0.6, 12))
    assert np.max(np.abs(seen.speed)) <= 1.0
    assert 0.02 < np.max(np.abs(seen.truth)) <= 0.04


def test_devices_that_are_light_in_any_direction_stay_within_the_travel() -> None:
    """Not along the axes or the diagonals only; the damping is least in every direction."""
    ranges = {
        "mass": (1.8, 3.0, 4.2),
        "damping": (6.0, 10.0, 16.0),
        "coulomb_friction": (0.5, 0.7, 1.0),
    }
    guesses = {k: {"low": low, "value": at, "high": high} for k, (low, at, high) in ranges.items()}
    plan = plan_axes(spec(duration=4.0, sample_time=4e-3, **guesses))
    turns = np.pi * np.arange(12) / 12
    units = np.stack((np.cos(turns), np.sin(turns)), axis=1)
    mass = 4.2 * np.eye(2) - 2.4 * units[:, :, None] * units[:, None, :]
    seen = played(plan, mass, np.broadcast_to(6 * np.eye(2), mass.shape), np.full(12, 0.5))
    assert 0.03 < np.max(np.abs(seen.truth)) <= 0.04


def test_intervals_are_those_that_identify_states() -> None:
    """Within a factor of two, as one log tells them; of a coupled device as well."""
    plan = planned()
    facts = {"axes": ["x", "y"], "motion": "linear", "sample_time": STEP, "delay": 0.0}
    limit = {"continuous": 9.0, "peak": 28.0}
    facts |= {"encoder_resolution": COUNT, "force_limit": limit}
    hardware = parse_document(Hardware, facts, "hardware")
    for across in (0.0, 0.8):
        mass, damping = (
            np.array([[own, across * share], [across * share, own]])
            for own, share in ((3.0, 1.0), (10.0, 2.0))
        )
        seen = played(plan, mass[None], damping[None], np.array([0.5]))
        found = identify(seen.log(), hardware=hardware)
        told = pose_of(found.device).covariance
        half = 1.96 * np.sqrt(np.diag(np.array(told.matrix)))
        predicted = np.array([plan.expected[name] for name in told.parameters])
        assert np.all(half < 2 * predicted)
        assert np.all(half > predicted / 2)
        assert np.allclose(pose_of(found.device).mass, mass, atol=1e-3)


def test_what_cannot_be_planned_is_refused_in_a_sentence() -> None:
    with pytest.raises(InvalidInputError, match=r"no 2 lines for each of 6 axes.*Give a duration"):
        plan_axes(spec(axes=list("abcdef"), duration=0.5, ramp=0.1))
    with pytest.raises(InvalidInputError, match="axes are x, x; give each a name of its own"):
        spec(axes=["x", "x"])
    with pytest.raises(InvalidInputError, match="axes"):
        spec(axes=["x"])
    with pytest.raises(UsageError, match="Plan them with plan_axes"):
        plan_excitation(spec())
    with pytest.raises(UsageError, match="plan one with plan_excitation"):
        plan_axes(spec(axes=None))


@pytest.mark.usefixtures("here")
def test_the_command_writes_a_column_an_axis() -> None:
    """A gentle play of what is hardly known, seen in a table and a picture."""
    content = {name: each for name, each in LIMITS.items() if name != "speed"}
    text = to_yaml(
        {"schema": "haptune/excitation/1"} | content | {"gentle": True, "duration": 1.2}, ""
    )
    Path("excitation.yaml").write_text(text, encoding="utf-8")
    run = haptune("excite", "excitation.yaml", "-o", "force.csv", "--picture", "plan.png")
    assert run.code == 0
    assert "mass x,y" in run.out
    assert "multisines with lines of their own: x " in run.out
    header, first, *_ = Path("force.csv").read_text(encoding="utf-8").splitlines()
    assert header == "time,force_x,force_y"
    assert first == "0,0,0"
    assert Path("plan.png").stat().st_size > 10_000


@pytest.mark.usefixtures("here")
def test_a_device_of_other_axes_is_refused() -> None:
    log, hardware = (str(bundled_path(f"planar.{end}")) for end in ("csv", "hardware.yaml"))
    assert haptune("identify", log, *COLUMNS, "--hardware", hardware).code == 0
    content = LIMITS | {"axes": ["u", "v"], "device": "device.yaml"}
    text = to_yaml({"schema": "haptune/excitation/1"} | content, "")
    Path("excitation.yaml").write_text(text, encoding="utf-8")
    run = haptune("excite", "excitation.yaml", "-o", "force.csv")
    assert run.code == 3
    assert "is of the axes x, y, the excitation of u, v. Give axes: [x, y]" in run.err
