"""Faults of the experiment: simulated devices that are held, stuck, weighed down or not moved."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Clock, Controller, Faults, Hand, Recording, Rig, simulate
from tests.outside_axis import Axis, Body, Drive, play
from tests.simulated.catalogue.motions import Course, multisine
from tests.simulated.catalogue.raw import RawLog

FloatArray = NDArray[np.float64]
Three = tuple[RawLog, RawLog, RawLog]

_STEP = 0.001  # s
_SAMPLES = 6000
_TRAVEL = 0.05  # m
_TIME: FloatArray = _STEP * np.arange(_SAMPLES, dtype=np.float64)

#: A planar rehabilitation robot; numbers as the named device homerehab.
_RIG = Rig(
    mass=3.0,
    damping=10.0,
    sample_time=_STEP,
    coulomb_friction=0.8,
    delay=_STEP,
    encoder_resolution=6e-6,
    name="homerehab",
)
_NOISE = Faults(position_noise=3e-6, force_noise=0.01)


def _course(seed: int, low: float = 0.2, high: float = 5.0) -> Course:
    return multisine(_TIME, low, high, seed).scaled(_TRAVEL)


def _force(rig: Rig, course: Course) -> FloatArray:
    """Force that moves a rig of one member along a course, friction included."""
    friction = rig.coulomb_friction[0] * np.sign(course.velocity)
    return rig.mass[0] * course.acceleration + rig.damping[0] * course.velocity + friction


def _three(rig: Rig, force: FloatArray, seed: int, faults: Faults = _NOISE) -> Three:
    return _logs(simulate(rig, force, faults=faults, seed=(seed, seed + 1, seed + 2)))


def _logs(recording: Recording) -> Three:
    return RawLog.of(recording, 0), RawLog.of(recording, 1), RawLog.of(recording, 2)


def good(seed: int) -> Three:
    """Nothing wrong: three logs of one device, moved within 50 mm."""
    return _three(_RIG, np.stack([_force(_RIG, _course(seed + i)) for i in range(3)]), seed)


def outside(seed: int, *axes: Axis) -> Three:
    """Logs of axes that the simulator of the package has not, moved as the good ones."""
    logs: list[RawLog] = []
    for place, axis in enumerate(axes):
        plan = _force(_RIG, _course(seed + place))
        drive = Drive(sample_time=_STEP, plan=plan, delay=_STEP, count=6e-6, noise=2e-6)
        played = play(axis, drive, np.random.default_rng(seed + place))
        logs.append(RawLog(time=played.time, force=played.command, position=played.reading))
    first, second, third = logs
    return first, second, third


def lagging(seed: int) -> Three:
    """The current loop of the drive is slow."""
    return outside(seed, *(replace(_AXIS, lag_hz=hertz) for hertz in (300.0, 50.0, 20.0)))


def vibrating(seed: int) -> Three:
    """Part of the mass hangs on a spring."""
    return outside(seed, *(_split(hertz, 0.02) for hertz in (60.0, 20.0, 11.0)))


def played_loose(seed: int) -> Three:
    """Part of the mass is moved through a gap."""
    return outside(seed, *(_split(200.0, 0.2, gap) for gap in (2e-6, 2e-4, 1e-3)))


def loaded(seed: int) -> Three:
    """Friction grows with the force."""
    return outside(seed, *(replace(_AXIS, load=part) for part in (0.003, 0.1, 0.3)))


_AXIS = Axis(mass=3.0, damping=10.0, coulomb=0.8)


def _split(hertz: float, damped: float, gap: float = 0.0) -> Axis:
    """The same axis, three tenths of it on a spring, which both swing on at a frequency."""
    omega, near, load = 2 * np.pi * hertz, 2.1, 0.9
    reduced = near * load / 3.0
    stiffness, damping = reduced * omega**2, 2 * damped * reduced * omega
    body = Body(mass=load, stiffness=stiffness, damping=damping, gap=gap / 2)
    return replace(_AXIS, mass=near, body=body)


def slow(seed: int) -> Three:
    """Two slow sines on a light, well damped device: its mass hardly counts."""
    rig = Rig(
        mass=0.2, damping=20.0, sample_time=_STEP, delay=_STEP, encoder_resolution=1e-5, name="slow"
    )
    force = [
        20.0 * 0.05 * 2 * np.pi * hertz * (np.sin(2 * np.pi * hertz * _TIME + seed))
        + 20.0 * 0.02 * 2 * np.pi * hertz * np.cos(2 * np.pi * 1.7 * hertz * _TIME)
        for hertz in (1.0, 0.25, 0.12)
    ]
    return _three(rig, np.stack(force), seed, Faults(position_noise=2e-5, force_noise=0.05))


def fast(seed: int) -> Three:
    """Motion at 8 to 20 Hz only: what a delay of a sample would add to the damping exceeds it."""
    rig = replace(
        _RIG, damping=np.ones(1), coulomb_friction=np.zeros(1), encoder_resolution=np.full(1, 1e-6)
    )
    force = [
        12 * np.sin(2 * np.pi * hertz * _TIME + seed) + 6 * np.cos(2 * np.pi * 1.6 * hertz * _TIME)
        for hertz in (8.0, 12.0, 20.0)
    ]
    return _three(rig, np.stack(force), seed, Faults(position_noise=3e-7, force_noise=0.1))


def jittered(seed: int) -> Three:
    """Stamps a fifth of a per cent off, steps of 10 and 12 ms in turn, and stamps that are false.

    The last were read evenly and stamped when somebody got round to it, within a third of a step.
    """
    time = 0.011 * np.arange(3000, dtype=np.float64)
    joint = replace(_RIG, sample_time=np.full(1, 0.011))
    turns = simulate(
        joint,
        _force(joint, multisine(time, 0.1, 2.0, seed).scaled(_TRAVEL)),
        clock=Clock(steps=(0.010, 0.012)),
        faults=_NOISE,
        seed=seed,
    )
    first, _, third = good(seed)
    late = np.random.default_rng(seed).uniform(0, _STEP / 3, (2, _SAMPLES))
    return (
        replace(first, time=first.time + 0.005 * late[0]),
        RawLog.of(turns),
        replace(third, time=third.time + late[1]),
    )


def on_an_arm(seed: int) -> Three:
    """A turning arm whose weight pulls with 2, 20 and 60 % of the peak force of the motion."""
    time = _TIME
    course = multisine(time, 0.2, 4.0, seed).scaled(1.2)
    rig = Rig(
        mass=0.01,
        damping=0.03,
        sample_time=_STEP,
        coulomb_friction=0.005,
        delay=_STEP,
        encoder_resolution=2e-4,
        name="arm",
        motion="rotary",
    )
    plain = _force(rig, course)
    weight = float(np.max(np.abs(plain))) * np.array([0.02, 0.2, 0.6])
    rigs = replace(rig, gravity_sine=weight)
    force = plain + weight[:, None] * np.sin(course.position)
    return _three(rigs, force, seed, Faults(position_noise=1e-4, force_noise=1e-4))


def sticking(seed: int) -> Three:
    """Friction of 10, 60 and 85 % of the largest force."""
    course = _course(seed)
    plain = replace(_RIG, coulomb_friction=np.zeros(1))
    force = _force(plain, course)
    parts = np.array([0.1, 0.6, 0.85])
    rigs = replace(_RIG, coulomb_friction=parts * np.max(np.abs(force)))
    return _three(rigs, np.stack([force] * 3), seed)


def dragged(seed: int) -> Three:
    """Drag with the square of speed, of about 1, 8 and 25 % of the force."""
    return outside(seed, *(replace(_AXIS, drag=drag) for drag in (1.5, 12.0, 37.0)))


def held(seed: int) -> Three:
    """A hand on the handle: resting on it, holding it, and gripping it."""
    hand = Hand(
        mass=np.array([0.0, 0.4, 0.8]),
        damping=np.array([0.0, 4.0, 10.0]),
        stiffness=np.array([0.0, 80.0, 300.0]),
        tremor=np.array([0.01, 0.25, 0.6]),
        wander=np.array([0.0, 0.003, 0.01]),
    )
    return _logs(simulate(_RIG, _force(_RIG, _course(seed)), hand=hand, faults=_NOISE, seed=seed))


def rendered(seed: int) -> Three:
    """A hand moves the device against a virtual spring: with excitation, without, and as one sine.

    The last is a hand at 1 Hz on a virtual spring: the log of a mass of K/ω².
    """
    hand = Hand(mass=0.5, damping=5.0, stiffness=400.0, tremor=0.1, wander=0.03)
    logs: list[RawLog] = []
    for i, (played, spring, damper) in enumerate(((1.0, 100.0, 2.0), (0.0, 500.0, 5.0))):
        recording = simulate(
            _RIG,
            played * _force(_RIG, _course(seed)),
            controller=Controller(stiffness=spring, damping=damper, velocity_filter_hz=50.0),
            hand=hand,
            faults=_NOISE,
            seed=seed + i,
        )
        logs.append(RawLog.of(recording))
    place = 0.04 * np.sin(2 * np.pi * _TIME + seed)
    noise = 3e-6 * np.random.default_rng(seed).standard_normal(place.size)
    place = np.rint((place + noise) / 6e-6) * 6e-6
    return logs[0], logs[1], RawLog(time=_TIME, force=-500.0 * place, position=place)


def late(seed: int, *samples: float) -> Three:
    """Force that arrives so many samples after its command."""
    rigs = replace(_RIG, delay=_STEP * np.array(samples))
    return _three(rigs, np.stack([_force(_RIG, _course(seed))] * 3), seed)
