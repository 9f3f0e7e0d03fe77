"""A design half a per cent beyond a condition of the certificate is refused."""

import copy
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.stats import chi2, norm

from identification import Device, load_device, round_to_digits, to_mapping, to_yaml
from tests.commands import digest_of
from tests.reference import Case, Sampled, crossings, loop_along
from tune import CheckFailedError, Effects, Filters, SafeProfile, Scene, audit, check, optimise
from tune.certificate.certify import certify
from tune.certificate.time_domain import contact_failures
from tune.documents.profile import AbsoluteStability, Design

#: How far from an edge, relative.
OFF = 0.005
STEP = 1e-3
#: Hz, of both filters where there are any.
VELOCITY, ACCELERATION = 50.0, 20.0
FILTERS = {"velocity_filter_hz": VELOCITY, "acceleration_filter_hz": ACCELERATION}
AXIS = Case(mass=3.0, damping=10.0, sample_time=STEP, delay_samples=1.0)
FILTERED = replace(AXIS, velocity_filter_hz=VELOCITY, acceleration_filter_hz=ACCELERATION)
#: Gain and extra samples of delay of the margin, and parts of these samples.
GAIN, EXTRA = 2.0, 1.0
PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)
MOTION = {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0}
PERCEPTION = {"name": "own", "stiffness": 0.22, "damping": 0.3, "mass": 0.2, "threshold": 0.02}

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Sizes = tuple[float, float, float]
#: K, B, constant of its multiplier, its taps.
Channels = Sequence[tuple[float, float, float, Sequence[tuple[int, float]]]]
#: The name of one, constant of its multiplier, its taps.
Channel = tuple[str, float, Sequence[tuple[int, float]]]


def element(stiffness: float = 0.0, damping: float = 0.0, mass: float = 0.0, **more: Any) -> Any:
    """One element, all that is said of it left open."""
    margins = {"gain": GAIN, "extra_delay_samples": EXTRA, "passive": False}
    whole = {
        "stiffness": stiffness,
        "damping": damping,
        "mass": mass,
        "perceived_steps": {},
        "limited_by": {},
        "ripple": 1e3,
        "motion": MOTION,
        "force_level": 14.0 * bool(stiffness),
        "fade_time": 0.2 * bool(mass),
    }
    return {**whole, **more, "margins": margins | more.get("margins", {})}


def design(
    elements: dict[str, Any], *, device: dict[str, Any] | None = None, **more: Any
) -> Design:
    """Elements on a bare device."""
    axis = {"sample_time": STEP, "mass": 3.0, "damping": 10.0, "delay": STEP}
    loop = {"sample_time": STEP, "extra_delay_samples": 1.0} | more.pop("loop", {})
    margin = {"name": "balanced", "gain": GAIN, "extra_delay_samples": 1}
    base = {"scene": "edges", "margin": margin, "ripple_limit": 1e3, "elements": elements}
    return Design.model_validate({**base, "device": axis | (device or {}), "loop": loop} | more)


def said(made: Design, witnesses: dict[str, AbsoluteStability] | None = None) -> str:
    """What `certify` says against a design, nothing where it proves it."""
    try:
        certify(made, witnesses=witnesses)
    except CheckFailedError as error:
        return "\n".join(error.failures)
    return ""


def interval(value: float, low: float | None = None, high: float | None = None) -> dict[str, float]:
    return {"value": value, "low": low or value, "high": high or value}


def limit(case: Case, sizes: Sizes) -> float:
    """The least gain at which a pole of a loop is on the unit circle."""
    gains = crossings(loop_along(case, *(size or None for size in sizes)))
    return min((float(gain.mid()) for gain in gains), default=np.inf)


def late_limit(cases: Sequence[Case], sizes: Sizes) -> float:
    """The same of many devices with every part of the margin's delay, over the margin's gain."""
    return min(limit(case.later(part), sizes) for case, part in product(cases, PARTS)) / GAIN


def along(case: Case, name: str, low: float, high: float) -> list[Case]:
    return [replace(case, **{name: float(x)}) for x in np.linspace(low, high, 9)]


def scaled(sizes: Sizes, factor: float) -> Any:
    return element(*(size * factor for size in sizes))


@dataclass(frozen=True, slots=True)
class Edge:
    """Words of a condition beyond its edge; designs by how far they go there, 1 is at it."""

    words: str
    made: Callable[[float], Design]
    witnesses: dict[str, AbsoluteStability] | None = None


SPRING = (1.0, 0.0, 0.0)
MASS = (0.0, 0.0, 1.0)
#: From half a 95 % interval to half the side of the box that holds two quantities in 99.9 %.
WIDER = float(np.sqrt(chi2.ppf(0.999, 2)) / norm.ppf(0.975))
SLOW = replace(AXIS, acceleration_filter_hz=5.0)
STIFFEST = 100 + 9900 * WIDER
MODE = {"damping_ratio": 0.02, "at_encoder": 0.8, "at_handle": -0.5}
GRIP = {"mass": 0.1, "damping": 2.0, "stiffness": interval(100.0, high=20000.0)}
#: Of each side of the box: device, what is most harmful along it, effects that feel it.
SIDES: dict[str, tuple[dict[str, Any], list[Case], Sizes]] = {
    "mass": ({"mass": interval(3.0, low=2.4)}, along(AXIS, "mass", 3.0 * 0.8**WIDER, 3.0), MASS),
    "damping": (
        {"damping": interval(10.0, low=8.0)},
        along(AXIS, "damping", 10 - 2 * WIDER, 10.0),
        SPRING,
    ),
    "sample_time": (
        {"sample_time": interval(STEP, high=1.2 * STEP)},
        [
            replace(AXIS, sample_time=float(T), delay_samples=float(STEP / T))
            for T in np.linspace(1.2 * STEP, STEP, 9)
        ],
        SPRING,
    ),
    "delay": (
        {"delay": interval(STEP, high=1.4 * STEP)},
        along(AXIS, "delay_samples", 1.4, 1.0),
        SPRING,
    ),
    "current_lag": (
        {"current_lag": interval(2e-4, high=4e-4)},
        along(AXIS, "current_lag", 4e-4, 2e-4),
        SPRING,
    ),
    "modes": (
        {"modes": [{"frequency_hz": interval(20.0, high=30.0), **MODE}]},
        [replace(AXIS, modes=((float(f), 0.02, 0.8, -0.5),)) for f in np.linspace(30, 20, 9)],
        SPRING,
    ),
    "position_stiffness": (
        {"position_stiffness": interval(100.0, low=99.0, high=10000.0)},
        [replace(SLOW, hand=(0.0, 0.0, float(k))) for k in np.linspace(STIFFEST, 100, 9)],
        MASS,
    ),
    "presliding_stiffness": (
        {"presliding_stiffness": {"low": 100.0, "high": 20000.0}},
        [replace(SLOW, hand=(0.0, 0.0, float(k))) for k in np.linspace(20000, 100, 9)],
        MASS,
    ),
    "hand": (
        {},
        [replace(SLOW, hand=(0.1, 2.0, float(k))) for k in np.linspace(20000, 100, 9)],
        MASS,
    ),
}


def side_of_the_box(name: str) -> Edge:
    device, cases, sizes = SIDES[name]
    least = late_limit(cases, sizes)
    assert least == late_limit(cases[:1], sizes) < 0.95 * late_limit(cases[-1:], sizes)
    hand = GRIP if name == "hand" else None
    loop = {"acceleration_filter_hz": cases[0].acceleration_filter_hz if sizes[2] else None}
    return Edge(
        f"a{' in a hand' if hand else ''}: margin: unstable at",
        lambda part: design(
            {"a": scaled(sizes, part * least)}, device=device, hand=hand, loop=loop
        ),
    )


def latest(spring: float, gain: float) -> float:
    """Samples of delay with which a spring is at the edge at a gain."""
    low, high = 1.0, 10.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        reach = limit(replace(AXIS, delay_samples=middle), (spring, 0.0, 0.0))
        low, high = (middle, high) if reach > gain else (low, middle)
    return low


def delay_of_the_margin() -> Edge:
    samples = latest(1200.0, GAIN)
    return Edge(
        "a: margin: unstable at",
        lambda part: design(
            {"a": element(1200.0)}, device={"delay": (part * samples - EXTRA) * STEP}
        ),
    )


def claimed(word: str, stiffness: float, **beside: Any) -> Edge:
    """Of a spring alone, or of one beside a stiffer one that claims less."""
    edge, own = limit(AXIS, (stiffness, 0.0, 0.0)), 0.0
    if word == "delay":
        edge, own = latest(stiffness, 1.0), 1.0
    key = {"gain": "gain", "delay": "extra_delay_samples"}[word]
    return Edge(
        f"a: claimed {word} margin: unstable at",
        lambda part: design({"a": element(stiffness, margins={key: part * edge - own}), **beside}),
    )


#: By whether another spring is there, by whose proof that of this one is covered.
CLAIMS: dict[str, Callable[[], Edge]] = {
    "claimed_gain": lambda: claimed("gain", 1200.0),
    "claimed_delay": lambda: claimed("delay", 1200.0),
    "gain_of_a_lesser_spring": lambda: claimed("gain", 600.0, b=element(1e3)),
    "delay_of_a_lesser_spring": lambda: claimed("delay", 1200.0, b=element(1900.0)),
}


def sum_of_two() -> Edge:
    reach = late_limit([AXIS], SPRING)
    return Edge(
        "a + b: margin: unstable at",
        lambda part: design(
            {"a": element(0.6 * reach), "b": element((part - 0.6) * reach)}, together=[["a", "b"]]
        ),
    )


def springs_alone() -> Edge:
    """The stiffest of some springs, by whose proof the others are proved too."""
    reach = late_limit([AXIS], SPRING)
    parts = {"a": 0.2, "b": 1.0, "c": 0.5}
    return Edge(
        "b: margin: unstable at",
        lambda part: design({name: element(part * each * reach) for name, each in parts.items()}),
    )


def gain_below_the_whole() -> Edge:
    """Stable at the margin's gain and near none, but not between, if a late mass is too light."""
    device = replace(AXIS, damping=0.154, velocity_filter_hz=None, acceleration_filter_hz=50.0)
    light, heavy = 0.4, 4.0
    while heavy > light * 1.0001:
        middle = float(np.sqrt(light * heavy))
        closed = late_limit([device], (113.4, 0.0, middle)) > 1
        light, heavy = (light, middle) if closed else (middle, heavy)
    return Edge(
        "of the gain asked for",
        lambda part: design(
            {"a": element(113.4, 0.0, heavy / part)},
            device={"damping": device.damping},
            loop={"acceleration_filter_hz": 50.0},
        ),
    )


def level_of_what_fades() -> Edge:
    """A block that fades beside a spring, worst at a level between none and all of it."""
    spring, block = np.array([1236.0, 0.0, 0.0]), np.array([2535.0, 0.0, 0.28])
    late = replace(AXIS, acceleration_filter_hz=40.0)
    sums = [spring + level * block for level in np.linspace(0, 1, 41)]
    reaches = [late_limit([late], (float(K), 0.0, float(M))) for K, _, M in sums]
    least = min(reaches)
    assert least < 0.95 * min(reaches[0], reaches[-1])
    return Edge(
        "a + b: not proved stable while b fades",
        lambda part: design(
            {"a": element(*part * least * spring), "b": element(*part * least * block)},
            together=[["a", "b"]],
            loop={"acceleration_filter_hz": 40.0},
        ),
    )


def longest_delay() -> Edge:
    return Edge(
        "samples are claimed, at most 64 judged",
        lambda part: design({"a": element(50.0)}, device={"delay": (64 * part - EXTRA) * STEP}),
    )


def own_force() -> Edge:
    """A device that may be pushed away a little from where it is."""
    return Edge(
        "device: position_stiffness",
        lambda part: design(
            {"a": element(100.0)},
            device={"position_stiffness": interval(WIDER, low=(WIDER - 1) / part, high=2 * WIDER)},
        ),
    )


LIMITED = {"force_limit": {"continuous": 14.0, "peak": 28.0}}


def continuous_force() -> Edge:
    return Edge(
        "a + b: sustained force",
        lambda part: design(
            {"a": element(800.0), "b": element(part * 1400.0 - 800.0)},
            device=LIMITED,
            together=[["a", "b"]],
        ),
    )


def peak_force() -> Edge:
    """10 N of a spring, 6 N of a damper and 12 N of a mass, each by its own motion."""
    quick = {"speed": 0.3, "acceleration": 20.0, "penetration": 0.02}
    return Edge(
        "a: peak force",
        lambda part: design(
            {"a": element(500.0, -20.0, part * 28 / 20 - 0.8, motion=quick, force_level=28.0)},
            device=LIMITED | {"damping": 80.0},
            loop={"acceleration_filter_hz": ACCELERATION},
        ),
    )


def force_levels() -> Edge:
    return Edge(
        "a + b: cut force",
        lambda part: design(
            {
                "a": element(500.0, force_level=20.0),
                "b": element(500.0, force_level=28 * part - 20),
            },
            device=LIMITED,
            together=[["a", "b"]],
        ),
    )


VISCOUS = replace(AXIS, velocity_filter_hz=VELOCITY, added_damping=1.0)
NOISY = replace(FILTERED, delay_samples=1.5, stiffness=1000.0, added_damping=20.0, added_mass=0.3)


def noise(case: Case = NOISY) -> float:
    """N rms that an encoder of 6 µm makes of an element."""
    loop = Sampled(case)
    return loop.noise_gain(loop.force_numerator) * 6e-6 / float(np.sqrt(12))


def ripple(**more: Any) -> Design:
    sizes = NOISY.stiffness, NOISY.added_damping, NOISY.added_mass
    whole = {"a": element(*sizes, ripple=more.pop("claim", 1e3))}
    device = {"encoder_resolution": 6e-6, "delay": interval(STEP, high=1.5 * STEP)}
    return design(whole, device=device, loop=FILTERS, **more)


def limit_of_ripple() -> Edge:
    return Edge("a: ripple", lambda part: ripple(ripple_limit=noise() / part))


def claim_of_ripple() -> Edge:
    return Edge("a: claims a ripple of", lambda part: ripple(claim=noise() / part))


def passivity() -> Edge:
    """A filtered damper, one sample late: b against T/2·Re{(1 - 1/z)·C/z}/(1 - cos θ)."""
    theta = np.linspace(1e-3, np.pi, 20001)
    z = np.exp(1j * theta)
    needed = STEP / 2 * ((1 - 1 / z) * velocity(theta) / z).real / (1 - np.cos(theta))
    reach = (10.0 - 2 * WIDER) / float(needed.max())
    return Edge(
        "a: claims passivity",
        lambda part: design(
            {"a": element(0.0, part * reach, margins={"passive": True})},
            device={"damping": interval(10.0, low=8.0)},
            loop=FILTERS,
        ),
    )


def felt(law: Callable[[Array], Complex], hertz: float) -> complex:
    """Force over velocity of a law that is held and a sample late, N·s/m."""
    turn = 2j * np.pi * hertz
    held = (1 - np.exp(-turn * STEP)) / (turn * STEP)
    return complex(law(np.array([abs(turn) * STEP]))[0] * held * np.exp(-turn * STEP) / turn)


def damping_of_a_mass(more: float = 10.0 * PERCEPTION["damping"], **table: float) -> Edge:
    """A damping of the device that a mass makes greater by a Weber fraction."""
    reach = more / felt(fast, 5.0).real
    return Edge(
        "of damping where 0 is asked for",
        lambda part: design(
            {"a": element(0.0, 0.0, part * reach)}, loop=FAST, perception=PERCEPTION | table
        ),
    )


def faint_damping_of_a_mass() -> Edge:
    """One force just noticed, where that is more than a Weber fraction of what the device has."""
    return damping_of_a_mass(4.0 / 0.2, threshold=4.0)


def mass_of_a_damper() -> Edge:
    """A mass of the device that a late damper makes less by a Weber fraction."""
    taken = max(-felt(velocity, hertz).imag / (2 * np.pi * hertz) for hertz in (0.5, 5.0))
    reach = 3.0 * (1 - 1 / (1 + PERCEPTION["mass"])) / taken
    return Edge(
        "of mass where 0 is asked for",
        lambda part: design({"a": element(0.0, part * reach)}, loop=FILTERS, perception=PERCEPTION),
    )


#: Filters with which a mass lags little, and the estimate of acceleration over position.
FAST = {"velocity_filter_hz": 200.0, "acceleration_filter_hz": 30.0}


def fast(theta: Array) -> Complex:
    return estimate(theta, 30.0, 2, 2)


def estimate(theta: Array, hertz: float, power: int, poles: int, *, leads: bool = False) -> Complex:
    """A derivative over position: equal poles behind differences, carried on by its lag or not."""
    z, pole = np.exp(1j * theta), np.exp(-2 * np.pi * hertz * STEP)
    lag = poles * pole / (1 - pole) + power / 2 if leads else 0.0
    filtered = ((1 - pole) / (1 - pole / z)) ** poles * (1 + lag * (1 - 1 / z))
    return ((1 - 1 / z) / STEP) ** power * filtered


def felt_edge(
    words: str,
    hertz: float,
    sizes: Callable[[float], tuple[float, float]],
    used: Callable[[Array, Array, Array, float, float], float],
    *,
    leads: bool = False,
) -> Edge:
    """Where (damping, mass), as they grow from half to twice, use all of a limit on what is felt.

    ``used`` is told Hz, mass and damping felt, damping and mass asked for; 0 where all is used.
    """
    places = np.unique([*np.geomspace(0.5, 5, 60), *np.geomspace(5, 20, 60)])
    poles = 4 if leads else 2
    laws = [
        np.array([felt(law, hz) for hz in places.tolist()])
        for law in (
            lambda theta: estimate(theta, 200.0, 1, 1),
            lambda theta: estimate(theta, hertz, 2, poles, leads=leads),
        )
    ]

    def beyond(part: float) -> float:
        damping, mass = sizes(part)
        whole = damping * laws[0] + mass * laws[1]
        return used(places, whole.imag / (2 * np.pi * places), whole.real, damping, mass)

    reach = float(brentq(beyond, 0.5, 2.0, xtol=1e-14))
    filters: dict[str, Any] = FAST | {"acceleration_filter_hz": hertz}
    filters |= {"acceleration_filter": "tracking", "acceleration_filter_order": 4} if leads else {}
    return Edge(
        words,
        lambda part: design(
            {"a": element(0.0, *sizes(part * reach))}, loop=filters, perception=PERCEPTION
        ),
    )


def mass_within_a_factor() -> Edge:
    """A damper that takes a sixth of a mass."""
    return felt_edge(
        "a factor of 1.2 is allowed",
        60.0,
        lambda part: (60.0 * part, 1.2),
        lambda hz, mass, _, __, asked: 1 / 1.2 - float(mass[hz <= 5].min()) / asked,
    )


def mass_beyond_the_motions() -> Edge:
    """A damper that takes all of what a filter leaves of a mass at 20 Hz."""
    return felt_edge(
        "from none to twice of it is allowed",
        25.0,
        lambda part: (2.0 * part, 0.25),
        lambda _, mass, __, ___, ____: -float(mass.min()),
    )


def damping_taken_away_beyond() -> Edge:
    """A negative mass that at 20 Hz takes more damping than device and damper have."""
    return felt_edge(
        "with the device's own it takes none away",
        24.0,
        lambda part: (40.0, -0.5 * part),
        lambda _, __, damping, ___, ____: -10.0 - float(damping.min()),
    )


def parasitic_damping_beyond() -> Edge:
    """A mass whose tracking filter, with little lag at 5 Hz, gives much damping at 15."""

    def used(hz: Array, _: Array, damping: Array, asked: float, mass: float) -> float:
        far = hz > 5
        rest = 10.0 + damping[far] - mass * 2 * np.pi * hz[far]
        return float(rest.max() / (10.0 + asked)) - 1 - PERCEPTION["damping"]

    return felt_edge(
        "1 step and the impedance of the mass are allowed",
        30.0,
        lambda part: (8.0, 0.2 * part),
        used,
        leads=True,
    )


def velocity(theta: Array) -> Complex:
    """The estimate of velocity over position."""
    z, pole = np.exp(1j * theta), np.exp(-2 * np.pi * VELOCITY * STEP)
    return (1 - 1 / z) / STEP * (1 - pole) / (1 - pole / z)


def acceleration(theta: Array) -> Complex:
    """The estimate of acceleration over position."""
    z, pole = np.exp(1j * theta), np.exp(-2 * np.pi * ACCELERATION * STEP)
    return ((1 - 1 / z) / STEP * (1 - pole) / (1 - pole / z)) ** 2


THETA = np.geomspace(1e-5, np.pi, 800)


def response(samples: float, own: float) -> Complex:
    """Position over a held force at angles THETA, with a spring of the device's own."""

    def held(time: float) -> Array:
        whole = np.zeros((3, 3))
        whole[0, 1], whole[1] = 1.0, np.array([-own, -AXIS.damping, 1.0]) / AXIS.mass
        return np.asarray(expm(whole * time))

    late = samples - np.floor(samples)
    z, moved = np.exp(1j * THETA), held(STEP)
    new = held((1 - late) * STEP)[:2, 2]
    pushed = new + (moved[:2, 2] - new) / z[:, None]
    states = np.linalg.solve(z[:, None, None] * np.eye(2) - moved[:2, :2], pushed[..., None])
    return states[:, 0, 0] * z ** -np.floor(samples)


def holds(channels: Channels, *, steady: float = 0.0, own: float = 0.0) -> bool:
    """Whether the condition of the clamps holds on a grid of angles, delays and levels."""
    laws = [(1 if K else 0) + (B / K if K else 1) * velocity(THETA) for K, B, _, _ in channels]
    taps = [
        constant + sum((w * (1 - np.exp(-1j * n * THETA)) for n, w in each), 0.0 * THETA)
        for _, _, constant, each in channels
    ]
    for part, level in product(PARTS, (0.0, GAIN / 2, GAIN) if steady else (0.0,)):
        plant = response(1.0 + EXTRA * part, own)
        plant = plant / (1 + level * steady * acceleration(THETA) * plant)
        matrix = np.array(
            [
                [
                    taps[i] * ((i == j) / (GAIN * (K or B)) + laws[i] * plant)
                    for j in range(len(laws))
                ]
                for i, (K, B, _, _) in enumerate(channels)
            ]
        ).transpose(2, 0, 1)
        whole = matrix + matrix.conj().transpose(0, 2, 1)
        size = np.sqrt(np.abs(np.einsum("kii->ki", whole)))
        if np.linalg.eigvalsh(whole / (size[:, :, None] * size[:, None, :])).min() <= 0:
            return False
    return True


def reach_of(channels: Channels, **beside: float) -> float:
    """The factor of all effects up to which the condition holds."""
    low, high = 0.01, 20.0
    while high > low * 1.0002:
        middle = float(np.sqrt(low * high))
        more = [(middle * K, middle * B, *rest) for K, B, *rest in channels]
        low, high = (middle, high) if holds(more, **beside) else (low, middle)  # type: ignore[arg-type]
    return low


def proof(*channels: Channel, **more: Any) -> AbsoluteStability:
    """What a profile states of a combination, for devices that are free if nothing else is said."""
    multiplier = {
        "channels": [
            {
                "name": name,
                "constant": constant,
                "taps": [{"samples": n, "weight": w} for n, w in taps],
            }
            for name, constant, taps in channels
        ]
    }
    stated = {"gain": GAIN, "extra_delay_samples": EXTRA, "free": multiplier, "covers": ()}
    return AbsoluteStability.model_validate(stated | more)


WALL = (8000.0, 60.0)
#: Of slope 1, as `Σ samples·weight`.
ONE = ((1, 1.0),)
THREE = ((1, 0.04), (8, 0.06), (14, 0.48 / 14))
LONG = ((1, 0.4), (30, 0.02))


def clamps(part: float, **beside: Any) -> Design:
    """A wall of so many times its sizes, and what is beside it."""
    wall = element(*(part * size for size in WALL), one_sided=True)
    return design({"wall": wall} | beside, loop=FILTERS)


def wall_alone() -> Edge:
    reach = reach_of([(*WALL, 0.0, ONE)])
    return Edge(
        "wall: not proved stable with its clamps",
        lambda part: clamps(part * reach),
        {"wall": proof(("wall", 0.0, ONE))},
    )


def walls_of_one_signal() -> Edge:
    """The stiffest of some walls alike, by whose proof the others are proved too."""
    reach = reach_of([(*WALL, 0.0, ONE)])
    parts = {"wall": 0.2, "door": 1.0, "gate": 0.5}
    return Edge(
        "door: not proved stable with its clamps",
        lambda part: design(
            {
                name: element(*(part * each * reach * size for size in WALL), one_sided=True)
                for name, each in parts.items()
            },
            loop=FILTERS,
        ),
        {name: proof((name, 0.0, ONE)) for name in parts},
    )


def beside_a_wall(name: str, K: float, B: float, channel: Channel) -> Edge:
    """An element whose channel, constant and taps are these, as much larger as the wall."""
    reach = reach_of([(*WALL, 0.0, THREE), (K, B, *channel[1:])])
    assert reach < 0.8 * reach_of([(*WALL, 0.0, THREE)])
    return Edge(
        f"wall + {name}: not proved stable with its clamps",
        lambda part: clamps(part * reach, **{name: element(part * reach * K, part * reach * B)}),
        {
            "wall": proof(("wall", 0.0, THREE)),
            f"wall + {name}": proof(("wall", 0.0, THREE), channel),
        },
    )


def damper_beside_a_wall() -> Edge:
    """Switched at any moment."""
    return beside_a_wall("water", 0.0, 30.0, ("damping", 8e-4, ()))


def spring_beside_a_wall() -> Edge:
    """A clamp of another signal."""
    return beside_a_wall("rubber", 500.0, 0.0, ("rubber", 0.0, LONG))


def mass_beside_a_wall() -> Edge:
    """That fades, at any level up to the margin's gain."""
    reach = reach_of([(*WALL, 0.0, ONE)], steady=2.0)
    assert reach < 0.95 * reach_of([(*WALL, 0.0, ONE)], steady=1.0)
    return Edge(
        "wall + cup: not proved stable with its clamps",
        lambda part: clamps(part * reach, cup=element(0.0, 0.0, 2.0)),
        {"wall": proof(("wall", 0.0, ONE)), "wall + cup": proof(("wall", 0.0, ONE))},
    )


def wall_of_a_held_device() -> Edge:
    reach = reach_of([(*WALL, 1e-3, ONE)], own=500.0)
    held = proof(("wall", 1e-3, ONE)).free
    return Edge(
        "wall: not proved stable with its clamps",
        lambda part: design(
            clamps(part * reach).elements, device={"position_stiffness": 500.0}, loop=FILTERS
        ),
        {"wall": proof(free=None, held=held)},
    )


EDGES: dict[str, Callable[[], Edge]] = {
    **{f"box: {name}": lambda name=name: side_of_the_box(name) for name in SIDES},
    **CLAIMS,
    **{
        each.__name__: each
        for each in (
            delay_of_the_margin,
            sum_of_two,
            springs_alone,
            gain_below_the_whole,
            level_of_what_fades,
            longest_delay,
            own_force,
            continuous_force,
            peak_force,
            force_levels,
            limit_of_ripple,
            claim_of_ripple,
            passivity,
            damping_of_a_mass,
            faint_damping_of_a_mass,
            mass_of_a_damper,
            mass_within_a_factor,
            mass_beyond_the_motions,
            damping_taken_away_beyond,
            parasitic_damping_beyond,
            wall_alone,
            walls_of_one_signal,
            damper_beside_a_wall,
            spring_beside_a_wall,
            mass_beside_a_wall,
            wall_of_a_held_device,
        )
    },
}


@pytest.mark.parametrize("name", EDGES)
def test_just_within_an_edge_passes_and_just_beyond_it_is_refused(name: str) -> None:
    edge = EDGES[name]()
    assert said(edge.made(1 - OFF), edge.witnesses) == ""
    assert edge.words in said(edge.made(1 + OFF), edge.witnesses)


WET = {"water": element(0.0, 30.0)}
FREE = proof(("wall", 0.0, THREE)).free
DAMPED = {
    "wall": proof(("wall", 0.0, THREE)),
    "wall + water": proof(("wall", 0.0, THREE), ("damping", 8e-4, ())),
}


@pytest.mark.parametrize(
    ("false", "words"),
    [
        ({"wall": proof(("wall", 0.0, THREE), gain=GAIN * (1 - OFF))}, "the margin asks for 2"),
        ({"wall": proof(("wall", 0.0, THREE), extra_delay_samples=1 - OFF)}, "the margin asks for"),
        ({"wall": proof(free=None)}, "wall: absolute_stability, free: no multiplier is stated"),
        ({"wall": proof(free=FREE, held=FREE)}, "wall: absolute_stability, held: a multiplier is"),
        ({"wall": proof(("wall", 1e-3, THREE))}, "needs taps and no constant"),
        ({"wall": proof(("wall", 0.0, ()))}, "needs taps and no constant"),
        ({"wall": proof(("door", 0.0, THREE))}, "is of door, not of wall"),
        ({"wall + water": proof(("wall", 0.0, THREE))}, "is of wall, not of wall, damping"),
        (
            {"wall + water": proof(("wall", 0.0, THREE), ("damping", 0.0, ()))},
            "damping that is switched is a constant above zero",
        ),
    ],
)
def test_a_false_multiplier_proves_nothing(false: dict[str, AbsoluteStability], words: str) -> None:
    made = clamps(1.0, **(WET if "wall + water" in false else {}))
    assert said(made, DAMPED) == ""
    assert words in said(made, DAMPED | false)


def test_a_multiplier_of_another_wall_proves_nothing() -> None:
    """Though the other wall is stiffer, follows the same signal and is proved by it."""
    made = clamps(1.0, door=element(*(size / 2 for size in WALL), one_sided=True))
    other = proof(("wall", 0.0, THREE))
    assert said(made, {"wall": other, "door": proof(("door", 0.0, THREE))}) == ""
    assert "is of wall, not of door" in said(made, {"wall": other, "door": other})


def test_the_largest_sets_that_a_wall_is_met_in_need_a_multiplier() -> None:
    """A wall is met beside whatever is played, unless the two are apart."""
    made = clamps(1.0, **WET)
    apart = Design.model_validate(made.model_dump(by_alias=True) | {"apart": [("wall", "water")]})
    alone, beside = ({name: DAMPED[name]} for name in ("wall", "wall + water"))
    assert said(made, beside) == said(apart, alone) == ""
    refused = "its force may be cut or push on one side only"
    assert f"wall + water: {refused}" in said(made, alone)
    assert f"wall: {refused}" in said(apart, beside)


def test_a_device_that_may_have_no_damping_has_no_walls() -> None:
    """Though its own damper makes the linear loop stable: what is only pushed may swing up."""
    within, beyond = (
        design(
            {"wall": element(200.0, 60.0, one_sided=True)},
            device={"damping_slope": {"low": least, "high": 10.0}},
            loop=FILTERS,
        )
        for least in (10.0 * OFF, 0.0)
    )
    stated = {"wall": proof(("wall", 0.0, THREE))}
    assert said(within, stated) == ""
    assert "no damping" in said(beyond, stated)


def test_hand_mode_lag_and_part_of_a_sample_are_certified_and_said() -> None:
    mode = {**MODE, "frequency_hz": interval(60.0, low=57.0, high=63.0)}
    axis = {
        "modes": [mode],
        "current_lag": interval(2e-4, low=1e-4, high=3e-4),
        "delay": interval(STEP, low=0.8 * STEP, high=1.2 * STEP),
    }
    grip = GRIP | {"damping": interval(5.0, low=2.0, high=20.0)}
    seal = certify(design({"a": element(1000.0, 20.0)}, device=axis, hand=grip, loop=FILTERS))
    assert seal.interior == {"a": "proved"}
    assert seal.hand is not None
    assert seal.hand.stiffness == (100.0, 20000.0)
    assert seal.modes[0].frequency_hz == (57.0, 63.0)
    assert (seal.current_lag, seal.delay_samples) == ((1e-4, 3e-4), (0.8, 1.2))
    assert 0.8 - 1e-9 <= seal.worst.delay_samples <= 2.2 + 1e-9
    assert len(seal.worst.modes) == 1


def test_what_is_not_proved_is_not_certified() -> None:
    """A claim a part in 10⁴ below the limit: true, but a hundred cells are too few to prove it."""
    reach = limit(replace(AXIS, mass=3.0 * 0.8**WIDER), (0.0, 0.0, 0.5))
    claim = {"gain": reach * (1 - 1e-4)}
    made = design(
        {"a": element(0.0, 0.0, 0.5, margins=claim)}, device={"mass": interval(3.0, low=2.4)}
    )
    assert said(made) == ""
    with pytest.raises(CheckFailedError, match="a: not proved for every device"):
        certify(made, 100)


STATED_AXIS = {
    "motion": "linear",
    "encoder_resolution": 6e-6,
    "force_limit": {"continuous": 14.0, "peak": 28.0},
    "sample_time": STEP,
    "mass": AXIS.mass,
    "delay": STEP,
}


def loud_damping(limit_of_ripple: float) -> float:
    """Damping of which an encoder of 6 µm makes so much noise."""
    low, high = 1.0, 1000.0
    while high > low * (1 + 1e-6):
        middle = float(np.sqrt(low * high))
        quiet = noise(replace(VISCOUS, added_damping=middle)) < limit_of_ripple
        low, high = (middle, high) if quiet else (low, middle)
    return low


#: What is asked for of one effect on a device of so much damping, by the limit that is met; and how
#: large others say it can be.
LARGEST: dict[str, tuple[dict[str, Any], float, Callable[[Any], float]]] = {
    "delay-margin": (
        {"stiffness": "max", "penetration": 0.001},
        AXIS.damping,
        lambda _: limit(AXIS.later(2.0), SPRING) / 3.0,
    ),
    "force": ({"stiffness": "max", "penetration": 0.02}, AXIS.damping, lambda _: 14.0 / 0.02),
    "ripple": ({"damping": "max", "speed": 0.01}, AXIS.damping, lambda _: loud_damping(0.05)),
    "rendering": ({"mass": "max"}, 35.0, lambda table: 35.0 * table.damping / felt(fast, 5.0).real),
}


@pytest.mark.parametrize("word", LARGEST)
def test_the_tuner_goes_to_the_edge_and_not_beyond(word: str) -> None:
    """With the margin that is called conservative: gain 3, two samples late."""
    wanted, damping, largest = LARGEST[word]
    loop = FAST if word == "rendering" else FILTERS
    scene = {"elements": {"a": wanted}, "loop": loop, "margin": "conservative"}
    profile = optimise(
        Device.model_validate(STATED_AXIS | {"damping": damping}),
        Scene.model_validate(scene | {"ripple_limit": 0.05}),
    )
    ((effect, limited_by),) = profile.elements["a"].limited_by.items()
    assert profile.perception is not None
    most = largest(profile.perception)
    assert most * (1 - OFF) < getattr(profile.elements["a"], effect) < most * (1 + 1e-5)
    assert limited_by == word


#: K and B of gains, a number of them that is at an edge, and the limit that is broken beyond it.
JUDGED: dict[str, tuple[tuple[float, float], Callable[[], float], set[str]]] = {
    "one gain": ((1.0, 0.0), lambda: limit(AXIS, SPRING), {"stability", "force"}),
    "its margin": ((1.0, 0.0), lambda: limit(AXIS, SPRING) / GAIN, {"gain-margin", "force"}),
    "late": ((1.0, 0.0), lambda: late_limit([AXIS], SPRING), {"delay-margin", "force"}),
    "two effects late": (
        (1.0, 0.01),
        lambda: late_limit([VISCOUS], (1.0, 0.01, 0.0)),
        {"delay-margin", "force"},
    ),
    "sustained": ((1.0, 0.0), lambda: 14.0 / 0.01, {"force"}),
    "peak": ((0.0, 1.0), lambda: 28.0 / 0.2, {"force"}),
}


@pytest.mark.parametrize("name", JUDGED)
def test_an_audit_tells_what_is_just_beyond_a_limit(name: str) -> None:
    (stiffness, damping), edge, beyond = JUDGED[name]
    quiet = {name: STATED_AXIS[name] for name in STATED_AXIS if name != "encoder_resolution"}
    device = Device.model_validate(quiet | {"damping": AXIS.damping})

    def faults(part: float) -> set[str]:
        effects = Effects(
            stiffness=part * edge() * stiffness or None, damping=part * edge() * damping or None
        )
        filters = Filters(velocity_filter_hz=VELOCITY if damping else None)
        return {fault.limit for fault in audit(device, effects, filters=filters).faults}

    word = beyond - {"force"} or beyond
    assert word <= faults(1 + OFF) <= beyond
    assert not word & faults(1 - OFF)


#: A pair of poles with which a mass lags little.
PAIRED = {"filter_damping_ratio": 0.5}


@cache
def content() -> dict[str, Any]:
    """A profile with a wall, its lead just reached, and a cup."""
    elements = {
        "wall": {"stiffness": 15000.0, "damping": "max", "one_sided": True},
        "cup": {"mass": "max", "damping": 30.0},
    }
    loop = {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 25.0} | PAIRED
    wanted = Scene.model_validate({"elements": elements, "loop": loop})
    return to_mapping(optimise(load_device("homerehab"), wanted))


def checked(
    folder: Path,
    change: Callable[[dict[str, Any]], None] = lambda _: None,
    made: Callable[[], dict[str, Any]] = content,
) -> str:
    """What `check` says against a profile after a change, signed anew."""
    changed = copy.deepcopy(made())
    changed.pop("digest")
    change(changed)
    path = folder / "profile.yaml"
    path.write_text(to_yaml(changed | {"digest": digest_of(changed)}), encoding="utf-8")
    try:
        check(path)
    except CheckFailedError as error:
        return "\n".join(error.failures)
    return ""


#: Numbers that `check` computes anew, of elements and of the rest, by what is told of them at once.
FELT = ("rendered", "perceived_steps")
STATED = ("contact", "ripple", "margins.jitter", "margins.absolute_gain")
CERTIFIED = (
    *("certificate.confidence", "certificate.mass", "certificate.damping", "certificate.delay"),
    *("certificate.sample_time", "certificate.delay_samples", "certificate.gain"),
    *("certificate.extra_delay_samples", "loop.sample_time", "loop.extra_delay_samples"),
    "certificate.worst.pole_radius",
)
#: What is a difference of larger numbers is told from a part of these.
PARTS_OF_MORE = {"net_damping": 3, "lead": 3}


def off(place: Any, key: str, words: str, told: Counter[str]) -> Any:
    """All numbers of a part of a profile half a per cent off, and how often each is to be told."""
    if isinstance(place, dict):
        return {name: off(each, name, f"{words}.{name}", told) for name, each in place.items()}
    if isinstance(place, list):
        return [off(each, key, words, told) for each in place]
    told[words] += 1
    return place and round_to_digits(place * (1 + OFF * PARTS_OF_MORE.get(key, 1)), 12)


@pytest.mark.parametrize("keys", [FELT, STATED, CERTIFIED], ids=["felt", "stated", "certified"])
def test_every_number_half_a_per_cent_off_is_told(keys: tuple[str, ...], tmp_path: Path) -> None:
    told: Counter[str] = Counter()

    def change(profile: dict[str, Any]) -> None:
        elements = profile["elements"].items()
        places = [(profile, "")] if keys is CERTIFIED else [(e, f"{n}: ") for n, e in elements]
        for place, begins in places:
            for key in keys:
                *above, last = key.split(".")
                inner = reduce(lambda part, name: part.get(name, {}), above, place)
                if last in inner:
                    inner[last] = off(inner[last], last, begins + key, told)

    said_of = checked(tmp_path, change)
    for words, count in told.items():
        # Both ends of an interval are told in one sentence.
        seen = said_of.count(f"{words} ")
        assert seen >= (1 if keys is CERTIFIED else count), words
    assert len(told) >= 9
    assert "in what haptune writes" not in said_of


def test_the_profile_itself_passes(tmp_path: Path) -> None:
    assert checked(tmp_path) == ""


def _less(profile: dict[str, Any]) -> None:
    margins = profile["elements"]["wall"]["margins"]
    margins["jitter"] = round_to_digits(margins["jitter"] * (1 - OFF), 12)


def _worst(**update: Any) -> Callable[[dict[str, Any]], None]:
    return lambda profile: profile["certificate"]["worst"].update(update)


def _harmless(profile: dict[str, Any]) -> None:
    """A point of the box where less is felt, with its true radius: a worse one is there."""
    worst, wall = profile["certificate"]["worst"], profile["elements"]["wall"]
    case = Case(
        **{name: worst[name] for name in ("mass", "damping", "sample_time", "delay_samples")},
        stiffness=wall["stiffness"] * worst["gain"],
        added_damping=wall["damping"] * worst["gain"],
        velocity_filter_hz=60.0,
    )
    radius = max(float(abs(pole).mid()) for pole in Sampled(case).poles)
    worst.update(elements=["wall"], pole_radius=round_to_digits(radius, 12))


Change = Callable[[dict[str, Any]], None]


def told_apart(folder: Path, changes: dict[str, Change], made: Callable[[], Any]) -> None:
    """Each change has words of its own, however many there are."""

    def change(profile: dict[str, Any]) -> None:
        for each in changes.values():
            each(profile)

    said_of = checked(folder, change, made)
    assert [words for words in changes if words not in said_of] == []


@pytest.mark.parametrize(
    "changes",
    [
        {
            "a worse one was found": _harmless,
            "does not say that wall + cup": lambda p: p["certificate"]["interior"].pop(
                "wall + cup"
            ),
            "has no such combination": lambda p: p["certificate"]["interior"].update(air="proved"),
            "before its face": lambda p: p["elements"]["wall"].update(lead=1e-3 * (1 - OFF)),
            "wall: margins.jitter says": _less,
        },
        {
            "certificate.worst.pole_radius says": _worst(elements=["wall"]),
            "more than the": lambda p: p["elements"]["wall"]["margins"].update(gain=3.0),
        },
        {"which is not felt": _worst(elements=["door"])},
        {"not a point of the box": _worst(hand={"mass": 0.1, "damping": 5.0, "stiffness": 300.0})},
        {"certificate.worst is not a point of the box": _worst(delay_samples=2.0 * (1 + OFF))},
        {"no multiplier is": lambda p: p["certificate"]["absolute_stability"].pop("wall + cup")},
    ],
    ids=", ".join,
)
def test_a_false_word_is_told(changes: dict[str, Change], tmp_path: Path) -> None:
    told_apart(tmp_path, changes, content)


def test_a_wall_that_damps_less_than_its_lag_takes_is_told() -> None:
    """Beyond what the linear loop bears, which is told first."""
    said_of: list[str] = []
    for part in (1 + OFF, 1 - OFF):
        changed = copy.deepcopy(content())
        wall = changed["elements"]["wall"]
        wall["damping"] = round_to_digits(0.0025 * wall["stiffness"] * part, 12)
        said_of.append("\n".join(contact_failures(SafeProfile.model_validate(changed), "wall")))
    assert "less than the lag" not in said_of[0]
    assert "less than the lag" in said_of[1]


def test_a_profile_that_was_changed_after_it_was_signed_is_refused(tmp_path: Path) -> None:
    changed = copy.deepcopy(content()) | {"scene": "another"}
    path = tmp_path / "profile.yaml"
    path.write_text(to_yaml(changed | {"digest": digest_of(content())}), encoding="utf-8")
    with pytest.raises(CheckFailedError, match="changed after it was certified"):
        check(path)


@cache
def several() -> dict[str, Any]:
    """A wall, a spring that must last as deep as is stated, something heavy, something wet."""
    elements = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
        "spring": {"stiffness": 500.0, "damping": 5.0, "penetration": 0.01},
        "cup": {"mass": "max", "damping": 30.0},
        "water": {"damping": 10.0},
    }
    scene = Scene.model_validate(
        {
            "elements": elements,
            "together": [["spring", "water"]],
            "apart": [["wall", "spring"], ["wall", "cup"]],
            "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0} | PAIRED,
        }
    )
    return to_mapping(optimise(load_device("homerehab"), scene))


WALL_OF, WATER_OF, CUP_OF, SPRING_OF = (
    ("elements", name) for name in ("wall", "water", "cup", "spring")
)


def _set(*keys: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        place = content
        for key in keys[:-1]:
            place = place[key]
        if value is None:
            del place[keys[-1]]
        else:
            place[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    "changes",
    [
        {"an earlier law of walls": _set("law", value=None)},
        {"the law 'gated'": _set("law", value="gated")},
        {
            "margins.gain says 1.5": _set(*WATER_OF, "margins", "gain", value=1.5),
            "acts, limited_by says nothing": _set(*WATER_OF, "limited_by", value={}),
            "perceived_steps has nothing": _set(*WATER_OF, "perceived_steps", value={}),
            "force_level says 0.5": _set(*SPRING_OF, "force_level", value=0.5),
        },
        {
            "margins.absolute_gain says 3.0": _set(*WALL_OF, "margins", "absolute_gain", value=3.0),
            "certificate.mass says": _set("certificate", "mass", value=[1.0, 2.0]),
            "limited by ripple": _set(*WATER_OF, "limited_by", "damping", value="ripple"),
            "limited by stability": _set(*CUP_OF, "limited_by", "mass", value="stability"),
            "by rendering": _set(*WALL_OF, "limited_by", "stiffness", value="rendering"),
            "limited by lead": _set(*SPRING_OF, "limited_by", "damping", value="lead"),
            "margins.jitter says 7": _set(*WATER_OF, "margins", "jitter", value=7.0),
        },
        {
            "more than the": _set(*WALL_OF, "margins", "gain", value=2.6),
            "by delay-margin": _set(*CUP_OF, "limited_by", "mass", value="delay-margin"),
            "by saturation": _set(*WALL_OF, "limited_by", "stiffness", value="saturation"),
            "less than was wanted": _set("notes", value=["water.damping: 10 N·s/m is asked for"]),
        },
    ],
    ids=", ".join,
)
def test_check_refuses_every_false_word(changes: dict[str, Change], tmp_path: Path) -> None:
    told_apart(tmp_path, changes, several)
