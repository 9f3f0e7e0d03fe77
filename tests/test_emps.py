"""The real axis: published values recovered, with intervals that deserve the name."""

from functools import cache
from pathlib import Path

import pytest

from identification import (
    Identification,
    LogColumns,
    Trajectory,
    identify,
    load_trajectory,
)

LOG = Path(__file__).parents[2] / "shared/data/emps/DATA_EMPS.mat"
pytestmark = pytest.mark.skipif(
    not LOG.exists(), reason="the EMPS log is test data that does not come with the project"
)

#: Janot, Gautier, Brunot: Data Set and Reference Models of EMPS, 2019; symmetric friction.
MASS, COULOMB, OFFSET = 95.109, 20.394, -3.165
#: Their standard deviations by ordinary least squares.
ORDINARY_MASS, ORDINARY_DAMPING = 0.109, 1.15


@cache
def log() -> Trajectory:
    return load_trajectory(
        LOG, LogColumns(time="t", force="vir", position="qm", reference="qg", force_gain=35.1507)
    )


@cache
def found() -> Identification:
    return identify(log())


def test_values_are_in_the_accepted_bands() -> None:
    device = found().device
    assert device.mass.value == pytest.approx(MASS, rel=0.01)
    assert 199 <= device.damping.value <= 214
    assert device.coulomb_friction.value == pytest.approx(COULOMB, rel=0.03)
    assert device.force_offset.value == pytest.approx(OFFSET, rel=0.02)


def test_intervals_are_useful_and_not_the_ordinary_ones() -> None:
    device, estimate = found().device, found().estimates[0]
    assert (device.mass.high - device.mass.low) / 2 <= 0.015 * device.mass.value
    assert (device.damping.high - device.damping.low) / 2 <= 0.06 * device.damping.value
    assert estimate.deviation("mass") >= 1.5 * ORDINARY_MASS
    assert estimate.deviation("damping") >= 2 * ORDINARY_DAMPING
    assert device.mass.low <= MASS <= device.mass.high


def test_friction_is_found_to_differ_by_direction() -> None:
    """Their second model: mass 95.154, Fv+ 166.71, Fv- 240.42, Fc+ 20.14, Fc- 20.63."""
    device = found().device
    assert device.mass.value == pytest.approx(95.154, rel=0.01)
    damping, friction = device.damping_by_direction, device.friction_by_direction
    assert damping is not None
    assert friction is not None
    assert damping.forward.value == pytest.approx(166.71, rel=0.06)
    assert damping.backward.value == pytest.approx(240.42, rel=0.06)
    assert friction.forward.value == pytest.approx(20.14, rel=0.06)
    assert friction.backward.value == pytest.approx(20.63, rel=0.06)
    box = device.simultaneous_box()
    assert box.damping[0] < damping.forward.low < damping.backward.high < box.damping[1]


def test_methods_that_lean_on_the_friction_model_are_not_believed() -> None:
    """Innovations disagree with least squares, which says so."""
    assert found().method == "least-squares"
    assert "innovations say" in found().reason
    others = {each.method: each for each in found().logs[0].others}
    assert others["innovations"].value("damping") > 250
    assert "output-error" not in others
