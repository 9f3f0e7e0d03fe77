"""What is felt of commanded effects: a hand moves a simulated device; quadrature in many digits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Rig, simulate
from identification import load_device, parse_document, quantity, to_mapping
from tests.commands import digest_of, haptune
from tests.unlimited import UNLIMITED
from tune import SafeProfile, Scene, load_profile, optimise

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

M, B, T = 3.0, 10.0, 0.001

#: (velocity, acceleration cut-off, orders, damping ratio, window, delay in samples, current lag).
LAWS: list[tuple[float | None, float | None, int, int, float, int | None, float, float]] = [
    (50.0, 30.0, 1, 2, 1.0, None, 1.0, 0.0),
    (20.0, 12.0, 2, 2, 0.7071, None, 2.4, 0.0),
    (80.0, 40.0, 1, 1, 1.0, None, 0.0, 0.0),
    (None, 60.0, 1, 2, 0.3, 15, 1.7, 0.0),
    (50.0, 30.0, 1, 2, 1.0, None, 1.0, 0.004),
]
#: Keys of a scene for the first five.
KEYS = (
    *("velocity_filter_hz", "acceleration_filter_hz"),
    *("velocity_filter_order", "acceleration_filter_order", "filter_damping_ratio"),
)
SPRING, DAMPER, MASS = 150.0, 6.0, 0.8


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


@pytest.mark.parametrize(
    "law",
    [*LAWS[1:4], *(pytest.param(each, marks=pytest.mark.long) for each in LAWS[::4])],
    ids=str,
)
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
        "cup": {"mass": MASS, "damping": 10 * DAMPER},
    }
    loop = {key: value or "none" for key, value in zip(KEYS, law[:5], strict=True)}
    if law[5]:
        loop = {"velocity_window_samples": law[5]} | {
            k: loop[k] for k in KEYS if "velocity" not in k
        }
    profile = optimise(device, Scene.model_validate({"elements": elements, "loop": loop}))
    turn = 2 * np.pi * np.array([0.5, 5.0])
    for name, sizes in (("rail", (SPRING, DAMPER, 0.0)), ("cup", (0.0, 10 * DAMPER, MASS))):
        felt = _felt_by_experiment(law, turn / 2 / np.pi, sizes)
        said = profile.elements[name].rendered
        assert said is not None
        np.testing.assert_allclose(said.damping_at_ends, felt.real, rtol=3e-4)
        if name == "cup":
            np.testing.assert_allclose(said.mass_at_ends, felt.imag / turn, rtol=3e-4)


def test_wanted_values_are_met_as_commanded_and_reported_as_felt() -> None:
    device = load_device("homerehab")
    scene = Scene.model_validate(
        {
            "elements": {
                "cup": {"mass": 1.0, "damping": 80.0},
                "rail": {"stiffness": 800.0, "damping": 10.0},
            },
            "loop": {"velocity_filter_hz": 30.0, "acceleration_filter_hz": 20.0},
        }
    )
    profile = optimise(device, scene)
    cup, rail = profile.elements["cup"], profile.elements["rail"]
    assert cup.mass == 1.0
    assert rail.stiffness == 800.0
    assert rail.damping == 10.0
    assert cup.rendered is not None
    assert rail.rendered is not None
    # What the damper takes away from the mass is that of the rail's, eight times.
    own = [
        whole - 8 * taken
        for whole, taken in zip(
            (cup.rendered.mass, *cup.rendered.mass_at_ends),
            (rail.rendered.mass, *rail.rendered.mass_at_ends),
            strict=True,
        )
    ]
    # (1-x²)/(1+x²)² of a mass through two poles, x = f/20 Hz; delay and hold take a little more.
    assert own[1] == pytest.approx(1.0, abs=0.005)
    assert own[2] == pytest.approx((1 - 1 / 16) / (1 + 1 / 16) ** 2, abs=0.04)
    assert cup.perceived_steps["mass"] == pytest.approx(
        np.log1p(own[0] / 3.0) / np.log1p(0.225), rel=2e-3
    )
    assert cup.perceived_steps["mass"] < 0.99 * np.log1p(1 / 3) / np.log1p(0.225)
    assert cup.rendered.damping > 1
    # The spring takes about K·1.5 ms of damping, the damper about B·(1/(2π·30) + 2 ms) of mass.
    assert rail.rendered.damping == pytest.approx(10.0 - 800 * 0.0015, abs=0.15)
    assert rail.rendered.mass == pytest.approx(-10 * (1 / (2 * np.pi * 30) + 0.002), rel=0.1)


def test_a_profile_from_before_still_loads_and_has_to_be_tuned_again(tmp_path: Any) -> None:
    """Without the apparent values, as older files are."""
    profile = optimise(
        load_device("homerehab"), Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})
    )
    content = to_mapping(profile)
    for element in content["elements"].values():
        del element["rendered"]
    content["digest"] = digest_of(content)
    older = parse_document(SafeProfile, content, tmp_path / "older.yaml")
    path = tmp_path / "profile.yaml"
    path.write_text(older.to_yaml(), encoding="utf-8")
    assert "rendered" not in path.read_text(encoding="utf-8")
    assert load_profile(path).elements["wall"].rendered is None
    ended = haptune("check", str(path))
    assert ended.code == 6
    assert "wall: rendered is missing. Tune again" in ended.err
