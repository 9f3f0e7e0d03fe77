"""Measured cut-offs: the interval of each filter that the logged force allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile
from tune.loop.filters import Filters, filters_of
from tune.verification.law import fit_scaled
from tune.verification.outcome import Outcome
from tune.verification.variants import Log

#: χ² of one parameter at 99.9 %: a sum of squares that grows by this many variances rules out.
_CHI_SQUARE = 10.83
#: Rows that count as one, for what rounding leaves of slow positions is not white.
_ALIKE_ROWS = 20.0
#: Part of the force that is no residual at all.
_EXACT = 1e-6
#: The widest interval looked for: this many times below and above the stated cut-off; its ends are
#: found by so many halvings of the logarithm.
_WIDEST, _HALVINGS = 8.0, 24
#: An interval narrower than this part is one cut-off.
_THE_SAME = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCutoff:
    """What a log tells of one low-pass.

    Attributes:
        name: "velocity" or "acceleration".
        stated: of the profile, Hz.
        low: least cut-off that explains the force as well, Hz.
        high: largest one, Hz.
    """

    name: str
    stated: float
    low: float
    high: float

    @property
    def outcome(self) -> Outcome:
        """The interval beside what is stated, which the law was recognised by."""
        return Outcome(
            check=f"{self.name} filter",
            verdict="agrees",
            seen=f"{self.low:.5g} to {self.high:.5g} Hz",
            predicted=f"{self.stated:.5g} Hz",
            tolerance="the law with such a cut-off explains the force as well",
            numbers={"seen_low": self.low, "seen_high": self.high, "predicted": self.stated},
        )


def measured_cutoffs(log: Log, loop: LoopProfile, effects: Effects) -> tuple[MeasuredCutoff, ...]:
    """The interval of each cut-off in use, the other one as stated.

    Args:
        log: the rows of the law.
        loop: filters that were recognised.
        effects: as played; a filter without its effect is not looked at.
    """
    found: list[MeasuredCutoff] = []
    for name, size in (("velocity", effects.damping), ("acceleration", effects.mass)):
        stated: float | None = getattr(loop, f"{name}_filter_hz")
        if size is None or stated is None:
            continue
        columns = log.columns(loop)
        if columns is None:
            continue
        own = fit_scaled(columns, effects).residual
        rows = max(columns.force.size / _ALIKE_ROWS, 1.0)
        most = float(np.hypot(own * np.sqrt(1 + _CHI_SQUARE / rows), _EXACT * columns.scale))
        key = f"{name}_filter_hz"

        def allowed(hertz: float, key: str = key, most: float = most) -> bool:
            columns = log.columns(loop.model_copy(update={key: hertz}))
            return columns is not None and fit_scaled(columns, effects).residual <= most

        nyquist = 0.5 / loop.sample_time
        low = _end(allowed, stated, stated / _WIDEST)
        high = _end(allowed, stated, min(stated * _WIDEST, nyquist))
        found.append(MeasuredCutoff(name=name, stated=stated, low=low, high=high))
    return tuple(found)


def allowed_filters(loop: LoopProfile, cutoffs: tuple[MeasuredCutoff, ...]) -> tuple[Filters, ...]:
    """The stated filters, and every corner of the intervals of their cut-offs."""
    every = [filters_of(loop)]
    for each in cutoffs:
        if each.high / each.low < 1 + _THE_SAME:
            continue
        key = f"{each.name}_filter_hz"
        ends = [{key: end} for end in (each.low, each.high)]
        every += [replace(filters, **end) for filters in every for end in ends]
    return tuple(every)


def _end(allowed: Callable[[float], bool], inside: float, outside: float) -> float:
    """Where allowing ends between a cut-off that is allowed and one far off."""
    if allowed(outside):
        return outside
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(inside * outside))
        inside, outside = (middle, outside) if allowed(middle) else (inside, middle)
    return outside
