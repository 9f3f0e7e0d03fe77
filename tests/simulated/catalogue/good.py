"""Logs that are what they should be: none of them may be refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Clock, Faults, Rig, Servo, simulate
from datasets_synthetic.device import Motion
from tests.simulated.catalogue.motions import Course, chirp, multisine, point_to_point
from tests.simulated.catalogue.raw import RawLog

FloatArray = NDArray[np.float64]

#: Devices are drawn between these, evenly on a logarithmic scale: mass in kg and half range in m,
#: or inertia in kg·m² and half range in rad: a joint of a robot, or a servo drive of 1e-5 kg·m².
_SIZES: dict[Motion, tuple[tuple[float, float], tuple[float, float]]] = {
    "linear": ((0.05, 95.0), (0.02, 0.2)),
    "rotary": ((1e-5, 0.5), (0.3, 6.0)),
}
_TIME_CONSTANT = (0.1, 3.0)  # m/b, s
_COUNTS = (2e3, 1e5)  # counts in the half range
_FRICTION = (0.01, 0.15)  # Coulomb friction, part of the rms force of mass and damping
_UNKNOWN_FORCE = (1e-4, 5e-3)  # rms of white unlogged force, part of the same
_NOISE = (0.05, 2.0)  # rms noise of position in counts
_LOWEST, _HIGHEST = (0.15, 0.4), (3.0, 8.0)  # Hz, slowest and fastest of a motion
_STEPS = (0.0005, 0.001, 0.002)  # s
_BANDWIDTH = (3.0, 6.0)  # Hz of a servo
_JITTER = 0.03  # rms of the stamps, part of a step, in a quarter of the logs
_DROPPED = 0.01  # part of the rows lost, in a quarter of the logs
_SAMPLES = 8000
_COURSES: tuple[Callable[[FloatArray, float, float, int], Course], ...] = (
    multisine,
    chirp,
    point_to_point,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class GoodLog:
    """A log and the truth behind it.

    Attributes:
        name: how it was made.
        log: the columns.
        mass: kg (kg·m²).
        damping: N·s/m (N·m·s/rad).
        delay: s.
        encoder_resolution: m (rad).
    """

    name: str
    log: RawLog
    mass: float
    damping: float
    delay: float
    encoder_resolution: float


def good_logs(count: int, seed: int) -> tuple[GoodLog, ...]:
    """``count`` logs: open and closed loop, linear and rotary, light and heavy, in turn.

    A quarter of them has jittered stamps, another quarter lost rows. Devices, motions, friction
    (in two thirds), offset, delay of 0 to 2 samples and noise are random.
    """
    logs: list[GoodLog] = []
    groups: list[tuple[Motion, bool]] = [
        (kind, closed) for kind in _SIZES for closed in (False, True)
    ]
    for place, (kind, closed) in enumerate(groups):
        share = len(range(place, count, len(groups)))
        if share:
            logs += _group(share, (seed, place), kind, closed=closed)
    return tuple(logs)


def _group(count: int, seed: tuple[int, int], kind: Motion, *, closed: bool) -> list[GoodLog]:
    generator = np.random.default_rng(seed)

    def drawn(bounds: tuple[float, float]) -> FloatArray:
        low, high = bounds
        return low * (high / low) ** generator.random(count)

    masses, travels = _SIZES[kind]
    mass, travel = drawn(masses), drawn(travels)
    damping = mass / drawn(_TIME_CONSTANT)
    step = generator.choice(_STEPS, count)
    slow, fast = drawn(_LOWEST), drawn(_HIGHEST)
    which = [_COURSES[int(index)] for index in generator.integers(0, len(_COURSES), count)]
    courses = [
        which[i](
            step[i] * np.arange(_SAMPLES, dtype=np.float64), slow[i], fast[i], seed[0] + 7919 * i
        ).scaled(float(travel[i]))
        for i in range(count)
    ]
    reference = np.stack([course.position for course in courses])
    velocity = np.stack([course.velocity for course in courses])
    force = mass[:, None] * np.stack([course.acceleration for course in courses])
    force += damping[:, None] * velocity
    size = np.std(force, axis=1)
    friction = np.where(generator.random(count) < 2 / 3, drawn(_FRICTION), 0.0) * size
    offset = 0.05 * size * generator.standard_normal(count)
    resolution = travel / drawn(_COUNTS)
    delay = generator.integers(0, 3, count) * step
    rig = Rig(
        mass=mass,
        damping=damping,
        sample_time=step,
        coulomb_friction=friction,
        force_offset=offset,
        delay=delay,
        encoder_resolution=resolution,
        motion=kind,
    )
    turn = 2 * np.pi * drawn(_BANDWIDTH)
    servo = Servo(
        reference=reference,
        stiffness=mass * turn**2,
        damping=1.4 * mass * turn,
        velocity_filter_hz=100,
    )
    played = force + friction[:, None] * np.sign(velocity) + offset[:, None]
    disturbed = generator.integers(0, 4, count)
    recording = simulate(
        rig,
        np.zeros_like(force) if closed else played,
        controller=servo if closed else None,
        faults=Faults(
            position_noise=drawn(_NOISE) * resolution, force_noise=drawn(_UNKNOWN_FORCE) * size
        ),
        clock=Clock(
            jitter=np.where(disturbed == 1, _JITTER * step, 0.0),
            dropped=np.where(disturbed == 2, _DROPPED, 0.0),
        ),
        seed=seed[0],
    )
    return [
        GoodLog(
            name=f"{kind} {which[i].__name__} {'closed' if closed else 'open'} "
            f"{('plain', 'jittered', 'dropped', 'plain')[disturbed[i]]} {i}",
            log=RawLog.of(recording, i),
            mass=float(mass[i]),
            damping=float(damping[i]),
            delay=float(delay[i]),
            encoder_resolution=float(resolution[i]),
        )
        for i in range(count)
    ]
