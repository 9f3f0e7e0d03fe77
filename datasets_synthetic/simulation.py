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
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypedDict, Unpack

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
from datasets_synthetic.dynamics import Dynamics, FlexibleDynamics, Loads, RigidDynamics
from datasets_synthetic.law import ControlLaw, Controller, Servo
from datasets_synthetic.motion import (
    LARGEST_STEP,
    Encoder,
    EvenTimetable,
    Timetable,
    UnevenTimetable,
)
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

    def members(self, which: slice) -> Truth:
        """The truth of these members."""
        return Truth(handle=self.handle[which], speed=self.speed[which], energy=self.energy[which])


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

    def instants(self, member: int) -> FloatArray:
        """True instants of the samples of one member, s, shape (n,)."""
        if self.stamps is not None:
            return self.stamps[member]
        step = float(self.sample_time[member])
        return step * np.arange(self.force.shape[1], dtype=np.float64)

    def members(self, which: slice) -> Recording:
        """The logs of these members."""

        def of(array: NDArray[Any] | None) -> NDArray[Any] | None:
            return None if array is None else array[which]

        return replace(
            self,
            sample_time=self.sample_time[which],
            force=self.force[which],
            position=self.position[which],
            stamps=of(self.stamps),
            reference=of(self.reference),
            kept=of(self.kept),
            truth=None if self.truth is None else self.truth.members(which),
        )

    def trajectory(self, member: int = 0) -> Trajectory:
        """The log of one member. Raises LogRefusedError if it is no log (too short, diverged)."""
        rows = slice(None) if self.kept is None else self.kept[member]
        return Trajectory(
            time=self.instants(member)[rows],
            force=self.force[member][rows],
            position=self.position[member][rows],
            reference=None if self.reference is None else self.reference[member][rows],
            axis=self.axis,
            motion=self.motion,
            source=self.source,
        )


class Conditions(TypedDict, total=False):
    """Conditions under which devices are simulated; what is left out is as if it were not there.

    Attributes:
        controller: virtual effects on the measured position or a servo that follows a reference,
            or None for open loop.
        hand: that holds the device, or None.
        faults: noise, or None for none.
        clock: uneven sampling and lost rows, or None for even and complete logs.
        seed: a list gives each member its own; one number, by default 0, is spread over the members
            by numpy's SeedSequence, the first of them the same as that of a single run.
        position: at t = 0, m (rad), a number or shape (batch,), by default 0.
        velocity: at t = 0, m/s (rad/s), a number or shape (batch,), by default 0.
        push: of a hand on the handle, besides its impedance, held over each sample and not delayed,
            N (N·m), shape (n,) or (batch, n), or None.
        watch: whether the true motion is recorded too, by default not.
        largest_step: largest |h·p| of one integration step h of a rigid device, without unit, by
            default LARGEST_STEP; see motion.py for the error.
    """

    controller: Controller | Servo | None
    hand: Hand | None
    faults: Faults | None
    clock: Clock | None
    seed: int | Sequence[int]
    position: float | FloatArray
    velocity: float | FloatArray
    push: FloatArray | None
    watch: bool
    largest_step: float


def simulate(rig: Rig, force: FloatArray, **conditions: Unpack[Conditions]) -> Recording:
    """Run a batch of devices for n samples.

    A rig, controller, hand or start of one member is repeated to the size of the largest among
    rig, force, controller, hand, faults, clock, start and list of seeds.

    Args:
        rig: the true devices.
        force: N (N·m), shape (n,) or (batch, n): the whole command in open loop, added to the
            controller's in closed loop.
        conditions: of ``Conditions``, by name.

    Returns:
        One log a member. A loop that grows without bound ends in values that are not finite,
        which ``Recording.trajectory`` refuses.
    """
    run = Simulation(rig, force, **conditions)
    return run.until(run.samples)


class Simulation:
    """A batch of devices in motion, up to any sample and then on; see ``simulate``."""

    def __init__(self, rig: Rig, force: FloatArray, **conditions: Unpack[Conditions]) -> None:
        """Ready to start; arguments as of ``simulate``, with as many samples as may be played."""
        controller, push = conditions.get("controller"), conditions.get("push")
        hand, clock = conditions.get("hand") or Hand(), conditions.get("clock") or Clock()
        faults = conditions.get("faults") or Faults()
        seed, watch = conditions.get("seed", 0), conditions.get("watch", False)
        position, velocity = conditions.get("position", 0.0), conditions.get("velocity", 0.0)
        largest_step = conditions.get("largest_step", LARGEST_STEP)
        seeds = tuple(int(each) for each in np.atleast_1d(seed))
        command = np.atleast_2d(np.asarray(force, dtype=np.float64))
        pushed = None if push is None else np.atleast_2d(np.asarray(push, dtype=np.float64))
        sizes = [rig.batch, command.shape[0], np.size(position), np.size(velocity), len(seeds)]
        sizes += [*faults.sizes(), *hand.sizes(), *clock.sizes()]
        sizes += [
            1 if controller is None else controller.size(),
            1 if pushed is None else len(pushed),
        ]
        batch = max(sizes)
        if any(size not in {1, batch} for size in sizes):
            raise ValueError(f"batch sizes must agree or be 1, not {sizes}")
        self.samples = samples = command.shape[1]
        column = partial(per_member, batch=batch)

        limit = column(rig.force_limit)
        sample_time = clock.nominal(column(rig.sample_time))
        sources = Sources(seeds, batch)
        stamps = clock.stamps(sample_time, samples, sources)
        loads = _loads(sources, faults, hand, stamps, pushed)
        start = column(position) + scatter(sources, column(faults.start_spread))
        flexible = bool(rig.modes) or bool(np.any(rig.current_lag))
        kind = FlexibleDynamics if flexible else RigidDynamics
        dynamics: Dynamics = kind(rig, hand, loads, start, column(velocity))
        timetable: Timetable = (
            EvenTimetable(column(rig.delay), sample_time, dynamics.rate(), largest_step)
            if clock.even
            else UnevenTimetable(column(rig.delay), stamps, dynamics.rate(), largest_step)
        )
        noise = white_noise(sources, "position", column(faults.position_noise), samples)
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

        commands = np.zeros((timetable.lead + samples, batch))
        commands[timetable.lead :] = np.clip(command.T, -limit, limit) if law is None else command.T
        self._rig, self._clock, self._sources = rig, clock, sources
        self._stamps, self._sample_time = stamps, sample_time
        self._dynamics, self._timetable, self._law = dynamics, timetable, law
        self._limit, self._encoder, self._noise = (
            limit,
            Encoder(column(rig.encoder_resolution)),
            noise,
        )
        self._reference, self._commands = reference, commands
        self._readings = np.empty((samples, batch))
        self._states = np.empty((samples, *dynamics.state().shape)) if watch else None
        self._played = 0

    def until(self, samples: int) -> Recording:
        """Plays on up to this many samples and returns all that was recorded till then."""
        dynamics, timetable, law, limit = self._dynamics, self._timetable, self._law, self._limit
        sent = self._commands.ravel()  # a view: row by row, one member after the other
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(self._played, samples):
                q = dynamics.measured()
                reading = self._encoder.read(q if self._noise is None else q + self._noise[k])
                self._readings[k] = reading
                if self._states is not None:
                    self._states[k] = dynamics.state()
                if law is not None:
                    now = self._commands[timetable.lead + k]
                    now += law.force(reading)
                    np.maximum(now, -limit, out=now)
                    np.minimum(now, limit, out=now)
                dynamics.begin(k)
                for part in timetable.parts(k):
                    dynamics.move(sent.take(part.place), part)
        self._played = samples
        return self._recorded()

    def _recorded(self) -> Recording:
        """What was recorded until now."""
        rig, played, batch = self._rig, self._played, self._sample_time.size
        lead, states = self._timetable.lead, self._states
        with np.errstate(over="ignore", invalid="ignore"):  # what grows without end
            truth = None if states is None else Truth.of(*self._dynamics.seen(states[:played]))
        return Recording(
            sample_time=read_only_copy(self._sample_time),
            force=read_only_copy(self._commands[lead : lead + played].T),
            position=read_only_copy(self._readings[:played].T),
            axis=rig.axis,
            motion=rig.motion,
            source=f"simulated {rig.name}",
            stamps=None if self._clock.even else read_only_copy(self._stamps[:played].T),
            reference=None
            if self._reference is None
            else read_only_copy(self._reference[:, :played]),
            kept=self._clock.kept(batch, played, self._sources),
            truth=truth,
        )


def _loads(
    sources: Sources,
    faults: Faults,
    hand: Hand,
    stamps: FloatArray,
    pushed: FloatArray | None,
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
