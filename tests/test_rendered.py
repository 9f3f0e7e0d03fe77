"""What is felt of commanded effects: a hand moves a simulated device; quadrature in many digits."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Rig, simulate
from identification import Device, load_device, parse_document, quantity, to_mapping
from tests.commands import haptune
from tune import Scene, load_profile, optimise
from tune.documents.perception import default_table
from tune.documents.profile import SafeProfile, digest_of
from tune.loop.loop import Filters
from tune.optimisation.problem import DesignTask, Problem, pose
from tune.rendering import FASTEST, SLOWEST, Shares, impedances, rendered_mass_and_damping

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
SPRING, DAMPER, MASS = 150.0, 6.0, 0.8


def _filters(law: tuple[Any, ...]) -> Filters:
    velocity, acceleration, first, second, ratio, window, _, _ = law
    return Filters(
        velocity_filter_hz=velocity,
        acceleration_filter_hz=acceleration,
        velocity_filter_order=first,
        acceleration_filter_order=second,
        filter_damping_ratio=ratio,
        velocity_window_samples=window,
    )


def _felt_by_experiment(law: tuple[Any, ...], frequencies: FloatArray) -> ComplexArray:
    """A hand shakes the simulated device in a sine; force over velocity less that of the device."""
    velocity, acceleration, first, second, ratio, window, delay, lag = law
    samples, last = 12_000, 4_000
    time = T * np.arange(samples)
    log = simulate(
        Rig(mass=M, damping=B, sample_time=T, delay=delay * T, current_lag=lag),
        np.zeros((frequencies.size, samples)),
        controller=Controller(
            stiffness=SPRING,
            damping=DAMPER,
            mass=MASS,
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
    [*LAWS[1:3], *(pytest.param(each, marks=pytest.mark.long) for each in LAWS[::3])],
    ids=str,
)
def test_a_hand_that_shakes_a_simulated_device_feels_the_impedance(law: tuple[Any, ...]) -> None:
    frequencies = np.array([0.5, 2.0, 5.0])
    felt = impedances(
        _filters(law), frequencies, sample_time=T, delay=law[-2] * T, current_lag=law[-1]
    )
    expected = SPRING * felt.stiffness + DAMPER * felt.damping + MASS * felt.mass
    seen = _felt_by_experiment(law, frequencies)
    assert np.all(np.abs(seen - expected) < 2e-5 * np.abs(expected))


def _mean(part: Any) -> float:
    """Mean of a function of z over the logarithm of 0.5 to 5 Hz, in 30 digits."""
    with mpmath.workdps(30):
        total = mpmath.quad(
            lambda x: part(2 * mpmath.pi * mpmath.e**x), [mpmath.log(0.5), mpmath.log(5)]
        )
        return float(total / mpmath.log(10))


def test_means_are_those_of_adaptive_quadrature_in_many_digits() -> None:
    """The transfer functions of the README in z, one sample of delay, written anew."""
    device = load_device("homerehab")
    shares = Shares.of(device, Filters(velocity_filter_hz=50.0, acceleration_filter_hz=30.0))
    step = mpmath.mpf("0.001")

    def force(turn: Any, kind: str) -> Any:
        z = mpmath.expj(turn * step)
        a, b = mpmath.exp(-2 * mpmath.pi * 50 * step), mpmath.exp(-2 * mpmath.pi * 30 * step)
        law = {
            "K": mpmath.mpf(1),
            "B": (1 - a) * (z - 1) / (step * (z - a)),
            "M": ((1 - b) * (z - 1) / (step * (z - b))) ** 2,
        }[kind]
        hold = (1 - 1 / z) / (1j * turn * step)
        return law / z * hold / (1j * turn)

    for band, part in (
        (shares.mass, lambda t: mpmath.im(force(t, "M")) / t),
        (shares.damping, lambda t: mpmath.re(force(t, "B"))),
        (shares.damping_of_mass, lambda t: mpmath.re(force(t, "M"))),
        (shares.mass_of_damping, lambda t: mpmath.im(force(t, "B")) / t),
        (shares.damping_of_stiffness, lambda t: mpmath.re(force(t, "K"))),
    ):
        assert band.mean == pytest.approx(_mean(part), rel=1e-10)
        ends = [float(part(2 * mpmath.pi * f)) for f in (SLOWEST, FASTEST)]
        assert [band.slowest, band.fastest] == pytest.approx(ends, rel=1e-10)


def test_a_sharp_resonance_at_the_edge_is_summed_to_a_percent() -> None:
    device = load_device("homerehab")
    sharp = Filters(acceleration_filter_hz=5.0, filter_damping_ratio=0.1)

    def mass(turn: Any) -> Any:
        t = mpmath.mpf("0.001")
        z = mpmath.expj(turn * t)
        turns = 2 * mpmath.pi * 5 * t
        pole = mpmath.exp(-turns * (mpmath.mpf("0.1") + 1j * mpmath.sqrt(mpmath.mpf("0.99"))))
        low = abs(1 - pole) ** 2 / ((1 - pole / z) * (1 - mpmath.conj(pole) / z))
        law = low * ((1 - 1 / z) / t) ** 2
        return mpmath.im(law / z * (1 - 1 / z) / (1j * turn * t) / (1j * turn)) / turn

    assert Shares.of(device, sharp).mass.mean == pytest.approx(_mean(mass), rel=1e-2)


def test_a_pure_delay_turns_mass_into_damping_by_the_cosine_integral() -> None:
    """At a sample time that is next to nothing: κ = mean of cos(ωτ), Ci by Ci."""
    device = load_device("homerehab").model_copy(
        update={"sample_time": quantity(1e-7), "delay": quantity(0.02)}
    )
    shares = Shares.of(device, Filters())
    low, high = (2 * mpmath.pi * f * 0.02 for f in (0.5, 5.0))
    cosine = float((mpmath.ci(high) - mpmath.ci(low)) / mpmath.log(10))
    assert shares.mass.mean == pytest.approx(cosine, rel=1e-4)
    # Mean of ω·sin(ωτ): its integral over ln ω is -cos(ωτ)/τ.
    honey = float((mpmath.cos(low) - mpmath.cos(high)) / 0.02 / mpmath.log(10))
    assert shares.damping_of_mass.mean == pytest.approx(honey, rel=1e-4)


def _problem(device: Device, wish: dict[str, Any], filters: Filters) -> Problem:
    scene = Scene.model_validate({"elements": {"it": wish}})
    return pose(DesignTask.of(device, scene, default_table()), elements=["it"], filters=filters)


def test_steps_count_what_is_felt_of_a_command() -> None:
    """κ_a·M against m, by the impedance that the experiment above confirms."""
    device = load_device("homerehab")
    filters = Filters(velocity_filter_hz=10.0, acceleration_filter_hz=10.0)
    frequency = np.geomspace(0.5, 5.0, 2001)
    felt = impedances(filters, frequency, sample_time=1e-3, delay=1e-3)

    def mean(values: FloatArray) -> float:
        return float(np.sum((values[1:] + values[:-1]) / 2) / 2000)

    kept = {
        "mass": (mean(felt.mass.imag / (2 * np.pi * frequency)), 3.0, 0.225),
        "damping": (mean(felt.damping.real), 10.0, 0.267),
    }
    assert 0.8 < kept["mass"][0] < 0.9
    assert 0.9 < kept["damping"][0] < 0.96
    for effect, (share, reference, weber) in kept.items():
        unknown = _problem(device, {effect: "max"}, filters).unknowns[0]
        expected = np.log1p(share * 2.0 / reference) / np.log1p(weber)
        assert unknown.steps(2.0) == pytest.approx(expected, rel=2e-3)
        assert unknown.size_at(unknown.steps(2.0)) == pytest.approx(2.0)
    spring = _problem(device, {"stiffness": "max"}, filters).unknowns[0]
    bare = 0.8 / 0.01  # N of friction at 10 mm
    assert spring.steps(bare) == pytest.approx(np.log(2) / np.log1p(0.338), rel=2e-3)


def test_a_device_is_not_made_lighter_than_it_is_by_a_share_above_one() -> None:
    """A resonance in the band renders more mass than commanded; what is felt stays positive."""
    device = load_device("homerehab").model_copy(update={"mass": quantity(3.0)})
    sharp = Filters(acceleration_filter_hz=6.0, filter_damping_ratio=0.1)
    assert Shares.of(device, sharp).mass.mean > 1.2
    unknown = _problem(device, {"mass": "min"}, sharp).unknowns[0]
    assert np.isfinite(unknown.steps(unknown.high))


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


def test_a_spring_adds_no_mass_and_takes_damping() -> None:
    felt = rendered_mass_and_damping(
        load_device("homerehab"), Filters(), stiffness=1000.0, damping=0.0, mass=0.0
    )
    assert felt.mass == 0
    assert felt.damping == pytest.approx(-1.5, rel=1e-3)


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
