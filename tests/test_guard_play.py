"""A free device among elements that come and go, through the compiled guard: nothing pumps."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from identification import Device, ForceLimit, quantity
from tests.entered import FloatArray, Run, played
from tests.entered_scenes import made
from tests.guard import built
from tests.test_clamps import WALL
from tests.thinned import thinned
from tune import NoFeasibleEffectError, Scene, optimise
from tune.exporters import export

#: HomeRehab's wall of the examples, and what is played beside it.
STIFF = (12_000.0, 70.0, 0.0)
ICE = (0.0, -9.0, 0.0)
#: Speeds that are told as possible, so that none of them is a glitch, m/s.
SPEED = 4.0


def asked(gains: FloatArray) -> Callable[[int, float], float]:
    """Gains in their order, then all."""
    return lambda k, _: float(gains[k]) if k < gains.size else 1.0


def adverse() -> Callable[[int, float], float]:
    """A gain that holds the device less on its way in than on its way out."""
    before = 0.0

    def gain(_: int, reading: float) -> float:
        nonlocal before
        before, moved = reading, reading - before
        return 1.0 if moved * reading <= 0 else 0.1

    return gain


def fastest(run: Run) -> float:
    """Largest speed, m/s."""
    return float(np.abs(run.speed).max())


@pytest.mark.parametrize(("speed", "left_at_once"), [(0.41, True), (1.5, False)])
def test_a_free_device_between_walls_with_ice_ends_no_faster_than_it_began(
    tmp_path: Path, speed: float, left_at_once: bool
) -> None:
    """Ice that is left at either face still fades when the wall is met, and never keeps it back."""
    scene = {"wall": STIFF, "wall 2": STIFF, "ice": ICE}
    profile = made("homerehab", scene, speed=SPEED)
    walls, ice, face = 3, 4, 0.05
    run = played(
        built(export(profile, "c"), tmp_path),
        profile,
        lambda _, x: walls | (ice if abs(x) < face or not left_at_once else 0),
        place=0.0,
        speed=speed,
        periods=20_000,
        faces={1: (face, -1), 2: (-face, 1), 4: (0.0, 0)},
    )
    assert set(run.statuses) == {"OK"}
    assert fastest(run) <= speed
    assert np.abs(run.force).max() > 1
    assert np.abs(run.speed[-1000:]).max() < 2e-3 * speed


@pytest.mark.parametrize("seed", thinned(range(100), 3))
def test_whatever_is_called_a_free_device_comes_to_rest_no_faster(
    tmp_path: Path, seed: int
) -> None:
    """Elements and gains at random, in bursts or by what the device does, periods missed, jumps."""
    source = np.random.default_rng(seed)
    scene = {
        "wall": STIFF,
        "wall 2": STIFF,
        "some": [ICE, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)][seed % 3],
        "rubber": (1400.0, 0.0, 0.0),
        "water": (0.0, 20.0, 0.0),
    }
    profile = made("homerehab", scene, speed=SPEED)
    periods, calls = 5000, 2500
    lasts = source.integers(1, 10 ** source.integers(1, 4), calls)
    sets = source.choice([3, 3 | 4, 3 | 8, 3 | 16, 4, 8, 16, 1, 0], calls)
    sets = np.repeat(sets, lasts)[:calls].tolist()
    gains = np.repeat(source.choice([0.0, 0.3, 1.0, source.random()], calls), lasts)[:calls]
    missed = np.flatnonzero(source.random(periods) < 0.02)
    run = played(
        built(export(profile, "c"), tmp_path),
        profile,
        lambda k, _: sets[k] if k < calls else 3,
        place=0.0,
        speed=0.2,
        periods=periods,
        faces={1: (0.01, -1), 2: (-0.01, 1), 4: (0.0, 0), 8: (0.0, 0), 16: (0.0, 0)},
        gain=asked(gains) if seed % 2 else adverse(),
        missed=frozenset(missed[np.diff(missed, prepend=-9) > 2].tolist()),
        wrong=dict.fromkeys(source.integers(10, periods, 5).tolist(), 0.3),
    )
    assert fastest(run) <= 0.2
    assert np.abs(run.speed[-300:]).max() < 1e-3
    assert np.abs(run.force).max() <= 28
    assert set(run.statuses) - {"GLITCH", "LATE", "WAITING"} == {"OK"}


#: What is felt between two walls, each as much or as little as can be had.
BETWEEN = {
    "ice": {"damping": "min"},
    "cup": {"mass": "max", "damping": "max"},
    "feather": {"mass": "min"},
    "water": {"damping": "max"},
}


def random_device(seed: int) -> Device:
    """0.05 to 100 kg, 0.2 to 2 ms, up to two samples of delay."""
    rng = np.random.default_rng([28, seed])
    mass = float(10 ** rng.uniform(-1.3, 2))
    damping = mass / float(10 ** rng.uniform(-1.3, 0.48))
    step = float(rng.choice([2e-4, 5e-4, 1e-3, 2e-3]))
    spread = float(rng.choice([0.0, 0.01, 0.05]))
    delay, strength = float(rng.choice([0, 0.5, 1, 1, 2])) * step, float(10 ** rng.uniform(0.5, 2))
    return Device(
        motion="linear",
        mass=quantity(mass, mass * (1 - spread), mass * (1 + spread)),
        damping=quantity(damping, damping * (1 - 2 * spread), damping * (1 + 2 * spread)),
        sample_time=quantity(step),
        delay=quantity(delay),
        coulomb_friction=quantity(float(rng.uniform(0, 1.0))),
        encoder_resolution=quantity(float(10 ** rng.uniform(-6.5, -5))),
        force_limit=ForceLimit(continuous=strength, peak=2 * strength),
    )


@pytest.mark.long
@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("seed", range(100))
def test_what_is_tuned_for_a_random_device_never_pumps(
    tmp_path: Path, seed: int, together: bool
) -> None:
    """Between two walls as stiff as they can be had, called at random or against the device."""
    device = random_device(seed)
    source = np.random.default_rng([4, seed])
    chosen = [str(name) for name in source.permutation(list(BETWEEN))[:2]]
    scene = {
        "elements": {"wall": WALL, "wall 2": WALL, **{name: BETWEEN[name] for name in chosen}},
        "together": [chosen] if together else [],
        "loop": {
            "velocity_filter_hz": 0.05 / device.sample_time.value,
            "acceleration_filter_hz": 0.03 / device.sample_time.value,
        },
    }
    try:
        profile = optimise(device, Scene.model_validate(scene))
    except NoFeasibleEffectError:
        pytest.skip("nothing that a hand could tell")
    bits = {name: 1 << k for k, name in enumerate(profile.elements)}
    walls = [profile.elements[name] for name in bits if name in profile.walls]
    both = sum(bits[name] for name in bits if name in profile.walls)
    others = [bits[name] for name in chosen if name in bits]
    speed = 0.5 * profile.elements["wall"].motion.speed
    corridor = sum(w.motion.speed * w.damping / w.stiffness for w in walls if w.stiffness)
    count = device.encoder_resolution.value if device.encoder_resolution else 0.0
    face = corridor / 2 + 20 * count
    faces = {bits.get("wall", 0): (face, -1), bits.get("wall 2", 0): (-face, 1)}
    faces |= dict.fromkeys(others, (0.0, 0))
    periods, calls = 6000, 3000
    lasts = source.integers(1, 10 ** source.integers(1, 4), calls)
    sets = np.repeat(source.choice([both, 0, *(both | each for each in others)], calls), lasts)
    gains = np.repeat(source.choice([0.0, 0.3, 1.0], calls), lasts)[:calls]
    run = played(
        built(export(profile, "c"), tmp_path),
        profile,
        lambda k, _: int(sets[k]) if k < calls else both,
        place=0.0,
        speed=speed,
        periods=periods,
        faces={bit: place for bit, place in faces.items() if bit},
        gain=asked(gains) if seed % 2 else adverse(),
    )
    assert device.force_limit is not None
    assert fastest(run) <= speed * (1 + 1e-9)
    # Between the walls only its own damping slows it down; counts of the encoder keep it awake.
    left = np.abs(run.speed[calls : calls + 300]).max()
    assert np.abs(run.speed[-300:]).max() <= max(left, 0.01 * speed)
    # The peak is exported with twelve digits.
    assert np.abs(run.force).max() <= device.force_limit.peak * (1 + 1e-11)
    assert set(run.statuses) <= {"OK", "WAITING", "NOT_TOGETHER"}
