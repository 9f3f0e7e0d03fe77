"""What is claimed beside stability, recomputed: forces, ripple, passivity, what is felt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from flint import arb_poly

from identification import counted
from tune.certificate.affine import ComplexArray, FloatArray
from tune.certificate.poles import law_in_doubles, law_of, precision, sampled_plant, shift_to_one
from tune.certificate.region import Point, Region, Setting, regions_of
from tune.documents.profile import Design, ElementProfile, PerceptionProfile
from tune.documents.scene import EFFECT_NAMES

#: Edges of panels on the half circle, even ones and about each pole, doubled in distance from it;
#: points of Gauss and Legendre in each. Panels are halved until two results agree.
_FEWEST, _HALVINGS, _NODES, _MOST = 65, 48, 12, 1 << 18
_CONVERGED = 1e-6
#: Frequencies looked at, evenly and in equal ratios from the slowest, as parts of π; around the
#: greatest need once more. A smooth peak is then missed by less than a part in 10⁹.
_ANGLES = 4096
_LEAST_ANGLE = 1e-5
#: A claim may fall short by this part of what is needed.
_SHORT_OF = 1e-6
#: A claimed number may differ from the recomputed one by this part: it is printed with four digits.
_AGREE = 1e-3
#: Force levels are stated with six digits.
_CUT = 1e-5
#: A delay within this part of a sample of a whole number is that number; clocks are not better.
_WHOLE = 1e-6
#: Sample times of the interval at which a claim of passivity is looked at.
_STEPS = 9
#: Hz, between which people move; means are over the logarithm.
_SLOWEST, _FASTEST = 0.5, 5.0
#: Points of Simpson's rule between them, an odd number; and on to the end of what is bound, Hz.
_POINTS, _FARTHER, _FARTHEST = 2001, 1200, 20.0
#: Mass is felt within this factor of what is commanded.
_ALIKE = 1.2
#: A device without damping is given this part of its mass over a second to compare with.
_FOOT = 0.01
#: Less felt of an effect than this part of it counts as this.
_BARELY = 1e-3
#: m and rad at which a stiffness is compared with what friction masks.
_DEPTH = {"linear": 0.01, "rotary": 0.1}


@lru_cache(maxsize=256)
def _ripple_by_integration(point: Point, setting: Setting, resolution: float) -> float:
    """Force ripple, N rms, from white noise of variance resolution²/12; inf beyond a double."""
    # Where nothing holds the position and there is no spring, plant and law share z = 1, which is
    # divided out. In powers of z - 1 polynomials do not cancel at low frequency as doubles.
    with precision():
        plant, law = sampled_plant(point), law_of(setting, point.sample_time)
        zero = arb_poly([-1, 1])
        top = law.numerator * plant.denominator
        bottom = law.denominator * plant.denominator
        fed_back = law.numerator * plant.numerator
        if plant.integrates or law.vanishes:
            top = top * zero
        if plant.integrates and not law.vanishes:
            bottom = bottom * zero
        if law.vanishes and not plant.integrates:
            fed_back = fed_back * zero
        numerator, denominator = (shift_to_one(p) for p in (top, bottom + fed_back))
    if not (np.isfinite(numerator).all() and np.isfinite(denominator).all()):
        return float("inf")
    value, edges = np.nan, _panels(denominator)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    while edges.size <= _MOST:
        half = np.diff(edges)[:, None] / 2
        away: ComplexArray = np.expm1(1j * (edges[:-1, None] + half * (1 + nodes)))
        with np.errstate(all="ignore"):
            response = np.polyval(numerator, away) / np.polyval(denominator, away)
            energy = float(np.sum(half * weights * np.abs(response) ** 2) / np.pi)
        if not np.isfinite(energy):
            return float("inf")
        previous, value = value, float(np.sqrt(energy / 12) * resolution)
        if abs(value - previous) <= _CONVERGED * value:
            break
        edges = np.sort(np.concatenate((edges, edges[:-1] + half[:, 0])))
    return value


def _panels(denominator: FloatArray) -> FloatArray:
    """Edges of panels from 0 to π that are as narrow about each pole as its peak."""
    # The denominator is in powers of z - 1, the highest first.
    # Those near z = 1 are found best as the largest of the reversed polynomial.
    inverse: ComplexArray = np.roots(denominator[::-1]).astype(np.complex128)
    with np.errstate(all="ignore"):
        poles: ComplexArray = np.log1p(1 / inverse)
        wide = np.abs(poles.real) * 2.0 ** np.arange(-1, _HALVINGS)[:, None]
        angle = np.abs(poles.imag)
    edges = np.concatenate((angle - wide, [angle], angle + wide)).ravel()
    even = np.linspace(0, np.pi, _FEWEST)
    return np.unique(np.concatenate((even, edges[(edges > 0) & (edges < np.pi)])))


def damping_for_passivity(setting: Setting, sample_time: float, delay_samples: int = 0) -> float:
    """The least damping b of a passive device, at least zero.

    b > T/2·Re{(1 - e^-jωT)·H(e^jωT)}/(1 - cos ωT) at every ω (Colgate and Schenkel); H is the law
    with its filters and with whole samples of delay within the computer; a rigid mass on a damper,
    any mass.
    """
    top, bottom, vanishes = law_in_doubles(setting, sample_time)

    def needed(angle: FloatArray) -> FloatArray:
        z = np.exp(1j * angle)
        response = np.polyval(top, z) / np.polyval(bottom, z) * z ** -float(delay_samples)
        if vanishes:
            response = response * (z - 1)
        return np.real((1 - np.conj(z)) * response) / (2 * np.sin(angle / 2) ** 2) * sample_time / 2

    angle = np.sort(
        np.pi
        * np.concatenate(
            [np.linspace(0, 1, _ANGLES + 1)[1:], np.geomspace(_LEAST_ANGLE, 1, _ANGLES)]
        )
    )
    values = needed(angle)
    at = int(np.argmax(values))
    low, high = float(angle[max(at - 1, 0)]), float(angle[min(at + 1, len(angle) - 1)])
    near: FloatArray = np.linspace(low, high, _ANGLES)
    return max(0.0, float(values[at]), float(needed(near).max()))


def force_failures(design: Design, combination: tuple[str, ...]) -> list[str]:
    """Forces of the stated motions against the limits of the device."""
    limit = design.device.force_limit
    if limit is None:
        return []
    chosen = [design.elements[name] for name in combination]
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
        for name, item in zip(combination, chosen, strict=True)
        for deep in (item.stiffness * (item.motion.penetration or 0.0),)
        if (item.force_level > 0) != bool(item.stiffness) or deep > item.force_level * (1 + _CUT)
    ]
    return wrong + [
        f"{' + '.join(combination)}: {words} force {seen:.6g} exceeds the limit {most:.6g}"
        for words, seen, most in (
            ("sustained", sustained, limit.continuous),
            ("peak", peak, limit.peak),
            ("cut", levels, limit.peak),
        )
        if seen > most * (1 + 1e-9)
    ]


def meets_wall(design: Design, combination: tuple[str, ...]) -> bool:
    """Whether a wall is met beside other elements, where ripple is told and not bound."""
    return bool(design.walls.intersection(combination)) and not design.walls.issuperset(combination)


def ripple_failures(design: Design, combination: tuple[str, ...], setting: Setting) -> list[str]:
    """Ripple of a combination against the limit, and a lone element's claim against what it has."""
    seen = ripple_of(design, setting)
    if seen is None:
        return []
    where = " + ".join(combination)
    failures: list[str] = []
    if not seen <= design.ripple_limit * (1 + _AGREE):
        failures.append(f"{where}: ripple {seen:.4g} exceeds the limit {design.ripple_limit:.4g}")
    claimed = max((design.elements[name].ripple or 0.0 for name in combination), default=0.0)
    if len(combination) == 1 and claimed < seen * (1 - _AGREE):
        failures.append(f"{where}: claims a ripple of {claimed:.4g}, has {seen:.4g}")
    return failures


def ripple_of(design: Design, setting: Setting) -> float | None:
    """Ripple at the best estimate and longest delay, with a hand or without; None if not known."""
    device = design.device
    if device.encoder_resolution is None:
        return None
    samples = device.delay.high / device.sample_time.value
    whole = round(samples)
    late = float(whole) if abs(samples - whole) <= _WHOLE else samples
    lag = 0.0 if device.current_lag is None else device.current_lag.value
    best = [device.mass.value, device.damping.value, device.sample_time.value, 0.0, lag]
    best.append(device.slope_at_zero)
    hand = [] if design.hand is None else [each.value for _, each in design.hand]
    modes = [x.value for mode in device.modes for x in (mode.frequency_hz, mode.damping_ratio)]
    points = [
        region.point(np.array([*best, *(hand if region.hand else ()), *modes]), late)
        for region in regions_of(design)
    ]
    count = device.encoder_resolution.value
    return max(_ripple_by_integration(point, setting, count) for point in points)


def passivity_failures(
    design: Design, combination: tuple[str, ...], setting: Setting, region: Region
) -> list[str]:
    """A claim of passivity, which is known for a rigid device and whole samples of delay."""
    claimed = [name for name in combination if design.elements[name].margins.passive is True]
    if len(combination) != 1 or not claimed:
        return []
    whole = whole_delay(region)
    if whole is None:
        return [
            f"{claimed[0]}: claims passivity with a mode, a lag or a part of a sample of delay, "
            "where it is not known"
        ]
    damping = region.damping[0]
    for step in np.unique(np.linspace(*region.sample_time, _STEPS)):
        needed = damping_for_passivity(setting, float(step), whole)
        if not damping > needed * (1 - _SHORT_OF):
            return [
                f"{claimed[0]}: claims passivity with a delay of {counted(whole, 'sample')}, but "
                f"a damping of {damping:.6g} is too little, {needed:.6g} is needed"
            ]
    return []


def whole_delay(region: Region, close: float = _WHOLE) -> int | None:
    """Samples of delay of a device for which passivity is known: rigid, without lag, and whole."""
    delays = {region.delay[i] / step for i in (0, 1) for step in region.sample_time}
    whole = round(max(delays))
    if region.modes or region.current_lag[1] or max(abs(d - whole) for d in delays) > close:
        return None
    return whole


def rendering_failures(design: Design, name: str, setting: Setting) -> list[str]:
    """What an element claims to make felt and how many steps, against the same computed anew."""
    element = design.elements[name]
    impedance = impedances(design, setting)
    return [
        f"{name}: {claim} says {said:.4g}, computed anew it is {seen:.4g}"
        for claim, said, seen, size in (
            *_rendered(element, impedance),
            *_steps(design, element, impedance),
        )
        if not abs(seen - said) <= _AGREE * size
    ] + excess_over_request(design, name, impedance)


def excess_over_request(design: Design, name: str, impedance: dict[str, ComplexArray]) -> list[str]:
    """Mass and damping felt as something else than what is asked for; a wall asks for nothing."""
    element, table = design.elements[name], design.perception
    if table is None or element.one_sided:
        return []
    felt, hertz = _felt(impedance), _turns() / (2 * np.pi)
    failures: list[str] = []
    asked = {"mass": element.mass, "damping": element.damping}
    slow = hertz <= _FASTEST

    def refuse(effect: str, beyond: FloatArray, needed: str) -> None:
        place = int(np.argmax(beyond))
        if not beyond[place] <= 0:
            failures.append(
                f"{name}: at {hertz[place]:.3g} Hz a hand feels {felt[effect][place]:.4g} of "
                f"{effect} where {asked[effect]:.4g} is asked for; {needed}; ask for less, or "
                "filter less, and tune again"
            )

    for effect, values in felt.items():
        own = _reference(design, table, effect)
        heights = _height(design, element, effect, own + values)
        steps = heights - _height(design, element, effect, own + asked[effect])
        apart = np.where(slow, np.abs(steps) - 1, -1.0)
        if effect == "damping":
            refuse(effect, apart, "1 step from it is allowed")
            refuse(effect, -own - values, "with the device's own it takes none away")
            # What is parasitic up to the impedance of the mass is not counted beyond the motions.
            least = np.where(slow, 0.0, abs(element.mass) * _turns())
            rest = _height(design, element, effect, own + (values - least))
            further = rest - _height(design, element, effect, own + asked[effect]) - 1
            refuse(effect, further, "1 step and the impedance of the mass are allowed")
        elif element.mass:
            share = values / element.mass
            within = np.maximum(share - _ALIKE, 1 / _ALIKE - share)
            refuse(effect, np.where(slow, within, -1.0), f"a factor of {_ALIKE:g} is allowed")
            refuse(effect, np.maximum(share - 2, -share), "from none to twice of it is allowed")
        else:
            refuse(effect, apart, "1 step from it is allowed")
    return failures


def impedances(design: Design, setting: Setting) -> dict[str, ComplexArray]:
    """That of each effect alone."""
    nothing = dict.fromkeys(EFFECT_NAMES, 0.0)
    alone = {name: {**nothing, name: getattr(setting, name)} for name in EFFECT_NAMES}
    return {name: _impedance(design, replace(setting, **each)) for name, each in alone.items()}


@cache
def _turns() -> FloatArray:
    """Angular frequencies of the motions, and beyond, rad/s."""
    motions = np.geomspace(_SLOWEST, _FASTEST, _POINTS)
    beyond = np.geomspace(_FASTEST, _FARTHEST, _FARTHER + 1)[1:]
    return 2 * np.pi * np.concatenate([motions, beyond])


def _mean(values: FloatArray) -> float:
    """Over the logarithm of frequency in motions, by Simpson's rule."""
    weights = np.full(_POINTS, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    return float(weights @ values[:_POINTS] / np.sum(weights))


def _impedance(design: Design, setting: Setting) -> ComplexArray:
    """Force of the held command against a sinusoidal motion, over its velocity, N·s/m."""
    device, turn = design.device, _turns()
    step = device.sample_time.value
    with precision():
        law = law_of(setting, step)
        top = law.numerator * arb_poly([-1, 1]) if law.vanishes else law.numerator
        numerator, denominator = shift_to_one(top), shift_to_one(law.denominator)
    if not numerator.size:
        return np.zeros(turn.size, dtype=np.complex128)
    away = np.expm1(1j * turn * step)
    command = np.polyval(numerator, away) / np.polyval(denominator, away)
    held = -np.expm1(-1j * turn * step) / (1j * turn * step)
    lag = 0.0 if device.current_lag is None else device.current_lag.value
    late = np.exp(-1j * turn * device.delay.value) / (1 + 1j * turn * lag)
    return command * held * late / (1j * turn)


def _felt(impedance: dict[str, ComplexArray]) -> dict[str, FloatArray]:
    """Mass and damping that are felt, by frequency."""
    moving = impedance["damping"] + impedance["mass"]
    return {"mass": moving.imag / _turns(), "damping": (moving + impedance["stiffness"]).real}


def _rendered(
    element: ElementProfile, impedance: dict[str, ComplexArray]
) -> Iterator[tuple[str, float, float, float]]:
    """(claim, as stated, as computed, what a difference is small against) of mass and damping."""
    said = element.rendered
    if said is None:
        return
    for claim, values in _felt(impedance).items():
        motion, beyond = values[:_POINTS], values[_POINTS - 1 :]
        size = float(np.max(np.abs(motion)))
        yield f"rendered.{claim}", getattr(said, claim), _mean(values), size
        for kind, pair in (
            ("at_ends", (motion[0], motion[-1])),
            ("in_motion", (motion.min(), motion.max())),
            ("beyond", (beyond.min(), beyond.max())),
        ):
            for one, other in zip(getattr(said, f"{claim}_{kind}"), map(float, pair), strict=True):
                least = abs(other) if kind == "beyond" else size
                yield f"rendered.{claim}_{kind}", one, other, least


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
        own, both = (_height(design, element, effect, x) for x in (reference, reference + felt))
        yield f"perceived_steps.{effect}", said, abs(float(both - own)), abs(said)


def _height(
    design: Design, element: ElementProfile, effect: str, total: FloatArray | float
) -> FloatArray:
    """Steps above nothing: one for each force just noticed, then one for each Weber fraction."""
    table = design.perception
    assert table is not None
    reach = {
        "stiffness": _DEPTH[design.device.motion],
        "damping": element.motion.speed,
        "mass": element.motion.acceleration,
    }[effect]
    noticed, fold = table.threshold / reach, float(np.log1p(getattr(table, effect)))
    part = np.asarray(total) * fold / noticed
    return np.where(part <= 1, part, 1 + np.log(np.maximum(part, 1.0))) / fold


def _reference(design: Design, table: PerceptionProfile, effect: str) -> float:
    """What an effect is compared with: the stiffness that friction masks, b or m."""
    device = design.device
    masked = max(device.coulomb_friction.value, table.threshold)
    return {
        "stiffness": masked / _DEPTH[device.motion],
        "damping": max(device.damping.value, _FOOT * device.mass.value),
        "mass": device.mass.value,
    }[effect]
