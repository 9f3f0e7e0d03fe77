"""identify: truth recovered, intervals that hold it, and every refusal with its reason."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from datasets_synthetic import FAMILIES
from identification import (
    Device,
    ForceLimit,
    Hardware,
    Identification,
    IdentificationError,
    InvalidInputError,
    LogRefusedError,
    Trajectory,
    UsageError,
    as_stored,
    identify,
    quantity,
)
from identification.estimators import METHODS
from identification.findings import CODES
from tests.exact_axis import Axis, closed_loop, counted, multisine, positions

Array = NDArray[np.float64]
STEP = 1e-3
COUNT = 6e-6
HARDWARE = Hardware(
    name="homerehab",
    sample_time=quantity(STEP),
    delay=quantity(STEP),
    encoder_resolution=quantity(COUNT),
    force_limit=ForceLimit(continuous=14.0, peak=28.0),
)
NAMES = ("mass", "damping", "coulomb_friction", "force_offset")


def log(force: Array, position: Array, step: float = STEP, **kind: Any) -> Trajectory:
    time: Array = np.arange(force.size) * np.float64(step)
    return Trajectory(time=time, force=force, position=position, **kind)


@cache
def homerehab(
    coulomb: float = 0.0,
    *,
    disturbance: float = 0.0,
    noise: float = 0.0,
    runs: int = 5,
    samples: int = 20000,
    seed: int = 0,
) -> tuple[Trajectory, ...]:
    """m = 3 kg, b = 10 N·s/m, delay 1 ms, ±50 mm, at most 14 N, counts of 6 um."""
    generator = np.random.default_rng(seed)
    axis = Axis(coulomb=coulomb, delay=STEP)
    force = multisine(generator, samples=samples, runs=runs, axis=axis)
    push = disturbance * generator.standard_normal(force.shape)
    place = positions(axis, force, disturbance=push)
    place = counted(place + noise * generator.standard_normal(force.shape), COUNT)
    return tuple(log(force[:, i], place[:, i]) for i in range(runs))


def codes(found: Identification | LogRefusedError) -> set[str]:
    return {finding.code for finding in found.findings}


def refused(trajectory: Trajectory, **options: Any) -> set[str]:
    with pytest.raises(LogRefusedError) as caught:
        identify(trajectory, **options)
    for finding in caught.value.findings:
        assert finding.code in CODES
        assert finding.seen
        assert finding.needed
        assert finding.remedy
    assert caught.value.findings[0].severity == "refusal"
    return {f.code for f in caught.value.findings if f.severity == "refusal"}


def holds(found: Identification, truth: dict[str, float]) -> NDArray[np.bool_]:
    inside: list[bool] = []
    for name, value in truth.items():
        interval = getattr(found.device, name)
        inside.append(interval.low <= value <= interval.high)
    return np.array(inside)


def test_clean_logs_are_right_to_a_thousandth() -> None:
    for trajectory in homerehab()[:3]:
        found = identify(trajectory, hardware=HARDWARE)
        assert found.device.mass.value == pytest.approx(3.0, rel=1e-4)
        assert found.device.damping.value == pytest.approx(10.0, rel=1e-4)
        assert found.method == "output-error"
        assert not found.findings


def test_friction_and_unknown_force_cost_less_than_a_per_cent() -> None:
    for trajectory in homerehab(0.8, disturbance=5e-3)[:3]:
        found = identify(trajectory, hardware=HARDWARE)
        assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)
        assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)
        assert found.device.coulomb_friction.value == pytest.approx(0.8, rel=5e-3)
        assert found.method == "innovations"
        assert not found.findings


@pytest.mark.long
@pytest.mark.parametrize(
    ("coulomb", "disturbance", "noise", "method"),
    [
        (0.0, 0.0, 1e-5, "auto"),
        (0.0, 0.0, 1e-5, "least-squares"),
        (0.8, 5e-3, 0.0, "auto"),
        (0.8, 0.1, 0.0, "auto"),
    ],
)
def test_coverage(coulomb: float, disturbance: float, noise: float, method: str) -> None:
    """95 % intervals hold the truth in at least 93 % of 300 logs."""
    logs = homerehab(coulomb, disturbance=disturbance, noise=noise, runs=300, seed=1)
    truth = {"mass": 3.0, "damping": 10.0, "coulomb_friction": coulomb, "force_offset": 0.0}
    found = [identify(each, hardware=HARDWARE, method=method) for each in logs]
    assert np.all(np.mean([holds(each, truth) for each in found], axis=0) >= 0.93)


def fleet(runs: int, seed: int) -> tuple[Axis, Array, Array]:
    """Devices of every size in one simulation, with the forces and the positions logged."""
    generator = np.random.default_rng(seed)
    step = float(generator.choice([5e-4, 1e-3, 2e-3]))
    mass = 10 ** generator.uniform(np.log10(0.05), np.log10(20), runs)
    damping = mass * 10 ** generator.uniform(-0.7, 1.5, runs)
    plain = Axis(mass=mass, damping=damping, sample_time=step)
    force = multisine(
        generator, samples=int(8 / step), runs=runs, axis=plain, travel=0.04, peak=1e9
    )
    size = force.std(axis=0)
    rubs = generator.integers(0, 2, runs)
    axis = Axis(
        mass=mass,
        damping=damping,
        coulomb=rubs * size * generator.uniform(0, 0.3, runs),
        offset=size * generator.normal(0, 0.02, runs),
        sample_time=step,
        delay=step * float(generator.integers(0, 3)),
    )
    force = force + axis.offset
    push = rubs * size * 1e-3 * generator.standard_normal(force.shape)
    place = positions(axis, force, disturbance=push)
    return axis, force, counted(place, 10 ** generator.uniform(-6.3, -4.5, runs))


def check_fleet(runs: int, seed: int) -> None:
    axis, force, place = fleet(runs, seed)
    mass, damping = np.asarray(axis.mass), np.asarray(axis.damping)
    for i in range(runs):
        trajectory = log(force[:, i], place[:, i], axis.sample_time)
        for hardware in (Hardware(delay=quantity(axis.delay)), None):
            found = identify(trajectory, hardware=hardware)
            box = found.device.simultaneous_box()
            assert box.mass[0] <= mass[i] <= box.mass[1]
            assert box.damping[0] <= damping[i] <= box.damping[1]
            assert found.device == as_stored(found.device)


def test_the_simultaneous_box_holds_devices_of_every_size() -> None:
    check_fleet(runs=8, seed=2)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_the_simultaneous_box_holds_hundreds_of_devices(seed: int) -> None:
    check_fleet(runs=60, seed=100 + seed)


def test_coarse_encoders_and_short_logs() -> None:
    trajectory = homerehab(0.8, disturbance=5e-3)[0]
    coarse = log(trajectory.force, counted(trajectory.position, 1e-4))
    known = HARDWARE.model_copy(update={"encoder_resolution": quantity(1e-4)})
    found = identify(coarse, hardware=known)
    assert found.device.mass.value == pytest.approx(3.0, rel=3e-3)
    assert found.device.damping.value == pytest.approx(10.0, rel=2e-2)
    short = log(trajectory.force[:3000], trajectory.position[:3000])
    assert identify(short, hardware=HARDWARE).device.damping.value == pytest.approx(10, rel=2e-2)


@pytest.mark.parametrize("shape", ["square", "prbs", "chirp", "sine"])
def test_no_usual_excitation_is_refused(shape: str) -> None:
    time = np.arange(12000) * STEP
    generator = np.random.default_rng(3)
    force = {
        "square": 8 * np.sign(np.sin(9.4 * time + 0.1)),
        "prbs": np.repeat(generator.choice([-6.0, 6.0], 120), 100),
        "chirp": 10 * np.sin(2 * np.pi * (0.3 * time + 0.3 * time**2)),
        "sine": 6 * np.sin(6.3 * time),
    }[shape]
    axis = Axis(coulomb=0.8, delay=STEP)
    push = 5e-3 * generator.standard_normal((force.size, 1))
    place = counted(positions(axis, force[:, None], disturbance=push)[:, 0], COUNT)
    found = identify(log(force, place), hardware=HARDWARE)
    assert found.device.mass.value == pytest.approx(3.0, rel=2e-3)
    assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)


def tracked(coulomb: float, push: float) -> tuple[Array, Array]:
    """A loop that follows a reference, closed over the counted position."""
    shape = (12000, 1)
    time = np.arange(shape[0]) * STEP
    wanted = 0.04 * (np.sin(3.1 * time) + 0.4 * np.sin(13.2 * time))
    last = np.zeros(1)

    def law(row: int, place: Array) -> Array:
        nonlocal last
        seen = counted(place, COUNT)
        force = 3000 * (wanted[row] - seen) - 60 * (seen - last) / STEP
        last = seen
        return force

    generator = np.random.default_rng(4)
    disturbance = push * generator.standard_normal(shape)
    place, force = closed_loop(
        Axis(coulomb=coulomb, delay=STEP), law, shape, disturbance=disturbance, speed=0.2
    )
    return force[:, 0], counted(place, COUNT)[:, 0]


@pytest.mark.parametrize(("coulomb", "push"), [(0.0, 0.0), (0.8, 5e-3), (0.8, 0.2)])
def test_a_log_in_closed_loop(coulomb: float, push: float) -> None:
    force, place = tracked(coulomb, push)
    hardware = HARDWARE.model_copy(update={"force_limit": None})
    found = identify(log(force, place), hardware=hardware)
    assert found.device.mass.value == pytest.approx(3.0, rel=3e-3)
    assert found.device.damping.value == pytest.approx(10.0, rel=1e-2)


@cache
def device_of_a_noisy_log() -> tuple[Trajectory, Device]:
    plain = homerehab(0.8, disturbance=5e-3, samples=6000, runs=1)[0]
    return plain, identify(plain).device


@settings(max_examples=8, deadline=None)
@given(
    force=st.floats(-2, 2).map(lambda power: 10**power),
    length=st.floats(-3, 3).map(lambda power: 10**power),
    time=st.floats(-1, 1).map(lambda power: 10**power),
    shift=st.floats(-5, 5),
    turn=st.sampled_from([1.0, -1.0]),
)
def test_units_shifts_and_direction_change_nothing(
    force: float, length: float, time: float, shift: float, turn: float
) -> None:
    plain, reference = device_of_a_noisy_log()
    # A plausible size of travel and force is all that depends on units.
    allow = ["force-unit"]
    scaled = Trajectory(
        time=plain.time * time + shift,
        force=plain.force * force * turn,
        position=plain.position * length * turn,
    )
    device = identify(scaled, allow=allow).device
    # Turns of a noisy log, and with them the friction, lean on the last digits; where refining
    # them ends does not: less than a thousandth of a half-width, and of the values far less.
    units = (
        (device.mass, reference.mass, force * time**2 / length),
        (device.damping, reference.damping, force * time / length),
        (device.coulomb_friction, reference.coulomb_friction, force),
    )
    for seen, known, unit in units:
        half = (known.high - known.low) / 2
        assert abs(seen.value / unit - known.value) <= 1e-3 * half
        assert (seen.high - seen.low) / unit == pytest.approx(2 * half, rel=1e-2)
    assert device.delay.value == pytest.approx(reference.delay.value * time, rel=1e-2)


# Delay and hardware


def test_delay_stated_assumed_or_read() -> None:
    for samples in (0.0, 1.0, 2.5):
        axis = Axis(delay=samples * STEP)
        force = multisine(np.random.default_rng(5), samples=8000, runs=1, axis=axis)
        trajectory = log(force[:, 0], counted(positions(axis, force), COUNT)[:, 0])
        found = identify(trajectory)
        assert "delay-unknown" in codes(found)
        assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)
        assert found.logs[0].delay is not None
        assert found.logs[0].delay.value == pytest.approx(samples * STEP, abs=2e-5)
        stored = found.device.delay
        assert stored.value == pytest.approx(max(samples, 1.0) * STEP, rel=1e-2)
        if samples > 1:
            assert stored.source == "log"
            assert stored.low <= samples * STEP <= stored.high
        stated = identify(trajectory, hardware=Hardware(delay=quantity(samples * STEP)))
        assert stated.device.delay.value == samples * STEP
        assert stated.device.delay.source == "hardware"
        assert "delay-unknown" not in codes(stated)


def test_doubt_about_the_delay_widens_the_damping() -> None:
    """A delay of d reads as -m·ω²·d of damping."""
    trajectory = homerehab()[0]
    late = Hardware(delay=quantity(1.5 * STEP))
    wide = Hardware(delay=quantity(STEP, 0.5 * STEP, 1.5 * STEP))
    for method in ("least-squares", "output-error"):
        right = identify(trajectory, hardware=HARDWARE, method=method).device.damping
        wrong = identify(trajectory, hardware=late, method=method).device.damping
        doubted = identify(trajectory, hardware=wide, method=method).device.damping
        assert doubted.low <= 10 <= doubted.high
        # The doubt is carried on by the slope at the value stated.
        assert (doubted.high - doubted.low) / 2 > 0.8 * abs(wrong.value - right.value)
        # Output error leans on slow motion, where a delay hardly matters.
        assert method == "output-error" or not wrong.low <= 10 <= wrong.high


def test_hardware_is_kept_and_what_it_leaves_open_is_read() -> None:
    trajectory = homerehab()[0]
    device = identify(trajectory, hardware=HARDWARE).device
    assert device.name == "homerehab"
    assert device.sample_time.source == "hardware"
    assert device.encoder_resolution == quantity(COUNT, source="hardware")
    assert device.force_limit == HARDWARE.force_limit
    found = identify(trajectory)
    assert codes(found) == {"delay-unknown", "force-saturated", "few-counts"}
    bare = found.device
    assert bare.encoder_resolution is not None
    assert bare.encoder_resolution.value == pytest.approx(COUNT, rel=1e-6)
    assert bare.encoder_resolution.source == "log"
    assert bare.force_limit is not None
    assert bare.force_limit.peak == pytest.approx(np.abs(trajectory.force).max(), rel=1e-9)
    assert bare.force_limit.continuous == bare.force_limit.peak
    assert bare.force_limit.source == "log"
    assert bare.sample_time.value == pytest.approx(STEP, rel=1e-9)
    assert bare.logs[0].findings == ("delay-unknown", "force-saturated", "few-counts")


def test_sample_times_that_contradict() -> None:
    trajectory = homerehab()[0]
    with pytest.raises(InvalidInputError, match=r"0\.001.*0\.0013"):
        identify(trajectory, hardware=Hardware(sample_time=quantity(0.0013)))
    assert refused(trajectory, hardware=Hardware(sample_time=quantity(0.0005))) == {
        "dropped-samples"
    }
    close = Hardware(sample_time=quantity(0.001005), delay=quantity(STEP))
    assert identify(trajectory, hardware=close).device.sample_time.value == 0.001005


# Several logs


def test_several_logs_give_their_envelope() -> None:
    poses: list[Trajectory] = []
    for mass in (2.8, 3.0, 3.3):
        axis = Axis(mass=mass, delay=STEP)
        force = multisine(np.random.default_rng(6), samples=6000, runs=1, axis=axis)
        poses.append(log(force[:, 0], counted(positions(axis, force), COUNT)[:, 0]))
    found = identify(poses, hardware=HARDWARE)
    assert found.device.mass.low <= 2.8
    assert found.device.mass.high >= 3.3
    assert 2.8 < found.device.mass.value < 3.3
    assert len(found.device.logs) == len(found.estimates) == 3
    covariance = found.device.covariance
    assert covariance is not None
    assert np.sqrt(covariance.matrix[0][0]) >= np.std([2.8, 3.0, 3.3], ddof=1) * 0.99
    box = found.device.simultaneous_box()
    assert box.mass[0] < 2.8
    assert box.mass[1] > 3.3


@pytest.mark.parametrize("kind", [{"axis": "y"}, {"motion": "rotary"}])
def test_axes_are_not_mixed(kind: dict[str, Any]) -> None:
    one = homerehab()[0]
    other = log(one.force, one.position, **kind)
    with pytest.raises(UsageError, match=r"one (axis|motion) at a time"):
        identify([one, other])
    with pytest.raises(UsageError, match="hardware"):
        identify(other, hardware=HARDWARE)


def test_requests_that_cannot_be_met() -> None:
    trajectory = homerehab()[0]
    with pytest.raises(UsageError, match="auto, least-squares, weak, instruments, output-error"):
        identify(trajectory, method="guess")
    with pytest.raises(UsageError, match="nonsense"):
        identify(trajectory, allow=["jitter", "nonsense"])
    with pytest.raises(UsageError):
        identify([])


@pytest.mark.parametrize("method", METHODS)
def test_a_method_can_be_asked_for(method: str) -> None:
    found = identify(homerehab()[0], hardware=HARDWARE, method=method)
    assert found.method == method
    assert "as asked" in found.reason


def test_terms_stay_unless_they_are_noise() -> None:
    none = identify(homerehab()[1], hardware=HARDWARE)
    assert none.device.coulomb_friction.low == 0
    assert none.device.coulomb_friction.value < 1e-4
    covariance = none.device.covariance
    assert covariance is not None
    assert covariance.parameters == NAMES
    small = identify(homerehab(0.02, runs=1)[0], hardware=HARDWARE)
    assert small.device.coulomb_friction.value == pytest.approx(0.02, abs=2e-3)


def test_motion_one_way_cannot_split_friction_from_offset() -> None:
    time = np.arange(8000) * STEP
    force = (12 + 3 * np.sin(9 * time) + 2 * np.sin(2 * time))[:, None]
    axis = Axis(coulomb=0.8)
    place = counted(positions(axis, force, speed=1.0), COUNT)[:, 0]
    hardware = Hardware(delay=quantity(0.0))
    found = identify(log(force[:, 0], place), hardware=hardware, allow=["force-unit"])
    assert found.estimates[0].parameters == ("mass", "damping", "force_offset")
    assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)
    assert found.device.force_offset.value == pytest.approx(0.8, rel=0.05)


# Findings


def test_jitter_is_doubted_and_then_refused() -> None:
    plain = homerehab()[0]
    generator = np.random.default_rng(7)
    for share, severity in ((0.015, "warning"), (0.1, "refusal")):
        stamps = plain.time + share * STEP * generator.uniform(-1.3, 1.3, len(plain)) / 1.06
        shaken = Trajectory(time=stamps, force=plain.force, position=plain.position)
        if severity == "refusal":
            assert refused(shaken, hardware=HARDWARE) == {"jitter"}
            allowed = identify(shaken, hardware=HARDWARE, allow=["jitter"])
            assert allowed.device.logs[0].allowed == ("jitter",)
            assert codes(allowed) == {"jitter"}
            assert all(finding.severity == "warning" for finding in allowed.findings)
        else:
            assert codes(identify(shaken, hardware=HARDWARE)) == {"jitter"}


def test_alternating_steps_are_taken_as_they_are() -> None:
    family = FAMILIES["alternating-steps"]
    trajectory = family.logs([0])[0]
    found = identify(trajectory, hardware=family.hardware)
    assert "jitter" in codes(found)
    device = found.device
    assert device.mass.value == pytest.approx(family.truth["mass"], rel=2e-3)
    assert device.damping.value == pytest.approx(family.truth["damping"], rel=2e-3)
    assert (device.sample_time.low, device.sample_time.high) == pytest.approx((0.010, 0.012))


def test_dropped_samples_are_counted_and_bridged() -> None:
    plain = homerehab()[0]
    keep = np.ones(len(plain), dtype=bool)
    keep[[500, 501, 9000]] = False
    gaps = Trajectory(time=plain.time[keep], force=plain.force[keep], position=plain.position[keep])
    found = identify(gaps, hardware=HARDWARE)
    (seen,) = [each.seen for each in found.findings if each.code == "dropped-samples"]
    assert "2 gaps, about 3 samples lost" in seen
    assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)


def test_few_counts() -> None:
    plain = homerehab()[0]
    coarse = log(plain.force, counted(plain.position, 2e-3))
    assert "few-counts" in refused(coarse)


def test_force_at_its_limit() -> None:
    plain = homerehab()[0]
    clipped = log(np.clip(plain.force, -6, 6), plain.position)
    assert refused(clipped) == {"force-saturated"}
    weak = HARDWARE.model_copy(update={"force_limit": ForceLimit(continuous=5.0, peak=9.0)})
    assert refused(plain, hardware=weak) == {"force-saturated"}


def test_a_force_of_the_wrong_sign() -> None:
    plain = homerehab(0.8, disturbance=5e-3)[0]
    turned = log(-plain.force, plain.position)
    assert "sign-flip" in refused(turned, hardware=HARDWARE)
    # A negative mass is no device, whatever is allowed.
    assert "sign-flip" in refused(turned, hardware=HARDWARE, allow=CODES)


def test_a_hand_against_a_virtual_damper_shows_the_controller() -> None:
    """F = -K·q - B·q̇ fits perfectly with damping -B."""
    time = np.arange(12000) * STEP
    place = counted(0.05 * np.sin(5 * time) + 0.03 * np.sin(11 * time), COUNT)
    velocity = np.diff(place, prepend=place[0]) / STEP
    assert "controller-identified" in refused(log(-300 * place - 20 * velocity, place))


def test_a_slow_log_does_not_tell_the_mass() -> None:
    time = np.arange(20000) * STEP
    axis = Axis(mass=0.005, damping=10.0)
    force = (2 * np.sin(0.7 * time))[:, None]
    push = 0.05 * np.random.default_rng(8).standard_normal(force.shape)
    place = counted(positions(axis, force, disturbance=push), 1e-4)[:, 0]
    hardware = Hardware(delay=quantity(0.0))
    assert "not-exciting-mass" in refused(log(force[:, 0], place), hardware=hardware)


def test_a_fast_log_does_not_tell_the_damping() -> None:
    time = np.arange(20000) * STEP
    axis = Axis(mass=3.0, damping=1.0)
    force = (12 * np.sin(130 * time))[:, None]
    push = 3.0 * np.random.default_rng(9).standard_normal(force.shape)
    place = counted(positions(axis, force, disturbance=push), COUNT)[:, 0]
    found = refused(log(force[:, 0], place), hardware=Hardware(delay=quantity(STEP * 0, 0.0, 2e-3)))
    assert found == {"not-exciting-damping"}


def test_a_device_without_damping_is_not_refused() -> None:
    axis = Axis(mass=3.0, damping=0.0)
    force = multisine(np.random.default_rng(10), samples=8000, runs=1, axis=axis)
    place = counted(positions(axis, force), COUNT)[:, 0]
    device = identify(log(force[:, 0], place), hardware=Hardware(delay=quantity(0.0))).device
    assert device.damping.low <= 0 <= device.damping.high


def test_every_refusal_of_a_log_is_listed_at_once() -> None:
    plain = homerehab()[0]
    clipped = np.clip(plain.force, -6, 6)
    stamps = plain.time + np.where(np.arange(len(plain)) > 700, 5.0, 0.0)
    bad = Trajectory(time=stamps, force=clipped, position=counted(plain.position, 2e-3))
    assert refused(bad) == {"force-saturated", "dropped-samples", "few-counts"}


WAVE = np.sin(2 * np.pi * 2 * np.arange(2000) * STEP)
ROWS = np.arange(2000.0)
SIGNS = (-1.0) ** np.arange(2000)
SPIKE = np.where(ROWS == 500, 1.0, 0.0)
WALK = np.random.default_rng(1).standard_normal(2000)
NOISE = np.random.default_rng(2).standard_normal(2000)
STRANGE: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
    "walks": (np.cumsum(WALK), np.cumsum(NOISE)),
    "noise": (WALK, NOISE),
    "impulse": (SPIKE, WAVE),
    "jump": (WAVE, SPIKE),
    "steps": (np.sign(WAVE), np.sign(WAVE)),
    "huge": (WAVE * 1e200, WAVE * 1e150),
    "tiny": (WAVE * 1e-200, WAVE * 1e-160),
    "ramps": (ROWS, ROWS),
    "alternating": (SIGNS, 1e-4 * SIGNS),
    "far away": (WAVE, 1e9 + WAVE * 1e-3),
    "growing": (np.exp(ROWS / 200), np.exp(ROWS / 200)),
    "one count": (WAVE, np.where(WAVE > 0, 1e-3, 0.0)),
    "shortest": (WAVE[:200], WAVE[:200]),
}


@pytest.mark.parametrize("allow", [(), CODES], ids=["strict", "all allowed"])
@pytest.mark.parametrize("method", ["auto", "output-error"])
@pytest.mark.parametrize("name", STRANGE)
def test_no_log_ends_in_anything_but_a_device_or_a_sentence(
    name: str, method: str, allow: tuple[str, ...]
) -> None:
    force, place = STRANGE[name]
    with suppress(IdentificationError):
        device = identify(log(force, place), method=method, allow=allow).device
        assert device.mass.low > 0
        assert device.simultaneous_box().mass[0] > 0
