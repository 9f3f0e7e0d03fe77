"""Forces, ripple and passivity: what a profile claims besides stability, recomputed."""

from __future__ import annotations

import numpy as np

from tune.certificate.passivity import damping_for_passivity, passive
from tune.certificate.point import ModePoint, Point, Setting
from tune.certificate.region import Region
from tune.certificate.ripple import ripple_by_integration
from tune.documents.certified import HandPlace
from tune.documents.profile import Design

#: A claimed number may differ from the recomputed one by this much, relative: both are printed.
_AGREE = 1e-3
#: Force levels are stated with six digits.
_CUT = 1e-5
#: A delay within this part of a sample of a whole number is that number; clocks are not better.
_WHOLE = 1e-6
#: Sample times of the interval at which a claim of passivity is looked at.
_STEPS = 9


def force_failures(design: Design, moment: tuple[str, ...]) -> list[str]:
    """Forces of the stated motions against the limits of the device."""
    limit = design.device.force_limit
    if limit is None:
        return []
    chosen = [design.elements[name] for name in moment]
    # What is cut at its level needs no penetration: that it is safe so is proved apart.
    sustained = sum(item.stiffness * (item.motion.penetration or 0.0) for item in chosen)
    peak = sustained + sum(
        (0.0 if item.one_sided and item.cut else abs(item.damping) * item.motion.speed)
        + abs(item.mass) * item.motion.acceleration
        for item in chosen
    )
    levels = sum(item.force_level for item in chosen if item.stiffness)
    wrong = [
        f"{name}: force_level says {item.force_level:.6g}, its spring gives {deep:.6g} as deep as "
        "is stated"
        for name, item in zip(moment, chosen, strict=True)
        for deep in (item.stiffness * (item.motion.penetration or 0.0),)
        if (item.force_level > 0) != bool(item.stiffness) or deep > item.force_level * (1 + _CUT)
    ]
    return wrong + [
        f"{' + '.join(moment)}: {words} force {seen:.6g} exceeds the limit {most:.6g}"
        for words, seen, most in (
            ("sustained", sustained, limit.continuous),
            ("peak", peak, limit.peak),
            ("cut", levels, limit.peak),
        )
        if seen > most * (1 + 1e-9)
    ]


def meets_wall(design: Design, moment: tuple[str, ...]) -> bool:
    """Whether a wall is met beside other elements, where ripple is told and not bound."""
    return bool(design.walls.intersection(moment)) and not design.walls.issuperset(moment)


def ripple_failures(design: Design, moment: tuple[str, ...], setting: Setting) -> list[str]:
    """Ripple of a moment against the limit, and what a lone element claims against what it has."""
    seen = ripple_of(design, setting)
    if seen is None:
        return []
    where = " + ".join(moment)
    failures: list[str] = []
    if not seen <= design.ripple_limit * (1 + _AGREE):
        failures.append(f"{where}: ripple {seen:.4g} exceeds the limit {design.ripple_limit:.4g}")
    claimed = max((design.elements[name].ripple or 0.0 for name in moment), default=0.0)
    if len(moment) == 1 and claimed < seen * (1 - _AGREE):
        failures.append(f"{where}: claims a ripple of {claimed:.4g}, has {seen:.4g}")
    return failures


def ripple_of(design: Design, setting: Setting) -> float | None:
    """Force ripple at the best estimate and the longest delay, with a hand or without, N (N·m).

    None where the encoder is not known.
    """
    resolution = design.device.encoder_resolution
    if resolution is None:
        return None
    return max(
        ripple_by_integration(point, setting, resolution.value) for point in _best_estimates(design)
    )


def _best_estimates(design: Design) -> list[Point]:
    device = design.device
    samples = device.delay.high / device.sample_time.value
    whole = round(samples)
    hands = [None] if design.hand is None else [None, design.hand]
    return [
        Point(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay_samples=float(whole) if abs(samples - whole) <= _WHOLE else samples,
            modes=tuple(
                ModePoint(
                    frequency_hz=mode.frequency_hz.value,
                    damping_ratio=mode.damping_ratio.value,
                    at_encoder=mode.at_encoder,
                    at_handle=mode.at_handle,
                )
                for mode in device.modes
            ),
            hand=hand
            and HandPlace(
                mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value
            ),
            current_lag=0.0 if device.current_lag is None else device.current_lag.value,
            position_stiffness=device.slope_at_zero,
        )
        for hand in hands
    ]


def passivity_failures(
    design: Design, moment: tuple[str, ...], setting: Setting, region: Region
) -> list[str]:
    """A claim of passivity, which is known for a rigid device and whole samples of delay."""
    claimed = [name for name in moment if design.elements[name].margins.passive is True]
    if len(moment) != 1 or not claimed:
        return []
    whole = whole_delay(region)
    if whole is None:
        return [
            f"{claimed[0]}: claims passivity with a mode, a lag or a part of a sample of delay, "
            "where it is not known"
        ]
    damping = region.damping[0]
    for step in np.linspace(*region.sample_time, _STEPS):
        if not passive(setting, damping, float(step), whole):
            needed = damping_for_passivity(setting, float(step), whole)
            return [
                f"{claimed[0]}: claims passivity with a delay of {whole} samples, but a damping "
                f"of {damping:.6g} is too little, {needed:.6g} is needed"
            ]
    return []


def whole_delay(region: Region, close: float = _WHOLE) -> int | None:
    """Samples of delay of a rigid device, for which passivity is known.

    Args:
        region: the device alone.
        close: parts of a sample that count as none.

    Returns:
        None with a mode, a lag or a part of a sample.
    """
    delays = {region.delay[i] / step for i in (0, 1) for step in region.sample_time}
    whole = round(max(delays))
    if region.modes or region.current_lag[1] or max(abs(d - whole) for d in delays) > close:
        return None
    return whole
