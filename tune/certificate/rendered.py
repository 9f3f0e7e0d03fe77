"""Rendered mass and damping, and perceived steps, recomputed from the law in ball arithmetic."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from flint import arb_poly

from tune.certificate.affine import ComplexArray, FloatArray
from tune.certificate.point import Setting
from tune.certificate.polynomial import law_of, shift_to_one
from tune.certificate.precision import precision
from tune.documents.profile import Design, ElementProfile, PerceptionProfile

#: Hz, between which people move; means are over the logarithm.
_SLOWEST, _FASTEST = 0.5, 5.0
#: Points of Simpson's rule between them, an odd number.
_POINTS = 2001
#: A stated number may differ from the recomputed one by this part: it is printed with four digits.
_AGREE = 1e-3
#: A device without damping is given this part of its mass over a second to compare with.
_FOOT = 0.01
#: Less felt of an effect than this part of it counts as this.
_BARELY = 1e-3

#: m and rad at which a stiffness is compared with what friction masks.
_DEPTH = {"linear": 0.01, "rotary": 0.1}

_EFFECTS = ("stiffness", "damping", "mass")


def rendering_failures(design: Design, name: str, setting: Setting) -> list[str]:
    """What an element claims to make felt and how many steps, against the same computed anew."""
    element = design.elements[name]
    impedance = {effect: _impedance(design, _alone(setting, effect)) for effect in _EFFECTS}
    return [
        f"{name}: {claim} says {said:.4g}, computed anew it is {seen:.4g}"
        for claim, said, seen, size in (
            *_rendered(element, impedance),
            *_steps(design, element, impedance),
        )
        if not abs(seen - said) <= _AGREE * size
    ] + excess_over_request(design, name, setting)


def excess_over_request(design: Design, name: str, setting: Setting) -> list[str]:
    """Mass and damping that are felt as more than a step from what an element asks for.

    A wall asks for nothing to move in.
    """
    element, table = design.elements[name], design.perception
    if table is None or element.as_commanded or element.one_sided:
        return []
    impedance = {effect: _impedance(design, _alone(setting, effect)) for effect in _EFFECTS}
    moving = impedance["damping"] + impedance["mass"]
    felt = {"mass": moving.imag / _turns(), "damping": (moving + impedance["stiffness"]).real}
    failures: list[str] = []
    for effect, values in felt.items():
        own, asked = _reference(design, table, effect), float(getattr(element, effect))
        for place, frequency in ((0, _SLOWEST), (-1, _FASTEST)):
            seen = float(values[place])
            steps = _steps_between(design, element, effect, own + asked, own + seen)
            if not steps <= 1:
                failures.append(
                    f"{name}: at {frequency:g} Hz a hand feels {seen:.4g} of {effect} where "
                    f"{asked:.4g} is asked for, {steps:.3g} steps from it beside the {own:.4g} of "
                    "the device, where 1 is allowed; ask for less, or filter less, and tune again"
                )
    return failures


def _alone(setting: Setting, effect: str) -> Setting:
    nothing = {other: 0.0 for other in _EFFECTS if other != effect}
    return replace(setting, **nothing)


def _turns() -> FloatArray:
    """Angular frequencies of the motions, rad/s."""
    return 2 * np.pi * np.geomspace(_SLOWEST, _FASTEST, _POINTS)


def _mean(values: FloatArray) -> float:
    """Over the logarithm of frequency, by Simpson's rule."""
    weights = np.full(_POINTS, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    return float(weights @ values / np.sum(weights))


def _impedance(design: Design, setting: Setting) -> ComplexArray:
    """Force of the held command against a sinusoidal motion, over its velocity, N·s/m."""
    device, turn = design.device, _turns()
    step = device.sample_time.value
    with precision():
        law = law_of(setting, step)
        top = law.numerator * arb_poly([-1, 1]) if law.vanishes else law.numerator
        numerator, denominator = shift_to_one(top), shift_to_one(law.denominator)
    if not numerator.size:
        return np.zeros(_POINTS, dtype=np.complex128)
    away = np.expm1(1j * turn * step)
    command = np.polyval(numerator, away) / np.polyval(denominator, away)
    held = -np.expm1(-1j * turn * step) / (1j * turn * step)
    lag = 0.0 if device.current_lag is None else device.current_lag.value
    late = np.exp(-1j * turn * device.delay.value) / (1 + 1j * turn * lag)
    return command * held * late / (1j * turn)


def _rendered(
    element: ElementProfile, impedance: dict[str, ComplexArray]
) -> Iterator[tuple[str, float, float, float]]:
    """(claim, as stated, as computed, what a difference is small against) of mass and damping."""
    said = element.rendered
    if said is None:
        return
    moving = impedance["damping"] + impedance["mass"]
    for claim, mean, ends, values in (
        ("mass", said.mass, said.mass_at_ends, moving.imag / _turns()),
        ("damping", said.damping, said.damping_at_ends, (moving + impedance["stiffness"]).real),
    ):
        size = float(np.max(np.abs(values)))
        yield f"rendered.{claim}", mean, _mean(values), size
        for end, place in zip(ends, (0, -1), strict=True):
            yield f"rendered.{claim}_at_ends", end, float(values[place]), size


def _steps(
    design: Design, element: ElementProfile, impedance: dict[str, ComplexArray]
) -> Iterator[tuple[str, float, float, float]]:
    """Claims of perceived steps; nothing where the profile does not say how fine hands are."""
    table = design.perception
    if table is None:
        return
    for effect, said in element.perceived_steps.items():
        reference = _reference(design, table, effect)
        felt = {
            "stiffness": element.stiffness,
            "damping": _mean(impedance["damping"].real),
            "mass": _mean(impedance["mass"].imag / _turns()),
        }[effect]
        commanded: float = getattr(element, effect)
        least = _BARELY * commanded
        felt = least if commanded == 0 or felt / commanded < _BARELY else felt
        seen = _steps_between(design, element, effect, reference, reference + felt)
        yield f"perceived_steps.{effect}", said, seen, abs(said)


def _steps_between(
    design: Design, element: ElementProfile, effect: str, first: float, second: float
) -> float:
    """Steps from one total of an effect, with the device's own, to another."""
    return abs(_height(design, element, effect, second) - _height(design, element, effect, first))


def _height(design: Design, element: ElementProfile, effect: str, total: float) -> float:
    """Steps above nothing: one for each force just noticed, then one for each Weber fraction."""
    table = design.perception
    assert table is not None
    reach = {
        "stiffness": _DEPTH[design.device.motion],
        "damping": element.motion.speed,
        "mass": element.motion.acceleration,
    }[effect]
    noticed, fold = table.threshold / reach, float(np.log1p(getattr(table, effect)))
    if total * fold <= noticed:
        return total / noticed
    return (1 + float(np.log(total * fold / noticed))) / fold


def _reference(design: Design, table: PerceptionProfile, effect: str) -> float:
    """What an effect is compared with: the stiffness that friction masks, b or m."""
    device = design.device
    masked = max(device.coulomb_friction.value, table.threshold)
    return {
        "stiffness": masked / _DEPTH[device.motion],
        "damping": max(device.damping.value, _FOOT * device.mass.value),
        "mass": device.mass.value,
    }[effect]
