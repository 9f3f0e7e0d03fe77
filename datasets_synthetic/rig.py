"""Rig: the true parameters of simulated devices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from datasets_synthetic.recording import Motion, read_only_copy
from datasets_synthetic.vibration import Vibration

FloatArray = NDArray[np.float64]

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
