"""Tuning against closed forms, brute force, relaxed limits and true devices."""

import time
from concurrent.futures import ThreadPoolExecutor
from itertools import permutations, product
from typing import Any
from unittest import mock

import numpy as np
import pytest
from flint import arb, ctx

from identification import Device, load_device, quantity
from tests.devices import device_of, known
from tests.felt import beyond, felt
from tests.reference import Case, crossings, loop_along, stable_by_jury
from tests.simulated.experiment import EFFECTS, EffectName
from tests.thinned import thinned
from tests.unlimited import UNLIMITED
from tune import (
    CheckFailedError,
    Effects,
    Filters,
    Loop,
    SafeProfile,
    Scale,
    Scene,
    audit,
    default_table,
    largest,
    optimise,
)

#: A spring that acts at once takes little of the damping away, so that stability limits it.
PROMPT = {"delay": quantity(0.0)}


def _scene(elements: dict[str, Any], **more: Any) -> Scene:
    return Scene.model_validate({"elements": elements, **more})


def _device(**changes: Any) -> Device:
    """HomeRehab without what would hide the limit under test."""
    return load_device("homerehab").model_copy(update=changes)


def test_a_lone_spring_is_the_closed_form_at_the_worst_corner() -> None:
    device = _device(**UNLIMITED, **PROMPT)
    profile = optimise(device, _scene({"wall": {"stiffness": "max"}}))
    box = device.simultaneous_box()
    worst = min(
        float(
            largest(
                Loop.from_numbers(mass=m, damping=b, sample_time=1e-3, delay_samples=1), "stiffness"
            )
        )
        for m in box.mass
        for b in box.damping
    )
    wall = profile.elements["wall"]
    assert wall.stiffness == pytest.approx(worst / 2, rel=2e-5)
    assert wall.stiffness <= worst / 2
    assert wall.limited_by == {"stiffness": "delay-margin"}
    assert profile.method == {"wall": "closed form"}
    assert {"damping", "mass", "hand", "modes"} <= set(profile.skipped)


#: Enough damping for what a mass brings of it to make no step.
THICK = {"damping": 60.0}
#: Filters with which a mass is felt as one: two equal poles would lag too much.
EQUAL: dict[str, Any] = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}
PAIR: dict[str, Any] = EQUAL | {"filter_damping_ratio": 0.5}
#: A force that has to last so deep is not cut.
DEEP = {"penetration": 0.01}


def _limit(profile: SafeProfile, element: str, effect: EffectName) -> tuple[float, str]:
    entry = profile.elements[element]
    return getattr(entry, effect), entry.limited_by[effect]


HEAVY: dict[str, Any] = {"also": THICK, "loop": PAIR}
LEAST: dict[str, Any] = {"wish": "min", "loop": {"velocity_filter_hz": 60.0}}
LASTING: dict[str, Any] = {"also": DEEP, "device": PROMPT}
AT_ONCE: dict[str, Any] = {"device": UNLIMITED | PROMPT}


@pytest.mark.parametrize(
    ("effect", "word", "tight", "loose"),
    thinned(
        [
            ("mass", "ripple", HEAVY | {"ripple_limit": 0.12}, HEAVY | {"ripple_limit": 0.2}),
            ("damping", "wanted", {"wish": 10.0, "loop": PAIR}, {"wish": "max", "loop": PAIR}),
            ("stiffness", "range", {"wish": {"min": 100.0, "max": 300.0}}, {"wish": "max"}),
            ("damping", "gain-margin", LEAST, LEAST | {"margin": "firm"}),
            ("stiffness", "force", LASTING, LASTING | AT_ONCE),
            ("stiffness", "rendering", {"device": UNLIMITED}, AT_ONCE),
            ("stiffness", "delay-margin", AT_ONCE | {"margin": "conservative"}, AT_ONCE),
        ],
        4,
    ),
)
def test_each_limit_binds_and_relaxing_it_lets_the_value_grow(
    effect: EffectName, word: str, tight: dict[str, Any], loose: dict[str, Any]
) -> None:
    values: list[tuple[float, str]] = []
    for setting in (tight, loose):
        rest = dict(setting)
        device = _device(**rest.pop("device", {}))
        wish = rest.pop("wish", "max")
        thing = {**rest.pop("also", {}), effect: wish}
        profile = optimise(device, _scene({"thing": thing}, **rest))
        values.append(_limit(profile, "thing", effect))
    assert values[0][1] == word
    assert abs(values[1][0]) > abs(values[0][0]) * 1.05


@pytest.mark.parametrize(
    ("effects", "ripple", "word", "grows"),
    [
        (("damping", "mass"), 0.05, "ripple", True),
        (("stiffness", "damping"), 0.1, "rendering", False),
    ],
)
def test_two_effects_at_once_name_the_limit_that_binds_them(
    effects: tuple[str, str], ripple: float, word: str, grows: bool
) -> None:
    """A tenth more ripple raises their product if that is the limit, and not if it is another."""
    tight, loose = (
        optimise(
            _device(), _scene({"it": dict.fromkeys(effects, "max")}, ripple_limit=limit, loop=PAIR)
        ).elements["it"]
        for limit in (ripple, 1.1 * ripple)
    )
    assert set(tight.limited_by.values()) == {word}
    sizes = [[getattr(each, effect) for effect in effects] for each in (tight, loose)]
    more = float(np.prod(sizes[1]) / np.prod(sizes[0]))
    assert (more > 1.05) if grows else more == pytest.approx(1, abs=1e-4)


def test_a_stated_damper_of_less_than_a_step_is_kept_for_the_spring_that_it_holds() -> None:
    wanted = _scene({"it": {"stiffness": 150.0, "damping": 0.5}}, loop=EQUAL)
    held = optimise(load_device("stylus"), wanted).elements["it"]
    assert (held.stiffness, held.damping) == (150.0, 0.5)
    assert 0.99 < held.perceived_steps["damping"] < 1


def test_what_no_hand_could_tell_is_played_once_the_encoder_is_finer() -> None:
    """A coarse encoder leaves less than a step of mass, and all of the ripple to the damper."""
    scene = _scene({"it": {"damping": "max", "mass": "max"}}, loop=PAIR)
    coarse = optimise(_device(encoder_resolution=quantity(6e-5)), scene).elements["it"]
    assert coarse.limited_by["mass"] == "not-perceptible"
    assert coarse.mass == 0
    assert coarse.perceived_steps["damping"] >= 1
    fine = optimise(_device(encoder_resolution=quantity(6e-6)), scene).elements["it"]
    assert fine.limited_by["mass"] != "not-perceptible"
    assert fine.perceived_steps["mass"] >= 1


def test_homerehab_is_stiff_damped_and_heavy_at_once() -> None:
    """By least steps 69 N/m; differential evolution with `tests.felt` found 1300, 39 and 1.19."""
    scene = _scene(
        {"it": {"stiffness": "max", "damping": "max", "mass": "max", "penetration": 0.01}},
        loop=PAIR,
    )
    it = optimise(_device(), scene).elements["it"]
    assert it.stiffness >= 1300
    assert it.damping >= 40
    assert it.mass >= 1.2


def test_elements_together_are_certified_as_a_sum() -> None:
    alone = optimise(_device(), _scene({"wall": {"stiffness": "max", **DEEP}}))
    apart = {"wall": {"stiffness": "max", **DEEP}, "rail": {"stiffness": 500.0, **DEEP}}
    both = optimise(_device(), _scene(apart, together=[["wall", "rail"]]))
    assert both.elements["rail"].stiffness == 500.0
    assert both.elements["wall"].stiffness == pytest.approx(
        alone.elements["wall"].stiffness - 500.0, rel=1e-3
    )


def _vibrating(*modes: float) -> Device:
    """With lightly damped modes around these frequencies, Hz."""
    ratio = {"value": 0.03, "low": 0.02, "high": 0.04}
    stated = [
        {
            "frequency_hz": {"value": f, "low": 0.95 * f, "high": 1.05 * f},
            "damping_ratio": ratio,
            "at_encoder": 0.6,
            "at_handle": 0.5,
        }
        for f in modes
    ]
    return Device.model_validate({**dict(_device(**UNLIMITED)), "modes": stated})


def _stable_up_to(
    stiffness: float | None, added: float, *, mass: float, damping: float, late: float, **more: Any
) -> float:
    """The first gain of spring and damper at which a pole of a vibrating device leaves the circle.

    Infinity for none.
    """
    case = Case(
        mass=mass,
        damping=damping,
        sample_time=1e-3,
        delay_samples=1.0 + late,
        velocity_filter_hz=60.0,
        **more,
    )
    loop = loop_along(case, stiffness, added, None)
    first = min((float(each.mid()) for each in crossings(loop)), default=np.inf)
    assert stable_by_jury(loop.at(arb(min(first, 1.0) / 2)))
    return first


def test_what_vibrates_in_any_hand_keeps_its_margin_throughout_the_box() -> None:
    """What is claimed, at corners of device, mode and hand and between them, in 360 digits."""
    device = _vibrating(60.0)
    scene = _scene(
        {"water": {"damping": "max"}}, hand="free-to-rigid", loop={"velocity_filter_hz": 60.0}
    )
    profile = optimise(device, scene)
    assert profile.hand is not None
    water = profile.elements["water"]
    damping, box = water.damping, profile.certificate
    hand = [(each.low, each.high) for _, each in profile.hand]
    ends = [box.mass, box.damping, (57.0, 63.0), (0.02, 0.04), *hand]
    rng, nearest = np.random.default_rng(4), np.inf
    for part in [*rng.integers(0, 2, (8, len(ends))), *rng.random((8, len(ends)))]:
        m, b, f, z, *grip = (
            low + t * (high - low) for t, (low, high) in zip(part, ends, strict=True)
        )
        for late, gain, held in (
            (0.0, water.margins.gain, tuple(grip)),
            (0.0, water.margins.gain, (0.0, 0.0, 0.0)),
            (water.margins.extra_delay_samples, 1.0, tuple(grip)),
        ):
            true = {"mass": m, "damping": b, "late": late}
            modes = ((f, z, 0.6, 0.5),)
            first = _stable_up_to(None, damping, **true, modes=modes, hand=held)
            assert first > gain
            nearest = min(nearest, first / gain)
    assert nearest < 1 + 1e-3  # one of the corners is what limits it


@pytest.mark.parametrize(
    "elements",
    [
        {"water": {"damping": 90.0}},
        pytest.param(
            {
                "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
                "water": {"damping": 10.0},
            },
            marks=pytest.mark.long,
        ),
    ],
    ids="+".join,
)
def test_what_is_claimed_holds_where_one_mode_is_slow_and_another_quick(
    elements: dict[str, Any],
) -> None:
    """Such corners are found by the search for the worst point, and then are part of the region."""
    profile = optimise(_vibrating(45.0, 110.0), _scene(elements, loop={"velocity_filter_hz": 60.0}))
    box, chosen = profile.certificate, profile.elements.values()
    K, B = (sum(getattr(each, name) for each in chosen) for name in ("stiffness", "damping"))
    gain = max(each.margins.gain for each in chosen)
    extra = max(each.margins.extra_delay_samples for each in chosen)
    ranges = [each for mode in box.modes for each in (mode.frequency_hz, mode.damping_ratio)]
    nearest = np.inf
    for mass, damping, *modes in product(box.mass[:1], box.damping, *ranges):
        for late, least in ((0.0, gain), (extra, 1.0)):
            both = tuple((f, z, 0.6, 0.5) for f, z in zip(modes[::2], modes[1::2], strict=True))
            true = {"mass": mass, "damping": damping, "late": late}
            first = _stable_up_to(K or None, B, **true, modes=both)
            assert first > least
            if not late:
                nearest = min(nearest, first / gain)
    # Of a wall no more is claimed than is proved of its contact.
    assert nearest < (2 if "wall" in elements else 1.01)


def test_all_damping_may_be_taken_from_a_device_with_a_mode() -> None:
    """Up to half of its least, which leaves a pole at 1 - 7e-9: no rounding makes growth of it."""
    loop = {"velocity_filter_hz": 90.0, "acceleration_filter_hz": 26.7}
    scene = _scene({"feather": {"damping": "min"}}, loop=loop)
    profile = optimise(_vibrating(60.0), scene)
    (least, _), feather = profile.certificate.damping, profile.elements["feather"]
    assert 0.98 < -2 * feather.damping / least < 1
    assert feather.fade_time == 0.1


def test_an_element_that_is_not_proved_is_left_out_and_the_rest_tuned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A proof of contact that ends early stands for one that is too long."""
    monkeypatch.setattr("tune.certificate.absolute._MOST_CELLS", 50)
    wall = {"wall": {"stiffness": 2000.0, "damping": 20.0, "one_sided": True}}
    loop = {"velocity_filter_hz": 60.0}
    both = _scene({**wall, "water": {"damping": 10.0}}, loop=loop)
    profile = optimise(_vibrating(60.0), both)
    assert profile.elements["water"].damping == 10.0
    assert profile.elements["wall"].stiffness == profile.elements["wall"].damping == 0.0
    assert any("wall.stiffness dropped: it was not proved" in note for note in profile.notes)
    said: list[str] = []
    with pytest.raises(CheckFailedError, match="not proved stable with its clamps"):
        optimise(_vibrating(60.0), _scene(wall, loop=loop), progress=said.append)
    assert said.count("certifying") == 2  # the second time with all the slack there is


@pytest.mark.parametrize("seed", thinned(range(3), 1))
def test_devices_inside_the_box_are_stable_with_the_claimed_margins(seed: int) -> None:
    """Random devices, scenes and filters; 40 true devices inside each box."""
    rng = np.random.default_rng(seed)
    mass = 10 ** rng.uniform(-1.3, 1.3)
    damping = mass / 10 ** rng.uniform(-1, 0.5)
    step = float(rng.choice([5e-4, 1e-3, 2e-3]))
    spread = rng.uniform(0.01, 0.1)
    delay = int(rng.integers(0, 3)) * step
    near = known(mass, spread), known(damping, 2 * spread)
    device = device_of(*near, step=step, delay=delay, count=1e-6, force=1e8)
    scene = _scene(
        {
            "wall": {"stiffness": "max", "damping": "max"},
            "water": {"damping": float(damping)},
            "cup": {"mass": "max"},
            "light": {"mass": "min"},
        },
        together=[["wall", "water"]],
        ripple_limit=1.0,
        loop={"velocity_filter_hz": 0.05 / step, "acceleration_filter_hz": 0.03 / step},
    )
    profile = optimise(device, scene)
    box = device.simultaneous_box()
    last = profile.certificate.delay_samples[1]
    for combination in profile.combinations():
        felt = [profile.elements[name] for name in combination]
        sizes = [sum(getattr(each, effect) for each in felt) or None for effect in EFFECTS]
        for _ in range(40 if any(sizes) else 0):
            case = Case(
                mass=rng.uniform(*box.mass),
                damping=rng.uniform(*box.damping),
                sample_time=step,
                delay_samples=float(rng.uniform(last, last + 1)),
                velocity_filter_hz=0.05 / step,
                acceleration_filter_hz=0.03 / step,
            )
            ends = crossings(loop_along(case, *sizes))
            assert not ends or float(ends[0].mid()) > 2.0


@pytest.mark.parametrize(
    ("name", "effects"),
    [("homerehab", ("damping", "mass")), ("stylus", EFFECTS)],
)
def test_no_safe_trade_of_one_effect_for_another_has_a_larger_product(
    name: str, effects: tuple[EffectName, ...]
) -> None:
    """Five per cent more of one, as much less of another as leaves half a per cent more steps."""
    device, filters = load_device(name), PAIR if name == "homerehab" else EQUAL
    profile = optimise(device, _scene({"it": dict.fromkeys(effects, "max")}, loop=filters))
    it = profile.elements["it"]
    scales = {e: Scale.of(e, device, default_table(), it.motion) for e in effects}

    pair = [Scale.of(e, device, default_table(), it.motion) for e in ("damping", "mass")]

    def faults(sizes: dict[EffectName, float]) -> list[str]:
        found = audit(device, Effects(**sizes), filters=Filters(**filters)).faults
        every = dict.fromkeys(EFFECTS, 0.0) | sizes
        return [each.limit for each in found] + beyond(
            device,
            felt(device, profile.loop, **every),
            every["damping"],
            every["mass"],
            weber=(pair[0].weber, pair[1].weber),
            floors=(pair[0].floor, pair[1].floor),
        )

    sizes: dict[EffectName, float] = {effect: getattr(it, effect) for effect in effects}
    assert faults(sizes) == []
    for more, less in permutations(effects, 2):
        raised = scales[more].steps(1.05 * sizes[more]) / scales[more].steps(sizes[more])
        left = scales[less].steps(sizes[less]) * 1.005 / raised
        traded: dict[EffectName, float] = {
            more: 1.05 * sizes[more],
            less: scales[less].value_at(left, 1),
        }
        assert faults(sizes | traded) != [], traded


class _Slow:
    """The precision of balls, of which each change lets other threads go on."""

    @property
    def prec(self) -> int:
        return ctx.prec

    @prec.setter
    def prec(self, bits: int) -> None:
        ctx.prec = bits
        time.sleep(1e-3)


def test_threads_find_what_one_finds_and_leave_the_precision_of_balls_as_it_was() -> None:
    """Each has a damper of its own: what one has proved is remembered."""
    device, before = load_device("homerehab"), ctx.prec
    waters = [{"elements": {"water": {"damping": 10.0 + each}}} for each in range(3)]
    scenes = [Scene.model_validate(each) for each in waters]
    with mock.patch("tune.certificate.poles.ctx", _Slow()), ThreadPoolExecutor(3) as threads:
        found = [*threads.map(lambda each: optimise(device, each).digest, scenes)]
    after, ctx.prec = ctx.prec, before
    assert after == before
    assert found == [optimise(device, each).digest for each in scenes]
