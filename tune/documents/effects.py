"""Effects: the virtual stiffness, damping and mass of one moment; units of all that designs say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from identification import Motion

FloatArray = NDArray[np.float64]
EffectName = Literal["stiffness", "damping", "mass"]
EFFECT_NAMES: tuple[EffectName, ...] = ("stiffness", "damping", "mass")
#: s, over which an element that may pump fades in and out at least, and at most.
SHORTEST_FADE, LONGEST_FADE = 0.1, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """Virtual stiffness K, damping B and mass M; numbers, or arrays of shapes that broadcast.

    ``None`` says that the effect is not there at all, which is not the same as zero: without any
    stiffness the position is free by design and the pole at z = 1 is not held against the loop,
    while a stiffness of zero leaves the loop marginal and is not stable.

    Attributes:
        stiffness: K, N/m (N·m/rad if rotary).
        damping: B, N·s/m (N·m·s/rad); negative values compensate friction.
        mass: M, kg (kg·m²); negative values make the device lighter.
    """

    stiffness: ArrayLike | None = None
    damping: ArrayLike | None = None
    mass: ArrayLike | None = None

    @property
    def position_free(self) -> bool:
        """True when no spring is part of the structure."""
        return self.stiffness is None

    def arrays(self) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
        """(K, B, M) as float64 arrays of the shapes given, ``None`` kept."""
        return (_array(self.stiffness), _array(self.damping), _array(self.mass))


def _array(values: ArrayLike | None) -> FloatArray | None:
    return None if values is None else np.asarray(values, dtype=np.float64)


UNITS: dict[Motion, dict[str, str]] = {
    "linear": {
        "stiffness": "N/m",
        "damping": "N·s/m",
        "mass": "kg",
        "force": "N",
        "length": "m",
        "speed": "m/s",
    },
    "rotary": {
        "stiffness": "N·m/rad",
        "damping": "N·m·s/rad",
        "mass": "kg·m²",
        "force": "N·m",
        "length": "rad",
        "speed": "rad/s",
    },
}


def format_number(number: float) -> str:
    """Four digits, without an exponent where there are no more than six before the point."""
    return f"{float(f'{number:.4g}'):g}"
