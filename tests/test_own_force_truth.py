"""Random devices with a force of their own by position: every verdict against an n-state truth."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Controller, rehearse, rig_of
from identification import as_stored, load_device, quantity
from tests.optimum_wishes import felt_ends, wanted_of
from tests.own_force_cases import OwnForceCase, Triple, draw_case, scaled, stable, unstable_gain
from tests.sampled_bench import SampledBench
from tests.simulated.experiment import EFFECTS
from tune import NoFeasibleEffectError, Scene, optimise
from tune.certificate.poles import judge
from tune.certificate.region import ModePoint, Point, Setting
from tune.documents.profile import HandPlace
from tune.documents.scene import FREE_TO_RIGID, Effects
from tune.judging import Audit, audit
from tune.loop.loop import Filters, Loop
from tune.stability.verdict import is_stable

#: The balanced margin.
GAIN = 2.0
#: Gains are compared up to here, and to this part.
MOST, CLOSE = 4.0, 1e-5
#: A rehearsal compares two parts of this length, s; it tells decay to so much of what was before,
#: and growth by so many times, from whatever little a slow pole begins with.
PART, DECAYS, GROWS = 0.9, 0.2, 100.0


def some(*few: int) -> list[Any]:
    """200 cases, of which these few belong to the default set."""
    return [
        pytest.param(seed, marks=() if seed in few else pytest.mark.long) for seed in range(200)
    ]


def effects_of(sizes: Triple) -> Effects:
    """Sizes of zero as effects that are absent."""
    return Effects(**{name: size or None for name, size in zip(EFFECTS, sizes, strict=True)})


def filters_of(case: OwnForceCase, sizes: Triple) -> Filters:
    """Those that the sizes use."""
    return Filters(
        velocity_filter_hz=case.velocity_filter_hz if sizes[1] else None,
        acceleration_filter_hz=case.acceleration_filter_hz if sizes[2] else None,
    )


def judged(case: OwnForceCase) -> Audit:
    """The audit of a case's sizes."""
    return audit(case.device, effects_of(case.ray), filters=filters_of(case, case.ray))


def refused_for_a_reason(case: OwnForceCase) -> bool:
    """Whether some device of the box is not stable on its own."""
    return any(bench.radii((0.0, 0.0, 0.0), np.zeros(1))[0] > 1 for bench in case.corners())


@pytest.mark.parametrize("seed", some(0, 1))
def test_an_audit_says_what_is_true(seed: int) -> None:
    case = draw_case(seed)
    found = judged(case)
    limits = [fault.limit for fault in found.faults]
    if not case.balanced:
        assert limits[0] == "device"
        assert refused_for_a_reason(case)
        return
    assert "device" not in limits
    benches = list(case.corners())
    now = min(unstable_gain(bench, case.ray, MOST) for bench in benches)
    late = min(
        unstable_gain(replace(bench, delay=bench.delay + part * bench.sample_time), case.ray, MOST)
        for bench in benches
        for part in (0.5, 1.0)
    )
    assert min(found.gain, MOST) == pytest.approx(min(now, MOST), rel=CLOSE)
    assert found.safe == (min(now, late) > GAIN), limits
    if found.safe:
        within = case.somewhere(np.random.default_rng(seed), 12)
        assert all(stable(bench, case.ray, GAIN) for bench in within if bench.hand[2] == 0)
    else:
        assert limits[0] in {"stability", "gain-margin", "delay-margin"}


@pytest.mark.parametrize("seed", some(*range(12)))
def test_loop_and_certificate_judge_one_device_alike(seed: int) -> None:
    """Its own force of either sign, gravity where the position is zero, with a hand and without."""
    case = draw_case(seed)
    chance = np.random.default_rng(seed)
    grip = FREE_TO_RIGID["linear"] if seed % 2 else None
    sizes = scaled(case.ray, float(chance.uniform(0.2, 3)))
    bench = case.bench()
    if grip is not None:
        grips = grip.mass.value, grip.damping.value, grip.stiffness.value
        bench = replace(bench, hand=grips)
    radius = float(bench.radii(sizes, np.ones(1))[0])
    filters = filters_of(case, sizes)
    loop = Loop.from_parts(case.device, filters, grip)
    assert bool(is_stable(loop, effects_of(sizes))) == (radius < 1)
    point = Point(
        mass=bench.mass,
        damping=bench.damping,
        sample_time=bench.sample_time,
        delay_samples=bench.delay / bench.sample_time,
        modes=tuple(
            ModePoint(frequency_hz=f, damping_ratio=z, at_encoder=e, at_handle=h)
            for f, z, e, h in bench.modes
        ),
        hand=None
        if grip is None
        else HandPlace(mass=bench.hand[0], damping=bench.hand[1], stiffness=bench.hand[2]),
        current_lag=bench.current_lag,
        position_stiffness=bench.own_stiffness,
    )
    setting = Setting(
        stiffness=sizes[0],
        damping=sizes[1],
        mass=sizes[2],
        velocity_filter_hz=filters.velocity_filter_hz,
        acceleration_filter_hz=filters.acceleration_filter_hz,
    )
    verdict = judge(point, setting, 1.0)
    assert verdict.radius == pytest.approx(radius, abs=1e-7)
    assert (verdict.answer == "stable") == stable(bench, sizes, 1.0)


@pytest.mark.parametrize("seed", some(1, 2))
def test_what_is_tuned_is_stable_and_what_is_refused_is_not(seed: int) -> None:
    case = draw_case(seed)
    played = ("stiffness", "damping", "mass")[seed % 3]
    scene = Scene.model_validate(
        {
            "hand": "free-to-rigid" if case.hand else "none",
            "loop": {
                "velocity_filter_hz": case.velocity_filter_hz or "none",
                "acceleration_filter_hz": case.acceleration_filter_hz or "none",
            },
            "elements": {"one": {played: "max"}},
        }
    )
    if not case.balanced:
        with pytest.raises(NoFeasibleEffectError, match=r"device: (position_stiffness|gravity)"):
            optimise(case.device, scene)
        assert refused_for_a_reason(case)
        return
    try:
        profile = optimise(case.device, scene)
    except NoFeasibleEffectError as error:
        # Less than a step can be told: so small a size, and a little more loses its margin.
        (reason,) = error.reasons
        size = re.match(rf"one\.{played}: (\S+) would be 0\.\d+ of a step", reason)
        assert size, reason
        largest = [1.05 * float(size[1]) if name == played else 0.0 for name in EFFECTS]
        if reason.endswith("limited by rendering"):
            # A little more would bring or take more than a step of what is not asked for.
            filters = (case.velocity_filter_hz, case.acceleration_filter_hz)
            wanted = list(wanted_of(case.device, "one", scene.elements["one"], GAIN, filters))
            ends = felt_ends(case.device, wanted, filters, scene.elements)
            for size, binds in ((max(largest), True), (max(largest) / 1.06, False)):
                sizes = np.array([size])
                assert (max(end.row(sizes) @ sizes for end in ends) > 1) == binds
            return
        worst = [*case.corners(), *case.grasped()]
        late = [replace(bench, delay=bench.delay + bench.sample_time) for bench in worst]
        beyond = (largest[0], largest[1], largest[2])
        assert not all(stable(bench, beyond, GAIN) for bench in [*worst, *late])
        return
    one = profile.elements["one"]
    sizes = one.stiffness, one.damping, one.mass
    assert any(sizes)
    where = case.somewhere(np.random.default_rng(seed), 16)
    assert all(stable(bench, sizes, GAIN) for bench in where)
    if set(one.limited_by.values()) & {"gain-margin", "delay-margin"} and not case.hand:
        late = [replace(b, delay=b.delay + b.sample_time) for b in case.corners()]
        beyond = scaled(sizes, 1.01)
        assert not all(stable(bench, beyond, GAIN) for bench in [*case.corners(), *late])


@pytest.mark.parametrize("seed", some(0, 5))
def test_a_rehearsal_settles_where_the_loop_does(seed: int) -> None:
    """At a third of the gain at which stability ends and beyond it, where time enough is left."""
    case = draw_case(seed)
    bench = case.bench()
    if case.kind in {"gravity", "none"}:
        pytest.skip("no force of its own, or none that makes one loop: gravity changes its slope")
    alike = replace(bench, own_stiffness=abs(bench.own_stiffness))
    tried = np.array([0.3, 1.3]) * min(10.0, unstable_gain(alike, case.ray, 10.0))
    mass = case.device.mass.value
    # Without a quantiser: what it sustains is no matter of the linear loop.
    rig = rig_of(case.device.model_copy(update={"encoder_resolution": None, "force_limit": None}))
    sizes = np.outer(tried, case.ray)
    rehearsals = rehearse(
        rig,
        Controller(
            stiffness=sizes[:, 0],
            damping=sizes[:, 1],
            mass=sizes[:, 2],
            velocity_filter_hz=case.velocity_filter_hz or np.inf,
            acceleration_filter_hz=case.acceleration_filter_hz or np.inf,
        ),
        duration=1.0,
        reach=0.005,
        push=mass,
        force_allowed=0.1 * mass,
    )
    for gain, rehearsal in zip(tried.tolist(), rehearsals, strict=True):
        radius = float(bench.radii(case.ray, np.array([gain]))[0])
        left = radius ** (PART / bench.sample_time)
        if left < DECAYS and stable(bench, scaled(case.ray, gain), 2.0):
            assert rehearsal.settles, rehearsal.vetoes[0].reason
        elif left > GROWS:
            assert not rehearsal.settles


def test_a_wall_that_does_not_hold_what_pushes_away() -> None:
    """HomeRehab with -500 N/m of its own and a wall of 300 N/m: a pole of modulus 1.005."""
    plain = load_device("homerehab")
    pushed = as_stored(plain.model_copy(update={"position_stiffness": quantity(-500.0)}))
    wall = (300.0, 0.0, 0.0)
    bench = SampledBench(
        mass=plain.mass.value,
        damping=plain.damping.value,
        sample_time=plain.sample_time.value,
        delay=plain.delay.value,
        own_stiffness=-500.0,
    )
    radius = float(bench.radii(wall, np.ones(1))[0])
    assert radius == pytest.approx(1.0067, abs=3e-4)
    loop = Loop.from_parts(pushed)
    assert not is_stable(loop, effects_of(wall))
    assert is_stable(Loop.from_parts(plain), effects_of(wall))
    found = audit(pushed, effects_of(wall))
    assert found.faults[0].limit == "device"
    assert found.gain == 0
    with pytest.raises(NoFeasibleEffectError, match="-500 to -500 N/m"):
        optimise(pushed, Scene.model_validate({"elements": {"wall": {"stiffness": 300.0}}}))
    (played,) = rehearse(rig_of(pushed), Controller(stiffness=300.0), duration=0.5)
    assert played.vetoes[0].verdict == "diverges"
