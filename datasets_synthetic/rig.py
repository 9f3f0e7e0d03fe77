"""The simulator: true devices in continuous time, sampled and held as their controller sees them.

Independent by design: it integrates by its own means (motion.py) and shares no algebra with what
identifies or tunes. A whole batch of devices runs in one loop over time.

What happens at t = kT: the encoder is read (noise added, then rounded to a count), the controller
computes its force, the force limit clips it, the log takes down all three. The force then acts on
[kT + delay, (k+1)T + delay); before the first command arrives it is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from datasets_synthetic.controller import ControlLaw, Controller
from datasets_synthetic.motion import LARGEST_STEP, Drag, advance
from datasets_synthetic.sampling import generators, pieces, read_encoder, white_noise
from identification import Trajectory

FloatArray = NDArray[np.float64]
Motion = Literal["linear", "rotary"]

_POSITIVE = frozenset({"mass", "sample_time", "force_limit"})
_NOT_NEGATIVE = frozenset({"coulomb_friction", "delay", "encoder_resolution"})


@dataclass(frozen=True, slots=True, kw_only=True, init=False)
class Rig:
    """The truth about a batch of devices; every array shape (batch,), read-only.

    Attributes:
        mass: m, kg (kg·m² if rotary), positive.
        damping: b, N·s/m (N·m·s/rad), any sign.
        sample_time: T, s, positive.
        coulomb_friction: Fc, N (N·m), not negative.
        force_offset: f0, N (N·m): m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F(t - delay).
        delay: from command to action, s, not negative, need not be whole samples.
        encoder_resolution: one count, m (rad); 0 means no rounding.
        force_limit: largest |force| the actuator gives, N (N·m); may be infinite.
        name: of the device, for messages.
        axis: name of the axis.
        motion: "linear" or "rotary".

    The constructor takes numbers or arrays of shape (batch,) and broadcasts them.

    Raises:
        ValueError: a value outside its range, or shapes that do not agree.
    """

    mass: FloatArray
    damping: FloatArray
    sample_time: FloatArray
    coulomb_friction: FloatArray
    force_offset: FloatArray
    delay: FloatArray
    encoder_resolution: FloatArray
    force_limit: FloatArray
    name: str
    axis: str
    motion: Motion

    def __init__(
        self,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        sample_time: ArrayLike,
        coulomb_friction: ArrayLike = 0.0,
        force_offset: ArrayLike = 0.0,
        delay: ArrayLike = 0.0,
        encoder_resolution: ArrayLike = 0.0,
        force_limit: ArrayLike = np.inf,
        name: str = "device",
        axis: str = "x",
        motion: Motion = "linear",
    ) -> None:
        given = {
            "mass": mass,
            "damping": damping,
            "sample_time": sample_time,
            "coulomb_friction": coulomb_friction,
            "force_offset": force_offset,
            "delay": delay,
            "encoder_resolution": encoder_resolution,
            "force_limit": force_limit,
        }
        arrays = [np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in given.values()]
        for key, array in zip(given, np.broadcast_arrays(*arrays), strict=True):
            if array.ndim != 1:
                raise ValueError(f"{key} must be a number or of shape (batch,), not {array.shape}")
            wrong = _out_of_range(key, array)
            if np.any(wrong):
                permitted = "positive" if key in _POSITIVE else "finite"
                permitted += " and not negative" if key in _NOT_NEGATIVE else ""
                raise ValueError(f"{key} must be {permitted}, not {array[wrong][0]:g}")
            object.__setattr__(self, key, _frozen(array))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "motion", motion)

    @property
    def batch(self) -> int:
        """Number of devices."""
        return self.mass.size

    def members(self, which: Sequence[int] | NDArray[np.intp]) -> Rig:
        """The devices at these indices, as a batch of their own."""
        chosen = np.asarray(which)
        columns = {name: getattr(self, name)[chosen] for name in _COLUMNS}
        return replace(self, **columns)


_COLUMNS = tuple(item.name for item in fields(Rig) if item.name not in {"name", "axis", "motion"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """What disturbs the log; numbers, or arrays of shape (batch,).

    Attributes:
        position_noise: rms of white noise added to the position before rounding, m (rad).
        force_noise: rms of a white force that acts but is not logged, held one sample, N (N·m).
    """

    position_noise: float | FloatArray = 0.0
    force_noise: float | FloatArray = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Logs of a batch; arrays read-only.

    Attributes:
        sample_time: s, shape (batch,).
        force: as commanded after the limit and before the delay, N (N·m), shape (batch, n).
        position: as the encoder reads it, m (rad), shape (batch, n).
        axis: name of the axis.
        motion: "linear" or "rotary".
        source: where the recording comes from, for messages.
    """

    sample_time: FloatArray
    force: FloatArray
    position: FloatArray
    axis: str = "x"
    motion: Motion = "linear"
    source: str = "simulated"

    @property
    def batch(self) -> int:
        """Number of logs."""
        return self.sample_time.size

    def trajectory(self, member: int = 0) -> Trajectory:
        """The log of one member. Raises LogRefusedError if it is no log (too short, diverged)."""
        step = float(self.sample_time[member])
        return Trajectory(
            time=step * np.arange(self.force.shape[1], dtype=np.float64),
            force=self.force[member],
            position=self.position[member],
            axis=self.axis,
            motion=self.motion,
            source=self.source,
        )


def simulate(
    rig: Rig,
    force: FloatArray,
    *,
    controller: Controller | None = None,
    faults: Faults | None = None,
    seed: int | Sequence[int] = 0,
    position: float | FloatArray = 0.0,
    velocity: float | FloatArray = 0.0,
    largest_step: float = LARGEST_STEP,
) -> Recording:
    """Run a batch of devices for n samples.

    A rig, controller or start of one member is repeated to the size of the largest among rig,
    force, controller, start and list of seeds.

    Args:
        rig: the true devices.
        force: N (N·m), shape (n,) or (batch, n): the whole command in open loop, added to the
            controller's in closed loop.
        controller: virtual effects on the measured position, or None for open loop.
        faults: noise, or None for none.
        seed: a list gives each member its own; one number is spread over the members by
            numpy's SeedSequence, the first of them the same as that of a single run.
        position: at t = 0, m (rad), a number or shape (batch,).
        velocity: at t = 0, m/s (rad/s), a number or shape (batch,).
        largest_step: largest |h·b/m| of one integration step h; see motion.py for the error.

    Returns:
        One log a member. A loop that grows without bound ends in values that are not finite,
        which ``Recording.trajectory`` refuses.
    """
    faults = faults or Faults()
    seeds = tuple(int(each) for each in np.atleast_1d(seed))
    command = np.atleast_2d(np.asarray(force, dtype=np.float64))
    sizes = [rig.batch, command.shape[0], np.size(position), np.size(velocity), len(seeds)]
    sizes += [np.size(faults.position_noise), np.size(faults.force_noise)]
    sizes += [controller.size()] if controller is not None else []
    batch = max(sizes)
    if any(size not in {1, batch} for size in sizes):
        raise ValueError(f"batch sizes must agree or be 1, not {sizes}")
    samples = command.shape[1]

    def column(values: float | FloatArray) -> FloatArray:
        return np.array(np.broadcast_to(np.asarray(values, dtype=np.float64), (batch,)))

    sample_time, mass, offset = map(column, (rig.sample_time, rig.mass, rig.force_offset))
    limit = column(rig.force_limit)
    drag = Drag.of(
        mass=mass, damping=column(rig.damping), coulomb_friction=column(rig.coulomb_friction)
    )
    parts = tuple(pieces(column(rig.delay), sample_time, drag.rate, largest_step))
    longest = max(int(part.lag.max()) for part in parts)
    acting = [np.arange(batch) - part.lag * batch for part in parts]  # where in ``sent``, now = 0
    sources = generators(seeds, batch)
    noise = white_noise([pair[0] for pair in sources], column(faults.position_noise), samples)
    disturbance = white_noise([pair[1] for pair in sources], column(faults.force_noise), samples)
    resolution = column(rig.encoder_resolution)
    law = None if controller is None else ControlLaw(controller, sample_time)

    commands = np.zeros((longest + samples, batch))
    commands[longest:] = np.clip(command.T, -limit, limit) if law is None else command.T
    sent = commands.ravel()  # a view: row by row, one member after the other
    readings = np.empty((samples, batch))
    q, v = column(position), column(velocity)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(samples):
            readings[k] = reading = read_encoder(q if noise is None else q + noise[k], resolution)
            now = longest + k
            if law is not None:
                commands[now] = np.clip(commands[now] + law.force(reading), -limit, limit)
            resisted = offset if disturbance is None else offset - disturbance[k]
            for part, first in zip(parts, acting, strict=True):
                pull = (sent.take(first + now * batch) - resisted) / mass
                for _ in range(part.steps):
                    q, v = advance(q, v, pull, drag, part.step)
    return Recording(
        sample_time=_frozen(sample_time),
        force=_frozen(commands[longest:].T),
        position=_frozen(readings.T),
        axis=rig.axis,
        motion=rig.motion,
        source=f"simulated {rig.name}",
    )


def _out_of_range(key: str, array: FloatArray) -> NDArray[np.bool_]:
    """Where a column of Rig holds what no device has."""
    impossible = np.isnan(array) if key == "force_limit" else ~np.isfinite(array)
    if key in _POSITIVE:
        return impossible | (array <= 0)
    return impossible | (array < 0) if key in _NOT_NEGATIVE else impossible


def _frozen(array: FloatArray) -> FloatArray:
    """A read-only contiguous copy."""
    copy = np.array(array, order="C")
    copy.setflags(write=False)
    return copy
