"""A device of several axes: one log to matrices, one law for every direction, judged from outside.

Truth is a simulator that integrates coupled axes with dry friction by its own means, and the poles
of the loop of all axes at once in a state space of this file's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

import identification as ident
from identification import Device, Hardware, InvalidInputError, LogRefusedError, identify
from tests.commands import haptune
from tests.planar import (
    DAMPING,
    FRICTION,
    HARDWARE,
    MASS,
    STEP,
    motion,
    tangled,
    write_log,
)
from tune import load_profile
from tune.documents.profile import SafeProfile

FloatArray = NDArray[np.float64]
COLUMNS = ("--force", "force_x,force_y", "--position", "position_x,position_y")
SCENE = """\
schema: haptune/scene/1
name: room
loop: {velocity_filter_hz: 50.0, acceleration_filter_hz: 30.0, filter_damping_ratio: 0.5}
ripple_limit: 0.1
elements:
  wall: {stiffness: max, damping: max, one_sided: true, speed: 0.2}
  water: {damping: 10.0}
  cup: {mass: max, damping: 30.0}
together: [[water, cup]]
"""


def hardware(**given: object) -> Hardware:
    content = ident.load_mapping("hardware.yaml", HARDWARE) | given
    return ident.parse_document(Hardware, content, "hardware.yaml")


@pytest.fixture(scope="module")
def planar() -> Device:
    """The device of [[3, 1], [1, 3]] kg, identified from a log of 4 s."""
    seen = motion(MASS, DAMPING, FRICTION, seed=1)
    return identify(seen.log(), hardware=hardware()).device


def test_principal_masses_are_found(planar: Device) -> None:
    """Axes of 3 kg each have masses of 2 and 4 kg; the limit of a mass follows the lighter."""
    assert planar.axes == ("x", "y")
    assert planar.poses is not None
    (pose,) = planar.poses
    assert np.allclose(np.linalg.eigvalsh(np.array(pose.mass)), [2.0, 4.0], rtol=0.01)
    assert np.allclose(pose.mass, MASS, rtol=0.01)
    assert np.allclose(pose.damping, DAMPING, rtol=0.1, atol=0.1)
    assert np.allclose(pose.coulomb_friction, FRICTION, rtol=0.02)
    least, largest = pose.extremes("mass", 0.0)
    assert np.allclose(np.abs(least.direction), np.sqrt(0.5), atol=0.01)
    assert least.direction[0] * least.direction[1] < 0 < largest.direction[0] * largest.direction[1]
    box = planar.simultaneous_box()
    assert 1.9 < box.mass[0] < 2.0
    assert 4.0 < box.mass[1] < 4.1
    assert box.damping[0] < np.linalg.eigvalsh(DAMPING)[0]
    assert np.linalg.eigvalsh(DAMPING)[1] < box.damping[1]


def _misses(seed: int, axes: int, *, rows: int = 4000, stated: bool = True) -> FloatArray:
    """Errors of all entries of a random device over their deviations, as of a normal variable."""
    chance = np.random.default_rng(seed)
    mass = tangled(chance, axes, 10.0, chance.uniform(0.1, 1.0))
    damping = tangled(chance, axes, 30.0, chance.uniform(0.3, 2.0))
    friction = chance.uniform(0.02, 0.08, axes) * 12.0
    delay = STEP * int(chance.integers(0, 4))
    seen = motion(mass, damping, friction, seed=seed, delay=delay, rows=rows)
    known = hardware(axes=list("xyz"[:axes]), delay=delay if stated else None)
    device = identify(seen.log(), hardware=known, allow=("force-unit",)).device
    assert device.poses is not None
    pose = device.poses[0]
    upper = np.triu_indices(axes)
    errors = np.concatenate(
        [
            (np.array(found) - truth)[upper]
            for found, truth in ((pose.mass, mass), (pose.damping, damping))
        ]
    )
    spread = np.sqrt(np.diag(np.array(pose.covariance.matrix)))
    box = device.simultaneous_box()
    for matrix, (low, high) in ((mass, box.mass), (damping, box.damping)):
        assert low < np.linalg.eigvalsh(matrix)[0]
        assert np.linalg.eigvalsh(matrix)[-1] < high
    return np.asarray(errors / spread / (pose.deviations() / 1.96), dtype=np.float64)


@pytest.mark.parametrize(("seed", "axes"), [(5, 2), (12, 2), (7, 3)])
def test_random_devices_are_found_within_their_intervals(seed: int, axes: int) -> None:
    assert np.all(np.abs(_misses(seed, axes)) < 4)


def test_the_delay_of_all_axes_is_found() -> None:
    assert np.all(np.abs(_misses(5, 2, stated=False)) < 4)


@pytest.mark.long
def test_intervals_of_three_hundred_devices_cover() -> None:
    """95 % intervals of every entry of both matrices hold 93 to 97.5 % of the truth."""
    found = np.concatenate([_misses(1000 + k, 2 + k % 2, rows=10_000) for k in range(300)])
    assert 0.93 < np.mean(np.abs(found) < 1.96) < 0.975


def test_one_force_on_both_axes_tells_them_not_apart() -> None:
    # What both matrices have in common is pushed; nothing moves the axes apart.
    damping = np.array([[11.0, 2.0], [2.0, 11.0]])
    seen = motion(MASS, damping, np.zeros(2), seed=3, alike=True)
    with pytest.raises(LogRefusedError) as refused:
        identify(seen.log(), hardware=hardware())
    assert "axes-not-told-apart" in {each.code for each in refused.value.findings}


def test_filtered_methods_agree_with_the_truth() -> None:
    seen = motion(MASS, DAMPING, FRICTION, seed=4)
    for method in ("least-squares", "instruments"):
        device = identify(seen.log(), hardware=hardware(), method=method).device
        assert device.poses is not None
        assert np.allclose(device.poses[0].mass, MASS, rtol=0.02)
        assert {log.method for log in device.logs} == {method}


def test_poses_are_enveloped() -> None:
    """Two logs at two poses: every direction of both is in the box."""
    seen = [motion(part * MASS, DAMPING, FRICTION, seed=5) for part in (1.0, 1.5)]
    device = identify([each.log() for each in seen], hardware=hardware()).device
    assert device.poses is not None
    assert len(device.poses) == 2
    box = device.simultaneous_box()
    assert box.mass[0] < 2.0
    assert box.mass[1] > 6.0


def _poles(
    profile: SafeProfile, gain: float, late: int, isotropic: FloatArray, wall: FloatArray, n: float
) -> float:
    """Largest pole of the loop of both axes but for those of free motion.

    Gains are K, B and M; the wall's act along the direction at an angle n, the others everywhere.
    """
    filters, step = profile.loop, STEP
    along = np.array([np.cos(n), np.sin(n)])
    one, wall_only = np.eye(2), np.outer(along, along)
    k, b, m = (gain * (iso * one + w * wall_only) for iso, w in zip(isotropic, wall, strict=True))
    plant = np.zeros((6, 6))
    plant[:2, 2:4] = one
    plant[2:4, 2:4] = -np.linalg.solve(MASS, DAMPING)
    plant[2:4, 4:] = np.linalg.inv(MASS)
    held = expm(plant * step)
    velocity, acceleration = filters.velocity_filter_hz, filters.acceleration_filter_hz
    assert isinstance(velocity, float)
    assert isinstance(acceleration, float)
    a = np.exp(-2 * np.pi * velocity * step)
    turn, ratio = 2 * np.pi * acceleration * step, filters.filter_damping_ratio
    assert isinstance(ratio, float)
    t = 2 * np.exp(-ratio * turn) * np.cos(np.sqrt(1 - ratio**2) * turn)
    p = np.exp(-2 * ratio * turn)
    # States: q, q̇, readings one and two ago, filtered velocity, acceleration now and before.
    size, wait = 14, 1 + late
    total = np.zeros((size + 2 * wait, size + 2 * wait))
    q, v = slice(0, 2), slice(2, 4)
    last, before = slice(4, 6), slice(6, 8)
    slow, now, old = slice(8, 10), slice(10, 12), slice(12, 14)
    # What the law makes of the state at a sample, as rows over the state.
    rows = np.zeros((3, 2, size + 2 * wait))
    rows[0][:, q] = one
    rows[1][:, slow] = a * one
    rows[1][:, q], rows[1][:, last] = (1 - a) / step * one, -(1 - a) / step * one
    fresh = (1 - t + p) / step**2
    rows[2][:, now], rows[2][:, old] = t * one, -p * one
    rows[2][:, q], rows[2][:, last], rows[2][:, before] = fresh * one, -2 * fresh * one, fresh * one
    force = -(k @ rows[0] + b @ rows[1] + m @ rows[2])
    acting = slice(size, size + 2)
    total[q, q], total[q, v], total[q, acting] = one, held[:2, 2:4], held[:2, 4:]
    total[v, v], total[v, acting] = held[2:4, 2:4], held[2:4, 4:]
    total[last, q], total[before, last] = one, one
    total[slow], total[now], total[old, now] = rows[1], rows[2], one
    for place in range(wait - 1):
        total[size + 2 * place : size + 2 * place + 2, size + 2 * place + 2 :][:, :2] = one
    total[size + 2 * wait - 2 :] = force
    found = np.linalg.eigvals(total)
    free = 2 - np.linalg.matrix_rank(k) if gain else 2
    kept = found[np.argsort(np.abs(found - 1.0))][free:]
    return float(np.max(np.abs(kept)))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a log of two axes and what the commands made of it."""
    folder = tmp_path_factory.mktemp("planar")
    write_log(folder / "log.csv", motion(MASS, DAMPING, FRICTION, seed=1))
    (folder / "hardware.yaml").write_text(HARDWARE, encoding="utf-8")
    (folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        known = ("--hardware", "hardware.yaml")
        ended = haptune("identify", "log.csv", *COLUMNS, *known, "-o", "device.yaml")
        assert ended.code == 0, ended.err
        assert "along (0.7" in ended.out
        ended = haptune("tune", "device.yaml", "scene.yaml", "-o", "profile.yaml")
        assert ended.code == 0, ended.err
        yield folder


def test_what_is_tuned_is_stable_in_every_direction(room: Path) -> None:
    """Poles of both axes at once, with every wall normal, gain and delay that is claimed."""
    profile = load_profile(room / "profile.yaml")
    gains = {
        name: np.array([each.stiffness, each.damping, each.mass])
        for name, each in profile.elements.items()
    }
    assert gains["wall"][0] > 5_000
    assert gains["cup"][2] > 0.2
    nothing = np.zeros(3)
    fluids = [nothing, gains["water"], gains["cup"], gains["water"] + gains["cup"]]
    worst = 0.0
    for late in (0, 1):
        for gain in (0.01, 0.1, 0.5, 1.0, 1.5, 2.0):
            for normal in np.linspace(0, np.pi, 50, endpoint=False):
                worst = max(worst, _poles(profile, gain, late, nothing, gains["wall"], normal))
            for fluid in fluids[1:]:
                worst = max(worst, _poles(profile, gain, late, fluid, nothing, 0.0))
    assert worst < 1
    # The limit is near: three times the gain is not stable along the lightest direction.
    assert _poles(profile, 4.0, 1, nothing, gains["wall"], 3 * np.pi / 4) > 1


def test_a_profile_of_several_axes_goes_on_to_a_guard(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(room)
    ended = haptune("check", "profile.yaml")
    assert ended.code == 0, ended.err
    profile = load_profile("profile.yaml")
    assert any("every axis of x, y" in each for each in profile.certificate.assumes)
    ended = haptune("export", "profile.yaml", "--to", "c", "-o", "guard")
    assert ended.code == 0, ended.err
    assert "for each of x, y" in ended.out
    ended = haptune("doctor", "log.csv", *COLUMNS, "--hardware", "hardware.yaml")
    assert ended.code == 0, ended.err
    ended = haptune("report", "profile.yaml", "log.csv", *COLUMNS, "-o", "report.html", "--quiet")
    assert ended.code == 0, ended.err


def test_a_hand_on_several_axes_is_refused(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(room)
    Path("held.yaml").write_text(f"{SCENE}hand: free-to-rigid\n", encoding="utf-8")
    ended = haptune("tune", "device.yaml", "held.yaml", "-o", "held-profile.yaml")
    assert ended.code == 5
    assert "a hand holds a device of 2 axes" in ended.err
    assert not Path("held-profile.yaml").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--force", "force_x,force_y", "--position", "position_x"), "names 1 for 2 forces"),
        ((*COLUMNS, "--axis", "x,y,z"), "names 3 for 2 forces"),
        ((*COLUMNS, "--axis", "x,x"), "a name of its own"),
        ((*COLUMNS, "--method", "innovations"), "innovations is for one axis"),
    ],
)
def test_columns_that_do_not_fit_are_refused(
    options: tuple[str, ...], sentence: str, room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(room)
    ended = haptune("identify", "log.csv", *options, "-o", "other.yaml")
    assert ended.code in {2, 3}
    assert sentence in ended.err
    assert not Path("other.yaml").exists()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"axes": None}, "axes and poses belong together"),
        ({"axes": ["x", "y", "z"]}, "need matrices of 3 axes"),
        ({"mass": 3.0}, "over all directions"),
        ({"modes": [{"frequency_hz": 90.0, "damping_ratio": 0.02, "at_encoder": 1.0}]}, "one axis"),
    ],
)
def test_device_files_that_contradict_themselves_are_refused(
    change: dict[str, object], sentence: str, planar: Device
) -> None:
    content = {**ident.to_mapping(planar), **change}
    content = {key: item for key, item in content.items() if item is not None}
    with pytest.raises(InvalidInputError, match=sentence):
        ident.parse_document(Device, content, "device.yaml")
