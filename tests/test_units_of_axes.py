"""Columns of several axes in other units than said: what tells, which axis, and what helps."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import identification as ident
from datasets_synthetic import bundled_path
from identification import Device, LogRefusedError, identify
from tests.commands import haptune
from tests.planar import COLUMNS, DAMPING, FRICTION, MASS, hardware, motion, pose_of, write_table


@pytest.mark.parametrize("code", ["repeated-rows", "lost-rows"])
def test_rows_of_several_axes_that_are_not_one_sample_each_are_refused(code: str) -> None:
    """Of one axis their time is put right; of several it would stay wrong."""
    log = motion(MASS, DAMPING, FRICTION, seed=1).log()
    chosen = np.random.default_rng(1).choice(np.arange(100, len(log) - 100), 60, replace=False)
    rows = np.arange(len(log))
    kept = np.sort(np.append(rows, chosen)) if code == "repeated-rows" else np.delete(rows, chosen)
    time = log.axes[0].sample_time * np.arange(kept.size)
    wrong = replace(
        log,
        axes=tuple(
            replace(each, time=time, force=each.force[kept], position=each.position[kept])
            for each in log.axes
        ),
    )
    with pytest.raises(LogRefusedError) as refused:
        identify(wrong, hardware=hardware())
    found = [each for each in refused.value.findings if each.code == code]
    assert found
    assert all("of several axes" in each.seen for each in found)


@pytest.mark.parametrize(("method", "gain"), [("auto", 0.5), ("least-squares", 1.1)])
def test_a_force_of_one_axis_in_another_unit_is_refused(method: ident.Method, gain: float) -> None:
    """The mass that couples x to y is 1 kg in the force of x, and the gain times that in y's."""
    log = motion(MASS, DAMPING, FRICTION, seed=1).log()
    x, y = log.axes
    wrong = replace(log, axes=(x, replace(y, force=gain * y.force)))
    with pytest.raises(LogRefusedError) as refused:
        identify(wrong, hardware=hardware(), method=method)
    (found,) = (each for each in refused.value.findings if each.severity == "refusal")
    assert found.code == "force-unit"
    numbers = [float(word) for word in found.seen.split() if word[0].isdecimal()]
    assert np.allclose(numbers, (1.0, gain, 1 / gain), rtol=0.03)
    small, large = ("y", "x") if gain < 1 else ("x", "y")
    assert f"position of {small} reads" in found.remedy
    assert f"one of {large} as much too large" in found.remedy


def test_a_force_between_axes_is_no_gain_of_one() -> None:
    """What adds to the damping of y by the motion of x leaves their masses alike."""
    seen = motion(MASS, DAMPING, FRICTION, seed=1)
    force = seen.force.copy()
    force[..., 1] += 2.0 * seen.speed[..., 0]
    with pytest.raises(LogRefusedError) as refused:
        identify(replace(seen, force=force).log(), hardware=hardware())
    assert "force-unit" not in {each.code for each in refused.value.findings}
    assert "no gain mends both" in str(refused.value)


@pytest.fixture
def here(here: Path) -> Path:
    """A folder with the bundled log of two axes, y in mm, and its hardware."""
    shutil.copy(bundled_path("planar.hardware.yaml"), "hardware.yaml")
    table = np.loadtxt(bundled_path("planar.csv"), delimiter=",", skiprows=1)
    write_table(table * [1, 1, 1, 1, 1000], "log.csv")
    return here


def identified(*options: str, y: str = "position_y") -> tuple[int, str]:
    columns = ("--force", "force_x,force_y", "--position", f"position_x,{y}")
    ended = haptune("identify", "log.csv", *columns, "--hardware", "hardware.yaml", *options)
    return ended.code, ended.err


@pytest.mark.usefixtures("here")
def test_a_remedy_followed_to_the_letter_mends_one_axis() -> None:
    """What is in mm gets the gain that the refusal names, for this axis alone."""
    code, said = identified()
    assert code == 4
    assert "log.csv, axis y steps by" in said
    assert "blank one leaves its axis as it is" in said
    (gain,) = re.findall(r"in mm: (--position-gain) (\S+)\)", said)
    assert gain[1] == ",0.001"
    code, said = identified(*gain)
    assert code == 0, said
    device = ident.load_document(Device, "device.yaml")
    truth = ident.load_mapping(bundled_path("planar.truth.yaml"))
    assert np.allclose(pose_of(device).mass, truth["mass"], rtol=0.02, atol=0.02)


@pytest.mark.usefixtures("here")
def test_gains_that_fit_no_axes_are_refused() -> None:
    for gains, code, sentence in (
        ("1,2,3", 3, "--position-gain: gives 3 numbers for 2 axes"),
        ("1,0", 3, "--position-gain: is 0, not a finite number other than zero"),
        ("mm", 2, "--position-gain: 'mm' is no number"),
    ):
        assert identified("--position-gain", gains)[0] == code
        assert sentence in identified("--position-gain", gains)[1]
    for role in ("force", "position"):
        both = {"force": "force_x,force_y", "position": "position_x,position_y"}
        both[role] = f"{role}_x,{role}_x"
        ended = haptune("doctor", "log.csv", *(w for k, v in both.items() for w in (f"--{k}", v)))
        assert ended.code == 2
        assert f"--{role}: names '{role}_x' for two axes" in ended.err
    one = ("--force", "force_x", "--position", "position_x", "--force-gain", "1,2")
    assert "gives 2 numbers for one axis" in haptune("identify", "log.csv", *one).err


@pytest.mark.usefixtures("here")
def test_a_unit_that_no_header_converts_is_asked_for_of_its_axis() -> None:
    write_table(np.loadtxt("log.csv", delimiter=",", skiprows=1), "log.csv", "position_y_deg")
    code, said = identified(y="position_y_deg")
    assert code == 3
    assert "Add --position-gain ,X, m (rad) per deg" in said


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("command", ["identify", "doctor"])
def test_one_column_of_a_device_of_two_axes_is_refused(command: str) -> None:
    """Else it would be a device of one axis, with the name of the first."""
    one = ("--force", "force_x", "--position", "position_x", "--hardware", "hardware.yaml")
    ended = haptune(command, "log.csv", *one)
    assert ended.code == 2
    assert "states the axes x,y, and log.csv is read as one" in ended.err
    assert "--force force_x,force_y and --position position_x,position_y" in ended.err
    assert not Path("device.yaml").exists()


@pytest.mark.usefixtures("here")
def test_two_columns_with_the_hardware_of_one_axis_are_refused() -> None:
    path = Path("hardware.yaml")
    text = re.sub(r"axes: .*", "axis: y", path.read_text(encoding="utf-8"))
    path.write_text(text, encoding="utf-8")
    code, said = identified("--position-gain", ",0.001")
    assert code == 2
    assert "the logs are of x,y, the hardware of y" in said
    assert "State axes: [x,y] in the hardware file" in said


@pytest.mark.usefixtures("here")
def test_each_refusal_names_the_axis_it_is_about() -> None:
    write_table(np.loadtxt("log.csv", delimiter=",", skiprows=1) * [1, 1, 1, 1000, 1], "log.csv")
    refused = [line for line in identified()[1].splitlines() if line.startswith("refusal:")]
    assert len(set(refused)) == len(refused) > 2
    for axis in "xy":
        assert any(f"log.csv, axis {axis} steps by" in line for line in refused)


@pytest.mark.usefixtures("here")
def test_a_refusal_of_one_log_of_several_names_the_log() -> None:
    shutil.copy(bundled_path("planar.csv"), "good.csv")
    write_table(np.loadtxt("good.csv", delimiter=",", skiprows=1) * [1, 1, 0, 1, 1], "log.csv")
    for logs, said in (
        (("log.csv",), "axes-not-told-apart: no force of its own moves y"),
        (("good.csv", "log.csv"), "axes-not-told-apart: log.csv: no force of its own moves y"),
    ):
        ended = haptune("identify", *logs, *COLUMNS)
        assert ended.code == 4
        assert said in ended.err
