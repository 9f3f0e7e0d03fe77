"""The certificate against the criterion that tunes: two assemblies, two arithmetics, one truth."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from identification import load_device, quantity, to_mapping, to_yaml
from tests.random_boxes import safe_gain as limit_of_corners
from tune import Scene, optimise
from tune.certificate.certify import certify, regions_of, setting_of
from tune.certificate.check import check
from tune.certificate.passivity import damping_for_passivity
from tune.certificate.plant import sampled_plant
from tune.certificate.polynomial import HandPoint, ModePoint, Point, Setting, precision
from tune.certificate.ripple import ripple_by_integration
from tune.certificate.roots import judge
from tune.certificate.words import NO_HAND, WITH_HAND
from tune.effects import Effects
from tune.errors import CheckFailedError
from tune.loop import Filters, Loop
from tune.profile import Design, digest_of
from tune.stability import safe_gain


def _case(seed: int) -> tuple[Point, Setting, Loop, Effects]:
    rng = np.random.default_rng(seed)
    mass, step = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-4, -2.5)
    damping = 0.0 if rng.random() < 0.1 else mass * 10 ** rng.uniform(-3, 2)
    delay = int(rng.integers(0, 4))
    cutoffs = [None if rng.random() < 0.3 else float(c) for c in rng.choice([20.0, 50.0], 2)]
    stiffness = 10 ** rng.uniform(-5, 0) * mass / step**2
    virtual_damping = rng.choice([0, 1, -0.01]) * 10 ** rng.uniform(-3, 0) * mass / step
    virtual_mass = rng.choice([0, 1, -0.3]) * 10 ** rng.uniform(-2, 0.5) * mass
    point = Point(mass=mass, damping=damping, sample_time=step, delay_samples=delay)
    setting = Setting(
        stiffness=stiffness,
        damping=virtual_damping,
        mass=virtual_mass,
        velocity_filter_hz=cutoffs[0],
        acceleration_filter_hz=cutoffs[1],
    )
    loop = Loop.from_numbers(
        mass=mass,
        damping=damping,
        sample_time=step,
        delay_samples=delay,
        filters=Filters(velocity_hz=cutoffs[0], acceleration_hz=cutoffs[1]),
    )
    effects = Effects(
        stiffness=stiffness, damping=virtual_damping or None, mass=virtual_mass or None
    )
    return point, setting, loop, effects


@pytest.mark.parametrize("block", range(4))
def test_the_gain_up_to_which_all_gains_are_stable_is_the_same(block: int) -> None:
    bounded = 0
    for seed in range(50 * block, 50 * block + 50):
        point, setting, loop, effects = _case(seed)
        gain = float(safe_gain(loop, effects))
        if gain == 0:
            assert judge(point, setting, 1e-6).answer != "stable"
        elif math.isinf(gain):
            assert judge(point, setting, 1e3).answer == "stable"
        else:
            bounded += 1
            assert judge(point, setting, gain * (1 - 1e-8)).answer == "stable"
            assert judge(point, setting, gain * (1 + 1e-8)).answer != "stable"
    assert bounded > 20


def test_a_gap_below_the_full_gain_is_found() -> None:
    """Stable at full gain and near zero, unstable between: not safe, because gains pass there."""
    delta = 0.0057
    point = Point(mass=1.0, damping=delta, sample_time=1.0, delay_samples=0)
    setting = Setting(
        stiffness=0.752,
        damping=0.211,
        mass=0.576,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    verdict = judge(point, setting, 1.0)
    assert verdict.radius < 1
    assert verdict.answer == "unstable"
    assert "crosses" in verdict.reason
    assert judge(point, setting, 0.039).answer == "stable"


def test_marginal_is_not_stable() -> None:
    """An undamped device under a virtual mass alone drifts for ever."""
    point = Point(mass=1.0, damping=0.0, sample_time=1e-3, delay_samples=0)
    setting = Setting(
        stiffness=0.0, damping=0.0, mass=0.5, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert judge(point, setting, 1.0).answer == "undecided"


def test_a_force_that_depends_on_position_is_named_as_not_assessed() -> None:
    device = load_device("homerehab")
    scene = Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})
    pulled = device.model_copy(update={"position_stiffness": quantity(5.0)})
    plain, sprung = (optimise(each, scene).certificate for each in (device, pulled))
    assert not any("position_stiffness" in each for each in plain.not_assessed)
    assert any("position_stiffness" in each for each in sprung.not_assessed)


def _two_bodies(point: Point) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Motor m₁ and handle m₂ on a spring and damper, the hand on the handle, in their own places.

    States x₁, x₂, ẋ₁, ẋ₂; the same mechanism that the mode of `point` states in modal coordinates.
    """
    mode, hand = point.modes[0], point.hand
    assert hand is not None
    share = mode.at_encoder**2  # m₂/m₁
    first = point.mass / (1 + share)
    second = point.mass - first
    reduced = first * second / point.mass
    omega = 2 * np.pi * mode.frequency_hz
    spring, damper = reduced * omega**2, 2 * mode.damping_ratio * omega * reduced
    stiffness = np.array([[spring, -spring], [-spring, spring + hand.stiffness]])
    # Damping of the rigid motion is spread over both bodies by their masses: it moves no mode.
    loss = np.array([[damper, -damper], [-damper, damper + hand.damping]])
    rigid = np.array([first, second]) / point.mass
    loss += point.damping * np.outer(rigid, rigid)
    inverse = np.diag([1 / first, 1 / (second + hand.mass)])
    motion = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ loss]])
    return motion, np.concatenate([np.zeros(2), inverse @ [1.0, 0.0]])


def _simulated(
    point: Point, motion: NDArray[np.float64], drive: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """x₁ at the samples after one sample of unit force, by the exponential between switchings."""
    step = point.sample_time
    edges = np.array([0.0, step]) + point.delay_samples * step
    times = np.union1d(np.arange(count) * step, edges)
    state, seen = np.zeros(len(drive)), {0.0: 0.0}
    for start, end in pairwise(times):
        force = float(edges[0] <= (start + end) / 2 < edges[1])
        augmented = np.zeros((len(drive) + 1,) * 2)
        augmented[:-1, :-1], augmented[:-1, -1] = motion, drive * force
        state = (expm(augmented * (end - start)) @ np.append(state, 1.0))[:-1]
        seen[float(end)] = float(state[0])
    return np.array([seen[float(t)] for t in np.arange(count) * step])


def _general(delay: float) -> Point:
    """1 kg of motor and 0.5 kg of handle at 40 Hz, in a hand."""
    return Point(
        mass=1.5,
        damping=3.0,
        sample_time=1e-3,
        delay_samples=delay,
        modes=(
            ModePoint(
                frequency_hz=40.0,
                damping_ratio=0.03,
                at_encoder=math.sqrt(0.5),
                at_handle=-math.sqrt(2.0),
            ),
        ),
        hand=HandPoint(mass=0.2, damping=4.0, stiffness=500.0),
    )


@pytest.mark.parametrize("delay", [0.0, 0.35, 1.0, 2.6])
def test_the_general_plant_is_two_bodies_on_a_spring_in_a_hand(delay: float) -> None:
    """The response of the polynomials in z against physical coordinates between the samples."""
    point = _general(delay)
    with precision():
        plant = sampled_plant(point)
        top, bottom = (
            [float(c) for c in p.coeffs()][::-1] for p in (plant.numerator, plant.denominator)
        )
    impulse = np.zeros(60)
    impulse[0] = 1.0
    top = [0.0] * (len(bottom) - len(top)) + top
    exact = _simulated(point, *_two_bodies(point), 60)
    assert not plant.integrates
    np.testing.assert_allclose(
        lfilter(top, bottom, impulse), exact, rtol=0, atol=1e-9 * exact.max()
    )


def test_without_anything_the_exponential_is_the_printed_plant() -> None:
    """A hand that weighs nothing, and a delay that is almost whole."""
    point = Point(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=1.0)
    nothing = HandPoint(mass=0.0, damping=0.0, stiffness=0.0)
    setting = Setting(
        stiffness=2000.0,
        damping=20.0,
        mass=0.5,
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
    )
    radii = [
        judge(each, setting, 1.0).radius
        for each in (
            point,
            replace(point, hand=nothing),
            replace(point, delay_samples=1 + 1e-12),
            replace(point, current_lag=1e-13),
        )
    ]
    np.testing.assert_allclose(radii, radii[0], rtol=1e-9)


def _low_passed(values: NDArray[np.float64], cutoff: float, step: float) -> NDArray[np.float64]:
    """A Butterworth filter of order two by matched poles."""
    pole = np.exp(-2 * np.pi * cutoff * step * (0.7071 + 1j * math.sqrt(1 - 0.7071**2)))
    trace, product = 2 * pole.real, abs(pole) ** 2
    return np.asarray(lfilter([1 - trace + product], [1.0, -trace, product], values))


def test_the_ripple_in_a_hand_is_the_sum_of_its_impulse_response() -> None:
    """C/(1 + GC) played as a filter, in two bodies whose plant is simulated between samples."""
    point = _general(1.35)
    setting = Setting(
        stiffness=300.0,
        damping=5.0,
        mass=0.1,
        velocity_filter_hz=60.0,
        acceleration_filter_hz=40.0,
        velocity_filter_order=2,
        filter_damping_ratio=0.7071,
    )
    count = 4000
    plant = _simulated(point, *_two_bodies(point), count)
    rate = np.diff(np.eye(count), axis=0, prepend=0.0)[:, 0] / point.sample_time
    bend = np.diff(rate, prepend=0.0) / point.sample_time
    law = (
        300.0 * (np.arange(count) == 0)
        + 5.0 * _low_passed(rate, 60.0, point.sample_time)
        + 0.1 * _low_passed(bend, 40.0, point.sample_time)
    )
    # F = -C·(noise + G·F), and G·C begins after at least one sample.
    loop = np.convolve(law, plant)[:count]
    force = np.zeros(count)
    for k in range(count):
        force[k] = -law[k] - np.dot(loop[1 : k + 1], force[:k][::-1])
    seen = ripple_by_integration(point, setting, 1e-5)
    assert seen == pytest.approx(1e-5 * math.sqrt(np.sum(force**2) / 12), rel=1e-3)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_passivity_of_a_spring_and_a_damper_by_the_known_condition(delay: int) -> None:
    """b > K·T/2 + |B| without a delay; a spring alone needs K·T·(1/2 + d) with d samples."""
    spring = Setting(
        stiffness=1000.0,
        damping=0.0,
        mass=0.0,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    needed = damping_for_passivity(spring, 1e-3, delay)
    assert needed == pytest.approx(1000.0 * 1e-3 * (0.5 + delay), rel=1e-6)
    for damping in (20.0, -20.0):
        both = replace(spring, damping=damping)
        assert damping_for_passivity(both, 1e-3) == pytest.approx(0.5 + 20.0, rel=1e-6)
    assert damping_for_passivity(replace(spring, mass=1.0, damping=10.0), 1e-3) == pytest.approx(
        2010.5, rel=1e-6
    )


def test_passivity_with_a_filter_by_the_energy_of_a_motion() -> None:
    """The sampled force takes from a sine at the worst frequency what the needed damping gives."""
    setting = Setting(
        stiffness=500.0,
        damping=15.0,
        mass=0.0,
        velocity_filter_hz=40.0,
        acceleration_filter_hz=None,
    )
    needed = damping_for_passivity(setting, 1e-3)
    unfiltered = damping_for_passivity(replace(setting, velocity_filter_hz=None), 1e-3)
    assert 0.25 < needed < unfiltered
    a = math.exp(-2 * np.pi * 40.0 * 1e-3)
    for angle in np.linspace(0.01, 3.1, 50):
        z = np.exp(1j * angle)
        law = 500.0 + 15.0 * (1 - a) * (z - 1) / (1e-3 * (z - a))
        taken = 1e-3 / 2 * ((1 - 1 / z) * law).real / (1 - math.cos(angle))
        assert taken <= needed * (1 + 1e-9)


def _design(**changes: object) -> Design:
    """A tuned scene on the homerehab, changed by hand before it is certified."""
    profile = optimise(
        load_device("homerehab"),
        Scene.model_validate(
            {"elements": {"wall": {"stiffness": 1500.0, "damping": 20.0}, "cup": {"mass": 1.0}}}
        ),
    )
    content = to_mapping(profile)
    for key in ("certificate", "digest"):
        content.pop(key)
    for element in content["elements"].values():
        element["margins"] |= {"gain": 2.0, "extra_delay_samples": 1.0}
        element |= {"ripple": 1.0, "rendered": None, "perceived_steps": {}}
    content["ripple_limit"] = 1.0
    content["device"] |= changes.pop("device", {})  # type: ignore[operator]
    return Design.model_validate(content | changes)


HAND = {
    "mass": {"value": 0.1, "low": 0.02, "high": 0.5},
    "damping": {"value": 5.0, "low": 2.0, "high": 20.0},
    "stiffness": {"value": 300.0, "low": 50.0, "high": 1500.0},
}
MODE = {
    "frequency_hz": {"value": 60.0, "low": 57.0, "high": 63.0},
    "damping_ratio": {"value": 0.05, "low": 0.04, "high": 0.06},
    "at_encoder": 0.3,
    "at_handle": -0.3,
}


def test_hand_mode_lag_and_part_of_a_sample_are_certified_and_said() -> None:
    design = _design(
        hand=HAND,
        device={
            "modes": [MODE],
            "current_lag": {"value": 2e-4, "low": 1e-4, "high": 3e-4},
            "delay": {"value": 1e-3, "low": 8e-4, "high": 1.2e-3},
        },
    )
    certificate = certify(design)
    assert set(certificate.interior) == {"wall", "cup"}
    assert certificate.hand is not None
    assert certificate.hand.stiffness == (50.0, 1500.0)
    assert certificate.modes[0].frequency_hz == (57.0, 63.0)
    assert certificate.current_lag == (1e-4, 3e-4)
    assert certificate.delay_samples == (0.8, 1.2)
    assert WITH_HAND in certificate.assumes
    assert NO_HAND not in certificate.assumes
    place = certificate.worst
    assert 0.8 - 1e-9 <= place.delay_samples <= 2.2 + 1e-9
    assert len(place.modes) == 1


def test_what_is_not_proved_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim a part in 10⁴ below the limit: true, but a hundred cells are too few to prove it."""
    design = _design()
    setting = setting_of(design, ("wall",))
    assert setting is not None
    limit = limit_of_corners(regions_of(design)[0], setting, extra=0.0)
    content = to_mapping(design)
    content["elements"]["wall"]["margins"]["gain"] = limit * (1 - 1e-4)
    edge = Design.model_validate(content)
    assert certify(edge).interior == {"wall": "proved", "cup": "proved"}
    monkeypatch.setattr("tune.certificate.certify.MOST_CELLS", 100)
    with pytest.raises(CheckFailedError, match="wall: not proved for every device") as failed:
        certify(edge)
    assert any("worst is a pole radius of 0.99" in words for words in failed.value.failures)


def test_a_hand_that_destabilises_is_named() -> None:
    design = _design(hand=HAND | {"damping": {"value": 0.1, "low": 0.0, "high": 0.2}})
    content = to_mapping(design)
    content["elements"]["cup"]["mass"] = -1.49
    with pytest.raises(CheckFailedError, match="cup in a hand: margin: unstable at mass"):
        certify(Design.model_validate(content))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mass": 2.0}, "certificate.worst is not a point of the box"),
        ({"delay_samples": 1.0}, "certificate.worst.pole_radius says"),
        ({"elements": ["cup"]}, "certificate.worst names cup, which is not felt"),
        ({"hand": {"mass": 0.1, "damping": 5.0, "stiffness": 300.0}}, "not a point of the box"),
        # A harmless point and its true radius: a worse one is there to be found.
        ({"elements": ["water"]}, "a worse one was found"),
    ],
)
def test_a_forged_worst_point_is_found_out(
    tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    scene = {"elements": {"wall": {"stiffness": 1500.0}, "water": {"damping": 20.0}}}
    profile = optimise(load_device("homerehab"), Scene.model_validate(scene))
    assert profile.certificate.worst.elements == ("wall",)
    content = to_mapping(profile)
    worst = content["certificate"]["worst"]
    worst |= changes
    if words.startswith("a worse"):
        setting = setting_of(profile, ("water",))
        assert setting is not None
        point = Point(
            **{key: worst[key] for key in ("mass", "damping", "sample_time", "delay_samples")}
        )
        worst["pole_radius"] = judge(point, setting, worst["gain"]).radius
    content["digest"] = digest_of(content)
    path = tmp_path / "profile.yaml"
    path.write_text(to_yaml(content), encoding="utf-8")
    with pytest.raises(CheckFailedError, match=words):
        check(path)
