"""What a design asks to be proved: regions of its device, and the effects of a moment."""

from __future__ import annotations

from dataclasses import replace

from tune.certificate.point import Setting
from tune.certificate.region import HandRegion, ModeRegion, Region
from tune.documents.profile import Design


def regions_of(design: Design) -> tuple[Region, ...]:
    """The device alone, held by its friction before it slides, and both in the box of hands."""
    device = design.device
    box = device.simultaneous_box()
    lag = device.current_lag
    bare = Region(
        mass=box.mass,
        damping=box.damping,
        sample_time=box.sample_time,
        delay=box.delay,
        modes=tuple(
            ModeRegion(
                frequency_hz=(mode.frequency_hz.low, mode.frequency_hz.high),
                damping_ratio=(mode.damping_ratio.low, mode.damping_ratio.high),
                at_encoder=mode.at_encoder,
                at_handle=mode.at_handle,
            )
            for mode in device.modes
        ),
        current_lag=(0.0, 0.0) if lag is None else (lag.low, lag.high),
        position_stiffness=box.position_stiffness,
    )
    alone = (bare,)
    held = device.presliding_stiffness
    if held is not None:
        low, high = box.position_stiffness
        alone += (replace(bare, position_stiffness=(low + held.low, high + held.high)),)
    if design.hand is None:
        return alone
    hand = HandRegion(
        mass=(design.hand.mass.low, design.hand.mass.high),
        damping=(design.hand.damping.low, design.hand.damping.high),
        stiffness=(design.hand.stiffness.low, design.hand.stiffness.high),
    )
    return (*alone, *(replace(each, hand=hand) for each in alone))


def setting_of(design: Design, moment: tuple[str, ...]) -> Setting | None:
    """The sum of effects of some elements; None if nothing acts."""
    chosen = [design.elements[name] for name in moment]
    totals = [
        sum(getattr(element, effect) for element in chosen)
        for effect in ("stiffness", "damping", "mass")
    ]
    if not any(totals):
        return None
    return Setting(
        stiffness=totals[0],
        damping=totals[1],
        mass=totals[2],
        **design.loop.filter_settings(),
    )
