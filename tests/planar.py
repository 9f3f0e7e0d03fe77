"""Devices of two and three axes for tests: random ones, forces that tell their axes apart, logs."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import identification as ident
from datasets_synthetic import Motions, RigOfAxes

FloatArray = NDArray[np.float64]

STEP = 1e-3
#: The device whose axes are not its principal ones: of 3 kg each, and of 2 and 4 kg.
MASS = np.array([[3.0, 1.0], [1.0, 3.0]])
DAMPING = np.array([[10.0, 2.0], [2.0, 12.0]])
FRICTION = np.array([0.8, 0.7])
HARDWARE = """\
schema: haptune/hardware/1
name: planar
axes: [x, y]
motion: linear
sample_time: 0.001
delay: 0.001
encoder_resolution: 0.000006
force_limit: {continuous: 9.0, peak: 28.0}
"""

#: What names the columns of a log of both axes.
COLUMNS = ("--force", "force_x,force_y", "--position", "position_x,position_y")


def hardware(**given: object) -> ident.Hardware:
    """What is known of the device, some of it stated otherwise."""
    content = ident.load_mapping("hardware.yaml", HARDWARE) | given
    return ident.parse_document(ident.Hardware, content, "hardware.yaml")


def write_table(table: FloatArray, name: str, y: str = "position_y") -> None:
    """A log of both axes as a file; its last column may be named otherwise."""
    header = f"time,force_x,force_y,position_x,{y}"
    np.savetxt(name, table, "%.9g", ",", header=header, comments="")


def pose_of(device: ident.Device) -> ident.Pose:
    """The one pose of a device."""
    assert device.poses is not None
    (pose,) = device.poses
    return pose


def tangled(chance: np.random.Generator, axes: int, ratio: float, least: float) -> FloatArray:
    """A symmetric matrix with eigenvalues from ``least`` to ``ratio`` times it."""
    turned = np.linalg.qr(chance.standard_normal((axes, axes)))[0]
    sizes = least * np.exp(chance.uniform(0, np.log(ratio), axes))
    matrix = (turned * sizes) @ turned.T
    return (matrix + matrix.T) / 2


def forces(
    chance: np.random.Generator, mass: FloatArray, damping: FloatArray, most: FloatArray, rows: int
) -> FloatArray:
    """A multisine of its own for each axis, N, shape (rows, axes), rising over a second."""
    time = STEP * np.arange(rows)
    found = np.zeros((rows, len(mass)))
    for axis in range(len(mass)):
        omega = 2 * np.pi * np.geomspace(0.3, 12, 14) * chance.uniform(0.95, 1.05, 14)
        phase = chance.uniform(0, 2 * np.pi, 14)
        size = np.hypot(omega * mass[axis, axis], damping[axis, axis])
        size = size * np.sqrt(omega / (1 + (omega / 30) ** 2))
        wave = np.sum(size[:, None] * np.sin(omega[:, None] * time + phase[:, None]), axis=0)
        found[:, axis] = most[axis] * wave / np.max(np.abs(wave))
    return found * np.minimum(1.0, time)[:, None]


def motion(
    mass: FloatArray,
    damping: FloatArray,
    friction: FloatArray,
    *,
    seed: int,
    delay: float = STEP,
    rows: int = 1600,
    most: float = 12.0,
    own: float = 1.0,
    noise: float = 5e-6,
    only: int | None = None,
    joints: FloatArray | None = None,
) -> Motions:
    """One device driven along all axes, by one common force but for ``own`` of each one's own.

    With ``only`` the others are driven by nothing. Friction acts along the axes, or along the
    columns of ``joints``, which are orthonormal, and so does the rest of what is not logged.
    """
    chance = np.random.default_rng(seed)
    axes = len(mass)
    force = forces(chance, mass, damping, np.full(axes, most), rows)
    force[:, 1:] = (own < 1) * force[:, :1] + own * force[:, 1:]
    if only is not None:
        force[:, np.arange(axes) != only] = 0.0
    turn = np.eye(axes) if joints is None else joints
    rig = RigOfAxes(
        mass=(turn.T @ mass @ turn)[None],
        damping=(turn.T @ damping @ turn)[None],
        sample_time=STEP,
        delay=delay,
        coulomb_friction=friction[None],
        force_offset=chance.uniform(-0.05, 0.05, (1, axes)),
        encoder_resolution=6e-6,
        position_noise=noise,
    )
    seen = rig.run((force @ turn)[None], seed=seed)
    return replace(seen, force=force[None], position=seen.position @ turn.T)
