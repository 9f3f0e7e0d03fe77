"""Devices and scenes drawn from the whole range of numbers, judged by roots in 360 digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from identification import Device, ForceLimit, IdentificationError, as_stored, quantity
from tests.reference import crossings, reference_loop, stable_by_jury
from tune import optimise
from tune.documents import CheckFailedError, TuneError
from tune.documents.profile import SafeProfile
from tune.documents.scene import MARGINS, Effects, Scene
from tune.loop.loop import Loop
from tune.stability.verdict import largest, verdict

#: Nearer to a boundary than this, relatively, a gain may be called either way.
_NEAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one draw.

    Attributes:
        kind: answered, refused, unproved or wrong.
        words: why, or what is wrong.
    """

    kind: str
    words: str


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def device_of(rng: np.random.Generator) -> Device:
    """m 1e-6 to 1e6, b 0 to 1e6, T 1e-6 to 0.1, encoder 1e-12 to 1e-2."""
    mass = _between(rng, 1e-6, 1e6)
    damping = 0.0 if rng.uniform() < 0.1 else _between(rng, 1e-6, 1e6)
    step = _between(rng, 1e-6, 0.1)
    width = float(rng.choice([0.0, 1e-3, 0.1, 0.3]))
    peak = _between(rng, 1e-3, 1e4)
    return Device(
        name="drawn",
        motion="linear" if rng.uniform() < 0.7 else "rotary",
        sample_time=quantity(step),
        delay=quantity(float(rng.integers(0, 4)) * step),
        encoder_resolution=quantity(_between(rng, 1e-12, 1e-2)),
        force_limit=ForceLimit(continuous=peak / 2, peak=peak),
        mass=quantity(mass, mass * (1 - width), mass * (1 + width)),
        damping=quantity(damping, damping * (1 - width), damping * (1 + width)),
        coulomb_friction=quantity(0.0 if rng.uniform() < 0.5 else _between(rng, 1e-6, peak)),
    )


def scene_of(rng: np.random.Generator, device: Device) -> Scene:
    """One to three elements of one to three effects; filters given, none or free."""
    step = device.sample_time.value
    wishes: dict[str, Any] = {"stiffness": "max", "damping": "max", "mass": "max"}
    elements: dict[str, Any] = {}
    for number in range(int(rng.choice([1, 1, 1, 2, 3]))):
        chosen = [name for name in wishes if rng.uniform() < 0.45]
        chosen = chosen or [str(rng.choice(list(wishes)))]
        elements[f"thing{number}"] = {name: wishes[name] for name in chosen}
    kind = rng.uniform()
    cut_offs: list[float | str] = ["none", "none"]
    if kind < 0.15:
        cut_offs = ["free", "free"]
    elif kind < 0.75:
        cut_offs = [_between(rng, 1e-3, 0.3) / step for _ in range(2)]
    return Scene.model_validate(
        {
            "elements": elements,
            "margin": str(rng.choice(list(MARGINS))),
            "loop": dict(
                zip(("velocity_filter_hz", "acceleration_filter_hz"), cut_offs, strict=True)
            ),
        }
    )


def tuned(seed: int) -> Outcome:
    """Tune one draw; judge the profile by exact roots at the corners of its box."""
    rng = np.random.default_rng([17, seed])
    device = device_of(rng)
    scene = scene_of(rng, device)
    try:
        profile = optimise(device, scene)
    except CheckFailedError as refusal:
        return Outcome(kind="unproved", words=str(refusal)[:200])
    except (TuneError, IdentificationError) as refusal:
        return Outcome(kind="refused", words=str(refusal)[:200])
    wrong = [*_not_finite(profile), *_unstable(as_stored(device), scene, profile)]
    return Outcome(kind="wrong" if wrong else "answered", words="; ".join(wrong)[:400])


def _not_finite(profile: SafeProfile) -> Iterator[str]:
    def walk(value: object, path: str) -> Iterator[str]:
        if isinstance(value, dict):
            for key, inner in value.items():
                yield from walk(inner, f"{path}.{key}")
        elif isinstance(value, list | tuple):
            for index, inner in enumerate(value):
                yield from walk(inner, f"{path}[{index}]")
        elif isinstance(value, float) and math.isnan(value):
            yield f"{path} is nan"

    yield from walk(profile.model_dump(), "profile")


def _unstable(device: Device, scene: Scene, profile: SafeProfile) -> Iterator[str]:
    margin = MARGINS[scene.margin]
    step = device.sample_time.value
    delay = round(device.delay.value / step) if device.delay is not None else 0
    loop = profile.loop
    poles = [
        0.0 if hertz is None else math.exp(-2 * math.pi * hertz * step)
        for hertz in (loop.velocity_filter_hz, loop.acceleration_filter_hz)
    ]
    for name, element in profile.elements.items():
        for mass in {device.mass.low, device.mass.high}:
            for damping in {device.damping.low, device.damping.high}:
                for extra in (0, margin.extra_delay_samples):
                    reference = reference_loop(
                        damping * step / mass,
                        element.stiffness * step**2 / mass,
                        element.damping * step / mass,
                        element.mass / mass,
                        delay=delay + extra,
                        velocity_pole=poles[0],
                        acceleration_pole=poles[1],
                    )
                    if element.stiffness == element.damping == element.mass == 0:
                        continue
                    first = min((float(g.mid()) for g in crossings(reference)), default=math.inf)
                    if first < margin.gain * (1 - _NEAR):
                        yield f"{name} with m {mass:.3g}, b {damping:.3g} crosses at {first:.6g}"
                    elif not stable_by_jury(reference.at(reference_gain(margin.gain))):
                        yield f"{name} with m {mass:.3g}, b {damping:.3g} is unstable"


def reference_gain(gain: float) -> Any:
    """A gain just inside, where an answer on the boundary is still right."""
    from flint import arb

    return arb(gain) * (1 - arb(2) * _NEAR)


def judged(seed: int) -> Outcome:
    """Verdict and largest effect of a draw beside exact roots, and under changes of units."""
    rng = np.random.default_rng([18, seed])
    device = device_of(rng)
    mass, damping = device.mass.value, device.damping.value
    step = device.sample_time.value
    delta = damping * step / mass
    delay = int(rng.integers(0, 3))
    loop = Loop.from_numbers(mass=mass, damping=damping, sample_time=step, delay_samples=delay)
    name = ("stiffness", "damping", "mass")[int(rng.integers(3))]
    unit = {"stiffness": mass / step**2, "damping": mass / step, "mass": mass}[name]
    limit = float(largest(loop, name))  # pyright: ignore[reportArgumentType]
    places = {"stiffness": (1.0, 0.0, 0.0), "damping": (0.0, 1.0, 0.0), "mass": (0.0, 0.0, 1.0)}
    exact = crossings(reference_loop(delta, *places[name], delay=delay))
    first = min((float(gain.mid()) for gain in exact), default=math.inf)
    wrong: list[str] = []
    # An undamped device is marginal under a spring: no gain above zero is stable.
    undamped = damping == 0
    if not undamped and not math.isclose(limit / unit, first, rel_tol=1e-9):
        wrong.append(f"largest {name} {limit / unit:.12g}, exact {first:.12g} (δ {delta:.3g})")
    if undamped and name == "stiffness" and limit > 0:
        wrong.append(f"largest stiffness of an undamped device is {limit:g}")
    wrong += _changed_units(loop, mass, damping, step, delay, name, limit)
    ray = np.exp(rng.uniform(-12, 4, 3)) * rng.choice([-0.3, 1, 1], 3)
    effects = Effects(
        stiffness=abs(ray[0]) * mass / step**2, damping=ray[1] * mass / step, mass=ray[2] * mass
    )
    said = int(verdict(loop, effects))
    truth = _stable(delta, (abs(ray[0]), ray[1], ray[2]), delay)
    if truth is not None and said not in (0, 1 if truth else -1):
        wrong.append(f"verdict {said}, exact {truth} at δ {delta:.3g}, {ray}, delay {delay}")
    return Outcome(
        kind="wrong" if wrong else "answered" if said else "undecided", words="; ".join(wrong)
    )


def _stable(delta: float, ray: tuple[float, float, float], delay: int) -> bool | None:
    from flint import arb

    try:
        answers = {
            stable_by_jury(reference_loop(delta, *ray, delay=delay).at(1 + arb(side) * _NEAR))
            for side in (-1, 0, 1)
        }
    except ArithmeticError:
        return None
    return answers.pop() if len(answers) == 1 else None


def _changed_units(
    loop: Loop, mass: float, damping: float, step: float, delay: int, name: Any, limit: float
) -> Iterator[str]:
    """Force in other units scales all effects; time in others K by the square, B by the unit."""
    del loop
    for factor in (1024.0, 2.0**-20):
        heavier = Loop.from_numbers(
            mass=mass * factor, damping=damping * factor, sample_time=step, delay_samples=delay
        )
        if not math.isclose(float(largest(heavier, name)), limit * factor, rel_tol=1e-12):
            yield f"largest {name} changes with the unit of force"
        faster = Loop.from_numbers(
            mass=mass, damping=damping * factor, sample_time=step / factor, delay_samples=delay
        )
        scale = {"stiffness": factor**2, "damping": factor, "mass": 1.0}[name]
        if not math.isclose(float(largest(faster, name)), limit * scale, rel_tol=1e-12):
            yield f"largest {name} changes with the unit of time"
