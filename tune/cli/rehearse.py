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

    from datasets_synthetic import Controller, Element, Hand, Rig
    from tune.documents.profile import Design, ElementProfile

#: Amplitude of force that may last, in ripple limits: the peak of three rms of a sinusoid. Within a
#: count the encoder keeps a frictionless device moving for ever.
_LASTING = 3 * 2**0.5
#: Moments played in one run: a step of a batch costs little more than one of a single device until
#: there are some hundred members, and each moment is some three dozen.
_AT_ONCE = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sum:
    """A sum of effects: K, N/m (N·m/rad); B, N·s/m (N·m·s/rad); M, kg (kg·m²)."""

    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = 0.0

    @classmethod
    def of(cls, elements: Sequence[ElementProfile]) -> _Sum:
        """The sum of some elements."""
        return cls(
            stiffness=sum(each.stiffness for each in elements),
            damping=sum(each.damping for each in elements),
            mass=sum(each.mass for each in elements),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """The elements that are felt at once.

    Attributes:
        name: of them all.
        plain: sum of those that are switched at any moment and pull as well as push.
        walls: sum of those that push only.
        fading: sum of those that fade.
        fade_time: the shortest of theirs, s.
    """

    name: str
    plain: _Sum
    walls: _Sum
    fading: _Sum
    fade_time: float


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

    rig = rig_of(design.device)
    others = _other_rigs(design, rig)
    moments = [_moment(design, names) for names in design.moments()]
    felt = [each for each in moments if {each.plain, each.walls, each.fading} != {_Sum()}]
    vetoes: list[str] = []
    for first in range(0, len(felt), _AT_ONCE):
        part = felt[first : first + _AT_ONCE]
        what = f"{part[0].name}{' and others' if part[1:] else ''}"
        count = f"({first // _AT_ONCE + 1} of {-(-len(felt) // _AT_ONCE)})"
        say(f"rehearsing {what} in simulation {count}")
        found = rehearse(
            rig,
            _law(design, part),
            hand=_grip(design),
            others=others,
            force_allowed=_LASTING * design.ripple_limit,
        )
        for moment, each in zip(part, found, strict=True):
            vetoes += [f"{moment.name}: rehearsal: {trial.reason}" for trial in each.vetoes[:1]]
    if vetoes:
        raise CheckFailedError(tuple(vetoes))


def _other_rigs(design: Design, rig: Rig) -> list[Rig]:
    """Devices that this one may be as well, and what friction with a memory makes of it.

    Three corners of the box of mass and damping, friction slopes in it, at the longest delay and
    the extra delay of the margin; and the device while its friction holds it like a spring.
    """
    device = design.device
    box = device.simultaneous_box()
    late = box.delay[1] + design.margin.extra_delay_samples * device.sample_time.value
    (light, heavy), (least, most) = box.mass, box.damping
    found = [
        replace(rig, mass=mass, damping=damping, damping_asymmetry=0.0, delay=late)
        for mass, damping in ((light, least), (heavy, least), (light, most))
    ]
    held = device.presliding_stiffness
    if held is not None:
        found.append(replace(rig, stiffness=rig.stiffness + held.high))
    return found


def _moment(design: Design, names: tuple[str, ...]) -> _Moment:
    chosen = [design.elements[name] for name in names]
    fading = [each for each in chosen if each.fade_time]
    at_once = [each for each in chosen if not each.fade_time]
    return _Moment(
        name=" + ".join(names),
        plain=_Sum.of([each for each in at_once if not each.one_sided]),
        walls=_Sum.of([each for each in at_once if each.one_sided]),
        fading=_Sum.of(fading),
        fade_time=min((each.fade_time for each in fading), default=0.0),
    )


def _column(rows: Sequence[_Sum] | Sequence[_Moment], name: str) -> NDArray[np.float64]:
    """One value a moment, shape (moments,)."""
    import numpy as np

    return np.array([getattr(each, name) for each in rows], dtype=np.float64)


def _law(design: Design, moments: Sequence[_Moment]) -> Controller:
    """The sums of effects as the simulator plays them, one member a moment."""
    from datasets_synthetic import Controller, Element

    plain, walls, fading = (
        [getattr(each, kind) for each in moments] for kind in ("plain", "walls", "fading")
    )
    beside: list[Element] = []
    if any(each != _Sum() for each in walls):
        beside.append(
            Element(
                stiffness=_column(walls, "stiffness"),
                damping=_column(walls, "damping"),
                one_sided=True,
            )
        )
    if any(each != _Sum() for each in fading):
        beside.append(
            Element(
                stiffness=_column(fading, "stiffness"),
                damping=_column(fading, "damping"),
                mass=_column(fading, "mass"),
                fade_time=_column(moments, "fade_time"),
            )
        )
    loop = design.loop
    infinite = float("inf")
    return Controller(
        stiffness=_column(plain, "stiffness"),
        damping=_column(plain, "damping"),
        mass=_column(plain, "mass"),
        beside=tuple(beside),
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
