"""Bags of ROS 2 give what the plain CSV gives; written by the writer of mcap-ros2-support."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2.writer import Writer

from identification import LogColumns, load_trajectory
from tests.packed_logs import (
    FORCE,
    POSITION,
    ROWS,
    TIME,
    assert_damage_is_refused,
    assert_extra_is_named,
    assert_is_the_plain_log,
    refusal,
)

pytestmark = pytest.mark.usefixtures("read_here")

_HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] effort\n" + _HEADER
FORCES = "std_msgs/Header header\ngeometry_msgs/Vector3 wrench\n" + _HEADER
FORCES += "=" * 80 + "\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
#: A recorder's clock: ns since 1970.
START = 1_700_000_000_123_456_789
FIELDS: dict[str, Any] = {"position": "/arm/joints/position[1]", "force": "/arm/joints/effort[1]"}
Message = Callable[[int], dict[str, Any]]


def header(k: int) -> dict[str, Any]:
    stamp = START + k * 1_000_000
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}


def joints(k: int) -> dict[str, Any]:
    return {
        "header": header(k),
        "name": ["base", "elbow"],
        "position": [9.0, POSITION[k]],
        "effort": [9.0, FORCE[k]],
    }


def bag(folder: Path, **topics: tuple[str, Message, range]) -> Path:
    """A bag; ``_`` in a topic's name stands for its slashes."""
    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer: Any = Writer(stream)
        for name, (definition, message, rows) in topics.items():
            schema = writer.register_msgdef(
                f"rig_msgs/msg/{name.title().replace('_', '')}", definition
            )
            for k in rows:
                late = START + 1_000_000 * k + 50_000 * (k % 3)
                topic = "/" + name.replace("_", "/")
                writer.write_message(
                    topic, schema, message(k), log_time=late + 200_000, publish_time=late
                )
        writer.finish()
    return path


ALL = range(ROWS)


def test_fields_of_one_topic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    words = "time from 'header stamp of /arm/joints'"
    path = bag(tmp_path, arm_joints=(JOINTS, joints, ALL))
    assert_is_the_plain_log(tmp_path, path, words, **FIELDS)
    bare = {role: name.removeprefix("/") for role, name in FIELDS.items()}
    assert_is_the_plain_log(tmp_path, path, words, **bare)


def test_topics_of_one_stamp_are_joined(tmp_path: Path) -> None:
    def forces(k: int) -> dict[str, Any]:
        return {"header": header(k), "wrench": {"x": FORCE[k], "y": 0.0, "z": 0.0}}

    fields = FIELDS | dict[str, Any](force="/motor/wrench/x")
    path = bag(tmp_path, arm_joints=(JOINTS, joints, ALL), motor=(FORCES, forces, ALL))
    words = "time from 'header stamp of /arm/joints'"
    assert_is_the_plain_log(tmp_path, path, words, **fields)
    # Ten messages of either have no partner.
    late = bag(
        tmp_path,
        arm_joints=(JOINTS, joints, range(10, ROWS)),
        motor=(FORCES, forces, range(ROWS - 10)),
    )
    log = load_trajectory(late, LogColumns(**fields))
    np.testing.assert_allclose(log.force, FORCE[10:-10])
    np.testing.assert_allclose(log.position, POSITION[10:-10])
    assert log.read_as.startswith("10 of 290 messages without a partner left out")


def test_topics_that_are_not_stamped_together_are_refused(tmp_path: Path) -> None:
    def forces(k: int) -> dict[str, Any]:
        shifted = header(k)
        shifted["stamp"]["nanosec"] += 1
        return {"header": shifted, "wrench": {"x": FORCE[k], "y": 0.0, "z": 0.0}}

    path = bag(tmp_path, arm_joints=(JOINTS, joints, ALL), motor=(FORCES, forces, ALL))
    fields = FIELDS | dict[str, Any](force="/motor/wrench/x")
    assert "not stamped together" in refusal(path, LogColumns(**fields))
    said = refusal(path, LogColumns(time="log_time", **fields))
    assert "have each their own log_time" in said


def test_messages_without_a_header_need_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()

    def both(k: int) -> dict[str, Any]:
        return {"position": POSITION[k], "force": FORCE[k], "ticks_ns": START + 1_000_000 * k}

    definition = "float64 position\nfloat64 force\nuint64 ticks_ns\n"
    path = bag(tmp_path, axis=(definition, both, ALL))
    fields: dict[str, Any] = {"position": "/axis/position", "force": "/axis/force"}
    assert "--time publish_time" in refusal(path, LogColumns(**fields))
    words = "time from '/axis/ticks_ns' times 1e-09"
    assert_is_the_plain_log(tmp_path, path, words, time="/axis/ticks_ns", **fields)
    sent = load_trajectory(path, LogColumns(time="publish_time", **fields))
    np.testing.assert_allclose(sent.time, TIME + 50e-6 * (np.arange(ROWS) % 3), atol=1e-12)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, "topics /arm/joints (rig_msgs/msg/ArmJoints), and nobody said which fields"),
        ({}, '--force "/joint_states/effort[0]" --position "/joint_states/position[0]"'),
        ({"force": "/arm/joints/effort[1]"}, "which fields are the position"),
        (FIELDS | {"force": "/leg/effort"}, "no field '/leg/effort'; its topics are /arm/joints"),
        (FIELDS | {"force": "/arm/joints/torque[0]"}, "they have: header, name, position, effort"),
        (FIELDS | {"force": "/arm/joints/effort"}, "holds 2 values"),
        (FIELDS | {"force": "/arm/joints/name[0]"}, "holds no number"),
        (FIELDS | {"force": "/arm/joints/__class__"}, "no field"),
    ],
)
def test_fields_that_are_not_there(tmp_path: Path, asked: dict[str, Any], said: str) -> None:
    path = bag(tmp_path, arm_joints=(JOINTS, joints, ALL))
    assert said in refusal(path, LogColumns(**asked))


def test_torn_and_damaged_bags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    whole = bag(tmp_path, arm_joints=(JOINTS, joints, ALL)).read_bytes()
    ends = (4, 100, len(whole) // 2, len(whole) - 10)
    assert_damage_is_refused(whole, tmp_path / "torn.mcap", ends, **FIELDS)


def test_the_extra_names_itself_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    path = bag(tmp_path, arm_joints=(JOINTS, joints, ALL))
    missing = "mcap and mcap-ros2-support, which read it, are not installed"
    assert_extra_is_named(monkeypatch, path, "mcap", missing, "ros")


@pytest.mark.parametrize(("ending", "step"), [(".db3", "ros2 bag convert"), (".xls", ".xlsx")])
def test_other_kinds_are_refused_with_what_makes_them_readable(
    tmp_path: Path, ending: str, step: str
) -> None:
    path = tmp_path / f"log{ending}"
    path.write_bytes(b"anything")
    assert step in refusal(path)
