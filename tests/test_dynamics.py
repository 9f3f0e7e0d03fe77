"""Lag, vibration, play and load friction: named, estimated, and out of mass and damping."""

import re
from functools import cache
from itertools import accumulate
from math import cos, sin, tanh
from typing import Any

import numpy as np
import pytest

from identification import (
    Hardware,
    Identification,
    LogRefusedError,
    Trajectories,
    Trajectory,
    identified_picture,
    identify,
)
from tests.exact_axis import Axis, counted, logged, positions
from tests.outside_axis import Axis as OutsideAxis
from tests.outside_axis import Body, Drive, play
from tests.simulated.catalogue.cases import Level, cases

#: Half-widths of 95 % within which an estimate of one log has to lie.
WIDE = 2.0


@cache
def log_with(code: str, level: Level) -> Trajectory:
    """A log of the catalogue."""
    case = next(each for each in cases(1, {code}) if each.level == level)
    return case.log.trajectory()


def found_in(code: str, level: Level, **stated: Any) -> Identification:
    """What identify makes of a log of the catalogue; codes that it does not allow are not there."""
    hardware = Hardware.model_validate({"motion": "linear", "delay": 0.001, **stated})
    found = identify(log_with(code, level), hardware=hardware)
    assert abs(found.device.damping.value - 10.0) < 0.2
    return found


def codes_of(found: Identification) -> set[str]:
    return {each.code for each in found.findings}


def test_a_lag_of_the_drive_is_measured_and_carried() -> None:
    found = found_in("drive-lag", "severe")
    lag, truth = found.device.current_lag, 1 / (2 * np.pi * 20.0)
    assert "drive-lag" in codes_of(found)
    assert lag is not None
    assert abs(lag.value - truth) < WIDE * (lag.high - lag.low) / 2 + 0.01 * truth
    assert abs(found.device.mass.value - 3.0) < 0.01
    stated = found_in("drive-lag", "severe", current_lag=truth)
    assert "drive-lag" not in codes_of(stated)
    assert stated.device.current_lag is not None
    assert stated.device.current_lag.value == pytest.approx(truth)


@pytest.mark.parametrize("stated", [0.002, 0.02])
def test_a_stated_lag_that_the_log_contradicts_is_held_beside_that_of_the_log(
    stated: float,
) -> None:
    found, truth = found_in("drive-lag", "severe", current_lag=stated), 1 / (2 * np.pi * 20.0)
    (said,) = [each for each in found.findings if each.code == "drive-lag"]
    lag = found.device.current_lag
    assert lag is not None
    assert lag.low <= min(stated, 1.01 * truth)
    assert max(stated, 0.99 * truth) <= lag.high
    assert f"the hardware states {stated * 1e3:g} ms" in said.seen
    assert f"{lag.low * 1e3:.3g} to {lag.high * 1e3:.3g} ms, and all of it" in said.remedy
    assert abs(found.device.mass.value - 3.0) < 0.01


LAG = 0.005


@cache
def log_behind(lag: float) -> Trajectory:
    """A log of 3 kg and 10 N·s/m with a delay of a sample and a lag, s, or 0."""
    step, fine = 1e-3, 8
    generator = np.random.default_rng(4)
    held = generator.integers(50, 300, 60)
    force = np.repeat(5 * generator.uniform(-1, 1, held.size), held)[:3000]
    late = np.repeat(np.append(0.0, force[:-1]), fine)
    if lag:
        kept = 1 - np.exp(-step / fine / lag)
        late = np.array([*accumulate(late, lambda level, sent: level + kept * (sent - level))])
        late[1:] = (late[1:] + late[:-1]) / 2  # the mean of each fine step
    axis = Axis(mass=3.0, damping=10.0, sample_time=step / fine)
    place = counted(positions(axis, late[:, None])[::fine, 0], 6e-6)
    time = step * np.arange(force.size, dtype=np.float64)
    return Trajectory(time=time, force=force, position=place)


def found_behind(log: Trajectory, lag: object) -> Identification:
    """What is told behind a stated lag; mass and damping are those of the log."""
    known = {"motion": "linear", "delay": 1e-3, "current_lag": lag}
    found = identify(log, hardware=Hardware.model_validate(known))
    assert found.device.mass.low <= 3.0 <= found.device.mass.high
    assert found.device.damping.low <= 10.0 <= found.device.damping.high
    assert found.device.delay.exact
    return found


@pytest.mark.parametrize("lag", [LAG, 0.0])
def test_a_stated_lag_is_given_to_the_fit_and_held_against_a_log_without_one(lag: float) -> None:
    found = found_behind(log_behind(lag), LAG)
    assert codes_of(found) - {"not-stated"} == (set() if lag else {"drive-lag"})
    assert found.device.current_lag is not None
    assert found.device.current_lag.low == pytest.approx(lag or 1e-6)
    assert found.device.current_lag.high == LAG
    if lag:
        drawn = identified_picture(found.device, found.logs).subfigs[0].get_suptitle()
        assert float(drawn.split("unexplained ")[1].split("%")[0]) < 2


@pytest.mark.parametrize("stated", [0.0047, 0.0053])
def test_what_a_stated_lag_leaves_in_doubt_is_in_the_intervals(stated: float) -> None:
    doubt = {"value": stated, "low": stated - 5e-4, "high": stated + 5e-4}
    found = found_behind(log_behind(LAG), doubt)
    assert codes_of(found) <= {"not-stated"}
    assert found.device.current_lag is not None
    assert found.device.current_lag.low == pytest.approx(stated - 5e-4)


def test_a_mode_is_measured_and_carried() -> None:
    found = found_in("vibration-mode", "severe")
    (mode,) = found.device.modes
    assert abs(mode.frequency_hz.value - 11.0) < 0.1
    assert abs(mode.damping_ratio.value - 0.02) < 0.005
    assert abs(mode.at_encoder - np.sqrt(0.9 / 2.1)) < 0.02
    assert abs(found.device.mass.value - 3.0) < 0.01


@pytest.mark.parametrize(("hertz", "part"), [(11.0, 0.65), (11.0, 0.1), (80.0, 0.65)])
def test_a_stated_mode_is_held_beside_that_of_the_log(hertz: float, part: float) -> None:
    mode = {"frequency_hz": hertz, "damping_ratio": 0.02, "at_encoder": part}
    found = found_in("vibration-mode", "severe", modes=[mode])
    near = [each for each in found.device.modes if abs(each.frequency_hz.value - 11.0) < 0.1]
    assert len(near) == 1
    assert abs(near[0].at_encoder - np.sqrt(0.9 / 2.1)) < 0.02
    assert near[0].damping_ratio.low < 0.02 < near[0].damping_ratio.high
    assert hertz in {each.frequency_hz.value for each in found.device.modes}
    assert ("vibration-mode" in codes_of(found)) is ((hertz, part) != (11.0, 0.65))


def test_an_encoder_behind_a_spring_is_refused() -> None:
    """The load of a drive of two masses is read, which swing on at 30 Hz; swept to 15 Hz."""
    time = 1e-3 * np.arange(10000, dtype=np.float64)
    shape = np.minimum(1.0, np.minimum(time, 10.0 - time) / 0.3)
    phase = 0.6 * np.pi * 10.0 / np.log(50.0) * (50.0 ** (time / 10.0) - 1)
    omega, reduced = 2 * np.pi * 30.0, 1.8 * 1.2 / 3.0
    load = Body(mass=1.2, stiffness=reduced * omega**2, damping=0.06 * reduced * omega)
    axis = OutsideAxis(mass=1.8, damping=10.0, coulomb=0.8, body=load)
    drive = Drive(sample_time=1e-3, plan=14 * shape * np.sin(phase), delay=1e-3, count=6e-6)
    played = play(axis, drive, np.random.default_rng(0))
    place = counted(played.reading + played.apart, 6e-6)
    hardware = Hardware.model_validate({"motion": "linear", "delay": 1e-3})
    with pytest.raises(LogRefusedError) as refused:
        identify(Trajectory(time=time, force=played.command, position=place), hardware=hardware)
    (found,) = [each for each in refused.value.findings if each.severity == "refusal"]
    assert found.code == "vibration-mode"
    hertz = re.search(r"at ([\d.]+) ± ", found.seen)
    assert hertz is not None
    assert float(hertz[1]) == pytest.approx(30.0, rel=0.02)


def test_mains_are_no_mode() -> None:
    """A tone of 0.3 N at 50 Hz that nothing excites: its damping is not told from zero."""
    generator = np.random.default_rng(0)
    held = generator.integers(50, 400, 60)
    levels = 5 * generator.uniform(0.3, 1, held.size) * (-1.0) ** np.arange(held.size)
    axis = Axis(mass=1.0, damping=4.0, coulomb=0.3, delay=1e-3)
    hum = 0.3 * np.sin(2 * np.pi * 50 * 1e-3 * np.arange(8000))
    found = identify(logged(axis, np.repeat(levels, held)[:8000], disturbance=hum))
    (tone,) = [each for each in found.findings if each.code == "unmodelled-force"]
    assert "a tone at 50" in tone.seen
    assert found.device.modes == ()
    assert found.device.mass.value == pytest.approx(1.0, rel=0.005)


def test_a_wrong_delay_is_not_taken_for_friction() -> None:
    """Force is 3 ms late and said to be prompt; what that leaves grows along a linear chirp."""
    time = 1e-3 * np.arange(10000, dtype=np.float64)
    shape = np.minimum(1.0, np.minimum(time, 10.0 - time) / 0.3)
    force = shape * np.sin(2 * np.pi * (0.2 * time + 0.49 * time**2))
    axis = Axis(mass=0.075, damping=0.2, coulomb=0.03, delay=3e-3)
    hardware = Hardware.model_validate({"motion": "linear", "delay": 0.0})
    found = identify(logged(axis, force, count=2e-5), hardware=hardware)
    assert "delay-contradicted" in codes_of(found)
    assert "unmodelled-force" not in codes_of(found)
    assert found.device.mass.value == pytest.approx(0.075, rel=0.005)


def test_play_widens_the_mass_down_to_what_stands_before_it() -> None:
    found = found_in("backlash", "plain")
    assert "backlash" in codes_of(found)
    assert found.device.mass.low < 2.2
    assert 2.95 < found.device.mass.high < 3.3


def test_friction_by_load_is_not_taken_for_inertia() -> None:
    found = found_in("load-friction", "plain")
    assert "load-friction" in codes_of(found)
    assert abs(found.device.mass.value - 3.0) < 0.02


@pytest.mark.parametrize("part", [0.03, 0.3])
def test_a_mass_that_depends_on_position_is_told_and_all_of_it_carried(part: float) -> None:
    """A linkage of 3·(1 + part·sin 15x) kg and 10 N·s/m, in steps of 0.05 ms."""
    generator, fine, place, speed = np.random.default_rng(4), 5e-5, 0.0, 0.0
    held = generator.integers(40, 200, 60)
    plan = np.repeat(12 * generator.uniform(-1, 1, held.size), held)[:5000]
    rows: list[tuple[float, float]] = []
    for level in plan.tolist():
        rows.append((level - 60 * place, place))
        for _ in range(20):
            mass, slope = 3 * (1 + part * sin(15 * place)), 45 * part * cos(15 * place)
            speed += fine * (rows[-1][0] - 10 * speed - slope * speed**2 / 2) / mass
            place += fine * speed
    force, course = np.array(rows).T
    masses = 3 * (1 + part * np.sin(15 * course))
    time = 1e-3 * np.arange(plan.size, dtype=np.float64)
    log = Trajectory(time=time, force=force, position=counted(course, 6e-6))
    found = identify(log, hardware=Hardware.model_validate({"motion": "linear", "delay": 0.0}))
    assert codes_of(found) - {"not-stated"} == {"unmodelled-force"}
    assert "a mass that depends on position" in found.findings[0].seen
    low, high = found.device.simultaneous_box().mass
    assert low < masses.min() < masses.max() < high
    assert found.device.mass.low == pytest.approx(masses.min(), rel=0.02)
    assert found.device.mass.high == pytest.approx(masses.max(), rel=0.02)
    assert found.device.damping.value == pytest.approx(10.0, rel=0.02)


def test_an_arm_is_told_by_its_mass_and_not_taken_for_friction_or_a_spring() -> None:
    """A rigid arm of two links with friction in its joints, in steps of 0.1 ms."""
    rng, fine = np.random.default_rng(0), 1e-4
    time = 2e-3 * np.arange(3000, dtype=np.float64)
    lines = np.geomspace(0.3, 8.0, 20).reshape(10, 2)
    turns = 2 * np.pi * lines * time[:, None, None] + rng.uniform(0, 2 * np.pi, lines.shape)
    plan = np.sin(turns).sum(axis=1)
    x = y = u = w = 0.0
    rows: list[tuple[float, ...]] = []
    for first, second in (plan * (2.0, 0.625) / np.abs(plan).max(axis=0)).tolist():
        rows.append((first - 1.1 * x, second - 0.2 * y, x, y))
        for _ in range(20):
            cosine, sine = 0.045 * cos(1.2 + y), 0.045 * sin(1.2 + y)
            own, both = 0.176 + 2 * cosine, 0.0325 + cosine
            one = rows[-1][0] + sine * (2 * u + w) * w - 0.3 * u - 0.04 * tanh(1e3 * u)
            other = rows[-1][1] - sine * u * u - 0.3 * w - 0.04 * tanh(1e3 * w)
            part = fine / (own * 0.0325 - both**2)
            u += part * (0.0325 * one - both * other)
            w += part * (own * other - both * one)
            x, y = x + fine * u, y + fine * w
    force, place = np.split(np.array(rows), 2, axis=1)
    axes = tuple(
        Trajectory(time=time, force=pull, position=counted(seen, 1e-5), axis=axis, motion="rotary")
        for axis, pull, seen in zip("xy", force.T, place.T, strict=True)
    )
    hardware = Hardware.model_validate({"motion": "rotary", "axes": ["x", "y"], "delay": 0.0})
    found = identify(Trajectories(axes=axes), hardware=hardware)
    (told,) = [each for each in found.findings if each.code != "not-stated"]
    range_seen = re.search(r"as of an arm: that of x goes from ([\d.]+) to ([\d.]+)", told.seen)
    assert range_seen is not None
    masses = 0.176 + 0.09 * np.cos(1.2 + place[:, 1])
    assert float(range_seen[1]) == pytest.approx(masses.min(), rel=0.05)
    assert float(range_seen[2]) == pytest.approx(masses.max(), rel=0.05)
