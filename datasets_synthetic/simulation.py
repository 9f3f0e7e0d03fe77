"""The simulator: true devices in continuous time, sampled and held as their controller sees them.

Independent by design: it integrates by its own means (motion.py) and shares no algebra with what
identifies or tunes. A whole batch of devices runs in one loop over time.

What happens at the instant t of a sample: the encoder is read (noise added, then rounded to a
count), the controller computes its force, the force limit clips it, the log takes down all three.
The force then acts from t + delay until delay after the next sample; before the first command
arrives it is zero. With an even clock t = kT.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.clock import Clock
from datasets_synthetic.controller import ControlLaw, Controller, Servo
from datasets_synthetic.faults import Faults
from datasets_synthetic.field import Field
from datasets_synthetic.hand import Hand
from datasets_synthetic.motion import LARGEST_STEP, Drag, advance
from datasets_synthetic.noise import Sources, coloured_noise, scatter, white_noise
from datasets_synthetic.recording import Recording, frozen
from datasets_synthetic.rig import Rig
from datasets_synthetic.sampling import read_encoder
from datasets_synthetic.timetable import EvenTimetable, Timetable, UnevenTimetable

FloatArray = NDArray[np.float64]


def simulate(
    rig: Rig,
    force: FloatArray,
    *,
    controller: Controller | Servo | None = None,
    hand: Hand | None = None,
    faults: Faults | None = None,
    clock: Clock | None = None,
    seed: int | Sequence[int] = 0,
    position: float | FloatArray = 0.0,
    velocity: float | FloatArray = 0.0,
    largest_step: float = LARGEST_STEP,
) -> Recording:
    """Run a batch of devices for n samples.

    A rig, controller, hand or start of one member is repeated to the size of the largest among
    rig, force, controller, hand, faults, clock, start and list of seeds.

    Args:
        rig: the true devices.
        force: N (N·m), shape (n,) or (batch, n): the whole command in open loop, added to the
            controller's in closed loop.
        controller: virtual effects on the measured position or a servo that follows a reference,
            or None for open loop.
        hand: that holds the device, or None.
        faults: noise, or None for none.
        clock: uneven sampling and lost rows, or None for even and complete logs.
        seed: a list gives each member its own; one number is spread over the members by
            numpy's SeedSequence, the first of them the same as that of a single run.
        position: at t = 0, m (rad), a number or shape (batch,).
        velocity: at t = 0, m/s (rad/s), a number or shape (batch,).
        largest_step: largest |h·p| of one integration step h; see motion.py for the error.

    Returns:
        One log a member. A loop that grows without bound ends in values that are not finite,
        which ``Recording.trajectory`` refuses.
    """
    faults, hand, clock = faults or Faults(), hand or Hand(), clock or Clock()
    seeds = tuple(int(each) for each in np.atleast_1d(seed))
    command = np.atleast_2d(np.asarray(force, dtype=np.float64))
    sizes = [rig.batch, command.shape[0], np.size(position), np.size(velocity), len(seeds)]
    sizes += [*faults.sizes(), *hand.sizes(), *clock.sizes()]
    sizes += [controller.size()] if controller is not None else []
    batch = max(sizes)
    if any(size not in {1, batch} for size in sizes):
        raise ValueError(f"batch sizes must agree or be 1, not {sizes}")
    samples = command.shape[1]
    column = partial(_column, batch=batch)

    mass = column(rig.mass) + column(hand.mass)
    drag = _drag(rig, hand, mass)
    limit, resolution = column(rig.force_limit), column(rig.encoder_resolution)
    offset = column(rig.force_offset) - column(hand.stiffness) * column(hand.rest)
    sample_time = clock.nominal(column(rig.sample_time))
    sources = Sources(seeds, batch)
    stamps = clock.stamps(sample_time, samples, sources)
    timetable: Timetable
    if clock.even:
        timetable = EvenTimetable(column(rig.delay), sample_time, drag.fastest(), largest_step)
    else:
        timetable = UnevenTimetable(column(rig.delay), stamps, drag.fastest(), largest_step)
    noise = white_noise(sources, "position", column(faults.position_noise), samples)
    disturbance = _disturbance(sources, faults, hand, stamps)
    reference = None
    if isinstance(controller, Servo):
        followed = np.atleast_2d(np.asarray(controller.reference, dtype=np.float64))
        if followed.shape[1] != samples:
            raise ValueError(
                f"the reference has {followed.shape[1]} samples, the force {samples}: give one "
                f"value of each a sample"
            )
        reference = np.broadcast_to(followed, (batch, samples))
        command = command + column(controller.stiffness)[:, None] * reference
        controller = controller.regulator()
    law = None if controller is None else ControlLaw(controller, sample_time)

    lead = timetable.lead
    commands = np.zeros((lead + samples, batch))
    commands[lead:] = np.clip(command.T, -limit, limit) if law is None else command.T
    sent = commands.ravel()  # a view: row by row, one member after the other
    readings = np.empty((samples, batch))
    q = column(position) + scatter(sources, column(faults.start_spread))
    v = column(velocity)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(samples):
            readings[k] = reading = read_encoder(q if noise is None else q + noise[k], resolution)
            if law is not None:
                now = lead + k
                commands[now] = np.clip(commands[now] + law.force(reading), -limit, limit)
            resisted = offset if disturbance is None else offset - disturbance[k]
            for part in timetable.parts(k):
                pull = (sent.take(part.place) - resisted) / mass
                for _ in range(part.steps):
                    q, v = advance(q, v, pull, drag, part.step)
    return Recording(
        sample_time=frozen(sample_time),
        force=frozen(commands[lead:].T),
        position=frozen(readings.T),
        axis=rig.axis,
        motion=rig.motion,
        source=f"simulated {rig.name}",
        stamps=None if clock.even else frozen(stamps.T),
        reference=None if reference is None else frozen(reference),
        kept=clock.kept(batch, samples, sources),
    )


def _column(values: float | FloatArray, batch: int) -> FloatArray:
    """One value a member, an array of its own, shape (batch,)."""
    return np.array(np.broadcast_to(np.asarray(values, dtype=np.float64), (batch,)))


def _drag(rig: Rig, hand: Hand, mass: FloatArray) -> Drag:
    """Friction and field of the device with the hand on it, per unit of their common mass."""
    column = partial(_column, batch=mass.size)
    return Drag.of(
        mass=mass,
        damping=column(rig.damping) + column(hand.damping),
        coulomb_friction=column(rig.coulomb_friction),
        damping_asymmetry=column(rig.damping_asymmetry),
        coulomb_asymmetry=column(rig.coulomb_asymmetry),
        field=Field.of(
            mass=mass,
            stiffness=column(rig.stiffness) + column(hand.stiffness),
            gravity_sine=column(rig.gravity_sine),
            gravity_cosine=column(rig.gravity_cosine),
        ),
    )


def _disturbance(
    sources: Sources, faults: Faults, hand: Hand, stamps: FloatArray
) -> FloatArray | None:
    """Force that acts but is not logged, N (N·m), shape (n, batch), or None for none."""
    samples, batch = stamps.shape

    column = partial(_column, batch=batch)
    parts = (
        white_noise(sources, "force", column(faults.force_noise), samples),
        coloured_noise(
            sources, column(faults.coloured_force), column(faults.correlation_time), stamps
        ),
        hand.push(sources, stamps),
    )
    there = [part for part in parts if part is not None]
    return sum(there[1:], start=there[0]) if there else None
