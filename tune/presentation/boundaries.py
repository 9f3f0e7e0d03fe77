"""Boundaries of the stable region of a device: best estimate, worst corner, whole margin kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.documents.profile import Design
from tune.loop.filters import Filters, filters_of
from tune.loop.loop import Loop
from tune.optimisation.region import DelayedLoops, Region
from tune.stability.verdict import largest, stable_values

FloatArray = NDArray[np.float64]

#: Parts of the margin's gain at which a point is judged: every gain below is to be stable too.
_PARTS = (0.25, 0.5, 0.75, 1.0)
#: Damping of a device that has as good as none, as a scale.
_LEAST_SCALE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Boundaries:
    """The largest stiffness for given damping and mass, on the device of a design.

    Attributes:
        nominal: loop at the best estimate.
        corners: loops of the corners of the box, at every delay up to the margin's.
        gain: of the margin.
        damping: of the device itself at its best estimate, N·s/m: a scale.
    """

    nominal: Loop
    corners: tuple[DelayedLoops, ...]
    gain: float
    damping: float

    @classmethod
    def of(cls, design: Design, filters: Filters | None = None) -> Boundaries:
        """The boundaries on the device, hand and filters of a design.

        Args:
            design: a profile, or what was judged.
            filters: None takes the design's.
        """
        used = filters or filters_of(design.loop)
        extra = design.margin.extra_delay_samples
        region = Region.of(design.device, design.hand, extra=extra)
        return cls(
            nominal=Loop.from_parts(design.device, used),
            corners=region.loops(used, extra),
            gain=design.margin.gain,
            damping=max(abs(design.device.damping.value), _LEAST_SCALE),
        )

    def at_best(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stable stiffness on the best estimate, of the broadcast shape, N/m."""
        B, M = np.broadcast_arrays(damping, mass)
        return largest(self.nominal, "stiffness", Effects(damping=B, mass=_present(M)))

    def at_worst(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stiffness that is stable at every corner of the box and delay of the device.

        N/m, of the broadcast shape of damping and mass.
        """
        return self._least(damping, mass, (1.0,), late=False)

    def with_margin(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stiffness stable at every corner with the extra delay, at gains up to the margin.

        N/m, of the broadcast shape of damping and mass. Judged at a few gains from zero up; the
        certificate judges them all.
        """
        return self._least(damping, mass, self._gains(), late=True)

    def damping_with_margin(self, stiffness: float, damping: float, mass: float) -> float:
        """Damping up to which a stiffness and a mass keep the whole margin, from one that does.

        Args:
            stiffness: N/m; 0 for none.
            damping: N·s/m, where to begin.
            mass: kg; 0 for none.

        Returns:
            N·s/m; the damping to begin with where not even that keeps the margin.
        """
        found: list[float] = []
        for gain in self._gains():
            K, M = np.array([gain * stiffness]), np.array([gain * mass])
            others = Effects(stiffness=_present(K), mass=_present(M))
            for each in self.corners:
                low, high = stable_values(each.loop, "damping", others)
                start = gain * max(damping, 0.0)
                inside = (low <= start) & (high > start)
                found.append(float(np.min(np.max(np.where(inside, high, 0.0), axis=0))) / gain)
        return max(min(found), damping)

    def _gains(self) -> tuple[float, ...]:
        return tuple(part * self.gain for part in _PARTS)

    def _least(
        self,
        damping: FloatArray,
        mass: FloatArray | float,
        gains: tuple[float, ...],
        *,
        late: bool,
    ) -> FloatArray:
        """Least over corners and gains, of the broadcast shape."""
        B, M = np.broadcast_arrays(damping, mass)
        gain = np.reshape(gains, (-1, *(1,) * (B.ndim + 1)))
        effects = Effects(damping=gain * B[..., None], mass=_present(gain * M[..., None]))
        found = [
            np.min(largest(each.loop, "stiffness", effects) / gain, axis=(0, -1))
            for each in self.corners
            if late or each.beyond == 0
        ]
        return np.min(found, axis=0)


def _present(values: FloatArray) -> FloatArray | None:
    """An effect that is nowhere is not there at all."""
    return values if np.any(values) else None
