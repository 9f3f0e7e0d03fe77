"""Two devices of several axes: what changed, entry by entry and axis by axis."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import identification as ident
from identification import Device, UsageError
from tests.commands import haptune
from tune import Comparison, compare

STANDARD = 1e-4


def device(
    mass: object, damping: object, friction: tuple[float, ...], *, axes: str = "xy", poses: int = 1
) -> Device:
    """A device whose entries have one standard deviation, as a file of one pose or several."""
    count = len(axes)
    rows = [(i, j) for i in range(count) for j in range(i, count)]
    names = [f"{which}_{axes[i]}_{axes[j]}" for which in ("mass", "damping") for i, j in rows]
    joint = {"parameters": names, "matrix": (STANDARD**2 * np.eye(len(names))).tolist()}
    pose: dict[str, Any] = {
        "mass": mass,
        "damping": damping,
        "coulomb_friction": friction,
        "force_offset": [0.0] * count,
        "covariance": joint | {"degrees_of_freedom": 100.0},
    }
    ends = [np.linalg.eigvalsh(np.array(each)) for each in (mass, damping)]
    spread = [{"value": float(e.mean()), "low": float(e[0]), "high": float(e[-1])} for e in ends]
    content = {
        "axis": ",".join(axes),
        "axes": list(axes),
        "poses": [pose] * poses,
        "motion": "linear",
        "sample_time": 0.001,
        "mass": spread[0],
        "damping": spread[1],
        "coulomb_friction": 0.7,
        "delay": 0.001,
        "encoder_resolution": 6e-6,
        "force_limit": {"continuous": 14.0, "peak": 28.0},
    }
    return ident.parse_document(Device, content, "device.yaml")


OLD = device([[2.0, 0.6], [0.6, 4.0]], [[8.0, -2.0], [-2.0, 14.0]], (0.5, 0.9))


def beyond(found: Comparison) -> set[str]:
    return {each.name for each in found.changes if each.beyond}


def test_what_came_off_an_axis_is_told_of_this_axis() -> None:
    """The range of masses over directions holds the new ones, the entry does not."""
    new = device([[2.0, 0.6], [0.6, 3.0]], [[8.0, -2.0], [-2.0, 14.0]], (0.5, 0.9))
    assert new.mass.low < OLD.mass.high
    found = compare(OLD, new)
    assert beyond(found) == {"mass_y_y"}
    assert {each.name for each in found.felt if each.differs} == {"mass_y_y"}
    assert beyond(compare(OLD, OLD)) == set()


def test_a_mirrored_axis_is_told_of_its_couplings() -> None:
    new = device([[2.0, -0.6], [-0.6, 4.0]], [[8.0, 2.0], [2.0, 14.0]], (0.5, 0.9))
    found = compare(OLD, new)
    assert beyond(found) == {"mass_x_y", "damping_x_y"}
    assert "mass_x_y" in {each.name for each in found.felt if each.differs}


def test_friction_is_compared_by_axis() -> None:
    new = device([[2.0, 0.6], [0.6, 4.0]], [[8.0, -2.0], [-2.0, 14.0]], (0.9, 0.5))
    found = compare(OLD, new)
    assert beyond(found) == {"coulomb_friction_x", "coulomb_friction_y"}
    assert {each.name for each in found.felt if each.differs} == beyond(found)


@pytest.mark.parametrize("other", [ident.load_device("homerehab"), "uv"])
def test_devices_of_unlike_axes_are_refused(other: Device | str) -> None:
    matrices = [[2.0, 0.6], [0.6, 4.0]], [[8.0, -2.0], [-2.0, 14.0]]
    new = device(*matrices, (0.5, 0.9), axes=other) if isinstance(other, str) else other
    with pytest.raises(UsageError, match=r"the old device has x, y, the new one (one axis|u, v)"):
        compare(OLD, new)


def test_axes_in_another_order_are_compared_by_name() -> None:
    new = device([[4.0, 0.6], [0.6, 2.0]], [[14.0, -2.0], [-2.0, 8.0]], (0.9, 0.5), axes="yx")
    assert beyond(compare(OLD, new)) == set()


@pytest.mark.parametrize("poses", [(2, 2), (1, 2), (2, 1)])
def test_poses_are_compared_one_by_one_or_all_together(poses: tuple[int, int]) -> None:
    matrices = [[2.0, 0.6], [0.6, 4.0]], [[8.0, -2.0], [-2.0, 14.0]]
    lighter = [[2.0, 0.6], [0.6, 3.0]], matrices[1]
    old = device(*matrices, (0.5, 0.9), poses=poses[0])
    new = device(*lighter, (0.5, 0.9), poses=poses[1])
    named = {"pose_1.mass_y_y", "pose_2.mass_y_y"} if poses == (2, 2) else {"mass_y_y"}
    assert beyond(compare(old, new)) == named
    assert {each.name for each in compare(old, new).felt} <= {
        each.name for each in compare(old, new).changes
    }


def test_the_command_names_axes_and_units(here: Path) -> None:
    new = device([[2.0, 0.6], [0.6, 3.0]], [[8.0, -2.0], [-2.0, 14.0]], (0.5, 0.9))
    for name, each in (("old.yaml", OLD), ("new.yaml", new)):
        (here / name).write_text(ident.to_yaml(ident.to_mapping(each), "of a test"), "utf-8")
    ended = haptune("compare", "old.yaml", "new.yaml")
    assert "feels different: mass y y 4 → 3 kg" in ended.out
    assert "changed beyond both 95 % intervals: mass y y\n" in ended.out
    rows = [line.split() for line in ended.out.splitlines() if line.strip().startswith("damping x")]
    assert [row[3] for row in rows] == ["N·s/m", "N·s/m"]
