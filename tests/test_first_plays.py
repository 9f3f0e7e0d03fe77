"""Planned forces on devices that are not as guessed, and a gentle play before the full one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import (
    Excitation,
    ExcitationSpec,
    InvalidInputError,
    load_excitation,
    plan_excitation,
)
from identification.planning.limits import spec_from_device
from tests.exact_axis import Axis, positions
from tests.excitation_plans import LIMITS, STEP, planned, spec
from tests.first_plays import Unknown, stored
from tests.thinned import thinned

Array = NDArray[np.float64]
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


@pytest.mark.parametrize(
    "name",
    [
        name if name == "homerehab" else pytest.param(name, marks=pytest.mark.long)
        for name in LIMITS
    ],
)
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
    full = plan_or_not(spec_from_device(unknown.spec(device=first), folder))
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
    lines = [f"{key}: {value}" for key, value in LIMITS["homerehab"].items()]
    text = "\n".join([f"sample_time: {STEP}", "duration: 2.0", "ramp: 0.2", *lines])
    path = tmp_path / "excitation.yaml"
    path.write_text(text.replace("mass: 3.0", "mass: 1.0") + "\ndevice: first.yaml\n", "utf-8")
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
    path.write_text(text + "\ndevice: first.yaml\ngentle: true\n", encoding="utf-8")
    with pytest.raises(InvalidInputError, match="leave out gentle, or device"):
        load_excitation(path)
