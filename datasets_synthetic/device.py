"""Devices as simulation truth: rigid parameters, vibration modes, all of one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

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


def choose_members(values: ArrayLike, which: NDArray[np.intp]) -> FloatArray:
    """The values of these members; one that all share stays one value.

    Values have shape (batch,) or (1,) or are one number; the answer has shape (members,) or that of
    the one value.
    """
    array = np.asarray(values, dtype=np.float64)
    return array if array.size == 1 else array[which]


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
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

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Vibration:
        """The mode of these members, shape (members,); a value that all share stays a number."""
        return Vibration(**{name: choose_members(getattr(self, name), which) for name in _FIELDS})


_FIELDS = ("frequency_hz", "damping_ratio", "at_encoder", "at_handle")


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
        coulomb_asymmetry: c, N (N·m), |c| <= Fc: likewise Fc + c and Fc - c.
        stiffness: k of a spring to ground, relaxed at zero, N/m (N·m/rad), any sign.
        gravity_sine: gs, N (N·m).
        gravity_cosine: gc, N (N·m).
        current_lag: time constant of the current loop, s, not negative; the force the actuator
            gives follows the delayed command with it.
        modes: vibration of the mechanism beside the rigid coordinate q; () is a rigid device.
        name: of the device, for messages.
        axis: name of the axis.
        motion: "linear" or "rotary".

    The law is m·q̈ + (b ± a)·q̇ + (Fc ± c)·sign(q̇) + f0 + k·q + gs·sin(q) + gc·cos(q) = F(t - delay),
    the upper sign for q̇ > 0. At rest the pull must exceed the friction of its own sense. Since
    (Fc ± c)·sign(q̇) is Fc·sign(q̇) + c whatever the direction, at rest too, no motion can tell c
    from f0: only their sum shows.

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
    coulomb_asymmetry: FloatArray
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
        coulomb_asymmetry: ArrayLike = 0.0,
        stiffness: ArrayLike = 0.0,
        gravity_sine: ArrayLike = 0.0,
        gravity_cosine: ArrayLike = 0.0,
        current_lag: ArrayLike = 0.0,
        modes: tuple[Vibration, ...] = (),
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
            "damping_asymmetry": damping_asymmetry,
            "coulomb_asymmetry": coulomb_asymmetry,
            "stiffness": stiffness,
            "gravity_sine": gravity_sine,
            "gravity_cosine": gravity_cosine,
            "current_lag": current_lag,
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
            object.__setattr__(self, key, read_only_copy(array))
        uneven = np.abs(self.coulomb_asymmetry) > self.coulomb_friction
        if np.any(uneven):
            raise ValueError(
                f"coulomb_asymmetry must not exceed coulomb_friction, "
                f"{self.coulomb_friction[uneven][0]:g}, not {self.coulomb_asymmetry[uneven][0]:g}"
            )
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


def _out_of_range(key: str, array: FloatArray) -> NDArray[np.bool_]:
    """Where a column of Rig holds what no device has."""
    impossible = np.isnan(array) if key == "force_limit" else ~np.isfinite(array)
    if key in _POSITIVE:
        return impossible | (array <= 0)
    return impossible | (array < 0) if key in _NOT_NEGATIVE else impossible


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
