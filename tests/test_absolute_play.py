"""What is proved absolutely stable, attacked: random moments at the full proved gain, and above."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from identification import load_device
from tests.wall_axis import Axis
from tests.wall_campaign import at_gain, growing, linear_growth, steady_growth
from tests.wall_cycles import responses
from tests.wall_devices import MOMENTS, Moment, certified_corners, draw_moment
from tests.wall_gates import pumped
from tests.wall_play import Bench, Law
from tune import Scene, optimise
from tune.loop.filters import Filters
from tune.stability.responses import Responses

#: Gains are found at the worst frequencies of a grid: up to 2e-6 above a linear limit was seen, and
#: what is tuned keeps 2e-3 from them.
SHAVED = 1e-5


def proved_moments(count: int, seed: int) -> tuple[list[Moment], list[float]]:
    """Random moments, as many of each kind, and the gain up to which each is proved."""
    generator = np.random.default_rng((seed, 23))
    moments: list[Moment] = []
    gains: list[float] = []
    while len(moments) < count:
        moment = draw_moment(generator, MOMENTS[len(moments) % len(MOMENTS)])
        if moment.law.steady_mass and not stands_alone(moment):
            continue  # a mass that is never switched must be stable by itself
        gain = moment.proved_gain()
        if gain > 0:
            moments.append(moment)
            gains.append(gain)
    return moments, gains


def stands_alone(moment: Moment) -> bool:
    """Whether the device is stable with any part of its steady mass."""
    return all(
        linear_growth(
            replace(moment, law=replace(moment.law, steady_mass=part * moment.law.steady_mass)),
            0.0,
            damper=0.0,
            inertia=0.0,
        )
        < 1
        for part in (0.1, 0.5, 1.0)
    )


def attack(moments: list[Moment], gains: list[float], repeats: int, samples: int) -> None:
    """No gate that stays, and no wall, gate, clamp or push by chance makes any of them grow."""
    shaved = [gain * (1 - SHAVED) for gain in gains]
    for moment, gain in zip(moments, shaved, strict=True):
        assert steady_growth(moment, gain) < 1, moment
    left = growing(moments, shaved, repeats=repeats, samples=samples, seed=5)
    assert not left, [moments[k] for k in left]


def test_responses_are_those_of_the_equations_of_motion() -> None:
    generator = np.random.default_rng(4)
    for k in range(10):
        moment = draw_moment(generator, MOMENTS[k % len(MOMENTS)])
        found = Responses.of(moment.loop())
        own = responses(Bench(moment.axis, moment.law), 0, np.exp(1j * found.angle))
        T, m = float(moment.axis.sample_time), float(moment.axis.mass)
        for theirs, ours, unit in zip(
            (found.position, found.velocity, found.acceleration),
            own,
            (m / T**2, T, T**2),
            strict=True,
        ):
            np.testing.assert_allclose(theirs[0], unit * ours, rtol=1e-8)


def test_no_more_is_found_than_the_linear_limit() -> None:
    """A mode that hardly dies out, nearly two samples of delay: the worst frequency is sharp."""
    axis = Axis(
        mass=0.346303,
        damping=31.48567,
        sample_time=2.5e-4,
        delay_samples=1.993819,
        mode_hz=82.106777,
        mode_damping=0.005838452650116918,
        at_encoder=-0.6057111495957359,
    )
    moment = Moment(axis=axis, law=Law(stiffness=8000.0), kind="spring", filters=Filters())
    gain = moment.proved_gain()
    assert linear_growth(moment, gain, damper=0.0, inertia=0.0) < 1
    assert linear_growth(moment, 1.01 * gain, damper=0.0, inertia=0.0) > 1


def test_what_is_proved_does_not_grow() -> None:
    attack(*proved_moments(5, 1), repeats=16, samples=300)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_many_that_are_proved_do_not_grow(seed: int) -> None:
    """10⁵ plays of 1000 moments, in ten parts."""
    attack(*proved_moments(100, 100 + seed), repeats=100, samples=1500)


@pytest.mark.long
def test_no_gate_is_found_that_pumps_what_is_proved() -> None:
    """Nor by search: gates that chase the swing, square waves, each improved sample by sample."""
    moments, gains = proved_moments(300, 300)
    search(moments, gains)


def search(moments: list[Moment], gains: list[float]) -> None:
    """No periodic gate of a damper or a mass makes any of them grow."""
    for moment, gain in zip(moments, gains, strict=True):
        law = moment.law
        if not law.damping and not law.mass:
            continue
        assert pumped(Bench(moment.axis, at_gain(law, gain)))[0] < 1 + SHAVED, moment


def destabilised(moments: list[Moment], gains: list[float]) -> list[str]:
    """What destabilises each at its gain: gates that stay, switched ones, a play, or nothing."""
    found: list[str] = []
    for moment, gain in zip(moments, gains, strict=True):
        law = moment.law
        if steady_growth(moment, gain) > 1:
            found.append("gates that stay")
        elif (law.damping or law.mass) and pumped(Bench(moment.axis, at_gain(law, gain)))[0] > 1:
            found.append("switched")
        else:
            found.append("")
    left = [k for k, each in enumerate(found) if not each]
    played = growing(
        [moments[k] for k in left], [gains[k] for k in left], repeats=100, samples=1500, seed=7
    )
    for place in played:
        found[left[place]] = "played"
    return found


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_most_of_what_is_refused_by_far_can_be_destabilised(seed: int) -> None:
    """1000 moments a quarter above what is proved, in four parts: not much is given away."""
    moments, gains = proved_moments(250, 500 + seed)
    found = destabilised(moments, [1.25 * gain for gain in gains])
    counts = Counter(zip((each.kind for each in moments), found, strict=True))
    for (kind, how), count in sorted(counts.items()):
        print(f"{kind}: {how or 'nothing found'} {count}")
    alone = [how for each, how in zip(moments, found, strict=True) if each.kind == "spring"]
    assert sum(map(bool, alone)) >= 0.98 * len(alone)
    assert sum(map(bool, found)) > 0.5 * len(found)


@pytest.mark.long
@pytest.mark.parametrize("name", ["homerehab", "stylus", "knob", "emps"])
@pytest.mark.parametrize("damping", [{}, {"damping": "max"}])
def test_a_certified_wall_holds_at_every_corner(name: str, damping: dict[str, str]) -> None:
    """At the gain and the extra delay that its certificate states."""
    wall = {"stiffness": "max", "one_sided": True, **damping}
    scene = Scene.model_validate({"elements": {"wall": wall}})
    moments, gains = certified_corners(optimise(load_device(name), scene), ("wall",))
    search(moments, gains)
    attack(moments, gains, repeats=40, samples=1500)


@pytest.mark.long
@pytest.mark.parametrize("name", ["stylus", "knob", "homerehab", "emps"])
@pytest.mark.parametrize("damping", [{}, {"damping": "max"}])
def test_a_wall_is_proved_in_every_hand(name: str, damping: dict[str, str]) -> None:
    """Also where a light device on a stiff hand swings far above what its weak wall could do."""
    wall = {"stiffness": "max", "one_sided": True, "penetration": 0.005, **damping}
    scene = Scene.model_validate({"hand": "free-to-rigid", "elements": {"wall": wall}})
    found = optimise(load_device(name), scene).certificate.absolute_stability
    assert found is not None
    assert found["wall"].free is not None
    assert found["wall"].held is not None
