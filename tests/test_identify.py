"""identify: truth recovered with honest intervals, what is asked for, what is refused."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from identification import (
    Device,
    ForceLimit,
    Hardware,
    Identification,
    IdentificationError,
    InvalidInputError,
    LogRefusedError,
    Method,
    Trajectory,
    UsageError,
    as_stored,
    devices_picture,
    examine,
    identify,
    quantity,
)
from identification.estimators import ESTIMATORS
from identification.findings import CODES
from tests.exact_axis import Axis, closed_loop, counted, fleet, logged, multisine, positions
from tests.findings import refusals
from tests.simulated.families import FAMILIES
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 1e-3
COUNT = 6e-6
HARDWARE = Hardware(
    name="homerehab",
    motion="linear",
    sample_time=quantity(STEP),
    delay=quantity(STEP),
    encoder_resolution=quantity(COUNT),
    force_limit=ForceLimit(continuous=14.0, peak=28.0),
)
NAMES = ("mass", "damping", "coulomb_friction", "force_offset")


def log(force: Array, position: Array, step: float = STEP, **kind: Any) -> Trajectory:
    time: Array = np.arange(force.size) * np.float64(step)
    return Trajectory(time=time, force=force, position=position, **{"motion": "linear", **kind})


@cache
def homerehab(
    coulomb: float = 0.0,
    *,
    disturbance: float = 0.0,
    noise: float = 0.0,
    runs: int = 3,
    samples: int = 8000,
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


def codes(found: Identification) -> set[str]:
    return {finding.code for finding in found.findings}


def holds(found: Identification, truth: dict[str, float]) -> NDArray[np.bool_]:
    inside: list[bool] = []
    for name, value in truth.items():
        interval = getattr(found.device, name)
        inside.append(interval.low <= value <= interval.high)
    return np.array(inside)


def test_clean_logs_are_right_to_a_thousandth() -> None:
    for trajectory in homerehab():
        found = identify(trajectory, hardware=HARDWARE)
        assert found.device.mass.value == pytest.approx(3.0, rel=1e-4)
        assert found.device.damping.value == pytest.approx(10.0, rel=1e-4)
        assert found.method == "output-error"
        assert not found.findings


@pytest.mark.long
def test_friction_and_unknown_force_cost_less_than_a_per_cent() -> None:
    for trajectory in homerehab(0.8, disturbance=5e-3, samples=20_000):
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
def test_coverage(coulomb: float, disturbance: float, noise: float, method: Method) -> None:
    """95 % intervals hold the truth in at least 93 % of 300 logs."""
    logs = homerehab(
        coulomb, disturbance=disturbance, noise=noise, runs=300, samples=20_000, seed=1
    )
    truth = {"mass": 3.0, "damping": 10.0, "coulomb_friction": coulomb, "force_offset": 0.0}
    found = [identify(each, hardware=HARDWARE, method=method) for each in logs]
    assert np.all(np.mean([holds(each, truth) for each in found], axis=0) >= 0.93)


def check_fleet(runs: int, seed: int) -> None:
    axis, force, place, _ = fleet(runs, seed)
    mass, damping = np.asarray(axis.mass), np.asarray(axis.damping)
    for i in range(runs):
        trajectory = log(force[:, i], place[:, i], axis.sample_time)
        for hardware in (Hardware(delay=quantity(axis.delay)), None):
            found = identify(trajectory, hardware=hardware)
            box = found.device.simultaneous_box()
            assert box.mass[0] <= mass[i] <= box.mass[1]
            assert box.damping[0] <= damping[i] <= box.damping[1]
            assert found.device == as_stored(found.device)


@pytest.mark.long
def test_the_simultaneous_box_holds_devices_of_every_size() -> None:
    check_fleet(runs=8, seed=2)


@pytest.mark.parametrize("shape", thinned(["square", "chirp", "prbs", "sine", "moves"], 1))
def test_no_usual_excitation_is_refused(shape: str) -> None:
    time = np.arange(12000) * STEP
    generator = np.random.default_rng(3)
    move, part = np.divmod(time / 0.5, 1.0)  # each of minimum jerk, to a random place
    places = generator.uniform(-0.06, 0.06, 25)[np.stack((move, move + 1)).astype(np.intp)]
    path = places[0] + (places[1] - places[0]) * part**3 * (10 - 15 * part + 6 * part**2)
    speed = np.gradient(path, STEP)
    force = {
        "square": 8 * np.sign(np.sin(9.4 * time + 0.1)),
        "prbs": np.repeat(generator.choice([-6.0, 6.0], 120), 100),
        "chirp": 10 * np.sin(2 * np.pi * (0.3 * time + 0.3 * time**2)),
        "sine": 6 * np.sin(6.3 * time),
        "moves": 3 * np.gradient(speed, STEP) + 10 * speed + 0.8 * np.sign(speed),
    }[shape]
    axis = Axis(coulomb=0.8, delay=STEP)
    push = 5e-3 * generator.standard_normal(force.size)
    found = identify(logged(axis, force, disturbance=push), hardware=HARDWARE)
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


@pytest.mark.parametrize(("coulomb", "push"), thinned([(0.8, 5e-3), (0.0, 0.0), (0.8, 0.2)], 1))
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


def _nothing_changes(force: float, length: float, time: float, shift: float, turn: float) -> None:
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


#: Sizes of force, length and time, shift of the clock and direction of another log.
CHANGED = given(
    force=st.floats(-2, 2).map(lambda power: 10**power),
    length=st.floats(-3, 3).map(lambda power: 10**power),
    time=st.floats(-1, 1).map(lambda power: 10**power),
    shift=st.floats(-5, 5),
    turn=st.sampled_from([1.0, -1.0]),
)


@settings(max_examples=4)
@CHANGED
def test_units_shifts_and_direction_change_nothing(
    force: float, length: float, time: float, shift: float, turn: float
) -> None:
    _nothing_changes(force, length, time, shift, turn)


@pytest.mark.parametrize("time", [0.11, 0.04])
def test_a_delay_of_few_of_many_fast_samples_is_found(time: float) -> None:
    """At 9 and 25 kHz, where the first scan for it takes steps of several samples."""
    _nothing_changes(1.0, 1.0, time, 0.0, 1.0)


@pytest.mark.parametrize("samples", thinned([2.5, 0.0, 1.0], 1))
def test_delay_stated_assumed_or_read(samples: float) -> None:
    axis = Axis(delay=samples * STEP)
    trajectory = logged(
        axis, multisine(np.random.default_rng(5), samples=8000, runs=1, axis=axis)[:, 0]
    )
    found = identify(trajectory)
    assert codes(found) == {"not-stated"}
    assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)
    assert found.logs[0].delay is not None
    assert found.logs[0].delay.value == pytest.approx(samples * STEP, abs=2e-5)
    stored = found.device.delay
    assert stored.value == pytest.approx(max(samples, 1.0) * STEP, rel=1e-2)
    assert stored.source == "log"
    assert stored.low <= samples * STEP <= stored.high
    assert stored.high >= STEP
    assert "delay" not in found.device.missing
    stated = identify(trajectory, hardware=Hardware(delay=quantity(samples * STEP)))
    assert stated.device.delay.value == samples * STEP
    assert stated.device.delay.source == "hardware"
    assert "delay" not in stated.findings[0].seen


def test_hardware_is_kept_and_what_it_leaves_open_is_read() -> None:
    trajectory = homerehab()[0]
    device = identify(trajectory, hardware=HARDWARE).device
    assert device.name == "homerehab"
    assert device.sample_time.source == "hardware"
    assert device.encoder_resolution == quantity(COUNT, source="hardware")
    assert device.force_limit == HARDWARE.force_limit
    assert device.missing == ()
    found = identify(replace(trajectory, motion=None))
    assert codes(found) == {"not-stated"}
    (said,) = found.findings
    for fact in ("motion", "delay", "force_limit", "encoder_resolution"):
        assert fact in said.seen
    bare = found.device
    assert bare.missing == ("motion", "sample_time", "encoder_resolution", "force_limit")
    assert bare.encoder_resolution is not None
    assert bare.encoder_resolution.value == pytest.approx(COUNT, rel=1e-6)
    assert bare.encoder_resolution.source == "log"
    assert bare.force_limit is not None
    assert bare.force_limit.peak == pytest.approx(np.abs(trajectory.force).max(), rel=1e-9)
    assert bare.force_limit.continuous == bare.force_limit.peak
    assert bare.force_limit.source == "log"
    assert bare.sample_time.value == pytest.approx(STEP, rel=1e-9)
    assert bare.sample_time.source == "log"
    assert bare.logs[0].findings == ("not-stated",)


def test_sample_times_that_contradict() -> None:
    trajectory = homerehab()[0]
    with pytest.raises(InvalidInputError, match=r"0\.001.*0\.0013"):
        identify(trajectory, hardware=Hardware(sample_time=quantity(0.0013)))
    assert refusals(trajectory, Hardware(sample_time=quantity(0.0005))) == {"dropped-samples"}
    close = Hardware(sample_time=quantity(0.001005), delay=quantity(STEP))
    assert identify(trajectory, hardware=close).device.sample_time.value == 0.001005


@pytest.mark.parametrize("delay", [1e3, 1e6, 1e9])
def test_a_delay_that_is_no_small_part_of_the_log_is_refused(delay: float) -> None:
    with pytest.raises(InvalidInputError, match=r"lasts .* s.*a delay of .* at most 0\.1 times"):
        identify(homerehab()[0], hardware=Hardware(delay=quantity(delay)))


def test_several_logs_give_their_envelope() -> None:
    poses: list[Trajectory] = []
    for mass in (2.8, 3.0, 3.3):
        axis = Axis(mass=mass, delay=STEP)
        force = multisine(np.random.default_rng(6), samples=6000, runs=1, axis=axis)
        poses.append(logged(axis, force[:, 0]))
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
    with pytest.raises(UsageError, match="auto, least-squares, instruments, output-error"):
        identify(trajectory, method="guess")  # pyright: ignore[reportArgumentType]
    with pytest.raises(UsageError, match="nonsense"):
        identify(trajectory, allow=["jitter", "nonsense"])
    with pytest.raises(UsageError):
        identify([])


@pytest.mark.parametrize("method", ESTIMATORS)
def test_a_method_can_be_asked_for(method: Method) -> None:
    found = identify(homerehab()[0], hardware=HARDWARE, method=method)
    assert found.method == method
    assert "as asked" in found.reason
    assert found.method in repr(found)
    assert len(repr(found)) < 300


def test_terms_stay_unless_they_are_noise() -> None:
    none = identify(homerehab()[1], hardware=HARDWARE)
    assert none.device.coulomb_friction.low == 0
    assert none.device.coulomb_friction.value < 1e-4
    covariance = none.device.covariance
    assert covariance is not None
    assert covariance.parameters == NAMES
    small = identify(homerehab(0.02, runs=1)[0], hardware=HARDWARE)
    assert small.device.coulomb_friction.value == pytest.approx(0.02, abs=2e-3)


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
    keep[[500, 501, 6000]] = False
    gaps = Trajectory(time=plain.time[keep], force=plain.force[keep], position=plain.position[keep])
    found = identify(gaps, hardware=HARDWARE)
    (seen,) = [each.seen for each in found.findings if each.code == "dropped-samples"]
    assert "2 gaps, about 3 samples lost" in seen
    assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)


def test_a_force_of_the_wrong_sign() -> None:
    """A negative mass is no device, whatever is allowed."""
    plain = homerehab(0.8, disturbance=5e-3)[0]
    turned = log(-plain.force, plain.position)
    with pytest.raises(LogRefusedError, match="sign-flip"):
        identify(turned, hardware=HARDWARE, allow=CODES)


def test_a_device_without_damping_is_not_refused() -> None:
    axis = Axis(mass=3.0, damping=0.0)
    force = multisine(np.random.default_rng(10), samples=8000, runs=1, axis=axis)[:, 0]
    device = identify(logged(axis, force), hardware=Hardware(delay=quantity(0.0))).device
    assert device.damping.low <= 0 <= device.damping.high


def test_every_refusal_of_a_log_is_listed_at_once() -> None:
    plain = homerehab()[0]
    clipped = np.clip(plain.force, -6, 6)
    stamps = plain.time + np.where(np.arange(len(plain)) > 700, 5.0, 0.0)
    bad = Trajectory(time=stamps, force=clipped, position=counted(plain.position, 2e-3))
    assert refusals(bad) == {"force-saturated", "dropped-samples", "few-counts"}


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
@pytest.mark.parametrize("method", thinned(["auto", "output-error"], 1))
@pytest.mark.parametrize("name", STRANGE)
def test_no_log_ends_in_anything_but_a_device_or_a_sentence(
    name: str, method: Method, allow: tuple[str, ...]
) -> None:
    force, place = STRANGE[name]
    with suppress(IdentificationError):
        device = identify(log(force, place), method=method, allow=allow).device
        assert device.mass.low > 0
        assert device.simultaneous_box().mass[0] > 0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda _: identify(cast("Any", "log.csv")), "'log.csv' is no log that was read"),
        (lambda _: examine(cast("Any", "log.csv")), "'log.csv' is no log that was read"),
        (lambda seen: identify(seen, allow="jiter"), "jiter is no finding"),
        (lambda seen: replace(seen, motion="sliding"), "motion: is 'sliding'. Give 'linear'"),
        (lambda seen: replace(seen, force=seen.force * 1j), "force: is complex. Give real"),
        (lambda seen: replace(seen, force=seen.force[1:]), "'force': (499,)"),
        (lambda seen: replace(seen, time=None), "'time': ()"),
        (lambda _: devices_picture({}), "devices: none given"),
    ],
)
def test_a_wrong_request_from_python_is_a_sentence(
    wrong: Callable[[Any], object], words: str
) -> None:
    time = 1e-3 * np.arange(500, dtype=np.float64)
    seen = Trajectory(time=time, force=np.sin(9 * time), position=np.cos(9 * time))
    with pytest.raises(UsageError, match=re.escape(words)):
        wrong(seen)
