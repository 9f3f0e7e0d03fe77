"""Choices of one filter cut-off on a logarithmic scale, from coarse places to written hertz."""

from __future__ import annotations

import math
from dataclasses import dataclass

from identification import round_to_digits
from tune.documents.scene import Cutoff
from tune.rendering.elements import FASTEST

#: Hz; a filter must pass the motions people make.
_LOWEST = FASTEST
#: Ratio of neighbouring cut-offs at first. Worth changes over several octaves: where ripple limits
#: a mass it rises with each octave of filtering, until force, stability or honey makes it fall.
COARSE = 3.0
#: Digits of a written cut-off.
_DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffAxis:
    """The choices of one cut-off on a logarithmic scale.

    Attributes:
        first: places to begin with, ascending; beyond the last but one there is no filter. One
            place where the cut-off is not free.
        fixed: Hz or none, where it is not free.
    """

    first: tuple[float, ...]
    fixed: float | None = None

    @classmethod
    def of(cls, cutoff: Cutoff, nyquist: float) -> CutoffAxis:
        """The choices that a scene leaves; Nyquist's frequency in Hz."""
        if cutoff != "free" or nyquist <= _LOWEST:
            return cls(first=(0.0,), fixed=cutoff if isinstance(cutoff, float) else None)
        low, high = math.log(_LOWEST), math.log(nyquist)
        count = math.ceil((high - low) / math.log(COARSE))
        return cls(first=tuple(low + (high - low) * k / count for k in range(count + 2)))

    @property
    def free(self) -> bool:
        """Whether there is anything to choose."""
        return len(self.first) > 1

    def hertz(self, place: float) -> float | None:
        """The cut-off as it is written; None for no filter."""
        if not self.free:
            return self.fixed
        return None if place > self.first[-2] else round_to_digits(math.exp(place), _DIGITS)
