"""Before a profile is written it is played on a simulated device; what does not settle is vetoed.

The certificate is about a linear loop. Quantiser, friction, force limit and one-sided walls are for
the simulator, which shares no algebra with anything that tunes or certifies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets_synthetic import Controller, Hand
    from tune.profile import Design

#: Amplitude of force that may last, in ripple limits: the peak of three rms of a sinusoid. Within a
#: count the encoder keeps a frictionless device moving for ever.
_LASTING = 3 * 2**0.5
#: Where no force limit is known, pushes are measured by the force that the design uses, this often.
_SPARE = 2.0


def refuse_restless(design: Design, say: Callable[[str], None]) -> None:
    """Play every moment of a design in the standard trials of the simulator.

    Args:
        design: as it will be stored.
        say: told what is going on.

    Raises:
        CheckFailedError: some trial diverges or keeps oscillating; nothing may be written.
    """
    from datasets_synthetic import rehearse, rig_of
    from tune.errors import CheckFailedError

    rig = rig_of(design.device)
    hand = _grip(design)
    known = design.device.encoder_resolution is not None
    vetoes: list[str] = []
    for moment in design.moments():
        law, push = _law(design, moment)
        if law is None:
            continue
        where = " + ".join(moment)
        say(f"rehearsing {where} in simulation")
        found = rehearse(
            rig,
            law,
            hand=hand,
            reach=None if known else min(design.elements[n].motion.penetration for n in moment),
            push=None if design.device.force_limit is not None else push,
            force_allowed=_LASTING * design.ripple_limit,
        )
        vetoes += [f"{where}: rehearsal: {trial.reason}" for trial in found.vetoes[:1]]
    if vetoes:
        raise CheckFailedError(tuple(vetoes))


def _law(design: Design, moment: tuple[str, ...]) -> tuple[Controller | None, float]:
    """The sum of effects as the simulator plays it, None for nothing; and a force to push with."""
    from datasets_synthetic import Controller

    chosen = [design.elements[name] for name in moment]
    stiffness, damping, mass = (
        sum(getattr(element, effect) for element in chosen)
        for effect in ("stiffness", "damping", "mass")
    )
    if not (stiffness or damping or mass):
        return None, 0.0
    loop = design.loop
    infinite = float("inf")
    law = Controller(
        stiffness=stiffness,
        damping=damping,
        mass=mass,
        velocity_cutoff=loop.velocity_filter_hz or infinite,
        acceleration_cutoff=loop.acceleration_filter_hz or infinite,
        velocity_order=loop.velocity_filter_order,
        acceleration_order=loop.acceleration_filter_order,
        damping_ratio=loop.filter_damping_ratio,
        velocity_window=loop.velocity_window_samples or 1,
    )
    force = sum(
        abs(element.stiffness) * element.motion.penetration
        + abs(element.damping) * element.motion.speed
        + abs(element.mass) * element.motion.acceleration
        for element in chosen
    )
    return law, _SPARE * force


def _grip(design: Design) -> Hand | None:
    from datasets_synthetic import Hand

    hand = design.hand
    if hand is None:
        return None
    return Hand(mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value)
