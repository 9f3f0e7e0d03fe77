"""Before a profile is written it is played on a simulated device; what does not settle is vetoed.

The certificate is about a linear loop. Quantiser, friction, force limit and one-sided walls are for
the simulator, which shares no algebra with anything that tunes or certifies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from datasets_synthetic import Controller, Hand
    from tune.documents.profile import Design

#: Amplitude of force that may last, in ripple limits: the peak of three rms of a sinusoid. Within a
#: count the encoder keeps a frictionless device moving for ever.
_LASTING = 3 * 2**0.5
#: Moments played in one run: a step of a batch costs little more than one of a single device until
#: there are some hundred members, and each moment is up to two dozen.
_AT_ONCE = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """The sum of the elements that are felt at once.

    Attributes:
        name: of them all.
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad).
        mass: M, kg (kg·m²).
    """

    name: str
    stiffness: float
    damping: float
    mass: float


def refuse_restless(design: Design, say: Callable[[str], None]) -> None:
    """Play every moment of a design in the standard trials of the simulator.

    Args:
        design: as it will be stored, its force limit and encoder stated.
        say: told what is going on.

    Raises:
        CheckFailedError: some trial diverges or keeps oscillating; nothing may be written.
    """
    from datasets_synthetic import rehearse, rig_of
    from tune.documents.errors import CheckFailedError

    hand, held = _grip(design), design.device.presliding_stiffness
    rigs = [rig_of(design.device)]
    if held is not None:
        # Friction with a memory, before it slides.
        rigs.append(replace(rigs[0], stiffness=rigs[0].stiffness + held.high))
    moments = [_moment(design, names) for names in design.moments()]
    felt = [each for each in moments if each.stiffness or each.damping or each.mass]
    vetoes: list[str] = []
    for first in range(0, len(felt), _AT_ONCE):
        part = felt[first : first + _AT_ONCE]
        say(f"rehearsing {part[0].name}{' and others' if part[1:] else ''} in simulation")
        for rig in rigs:
            found = rehearse(
                rig,
                _law(design, part),
                hand=hand,
                force_allowed=_LASTING * design.ripple_limit,
            )
            for moment, each in zip(part, found, strict=True):
                vetoes += [f"{moment.name}: rehearsal: {trial.reason}" for trial in each.vetoes[:1]]
    if vetoes:
        raise CheckFailedError(tuple(vetoes))


def _moment(design: Design, names: tuple[str, ...]) -> _Moment:
    chosen = [design.elements[name] for name in names]
    return _Moment(
        name=" + ".join(names),
        stiffness=sum(each.stiffness for each in chosen),
        damping=sum(each.damping for each in chosen),
        mass=sum(each.mass for each in chosen),
    )


def _column(moments: Sequence[_Moment], name: str) -> NDArray[np.float64]:
    """One value a moment, shape (moments,)."""
    import numpy as np

    return np.array([getattr(each, name) for each in moments], dtype=np.float64)


def _law(design: Design, moments: Sequence[_Moment]) -> Controller:
    """The sums of effects as the simulator plays them, one member a moment."""
    from datasets_synthetic import Controller

    loop = design.loop
    infinite = float("inf")
    return Controller(
        stiffness=_column(moments, "stiffness"),
        damping=_column(moments, "damping"),
        mass=_column(moments, "mass"),
        velocity_filter_hz=loop.velocity_filter_hz or infinite,
        acceleration_filter_hz=loop.acceleration_filter_hz or infinite,
        velocity_filter_order=loop.velocity_filter_order,
        acceleration_filter_order=loop.acceleration_filter_order,
        filter_damping_ratio=loop.filter_damping_ratio,
        velocity_window_samples=loop.velocity_window_samples or 1,
    )


def _grip(design: Design) -> Hand | None:
    from datasets_synthetic import Hand

    hand = design.hand
    if hand is None:
        return None
    return Hand(mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value)
