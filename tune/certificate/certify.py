"""Certify a design over the corners of its box, every delay, every gain and every moment."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version
from itertools import product
from typing import Literal

import numpy as np

from tune.certificate.boxes import Cell, no_crossing
from tune.certificate.passivity import passive
from tune.certificate.polynomial import Point, Setting
from tune.certificate.ripple import ripple_by_integration
from tune.certificate.roots import judge
from tune.errors import CheckFailedError
from tune.profile import Certificate, Design, ElementProfile, WorstPoint

#: A claimed number may differ from the recomputed one by this much, relative: both are printed.
_AGREE = 1e-3
#: Cells of the box looked at for one moment and delay before its interior is left unproved; a
#: setting with a fifth of margin to spare takes one or two, one on the edge takes thousands.
_MOST_CELLS = 64

#: Samples of delay, margins included, that are looked at one by one.
_LONGEST_DELAY = 64

ASSUMES = (
    "constant sample time within its interval; a missed deadline counts as one extra sample",
    "a linear loop: forces stay below the limit, the force of saturation is not relied on",
    "elements and gains change slowly against the loop; switching is not part of the proof",
    "the controller runs the very filters named, reset on contact",
    "no hand: the device alone",
    "Coulomb friction gives no damping",
)
CORNERS_ONLY = (
    "the interior of the box where certificate.interior says corners-only: every corner is "
    "certified, not every point between them"
)
POSITION_FORCE = (
    "the device's own force that depends on position (position_stiffness, gravity): the certified "
    "loop has none"
)
NOT_ASSESSED = (
    "a hand on the device",
    "vibration modes of the mechanism and lag of the current loop",
    "fractions of a sample of delay: every whole sample of the range is certified",
    "bounce on a one-sided wall, and sustained oscillation from quantiser and friction",
)


def certify(design: Design) -> Certificate:
    """Re-check a design by roots in ball arithmetic.

    Raises:
        CheckFailedError: with every failure, each naming elements, point and reason.
    """
    failures: list[str] = []
    box = design.device.simultaneous_box()
    corners = list(dict.fromkeys(product(box.mass, box.damping, box.sample_time)))
    first = int(np.floor(box.delay[0] / box.sample_time[1] + 1e-6))
    last = int(np.ceil(box.delay[1] / box.sample_time[0] - 1e-6))
    margin = design.margin
    extras = [element.margins.extra_delay_samples for element in design.elements.values()]
    longest = last + max(margin.extra_delay_samples, *extras, 0)
    if longest > _LONGEST_DELAY:
        raise CheckFailedError(
            (f"delays up to {longest:.6g} samples are claimed, at most {_LONGEST_DELAY} judged",)
        )
    worst: WorstPoint | None = None
    points = 0
    cell = Cell(mass=box.mass, damping=box.damping, sample_time=box.sample_time)
    interior: dict[str, Literal["proved", "corners-only"]] = {}
    for moment in design.moments():
        setting = setting_of(design, moment)
        if setting is None:
            continue
        failures += _force_failures(design, moment)
        for delays, gain, what in _claims(design, moment, first, last):
            for (mass, damping, step), delay in product(corners, delays):
                point = Point(mass=mass, damping=damping, sample_time=step, delay_samples=delay)
                verdict = judge(point, setting, gain)
                points += 1
                if verdict.answer != "stable":
                    failures.append(
                        f"{' + '.join(moment)}: {what}: {verdict.answer} at mass {mass:.6g}, "
                        f"damping {damping:.6g}, sample time {step:.6g} s, delay {delay} "
                        f"samples, gain {gain:.6g}: {verdict.reason}"
                    )
                elif what == "margin" and (worst is None or verdict.radius > worst.pole_radius):
                    worst = WorstPoint(
                        elements=moment,
                        mass=mass,
                        damping=damping,
                        sample_time=step,
                        delay_samples=delay,
                        gain=gain,
                        pole_radius=verdict.radius,
                    )
        delays = range(first, last + margin.extra_delay_samples + 1)
        proved = all(no_crossing(cell, setting, d, margin.gain, _MOST_CELLS) for d in delays)
        interior[" + ".join(moment)] = "proved" if proved else "corners-only"
        failures += _ripple_failures(design, moment, setting, last)
        failures += _passivity_failures(design, moment, setting, last)
    if failures:
        raise CheckFailedError(tuple(failures))
    if worst is None:
        raise CheckFailedError(("the profile plays no effect at all",))
    return Certificate(
        method="poles and unit-circle crossings isolated in 400-bit ball arithmetic at each "
        "corner; crossings between the corners excluded by interval arithmetic",
        confidence=0.999,
        mass=box.mass,
        damping=box.damping,
        sample_time=box.sample_time,
        delay_samples=(first, last),
        gain=margin.gain,
        extra_delay_samples=margin.extra_delay_samples,
        points=points,
        interior=interior,
        worst=worst,
        assumes=ASSUMES,
        not_assessed=(
            *((CORNERS_ONLY,) if "corners-only" in interior.values() else ()),
            *((POSITION_FORCE,) if _pushed_by_place(design) else ()),
            *NOT_ASSESSED,
        ),
        versions={name: version(name) for name in ("haptune", "numpy", "python-flint")},
    )


def _pushed_by_place(design: Design) -> bool:
    return design.device.position_stiffness is not None or design.device.gravity is not None


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
        velocity_filter_hz=design.loop.velocity_filter_hz,
        acceleration_filter_hz=design.loop.acceleration_filter_hz,
    )


def _claims(
    design: Design, moment: tuple[str, ...], first: int, last: int
) -> Iterator[tuple[range, float, str]]:
    """(delays, gain, words) of the margin kept and of what the elements claim beyond it."""
    margin = design.margin
    yield range(first, last + margin.extra_delay_samples + 1), margin.gain, "margin"
    claims = [design.elements[name].margins for name in moment]
    # A single element claims for every moment it is in; its strongest claim covers the others.
    yield range(first, last + 1), max(claim.gain for claim in claims), "claimed gain margin"
    delay = max(int(claim.extra_delay_samples) for claim in claims)
    yield range(last + 1, last + delay + 1), 1.0, "claimed delay margin"


def _force_failures(design: Design, moment: tuple[str, ...]) -> list[str]:
    limit = design.device.force_limit
    if limit is None:
        return []
    chosen = [design.elements[name] for name in moment]
    sustained = sum(item.stiffness * item.motion.penetration for item in chosen)
    peak = sustained + sum(
        abs(item.damping) * item.motion.speed + abs(item.mass) * item.motion.acceleration
        for item in chosen
    )
    return [
        f"{' + '.join(moment)}: {words} force {seen:.6g} exceeds the limit {most:.6g}"
        for words, seen, most in (
            ("sustained", sustained, limit.continuous),
            ("peak", peak, limit.peak),
        )
        if seen > most * (1 + 1e-9)
    ]


def _ripple_failures(
    design: Design, moment: tuple[str, ...], setting: Setting, delay: int
) -> list[str]:
    resolution = design.device.encoder_resolution
    if resolution is None:
        return []
    point = Point(
        mass=design.device.mass.value,
        damping=design.device.damping.value,
        sample_time=design.device.sample_time.value,
        delay_samples=delay,
    )
    seen = ripple_by_integration(point, setting, resolution.value)
    where = " + ".join(moment)
    failures: list[str] = []
    if not seen <= design.ripple_limit * (1 + _AGREE):
        failures.append(f"{where}: ripple {seen:.4g} exceeds the limit {design.ripple_limit:.4g}")
    claimed = max((_ripple_of(design.elements[name]) for name in moment), default=0.0)
    if len(moment) == 1 and claimed < seen * (1 - _AGREE):
        failures.append(f"{where}: claims a ripple of {claimed:.4g}, has {seen:.4g}")
    return failures


def _passivity_failures(
    design: Design, moment: tuple[str, ...], setting: Setting, delay: int
) -> list[str]:
    claimed = [name for name in moment if design.elements[name].margins.passive is True]
    if len(moment) != 1 or not claimed:
        return []
    if delay or setting.velocity_filter_hz or setting.acceleration_filter_hz:
        return [f"{claimed[0]}: claims passivity with a delay or a filter, where it is not known"]
    box = design.device.simultaneous_box()
    if passive(setting, box.damping[0], box.sample_time[1]):
        return []
    return [f"{claimed[0]}: claims passivity, a damping of {box.damping[0]:.6g} is too little"]


def _ripple_of(element: ElementProfile) -> float:
    return element.ripple or 0.0
