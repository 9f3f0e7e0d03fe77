"""The simulator: true devices in continuous time, sampled and held as their controller sees them.

Independent by design: it integrates by its own means and shares no algebra with what identifies or
tunes. A whole batch of devices runs in one loop over time.

What happens at the instant t of a sample: the encoder is read (noise added, then rounded to a
count), the controller computes its force, the force limit clips it, the log takes down all three.
The force then acts from t + delay until delay after the next sample; before the first command
arrives it is zero. With an even clock t = kT.

Axes that are coupled are stepped together by the linear map of the law between turns; where a speed
turns or an axis sticks, ever shorter steps decide dry friction as a complementarity problem
(Moreau's time stepping: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems,
2008).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import mul

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import (
    Clock,
    Faults,
    FloatArray,
    Hand,
    Motion,
    Rig,
    Sources,
    per_member,
    read_only_copy,
    scatter,
    white_noise,
)
from datasets_synthetic.dynamics import FlexibleDynamics, Loads, RigidDynamics, fastest, maps
from datasets_synthetic.law import ControlLaw, Controller, Servo
from datasets_synthetic.motion import LARGEST_STEP, Encoder, EvenTimetable, UnevenTimetable
from identification import Trajectories, Trajectory

Indices = NDArray[np.intp]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Logs of a batch; arrays read-only. Rows that were lost from a log are still in the arrays.

    Attributes:
        time: true instants of the samples, s, shape (batch, n).
        force: as commanded after the limit and before the delay, N (N·m), shape (batch, n).
        position: as the encoder reads it, m (rad), shape (batch, n).
        axis: name of the axis.
        motion: "linear" or "rotary".
        source: where the recording comes from, for messages.
        reference: what a servo followed, m (rad), shape (batch, n), or None.
        kept: which rows reached the log, shape (batch, n), or None for all.
        truth: the true motion, where it was watched.
    """

    time: FloatArray
    force: FloatArray
    position: FloatArray
    axis: str = "x"
    motion: Motion = "linear"
    source: str = "simulated"
    reference: FloatArray | None = None
    kept: NDArray[np.bool_] | None = None
    truth: Truth | None = None

    @property
    def batch(self) -> int:
        """Number of logs."""
        return len(self.force)

    def trajectory(self, member: int = 0) -> Trajectory:
        """The log of one member. Raises LogRefusedError if it is no log (too short, diverged)."""
        rows = slice(None) if self.kept is None else self.kept[member]
        return Trajectory(
            time=self.time[member][rows],
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
    if pushed is not None and pushed.shape[1] != samples:
        raise ValueError(f"push has {pushed.shape[1]} samples, force {samples}: give as many")
    loads = Loads(
        device=white_noise(sources, "force", column(faults.force_noise), samples),
        handle=hand.push(sources, stamps) + (0.0 if pushed is None else pushed.T),
    )
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
        followed = np.atleast_2d(np.asarray(controller.reference, dtype=np.float64))
        if followed.shape[1] != samples:
            raise ValueError(
                f"the reference has {followed.shape[1]} samples, the force {samples}: give one "
                f"value of each a sample"
            )
        reference = np.broadcast_to(followed, (batch, samples))
        command = command + column(controller.stiffness)[:, None] * reference
        controller = controller.regulator()
    sent, readings, states = _run(
        dynamics,
        timetable,
        np.repeat(command.T, batch // command.shape[0], axis=1),
        law=None if controller is None else ControlLaw(controller, sample_time),
        limit=column(rig.force_limit),
        encoder=Encoder(column(rig.encoder_resolution)),
        noise=noise,
        watch=watch,
    )
    truth = None
    if states is not None:
        with np.errstate(over="ignore", invalid="ignore"):  # what grows without end
            handle, speed, energy = (read_only_copy(each.T) for each in dynamics.seen(states))
        truth = Truth(handle=handle, speed=speed, energy=energy)
    return Recording(
        time=read_only_copy(stamps.T),
        force=read_only_copy(sent.T),
        position=read_only_copy(readings.T),
        axis=rig.axis,
        motion=rig.motion,
        source=f"simulated {rig.name}",
        reference=None if reference is None else read_only_copy(reference),
        kept=clock.kept(batch, samples, sources),
        truth=truth,
    )


def _run(
    dynamics: RigidDynamics | FlexibleDynamics,
    timetable: EvenTimetable | UnevenTimetable,
    command: FloatArray,
    *,
    law: ControlLaw | None,
    limit: FloatArray,
    encoder: Encoder,
    noise: FloatArray,
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
            readings[k] = reading = encoder.read(dynamics.measured() + noise[k])
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


#: Force of each axis from what its encoder reads, N (N·m), shape (batch, axes) both.
Law = Callable[[int, FloatArray], FloatArray]

#: Halvings of a part of a sample in which something turns: its instant to 1/16 000 of it.
_HALVINGS = 14
#: Sweeps of Gauss and Seidel for the friction of all axes in one small step.
_SWEEPS = 60
#: A delay this part of a sample off a whole number of samples is that number.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class RigOfAxes:
    """A batch of devices of several axes; arrays of shape (batch, ...), read from left to right.

    Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay), with the friction of each axis its own; an axis that
    is at rest stays there as long as friction can hold it.

    Attributes:
        mass: Λ, kg (kg·m²), shape (batch, axes, axes), symmetric and positive definite.
        damping: D, N·s/m (N·m·s/rad), of the same shape, symmetric.
        sample_time: T, s.
        delay: from command to action, s, of all axes.
        coulomb_friction: Fc, N (N·m), shape (batch, axes).
        force_offset: f0, N (N·m), shape (batch, axes).
        encoder_resolution: one count, m (rad), shape (axes,); 0 means no rounding.
        position_noise: standard deviation of a reading, m (rad).
    """

    mass: FloatArray
    damping: FloatArray
    sample_time: float
    delay: float = 0.0
    coulomb_friction: FloatArray | float = 0.0
    force_offset: FloatArray | float = 0.0
    encoder_resolution: FloatArray | float = 0.0
    position_noise: float = 0.0

    def run(
        self,
        force: FloatArray,
        *,
        law: Law | None = None,
        start: FloatArray | float = 0.0,
        speed: FloatArray | float = 0.0,
        seed: int = 0,
    ) -> Motions:
        """What is commanded and read over n samples.

        Args:
            force: N (N·m), shape (batch, n, axes); the whole command without a law, added to it
                with one.
            law: gives what a controller adds at sample k for the readings of all axes.
            start: positions at t = 0, m (rad), broadcast to (batch, axes).
            speed: velocities at t = 0, likewise.
            seed: of the noise of readings.
        """
        batch, samples, axes = force.shape
        whole = int(np.floor(self.delay / self.sample_time + _WHOLE))
        late = max(self.delay - whole * self.sample_time, 0.0)
        late = 0.0 if late < _WHOLE * self.sample_time else late
        parts = [(late, whole + 1), (self.sample_time - late, whole)]
        strides = [(_Stride(self, span), ago) for span, ago in parts if span > 0]
        friction = np.broadcast_to(self.coulomb_friction, (batch, axes)).astype(np.float64)
        offset = np.broadcast_to(self.force_offset, (batch, axes))
        counts = np.broadcast_to(self.encoder_resolution, (axes,)).astype(np.float64)
        encoder, chance = Encoder(counts), np.random.default_rng(seed)
        state = np.zeros((batch, 2 * axes))
        state[:, :axes], state[:, axes:] = start, speed
        commands = np.zeros((whole + 1 + samples, batch, axes))
        readings, truth = np.empty((2, samples, batch, axes))
        speeds = np.empty_like(truth)
        for k in range(samples):
            truth[k], speeds[k] = state[:, :axes], state[:, axes:]
            noise = self.position_noise * chance.standard_normal((batch, axes))
            readings[k] = encoder.read(truth[k] + noise)
            added = 0.0 if law is None else law(k, readings[k])
            commands[whole + 1 + k] = force[:, k] + added
            for stride, ago in strides:
                acting = commands[whole + 1 + k - ago] - offset
                state = stride.moved(state, acting, friction)
        return Motions(
            sample_time=self.sample_time,
            force=np.moveaxis(commands[whole + 1 :], 0, 1),
            position=np.moveaxis(readings, 0, 1),
            truth=np.moveaxis(truth, 0, 1),
            speed=np.moveaxis(speeds, 0, 1),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Motions:
    """What a batch of devices was commanded and did; arrays of shape (batch, n, axes).

    Attributes:
        sample_time: s.
        force: commanded, N (N·m).
        position: as encoders read it, m (rad).
        truth: true position, m (rad).
        speed: true velocity, m/s (rad/s).
    """

    sample_time: float
    force: FloatArray
    position: FloatArray
    truth: FloatArray
    speed: FloatArray

    def log(self, member: int = 0, axes: tuple[str, ...] = ("x", "y", "z")) -> Trajectories:
        """The log of one device. Raises LogRefusedError if it is no log."""
        time = self.sample_time * np.arange(self.force.shape[1], dtype=np.float64)
        return Trajectories(
            axes=tuple(
                Trajectory(
                    time=time,
                    force=self.force[member, :, axis],
                    position=self.position[member, :, axis],
                    axis=axes[axis],
                    motion="linear",
                    source="simulated",
                    may_stand=True,
                )
                for axis in range(self.force.shape[2])
            )
        )


@dataclass(frozen=True, slots=True)
class _Stride:
    """The linear law over a span, over half of it, a quarter, and so on."""

    rig: RigOfAxes
    span: float  # s
    #: by which axes stand all the time: changes of (q, q̇) by each of (q, q̇, force), each shape
    #: (batch, 2·axes, 3·axes), and of speed, per s
    _known: dict[tuple[bool, ...], tuple[list[FloatArray], FloatArray]] = field(
        default_factory=dict[tuple[bool, ...], tuple[list[FloatArray], FloatArray]]
    )

    def changes(
        self, stands: tuple[bool, ...], halving: int, members: Indices
    ) -> tuple[FloatArray, FloatArray]:
        """Those over span/2^halving of axes some of which stand, whatever the force; and per s."""
        if stands not in self._known:
            batch, axes, _ = self.rig.mass.shape
            moves = np.flatnonzero(~np.array(stands))
            square = (slice(None), moves[:, None], moves)
            light = np.zeros_like(self.rig.mass)  # Λ⁻¹ of what moves
            light[square] = np.linalg.inv(self.rig.mass[square])
            law = np.zeros((batch, 3 * axes, 3 * axes))
            law[:, moves, axes + moves] = 1.0
            law[:, axes : 2 * axes, axes : 2 * axes] = -light @ self.rig.damping
            law[:, axes : 2 * axes, 2 * axes :] = light
            spans = np.full(batch, self.span, dtype=np.float64)
            found = [each[:, : 2 * axes] for each in maps(law, spans, fastest(law), _HALVINGS)]
            self._known[stands] = found, law[:, axes : 2 * axes, axes:]
        found, slope = self._known[stands]
        return found[halving][members], slope[members]

    def moved(
        self,
        state: FloatArray,
        acting: FloatArray,
        friction: FloatArray,
        members: Indices | None = None,
        halving: int = 0,
    ) -> FloatArray:
        """(q, q̇) of some members after span/2^halving under held forces, through every turn."""
        members = np.arange(len(state)) if members is None else members
        later, calm = self._stepped(state, acting, friction, members, halving)
        if halving < _HALVINGS and not calm.all():
            rest = np.flatnonzero(~calm)
            half = state[rest]
            for _ in range(2):
                half = self.moved(half, acting[rest], friction[rest], members[rest], halving + 1)
            later[rest] = half
        return later

    def _stepped(
        self,
        state: FloatArray,
        acting: FloatArray,
        friction: FloatArray,
        members: Indices,
        halving: int,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """One step whose friction leaves no axis moving against it; where none turned or started.

        The friction held over the step is what brings an axis to rest at its end, if that is
        within what it can give, else all of it against the motion (Gauss and Seidel, axis by
        axis). What stands at both ends stands between.
        """
        axes = acting.shape[1]
        change, _ = self.changes((False,) * axes, halving, members)
        before = state[:, axes:]
        held = -friction * np.sign(before)
        later = _after(change, state, acting + held)
        # As long as all friction acts against motion that goes on, there is nothing to look for.
        calm = ((before * later[:, axes:] > 0) | (friction == 0)).all(axis=1)
        if calm.any():
            rest = np.flatnonzero(~calm)
            if rest.size:
                later[rest], calm[rest] = self._stepped(
                    state[rest], acting[rest], friction[rest], members[rest], halving
                )
            return later, calm
        slope = change[:, axes:, 2 * axes :]  # speed by force
        free = _after(change, state, acting)[:, axes:]
        held = _resting(free, slope, friction, held)
        later = _after(change, state, acting + held)
        rests = np.abs(held) < friction
        stands = rests & (before == 0)
        after = later[:, axes:]
        freed = np.zeros_like(stands)
        codes: Indices = stands @ (1 << np.arange(axes, dtype=np.intp))
        for code in np.flatnonzero(np.bincount(codes)[1:]) + 1:
            which = np.flatnonzero(codes == code)
            pattern = stands[which[0]]
            place, force = members[which], (acting + held)[which]
            change, law = self.changes(tuple(pattern.tolist()), halving, place)
            later[which] = _after(change, state[which], force)
            # What holds what stands at the end: all forces less what moves the others.
            bent = _times(law, np.hstack((after[which], force)))
            pull = _times(self.rig.mass[place], bent) + _times(
                self.rig.damping[place], after[which]
            )
            freed[which] = pattern & (np.abs(acting[which] - pull) > friction[which])
        after[rests] = 0.0
        turned = np.where(before != 0, after * before <= 0, after != 0) & (friction > 0)
        return later, ~(turned | freed).any(axis=1)


def _resting(
    free: FloatArray, slope: FloatArray, friction: FloatArray, held: FloatArray
) -> FloatArray:
    """Friction that brings axes to rest as far as it can, from a start; shape (members, axes)."""
    found = held.tolist()
    for place, own, speeds, limits in zip(
        found, slope.tolist(), free.tolist(), friction.tolist(), strict=True
    ):
        for _ in range(_SWEEPS):
            last = place.copy()
            for axis, (row, speed, most) in enumerate(zip(own, speeds, limits, strict=True)):
                wanted = place[axis] - (speed + sum(map(mul, row, place))) / row[axis]
                place[axis] = min(max(wanted, -most), most)
            if place == last:
                break
    return np.array(found)


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.einsum("bij,bj->bi", matrices, vectors)


def _after(change: FloatArray, state: FloatArray, force: FloatArray) -> FloatArray:
    return state + _times(change, np.concatenate((state, force), axis=1))
