"""General loops, one known and many random, judged and compared with 360-digit arithmetic."""

from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
from flint import arb

from tests.reference import Case, ReferenceLoop, crossings, loop_along, stable_by_jury
from tune import Effects, Filters, Loop, safe_gain, stable_gains, verdict
from tune.loop.plant import HandNumbers, ModeNumbers

#: A mode, a hand and a device to begin from.
MODE = ModeNumbers(frequency_hz=80.0, damping_ratio=0.02, at_encoder=0.5, at_handle=-2.0)
HAND = HandNumbers(mass=0.1, damping=5.0, stiffness=300.0)
HOMEREHAB: dict[str, Any] = {"mass": 3.0, "damping": 10.0, "sample_time": 1e-3}

Ray = tuple[float | None, float | None, float | None]


def filters_of(case: Case) -> Filters:
    """The filters of a case by the code under test."""
    return Filters(
        velocity_filter_hz=case.velocity_filter_hz,
        velocity_filter_order=case.velocity_filter_order,  # type: ignore[arg-type]
        velocity_window_samples=case.velocity_window_samples,
        acceleration_filter_hz=case.acceleration_filter_hz,
        acceleration_filter_order=case.acceleration_filter_order,  # type: ignore[arg-type]
        filter_damping_ratio=case.filter_damping_ratio,
    )


def loop_of(case: Case) -> Loop:
    """The same loop by the code under test."""
    mass, damping, stiffness = case.hand
    return Loop.from_numbers(
        mass=case.mass,
        damping=case.damping,
        sample_time=case.sample_time,
        delay_samples=case.delay_samples,
        filters=filters_of(case),
        modes=tuple(
            ModeNumbers(frequency_hz=f, damping_ratio=z, at_encoder=e, at_handle=h)
            for f, z, e, h in case.modes
        ),
        hand=HandNumbers(mass=mass, damping=damping, stiffness=stiffness)
        if any(case.hand)
        else None,
        current_lag=case.current_lag,
    )


def draw_case(rng: np.random.Generator) -> Case:
    """0.1 to 10 ms, delay 0 to 5 samples, filters 5 Hz to Nyquist, hand, one mode, current lag."""
    T = 10 ** rng.uniform(-4, -2)

    def cutoff() -> float:
        return float(10 ** rng.uniform(np.log10(5), np.log10(0.5 / T)))

    def ratio() -> float:
        return float(rng.choice([1.0, 0.7071, rng.uniform(0.2, 1)]))

    delay = float(rng.integers(6)) if rng.random() < 0.3 else float(rng.uniform(0, 5))
    modes: tuple[tuple[float, float, float, float], ...] = ()
    if rng.random() < 0.7:
        encoder = float(rng.uniform(-1.5, 1.5))
        handle = float(rng.uniform(-1.5, 1.5))
        if rng.random() < 0.4 and abs(encoder) > 0.1:
            handle = -1 / encoder  # two bodies on a spring
        frequency = float(10 ** rng.uniform(0, np.log10(1.5 / T)))
        modes = ((frequency, float(10 ** rng.uniform(-3, 0)), encoder, handle),)
    m = float(10 ** rng.uniform(-1.5, 1.2))
    b = float(m * 10 ** rng.uniform(-2, 2)) if rng.random() < 0.95 else 0.0
    hand = (0.0, 0.0, 0.0)
    if rng.random() < 0.6:
        grip = 10 ** rng.uniform([-2.3, -0.5, 1.0], [0.3, 1.7, 3.5])
        grip[int(rng.integers(3))] *= rng.random() < 0.67  # at times one of them is missing
        if b == 0:
            grip[1] = 5.0  # what nothing but a mode damps has a test of its own
        hand = (float(grip[0]), float(grip[1]), float(grip[2]))
    shape = ratio()  # one damping ratio for both
    velocity_filter_hz = velocity_window_samples = acceleration_filter_hz = None
    velocity_filter_order, acceleration_filter_order = 1, 2
    lot = rng.random()
    if lot < 0.15:
        velocity_window_samples = int(rng.integers(1, 9))
    elif lot < 0.75:
        velocity_filter_hz, velocity_filter_order = cutoff(), int(rng.integers(1, 3))
    if rng.random() < 0.7:
        acceleration_filter_hz, acceleration_filter_order = cutoff(), int(rng.integers(1, 3))
    return Case(
        mass=m,
        damping=b,
        sample_time=float(T),
        delay_samples=delay,
        modes=modes,
        hand=hand,
        current_lag=float(T * 10 ** rng.uniform(-1.5, 0.7)) if rng.random() < 0.4 else 0.0,
        velocity_filter_hz=velocity_filter_hz,
        velocity_filter_order=velocity_filter_order,
        velocity_window_samples=velocity_window_samples,
        acceleration_filter_hz=acceleration_filter_hz,
        acceleration_filter_order=acceleration_filter_order,
        filter_damping_ratio=shape,
    )


def draw_ray(rng: np.random.Generator, case: Case) -> Ray:
    """K, B and M over many magnitudes, negative at times, at least one of them there."""
    m, T = case.mass, case.sample_time
    sizes = 10 ** rng.uniform([-7, -6, -3], [-1, 0, 1]) * [m / T**2, m / T, m]
    signs = rng.choice([1, 1, 1, -1], 3) if rng.random() < 0.4 else np.ones(3)
    there = rng.random(3) < 0.75
    there[int(rng.integers(3))] = True
    k, b, a = (float(x) if t else None for x, t in zip(sizes * signs, there, strict=True))
    return (k, b, a)


def effects_at(ray: Ray, gains: np.ndarray | float) -> Effects:
    """The effects of a ray at each gain."""
    k, b, m = (None if part is None else part * np.asarray(gains) for part in ray)
    return Effects(stiffness=k, damping=b, mass=m)


def compare(count: int, seed: int) -> Counter[str]:
    """Verdicts at random settings and 1e-9 off boundaries; all stable intervals along a ray."""
    rng = np.random.default_rng(seed)
    tally: Counter[str] = Counter()
    for _ in range(count):
        case = draw_case(rng)
        ray = draw_ray(rng, case)
        reference, loop = loop_along(case, *ray), loop_of(case)
        ends = crossings(reference)
        gains, kinds = [1.0], ["draw"]
        if ends:
            index = int(rng.integers(len(ends)))
            end = float(ends[index].mid())
            below = float(ends[index - 1].mid()) if index else 0.0
            gains += [below + (end - below) * rng.uniform(0.01, 0.99)]
            gains += [end * (1 - 1e-9), end * (1 + 1e-9)]
            kinds += ["draw", "near", "near"]
        answers = verdict(loop, effects_at(ray, np.array(gains)))
        for gain, kind, answer in zip(gains, kinds, answers, strict=True):
            truth = _stable(reference, arb(gain))
            tally[kind] += 1
            tally[f"{kind} stable"] += truth
            tally[f"{kind} undecided"] += answer == 0
            tally["wrong"] += answer != 0 and (answer > 0) != truth
        _compare_intervals(reference, ends, loop, ray, tally)
    return tally


def _stable(reference: ReferenceLoop, gain: arb) -> bool:
    try:
        return stable_by_jury(reference.at(gain))
    except ArithmeticError:
        return False  # nothing damps the velocity: a root stays at z = 1 for any gain


def _compare_intervals(
    reference: ReferenceLoop, ends: list[arb], loop: Loop, ray: Ray, tally: Counter[str]
) -> None:
    edges = [0.0, *(float(end.mid()) for end in ends), np.inf]
    truths: list[list[float]] = []
    for low, high in pairwise(edges):
        inside = (low + high) / 2 if np.isfinite(high) else 2 * low + 1
        if _stable(reference, arb(inside)):
            if truths and truths[-1][1] == low:
                truths[-1][1] = high
            else:
                truths.append([low, high])
    low, high = stable_gains(loop, effects_at(ray, 1.0))
    found = [pair for pair in zip(low, high, strict=True) if not np.isnan(pair[0])]
    right = len(found) == len(truths) and bool(
        np.allclose(np.ravel(found), np.ravel(truths), rtol=1e-9, atol=0)
    )
    safe = truths[0][1] if truths and truths[0][0] == 0 else 0.0
    right &= bool(np.isclose(safe_gain(loop, effects_at(ray, 1.0)), safe, rtol=1e-9, atol=0))
    tally["intervals"] += 1
    tally["wrong intervals"] += not right
    tally["unstable rays"] += not truths
    tally["several intervals"] += len(truths) > 1
