"""What is felt: contact with an element, what a hand feels of commands."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from datasets_synthetic import Controller, Rig, simulate
from identification import Device, load_device, quantity
from tests.unlimited import UNLIMITED
from tune import Effects, Filters, SafeProfile, Scene, optimise
from tune.rendering import contact

COUNT = 6e-6
MASS = Effects(mass=1.0)


#: Stiffness and damping of a wall fit for each named device, and its velocity filter, Hz.
WALLS: dict[str, tuple[float, float, float | None]] = {
    "homerehab": (1154.0, 82.0, 72.55),
    "stylus": (90.0, 1.2, 60.0),
    "knob": (0.06, 0.0005, None),
    "emps": (11700.0, 700.0, 100.0),
}


def _exactly(device: Device) -> Device:
    """The device without intervals."""
    sides = ("mass", "damping", "sample_time", "delay")
    return device.model_copy(update={s: quantity(getattr(device, s).value) for s in sides})


def _bounce(
    device: Device,
    wall: tuple[float, float, float | None],
    phase: float,
    *,
    one_sided: bool,
    samples: float,
) -> float:
    """Speed out over speed in of a rigid device, sample by sample, its motion in closed form."""
    (K, B, cutoff), T = wall, device.sample_time.value
    m, b = device.mass.value, device.damping.value
    whole, rate = round(samples), b / m
    pole = math.exp(-2 * math.pi * cutoff * T) if cutoff else 0.0

    def moved(x: float, v: float, force: float, time: float) -> tuple[float, float]:
        end = force / b
        left = math.exp(-rate * time)
        return x + end * time + (v - end) * (1 - left) / rate, end + (v - end) * left

    x, v = moved(0.0, 1.0, 0.0, phase * T)
    x -= B / K
    last, speed, sent = x - T, 1.0, [0.0] * whole
    for _ in range(20_000):
        speed = pole * speed + (1 - pole) * (x - last) / T
        last = x
        force = -(K * x + B * speed)
        if force >= 0 and (x <= 0 or not one_sided):
            for each in sent:
                x, v = moved(x, v, each, T)
            return max(0.0, -(v + rate * (x + B / K)))
        sent.append(min(force, 0.0))
        x, v = moved(x, v, sent.pop(0), T)
    return 0.0


@pytest.mark.parametrize("name", WALLS)
@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("damped", [False, True])
def test_bounces_as_the_motion_does(name: str, one_sided: bool, damped: bool) -> None:
    """Without intervals the stated range is that of the places between two samples, within 1 %."""
    device = _exactly(load_device(name))
    K, B, cutoff = WALLS[name]
    wall = (K, B if damped else 0.0, cutoff)
    samples = device.delay.value / device.sample_time.value
    found = [
        _bounce(device, wall, phase, one_sided=one_sided, samples=samples)
        for phase in np.linspace(0.02, 1.0, 25)
    ]
    low, high = _stated(device, wall, one_sided=one_sided)
    assert low <= min(found)
    assert max(found) <= high
    assert high - low <= 3 * (max(found) - min(found)) + 0.01 * max(found)


def _stated(
    device: Device, wall: tuple[float, float, float | None], *, one_sided: bool
) -> tuple[float, float]:
    K, B, cutoff = wall
    element = (
        _tuned()
        .elements["wall"]
        .model_copy(update={"stiffness": K, "damping": B, "one_sided": one_sided})
    )
    filters = Filters(velocity_filter_hz=cutoff)
    found = contact(device, device.simultaneous_box(), filters, element, 1.0).restitution
    assert found is not None
    return found


def test_with_a_mode_a_lag_and_part_of_a_sample_of_delay() -> None:
    """In tenths of a step, by scipy's exponential of the mechanism's matrix."""
    m, b, T, K, B, lag, tenths = 3.0, 10.0, 1e-3, 1500.0, 30.0, 0.002, 13
    omega, ratio, share = 2 * math.pi * 60.0, 0.02, -0.5
    motion = np.zeros((6, 6))  # q, mode, speeds, force of the actuator, command
    motion[0, 2] = motion[1, 3] = 1.0
    motion[2, [2, 4]] = -b / m, 1 / m
    motion[3, [1, 3, 4]] = -(omega**2), -2 * ratio * omega, share / m
    motion[4, [4, 5]] = -1 / lag, 1 / lag
    step = expm(motion * T / 10)
    pole = math.exp(-2 * math.pi * 50.0 * T)
    found: list[float] = []
    for phase in range(1, 11):
        x = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        for _ in range(phase):
            x = step @ x
        x[0] -= B / K
        last, speed, sent, inside, out = x[0] - T, 1.0, [0.0] * tenths, True, 0
        while out < 200:
            reading = x[0] + share * x[1]
            speed = pole * speed + (1 - pole) * (reading - last) / T
            force = min(0.0, -(K * reading + B * speed))
            last, inside = reading, inside and not (force == 0 and reading <= 0)
            out += not inside
            sent += [force if inside else 0.0] * 10
            for _ in range(10):
                x[5] = sent.pop(0)
                x = step @ x
        found.append(-(x[2] + b / m * (x[0] + B / K)))
    mode = {"frequency_hz": 60.0, "damping_ratio": 0.02, "at_encoder": share, "at_handle": 1.0}
    stated = load_device("homerehab").model_dump(by_alias=True) | {
        "mass": m,
        "damping": b,
        "sample_time": T,
        "delay": 0.0013,
        "current_lag": lag,
        "modes": [mode],
    }
    low, high = _stated(Device.model_validate(stated), (K, B, 50.0), one_sided=True)
    assert low <= min(found)
    assert max(found) <= high
    assert high - low < 0.02 * max(found)


@functools.cache
def _tuned() -> SafeProfile:
    elements: dict[str, Any] = {
        "wall": {"stiffness": 800.0, "damping": 30.0, "one_sided": True, "speed": 0.3},
        "cup": {"mass": 1.0, "damping": 30.0},
    }
    filters = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}
    filters |= {"filter_damping_ratio": 0.5}
    scene = Scene.model_validate({"elements": elements, "loop": filters})
    return optimise(load_device("homerehab"), scene)


def test_depth_force_and_energy_are_those_of_the_stated_motion() -> None:
    wall, cup = (_tuned().elements[name].contact for name in ("wall", "cup"))
    assert wall is not None
    assert cup is not None
    assert wall.depth_at_continuous_force == pytest.approx(14.0 / 800.0, rel=1e-3)
    assert wall.depth_at_peak_force == pytest.approx(28.0 / 800.0, rel=1e-3)
    assert wall.force_on_entry == pytest.approx(0.3 * 800.0 * 0.001, rel=1e-3)
    assert wall.net_damping == pytest.approx(30.0 - 800.0 * 0.0025, rel=1e-3)
    assert wall.lead == pytest.approx(0.3 * (30.0 / 800.0 - 0.0015), rel=1e-3)
    assert wall.energy_per_entry is None
    assert cup.restitution is None
    assert cup.force_on_entry == pytest.approx(0.2 * 30.0, rel=1e-3)
    mass = _tuned().elements["cup"].mass
    assert cup.energy_per_entry == pytest.approx(0.5 * mass * 0.2**2, rel=1e-3)


FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

M, B, T = 3.0, 10.0, 0.001

#: (velocity, acceleration cut-off, orders, damping ratio, window, delay in samples, current lag).
LAWS: list[tuple[float | None, float | None, int, int, float, int | None, float, float]] = [
    (50.0, 70.0, 1, 2, 1.0, None, 1.0, 0.0),
    (60.0, 90.0, 2, 2, 0.7071, None, 2.4, 0.0),
    (80.0, 40.0, 1, 1, 1.0, None, 0.0, 0.0),
    (None, 60.0, 1, 2, 0.3, 15, 1.7, 0.0),
    (50.0, 150.0, 1, 1, 1.0, None, 1.0, 0.004),
]
#: Keys of a scene for the first five.
KEYS = (
    *("velocity_filter_hz", "acceleration_filter_hz"),
    *("velocity_filter_order", "acceleration_filter_order", "filter_damping_ratio"),
)
SPRING, DAMPER, WEIGHT = 150.0, 6.0, 0.8
WORDS = ("stiffness", "damping", "mass")


def _felt_by_experiment(
    law: tuple[Any, ...], frequencies: FloatArray, sizes: tuple[float, float, float]
) -> ComplexArray:
    """A hand shakes the simulated device in a sine; force over velocity less that of the device."""
    velocity, acceleration, first, second, ratio, window, delay, lag = law
    samples, last = 12_000, 4_000
    time = T * np.arange(samples)
    log = simulate(
        Rig(mass=M, damping=B, sample_time=T, delay=delay * T, current_lag=lag),
        np.zeros((frequencies.size, samples)),
        controller=Controller(
            stiffness=sizes[0],
            damping=sizes[1],
            mass=sizes[2],
            velocity_filter_hz=velocity or np.inf,
            acceleration_filter_hz=acceleration or np.inf,
            velocity_filter_order=first,
            acceleration_filter_order=second,
            filter_damping_ratio=ratio,
            velocity_window_samples=window or 1,
        ),
        push=np.sin(2 * np.pi * frequencies[:, None] * time),
    )
    turn = 2j * np.pi * frequencies
    waves = np.exp(-turn[:, None] * time[-last:]) * 2 / last
    position = np.sum(log.position[:, -last:] * waves, axis=1)
    # The push is held: a sine of this amplitude at its own frequency, beside its images.
    held = -1j * (1 - np.exp(-turn * T)) / (turn * T)
    return held / (turn * position) - B - turn * M


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_a_hand_that_shakes_a_simulated_device_feels_what_the_profile_says(
    law: tuple[Any, ...],
) -> None:
    """At 0.5 and 5 Hz, to the four digits written; a spring keeps its imaginary part."""
    facts = {"mass": M, "damping": B, "delay": law[-2] * T}
    facts |= {"current_lag": law[-1]} if law[-1] else {}
    device = load_device("homerehab").model_copy(
        update={name: quantity(value) for name, value in facts.items()} | UNLIMITED
    )
    elements = {
        "rail": {"stiffness": SPRING, "damping": DAMPER},
        "cup": {"mass": WEIGHT, "damping": 2 * DAMPER},
    }
    loop = {key: value or "none" for key, value in zip(KEYS, law[:5], strict=True)}
    if law[5]:
        loop = {"velocity_window_samples": law[5]} | {
            k: loop[k] for k in KEYS if "velocity" not in k
        }
    profile = optimise(device, Scene.model_validate({"elements": elements, "loop": loop}))
    turn = 2 * np.pi * np.array([0.5, 5.0])
    for name in ("rail", "cup"):
        element = profile.elements[name]
        sizes = (element.stiffness, element.damping, element.mass)
        assert sizes == tuple(elements[name].get(each, 0.0) for each in WORDS)
        felt = _felt_by_experiment(law, turn / 2 / np.pi, sizes)
        said = element.rendered
        assert said is not None
        np.testing.assert_allclose(said.damping_at_ends, felt.real, rtol=5e-4)
        if name == "cup":
            np.testing.assert_allclose(said.mass_at_ends, felt.imag / turn, rtol=5e-4)


def test_wanted_values_are_met_and_reported_as_felt() -> None:
    elements = {
        "cup": {"mass": 1.0, "damping": 30.0},
        "rail": {"stiffness": 800.0, "damping": 10.0},
    }
    loop = {"velocity_filter_hz": 200.0, "acceleration_filter_hz": 40.0}
    scene = Scene.model_validate({"elements": elements, "loop": loop, "ripple_limit": 1.0})
    played = optimise(load_device("homerehab"), scene).elements
    cup, rail = played["cup"], played["rail"]
    assert (cup.mass, rail.stiffness, rail.damping) == (1.0, 800.0, 10.0)
    assert cup.rendered is not None
    assert rail.rendered is not None
    # What the damper takes away from the mass is that of the rail's, three times.
    own = [
        whole - 3 * taken
        for whole, taken in zip(
            (cup.rendered.mass, *cup.rendered.mass_at_ends),
            (rail.rendered.mass, *rail.rendered.mass_at_ends),
            strict=True,
        )
    ]
    # (1-x²)/(1+x²)² of a mass through two poles, x = f/40 Hz; delay and hold take a little more.
    assert own[1] == pytest.approx(1.0, abs=0.005)
    assert own[2] == pytest.approx((1 - 1 / 64) / (1 + 1 / 64) ** 2, abs=0.04)
    assert cup.perceived_steps["mass"] == pytest.approx(
        np.log1p(own[0] / 3.0) / np.log1p(0.225), rel=2e-3
    )
    assert cup.perceived_steps["mass"] < 0.995 * np.log1p(1 / 3) / np.log1p(0.225)
    assert cup.rendered.damping > 1
    # The spring takes about K·1.5 ms of damping, the damper B·(lag of its pole + 2 ms) of mass.
    assert rail.rendered.damping == pytest.approx(10.0 - 800 * 0.0015, abs=0.15)
    late = 0.001 / np.expm1(2 * np.pi * 200 * 0.001) + 0.002
    assert rail.rendered.mass == pytest.approx(-10 * late, rel=0.01)
