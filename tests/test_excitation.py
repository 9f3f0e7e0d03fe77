"""Planned forces: limits, intervals, gentle first plays, and plans as they are asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Rig, simulate
from identification import (
    Device,
    Excitation,
    ExcitationSpec,
    ForceLimit,
    Hardware,
    InvalidInputError,
    Trajectory,
    identify,
    load_excitation,
    parse_document,
    plan_excitation,
    quantity,
    to_mapping,
    to_yaml,
)
from identification.planning.information import predict
from identification.planning.limits import Guess
from tests.commands import files, form, haptune
from tests.exact_axis import Axis, counted, positions
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 0.001

LIMITS: dict[str, dict[str, Any]] = {
    "homerehab": {
        "mass": 3.0,
        "damping": 10.0,
        "force": 14.0,
        "travel": 0.1,
        "speed": 1.0,
        "encoder_resolution": 6e-6,
        "position_noise": 3e-6,
    },
    "stylus": {
        "mass": 0.05,
        "damping": 0.2,
        "force": 0.9,
        "travel": 0.05,
        "speed": 0.6,
        "encoder_resolution": 2e-5,
        "position_noise": 1e-5,
    },
    "knob": {
        "motion": "rotary",
        "mass": 1e-4,
        "damping": 5e-4,
        "force": 0.05,
        "travel": 1.0,
        "speed": 15.0,
        "encoder_resolution": 7.7e-4,
        "position_noise": 3.9e-4,
    },
}


def spec(name: str = "homerehab", duration: float = 4.0, **others: Any) -> ExcitationSpec:
    given = {"sample_time": STEP, "duration": duration, "ramp": 0.3} | LIMITS[name] | others
    return parse_document(ExcitationSpec, given, "spec")


@cache
def planned(name: str, duration: float = 3.0, friction: float = 0.0) -> Excitation:
    return plan_excitation(spec(name, duration, coulomb_friction=friction))


def rig_of(plan: ExcitationSpec, **others: Any) -> Rig:
    given: dict[str, Any] = {
        "mass": plan.mass.value,
        "damping": plan.damping.value,
        "coulomb_friction": plan.coulomb_friction.value,
        "sample_time": plan.sample_time,
    }
    return Rig(**(given | others))


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """What is guessed, and the device as it is: up to two times off, pulled by up to 2 %."""

    guesses: dict[str, Any]
    axis: Axis

    @classmethod
    def drawn(cls, seed: int, duration: float) -> Unknown:
        """30 g to 10 kg, 50 ms to 2 s, 3 to 50 cm, with friction up to a tenth of the force."""
        dice = np.random.default_rng(seed)
        mass = 10 ** dice.uniform(-1.5, 1)
        damping = mass / 10 ** dice.uniform(-1.3, 0.3)
        travel = 10 ** dice.uniform(-1.5, -0.3)
        force = mass * travel * (2 * np.pi * 10 ** dice.uniform(-0.2, 0.5)) ** 2
        friction = force * float(dice.choice([0.0, 0.02, 0.05, 0.1]))
        guesses = {
            "sample_time": STEP,
            "duration": duration,
            "ramp": 0.2,
            "force": force,
            "travel": travel,
            "speed": travel * float(dice.choice([6.0, 100.0])),
            "mass": mass,
            "damping": damping,
            "coulomb_friction": friction,
            "encoder_resolution": travel * 10 ** dice.uniform(-5, -4),
        }
        off = 2 ** dice.uniform(-1, 1, 3)
        axis = Axis(
            mass=mass * off[0],
            damping=damping * off[1],
            coulomb=friction * off[2],
            offset=force * dice.uniform(-0.02, 0.02),
        )
        return cls(guesses=guesses, axis=axis)

    def spec(self, **keys: Any) -> ExcitationSpec:
        return parse_document(ExcitationSpec, self.guesses | keys, "guesses")

    def played(self, plan: Excitation) -> Array:
        """Position under the planned force, shape (n,), m."""
        return positions(self.axis, plan.best.force[:, None])[:, 0]

    def identified(self, plan: Excitation, position: Array) -> Device:
        """The device as its log shows it."""
        count, force = self.guesses["encoder_resolution"], self.guesses["force"]
        log = Trajectory(
            time=plan.time,
            force=plan.best.force,
            position=counted(position, count),
            stated_units=frozenset({"force"}),  # --force-gain 1: a gentle force looks like amperes
        )
        hardware = Hardware(
            sample_time=quantity(STEP),
            delay=quantity(0.0),
            encoder_resolution=quantity(count),
            force_limit=ForceLimit(continuous=force, peak=force),
        )
        return identify(log, hardware=hardware).device

    def used(self, position: Array) -> float:
        """The larger part of travel and speed that a motion uses."""
        reach = np.max(np.abs(position)) / self.guesses["travel"]
        return float(max(reach, np.max(np.abs(np.diff(position))) / STEP / self.guesses["speed"]))


def stored(device: Device, path: Path) -> str:
    """Write a device as identify does; the name of its file."""
    path.write_text(to_yaml(to_mapping(device), "first play"), encoding="utf-8")
    return path.name


@pytest.mark.parametrize("name", thinned(LIMITS, 1))
def test_the_simulated_device_keeps_the_limits_and_comes_back_to_rest(name: str) -> None:
    plan = planned(name)
    limits = plan.spec
    force = plan.best.force
    assert force.size == limits.samples + 1
    assert force[0] == force[-1] == 0
    assert np.max(np.abs(force)) <= limits.force
    assert np.max(np.abs(force[:30])) < 0.1 * limits.force  # a tenth of the ramp
    position = simulate(rig_of(limits), force).position[0]
    speed = np.diff(position) / STEP
    assert 0.97 * limits.travel < np.max(np.abs(position)) <= limits.travel
    assert limits.speed is not None
    assert np.max(np.abs(speed)) <= limits.speed
    assert abs(position[-1]) < 1e-3 * limits.travel
    assert abs(speed[-1]) < 1e-3 * limits.speed


def jacobian(plan: ExcitationSpec, force: Array) -> Array:
    """Position by mass, damping, offset, start and velocity, from the simulator."""

    def position(start: float = 0.0, velocity: float = 0.0, **others: float) -> Array:
        return simulate(rig_of(plan, **others), force, position=start, velocity=velocity).position[
            0
        ]

    sizes = {"mass": 3e-3, "damping": 1e-2, "force_offset": 1e-2, "start": 1e-2, "velocity": 1e-2}
    around = {"mass": plan.mass.value, "damping": plan.damping.value}
    slopes = [
        position(**{name: around.get(name, 0.0) + size})
        - position(**{name: around.get(name, 0.0) - size})
        for name, size in sizes.items()
    ]
    return np.stack(slopes, axis=1) / (2 * np.array([*sizes.values()]))


def test_predicted_intervals_are_the_bound_of_the_simulator() -> None:
    """Cramér and Rao's, with offset, start and velocity unknown, by differences of positions."""
    plan = planned("homerehab")
    table = jacobian(plan.spec, plan.best.force) / plan.spec.reading_noise
    bound = 1.96 * np.sqrt(np.diag(np.linalg.inv(table.T @ table))[:2])
    np.testing.assert_allclose([plan.mass, plan.damping], bound, rtol=1e-2)


def test_bound_with_unknown_force_is_that_of_the_dense_covariance() -> None:
    plan = spec()
    samples, unknown = 600, 0.05
    time = np.arange(samples) * STEP
    swing = np.sin(2 * np.pi * 1.3 * time) + 0.6 * np.cos(2 * np.pi * 3.1 * time)
    force = 4.0 * np.minimum(time / 0.2, 1.0) * swing
    table = jacobian(plan, np.append(force, 0.0))
    kick = np.zeros(samples + 1)
    kick[0] = unknown
    answer_to_one = simulate(rig_of(plan), kick).position[0]
    lag = np.subtract.outer(np.arange(samples + 1), np.arange(samples))
    spread = np.where(lag >= 0, answer_to_one[np.maximum(lag, 0)], 0.0)
    noise = plan.reading_noise**2 * np.eye(samples + 1) + spread @ spread.T
    truth = np.linalg.inv(table.T @ np.linalg.solve(noise, table))[:2, :2]
    got = predict(
        force,
        Guess(mass=3.0, damping=10.0),
        step=STEP,
        noise=plan.reading_noise,
        force_noise=unknown,
    )
    # The Kalman filter is taken as settled from the first sample on: a few samples of 600.
    np.testing.assert_allclose(got.covariance, truth, rtol=0.02)
    assert (
        got.mass
        > 5
        * predict(force, Guess(mass=3.0, damping=10.0), step=STEP, noise=plan.reading_noise).mass
    )


def test_families_are_compared_and_the_best_is_played() -> None:
    limits = spec(duration=1.2, coulomb_friction=0.8)
    seen: list[str] = []
    plan = plan_excitation(limits, progress=seen.append)
    assert seen == [
        "designing a multisine",
        "designing a swept sine",
        "designing a binary sequence",
        "looking for the devices that go farthest",
    ]
    assert {each.family for each in plan.candidates} == {"multisine", "swept-sine", "binary"}
    products = [each.prediction.mass * each.prediction.damping for each in plan.candidates]
    assert products == sorted(products)
    assert (plan.mass, plan.damping) == (plan.best.prediction.mass, plan.best.prediction.damping)


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("mass: must be greater than 0", {"mass": -1}),
        ("damping must not be negative", {"damping": -1}),
        ("hardly moves the device; allow 3 or more", {"force": 2.5, "coulomb_friction": 2.0}),
        ("samples; 200 to 200000 can be planned", {"duration": 1e6}),
        ("samples; 200 to 200000 can be planned", {"duration": 0.1, "ramp": 0.0}),
        ("leaves too little between two ramps", {"ramp": 1.5}),
        ("travel: must be greater than 0", {"travel": 0}),
        ("true and false are neither numbers nor text", {"force": True}),
        ("finite number", {"speed": float("inf")}),
        ("delay: must be 'known' or 'unknown'", {"delay": 0.001}),
    ],
)
def test_senseless_limits_are_a_sentence(words: str, change: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError) as caught:
        spec(**change)
    assert words in str(caught.value)


def test_drift_that_no_force_can_prevent_is_a_sentence() -> None:
    with pytest.raises(InvalidInputError) as caught:
        plan_excitation(spec(duration=1.5, force_offset={"value": 0.0, "low": -1.0, "high": 1.0}))
    assert "some device within the guesses moves" in str(caught.value)
    assert "narrow the ranges of coulomb_friction and force_offset" in str(caught.value)


def limits_of(**given: Any) -> str:
    """A file of the limits of the first device."""
    stated = {"sample_time": STEP, "ramp": 0.2} | LIMITS["homerehab"] | given
    return "".join(f"{key}: {value}\n" for key, value in stated.items())


@pytest.fixture
def here(here: Path) -> Path:
    Path("excitation.yaml").write_text(limits_of(duration=1.2), encoding="utf-8")
    return here


@pytest.mark.usefixtures("here")
def test_command_writes_force_and_picture() -> None:
    ended = haptune("excite", "excitation.yaml", "--picture", "force.png")
    assert ended.code == 0, ended.err
    for word in ("multisine", "swept-sine", "binary", "predicted 95 % intervals: mass 3 ±"):
        assert word in ended.out
    rows = Path("force.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "time,force"
    assert rows[1] == "0,0"
    assert rows[-1] == "1.2,0"
    table = np.loadtxt(rows[1:], delimiter=",")
    np.testing.assert_allclose(np.diff(table[:, 0]), STEP, rtol=1e-9)
    plan = plan_excitation(load_excitation(Path("excitation.yaml")))
    np.testing.assert_array_equal(table[:, 1], plan.best.force)
    assert Path("force.png").read_bytes().startswith(b"\x89PNG")


def test_command_says_what_it_would_do_and_what_is_wrong(here: Path) -> None:
    before = files()
    ended = haptune("excite", "excitation.yaml", "--dry-run")
    assert ended.code == 0
    assert "force.csv would be written, 1201 rows" in ended.out
    assert haptune("excite", "excitation.yaml", "-o", "excitation.yaml").code == 2
    assert haptune("excite", "excitation.yaml", "--picture", "force.csv").code == 2
    assert files() == before
    drifting = limits_of(duration=1.2, force_offset="{value: 0, low: -5, high: 5}")
    Path("drift.yaml").write_text(drifting, encoding="utf-8")
    ended = haptune("excite", "drift.yaml")
    assert ended.code == 3
    assert len(ended.err.splitlines()) == 1
    assert "makes a device drift" in ended.err


@pytest.mark.parametrize("travel", [0.1, 10.0])
def test_a_device_that_is_named_is_warned_of_what_may_pull_at_it_alone(
    here: Path, travel: float
) -> None:
    named = limits_of(duration=2.0, travel=travel, speed=9.0, device="homerehab")
    Path("named.yaml").write_text(named, encoding="utf-8")
    ended = haptune("excite", "named.yaml")
    assert ended.code == 0
    if travel > 1:
        assert ended.err == ""
        return
    said = "may drive the device named against its end stops: an unplanned constant force of 1%"
    assert said in ended.err
    assert "times wrong" not in ended.err
    assert "Let nothing pull at it" in ended.err


@pytest.mark.parametrize(("speed", "little"), [(0.3, True), (2.0, False)])
def test_a_plan_of_little_force_tells_the_option_that_its_log_needs(
    here: Path, speed: float, little: bool
) -> None:
    """A log of less than 40 % of the continuous force is asked for its unit."""
    light = limits_of(duration=1.2, mass=0.3, damping=1.0, speed=speed)
    Path("plan.yaml").write_text(light, encoding="utf-8")
    ended = haptune("excite", "plan.yaml")
    assert ended.code == 0
    force = np.loadtxt("force.csv", delimiter=",", skiprows=1)[:, 1]
    assert (np.max(np.abs(force)) < 0.4 * 14.0) == little
    assert ("--force-gain 1" in ended.out) == little


@pytest.mark.usefixtures("here")
def test_template_is_read() -> None:
    assert haptune("new", "excitation", "-o", "blank.yaml", "--quiet").code == 0
    assert Path("blank.yaml").read_text(encoding="utf-8") == form("excitation")
    filled = ("--device", "homerehab", "-o", "mine.yaml", "--quiet")
    assert haptune("new", "excitation", *filled).code == 0
    read = load_excitation(Path("mine.yaml"))
    assert (read.mass.low, read.mass.high, read.samples) == (2.7, 3.3, 10_000)
    assert replace(planned("homerehab"), spec=read).time[-1] == pytest.approx(3.0)


#: Between two ways to add up the same motion.
ROUNDING = 1e-9
#: Mass, damping, friction wrong by this factor at most; the constant force as part of the limit.
SETS = {
    "stated": (1.0, 0.0),
    "twice": (2.0, 0.0),
    "unplanned-1": (1.0, 0.01),
    "unplanned-2": (1.0, 0.02),
    "both": (2.0, 0.02),
}


def plan_or_not(limits: ExcitationSpec) -> Excitation | None:
    """The plan; None if a constant force or friction would make the device drift too far."""
    try:
        return plan_excitation(limits)
    except InvalidInputError as error:
        if "drift" in str(error) or "a constant force of" in str(error):
            return None
        raise


def driven(plan: Excitation, factor: float, pull: float, count: int, seed: int) -> Array:
    """Positions (n, devices) of devices wrong by up to a factor and pulled; the worst half are
    drawn where a device goes far: light, little damped, fully pulled."""
    dice = np.random.default_rng(seed)
    limits = plan.spec
    off = factor ** dice.uniform(-1, 1, (3, count))
    off[:, : count // 4] = 1 / factor
    off[::2, count // 4 : count // 2] = 1 / factor
    tug = (
        pull
        * limits.force
        * np.where(
            np.arange(count) % 2, dice.choice([-1.0, 1.0], count), dice.uniform(-1, 1, count)
        )
    )

    def within(name: str) -> Array:
        guess = getattr(limits, name)
        return dice.uniform(guess.low, guess.high, count)

    wrong = factor > 1
    axis = Axis(
        mass=limits.mass.value * off[0] if wrong else within("mass"),
        damping=limits.damping.value * off[1] if wrong else within("damping"),
        coulomb=limits.coulomb_friction.value * off[2] if wrong else within("coulomb_friction"),
        offset=within("force_offset") + tug,
        sample_time=limits.sample_time,
    )
    return positions(axis, np.repeat(plan.best.force[:, None], count, axis=1))


def check_stated(plan: Excitation, *, seed: int, count: int = 200) -> None:
    """No device in a set goes farther or faster than the plan says, and some go nearly as far."""
    assert [each.name for each in plan.worst] == list(SETS)
    for each in plan.worst:
        place = driven(plan, *SETS[each.name], count=count, seed=seed)
        assert np.max(np.abs(place)) <= each.travel * (1 + ROUNDING), each.name
        speed = np.max(np.abs(np.diff(place, axis=0))) / plan.spec.sample_time
        assert speed <= each.speed * (1 + ROUNDING), each.name
        assert np.max(np.abs(place)) > 0.7 * each.travel, each.name
    assert plan.worst[0].travel <= plan.spec.travel
    assert plan.worst[0].speed <= (plan.spec.speed or np.inf)


@pytest.mark.parametrize("name", thinned(LIMITS, 1))
def test_no_device_goes_farther_than_is_stated(name: str) -> None:
    check_stated(planned(name), seed=1)


def test_what_leaves_the_limits_is_named() -> None:
    """Half the mass and damping go twice as far; a constant force f0 drifts by f0/b a second."""
    plan = planned("homerehab")
    worst = {each.name: each for each in plan.worst}
    assert worst["twice"].travel == pytest.approx(2 * worst["stated"].travel, rel=0.02)
    drift = 0.02 * 14.0 / 10.0 * 3.0
    assert worst["unplanned-2"].travel > 0.5 * drift + 0.5 * worst["stated"].travel
    assert {each.name for each in plan.beyond} == {"twice", "unplanned-1", "unplanned-2", "both"}
    kept = replace(plan, spec=plan.spec.model_copy(update={"travel": 10.0, "speed": 100.0}))
    assert kept.beyond == ()


def test_friction_guessed_twice_too_large_goes_farther() -> None:
    plan = plan_excitation(spec(duration=1.5, coulomb_friction=7.0))
    mass, damping = plan.spec.mass.value / 2, plan.spec.damping.value / 2

    def reached(coulomb: float) -> float:
        light = Axis(mass=mass, damping=damping, coulomb=coulomb)
        return float(np.max(np.abs(positions(light, plan.best.force[:, None]))))

    travel = plan.worst[1].travel
    assert 1.3 * reached(7.0) < reached(3.5) <= travel * (1 + ROUNDING)


def reread(asked: ExcitationSpec, folder: Path) -> ExcitationSpec:
    """A specification as a file beside the device that it names."""
    path = folder / "excitation.yaml"
    path.write_text(to_yaml(to_mapping(asked)), encoding="utf-8")
    return load_excitation(path)


def check_two_plays(seed: int, duration: float, folder: Path) -> bool:
    """Both plays keep the limits; whether both could be planned."""
    unknown = Unknown.drawn(seed, duration)
    gentle = plan_or_not(unknown.spec(gentle=True))
    if gentle is None:
        return False
    assert gentle.beyond == ()
    place = unknown.played(gentle)
    assert unknown.used(place) <= 1
    assert np.max(np.abs(gentle.best.force)) <= unknown.guesses["force"]
    first = stored(unknown.identified(gentle, place), folder / f"first-{seed}.yaml")
    full = plan_or_not(reread(unknown.spec(device=first), folder))
    if full is None:
        return False
    place = unknown.played(full)
    assert unknown.used(place) <= 1
    assert unknown.used(place) > 0.9 * full.best.used.most or full.best.used.force > 0.9
    return True


@pytest.mark.parametrize("seed", thinned(range(8), 1))
def test_a_gentle_play_makes_the_full_one_safe(seed: int, tmp_path: Path) -> None:
    assert check_two_plays(seed, 1.0, tmp_path)


def test_a_device_that_no_gentle_play_can_tell_is_a_sentence() -> None:
    with pytest.raises(InvalidInputError) as caught:
        plan_excitation(spec(gentle=True, travel=0.001))
    assert "moves the lightest device" in str(caught.value)
    assert "narrow force_offset" in str(caught.value)


def test_what_a_device_file_says_stands_in_for_the_guesses(tmp_path: Path) -> None:
    path = tmp_path / "excitation.yaml"
    path.write_text(limits_of(duration=2.0, mass=1.0, device="first.yaml"), "utf-8")
    device = (
        "name: d\naxis: x\nmotion: linear\nsample_time: 0.001\ndelay: 0.001\n"
        "mass: {value: 3.0, low: 2.9, high: 3.1}\ndamping: {value: 0.1, low: -0.1, high: 0.3}\n"
        "coulomb_friction: {value: 0.8, low: 0.7, high: 0.9}\nforce_offset: 0.05\n"
    )
    (tmp_path / "first.yaml").write_text(device, encoding="utf-8")
    read = load_excitation(path)
    assert read.mass.value == 3.0
    # Four quantities at once with 99.9 %: √χ²₄(0.999) = 4.297 deviations, not 1.96.
    assert (read.coulomb_friction.high - 0.8) / 0.1 == pytest.approx(4.2973 / 1.95996, rel=1e-4)
    assert read.damping.low == 0.0
    assert (read.force_offset.low, read.force_offset.high) == (0.05, 0.05)
    for change, words in (
        (device.replace("linear", "rotary"), "is rotary, the excitation linear"),
        (device + "position_stiffness: 30.0\n", "force of position"),
        (None, "first.yaml"),
    ):
        (tmp_path / "first.yaml").unlink()
        if change is not None:
            (tmp_path / "first.yaml").write_text(change, encoding="utf-8")
        with pytest.raises(InvalidInputError, match=words):
            load_excitation(path)
    both = limits_of(duration=2.0, device="first.yaml", gentle="true")
    path.write_text(both, encoding="utf-8")
    with pytest.raises(InvalidInputError, match="leave out gentle, or device"):
        load_excitation(path)
