"""Logs of devices drawn from the whole range of numbers, and whether answers are true."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification import (
    Device,
    ForceLimit,
    Hardware,
    IdentificationError,
    Trajectory,
    identify,
    quantity,
)
from tests.stress_tuning import Outcome

FloatArray = NDArray[np.float64]

#: An interval of 95 % may miss; by so many half-widths, or by less than so much of the value, it
#: may not.
_FAR, _CLOSE = 4.0, 0.02
#: Under a change of units, sign or origin an estimate stays within this part of its half-width.
_SAME = 0.1


#: Devices are drawn far beyond what hands hold.
ALLOWED = ("force-unit",)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _positions(force: FloatArray, mass: float, damping: float, step: float) -> FloatArray:
    """Exact positions of mass and damping under a held force from rest, in extended precision."""
    long = np.longdouble
    m, b, T = long(mass), long(damping), long(step)
    x = b * T / m
    decay = np.exp(-x)
    # (1 - e^-x)/x and (x - 1 + e^-x)/x², by series where they would cancel.
    small = x < long(1e-3)
    first = 1 - x / 2 + x**2 / 6 - x**3 / 24 if small else -np.expm1(-x) / x
    second = long(0.5) - x / 6 + x**2 / 24 - x**3 / 120 if small else (1 - first) / x
    speed = np.zeros(force.size, dtype=long)
    for k in range(1, force.size):
        speed[k] = decay * speed[k - 1] + T / m * first * long(force[k - 1])
    moved = T * first * speed + T * T / m * second * force.astype(long)
    return np.concatenate(([long(0)], np.cumsum(moved)[:-1])).astype(np.float64)


def drawn(seed: int) -> tuple[Trajectory, Hardware, float, float]:
    """A log, what is stated of its device, and its true mass and damping."""
    rng = np.random.default_rng([19, seed])
    mass = _between(rng, 1e-6, 1e6)
    damping = 0.0 if rng.uniform() < 0.05 else _between(rng, 1e-6, 1e6)
    # Half of the draws have rates that a log can show; the others are whatever they are.
    sensible = rng.uniform() < 0.7
    step = _between(rng, 1e-6, 0.1)
    if sensible:
        damping = mass / step * _between(rng, 1e-4, 0.1)
    samples = round(_between(rng, 200, 1e5 if seed % 10 == 0 else 8e3))
    time = np.float64(step) * np.arange(samples)
    lines = np.unique(np.round(np.exp(rng.uniform(0, np.log(samples / 12), 8))))
    sizes = rng.uniform(0.3, 1, lines.size)
    phases = rng.uniform(0, 2 * np.pi, lines.size)
    angles = 2 * np.pi * lines * (np.arange(samples)[:, None] / samples) + phases
    peak = _between(rng, 1e-3, 1e4)
    force = np.cos(angles) @ sizes
    force = peak * (force - force.mean()) / np.max(np.abs(force))
    delay = int(rng.integers(0, 4))
    late = np.concatenate((np.zeros(delay), force))[:samples]
    place = _positions(late, mass, damping, step)
    travel = float(np.ptp(place)) or 1.0
    noise = travel * _between(rng, 1e-8, 1e-2)
    encoder = _between(rng, 1e-12, 1e-2)
    if sensible:
        encoder = travel * _between(rng, 1e-7, 1e-3)
        noise = encoder * _between(rng, 1e-2, 3.0)
    place = place + noise * rng.standard_normal(samples)
    place = encoder * np.round(place / encoder)
    log = Trajectory(time=time, force=force, position=place, motion="linear")
    hardware = Hardware(
        name="drawn",
        motion="linear",
        sample_time=quantity(step),
        delay=quantity(delay * step) if rng.uniform() < 0.7 else None,
        encoder_resolution=quantity(encoder),
        force_limit=ForceLimit(continuous=1.1 * peak, peak=1.2 * peak),
    )
    return log, hardware, mass, damping


def identified(seed: int) -> Outcome:
    """Identify one draw; compare with the truth, and with its turned, moved and rescaled log."""
    try:
        log, hardware, mass, damping = drawn(seed)
        found = identify(log, hardware=hardware, allow=ALLOWED).device
    except IdentificationError as refusal:
        return Outcome(kind="refused", words=str(refusal)[:120])
    wrong = [*_untrue(found, mass, damping)]
    if seed % 4 == 0:
        wrong += _changed(log, hardware, found)
    return Outcome(kind="wrong" if wrong else "answered", words="; ".join(wrong)[:400])


def _untrue(found: Device, mass: float, damping: float) -> Iterator[str]:
    for name, value, truth in (("mass", found.mass, mass), ("damping", found.damping, damping)):
        if not all(map(math.isfinite, (value.value, value.low, value.high))):
            yield f"{name} {value.value} ({value.low} to {value.high})"
            continue
        side = value.value - value.low if truth < value.value else value.high - value.value
        missed = abs(value.value - truth)
        if missed > _FAR * side and missed > _CLOSE * truth:
            interval = f"{value.low:.5g} to {value.high:.5g}"
            yield f"{name} {value.value:.5g} ({interval}), true {truth:.5g}"


def _changed(log: Trajectory, hardware: Hardware, found: Device) -> Iterator[str]:
    """Signs of force and place, origin of place, units of force."""
    unit = 2.0**10 if found.mass.value < 1 else 2.0**-10
    limit = hardware.force_limit
    assert limit is not None
    stronger = hardware.model_copy(
        update={
            "force_limit": ForceLimit(continuous=limit.continuous * unit, peak=limit.peak * unit)
        }
    )
    middle = float(np.median(log.position))
    turned = replace(log, force=-log.force, position=-log.position)
    moved = replace(log, position=log.position + 2.0 ** math.ceil(math.log2(abs(middle) + 1e-300)))
    scaled = replace(log, force=log.force * unit)
    for words, other, stated, factor in (
        ("sign", turned, hardware, 1.0),
        ("origin", moved, hardware, 1.0),
        ("unit of force", scaled, stronger, unit),
    ):
        try:
            again = identify(other, hardware=stated, allow=ALLOWED).device
        except IdentificationError as refusal:
            yield f"refused after a change of {words}: {str(refusal)[:80]}"
            continue
        for name in ("mass", "damping"):
            before, after = getattr(found, name), getattr(again, name)
            width = before.high - before.low
            if abs(after.value / factor - before.value) > _SAME * width:
                became = after.value / factor
                yield f"{name} {before.value:.6g} becomes {became:.6g} with the {words}"
