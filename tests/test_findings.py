"""The findings one by one, on an axis simulated elsewhere."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import (
    ForceLimit,
    Hardware,
    InvalidInputError,
    LogRefusedError,
    SlopeRange,
    Trajectory,
    UnmodelledForce,
    identify,
    quantity,
)
from identification.findings import inspect
from identification.fitting.friction_curve import FrictionCurve, unmodelled
from tests.exact_axis import Axis, counted, logged, multisine, positions
from tests.findings import findings_of, refusals, warnings
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 1e-3
COUNT = 6e-6


@cache
def plain(samples: int = 8000, seed: int = 0) -> Trajectory:
    """m = 3 kg, b = 10 N·s/m, Fc = 0.8 N, one sample of delay, 5 mN of unlogged force."""
    return recorded(Axis(coulomb=0.8, delay=STEP), samples=samples, seed=seed)


def recorded(axis: Axis, *, samples: int, seed: int) -> Trajectory:
    """A multisine on an axis, with 5 mN of unlogged force."""
    generator = np.random.default_rng(seed)
    force = multisine(generator, samples=samples, runs=1, axis=axis)[:, 0]
    return logged(axis, force, disturbance=5e-3 * generator.standard_normal(samples))


def log(force: Array, position: Array, time: Array | None = None) -> Trajectory:
    stamps = STEP * np.arange(force.size, dtype=np.float64) if time is None else time
    return Trajectory(time=stamps, force=force, position=position, motion="linear")


def seen_in(trajectory: Trajectory, hardware: Hardware | None = None) -> set[str]:
    """Codes of what is found before anything is estimated."""
    return {each.code for each in inspect(trajectory, hardware or Hardware())}


def test_a_clean_log_has_nothing_to_say() -> None:
    hardware = Hardware(
        delay=quantity(STEP),
        encoder_resolution=quantity(COUNT),
        force_limit=ForceLimit(continuous=14.0, peak=28.0),
    )
    findings, found = findings_of(plain(), hardware)
    assert findings == ()
    assert found is not None
    assert "forces act" not in found.reason


@pytest.mark.parametrize("period", [0.05, 0.011])
def test_a_counter_that_runs_over_names_its_range(period: float) -> None:
    trajectory = plain()
    wrapped = log(trajectory.force, np.mod(trajectory.position, period))
    (finding,) = inspect(wrapped, Hardware())
    assert finding.code == "encoder-wrap"
    assert finding.severity == "refusal"
    stated = float(finding.remedy.split("period=")[1].split(")")[0])
    assert stated == pytest.approx(period, rel=2e-3)  # jump and motion differ by more
    assert "for position in m" not in finding.remedy
    (finding,) = inspect(replace(wrapped, stated_units=frozenset({"position"})), Hardware())
    assert f"period={stated:.6g} for position in m (rad)" in finding.remedy


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
def test_a_turn_is_called_a_turn(turn: float) -> None:
    """It jumps by 2 % less while it moves, and the period of numpy.unwrap is the turn itself."""
    time = STEP * np.arange(4000, dtype=np.float64)
    angle: Array = 1.5 * turn * np.sin(2 * np.pi * 2 * time)
    trajectory = Trajectory(time=time, force=np.cos(time), position=np.mod(angle, turn))
    (finding,) = [each for each in inspect(trajectory, Hardware()) if each.code == "encoder-wrap"]
    assert f"by {turn:.4g}, one turn," in finding.seen
    assert "360 in degrees, 6.283185307 in rad" in finding.remedy


def test_a_reading_that_is_lost_is_a_jump() -> None:
    trajectory = plain()
    place = trajectory.position.copy()
    place[3000] += 0.02
    assert refusals(log(trajectory.force, place)) == {"encoder-wrap"}


@pytest.mark.parametrize(
    ("force", "position"), [(100.0, 1.0), (1.0, 1000.0), (1.0, 180 / np.pi)], ids=["N", "mm", "deg"]
)
def test_hardware_tells_units(force: float, position: float) -> None:
    hardware = Hardware(
        encoder_resolution=quantity(COUNT), force_limit=ForceLimit(continuous=10.0, peak=14.5)
    )
    trajectory = plain()
    other = log(trajectory.force * force, trajectory.position * position)
    assert "force-unit" in refusals(other, hardware)


@pytest.mark.parametrize(
    ("times", "codes"), [(2 * np.pi, {"force-unit"}), (6, set()), (1 / 6, set())]
)
def test_counts_of_a_turn_apart_are_another_unit(times: float, codes: set[str]) -> None:
    """An encoder read four or six times finer or coarser than stated is none."""
    hardware = Hardware(encoder_resolution=quantity(COUNT * times))
    turning = replace(plain(), motion="rotary")
    assert refusals(turning, hardware) == codes
    turning = replace(turning, stated_units=frozenset({"position"}))
    assert not inspect(turning, hardware)


@pytest.mark.parametrize("gain", [1e-3, 1e-6, 1e3])
def test_a_clock_of_another_unit_is_named_by_its_gain(gain: float) -> None:
    hardware = Hardware(sample_time=quantity(STEP))
    other = log(plain().force, plain().position, plain().time / gain)
    finding = next(each for each in inspect(other, hardware) if each.code == "force-unit")
    assert (f"--time-gain {gain:g} " in finding.remedy) == (gain < 1)
    assert f"{1 / gain:.4g} times the sample time" in finding.seen


@pytest.mark.parametrize(("jitter", "refuses"), [(0.03, False), (0.25, True)])
def test_stamps_that_say_when_a_row_was_written(jitter: float, refuses: bool) -> None:
    trajectory = plain()
    late = STEP * jitter * np.random.default_rng(7).uniform(0, 1, len(trajectory))
    shaken = log(trajectory.force, trajectory.position, trajectory.time + late)
    found = [each for each in inspect(shaken, Hardware()) if each.code == "jitter"]
    assert [each.severity for each in found] == ["refusal" if refuses else "warning"]


@pytest.mark.parametrize("hardware", [Hardware(), Hardware(sample_time=quantity(STEP))])
def test_rows_that_come_in_packets_are_not_lost(hardware: Hardware) -> None:
    """Eight rows are stamped as they come at once; where they are read at once, others are lost."""
    trajectory = plain()
    row = np.arange(len(trajectory), dtype=np.float64)
    come = STEP * (row // 8 + 1) * 8 + 2e-5 * (row % 8)
    late = log(trajectory.force, trajectory.position, come)
    (found,) = (each for each in inspect(late, hardware) if each.severity == "refusal")
    assert found.code == "jitter"
    assert "come in packets, 0.9991 ms a row" in found.seen
    assert "number the rows" in found.remedy
    kept = row % 18 < 8
    lost = log(trajectory.force[kept], trajectory.position[kept], STEP * row[kept])
    assert [each.code for each in inspect(lost, hardware)] == ["dropped-samples"]


def test_a_log_of_every_second_sample_is_named() -> None:
    every = [column[::2] for column in (plain().force, plain().position, plain().time)]
    found = inspect(log(*every), Hardware(sample_time=quantity(STEP)))
    assert any("every second sample of the 1 ms" in each.seen for each in found)


@pytest.mark.parametrize("pause", [0.01, 0.6], ids=["at once", "slowly"])
@pytest.mark.parametrize("lost", [0, 100])
@pytest.mark.parametrize("true", [1.0, 0.95, 1.05])
def test_rows_that_come_late_and_catch_up_are_no_other_clock(
    pause: float, lost: int, true: float
) -> None:
    """Three rows in a thousand are late by 5 samples, what was missed follows; others are lost."""
    trajectory = plain()
    due = np.arange(len(trajectory), dtype=np.float64)
    when = due.copy()
    for k in range(300, len(trajectory) - 50, 300):
        when[k : k + 20] = np.maximum(due[k : k + 20], k + 5 + pause * np.arange(20))
    keep = np.ones(len(trajectory), dtype=bool)
    keep[[k for k in range(50, 8000, 70) if 20 <= k % 300 <= 290][:lost]] = False
    late = log(trajectory.force[keep], trajectory.position[keep], true * STEP * when[keep])
    if true != 1.0:
        with pytest.raises(InvalidInputError, match="but the hardware states a sample time"):
            list(inspect(late, Hardware(sample_time=quantity(STEP))))
        return
    found = seen_in(late, Hardware(sample_time=quantity(STEP)))
    assert found == ({"jitter", "dropped-samples"} if lost else {"jitter"})


def test_a_force_that_a_late_sample_held_on_is_no_force_of_lost_rows() -> None:
    """Played by a computer that is late by 4.5 samples three times a second, true stamps."""
    axis = Axis(coulomb=0.8, delay=STEP, sample_time=STEP / 10)
    force = multisine(np.random.default_rng(0), samples=6000, runs=1, axis=Axis())[:, 0]
    ticks = 10 * np.arange(force.size)
    for k in range(300, force.size - 10, 300):
        ticks[k : k + 5] = 10 * (k + 5) - np.arange(5, 0, -1)
    held = np.repeat(force, np.diff(ticks, append=ticks[-1] + 10))
    place = counted(positions(axis, held[:, None]), COUNT)[ticks, 0]
    late = log(force, place, np.asarray(STEP / 10 * ticks, dtype=np.float64))
    found = identify(late, hardware=Hardware(sample_time=quantity(STEP), delay=quantity(STEP)))
    assert found.device.mass.low <= axis.mass <= found.device.mass.high
    assert found.device.damping.low <= axis.damping <= found.device.damping.high
    assert found.device.mass.high - found.device.mass.low < 1e-3 * axis.mass


@pytest.mark.parametrize(("milliseconds", "severity"), [(5, "warning"), (150, "refusal")])
def test_a_gap_is_judged_by_the_motion_in_it(milliseconds: int, severity: str) -> None:
    trajectory = plain()
    keep = np.ones(len(trajectory), dtype=bool)
    keep[4000 : 4000 + milliseconds] = False
    cut = log(trajectory.force[keep], trajectory.position[keep], trajectory.time[keep])
    found = [each for each in inspect(cut, Hardware()) if each.code == "dropped-samples"]
    assert [each.severity for each in found] == [severity]


@pytest.mark.parametrize("flat", [False, True])
def test_a_smooth_top_is_no_limit(flat: bool) -> None:
    """Within 1e-4 of the peak for 8 % of the time, twice a second."""
    time = STEP * np.arange(2000)
    force = np.sin(2 * np.pi * time) + np.sin(6 * np.pi * time) / 9
    force = np.clip(force, -0.87, 0.87) if flat else force
    assert np.mean(np.abs(force) >= 0.9999 * np.abs(force).max()) > 0.01
    assert ("force-saturated" in seen_in(logged(Axis(), force, count=0.0))) == flat


def test_a_square_wave_that_fades_in_is_no_limit_unless_it_reaches_the_one_stated() -> None:
    time = STEP * np.arange(4000)
    fade = np.minimum(time / 1.0, 1.0)
    force = 5 * fade * np.sign(np.sin(2 * np.pi * 1.3 * time) + 0.1)
    square = logged(Axis(), force, count=0.0)
    for reached, limit in (
        (False, None),
        (False, ForceLimit(continuous=6.0, peak=9.0)),
        (True, ForceLimit(continuous=5.0, peak=5.0)),
    ):
        found = seen_in(square, Hardware(force_limit=limit))
        assert ("force-saturated" in found) == reached


def test_steps_held_as_long_as_others_are_no_limit() -> None:
    """Staircases, and steps of any size of which none stands out; what is cut stays one."""
    generator = np.random.default_rng(7)
    stairs = np.repeat(np.concatenate((np.arange(21.0), np.arange(20.0, -21, -1))), 25)
    steps = np.repeat(np.sort(generator.uniform(-3, 3, 24)), generator.integers(100, 600, 24))
    time = STEP * np.arange(4000)
    sine = np.sin(2 * np.pi * time * (1 + time))
    limit = ForceLimit(continuous=20.0, peak=40.0)

    def saturated(force: Array, hardware: Hardware | None = None) -> bool:
        return "force-saturated" in seen_in(logged(Axis(), force, count=0.0), hardware)

    assert not saturated(stairs)
    assert not saturated(steps)
    fade = np.minimum(1.0, np.minimum(time, time[-1] - time) / 0.23)
    assert not saturated(fade * np.repeat(generator.choice((-1.0, 1.0), 80), 50))
    rounded = np.round(50 * np.clip(sine, -0.9, 0.9)) / 50
    assert saturated(rounded)
    assert saturated(np.where(time < 2.5, 0.0, rounded))  # most of it at rest
    # The remedies: an actuator that gives far more is at no limit.
    assert saturated(12 * rounded, Hardware(force_limit=limit))
    assert not saturated(11 * rounded, Hardware(force_limit=limit))


@pytest.mark.parametrize("step", [1e-3, 2e-4])
def test_rows_lost_and_renumbered_are_named(step: float) -> None:
    whole = late_by(0.0, step, 8000)
    assert "lost-rows" not in seen_in(whole)
    kept = np.random.default_rng(8).random(len(whole)) >= 0.02
    rows = np.count_nonzero(kept)
    torn = log(whole.force[kept], whole.position[kept], step * np.arange(rows, dtype=np.float64))
    found = [each for each in inspect(torn, Hardware()) if each.code == "lost-rows"]
    assert [each.severity for each in found] == ["warning"]
    again = identify(torn, hardware=Hardware(delay=quantity(0.0))).device.mass
    assert abs(again.value - 3.0) < max(again.high - again.low, 0.005 * 3.0)
    # With their own stamps the same rows are gaps.
    gaps = log(whole.force[kept], whole.position[kept], whole.time[kept])
    assert seen_in(gaps) == {"dropped-samples"}


@pytest.mark.parametrize("seed", [407, 477])
def test_noise_that_makes_long_steps_makes_as_many_short_ones_and_loses_no_row(seed: int) -> None:
    """Of 600 seeds two of those whose noise has 15 to 17 jumps forward and half as many back."""
    force = multisine(np.random.default_rng(0), samples=20_000, runs=1, axis=Axis())[:, 0]
    clean = logged(Axis(delay=STEP), force, count=0.0)
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(force.size)
    assert "lost-rows" not in seen_in(log(force, clean.position + noise))


@pytest.mark.parametrize("part", [0.02, 0.1])
def test_rows_written_twice_are_named_and_taken_out(part: float) -> None:
    whole = plain()
    chosen = np.random.default_rng(8).random(len(whole)) < part
    rows = np.repeat(np.arange(len(whole)), np.where(chosen, 2, 1))
    twice = log(whole.force[rows], whole.position[rows])
    found = identify(twice)
    (named,) = [each for each in found.findings if each.code == "repeated-rows"]
    assert abs(float(named.seen.split()[0]) / np.count_nonzero(chosen) - 1) < 0.2
    mass = found.device.mass
    assert mass.low < 3.0 < mass.high
    assert mass.value == pytest.approx(3.0, rel=0.005)


@pytest.mark.parametrize("rows", [1.05, 2, 3])
def test_a_log_of_a_slower_controller_has_no_row_twice(rows: float) -> None:
    """Nor has one of which only the position is read as seldom."""
    whole = plain()
    seldom = (np.arange(len(whole)) // rows).astype(np.intp)
    for force in (whole.force, whole.force[seldom]):
        assert "repeated-rows" not in seen_in(log(force, whole.position[seldom]))


def test_what_friction_holds_at_rest_is_no_hand() -> None:
    """Friction of 3 N holds the device against steps of 1.5 to 5 N: all within the model."""
    generator = np.random.default_rng(0)
    held = generator.integers(50, 400, 60)
    levels = 5 * generator.uniform(0.3, 1, held.size) * (-1.0) ** np.arange(held.size)
    axis = Axis(mass=1.0, damping=4.0, coulomb=3.0, delay=STEP)
    found, known = findings_of(logged(axis, np.repeat(levels, held)[:8_000]))
    assert "hand-on-device" not in {each.code for each in found}
    assert known is not None
    assert known.device.mass.value == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("hertz", [20.0, 60.0])
def test_a_sweep_too_fast_for_cubics_lost_no_row(hertz: float) -> None:
    """A period of it is 25 and 8 rows long at its end."""
    time: Array = 2e-3 * np.arange(5000, dtype=np.float64)
    force = 5 * np.sin(2 * np.pi * (0.5 * time + (hertz - 0.5) * time**2 / 20))
    axis = Axis(mass=1.0, damping=4.0, coulomb=0.3, sample_time=2e-3, delay=2e-3)
    assert "lost-rows" not in seen_in(logged(axis, force, count=1e-6))


@pytest.mark.parametrize("counts", [5.0, 20.0])
def test_noise_on_a_fine_encoder_is_no_unit(counts: float) -> None:
    noise = counts * 1e-7 * np.random.default_rng(4).standard_normal(len(plain()))
    hardware = Hardware(encoder_resolution=quantity(1e-7))
    for place in (plain().position + noise, counted(plain().position + noise, 1e-7)):
        assert "force-unit" not in seen_in(log(plain().force, place), hardware)


def test_no_share_above_all_of_the_force_is_printed_and_no_slope_that_nothing_tells() -> None:
    forces = (
        UnmodelledForce(kind="position", share=53.661),
        UnmodelledForce(kind="drag", share=2.0),
    )
    steep = FrictionCurve(
        found=forces,
        slope=SlopeRange(low=-3e7, high=4e7),
        fastest=0.2,
        presliding=None,
        mass=3.0,
        mass_deviation=0.1,
        left=0.5,
    )
    told = unmodelled(plain(), steep, 10.0)
    assert told.severity == "refusal"
    assert "%" not in told.seen
    assert "e+07" not in told.seen
    told = unmodelled(plain(), replace(steep, slope=SlopeRange(low=9.0, high=40.0)), 10.0)
    assert "from 9 to 40" in told.seen


def hand_on(spring: float, damper: float, *, hertz: tuple[float, ...]) -> Trajectory:
    """A hand moves the handle; the controller answers to what it reads, and nothing else acts."""
    time = STEP * np.arange(6000)
    place = counted(
        np.sum([0.03 / k * np.sin(2 * np.pi * h * time + k) for k, h in enumerate(hertz, 1)], 0)
        + 3e-6 * np.random.default_rng(2).standard_normal(time.size),
        COUNT,
    )
    speed = np.diff(place, prepend=place[0]) / STEP
    return log(-spring * place - damper * speed, place)


@pytest.mark.parametrize(
    ("spring", "damper"),
    [
        pytest.param(500.0, 0.0, id="K"),
        pytest.param(500.0, 5.0, id="KB", marks=pytest.mark.long),
        pytest.param(0.0, 20.0, id="B"),
    ],
)
@pytest.mark.parametrize(
    "hertz", [(0.7, 1.9, 3.1), pytest.param((1.0,), marks=pytest.mark.long)], ids=["three", "one"]
)
def test_a_log_of_the_controller(spring: float, damper: float, hertz: tuple[float, ...]) -> None:
    """At one frequency a virtual spring is a mass of K/ω² that fits perfectly."""
    assert "controller-identified" in refusals(hand_on(spring, damper, hertz=hertz))


def test_a_sine_cannot_tell_a_mass_from_a_spring() -> None:
    time = STEP * np.arange(8000)
    force = 6 * np.sin(2 * np.pi * 1.5 * time)
    push = 5e-3 * np.random.default_rng(3).standard_normal(force.size)
    # From rest the motion drifts, which tells; the last seconds are steady.
    steady = logged(Axis(delay=STEP), force, disturbance=push).part(slice(4000, None))
    assert "not-exciting-mass" in {each.code for each in findings_of(steady)[0]}


def test_friction_and_offset_in_one_way_motion() -> None:
    generator = np.random.default_rng(4)
    force = np.repeat(generator.choice([3.0, 4.0, 6.0], 20), 400)
    axis = Axis(coulomb=0.8, offset=0.5, delay=STEP)
    push = 5e-3 * generator.standard_normal(force.size)
    findings, found = findings_of(logged(axis, force, disturbance=push, speed=0.2))
    assert found is not None
    assert found.device.mass.value == pytest.approx(3.0, rel=0.01)
    assert found.device.damping.value == pytest.approx(10.0, rel=0.02)
    (told,) = findings
    assert told.code == "not-exciting-damping"
    both = float(told.seen.split("friction is ")[1].split(" ±")[0])
    assert both == pytest.approx(0.8 + 0.5, rel=0.02)


@pytest.mark.parametrize(("mass", "severity"), thinned([(4.5, "refusal"), (3.02, None)], 1))
def test_a_device_that_changes(mass: float, severity: str | None) -> None:
    """The last third is of another mass; both parts start from rest."""
    other = recorded(replace(Axis(coulomb=0.8), mass=mass), samples=3000, seed=5)
    parts = (plain(5000, 1), other)
    force = np.concatenate([part.force for part in parts])
    start = parts[0].position[-1] - parts[1].position[0]
    place = np.concatenate((parts[0].position, parts[1].position + start))
    found = [each for each in findings_of(log(force, place))[0] if each.code == "heldout-misfit"]
    assert [each.severity for each in found] == ([severity] if severity else [])


def late_by(delay: float, step: float = STEP, samples: int = 5000) -> Trajectory:
    axis = Axis(coulomb=0.8, delay=delay, sample_time=step)
    return recorded(axis, samples=samples, seed=6)


def test_a_delay_beyond_the_scan_is_refused_and_a_stated_one_is_not_doubted() -> None:
    late = late_by(14 * STEP)
    assert "delay-unknown" in refusals(late)
    assert "delay-unknown" not in warnings(late, Hardware(delay=quantity(14 * STEP)))


def test_a_force_that_was_measured_tells_mass_but_no_delay() -> None:
    """A hand shakes the device; a sensor reads its force with every position."""
    fine = Axis(coulomb=0.8, sample_time=STEP / 4)
    lines = np.array([0.5, 0.8, 1.3, 1.9, 2.6, 3.5, 4.6])

    def push(time: Array) -> Array:
        return 6 * np.sin(2 * np.pi * lines * (time[:, None] + lines)).sum(axis=1)

    force = push(STEP * np.arange(4000, dtype=np.float64))
    acted = push(fine.sample_time * (np.arange(16000, dtype=np.float64) + 0.5))
    measured = log(force, counted(positions(fine, acted[:, None]), COUNT)[::4, 0])
    found = identify(measured, hardware=Hardware(encoder_resolution=quantity(COUNT)))
    (doubt,) = (each for each in found.findings if each.code != "not-stated")
    assert doubt.code == "delay-unknown"
    assert "it seems measured" in doubt.seen
    assert found.device.mass.low <= fine.mass <= found.device.mass.high
    assert "delay" in found.device.missing
    late = Hardware(encoder_resolution=quantity(COUNT), delay=quantity(STEP))
    assert identify(measured, hardware=late).device.delay.high == STEP
    # As the remedy has it, and a force that was held.
    mean = log(np.convolve(force, (0.5, 0.5))[1:], measured.position)
    at_once = Hardware(encoder_resolution=quantity(COUNT), delay=quantity(0.0))
    assert warnings(mean, at_once) == set()
    assert "delay-unknown" not in warnings(logged(Axis(coulomb=0.8), force))


@pytest.mark.parametrize("stated", [None, STEP])
def test_a_force_that_was_logged_rows_late_is_refused(stated: float | None) -> None:
    known = Hardware() if stated is None else Hardware(delay=quantity(stated))
    held, low_pass = late_by(STEP), np.repeat(1 / 8, 8)
    late = replace(held, force=np.roll(held.force, 2 if stated is None else 6))
    for log in (late, replace(held, force=np.convolve(held.force, low_pass)[: len(held)])):
        found = identify(log, hardware=known, allow="delay-unknown")
        assert found.device.logs[0].allowed == ("delay-unknown",)
        (said,) = (each.seen for each in found.findings if each.code == "delay-unknown")
        assert re.search(r"before its row, .* damping comes out too high", said)
        assert ("delay" in found.device.missing) == (stated is None)
    assert "delay-unknown" not in refusals(held, known)


@pytest.mark.parametrize(
    ("delay", "step"), thinned([(9.3e-3, 2e-4), (0.0072, 1e-3), (0.0035, 2e-3)], 1)
)
def test_a_delay_is_looked_for_up_to_ten_milliseconds_at_any_rate(
    delay: float, step: float
) -> None:
    late = late_by(delay, step, 8000)
    findings, found = findings_of(late)
    assert "delay-unknown" not in {each.code for each in findings}
    assert found is not None
    seen = found.logs[0].delay
    assert seen is not None
    assert seen.value == pytest.approx(delay, abs=0.02 * step)
    assert warnings(late, Hardware(delay=quantity(delay))) == set()


@pytest.mark.parametrize("samples", [-1, 1])
def test_a_stated_delay_that_is_a_sample_wrong_is_contradicted_once(samples: int) -> None:
    delay = 2.4 * STEP
    stated = quantity(delay + samples * STEP)
    findings, found = findings_of(late_by(delay), Hardware(delay=stated))
    doubted = [each for each in findings if each.code.startswith("delay-")]
    assert [each.code for each in doubted] == ["delay-contradicted"]
    assert f"the hardware states {stated.value * 1e3:.4g} ms" in doubted[0].seen
    assert found is not None
    device = found.device
    assert device.mass.low <= 3 <= device.mass.high
    assert device.damping.low <= 10 <= device.damping.high
    # Nobody knows which is right, so the device holds both.
    assert device.delay.low <= min(delay, stated.value) + 1e-9
    assert device.delay.high >= max(delay, stated.value)


def test_standing_under_a_changing_force() -> None:
    time = STEP * np.arange(8000)
    force = 5 * np.sin(2 * np.pi * 0.5 * time) + 0.5 * np.sin(2 * np.pi * 5 * time)
    for friction, codes in ((0.5, set[str]()), (4.8, {"stiction"})):
        push = 2e-3 * np.random.default_rng(1).standard_normal(force.size)
        assert seen_in(logged(Axis(coulomb=friction), force, disturbance=push)) == codes


@pytest.mark.parametrize(
    ("given", "where"),
    [
        (lambda force: np.clip(force, -0.6, 0.6), "above"),
        (lambda force: np.sign(force) * np.maximum(np.abs(force) - 0.1, 0.0), "below"),
        (lambda force: np.tanh(0.7 * force) / 0.7, "above"),
    ],
    ids=["clipped", "dead zone", "compressed"],
)
def test_an_actuator_that_gives_less_than_the_log_says_is_named(
    given: Callable[[Array], Array], where: str
) -> None:
    """Parts of the largest force; mass is 3 to 40 % off then, and nothing else tells it."""
    generator = np.random.default_rng(0)
    axis = Axis(coulomb=0.8, delay=STEP)
    force = multisine(generator, samples=8000, runs=1, axis=axis)[:, 0]
    peak = np.abs(force).max()
    place = logged(axis, peak * given(force / peak)).position
    hardware = Hardware(delay=quantity(STEP), encoder_resolution=quantity(COUNT))
    with pytest.raises(LogRefusedError) as refused:
        identify(log(force, place), hardware=hardware)
    (found,) = (each for each in refused.value.findings if each.code == "force-saturated")
    assert found.seen.startswith(where)
