"""Elements entered, left and disturbed on a moving device, through the compiled guard."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from identification import load_device
from tests.entered import Run, played
from tests.entered_scenes import made
from tests.guard import Guard, built
from tune import SafeProfile, Scene, optimise
from tune.exporters import export
from tune.exporters.law import largest_change

#: Sizes (K, B, M) of elements by name; those named wall push only. The first is the demo's scene.
SCENES: dict[str, dict[str, tuple[float, float, float]]] = {
    "homerehab": {
        "wall": (20_000.0, 90.0, 0.0),
        "water": (0.0, 10.0, 0.0),
        "cup": (0.0, 0.0, 1.475),
        "rubber": (1400.0, 0.0, 0.0),
        "feather": (0.0, 0.0, -1.2),
    },
    "knob": {
        "wall": (1.3, 5.5e-3, 0.0),
        "thing": (0.124, 8.8e-4, 1.4e-4),
        "free": (0.0, -1.4e-4, 0.0),
        "feather": (0.0, 0.0, -3.1e-5),
    },
}
ELEMENTS = [(device, name) for device, scene in SCENES.items() for name in scene]
#: Periods before an element is reached.
BEFORE = 60


def depth_of(profile: SafeProfile, name: str) -> float:
    """How deep a hand goes: as stated, else where the spring takes the peak force; m (rad)."""
    element, limit = profile.elements[name], profile.device.force_limit
    if element.motion.penetration is not None:
        return element.motion.penetration
    assert limit is not None
    return limit.peak / element.stiffness


def stated_sum(profile: SafeProfile, name: str) -> float:
    """|K|·depth + |B|·speed + |M|·acceleration, N (N·m)."""
    element = profile.elements[name]
    motion = element.motion
    return (
        abs(element.stiffness) * depth_of(profile, name)
        + abs(element.damping) * motion.speed
        + abs(element.mass) * motion.acceleration
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """A profile and its compiled guard."""

    profile: SafeProfile
    guard: Guard

    def bit(self, name: str) -> int:
        """The set of one element."""
        return 1 << list(self.profile.elements).index(name)

    def noise(self, name: str) -> float:
        """Force that one count of the encoder may make of an element, N (N·m)."""
        element, loop = self.profile.elements[name], self.profile.loop
        resolution, step = self.profile.device.encoder_resolution, loop.sample_time
        assert resolution is not None
        quick, slow = (
            1 - math.exp(-2 * math.pi * (hz or math.inf) * step)
            for hz in (loop.velocity_filter_hz, loop.acceleration_filter_hz)
        )
        sizes = (
            abs(element.stiffness)
            + abs(element.damping) * quick / step
            + abs(element.mass) * (slow / step) ** 2
        )
        return sizes * resolution.value

    def entry(self, name: str, wrong: dict[int, float] | None = None) -> Run:
        """One element reached from below at the stated speed."""
        element, device = self.profile.elements[name], self.profile.device
        speed, step = element.motion.speed, self.profile.loop.sample_time
        early = speed * math.exp(device.damping.value / device.mass.value * BEFORE * step)
        start = -device.mass.value / device.damping.value * (early - speed)
        return played(
            self.guard,
            self.profile,
            lambda _, reading: self.bit(name) if element.one_sided or reading > 0 else 0,
            place=start,
            speed=early,
            periods=BEFORE + 500,
            faces={self.bit(name): (0.0, -1)},
            wrong=wrong,
        )


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Played]:
    found: dict[str, Played] = {}
    for name, scene in SCENES.items():
        profile = made(name, scene)  # what is played depends on no certificate
        guard = built(export(profile, "c"), tmp_path_factory.mktemp(name))
        found[name] = Played(profile=profile, guard=guard)
    return found


@pytest.mark.parametrize(("device", "name"), ELEMENTS)
def test_an_element_is_entered_without_a_blow(
    scenes: dict[str, Played], device: str, name: str
) -> None:
    entered_without_a_blow(scenes[device], name)


@pytest.mark.long
@pytest.mark.parametrize("device", ["homerehab", "stylus", "knob", "emps"])
def test_what_is_tuned_is_entered_without_a_blow(device: str, tmp_path: Path) -> None:
    """As large as each can be had, free cut-offs, a spring with a mass and none to damp it too."""
    hardware = load_device(device)
    wishes = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
        "thing": {"stiffness": "max", "damping": "max", "mass": "max"},
        "load": {"stiffness": "max", "mass": "max"},
        "free": {"damping": "min"},
        "feather": {"mass": "min", "damping": 2 * hardware.damping.value},
    }
    profile = optimise(hardware, Scene.model_validate({"elements": wishes}))
    acting = [name for name, element in profile.elements.items() if element.acting]
    assert {"wall", "thing", "load"} <= {*acting}  # no hand tells what is taken off light devices
    scene = Played(profile=profile, guard=built(export(profile, "c"), tmp_path))
    for name in acting:
        entered_without_a_blow(scene, name)


def entered_without_a_blow(scene: Played, name: str) -> None:
    """Within the stated sum and the peak from the first period on, and no speed is gained."""
    run, element, device = scene.entry(name), scene.profile.elements[name], scene.profile.device
    first = int(np.argmax(run.force != 0))
    speed, step = element.motion.speed, scene.profile.loop.sample_time
    assert run.speed[first] == pytest.approx(speed, rel=0.06)  # a wall is met before its face
    assert device.force_limit is not None
    counts = scene.noise(name)
    shallow = np.abs(run.place) <= depth_of(scene.profile, name)
    assert np.abs(run.force).max() <= device.force_limit.peak
    assert np.abs(run.force[shallow]).max() <= 1.02 * stated_sum(scene.profile, name) + 2 * counts
    # A wall begins with none, and is a period deeper in the next, what else has a damper with its
    # force; a fade has come two periods far.
    cut_off = scene.profile.loop.velocity_filter_hz or math.inf
    new = 1 - math.exp(-2 * math.pi * cut_off * step) if element.one_sided else 1.0
    slows = device.damping.value / device.mass.value * speed
    blow = (element.stiffness * step + abs(element.damping) * new) * speed
    blow += abs(element.mass) * slows
    blow *= 2 * step / element.fade_time if element.fades else 1.0
    assert np.abs(np.diff(run.force[first - 1 : first + 20])).max() <= 1.05 * blow + 2 * counts
    assert set(run.statuses[BEFORE - 20 :]) == {"OK"}
    if element.fades and element.stiffness:
        left_slower(scene, name)
    else:
        assert np.abs(run.speed[first:]).max() <= 1.01 * run.speed[first]


def left_slower(scene: Played, name: str) -> None:
    """A spring that fades in under a swing gives work, which it takes back as it fades out."""
    element = scene.profile.elements[name]
    speed, one = element.motion.speed, scene.bit(name)
    left = 1500 + round(element.fade_time / scene.profile.loop.sample_time)
    for end in range(BEFORE, BEFORE + 1500, 35):
        run = played(
            scene.guard,
            scene.profile,
            lambda k, _, end=end: one if k < end else 0,
            place=0.0,
            speed=speed,
            periods=end + left,
            faces={one: (0.0, 1)},
        )
        after = np.flatnonzero(run.force)[-1] + 1
        assert after < end + left
        assert abs(run.speed[after]) < speed


@pytest.mark.parametrize("device", SCENES)
def test_one_wrong_reading_never_makes_more_force_than_the_stated_sum(
    scenes: dict[str, Played], device: str
) -> None:
    """At any time, and half as much again as the device can move."""
    scene = scenes[device]
    jump = 1.5 * largest_change(scene.profile)
    for name in scene.profile.elements:
        for at in (BEFORE - 1, BEFORE, BEFORE + 1, BEFORE + 150):
            for size in (jump, -jump):
                run = scene.entry(name, {at: size})
                assert run.statuses[at] == "GLITCH"
                assert set(run.statuses[at + 1 :]) == {"OK"}
                shallow = np.abs(run.place) <= depth_of(scene.profile, name)
                most = 1.02 * stated_sum(scene.profile, name) + 2 * scene.noise(name)
                assert np.abs(run.force[shallow]).max() <= most


@pytest.mark.parametrize("in_a_row", [True, False])
@pytest.mark.parametrize("device", SCENES)
def test_a_tenth_of_the_periods_missed_leaves_every_element_quiet(
    scenes: dict[str, Played], device: str, in_a_row: bool
) -> None:
    """Met at a tenth of the stated speed: the force of the last fifth stays below 3 ripple limits.

    Two periods missed in a row end the contact, and the program enters it again.
    """
    scene = scenes[device]
    source = np.random.default_rng(3)
    periods = 4000
    missed = source.random(periods) < 0.1
    if not in_a_row:
        missed[1:] &= ~missed[:-1]
    limit = 3 * (0.1 if scene.profile.device.motion == "linear" else 0.005)
    for name, element in scene.profile.elements.items():
        one = scene.bit(name)
        run = played(
            scene.guard,
            scene.profile,
            lambda _, __, one=one: one,
            place=0.0,
            speed=-0.1 * element.motion.speed,
            periods=periods,
            faces={one: (0.0, 1)},
            missed=frozenset(np.flatnonzero(missed).tolist()),
        )
        assert np.abs(run.force[-periods // 5 :]).max() < limit
        assert ("LATE" in run.statuses) == in_a_row
