"""A device of several axes: one log to matrices, one law for every direction, judged from outside.

Truth is a simulator that integrates coupled axes with dry friction by its own means, and the poles
of the loop of all axes at once in a state space of this file's own.
"""

import itertools
import json
import math
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import nnls

import identification as ident
from datasets_synthetic import RigOfAxes, bundled_path
from datasets_synthetic.scenarios import planar_texts
from identification import Device, InvalidInputError, LogRefusedError, UsageError, identify
from tests.commands import haptune
from tests.exported import on_axes
from tests.guard import (
    STATUS,
    Guard,
    GuardOfAxes,
    built,
    compiles,
    enter,
    module_of,
    parameters_of,
    push,
    write,
)
from tests.planar import (
    COLUMNS,
    DAMPING,
    FRICTION,
    MASS,
    STEP,
    hardware,
    motion,
    pose_of,
    tangled,
    write_table,
)
from tests.thinned import thinned
from tune import Scene, export, load_profile, optimise, profile_sheet, verify
from tune.cli.preparation import template
from tune.documents.profile import SafeProfile

FloatArray = NDArray[np.float64]
#: The bundled device in the plane, and the directions in which it is lightest and heaviest.
PLANE = ident.load_mapping(bundled_path("planar.truth.yaml"))
LIGHT, HEAVY = np.linalg.eigh(np.array(PLANE["mass"]))[1].T


@pytest.fixture(scope="module")
def planar() -> Device:
    """The device of [[3, 1], [1, 3]] kg, of a log of 4 s whose motion the hardware states."""
    log = motion(MASS, DAMPING, FRICTION, seed=1).log()
    silent = replace(log, axes=tuple(replace(each, motion=None) for each in log.axes))
    found = identify(silent, hardware=hardware())
    assert "not-stated" not in {each.code for each in found.findings}
    return found.device


def test_principal_masses_are_found(planar: Device) -> None:
    """Axes of 3 kg each have masses of 2 and 4 kg; the limit of a mass follows the lighter."""
    assert planar.axes == ("x", "y")
    pose = pose_of(planar)
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
    least, largest = np.linalg.eigvalsh(DAMPING)
    assert 0.9 * least < box.damping[0] < least
    assert largest < box.damping[1] < 1.1 * largest


def misses(seed: int, axes: int, *, rows: int = 1600, stated: bool = True) -> FloatArray:
    """Errors of all entries of a random device over their deviations, as of a normal variable."""
    chance = np.random.default_rng(seed)
    mass = tangled(chance, axes, 10.0, chance.uniform(0.1, 1.0))
    damping = tangled(chance, axes, 30.0, chance.uniform(0.3, 2.0))
    friction = chance.uniform(0.02, 0.08, axes) * 12.0
    delay = STEP * int(chance.integers(0, 4))
    seen = motion(mass, damping, friction, seed=seed, delay=delay, rows=rows)
    known = hardware(axes=list("xyz"[:axes]), delay=delay if stated else None)
    device = identify(seen.log(), hardware=known, allow=("force-unit",)).device
    pose = pose_of(device)
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


@pytest.mark.parametrize(("seed", "axes", "stated"), [(12, 2, True), (7, 3, True), (5, 2, False)])
def test_random_devices_are_found_within_their_intervals(
    seed: int, axes: int, *, stated: bool
) -> None:
    """Whether their delay is stated or found."""
    assert np.all(np.abs(misses(seed, axes, stated=stated)) < 4)


@pytest.mark.long
def test_intervals_of_three_hundred_devices_cover() -> None:
    """95 % intervals of every entry of both matrices hold 93 to 97.5 % of the truth."""
    found = np.concatenate([misses(1000 + k, 2 + k % 2, rows=10_000) for k in range(300)])
    assert 0.93 < np.mean(np.abs(found) < 1.96) < 0.975


@pytest.mark.parametrize("own", [0.0, 0.0035, 0.02])
def test_one_force_on_both_axes_tells_them_not_apart(own: float) -> None:
    """What both matrices have in common is pushed; hardly anything moves the axes apart."""
    damping = np.array([[11.0, 2.0], [2.0, 11.0]])
    seen = motion(MASS, damping, np.zeros(2), seed=3, own=own, noise=2e-5, rows=4000)
    with pytest.raises(LogRefusedError) as refused:
        identify(seen.log(), hardware=hardware())
    assert "axes-not-told-apart" in {each.code for each in refused.value.findings}


def test_a_tenth_of_a_force_tells_axes_apart() -> None:
    seen = motion(MASS, DAMPING, FRICTION, seed=3, own=0.1)
    box = identify(seen.log(), hardware=hardware()).device.simultaneous_box()
    assert 1.9 < box.mass[0] < 2.0
    assert 4.0 < box.mass[1] < 4.1


def test_ends_of_matrices_are_those_of_the_worst_directions(planar: Device) -> None:
    """Of vᵀMv so many standard deviations away; looked for on a fine grid of directions."""
    pose = pose_of(planar)
    angle = np.linspace(0, np.pi, 20_001)
    x, y = np.cos(angle), np.sin(angle)
    weights = np.stack((x * x, 2 * x * y, y * y))
    places: dict[Literal["mass", "damping"], int] = {"mass": 0, "damping": 3}
    for which, place in places.items():
        matrix = np.array(getattr(pose, which))
        entries = np.array([matrix[0, 0], matrix[0, 1], matrix[1, 1]])
        joint = np.array(pose.covariance.matrix)[place : place + 3, place : place + 3]
        value = entries @ weights
        half = 5.0 * np.sqrt(np.einsum("id,ij,jd->d", weights, joint, weights))
        low, high = value - half, value + half
        if which == "mass":
            low, high = value * np.exp(-half / value), value * np.exp(half / value)
        least, largest = pose.extremes(which, 5.0)
        assert least.value == pytest.approx(np.min(low), rel=1e-5)
        assert largest.value == pytest.approx(np.max(high), rel=1e-5)


def test_a_force_with_the_other_sign_is_named_with_its_axis() -> None:
    """By any method, though most of them find no mass to start from."""
    seen = motion(MASS, DAMPING, FRICTION, seed=2)
    turned = replace(seen, force=seen.force * np.array([1.0, -1.0]))
    methods: tuple[ident.Method, ...] = ("auto", "instruments")
    for method in methods:
        with pytest.raises(LogRefusedError) as refused:
            identify(turned.log(), hardware=hardware(), method=method)
        (found,) = (each for each in refused.value.findings if each.code == "sign-flip")
        assert str(found).startswith("sign-flip: simulated, axis y gives mass -2.")
        assert found.remedy.startswith("Negate the force of y")


@pytest.mark.parametrize(("part", "refused"), [(0.3, ()), (1.0, ("unmodelled-force",))])
def test_friction_of_joints_is_told_with_its_direction(
    part: float, refused: tuple[str, ...]
) -> None:
    """At 30° to the axes it looks like damping; what is told of it is taken out."""
    turn = np.pi / 6
    joints = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    seen = motion(MASS, DAMPING, part * FRICTION, seed=1, joints=joints, rows=2500)
    found = identify(seen.log(), hardware=hardware(), allow="unmodelled-force")
    assert found.device.logs[0].allowed == refused
    (told,) = (each for each in found.findings if each.code == "unmodelled-force")
    friction, x, y = map(
        float, re.findall(r"of (\S+) N acts along \((\S+) x, (\S+) y", told.seen)[0]
    )
    assert friction == pytest.approx(part * FRICTION[0], rel=0.15)
    assert np.allclose((x, y), joints[:, 0], atol=0.05)
    assert told.remedy.startswith("Log and tune in the coordinates of the joints")
    assert np.allclose(pose_of(found.device).damping, DAMPING, atol=2.0)
    box = found.device.simultaneous_box()
    least, largest = np.linalg.eigvalsh(DAMPING)
    assert box.damping[0] < least < largest < box.damping[1]


@pytest.mark.parametrize(
    ("seed", "drift"),
    thinned([(8, 2e-3), (111, 2e-3), (113, 6e-3), (116, 6e-3), (122, 6e-3), (124, 4e-3)], 1),
)
def test_what_no_encoder_explains_is_fitted_by_least_squares_within_its_interval(
    seed: int, drift: float
) -> None:
    """A force beside the logged one; what moves the others hides the delay of each axis."""
    seen = motion(MASS, DAMPING, FRICTION, seed=seed, rows=2500)
    chance = np.random.default_rng(seed)
    beside = drift * np.cumsum(chance.standard_normal(seen.force.shape), axis=1)
    log = replace(seen, force=seen.force - beside + beside.mean(axis=1, keepdims=True)).log()
    device = identify(log, hardware=hardware(delay=None)).device
    assert {each.method for each in device.logs} == {"least-squares"}
    assert not any("unmodelled-force" in each.findings for each in device.logs)
    assert device.delay is not None
    assert device.delay.low < STEP < device.delay.high
    box = device.simultaneous_box()
    for matrix, (low, high) in ((MASS, box.mass), (DAMPING, box.damping)):
        least, largest = np.linalg.eigvalsh(matrix)
        assert low < least < largest < high


def test_hardware_that_only_one_axis_can_have_is_refused() -> None:
    seen = motion(MASS, DAMPING, FRICTION, seed=2).log()
    with pytest.raises(UsageError, match="known of one axis only"):
        identify(seen, hardware=hardware(current_lag=0.001))
    one = ident.Trajectory(
        time=seen.axes[0].time, force=seen.axes[0].force, position=seen.axes[0].position
    )
    with pytest.raises(UsageError, match="of one axis and of several"):
        identify([seen, one], hardware=hardware())


def test_ellipses_have_the_principal_masses_as_half_axes(planar: Device) -> None:
    picture = ident.devices_picture({"now": planar, "a year ago": planar})
    (axes,) = (each for each in picture.axes if each.get_xlabel() == "mass along x, kg")
    ellipses = [np.array(line.get_data()) for line in axes.lines if len(line.get_xdata()) > 2]  # pyright: ignore[reportArgumentType]
    assert len(ellipses) == 2
    radius = np.linalg.norm(ellipses[0], axis=0)
    assert np.allclose([radius.min(), radius.max()], [2.0, 4.0], rtol=0.01)


def test_what_is_felt_in_every_direction_is_drawn_with_each_element(profile: SafeProfile) -> None:
    """An element adds its own mass and damping to the principal ones."""
    (axes,) = (
        each
        for each in profile_sheet(profile).axes
        if each.get_xlabel() == "damping along x, N·s/m"
    )
    own = np.linalg.eigvalsh(np.array(pose_of(profile.device).damping))
    found = {
        str(line.get_label()): np.linalg.norm(np.array(line.get_data()), axis=0)
        for line in axes.lines
        if len(line.get_xdata()) > 2  # pyright: ignore[reportArgumentType]
    }
    assert set(found) == {"alone", "water", "cup", "feather"}
    for name in ("water", "cup", "feather"):
        wanted = own + profile.elements[name].damping
        assert [found[name].min(), found[name].max()] == pytest.approx(wanted, rel=1e-3)


@cache
def one_after_another(heavier: float = 1.0) -> tuple[ident.Trajectories, ...]:
    """A log of each axis, of which the other is driven by nothing and moves with it."""
    return tuple(
        motion(heavier * MASS, DAMPING, FRICTION / 4, seed=3 + axis, only=axis, rows=2500).log()
        for axis in range(2)
    )


@pytest.mark.parametrize("method", ["auto", "instruments"])
def test_axes_driven_one_after_another_make_one_pose(method: ident.Method) -> None:
    logs = one_after_another()
    device = identify(logs, hardware=hardware(), method=method).device
    pose = pose_of(device)
    assert len(device.logs) == 2
    spread = np.sqrt(np.diag(np.array(pose.covariance.matrix)))
    upper = np.triu_indices(2)
    found = np.concatenate([np.array(each)[upper] for each in (pose.mass, pose.damping)])
    truth = np.concatenate([MASS[upper], DAMPING[upper]])
    assert np.all(np.abs(found - truth) < 4 * spread)
    assert np.all(np.abs(found / truth - 1) < 0.02)


def test_logs_of_axes_one_after_another_are_poses_in_their_order() -> None:
    """Every direction of each pose is in the box."""
    logs = (*one_after_another(), *one_after_another(1.5))
    device = identify(logs, hardware=hardware(), method="least-squares").device
    assert device.poses is not None
    for pose, heavier in zip(device.poses, (1.0, 1.5), strict=True):
        assert np.array(pose.mass) == pytest.approx(heavier * MASS, rel=0.01)
    box = device.simultaneous_box()
    assert box.mass[0] < 2.0
    assert box.mass[1] > 6.0


def test_logs_that_leave_an_axis_alone_are_refused_with_its_name() -> None:
    logs = one_after_another()
    with pytest.raises(LogRefusedError, match="no force of its own moves y"):
        identify(logs[0], hardware=hardware())
    with pytest.raises(LogRefusedError, match="no force of its own moves x"):
        identify([*logs, logs[1]], hardware=hardware())
    # Friction holds each while the other is driven: nothing tells what couples them.
    apart = [
        motion(np.diag([3.0, 2.0]), DAMPING, 4 * FRICTION, seed=3, only=axis, rows=1500).log()
        for axis in range(2)
    ]
    with pytest.raises(LogRefusedError, match="x and y never move in one log") as refused:
        identify(apart, hardware=hardware())
    assert "Drive all axes at once" in refused.value.findings[0].remedy


def test_a_spring_on_one_of_several_axes_is_refused_with_what_it_moves() -> None:
    """What is commanded moves the device, once a spring on y has taken its part a sample later."""
    seen = motion(MASS, DAMPING, FRICTION, seed=1)
    place = np.pad(seen.truth[0, :, 1], (0, 2), mode="edge")
    x, y = seen.log().axes
    y = replace(y, force=y.force + 50.0 * (place[1:-1] + place[2:]) / 2)
    pulled = replace(seen.log(), axes=(x, y))
    with pytest.raises(LogRefusedError, match="acts on axis y: mass 3") as refused:
        identify(pulled, hardware=hardware(), method="least-squares")
    (found,) = (each for each in refused.value.findings if each.code == "gravity")
    assert "springs" in found.remedy


class Loop:
    """Both axes, sampled, held, delayed and filtered, with one law on both and a wall."""

    def __init__(self, profile: SafeProfile, mass: FloatArray, damping: FloatArray) -> None:
        plant = np.zeros((6, 6))
        plant[:2, 2:4] = np.eye(2)
        plant[2:4, 2:4] = -np.linalg.solve(mass, damping)
        plant[2:4, 4:] = np.linalg.inv(mass)
        self.held = expm(plant * STEP)[:4]
        loop = profile.loop
        velocity, acceleration = loop.velocity_filter_hz, loop.acceleration_filter_hz
        assert isinstance(velocity, float)
        assert isinstance(acceleration, float)
        assert (loop.velocity_filter_order, loop.acceleration_filter_order) == (1, 2)
        self.a = np.exp(-2 * np.pi * velocity * STEP)
        turn, ratio = 2 * np.pi * acceleration * STEP, loop.filter_damping_ratio
        self.t = 2 * np.exp(-ratio * turn) * np.cos(np.sqrt(1 - ratio**2) * turn)
        self.p = np.exp(-2 * ratio * turn)

    def largest_pole(
        self, everywhere: FloatArray, wall: FloatArray, normal: float, late: int
    ) -> float:
        """Largest modulus of a pole but for those of free motion; gains are K, B and M."""
        along = np.array([np.cos(normal), np.sin(normal)])
        k, b, m = (
            g * np.eye(2) + w * np.outer(along, along)
            for g, w in zip(everywhere, wall, strict=True)
        )

        def after(state: FloatArray) -> FloatArray:
            """A sample later: q, q̇, two readings, filtered velocity, two accelerations, forces."""
            q, v, last, before, slow, now, old, *sent = state.reshape(-1, 2)
            slow = self.a * slow + (1 - self.a) / STEP * (q - last)
            fresh = (1 - self.t + self.p) / STEP**2 * (q - 2 * last + before)
            new = self.t * now - self.p * old + fresh
            moved = self.held @ np.concatenate((q, v, sent[0]))
            force = -(k @ q + b @ slow + m @ new)
            return np.concatenate((moved, q, last, slow, new, now, *sent[1:], force))

        found = np.linalg.eigvals(np.array([after(unit) for unit in np.eye(16 + 2 * late)]).T)
        free = 2 - np.linalg.matrix_rank(k)
        return float(np.max(np.abs(found[np.argsort(np.abs(found - 1.0))][free:])))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log of two axes and what the demo makes of it: filters stated, undrawn."""
    folder = tmp_path_factory.mktemp("planar")
    shutil.copy(bundled_path("planar.csv"), folder / "log.csv")
    shutil.copy(bundled_path("planar.hardware.yaml"), folder / "hardware.yaml")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        text = template("scene").replace("velocity_filter_hz: free", "velocity_filter_hz: 48.8")
        scene = text.replace("acceleration_filter_hz: free", "acceleration_filter_hz: 28.25")
        patch.setattr("tune.cli.profiles.template", lambda _: scene)
        patch.setattr("tune.cli.session.Session.draw", lambda *_: None)
        ended = haptune("demo", "--planar")
    assert ended.code == 0, ended.err
    assert "along (0.8" in ended.out
    return folder


def test_the_bundled_log_is_what_it_is_said_to_be() -> None:
    for name, text in planar_texts().items():
        assert bundled_path(name).read_text(encoding="utf-8") == text


def test_what_is_tuned_is_stable_in_every_direction(room: Path) -> None:
    """Poles of both axes at once, with every wall normal, gain and delay that is claimed."""
    mass, damping = np.array(PLANE["mass"]), np.array(PLANE["damping"])
    profile = load_profile(room / "profile.yaml")
    elements = profile.elements
    gains = {n: np.array([e.stiffness, e.damping, e.mass]) for n, e in elements.items()}
    assert gains["wall"][0] > 10_000
    assert gains["cup"][2] > 1.0
    box = profile.device.simultaneous_box()
    assert box.mass[0] < np.linalg.eigvalsh(mass)[0]
    assert np.linalg.eigvalsh(mass)[-1] < box.mass[1]
    loop = Loop(profile, mass, damping)
    worst, normals = 0.0, np.linspace(0, np.pi, 50, endpoint=False)
    for names in profile.combinations():
        walls = sum((gains[n] for n in names if elements[n].one_sided), np.zeros(3))
        others = sum((gains[n] for n in names if not elements[n].one_sided), np.zeros(3))
        for late in (0, 1):
            for gain in (0.01, 0.1, 0.5, 1.0, 2.0):
                for normal in normals if walls.any() else normals[:1]:
                    found = loop.largest_pole(gain * others, gain * walls, normal, late)
                    worst = max(worst, found)
    assert worst < 1
    # The limit is near: four times the gain is not stable along the lightest direction.
    along = float(np.arctan2(*LIGHT[::-1]))
    assert loop.largest_pole(np.zeros(3), 4 * gains["wall"], along, 1) > 1


def test_a_profile_of_several_axes_goes_on_to_a_guard(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its page too, of which the pictures of elements are those of one axis."""
    monkeypatch.chdir(room)
    monkeypatch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))
    profile = load_profile("profile.yaml")
    (of_axes,) = (each for each in profile.certificate.assumes if "every axis of x, y" in each)
    # What the guard plays: a room of any angles of one wall, several walls along one line alone.
    assert "faces of one wall leave a convex room, those of several walls are parallel" in of_axes
    ended = haptune("export", "profile.yaml", "--to", "c", "-o", "guard")
    assert ended.code == 0, ended.err
    assert "x, y together: haptune_axes_force" in ended.out
    law = json.loads(export(profile, "json")["haptune_profile.json"])["law"]
    assert "vectors of all axes" in law
    ended = haptune("report", "profile.yaml", "log.csv", *COLUMNS, "-o", "report.html", "--quiet")
    assert ended.code == 0, ended.err


def test_a_hand_on_several_axes_is_refused(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(room)
    text = Path("scene.yaml").read_text(encoding="utf-8")
    Path("held.yaml").write_text(text.replace("hand: none", "hand: free-to-rigid"), "utf-8")
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


ONE = {"parameters": ["mass_x_x"], "matrix": [[1.0]], "degrees_of_freedom": 9.0}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"axes": None}, "axes and poses belong together"),
        ({"axes": ["x", "y", "z"]}, "need matrices of 3 axes"),
        ({"mass": 3.0}, "over all directions"),
        ({"poses": {"mass": [[3.0, 1.0]]}}, "mass must have 1 rows of 1 numbers"),
        ({"poses": {"damping": [[9.0, 1.0], [2.0, 9.0]]}}, "damping must be symmetric"),
        ({"poses": {"force_offset": [0.0]}}, "need 2 numbers"),
        ({"poses": {"covariance": ONE}}, "pose needs the parameters mass_x_x, mass_x_y, mass_y_y,"),
        ({"poses": {"mass": [[1.0, 2.0], [2.0, 1.0]]}}, "mass is -1 in some direction"),
        ({"modes": [{"frequency_hz": 90.0, "damping_ratio": 0.02, "at_encoder": 1.0}]}, "one axis"),
    ],
)
def test_device_files_that_contradict_themselves_are_refused(
    change: dict[str, object], sentence: str, planar: Device
) -> None:
    content = {**ident.to_mapping(planar), **change}
    if isinstance(pose := change.get("poses"), dict):
        content["poses"] = [{**ident.to_mapping(planar)["poses"][0], **pose}]
    content = {key: item for key, item in content.items() if item is not None}
    with pytest.raises(InvalidInputError, match=sentence):
        ident.parse_document(Device, content, "device.yaml")


@pytest.fixture(scope="module")
def profile(room: Path) -> SafeProfile:
    return load_profile(room / "profile.yaml")


@pytest.fixture(scope="module")
def guard(room: Path, profile: SafeProfile) -> GuardOfAxes:
    return GuardOfAxes(profile, room / "axes")


@pytest.fixture(scope="module")
def single(room: Path, profile: SafeProfile) -> Guard:
    (room / "single").mkdir()
    return built(export(profile, "c"), room / "single")


@pytest.mark.parametrize("name", ["water", "cup", "rubber", "wall"])
def test_along_any_line_the_guard_of_axes_plays_what_that_of_one_plays(
    single: Guard, guard: GuardOfAxes, name: str
) -> None:
    """A wavering motion along a line, periods missed, a gain that moves, more than springs hold."""
    chance = np.random.default_rng(3)
    line = np.array([0.6, -0.8])
    bits = guard.bits
    single.start()
    guard.start()
    assert single.call(enter(bits[name], 2e-4, 1)).status == "OK"
    wall = name == "wall"
    placed = guard.place(3, bits[name], line.tolist(), 2e-4) if wall else guard.enter(bits[name])
    assert placed == "OK"
    place = np.cumsum(np.cumsum(chance.normal(size=900)) - np.cumsum(chance.normal(size=900)))
    place *= 0.03 / np.max(np.abs(place))
    seen, cut, missed = 0.0, 0, 0
    for k in range(900):
        if chance.random() < 0.05:
            continue
        gain = float(chance.choice([1.0, 1.0, 1.0, 0.4]))
        there = k % 300 > 20
        along = single.call(push(bits[name] * there, k, place[k], gain))
        elements, faces = (0, 8 * there) if wall else (bits[name] * there, 0)
        reply = guard.push(elements, faces, k, place[k] * line, gain)
        assert reply.status == along.status
        assert (reply.clamped, reply.missed) == (along.clamped, along.missed)
        assert reply.force == pytest.approx(along.force * line, rel=1e-9, abs=1e-9)
        seen, cut, missed = max(seen, abs(along.force)), cut + along.clamped, along.missed
    assert seen > 0.1
    assert missed > 10
    assert (cut > 10) == (name in {"rubber", "wall"})


def test_a_force_that_is_cut_keeps_its_direction(profile: SafeProfile, guard: GuardOfAxes) -> None:
    rubber = profile.elements["rubber"]
    guard.start()
    guard.enter(guard.bits["rubber"] | guard.bits["water"])
    pulled = np.array([0.8, 0.6]) * 2 * rubber.force_level / rubber.stiffness
    for k in range(1000):
        guard.push(guard.bits["rubber"], 0, k, (k / 1000 * pulled).tolist())
    for k in range(1000, 2000):
        guard.push(guard.bits["rubber"], 0, k, pulled.tolist())
    reply = guard.push(guard.bits["rubber"], 0, 2000, pulled.tolist())
    assert reply.clamped
    assert reply.force == pytest.approx(-rubber.force_level * np.array([0.8, 0.6]), rel=1e-9)


def test_in_a_corner_under_water_the_sum_is_cut_at_the_peak(
    profile: SafeProfile, guard: GuardOfAxes
) -> None:
    limit = profile.device.force_limit
    bits = guard.bits
    assert limit is not None
    guard.start()
    guard.enter(bits["water"])
    for face, normal in enumerate(((0.6, 0.8), (0.8, -0.6))):
        assert guard.place(face, bits["wall"], normal, 0.0) == "OK"
    into = np.array([-1.4, -0.2]) / 2**0.5
    replies = [guard.push(bits["water"], 3, k, (1e-6 * k**2 * into).tolist()) for k in range(1500)]
    reply = replies[-1]
    assert reply.clamped
    assert reply.force == pytest.approx(-limit.peak * into, rel=1e-9)
    # Not by one rounding more, to whatever side it is pushed out.
    for k in range(1500, 1900):
        turned = into + 1e-7 * (k - 1500) ** 2 * np.array([-into[1], into[0]])
        reply = guard.push(bits["water"], 3, k, (1e-6 * k**2 * turned).tolist())
        assert reply.clamped
        assert math.hypot(*reply.force) <= limit.peak


@pytest.mark.parametrize("axes", [2, 3])
def test_the_guard_of_axes_compiles_without_a_warning_however_it_is_optimised(
    axes: int, tmp_path: Path
) -> None:
    write(export(on_axes(axes), "c"), tmp_path)
    assert compiles(tmp_path, "-O3") == ""


def test_two_laws_at_an_angle_are_not_certified(tmp_path: Path) -> None:
    made = on_axes(2)
    guard = GuardOfAxes(made, tmp_path / "guard")
    for names, state in ((("wall", "wall"), "OK"), (("wall", "other"), "NOT_TOGETHER")):
        law = law_of_axes(made, tmp_path)
        guard.start()
        for face, (name, normal) in enumerate(zip(names, ((1.0, 0.0), (0.0, 1.0)), strict=True)):
            assert guard.place(face, guard.bits[name], normal, -0.01) == "OK"
            assert law.place(str(face), name, normal, -0.01).name == "OK"
        assert guard.push(0, 3, 0, (0.0, 0.0)).status == state
        law.force([], ["0", "1"], 0, [0.0, 0.0])
        assert law.status.name == state


def test_faces_that_are_not_certified_together_give_no_force(guard: GuardOfAxes) -> None:
    periods = iter(range(100))
    bits = guard.bits

    def start(*placed: tuple[float, float, float], state: str = "OK") -> None:
        guard.start()
        told = [guard.place(k, bits["wall"], each[:2], each[2]) for k, each in enumerate(placed)]
        assert told == ["OK"] * (len(placed) - 1) + [state]

    def status(faces: int, elements: int = 0) -> str:
        reply = guard.push(elements, faces, next(periods), (0.0, 0.0))
        assert not reply.force.any()
        return reply.status

    start((1.0, 0.0, -0.01), (0.0, -1.0, -0.01), (-1.0, 0.0, -0.01), (0.6, 0.8, -0.01))
    assert status(7) == "OK"  # a room of three sides
    assert status(15) == "OK"  # one more, askew
    start((1.0, 0.0, 0.01), (-1.0, 0.0, 0.01))
    assert status(3) == "TOO_NARROW"
    start((0.6, 0.8, 1e-6), (0.6, -0.8, 1e-6), (-1.0, 0.0, -1e-6))
    assert status(7) == "TOO_NARROW"  # no place is within all three
    start((1.0, 0.1, 0.0), state="NO_SIDE")
    assert status(1) == "NOT_ENTERED"
    start((np.nan, 0.1, 0.0), state="NOT_FINITE")
    start((1.0, 0.0, np.inf), state="NOT_FINITE")
    start((1.0, 0.0, -0.01))
    assert guard.place(16, bits["wall"], (1.0, 0.0), 0.0) == "NOT_TOGETHER"
    assert guard.place(1, bits["water"], (1.0, 0.0), 0.0) == "NOT_TOGETHER"
    assert guard.place(1, bits["wall"] | bits["water"], (1.0, 0.0), 0.0) == "NOT_TOGETHER"
    assert guard.enter(bits["wall"]) == "NOT_TOGETHER"
    assert guard.enter(bits["feather"] | bits["cup"] | bits["water"]) == "OK"
    assert status(1, bits["feather"]) == "NOT_TOGETHER"  # apart
    assert status(1 << 16) == "NOT_ENTERED"


def nearest(point: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """The nearest place of a room by least distance programming: Lawson and Hanson 1974, ch. 23."""
    columns = np.vstack([normals.T, offsets - normals @ point])
    aim = np.append(np.zeros(len(point)), 1.0)
    left = columns @ nnls(columns, aim)[0] - aim
    return np.asarray(point - left[:-1] / left[-1])


@pytest.mark.parametrize(("axes", "counts"), [(2, (3, 7)), (3, (4, 16)), (6, (9,))])
def test_a_wall_pushes_back_to_the_nearest_place_of_its_room(
    axes: int, counts: tuple[int, ...], tmp_path: Path
) -> None:
    """A hand that has come to rest beyond faces of any angles, sharp corners among them."""
    made = on_axes(axes)
    wall = made.elements["wall"].model_copy(update={"force_level": 9.0})
    made = made.model_copy(update={"elements": {**made.elements, "wall": wall}}).signed()
    guard = GuardOfAxes(made, tmp_path / "guard")
    cuts = 0
    for count, seed in itertools.product(counts, range(8)):
        chance = np.random.default_rng(seed)
        normals = chance.normal(size=(count, axes))
        normals[-1] = 0.05 * normals[-1] - normals[0]  # a narrow wedge
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        offsets = -chance.uniform(1e-4, 0.01, count)
        end = chance.normal(size=axes)
        end *= chance.uniform(0.01, 0.05) / np.linalg.norm(end)
        guard.start()
        for face, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
            assert guard.place(face, 1, normal.tolist(), offset) == "OK"
        way = [*np.linspace(0, 1, 800), *np.ones(700)]
        replies = [guard.push(0, 2**count - 1, k, (at * end).tolist()) for k, at in enumerate(way)]
        reply = replies[-1]
        wanted = wall.stiffness * (nearest(end, normals, offsets) - end)
        length = np.linalg.norm(wanted)
        cuts += length > wall.force_level
        wanted *= min(1.0, wall.force_level / max(length, 1e-12))
        assert reply.force == pytest.approx(wanted, rel=1e-7, abs=1e-7)
        assert reply.clamped == (length > wall.force_level)
    assert cuts > 0


def test_a_face_that_comes_while_its_wall_pushes_adds_nothing(
    guard: GuardOfAxes, profile: SafeProfile
) -> None:
    """Beyond it as what pushes leaves the hand, it stands in its place after that was left."""
    guard.start()
    periods, at = itertools.count(), 1e-4
    normals = np.array([[0.0, 1.0], [0.8, 0.6]])

    def held(height: float, faces: int) -> FloatArray:
        nonlocal at
        way = [*np.linspace(at, height, 200), *[height] * 500]
        replies = [guard.push(0, faces, next(periods), (0.0, there)) for there in way]
        assert {reply.status for reply in replies} == {"OK"}
        at = height
        return replies[-1].force

    assert guard.place(0, guard.bits["wall"], normals[0].tolist(), 0.0) == "OK"
    assert not held(1e-4, 1).any()
    before = held(-3e-4, 1)
    assert before[1] > 1
    assert guard.place(1, guard.bits["wall"], normals[1].tolist(), 2e-4) == "OK"
    assert held(-3e-4, 3) == pytest.approx(before, abs=1e-9)
    assert held(2e-4, 3) == pytest.approx([0.0, 0.0], abs=1e-9)  # behind it, no farther
    assert not held(5e-4, 3).any()
    wall = profile.elements["wall"]
    expected = wall.stiffness * (2e-4 - 0.6 * 2e-4) * normals[1]
    assert held(2e-4, 3) == pytest.approx(expected, rel=1e-9)


def test_a_face_moves_only_while_it_gives_no_force_and_a_gap_ends_all(guard: GuardOfAxes) -> None:
    guard.start()
    assert guard.place(0, guard.bits["wall"], (0.0, 1.0), 0.0) == "OK"
    replies = [guard.push(0, 1, k, (1e-3, 1e-5 * (20 - k))) for k in range(100)]
    reply = replies[-1]
    assert reply.force[0] == 0
    assert reply.force[1] > 1
    assert guard.place(0, guard.bits["wall"], (1.0, 0.0), 0.0) == "PUSHING"
    assert guard.place(1, guard.bits["wall"], (0.0, 1.0), -8.05e-4) == "OK"
    reply = guard.push(0, 2, 100, (1e-3, -8e-4))  # its damper is met before it
    assert reply.force[1] > 0.1
    assert guard.place(1, guard.bits["wall"], (1.0, 0.0), 0.0) == "PUSHING"
    held = guard.push(0, 2, 101, (1e-3, np.nan))
    assert held.status == "NOT_FINITE"
    assert held.force == pytest.approx(reply.force, abs=0)
    jumped = guard.push(0, 2, 102, (0.5, -8e-4))
    assert jumped.status == "LATE"
    assert not jumped.force.any()
    assert guard.push(0, 2, 103, (1e-3, -8e-4)).status in {"NOT_ENTERED", "LATE"}


def test_fades_stand_still_while_a_face_pushes(guard: GuardOfAxes) -> None:
    """A cup that is entered in the wall has no force before it is out of it."""
    for pushing in (False, True):
        guard.start()
        guard.enter(guard.bits["cup"])
        assert guard.place(0, guard.bits["wall"], (0.0, 1.0), 0.0 if pushing else -1.0) == "OK"
        replies = [
            guard.push(guard.bits["cup"] * (k > 150), 1, k, (1e-5 * k, 1e-5 * (20 - k)))
            for k in range(200)
        ]
        reply = replies[-1]
        assert (reply.force[1] > 1) == pushing
        assert (reply.force[0] == 0) == pushing


def law_of_axes(profile: SafeProfile, folder: Path) -> Any:
    """The law of several axes as the files of ROS 2 have it."""
    files = export(profile, "ros2")
    write(files, folder)
    with pytest.MonkeyPatch.context() as patched:
        module_of(folder, "haptune_law", patched)
        module = module_of(folder, "haptune_axes", patched)
    return module.LawOfAxes(parameters_of(files["haptune_params.yaml"]))


@pytest.mark.parametrize("axes", [2, 3])
def test_the_law_of_axes_in_python_keeps_to_the_guard(
    profile: SafeProfile, axes: int, tmp_path: Path
) -> None:
    """Thousands of calls of every kind, wrong ones among them: states alike, forces to rounding."""
    made = on_axes(axes, profile)
    guard = GuardOfAxes(made, tmp_path / "guard")
    law = law_of_axes(made, tmp_path)
    guard.start()
    chance = np.random.default_rng(axes + 5)
    fluids = [["water"], ["cup"], ["rubber"], ["water", "rubber"], ["cup", "water"], ["wall"], []]
    normals = [*np.eye(axes), -np.eye(axes)[0], *chance.normal(size=(3, axes))]
    normals = [each / np.linalg.norm(each) for each in normals] + [1.1 * np.eye(axes)[0]]
    touched, faces, place, way = fluids[0], [0], np.zeros(axes), np.zeros(axes)
    seen: set[str] = set()
    largest = 0.0
    for k in range(10_000):
        draw = chance.random()
        if draw < 0.01:
            touched = fluids[chance.integers(len(fluids))]
            faces = chance.choice(4, chance.integers(4), replace=False).tolist()
        elif draw < 0.02:
            told = guard.enter(sum(guard.bits[name] for name in touched))
            assert law.enter(touched).name == told
            seen.add(told)
        elif draw < 0.05:
            face, normal = int(chance.integers(4)), normals[chance.integers(len(normals))].tolist()
            offset = float(place @ normal + chance.choice([0.0, -0.003, 0.001, np.nan]))
            element = str(chance.choice(["wall", "wall", "wall", "water"]))
            told = guard.place(face, guard.bits[element], normal, offset)
            assert law.place(str(face), element, normal, offset).name == told
            seen.add(told)
        way += 2e-6 * chance.normal(size=axes) - 5e-4 * place - 0.01 * way
        place = place + way
        period, reading, gain = k, place.tolist(), 1.0
        draw = chance.random()
        if draw < 0.01:
            continue
        if draw < 0.02:
            reading[chance.integers(axes)] += float(chance.choice([np.nan, 0.3]))
        elif draw < 0.025:
            period -= 1
        elif draw < 0.1:
            gain = float(chance.choice([0.0, 0.5, 1.5]))
        chosen = sum(1 << face for face in faces)
        reply = guard.push(sum(guard.bits[name] for name in touched), chosen, period, reading, gain)
        force = law.force(touched, [str(face) for face in faces], period, reading, gain)
        assert (law.status.name, law.clamped) == (reply.status, reply.clamped)
        assert (law.missed, law.glitches) == (reply.missed, reply.glitches)
        assert force == pytest.approx(reply.force, rel=1e-11, abs=1e-12)
        seen.add(reply.status)
        largest = max(largest, float(np.linalg.norm(force)))
    assert largest > 5
    assert seen == set(STATUS)


def rig_of(mass: ArrayLike, damping: ArrayLike, friction: ArrayLike = 0.0) -> RigOfAxes:
    """A true device, with a sample of delay and counts of 6 µm."""
    return RigOfAxes(
        mass=np.array([mass]),
        damping=np.array([damping]),
        coulomb_friction=np.array([np.broadcast_to(friction, len(np.array(mass)))]),
        sample_time=STEP,
        delay=STEP,
        encoder_resolution=6e-6,
    )


def test_the_guard_of_all_axes_makes_nothing_grow(profile: SafeProfile, guard: GuardOfAxes) -> None:
    """The compiled guard on the true device without friction: fast into corners, or adversely held.

    A room that stands askew, whose faces come and go, with right angles or corners of 60 degrees, a
    fluid switched at any moment: however fast it comes in, the device ends slower, nothing is above
    the peak, and no wall pulls.
    """
    rig = rig_of(PLANE["mass"], PLANE["damping"])
    for seed in range(4):
        angles = 0.3 + 2 * np.pi * np.arange(4 - seed % 2) / (4 - seed % 2)
        room = np.column_stack([np.cos(angles), np.sin(angles)])
        nothing_grows(guard, profile, rig, room, seed)


SCENE = """\
schema: haptune/scene/1
name: room
margin: balanced
elements:
  wall: {stiffness: max, damping: max, one_sided: true}
  water: {damping: DAMPING}
  cup: {mass: MASS, damping: DAMPING}
"""


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100))
def test_the_guard_of_a_random_device_makes_nothing_grow(seed: int, tmp_path: Path) -> None:
    """From its log to its compiled guard; the true device in a room that stands askew."""
    chance = np.random.default_rng(seed)
    axes = 2 + seed % 2
    mass = tangled(chance, axes, 10.0, float(chance.uniform(0.3, 3.0)))
    damping = tangled(chance, axes, 30.0, float(chance.uniform(0.5, 3.0)))
    seen = motion(mass, damping, np.full(axes, 0.3), seed=seed, rows=8000)
    names = ["x", "y", "z"][:axes]
    device = identify(seen.log(), hardware=hardware(axes=names)).device
    # A fifth more than what the heaviest, stickiest direction has of its own.
    sizes = {"MASS": 0.2 * np.linalg.eigvalsh(mass)[-1], "DAMPING": np.linalg.eigvalsh(damping)[-1]}
    text = SCENE
    for word, size in sizes.items():
        text = text.replace(word, f"{size:.3g}")
    made = optimise(device, ident.parse_document(Scene, ident.load_mapping("scene", text), "scene"))
    rig = rig_of(mass, damping)
    turned = np.linalg.qr(chance.standard_normal((axes, axes)))[0]
    guard = GuardOfAxes(made, tmp_path / "guard")
    sharp = chance.standard_normal((axes + 1, axes))
    sharp[-1] = -sharp[:-1].sum(0)  # any corners: a triangle, a tetrahedron
    sharp /= np.linalg.norm(sharp, axis=1)[:, None]
    for play in range(6):
        faces = sharp if play % 3 == 2 else np.concatenate((turned, -turned))
        nothing_grows(guard, made, rig, faces, play)


def nothing_grows(
    guard: GuardOfAxes, profile: SafeProfile, rig: RigOfAxes, normals: FloatArray, seed: int
) -> None:
    limit = profile.device.force_limit
    assert limit is not None
    chance = np.random.default_rng(seed)
    guard.start()
    met = {name for names in profile.combinations() if "wall" in names for name in names}
    fluids = [name for name in ("water", "cup") if name in met]
    assert guard.enter(sum(guard.bits[name] for name in fluids)) == "OK"
    for face, normal in enumerate(normals):
        assert guard.place(face, guard.bits["wall"], normal.tolist(), -0.02) == "OK"
    wet, faces, fluid = True, 2 ** len(normals) - 1, fluids[seed % len(fluids)] if fluids else None

    def law(k: int, seen: FloatArray) -> FloatArray:
        nonlocal wet, faces
        wet ^= chance.random() < 0.01
        if chance.random() < 0.004:
            faces ^= 1 << chance.integers(len(normals))
        chosen = guard.bits[fluid] if wet and fluid else 0
        reply = guard.push(chosen, faces, k, seen[0].tolist())
        assert reply.status == "OK"
        assert np.linalg.norm(reply.force) <= (1 + 1e-12) * limit.peak
        if fluid != "cup" and not chosen:  # walls alone push towards the middle
            assert seen[0] @ reply.force <= 1e-12
        return reply.force[None]

    # A blow of 30 ms, over before any wall.
    way = chance.normal(size=normals.shape[1])
    pushed = np.zeros((1, 3000, len(way)))
    pushed[0, :30] = 10 * np.linalg.eigvalsh(rig.mass[0])[0] * way / np.linalg.norm(way)
    played = rig.run(pushed, law=law)
    energy = 0.5 * np.einsum("ka,ab,kb->k", played.speed[0], rig.mass[0], played.speed[0])
    assert np.max(np.abs(played.truth[0, :35])) < 0.01
    assert np.max(energy[35:]) <= 1.001 * energy[35]
    assert energy[-1] < 0.5 * energy[35]


#: Part of the full gain, the sample at which the hand lets go, and s until it has.
GAIN, GONE, RELEASE = 0.9, 700, 0.702


def played(
    guard: GuardOfAxes,
    hand: FloatArray,
    *,
    element: str = "rubber",
    normal: FloatArray | None = None,
    told: tuple[float, float] = (1.0, 1.0),
    holds: FloatArray | None = None,
) -> ident.Trajectories:
    """What the guard commands at a gain while a hand pulls the true device there, and lets go.

    The hand's force is beside what it takes to slide each axis. Forces of the guard reach the
    motors, and the log, times those told of each axis. What ``holds`` is friction of each axis.
    """
    friction = PLANE["coulomb_friction"]
    rig = rig_of(PLANE["mass"], PLANE["damping"], friction if holds is None else holds)
    guard.start()
    chosen = 0 if normal is not None else guard.bits[element]
    if normal is None:
        assert guard.enter(chosen) == "OK"
    else:
        assert guard.place(0, guard.bits[element], normal.tolist(), 0.0) == "OK"
    commands: list[FloatArray] = []

    def law(k: int, seen: FloatArray) -> FloatArray:
        reply = guard.push(chosen, int(normal is not None), k, seen[0].tolist(), GAIN)
        commands.append(np.array(reply.force) * told)
        return commands[-1][None]

    pushed = np.zeros((1, 2500, 2))
    pushed[0, :GONE] = hand + np.sign(hand) * friction
    position = rig.run(pushed, law=law).position[0]
    force: FloatArray = np.round(np.array(commands), 5).astype(np.float64)
    return ident.Trajectories(
        axes=tuple(
            ident.Trajectory(
                time=np.linspace(0.0, 2499 * STEP, 2500),
                force=force[:, place],
                position=position[:, place],
                axis=axis,
                motion="linear",
                may_stand=True,
            )
            for place, axis in enumerate("xy")
        )
    )


@pytest.mark.parametrize(
    ("way", "assessed", "holds"),
    [
        (LIGHT, False, None),
        (HEAVY, True, None),
        (np.array([1.0, 0.0]), True, np.array([PLANE["coulomb_friction"][0], 1e6])),
    ],
    ids=["light", "heavy", "rail"],
)
def test_a_spring_let_go_along_a_line_agrees(
    way: FloatArray,
    *,
    assessed: bool,
    holds: FloatArray | None,
    profile: SafeProfile,
    guard: GuardOfAxes,
) -> None:
    """A principal one, on the lighter of which friction bends the motion too much, or a rail."""
    seen = verify(profile, played(guard, 7.5 * way, holds=holds), release=RELEASE)
    assert seen.elements == ("rubber",)
    assert seen.assessed == assessed
    assert not seen.disagreements
    assert seen.gain == pytest.approx(GAIN, rel=1e-4)
    assert abs(np.dot(seen.direction or (), way)) > 0.99
    assert seen.motion is not None
    assert seen.motion.measured is not None
    K = GAIN * profile.elements["rubber"].stiffness
    hertz = np.sqrt(K / (way @ np.array(PLANE["mass"]) @ way)) / (2 * np.pi)
    assert seen.motion.measured.frequency == pytest.approx(hertz, rel=0.02)


def test_a_wall_askew_is_seen_with_its_normal(profile: SafeProfile, guard: GuardOfAxes) -> None:
    normal = np.array([0.6, 0.8])
    log = played(guard, np.array([-4.0, -3.0]), element="wall", normal=normal)
    seen = verify(profile, log, release=RELEASE)
    assert seen.direction == pytest.approx(normal, abs=1e-4)
    found = {each.check: each.verdict for each in seen.outcomes}
    assert [found[check] for check in ("encoder", "law", "gain", "across")] == ["agrees"] * 4
    # A force beside the wall that is none of its own.
    bent = replace(log.axes[0], force=log.axes[0].force + 0.2 * np.sin(40 * log.axes[0].time))
    found = {
        each.check: each.verdict
        for each in verify(profile, replace(log, axes=(bent, log.axes[1]))).outcomes
    }
    assert "disagrees" in {found["law"], found["across"]}


def test_a_gain_of_one_axis_is_told_from_that_of_all(
    profile: SafeProfile, guard: GuardOfAxes
) -> None:
    log = played(guard, 7.5 * LIGHT, told=(1.0, 0.9))
    across = next(e for e in verify(profile, log, release=RELEASE).outcomes if e.check == "across")
    assert across.verdict == "disagrees"
    assert "same gain on all axes" in across.remedy


def test_motion_that_leaves_its_line_tells_the_law_only(
    profile: SafeProfile, guard: GuardOfAxes
) -> None:
    """Far from a principal axis both swing, each at its own frequency."""
    log = played(guard, 7.5 * (LIGHT + HEAVY) / np.sqrt(2))
    seen = verify(profile, log, release=RELEASE)
    found = {each.check: each for each in seen.outcomes}
    assert found["law"].verdict == found["across"].verdict == "agrees"
    assert not seen.assessed
    assert "principal direction" in found["frequency"].remedy


def write_log(log: ident.Trajectories, name: str) -> None:
    """A file of the log, in the current folder."""
    columns = [log.axes[0].time, *(a.force for a in log.axes), *(a.position for a in log.axes)]
    write_table(np.column_stack(columns), name)


def test_verify_compares_and_plans_along_principal_axes(
    room: Path, profile: SafeProfile, guard: GuardOfAxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(room)
    write_log(played(guard, 7.5 * HEAVY), "played.csv")
    verify_it = ("verify", "profile.yaml", "played.csv")
    ended = haptune(*verify_it, *COLUMNS, "--release", str(RELEASE), "--json")
    assert ended.code == 0, ended.out + ended.err
    told = json.loads(ended.out)["details"]
    assert abs(np.dot(told["direction"], HEAVY)) > 0.99
    assert told["elements"] == ["rubber"]
    ended = haptune("verify", "profile.yaml", "--element", "rubber", "--json")
    assert ended.code == 0, ended.err
    ways = [each["play"]["direction"] for each in json.loads(ended.out)["details"]["play"]]
    assert np.abs(np.array(ways) @ np.array([LIGHT, HEAVY]).T) == pytest.approx(np.eye(2), abs=0.1)
    # So far that the guard cuts no force of it.
    rubber = profile.elements["rubber"]
    for each in json.loads(ended.out)["details"]["play"]:
        assert 0 < each["play"]["displacement"] * rubber.stiffness < rubber.force_level
    ended = haptune(*verify_it, *COLUMNS, "--element", "wall+water")
    assert ended.code == 2
    assert "Play and compare the wall alone" in ended.err
    ended = haptune(*verify_it, "--force", "force_x", "--position", "position_x")
    assert ended.code == 2
    assert "of all axes in this order" in ended.err


def test_what_does_not_tell_is_to_be_played_along_a_principal_direction(
    room: Path, profile: SafeProfile, guard: GuardOfAxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(room)
    write_log(played(guard, 7.5 * (LIGHT + HEAVY) / np.sqrt(2)), "askew.csv")
    ended = haptune("verify", "profile.yaml", "askew.csv", *COLUMNS, "--release", str(RELEASE))
    assert ended.code == 4
    (x, y) = re.findall(r"Instead along \((\S+) x, (\S+) y\): play rubber", ended.err)[0]
    assert abs(np.array([float(x), float(y)]) @ HEAVY) > 0.99
