"""Before a profile is written it is played on a simulated device; what does not settle is vetoed.

The certificate is about a linear loop. Quantiser, friction, force limit and one-sided walls are for
the simulator, which shares no algebra with anything that tunes or certifies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets_synthetic import Controller, Element, Hand, Rig
    from tune.documents.profile import Design, ElementProfile

#: Amplitude of force that may last, in ripple limits: the peak of three rms of a sinusoid. Within a
#: count the encoder keeps a frictionless device moving for ever.
_LASTING = 3 * 2**0.5
#: Moments played in one run: a step of a batch costs little more than one of a single device until
#: there are some hundred members, and each moment is some three dozen.
_AT_ONCE = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Effects that act as one: K, N/m (N·m/rad); B, N·s/m (N·m·s/rad); M, kg (kg·m²).

    Attributes:
        level: of the clamp of a spring, N (N·m).
        fade_time: s, 0 for what is switched.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = 0.0
    level: float = float("inf")
    fade_time: float = 0.0

    @classmethod
    def sum_of(cls, elements: Sequence[ElementProfile]) -> _Part:
        """Elements without a spring together; what fades as fast as the fastest of them."""
        return cls(
            damping=sum(each.damping for each in elements),
            mass=sum(each.mass for each in elements),
            fade_time=min((each.fade_time for each in elements), default=0.0),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """The elements that are felt at once.

    Attributes:
        name: of them all.
        walls: each that pushes only.
        springs: each other with a spring.
        damping: all that is damping only.
        fading: all that fades and has no spring.
    """

    name: str
    walls: tuple[_Part, ...]
    springs: tuple[_Part, ...]
    damping: _Part
    fading: _Part

    @property
    def silent(self) -> bool:
        """Whether nothing acts."""
        return not (self.walls or self.springs) and self.damping == self.fading == _Part()


def refuse_restless(design: Design, say: Callable[[str], None]) -> None:
    """Play every moment of a design, and its transitions, in the standard trials of the simulator.

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
    felt = [each for each in moments if not each.silent]
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
    springs = [(each.one_sided, _spring(each)) for each in chosen if each.stiffness]
    others = [each for each in chosen if not each.stiffness]
    return _Moment(
        name=" + ".join(names),
        walls=tuple(part for one_sided, part in springs if one_sided),
        springs=tuple(part for one_sided, part in springs if not one_sided),
        damping=_Part.sum_of([each for each in others if not each.fades]),
        fading=_Part.sum_of([each for each in others if each.fades]),
    )


def _spring(element: ElementProfile) -> _Part:
    return _Part(
        stiffness=element.stiffness,
        damping=element.damping,
        mass=element.mass,
        level=element.force_level,
        fade_time=element.fade_time,
    )


def _law(design: Design, moments: Sequence[_Moment]) -> Controller:
    """The elements as the simulator plays them, one member a moment."""
    from datasets_synthetic import Controller

    columns = [
        (True, _column([each.walls[place : place + 1] for each in moments]))
        for place in range(max(len(each.walls) for each in moments))
    ]
    columns += [
        (False, _column([each.springs[place : place + 1] for each in moments]))
        for place in range(max(len(each.springs) for each in moments))
    ]
    columns += [
        (False, _column([(getattr(each, kind),) for each in moments]))
        for kind in ("damping", "fading")
        if any(getattr(each, kind) != _Part() for each in moments)
    ]
    loop = design.loop
    infinite = float("inf")
    return Controller(
        beside=tuple(
            replace(element, one_sided=one_sided, quiet=_longest_tap(design))
            for one_sided, element in columns
        ),
        velocity_filter_hz=loop.velocity_filter_hz or infinite,
        acceleration_filter_hz=loop.acceleration_filter_hz or infinite,
        velocity_filter_order=loop.velocity_filter_order,
        acceleration_filter_order=loop.acceleration_filter_order,
        filter_damping_ratio=loop.filter_damping_ratio,
        velocity_window_samples=loop.velocity_window_samples or 1,
    )


def _column(parts: Sequence[tuple[_Part, ...]]) -> Element:
    """One part of each moment, or none of it, as one element of the batch."""
    import numpy as np

    from datasets_synthetic import Element

    rows = [part[0] if part else _Part() for part in parts]
    return Element(
        **{
            name: np.array([getattr(each, name) for each in rows], dtype=np.float64)
            for name in ("stiffness", "damping", "mass", "level", "fade_time")
        }  # pyright: ignore[reportArgumentType]
    )


def _longest_tap(design: Design) -> int:
    """Samples that a gain waits for before it rises; of an uncertified design one."""
    from tune.documents.profile import SafeProfile

    return design.certificate.longest_tap if isinstance(design, SafeProfile) else 1


def _grip(design: Design) -> Hand | None:
    from datasets_synthetic import Hand

    hand = design.hand
    if hand is None:
        return None
    return Hand(mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value)
