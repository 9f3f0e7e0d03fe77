"""Devices as simulation truth, the hand on them, and what a log does not say: noise and clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Device, load_device

FloatArray = NDArray[np.float64]

Motion = Literal["linear", "rotary"]


def per_member(values: ArrayLike, batch: int) -> FloatArray:
    """One value a member, an array of its own, shape (batch,)."""
    return np.array(np.broadcast_to(np.asarray(values, dtype=np.float64), (batch,)))


def read_only_copy(array: FloatArray) -> FloatArray:
    """A read-only contiguous copy."""
    copy = np.array(array, order="C")
    copy.setflags(write=False)
    return copy


class Batched:
    """A dataclass of numbers, or arrays of one value a member, shape (batch,)."""

    __slots__ = ()
    #: Fields that all members share.
    shared: ClassVar[tuple[str, ...]] = ()

    def _columns(self) -> dict[str, NDArray[Any]]:
        mine: Any = self
        names = [each.name for each in fields(mine) if each.name not in self.shared]
        return {name: np.asarray(getattr(self, name)) for name in names}

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [column.size for column in self._columns().values()]

    def members(self, which: NDArray[np.intp]) -> Self:
        """Those of these members, shape (members,); a value that all share stays one."""
        mine: Any = self
        columns = self._columns().items()
        chosen = {name: each if each.size == 1 else each[which] for name, each in columns}
        return replace(mine, **chosen)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration(Batched):
    """One mode of a mechanism that is not rigid; numbers, or arrays of shape (batch,).

    Its coordinate q obeys m·(q'' + 2·z·w·q' + w²·q) = e·Fa - h·Fh, with m the whole mass of the
    device, Fa the force of the actuator and Fh what the device does to the hand. The encoder reads
    the rigid coordinate and e·q, the handle is at the rigid coordinate and h·q. A motor m1 with
    its encoder and a handle m2 on a spring make one mode, e = √(m2/m1) and h = -√(m1/m2).

    Attributes:
        frequency_hz: w/2π, undamped, Hz.
        damping_ratio: z, not negative.
        at_encoder: e, without unit.
        at_handle: h, without unit.
    """

    frequency_hz: float | FloatArray
    damping_ratio: float | FloatArray
    at_encoder: float | FloatArray
    at_handle: float | FloatArray

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.frequency_hz) > 0):
            raise ValueError(f"frequency_hz of a mode must be positive, not {self.frequency_hz}")
        if not np.all(np.asarray(self.damping_ratio) >= 0):
            raise ValueError(f"damping_ratio must not be negative, not {self.damping_ratio}")


_POSITIVE = frozenset({"mass", "sample_time", "force_limit"})
_NOT_NEGATIVE = frozenset({"coulomb_friction", "delay", "encoder_resolution", "current_lag"})


@dataclass(frozen=True, slots=True, kw_only=True, init=False)
class Rig:
    """The truth about a batch of devices; every array shape (batch,), read-only.

    Attributes:
        mass: m, kg (kg·m² if rotary), positive.
        damping: b, N·s/m (N·m·s/rad), any sign.
        sample_time: T, s, positive.
        coulomb_friction: Fc, N (N·m), not negative.
        force_offset: f0, N (N·m).
        delay: from command to action, s, not negative, need not be whole samples.
        encoder_resolution: one count, m (rad); 0 means no rounding.
        force_limit: largest |force| the actuator gives, N (N·m); may be infinite.
        damping_asymmetry: a, N·s/m (N·m·s/rad): the damping is b + a for q̇ > 0, b - a for q̇ < 0.
        stiffness: k of a spring to ground, relaxed at zero, N/m (N·m/rad), any sign.
        gravity_sine: gs, N (N·m).
        gravity_cosine: gc, N (N·m).
        current_lag: time constant of the current loop, s, not negative; the force the actuator
            gives follows the delayed command with it.
        modes: vibration of the mechanism beside the rigid coordinate q; () is a rigid device.
        name: of the device, for messages.
        axis: name of the axis.
        motion: "linear" or "rotary".

    The law is m·q̈ + (b ± a)·q̇ + Fc·sign(q̇) + f0 + k·q + gs·sin(q) + gc·cos(q) = F(t - delay), the
    upper sign for q̇ > 0. Coulomb friction that differs by direction is Fc and an offset.

    With modes q is the rigid coordinate, on which friction and field act, and mass the whole mass.

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
    damping_asymmetry: FloatArray
    stiffness: FloatArray
    gravity_sine: FloatArray
    gravity_cosine: FloatArray
    current_lag: FloatArray
    modes: tuple[Vibration, ...]
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
        damping_asymmetry: ArrayLike = 0.0,
        stiffness: ArrayLike = 0.0,
        gravity_sine: ArrayLike = 0.0,
        gravity_cosine: ArrayLike = 0.0,
        current_lag: ArrayLike = 0.0,
        modes: tuple[Vibration, ...] = (),
        name: str = "device",
        axis: str = "x",
        motion: Motion = "linear",
    ) -> None:
        given = {name: value for name, value in locals().items() if name in _COLUMNS}
        arrays = [np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in given.values()]
        for key, array in zip(given, np.broadcast_arrays(*arrays), strict=True):
            if array.ndim != 1:
                raise ValueError(f"{key} must be a number or of shape (batch,), not {array.shape}")
            impossible = np.isnan(array) if key == "force_limit" else ~np.isfinite(array)
            below = array <= 0 if key in _POSITIVE else (array < 0) & (key in _NOT_NEGATIVE)
            wrong = impossible | below
            if np.any(wrong):
                permitted = "positive" if key in _POSITIVE else "finite"
                permitted += " and not negative" if key in _NOT_NEGATIVE else ""
                raise ValueError(f"{key} must be {permitted}, not {array[wrong][0]:g}")
            object.__setattr__(self, key, read_only_copy(array))
        sizes = {size for mode in modes for size in mode.sizes()} - {1, self.mass.size}
        if sizes:
            raise ValueError(f"modes must be of {self.mass.size} devices or of 1, not {sizes}")
        object.__setattr__(self, "modes", tuple(modes))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "motion", motion)

    @property
    def batch(self) -> int:
        """Number of devices."""
        return self.mass.size

    @classmethod
    def batch_of(cls, rigs: Sequence[Rig]) -> Rig:
        """Devices with the same modes, one after the other, as one batch named after the first."""
        columns = {
            name: np.concatenate([np.atleast_1d(getattr(rig, name)) for rig in rigs])
            for name in _COLUMNS
        }
        members = np.zeros(len(rigs), dtype=np.intp)
        modes = tuple(mode.members(members) for mode in rigs[0].modes)
        return replace(rigs[0], **columns, modes=modes)

    def members(self, which: Sequence[int] | NDArray[np.intp]) -> Rig:
        """The devices at these indices, shape (members,), as a batch of their own."""
        chosen = np.asarray(which)
        columns = {name: getattr(self, name)[chosen] for name in _COLUMNS}
        modes = tuple(mode.members(chosen) for mode in self.modes)
        return replace(self, **columns, modes=modes)


_OTHERS = {"name", "axis", "motion", "modes"}
_COLUMNS = tuple(item.name for item in fields(Rig) if item.name not in _OTHERS)


def rig_of(device: Device) -> Rig:
    """One rig whose truth is the value of every quantity the device states.

    A device without encoder resolution is read exactly; one without force limit has no limit.
    """
    resolution, limit = device.encoder_resolution, device.force_limit
    return Rig(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=device.sample_time.value,
        coulomb_friction=device.coulomb_friction.value,
        force_offset=device.force_offset.value,
        delay=device.delay.value,
        stiffness=0.0 if device.position_stiffness is None else device.position_stiffness.value,
        gravity_sine=0.0 if device.gravity is None else device.gravity.sine.value,
        gravity_cosine=0.0 if device.gravity is None else device.gravity.cosine.value,
        encoder_resolution=0.0 if resolution is None else resolution.value,
        force_limit=np.inf if limit is None else limit.peak,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            Vibration(
                frequency_hz=mode.frequency_hz.value,
                damping_ratio=mode.damping_ratio.value,
                at_encoder=mode.at_encoder,
                at_handle=mode.at_handle,
            )
            for mode in device.modes
        ),
        name=device.name,
        axis=device.axis,
        motion=device.motion,
    )


def named_rig(name: str) -> Rig:
    """The rig of a named device or device file. Raises InvalidInputError."""
    return rig_of(load_device(name))


Purpose = Literal["position", "force", "coloured", "tremor", "wander", "clock", "rows", "start"]

#: The place of a purpose is part of its seed: new ones go to the end, and none is taken away.
_PURPOSES = get_args(Purpose)

#: Lines of a signal in a band, one in each of as many equal parts of it: enough for its values to
#: be all but normal (kurtosis 3 - 1.5/48).
_LINES = 48
#: Golden ratio: where in its part each line stands, all over it, so that the signal never repeats.
_GOLDEN = (1 + 5**0.5) / 2


class Sources:
    """Independent generators of every member, one for each thing that is random."""

    __slots__ = ("_sequences",)

    def __init__(self, seeds: Sequence[int], batch: int) -> None:
        """One seed is spread over the members by numpy's SeedSequence; several are one a member.

        The first member of a batch of one seed is the same as that of a batch of one.
        """
        if len(seeds) == 1:
            self._sequences = np.random.SeedSequence(seeds[0]).spawn(batch)
        else:
            self._sequences = [np.random.SeedSequence(each).spawn(1)[0] for each in seeds]

    def generators(self, purpose: Purpose) -> list[np.random.Generator]:
        """One generator a member, always the same for the same purpose and seed."""
        place = _PURPOSES.index(purpose)
        return [
            np.random.default_rng(
                np.random.SeedSequence(each.entropy, spawn_key=(*each.spawn_key, place))
            )
            for each in self._sequences
        ]


def white_noise(sources: Sources, purpose: Purpose, rms: FloatArray, samples: int) -> FloatArray:
    """Normal noise of the given rms (batch,), shape (samples, batch)."""
    noise = np.zeros((samples, rms.size))
    for member, source in enumerate(sources.generators(purpose) if np.any(rms) else ()):
        if rms[member] > 0:
            noise[:, member] = rms[member] * source.standard_normal(samples)
    return noise


def scatter(sources: Sources, spread: FloatArray) -> FloatArray:
    """One number a member, even between -spread and spread, shape (batch,)."""
    if not np.any(spread):
        return np.zeros_like(spread)
    return spread * np.array([each.uniform(-1, 1) for each in sources.generators("start")])


def band_noise(
    sources: Sources,
    purpose: Purpose,
    rms: FloatArray,
    band: tuple[float, float],
    stamps: FloatArray,
) -> FloatArray:
    """Sines of equal amplitude over a band, Hz, in random phases; stamps, s, (n, batch)."""
    noise = np.zeros(stamps.shape)
    if not np.any(rms):
        return noise
    low, high = band
    place = (np.arange(_LINES) + np.arange(_LINES) * _GOLDEN % 1.0) / _LINES
    turns = 2 * np.pi * (low + (high - low) * place)
    phase = 2 * np.pi * np.stack([each.random(_LINES) for each in sources.generators(purpose)])
    amplitude = rms * np.sqrt(2 / _LINES)
    common = stamps[:, :1]
    time = common if np.array_equal(np.broadcast_to(common, stamps.shape), stamps) else stamps
    for line, turn in enumerate(turns):
        angle = turn * time
        noise += np.sin(angle) * (amplitude * np.cos(phase[:, line]))
        noise += np.cos(angle) * (amplitude * np.sin(phase[:, line]))
    return noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults(Batched):
    """What disturbs the log; numbers, or arrays of shape (batch,).

    Attributes:
        position_noise: rms of white noise added to the position before rounding, m (rad).
        force_noise: rms of a white force that acts but is not logged, held one sample, N (N·m).
        start_spread: the device starts anywhere within this of its stated start, evenly, m (rad):
            where between two counts it stands is chance.
    """

    position_noise: float | FloatArray = 0.0
    force_noise: float | FloatArray = 0.0
    start_spread: float | FloatArray = 0.0


#: Jitter is cut at this part of the shortest step, so that stamps never meet.
_FURTHEST = 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock(Batched):
    """Uneven sampling and lost rows; the log carries the true stamps.

    The device is read, and its force renewed, at the uneven instants themselves. Rows are lost from
    the log only: the loop ran at every sample.

    Attributes:
        steps: lengths of the steps, s, taken in turn, over and over; empty means the rig's
            sample time at every step.
        jitter: rms of each stamp about its even place, normal, cut at 45 % of the shortest step,
            s, a number or shape (batch,). It does not add up; the first stamp is 0.
        dropped: probability of each row but the first and the last to be lost, 0 to below 1, a
            number or shape (batch,).
    """

    shared: ClassVar[tuple[str, ...]] = ("steps",)

    steps: tuple[float, ...] = ()
    jitter: float | FloatArray = 0.0
    dropped: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        if any(step <= 0 for step in self.steps):
            raise ValueError(f"steps of a clock must be positive, not {self.steps}")
        if np.any(np.asarray(self.jitter) < 0):
            raise ValueError(f"jitter must not be negative, not {self.jitter}")
        lost = np.asarray(self.dropped)
        if np.any((lost < 0) | (lost >= 1)):
            raise ValueError(f"dropped must be at least 0 and less than 1, not {self.dropped}")

    @property
    def even(self) -> bool:
        """Whether every step is the rig's sample time."""
        return not self.steps and not np.any(self.jitter)

    def nominal(self, sample_time: FloatArray) -> FloatArray:
        """Mean step, s, shape (batch,): what the filters of a controller are made for."""
        return np.full_like(sample_time, np.mean(self.steps)) if self.steps else sample_time

    def stamps(self, sample_time: FloatArray, samples: int, sources: Sources) -> FloatArray:
        """True stamps, s, shape (samples, batch), from zero and increasing."""
        if self.steps:
            turns = np.resize(np.asarray(self.steps, dtype=np.float64), samples)
            places = np.concatenate(([0.0], np.cumsum(turns)[:-1]))
            stamps = np.repeat(places[:, None], sample_time.size, axis=1)
            shortest = np.full_like(sample_time, min(self.steps))
        else:
            stamps = np.arange(samples, dtype=np.float64)[:, None] * sample_time
            shortest = sample_time
        jitter = per_member(self.jitter, sample_time.size)
        if not np.any(jitter):
            return stamps
        for member, source in enumerate(sources.generators("clock")):
            if jitter[member] > 0:
                bound = _FURTHEST * shortest[member]
                moved = np.clip(jitter[member] * source.standard_normal(samples), -bound, bound)
                stamps[1:, member] += moved[1:]
        return stamps

    def kept(self, batch: int, samples: int, sources: Sources) -> NDArray[np.bool_] | None:
        """Which rows reach the log, shape (batch, samples); None if all of them do."""
        dropped = per_member(self.dropped, batch)
        if not np.any(dropped):
            return None
        generators = sources.generators("rows")
        rows = np.stack([each.random(samples) for each in generators]) >= dropped[:, None]
        rows[:, [0, -1]] = True
        return rows


#: Physiological tremor of hand and forearm, Hz (R. J. Elble, W. C. Koller, Tremor, 1990).
TREMOR_BAND = (8.0, 12.0)
#: Voluntary motion of a hand that is not tracking anything fast, Hz.
WANDER_BAND = (0.1, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand(Batched):
    """Mass, damper and spring that move with the handle; numbers, or arrays of shape (batch,).

    The spring and the damper are fixed to ground, the spring at the rest position.

    Attributes:
        mass: of the hand, kg (kg·m²), added to that of the device.
        damping: N·s/m (N·m·s/rad).
        stiffness: N/m (N·m/rad).
        rest: where the spring is relaxed, m (rad).
        tremor: rms of an unlogged force of 8 to 12 Hz, held one sample, N (N·m).
        wander: rms of a slow voluntary motion of the rest position, 0.1 to 1 Hz, m (rad).
    """

    mass: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    stiffness: float | FloatArray = 0.0
    rest: float | FloatArray = 0.0
    tremor: float | FloatArray = 0.0
    wander: float | FloatArray = 0.0

    def push(self, sources: Sources, stamps: FloatArray) -> FloatArray:
        """Force of tremor and voluntary motion (its spring at zero apart), N, shape (n, batch)."""
        column = partial(per_member, batch=stamps.shape[1])
        moved = column(self.stiffness) * column(self.wander)
        tremor = band_noise(sources, "tremor", column(self.tremor), TREMOR_BAND, stamps)
        wander = band_noise(sources, "wander", moved, WANDER_BAND, stamps)
        return tremor + wander
