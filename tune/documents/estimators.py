"""The estimators of velocity and acceleration: differences behind a low-pass, or tracking filters.

An estimate is the k-th backward difference of the readings, k = 1 of velocity and 2 of
acceleration, behind n poles exp(-2π·f·T), together of unit gain; two poles, and of more the first
two, are the pair exp(-2π·f·T·(ζ ± j√(1-ζ²))). A tracking filter of n states is the steady observer
of position, velocity and so on under a constant highest derivative, whose error has these n poles
(α-β and α-β-γ filters: P. R. Kalata, IEEE Trans. Aerospace and Electronic Systems 20, 1984). With
n = k + 1 that is the low-pass. With n = k + 2 it is the low-pass carried on along its last change
by its own lag, x + ℓ·(x - x before): slow motions are then estimated without lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, cast

FilterKind = Literal["low-pass", "tracking"]
Derivative = Literal["velocity", "acceleration"]
DERIVATIVES: tuple[Derivative, ...] = ("velocity", "acceleration")
#: Differences of each, k; also the poles of a low-pass where nobody states them.
DIFFERENCES: dict[Derivative, int] = {"velocity": 1, "acceleration": 2}
#: What the names of kind, cut-off and order end in.
_ENDS = "", "_hz", "_order"
#: Kinds, with poles or states, of which one is chosen where they are free, the usual first.
KINDS: dict[Derivative, tuple[tuple[FilterKind, int], ...]] = {
    "velocity": (("low-pass", 1), ("low-pass", 2), ("tracking", 3)),
    "acceleration": (("low-pass", 2), ("tracking", 4), ("low-pass", 1)),
}
#: Likewise damping ratios, with each of them.
RATIOS = (1.0, 0.5)


class FilterSettings(Protocol):
    """What holds the settings of both filters by the names that files give them."""

    @property
    def filter_damping_ratio(self) -> float:
        """ζ of pairs of poles."""
        ...


class Filter(NamedTuple):
    """One of the two filters as files name it; without a cut-off, Hz, it is none."""

    kind: FilterKind
    hertz: float | None
    order: int

    def __str__(self) -> str:
        if self.hertz is None:
            return "none"
        tracking = f" tracking, {self.order} states" if self.kind == "tracking" else ""
        return f"{self.hertz:g} Hz{tracking}"


def filter_of(settings: FilterSettings, which: Derivative) -> Filter:
    """One of the filters of anything that holds the settings of both."""
    kind, hertz, order = (getattr(settings, f"{which}_filter{end}") for end in _ENDS)
    return Filter(cast("FilterKind", kind), hertz, order)


def idle_settings(settings: FilterSettings, *, damping: bool, mass: bool) -> dict[str, Any]:
    """Settings of filters that these effects do not use, at their defaults."""
    idle: dict[str, Any] = {} if damping else {"velocity_window_samples": None}
    pairs = False
    for which, acts in zip(DERIVATIVES, (damping, mass), strict=True):
        _, hertz, order = filter_of(settings, which)
        if acts and hertz is not None:
            pairs |= order >= 2
            continue
        defaults = "low-pass", None, DIFFERENCES[which]
        idle |= zip((f"{which}_filter{end}" for end in _ENDS), defaults, strict=True)
    return idle if pairs else idle | {"filter_damping_ratio": 1.0}


def strange_order(which: Derivative, kind: FilterKind, order: object) -> str | None:
    """What is wrong with an order, as a sentence; None where nothing is."""
    least = 1 if kind == "low-pass" else DIFFERENCES[which] + 1
    if order in {least, least + 1}:
        return None
    words = "poles of a low-pass" if kind == "low-pass" else "states of a tracking filter"
    return f"{which}_filter_order must be {least} or {least + 1}, {words}, not {order!r}"


def leads(which: Derivative, kind: FilterKind, order: int) -> bool:
    """Whether the filter carries its low-pass on by its own lag."""
    return kind == "tracking" and order == DIFFERENCES[which] + 2


@dataclass(frozen=True, slots=True)
class Section:
    """A low-pass x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k] with g = 1 - t + p.

    One pole a: t = a, p = 0. No filter: t = p = 0.
    """

    t: float = 0.0
    p: float = 0.0

    @property
    def gain(self) -> float:
        """g, from the very t and p that are printed, so that a steady input passes unchanged."""
        return 1 - self.t + self.p

    @property
    def lag(self) -> float:
        """Samples by which a slow input comes out late."""
        return (self.t - 2 * self.p) / self.gain


@dataclass(frozen=True, slots=True)
class Estimator:
    """Behind the differences two sections, one after the other, then x + lead·(x - x before)."""

    first: Section = Section()
    then: Section = Section()
    lead: float = 0.0  # samples

    @classmethod
    def of(cls, settings: FilterSettings, which: Derivative, sample_time: float) -> Estimator:
        """The filter of velocity or acceleration of anything that holds the settings of both."""
        kind, hertz, order = filter_of(settings, which)
        if hertz is None:
            return cls()
        ratio = settings.filter_damping_ratio
        turn = 2 * math.pi * hertz * sample_time
        single = math.exp(-turn)
        if order == 1:
            return cls(Section(single))
        size = math.exp(-ratio * turn)
        pair = Section(2 * size * math.cos(turn * math.sqrt(1 - ratio * ratio)), size * size)
        rest = (Section(), Section(single), Section(2 * single, single * single))[order - 2]
        lag = pair.lag + rest.lag + DIFFERENCES[which] / 2
        return cls(pair, rest, lag if leads(which, kind, order) else 0.0)
