"""One element in numbers: the part of each limit that it uses, its answers to step and impact."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.perception import Scale
from tune.documents.profile import Design, ElementProfile
from tune.loop.loop import filters_of
from tune.loop.state_space import Corner, SampledLoop, corners_of, exponential

FloatArray = NDArray[np.float64]

#: Of several limits of one kind those bind that are used as much as the most used, nearly.
_NEARLY = 0.98
#: Samples followed, at least and at most; half periods or time constants that are looked at.
_FEWEST, _MOST, _PERIODS = 50, 3000, 5.0
#: Corners of the box that are followed beside the best estimate.
_CORNERS = 8


@dataclass(frozen=True, slots=True)
class Use:
    """A limit, the part of it that is used (1: used up), words for it, effects that it binds."""

    limit: str
    part: float
    words: str
    binds: tuple[str, ...]


#: (limit, reason as profiles name it, part, words) of a limit.
_Found = Iterator[tuple[str, str, float, str]]


def uses_of(design: Design, name: str, units: dict[str, str]) -> tuple[Use, ...]:
    """Every limit of an element that has a number, in the order of the profile's margins."""
    element = design.elements[name]
    bound: dict[str, tuple[str, ...]] = {}
    for effect, reason in element.limited_by.items():
        bound[reason] = (*bound.get(reason, ()), effect)
    found = (
        *_margins(design, element),
        *_forces(design, name, units["force"]),
        *_felt(design, element),
    )
    most = {why: max(part for _, other, part, _ in found if other == why) for _, why, _, _ in found}
    return tuple(
        Use(limit, part, words, bound.get(why, ()) if part >= _NEARLY * most[why] else ())
        for limit, why, part, words in found
    )


def _margins(design: Design, element: ElementProfile) -> _Found:
    margin, own = design.margin, element.margins
    if own.gain > 0:
        part = margin.gain / own.gain
        yield "gain margin", "gain-margin", part, f"{margin.gain:g} of {own.gain:.3g}"
    if margin.extra_delay_samples and own.extra_delay_samples > 0:
        wanted, most = margin.extra_delay_samples, own.extra_delay_samples
        yield "extra delay", "delay-margin", wanted / most, f"{wanted:g} of {most:g} T"
    if own.absolute_gain:
        part = margin.gain / own.absolute_gain
        words = f"{margin.gain:g} of {own.absolute_gain:.3g}"
        yield "proof of its clamp", "saturation", part, words
    if element.lead and element.contact and element.contact.lead and element.damping:
        part = element.contact.lead / element.lead
        yield "met before its face", "lead", part, f"{part:.3g} of what it may be"


def _sustained(element: ElementProfile) -> float:
    """Force of the spring at the depth it must last to, N."""
    return element.stiffness * (element.motion.penetration or 0.0)


def _in_motion(element: ElementProfile) -> float:
    """Force of the whole element in its motion, N."""
    motion = element.motion
    damping = 0.0 if element.one_sided and element.cut else abs(element.damping)
    return _sustained(element) + damping * motion.speed + abs(element.mass) * motion.acceleration


def _forces(design: Design, name: str, unit: str) -> _Found:
    """Forces of the element, and of the moment with it whose forces are the largest."""
    limit, element = design.device.force_limit, design.elements[name]
    for what, force_of, most in (
        ("sustained force", _sustained, limit.continuous if limit else 0.0),
        ("force in motion", _in_motion, limit.peak if limit else 0.0),
    ):
        own = force_of(element)
        if most <= 0 or (what == "sustained force" and not own):
            continue
        forces = {
            moment: sum(force_of(design.elements[each]) for each in moment)
            for moment in design.moments()
            if name in moment
        }
        worst, total = max(forces.items(), key=lambda item: (item[1], -len(item[0])))
        beside = [each for each in worst if each != name]
        words = f"{own:.3g} of {most:.4g} {unit}"
        words += f", {total:.3g} with {' and '.join(beside)}" if beside else ""
        yield what, "force", total / most, words
    if element.ripple is not None:
        words = f"{element.ripple:.2g} of {design.ripple_limit:g} {unit}"
        yield "encoder ripple", "ripple", element.ripple / design.ripple_limit, words


def _felt(design: Design, element: ElementProfile) -> _Found:
    """Perceived steps from what is asked for to what is felt at 0.5 and 5 Hz; one is allowed."""
    felt, table, motion = element.rendered, design.perception, element.motion
    if felt is None or table is None or element.one_sided:
        return
    for effect, ends, weber, reach in (
        ("mass", felt.mass_at_ends, table.mass, motion.acceleration),
        ("damping", felt.damping_at_ends, table.damping, motion.speed),
    ):
        asked: float = getattr(element, effect)
        total: float = getattr(design.device, effect).value + asked
        scale = Scale(reference=total, weber=weber, floor=table.threshold / reach)
        steps = max(scale.steps(end - asked) for end in ends)
        yield f"{effect} as felt", "rendering", steps, f"off by {steps:.2g} of 1 step"


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Handle, rigid mass and force of the law inside of an element, SI, shape (devices, samples).

    Time has shape (samples,). The first device is the best estimate, the others are corners of its
    box. The sampled loop is followed with its delay and filters; the law is cut at the peak force,
    and a one-sided element only pushes. Friction, quantisation and hands are left out.
    """

    time: FloatArray
    position: FloatArray
    speed: FloatArray
    force: FloatArray


def step_response(design: Design, element: ElementProfile, force: float) -> Response:
    """Motion from rest under a constant force, N, where the encoder reads; the law is two-sided."""
    return _followed(design, element, pushed=force, speed=0.0, one_sided=False)


def impact_response(design: Design, element: ElementProfile) -> Response:
    """Motion of a free device that enters the element at the speed of its motion."""
    one_sided = element.one_sided and not element.fades
    return _followed(design, element, pushed=0.0, speed=element.motion.speed, one_sided=one_sided)


def _followed(
    design: Design, element: ElementProfile, *, pushed: float, speed: float, one_sided: bool
) -> Response:
    filters, device, sample_time = filters_of(design.loop), design.device, design.loop.sample_time
    values = (element.stiffness, element.damping, element.mass)
    limit = element.force_level or math.inf
    count = _samples(design, element)

    def follow(place: Corner) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and force of one device from sample to sample."""
        loop = SampledLoop.of(place, filters, values)
        plant, free, command = loop.plant, loop.free, loop.command
        # The law enters in one place: what acts differs from what is free by column times command.
        column = (loop.pushed - free) @ command / (command @ command)
        outside = _outside(loop, place) * pushed
        state = np.zeros(len(loop.read))
        state[plant.speed] = speed
        if speed:
            # An element with a spring is entered where its law passes zero.
            before = element.damping / element.stiffness if element.stiffness else 0.0
            state[0] = -speed * before
            step = speed * place.sample_time
            state[loop.remembered] = loop.moving(loop.read @ state[:, None], step)[:, 0]
        rows = np.empty((count, 3))
        for row in range(count):
            force = float(np.clip(command @ state, -limit, limit))
            position = float(loop.read @ state)
            if one_sided:
                force = min(force, 0.0)
            rows[row] = position, state[plant.speed], force
            state = free @ state + column * force + outside
        return rows[:, 0], rows[:, 1], rows[:, 2]

    best = Corner(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=sample_time,
        delay=design.loop.extra_delay_samples * sample_time,
        position_stiffness=device.slope_at_zero,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            (each.frequency_hz.value, each.damping_ratio.value, each.at_encoder)
            for each in device.modes
        ),
    )
    box = corners_of(device, device.simultaneous_box())
    places = [best, *box[:: max(1, len(box) // _CORNERS)][:_CORNERS]]
    position, rate, force = (np.stack(each) for each in zip(*map(follow, places), strict=True))
    time = np.arange(count, dtype=np.float64) * sample_time
    return Response(time=time, position=position, speed=rate, force=force)


def _samples(design: Design, element: ElementProfile) -> int:
    """Samples in which what the element does can be seen."""
    mass = max(design.device.mass.value + element.mass, 0.1 * design.device.mass.value)
    loss = max(design.device.damping.value + element.damping, 1e-3 * mass)
    span = mass / loss
    if element.stiffness > 0:
        span = math.pi * math.sqrt(mass / element.stiffness)
    return int(np.clip(_PERIODS * span / design.loop.sample_time, _FEWEST, _MOST))


def _outside(loop: SampledLoop, place: Corner) -> FloatArray:
    """What a constant force of 1 N where the encoder reads adds to the state in a sample."""
    plant = loop.plant
    size = len(plant.drive)
    drive = np.zeros(size)
    drive[plant.speed : 2 * plant.speed] = plant.read[: plant.speed] / place.mass
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = plant.motion, drive
    added = np.zeros(len(loop.read))
    added[:size] = exponential(augmented * place.sample_time)[:size, size]
    return added
