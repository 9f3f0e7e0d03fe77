"""Other laws than the profile's, one change at a time: shifted columns, other filters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile
from tune.verification.law import Columns, columns_of, fit_scaled

FloatArray = NDArray[np.float64]

#: Rows by which the force column may be early or late.
_SHIFTS = (1, -1, 2, -2)
#: Cut-offs looked through, Hz, up to this part of the sample rate, ...
_LOWEST, _HIGHEST = 1.0, 0.45
#: ... first on so many places, then between the best and its neighbours to this part.
_PLACES, _FINE = 40, 1e-4
#: Windows of velocity looked through, samples.
_WINDOWS = range(1, 41)
#: A cut-off nearer to the profile's than this part is the same to any margin.
_MATERIAL_CUTOFF = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """What the law is judged on.

    Attributes:
        force: N, shape (n,).
        position: m, shape (n,).
        used: rows neither saturated nor outside of a one-sided wall, shape (n,).
    """

    force: FloatArray
    position: FloatArray
    used: NDArray[np.bool_]

    def columns(self, loop: LoopProfile, late: int = 0) -> Columns | None:
        """The regression of one variant."""
        return columns_of(self.force, self.position, loop, self.used, late=late)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One change of the law: what it is in words, what to do about it, whether it matters."""

    words: str
    remedy: str
    loop: LoopProfile
    late: int = 0
    material: bool = True


def variants(
    log: Log, loop: LoopProfile, moments: dict[tuple[str, ...], Effects]
) -> Iterator[Variant]:
    """Every law that is tried, the simplest first.

    Args:
        log: that searches of cut-offs and windows look at.
        loop: the profile's.
        moments: what may have been played.
    """
    for late in _SHIFTS:
        side = "late" if late > 0 else "early"
        yield Variant(
            words=f"the force column is {abs(late)} row(s) {side}: each force answers the position "
            f"logged {abs(late)} row(s) {'before' if late > 0 else 'after'} it",
            remedy="Log each force beside the position it was computed from; if the controller "
            "itself uses an older position, add that delay to the device and tune again.",
            loop=loop,
            late=late,
        )
    run = "Run the filters of the profile, or state those you run in the scene and tune again."
    damped = any(each.damping is not None for each in moments.values())
    heavy = any(each.mass is not None for each in moments.values())
    both: dict[str, object] = {}
    for name, concerned in (("velocity", damped), ("acceleration", heavy)):
        if not concerned:
            continue
        bare = _bare(name)
        if any(getattr(loop, key) is not None for key in bare):
            both |= bare
            yield Variant(
                words=f"{name} is not filtered", remedy=run, loop=loop.model_copy(update=bare)
            )
        yield from _other_filters(log, loop, moments, name, run)
    if damped and heavy:
        yield Variant(
            words="velocity and acceleration are not filtered",
            remedy=run,
            loop=loop.model_copy(update=both),
        )
        yield Variant(
            words="the cut-offs of velocity and acceleration are exchanged",
            remedy=run,
            loop=loop.model_copy(
                update={
                    "velocity_filter_hz": loop.acceleration_filter_hz,
                    "acceleration_filter_hz": loop.velocity_filter_hz,
                }
            ),
        )


def _bare(name: str) -> dict[str, object]:
    """What to change for an estimate without a filter."""
    bare: dict[str, object] = {f"{name}_filter_hz": None}
    return bare | ({"velocity_window_samples": None} if name == "velocity" else {})


def _other_filters(
    log: Log,
    loop: LoopProfile,
    moments: dict[tuple[str, ...], Effects],
    name: str,
    remedy: str,
) -> Iterator[Variant]:
    """Other cut-offs, orders, dampings and windows of one estimate."""
    stated: float | None = getattr(loop, f"{name}_filter_hz")
    own: int = getattr(loop, f"{name}_filter_order")
    for order in (own, 3 - own):

        def with_cutoff(hertz: float, order: int = order) -> LoopProfile:
            update = {f"{name}_filter_hz": hertz, f"{name}_filter_order": order}
            return loop.model_copy(update=_bare(name) | update)

        hertz = _best_cutoff(
            lambda f: _residual(log, with_cutoff(f), moments),
            _HIGHEST / loop.sample_time,
        )
        told = "no filter" if stated is None else f"{stated:.4g} Hz"
        kind = "" if order == own else f" and order {order} instead of {own}"
        yield Variant(
            words=f"{name} is filtered at {hertz:.4g} Hz{kind}; the profile has {told}",
            remedy=remedy,
            loop=with_cutoff(hertz),
            material=order != own or stated is None or abs(hertz / stated - 1) > _MATERIAL_CUTOFF,
        )
    if name == "velocity":
        count = min(_WINDOWS, key=lambda n: _residual(log, _windowed(loop, n), moments))
        yield Variant(
            words=f"velocity is taken over a window of {count} sample(s)",
            remedy=remedy,
            loop=_windowed(loop, count),
            material=count != loop.velocity_window_samples,
        )


def _windowed(loop: LoopProfile, count: int) -> LoopProfile:
    return loop.model_copy(update={"velocity_filter_hz": None, "velocity_window_samples": count})


def _residual(log: Log, loop: LoopProfile, moments: dict[tuple[str, ...], Effects]) -> float:
    columns = log.columns(loop)
    if columns is None:
        return np.inf
    return min(fit_scaled(columns, effects).residual for effects in moments.values())


def _best_cutoff(residual: Callable[[float], float], highest: float) -> float:
    from scipy.optimize import minimize_scalar

    places = np.geomspace(_LOWEST, highest, _PLACES)
    values = [residual(float(place)) for place in places]
    best = int(np.argmin(values))
    low, high = places[max(best - 1, 0)], places[min(best + 1, _PLACES - 1)]

    def at(logarithm: float) -> float:
        return residual(float(np.exp(logarithm)))

    found = minimize_scalar(
        at, bounds=(np.log(low), np.log(high)), method="bounded", options={"xatol": _FINE}
    )
    return float(np.exp(found.x))
