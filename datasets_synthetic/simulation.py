"""The simulator: true devices in continuous time, sampled and held as their controller sees them.

Independent by design: it integrates by its own means and shares no algebra with what identifies or
tunes. A whole batch of devices runs in one loop over time.

What happens at the instant t of a sample: the encoder is read (noise added, then rounded to a
count), the controller computes its force, the force limit clips it, the log takes down all three.
The force then acts from t + delay until delay after the next sample; before the first command
arrives it is zero. With an even clock t = kT.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import (
    Clock,
    Faults,
    Hand,
    Motion,
    Rig,
    Sources,
    coloured_noise,
    per_member,
    read_only_copy,
    scatter,
    white_noise,
)
from datasets_synthetic.dynamics import FlexibleDynamics, Loads, RigidDynamics
from datasets_synthetic.law import ControlLaw, Controller, Servo
from datasets_synthetic.motion import LARGEST_STEP, Encoder, EvenTimetable, UnevenTimetable
from identification import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """True motion at the samples; arrays read-only, shape (batch, n).

    Attributes:
        handle: where the handle is, m (rad).
        speed: of the handle, m/s (rad/s).
        energy: of motion, springs and gravity, the hand's included, J.
    """

    handle: FloatArray
    speed: FloatArray
    energy: FloatArray

    @classmethod
    def of(cls, handle: FloatArray, speed: FloatArray, energy: FloatArray) -> Truth:
        """From each at each sample, shape (n, batch)."""
        return cls(
            handle=read_only_copy(handle.T),
            speed=read_only_copy(speed.T),
            energy=read_only_copy(energy.T),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Logs of a batch; arrays read-only. Rows that were lost from a log are still in the arrays.

    Attributes:
        sample_time: s, shape (batch,); the mean step where stamps are uneven.
        force: as commanded after the limit and before the delay, N (N·m), shape (batch, n).
        position: as the encoder reads it, m (rad), shape (batch, n).
        axis: name of the axis.
        motion: "linear" or "rotary".
        source: where the recording comes from, for messages.
        stamps: true instants of uneven samples, s, shape (batch, n), or None for even ones.
        reference: what a servo followed, m (rad), shape (batch, n), or None.
        kept: which rows reached the log, shape (batch, n), or None for all.
        truth: the true motion, where it was watched.
    """

    sample_time: FloatArray
    force: FloatArray
    position: FloatArray
    axis: str = "x"
    motion: Motion = "linear"
    source: str = "simulated"
    stamps: FloatArray | None = None
    reference: FloatArray | None = None
    kept: NDArray[np.bool_] | None = None
    truth: Truth | None = None

    @property
    def batch(self) -> int:
        """Number of logs."""
        return self.sample_time.size

    @property
    def time(self) -> FloatArray:
        """True instants of the samples, s, shape (batch, n)."""
        if self.stamps is not None:
            return self.stamps
        return self.sample_time[:, None] * np.arange(self.force.shape[1], dtype=np.float64)

    def trajectory(self, member: int = 0) -> Trajectory:
        """The log of one member. Raises LogRefusedError if it is no log (too short, diverged)."""
        rows = slice(None) if self.kept is None else self.kept[member]
        step, count = float(self.sample_time[member]), self.force.shape[1]
        even = step * np.arange(count, dtype=np.float64)
        return Trajectory(
            time=(even if self.stamps is None else self.stamps[member])[rows],
            force=self.force[member][rows],
            position=self.position[member][rows],
            reference=None if self.reference is None else self.reference[member][rows],
            axis=self.axis,
            motion=self.motion,
            source=self.source,
        )


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
    push: FloatArray | None = None,
    watch: bool = False,
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
        seed: a list gives each member its own; one number is spread over the members by numpy's
            SeedSequence, the first of them the same as that of a single run.
        position: at t = 0, m (rad), a number or shape (batch,).
        velocity: at t = 0, m/s (rad/s), a number or shape (batch,).
        push: of a hand on the handle, besides its impedance, held over each sample and not delayed,
            N (N·m), shape (n,) or (batch, n), or None.
        watch: whether the true motion is recorded too.
        largest_step: largest |h·p| of one integration step h of a rigid device, without unit; see
            motion.py for the error.

    Returns:
        One log a member. A loop that grows without bound ends in values that are not finite,
        which ``Recording.trajectory`` refuses.
    """
    hand, clock, faults = hand or Hand(), clock or Clock(), faults or Faults()
    seeds = tuple(int(each) for each in np.atleast_1d(seed))
    command = np.atleast_2d(np.asarray(force, dtype=np.float64))
    pushed = None if push is None else np.atleast_2d(np.asarray(push, dtype=np.float64))
    sizes = [rig.batch, command.shape[0], np.size(position), np.size(velocity), len(seeds)]
    sizes += [*faults.sizes(), *hand.sizes(), *clock.sizes()]
    sizes += [1 if controller is None else controller.size(), 1 if pushed is None else len(pushed)]
    batch, samples = max(sizes), command.shape[1]
    if any(size not in {1, batch} for size in sizes):
        raise ValueError(f"batch sizes must agree or be 1, not {sizes}")
    column = partial(per_member, batch=batch)

    sample_time = clock.nominal(column(rig.sample_time))
    sources = Sources(seeds, batch)
    stamps = clock.stamps(sample_time, samples, sources)
    loads = _loads(sources, faults, hand, stamps, pushed)
    start = column(position) + scatter(sources, column(faults.start_spread))
    flexible = bool(rig.modes) or bool(np.any(rig.current_lag))
    kind = FlexibleDynamics if flexible else RigidDynamics
    dynamics = kind(rig, hand, loads, start, column(velocity))
    timetable = (
        EvenTimetable(column(rig.delay), sample_time, dynamics.rate(), largest_step)
        if clock.even
        else UnevenTimetable(column(rig.delay), stamps, dynamics.rate(), largest_step)
    )
    noise = white_noise(sources, "position", column(faults.position_noise), samples)
    reference = None
    if isinstance(controller, Servo):
        reference = _followed(controller, batch, samples)
        command = command + column(controller.stiffness)[:, None] * reference
        controller = controller.regulator()
    law = None if controller is None else ControlLaw(controller, sample_time)
    sent, readings, states = _run(
        dynamics,
        timetable,
        np.repeat(command.T, batch // command.shape[0], axis=1),
        law=law,
        limit=column(rig.force_limit),
        encoder=Encoder(column(rig.encoder_resolution)),
        noise=noise,
        watch=watch,
    )
    with np.errstate(over="ignore", invalid="ignore"):  # what grows without end
        truth = None if states is None else Truth.of(*dynamics.seen(states))
    return Recording(
        sample_time=read_only_copy(sample_time),
        force=read_only_copy(sent.T),
        position=read_only_copy(readings.T),
        axis=rig.axis,
        motion=rig.motion,
        source=f"simulated {rig.name}",
        stamps=None if clock.even else read_only_copy(stamps.T),
        reference=None if reference is None else read_only_copy(reference),
        kept=clock.kept(batch, samples, sources),
        truth=truth,
    )


def _followed(servo: Servo, batch: int, samples: int) -> FloatArray:
    """The reference of a servo, shape (batch, samples)."""
    followed = np.atleast_2d(np.asarray(servo.reference, dtype=np.float64))
    if followed.shape[1] != samples:
        raise ValueError(
            f"the reference has {followed.shape[1]} samples, the force {samples}: give one "
            f"value of each a sample"
        )
    return np.broadcast_to(followed, (batch, samples))


def _run(
    dynamics: RigidDynamics | FlexibleDynamics,
    timetable: EvenTimetable | UnevenTimetable,
    command: FloatArray,
    *,
    law: ControlLaw | None,
    limit: FloatArray,
    encoder: Encoder,
    noise: FloatArray | None,
    watch: bool,
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Forces sent and readings, shape (samples, batch) each, and all states if they are watched."""
    samples, lead = len(command), timetable.lead
    commands = np.zeros((lead + samples, command.shape[1]))
    commands[lead:] = np.clip(command, -limit, limit) if law is None else command
    least = -limit
    flat = commands.ravel()  # a view: row by row, one member after the other
    readings = np.empty_like(command)
    states = np.empty((samples, *dynamics.state().shape)) if watch else None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(samples):
            q = dynamics.measured()
            readings[k] = reading = encoder.read(q if noise is None else q + noise[k])
            if states is not None:
                states[k] = dynamics.state()
            if law is not None:
                now = commands[lead + k]
                now += law.force(reading)
                np.minimum(np.maximum(now, least, out=now), limit, out=now)
            dynamics.begin(k)
            acting = flat[timetable.first(k) :]
            for part in timetable.parts(k):
                dynamics.move(acting.take(part.place), part)
    return commands[lead:], readings, states


def _loads(
    sources: Sources, faults: Faults, hand: Hand, stamps: FloatArray, pushed: FloatArray | None
) -> Loads:
    """Forces that act but are not logged."""
    samples, batch = stamps.shape
    column = partial(per_member, batch=batch)
    if pushed is not None and pushed.shape[1] != samples:
        raise ValueError(f"push has {pushed.shape[1]} samples, force {samples}: give as many")
    device = (
        white_noise(sources, "force", column(faults.force_noise), samples),
        coloured_noise(
            sources, column(faults.coloured_force), column(faults.correlation_time), stamps
        ),
    )
    handle = (
        hand.push(sources, stamps),
        None if pushed is None else np.broadcast_to(pushed.T, (samples, batch)),
    )
    return Loads(device=_sum(device), handle=_sum(handle))


def _sum(parts: tuple[FloatArray | None, ...]) -> FloatArray | None:
    there = [part for part in parts if part is not None]
    return sum(there[1:], start=there[0]) if there else None
