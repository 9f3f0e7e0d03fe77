"""Before a profile is written it is played on a simulated device; what does not settle is vetoed.

The certificate is about a linear loop. Quantiser, friction, force limit and one-sided walls are for
the simulator, which shares no algebra with anything that tunes or certifies.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets_synthetic import Controller, Element, Rig
    from tune.documents.profile import Design, ElementProfile

    #: An element, the side to which it pushes and its place.
    _Part = tuple[ElementProfile, int, float]

#: Amplitude of force that may last, in ripple limits: the peak of three rms of a sinusoid. Within a
#: count the encoder keeps a frictionless device moving for ever.
_LASTING = 3 * 2**0.5
#: Moments played in one run: a step of a batch costs little more than one of a single device until
#: there are some hundred members, and each moment is some three dozen.
_AT_ONCE = 12
#: Walls whose lead times differ by less, in parts, are alike: one clamp of one signal.
_ALIKE = 1e-9


def refuse_restless(design: Design, say: Callable[[str], None]) -> None:
    """Play every moment of a design, and its transitions, in the standard trials of the simulator.

    The design is as it will be stored, its force limit and encoder stated. Raises CheckFailedError
    where some trial diverges or keeps oscillating; then nothing may be written.
    """
    from datasets_synthetic import Hand, rehearse, rig_of
    from tune.documents.effects import EFFECT_NAMES
    from tune.documents.errors import CheckFailedError

    hand = design.hand and Hand(
        mass=design.hand.mass.value,
        damping=design.hand.damping.value,
        stiffness=design.hand.stiffness.value,
    )
    rig = rig_of(design.device)
    others = _other_rigs(design, rig)
    felt = [
        names
        for names in design.moments()
        if any(getattr(design.elements[name], effect) for name in names for effect in EFFECT_NAMES)
    ]
    runs = -(-len(felt) // _AT_ONCE)
    vetoes: list[str] = []
    for run in range(runs):
        part = felt[run::runs]
        what = f"{' + '.join(part[0])}{' and others' if part[1:] else ''}"
        say(f"rehearsing {what} in simulation ({run + 1} of {runs})")
        found = rehearse(
            rig,
            _law(design, part),
            hand=hand,
            others=others,
            force_allowed=_LASTING * design.ripple_limit,
        )
        for names, each in zip(part, found, strict=True):
            told = [f"{' + '.join(names)}: rehearsal: {trial.reason}" for trial in each.vetoes]
            vetoes += told[:1]
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


def _law(design: Design, moments: Sequence[tuple[str, ...]]) -> Controller:
    """The elements as the simulator plays them, one member a moment."""
    from datasets_synthetic import Calls, Controller
    from tune.documents.profile import SafeProfile

    certified = {frozenset(names) for names in design.moments()}
    played = [_parts(design, names, certified) for names in moments]
    loop = design.loop
    infinite = float("inf")
    # Samples that a gain waits for before it rises; of an uncertified design one.
    taps = design.certificate.longest_tap if isinstance(design, SafeProfile) else 1
    return Controller(
        beside=tuple(_column(column) for column in zip_longest(*played)),
        calls=Calls(taps=taps),
        velocity_filter_hz=loop.velocity_filter_hz or infinite,
        acceleration_filter_hz=loop.acceleration_filter_hz or infinite,
        velocity_filter_order=loop.velocity_filter_order,
        acceleration_filter_order=loop.acceleration_filter_order,
        filter_damping_ratio=loop.filter_damping_ratio,
        velocity_window_samples=loop.velocity_window_samples or 1,
    )


def _parts(
    design: Design, names: tuple[str, ...], certified: Collection[frozenset[str]]
) -> list[_Part]:
    """The elements of a moment, and a wall on the other side, as near as it may stand."""
    walls = [name for name in names if name in design.walls]
    others = frozenset(names).difference(walls)
    parts = [(design.elements[name], -1 if name in walls else 0, 0.0) for name in names]
    facing = [
        name
        for name in design.elements
        if walls
        and name in design.walls.difference(walls)
        and others | {name} in certified
        and not any({name, wall} == set(pair) for wall in walls for pair in design.apart)
    ]
    for name in facing[:1]:
        leads = [_corridor(design.elements[wall], design.elements[name]) for wall in walls]
        parts.append((design.elements[name], 1, -max(leads)))
    return parts


def _corridor(wall: ElementProfile, other: ElementProfile) -> float:
    """The narrowest between two walls that is certified, m (rad): none where they are alike."""
    here, there = (each.damping / each.stiffness for each in (wall, other))
    if abs(here - there) <= _ALIKE * max(here, there):
        return 0.0
    return here * wall.motion.speed + there * other.motion.speed


def _column(parts: Sequence[_Part | None]) -> Element:
    """One part of each moment, or none of it, as one element of the batch."""
    import numpy as np

    from datasets_synthetic import Element

    rows = [(0.0, 0.0, 0.0, np.inf, 0.0, 0, 0.0)] * len(parts)
    for row, part in enumerate(parts):
        if part is not None:
            one, side, place = part
            sizes = one.stiffness, one.damping, one.mass
            rows[row] = (*sizes, one.force_level or np.inf, one.fade_time, side, place)
    columns = np.array(rows, dtype=np.float64).T
    names = ("stiffness", "damping", "mass", "level", "fade_time", "side", "place")
    return Element(**dict(zip(names, columns, strict=True)))  # pyright: ignore[reportArgumentType]
