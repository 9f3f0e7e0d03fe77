"""Walls as one clamp round spring and damper: how stiff, proved how far, and played."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from identification import Device, ForceLimit, Mode, load_device, quantity
from tests.wall_axis import Axis
from tests.wall_play import Array, Bench, Gate, Law
from tune import CheckFailedError, NoFeasibleEffectError, SafeProfile, Scene, optimise
from tune.certificate.certify import certify
from tune.documents.profile import AbsoluteStability, Channel, Design, Multiplier

WALL = {"stiffness": "max", "damping": "max", "one_sided": True}
#: N/m or N·m/rad that one wall reaches at least, both effects as large as can be.
STIFF = {"homerehab": 16_000.0, "stylus": 1_000.0, "knob": 1.3, "emps": 1.0e6}
Complex = NDArray[np.complex128]


def scene(**elements: object) -> Scene:
    return Scene.model_validate({"elements": elements})


def tuned(device: str | Device, wanted: Scene) -> SafeProfile:
    return optimise(load_device(device) if isinstance(device, str) else device, wanted)


def response(mass: float, damping: float, step: float, samples: float, theta: Array) -> Complex:
    """Position over a held force: the step response t/b - (m/b²)(1 - e^(-bt/m)), sampled late."""
    whole = int(np.floor(samples))
    late = samples - whole
    z, pole = np.exp(1j * theta), np.exp(-damping * step / mass)

    def moved(time: float) -> Complex:
        """Σ over k of the step response at (k + 1)T - time, times z^-(k+1), times (1 - 1/z)."""
        first = step - time
        ramp = (first + step / (z - 1)) / damping
        decay = mass / damping**2 * np.exp(-damping * first / mass)
        rest = -mass / damping**2 + decay * (z - 1) / (z - pole)
        return (ramp + rest) / z

    return moved(late * step) * z ** -float(whole)


def law(
    stiffness: float, damping: float, hertz: float | None, step: float, theta: Array
) -> Complex:
    z = np.exp(1j * theta)
    pole = 0.0 if hertz is None else np.exp(-2 * np.pi * hertz * step)
    return np.asarray(stiffness + damping * (1 - pole) * (z - 1) / (step * (z - pole)), complex)


def half_plane(loops: list[Complex], theta: Array) -> bool:
    """Whether one FIR multiplier makes Re{M·(1 + H)} positive in all loops: a linear program."""
    ladder = np.array([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 30])
    taps = 1 - np.exp(-1j * np.outer(theta, ladder))
    rows = np.concatenate([(taps * (1 + loop)[:, None]).real for loop in loops])
    rows /= np.abs(rows).mean(axis=1, keepdims=True)
    found = linprog(
        np.append(np.zeros(ladder.size), -1.0),
        A_ub=np.hstack([-rows, np.ones((len(rows), 1))]),
        b_ub=np.zeros(len(rows)),
        A_eq=np.append(np.ones(ladder.size), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * ladder.size + [(None, None)],
    )
    return found.x is not None and bool(found.success and found.x[-1] > 0)


def partly_open(theta: Array) -> Gate:
    """A gate that passes so much of the damper and no inertia."""

    def gate(k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
        return theta * np.ones_like(damper), 0 * inertia

    return gate


def corner_loops(profile: SafeProfile, gain: float, theta: Array) -> list[Complex]:
    seal, wall = profile.certificate, profile.elements["wall"]
    step, extra = profile.loop.sample_time, seal.extra_delay_samples
    spoken = law(wall.stiffness, wall.damping, profile.loop.velocity_filter_hz, step, theta)
    return [
        gain * spoken * response(mass, damping, step, samples, theta)
        for mass, damping, samples in product(
            seal.mass, seal.damping, (seal.delay_samples[0], seal.delay_samples[1] + extra)
        )
    ]


@pytest.mark.parametrize("name", STIFF)
def test_walls_are_as_stiff_as_makers_render_them(name: str) -> None:
    """And a linear program of its own over 2 000 frequencies says of the corners what is proved."""
    profile = tuned(name, scene(wall=WALL))
    wall = profile.elements["wall"]
    assert wall.stiffness >= STIFF[name]
    assert (profile.certificate.gain, profile.certificate.extra_delay_samples) == (2.0, 1.0)
    assert wall.margins.gain <= (wall.margins.absolute_gain or 0.0)
    assert wall.limited_by["stiffness"] in {"delay-margin", "ripple"}
    slowest = 0.03 * profile.certificate.damping[0] * profile.loop.sample_time
    theta = np.geomspace(slowest / profile.certificate.mass[1], np.pi, 2000)
    assert half_plane(corner_loops(profile, 2.0, theta), theta)
    if wall.limited_by["stiffness"] == "delay-margin":
        assert not half_plane(corner_loops(profile, 2.04, theta), theta)


@pytest.mark.parametrize("name", STIFF)
def test_a_wall_gives_more_than_its_lag_takes_and_keeps_to_its_lead(name: str) -> None:
    device, profile = load_device(name), tuned(name, scene(wall=WALL))
    wall = profile.elements["wall"]
    latest = device.delay.high + 1.5 * device.sample_time.high
    usual = device.delay.value + 0.5 * device.sample_time.value
    assert wall.damping >= latest * wall.stiffness * (1 - 1e-4)
    most = 1e-3 if device.motion == "linear" else 1e-2
    assert wall.motion.speed * (wall.damping / wall.stiffness - usual) <= most * (1 + 1e-4)
    assert wall.contact is not None
    assert wall.contact.net_damping == pytest.approx(
        wall.damping - latest * wall.stiffness, abs=1e-3 * wall.damping
    )


def test_a_longer_lead_allows_more_damping_and_a_shorter_one_less() -> None:
    dampings = [
        tuned("homerehab", scene(wall={**WALL, "lead": lead})).elements["wall"].damping
        for lead in (2e-4, 1e-3)
    ]
    assert dampings[0] < dampings[1]


def test_stiffness_counts_first_and_gives_up_half_a_step_at_most() -> None:
    fixed = {"loop": {"velocity_filter_hz": 50.0}}
    most, alone = (
        optimise(
            load_device("homerehab"), Scene.model_validate({"elements": {"wall": wall}, **fixed})
        ).elements["wall"]
        for wall in ({**WALL, "damping": {"min": 55.0, "max": 75.0}}, WALL)
    )
    # More damping than 75 N·s/m was worth less than half a step of stiffness.
    assert alone.damping > 75
    lost = most.perceived_steps["stiffness"] - alone.perceived_steps["stiffness"]
    assert lost < 0.5 + 1e-3


def test_what_a_wall_meets_costs_it_only_what_it_must() -> None:
    """Beside all the elements of the demo on a device that is known to 1 and 6 per cent."""
    others: dict[str, object] = {
        "water": {"damping": 10.0},
        "cup": {"mass": "max", "damping": 30.0},
        "rubber": {"stiffness": {"min": 200.0, "max": 1500.0}},
        "feather": {"mass": "min", "damping": 20.0},
    }
    profile = tuned("homerehab", scene(wall=WALL, **others))
    assert profile.elements["wall"].stiffness > 4_000
    proved = profile.certificate.absolute_stability or {}
    assert {f"wall + {name}" for name in others} == set(proved)
    assert [c.name for c in (proved["wall + rubber"].free or Multiplier(channels=())).channels] == [
        "wall",
        "rubber",
    ]
    # Levels of springs that may push at once sum to the peak force.
    wall, rubber = profile.elements["wall"], profile.elements["rubber"]
    assert wall.force_level + rubber.force_level == pytest.approx(28.0)


def test_pairs_that_are_apart_are_not_proved_and_cost_nothing() -> None:
    elements = {"wall": WALL, "feather": {"mass": "min", "damping": 20.0}}
    beside, apart = (
        optimise(load_device("homerehab"), Scene.model_validate({"elements": elements, **more}))
        for more in ({}, {"apart": [["wall", "feather"]]})
    )
    assert apart.elements["wall"].stiffness > STIFF["homerehab"]
    assert apart.elements["wall"].stiffness > 1.2 * beside.elements["wall"].stiffness
    assert ("wall", "feather") in beside.moments()
    assert ("wall", "feather") not in apart.moments()


def test_what_no_wall_can_meet_is_kept_apart_and_said_so() -> None:
    """A block whose damper is far stronger than a wall's: two clamps of unlike signals."""
    block = {"stiffness": "max", "damping": "max", "mass": "max"}
    profile = tuned("homerehab", scene(block=block, wall=WALL))
    assert profile.apart == (("block", "wall"),)
    assert any(note.startswith("kept apart: block and wall") for note in profile.notes)
    assert profile.elements["wall"].stiffness > STIFF["homerehab"]


def test_pairs_that_no_wall_can_meet_are_each_told_once() -> None:
    """Two springs with a mass on the stylus: the first pair apart leaves the second."""
    told: list[str] = []
    wishes = {
        "wall": WALL,
        "thing": {"stiffness": "max", "damping": "max", "mass": "max"},
        "load": {"stiffness": "max", "mass": "max"},
    }

    def say(words: str) -> None:
        told.extend([words] if "cannot be met" in words else [])
        assert len(told) <= 2, told

    profile = optimise(load_device("stylus"), scene(**wishes), progress=say)
    assert profile.apart == (("wall", "load"), ("wall", "thing"))
    assert profile.elements["wall"].stiffness > STIFF["stylus"]


def proof_failures(design: Design, witnesses: dict[str, AbsoluteStability]) -> list[str]:
    """What `certify` says of clamps."""
    try:
        certify(design, 4_000, witnesses)
    except CheckFailedError as error:
        return [
            each
            for each in error.failures
            if "clamps" in each or "absolute_stab" in each or "multiplier" in each
        ]
    return []


@pytest.fixture(scope="module")
def wet() -> SafeProfile:
    """A wall beside a damper that may be switched."""
    elements = {"wall": WALL, "water": {"damping": 10.0}}
    return optimise(load_device("homerehab"), Scene.model_validate({"elements": elements}))


def stated(profile: SafeProfile) -> dict[str, AbsoluteStability]:
    return dict(profile.certificate.absolute_stability or {})


def with_claim(profile: SafeProfile, moment: str, **update: object) -> dict[str, AbsoluteStability]:
    found = stated(profile)
    return found | {moment: found[moment].model_copy(update=update)}


@pytest.mark.parametrize("beside", [None, "water", "cup"])
def test_half_a_per_cent_beyond_what_a_clamp_is_proved_for_is_refused(beside: str | None) -> None:
    """Of the wall alone, beside a damper that is switched and beside a mass that fades."""
    wall = {"stiffness": 8000.0, "damping": 60.0, "one_sided": True}
    elements = {"wall": wall, "water": {"damping": 30.0}, "cup": {"mass": 0.8, "damping": 20.0}}
    chosen = {name: each for name, each in elements.items() if name in {"wall", beside}}
    profile = optimise(load_device("homerehab"), Scene.model_validate({"elements": chosen}))
    moment = "wall" if beside is None else f"wall + {beside}"

    def proved(gain: float) -> bool:
        return not proof_failures(profile, with_claim(profile, moment, gain=gain))

    edge, beyond = 2.0, 8.0
    while beyond > edge * 1.004:
        middle = float(np.sqrt(edge * beyond))
        edge, beyond = (middle, beyond) if proved(middle) else (edge, middle)
    assert proved(edge * 0.995)
    assert not proved(edge * 1.005)


@pytest.mark.parametrize(
    ("update", "words"),
    [
        ({"gain": 1.99}, "says a gain of 1.99"),
        ({"extra_delay_samples": 0.0}, "with 0 extra samples"),
        ({"free": None}, "no multiplier is stated"),
    ],
)
def test_a_false_claim_of_a_clamp_is_refused(
    wet: SafeProfile, update: dict[str, object], words: str
) -> None:
    failures = proof_failures(wet, with_claim(wet, "wall + water", **update))
    assert any(words in each for each in failures)


def test_channels_are_those_of_the_moment(wet: SafeProfile) -> None:
    whole = stated(wet)["wall + water"].free
    assert whole is not None
    fewer = Multiplier(channels=whole.channels[:1])
    failures = proof_failures(wet, with_claim(wet, "wall + water", free=fewer))
    assert any("not of wall, damping" in each for each in failures)


def test_a_constant_in_a_free_clamp_and_a_held_multiplier_without_a_hand_are_refused(
    wet: SafeProfile,
) -> None:
    (moment,) = stated(wet)
    free = stated(wet)[moment].free
    assert moment == "wall + water"
    assert free is not None
    channel, damping = free.channels
    lifted = Multiplier(channels=(channel.model_copy(update={"constant": 0.1}), damping))
    assert proof_failures(wet, with_claim(wet, moment, free=lifted))
    assert proof_failures(wet, with_claim(wet, moment, held=lifted))
    assert proof_failures(wet, {})
    nothing = Multiplier(channels=(Channel(name="wall"), damping))
    assert proof_failures(wet, with_claim(wet, moment, free=nothing))


class Clamped(Bench):
    """Devices under -clamp(K·y + B·v + M·a), and a damper beside it that a gate switches."""

    beside: float | Array = 0.0

    def command(self, y: Array, damper: Array, inertia: Array) -> Array:
        law = self.law
        speed = self._estimates(y)[0]
        low = np.where(law.one_sided, 0.0, -np.asarray(law.peak))
        whole = law.stiffness * y + law.damping * speed
        theta = damper / np.where(law.damping * speed == 0, 1.0, law.damping * speed)
        return -np.clip(whole, low, law.peak) - theta * self.beside * speed


def played(
    profile: SafeProfile, members: int, seed: int, *, beside: float = 0.0
) -> tuple[Clamped, Array, Array]:
    """A wall at random corners, gains and delays up to the margin's, released before it.

    Returns:
        (the bench at the end, energy at first, the most in the last tenth), J, (members,).
    """
    generator = np.random.default_rng(seed)
    seal, wall = profile.certificate, profile.elements["wall"]
    hertz, step = profile.loop.velocity_filter_hz, profile.loop.sample_time
    gain = generator.uniform(0.05, seal.gain, members)
    last = seal.delay_samples[1] + seal.extra_delay_samples
    axis = Axis(
        mass=generator.choice(seal.mass, members),
        damping=generator.choice(seal.damping, members),
        sample_time=step,
        delay_samples=generator.uniform(seal.delay_samples[0], last, members),
    )
    bench = Clamped(
        axis,
        Law(
            stiffness=gain * wall.stiffness,
            damping=gain * wall.damping,
            velocity_pole=0.0 if hertz is None else float(np.exp(-2 * np.pi * hertz * step)),
            one_sided=1.0,
            peak=gain * wall.force_level,
        ),
        members,
    )
    bench.beside = gain * beside
    speed = wall.motion.speed * generator.uniform(0.1, 3.0, members)
    bench.start(-2 * speed * wall.damping / wall.stiffness - 3 * speed * step, speed)
    mass = np.asarray(bench.axis.mass)
    first = mass * speed**2 / 2
    open_ = np.ones(members)
    most = np.zeros(members)
    count = 4000
    for k in range(count):
        open_ = np.where(generator.random(members) < 0.05, 1 - open_, open_)
        bench.step(k, partly_open(open_))
        if k > 0.9 * count:
            most = np.maximum(most, mass * bench.pace() ** 2 / 2)
    return bench, first, most


@pytest.mark.parametrize("name", STIFF)
def test_a_free_device_leaves_a_wall_no_faster_than_it_came(name: str) -> None:
    _, first, most = played(tuned(name, scene(wall=WALL)), 60, 7)
    assert np.all(most <= first)


def test_a_damper_switched_beside_a_wall_does_not_pump(wet: SafeProfile) -> None:
    _, first, most = played(wet, 60, 8, beside=wet.elements["water"].damping)
    assert np.all(most <= first)


def random_device(seed: int, *, modes: bool) -> tuple[Device, Scene]:
    """0.05 to 100 kg, 0.2 to 2 ms, up to two samples of delay; a mode, a lag or both."""
    rng = np.random.default_rng([28, seed])
    mass = float(10 ** rng.uniform(-1.3, 2))
    damping = mass / float(10 ** rng.uniform(-1.3, 0.48))
    step = float(rng.choice([2e-4, 5e-4, 1e-3, 2e-3]))
    spread = float(rng.choice([0.0, 0.01, 0.05]))
    delay, strength = float(rng.choice([0, 0.5, 1, 1, 2])) * step, float(10 ** rng.uniform(0.5, 2))
    more: dict[str, object] = {}
    if modes and seed % 3 != 1:
        f = min(float(rng.uniform(20, 300)), 0.4 / step)
        ratio, share = float(10 ** rng.uniform(-2.3, -1)), float(rng.uniform(0.05, 0.5))
        more["modes"] = (
            Mode(
                frequency_hz=quantity(f, f * 0.98, f * 1.02),
                damping_ratio=quantity(ratio, ratio * 0.9, ratio * 1.1),
                at_encoder=share,
                at_handle=share,
            ),
        )
    if modes and seed % 3 != 0:
        lag = float(rng.uniform(0.1, 1.0)) * step
        more["current_lag"] = quantity(lag, lag * 0.9, lag * 1.1)
    device = Device.model_validate(
        {
            "motion": "linear",
            "mass": quantity(mass, mass * (1 - spread), mass * (1 + spread)),
            "damping": quantity(damping, damping * (1 - 2 * spread), damping * (1 + 2 * spread)),
            "sample_time": quantity(step),
            "delay": quantity(delay),
            "coulomb_friction": quantity(float(rng.uniform(0, 1.0))),
            "encoder_resolution": quantity(float(10 ** rng.uniform(-6.5, -5))),
            "force_limit": ForceLimit(continuous=strength, peak=2 * strength),
            **more,
        }
    )
    wanted = Scene.model_validate(
        {
            "margin": str(rng.choice(["conservative", "balanced", "firm"])),
            "ripple_limit": float(rng.choice([0.02, 0.1, 0.5])),
            "elements": {"wall": WALL},
        }
    )
    return device, wanted


def stiffest(device: Device, wanted: Scene, profile: SafeProfile) -> float:
    """The largest stiffness beside as much damping, by a grid that closes in, of linear limits."""
    from tune import Filters
    from tune.documents.perception import default_table
    from tune.optimisation.feasibility import feasible_points
    from tune.optimisation.problem import DesignTask, pose

    task = DesignTask.of(device, wanted, default_table())
    filters = Filters(velocity_filter_hz=profile.loop.velocity_filter_hz)
    problem = pose(task, elements=["wall"], filters=filters, cut=frozenset({"wall"}))
    wall = profile.elements["wall"]
    steepest = np.linspace(*problem.linear.leads[0][2:], 40)
    sizes: Array = np.geomspace(wall.stiffness / 2, 3 * wall.stiffness, 60)
    best = 0.0
    for width in (0.06, 0.015, 0.004):
        K, ratio = (each.ravel() for each in np.meshgrid(sizes, steepest, indexing="ij"))
        points = np.stack([K, K * ratio], axis=1)
        good = feasible_points(problem, points) & (points[:, 1] >= wall.damping * (1 - 1e-6))
        if not good.any():
            break
        best = max(best, float(K[good].max()))
        sizes = np.linspace(best, best * (1 + width), 30)
    return best


def compared(seeds: range, *, modes: bool) -> Iterator[tuple[int, float]]:
    """(seed, stiffness over that of the search) of devices that can have a wall that damps."""
    for seed in seeds:
        device, wanted = random_device(seed, modes=modes)
        try:
            profile = optimise(device, wanted)
        except NoFeasibleEffectError:
            continue
        wall = profile.elements["wall"]
        if wall.damping:
            best = stiffest(device, wanted, profile)
            yield seed, wall.stiffness / best if best else 1.0


def test_tuned_walls_are_as_stiff_as_linear_limits_allow() -> None:
    parts = dict(compared(range(0, 150, 25), modes=False))
    assert len(parts) >= 4
    assert min(parts.values()) >= 0.95


@pytest.mark.long
def test_tuned_walls_of_150_rigid_devices_are_as_stiff_as_linear_limits_allow() -> None:
    parts = dict(compared(range(150), modes=False))
    assert len(parts) >= 135
    assert min(parts.values()) >= 0.95, parts


@pytest.mark.long
def test_tuned_walls_of_150_devices_with_modes_or_lag_are_nearly_as_stiff() -> None:
    parts = dict(compared(range(150), modes=True))
    assert len(parts) >= 130
    values = np.array(list(parts.values()))
    assert values.min() >= 0.65, parts
    assert np.mean(values >= 0.95) >= 2 / 3


@pytest.mark.long
def test_a_hundred_thousand_plays_of_tuned_walls_do_not_grow() -> None:
    count = 0
    for seed in range(100):
        device, wanted = random_device(seed, modes=False)
        try:
            profile = optimise(device, wanted)
        except NoFeasibleEffectError:
            continue
        _, first, most = played(profile, 1200, seed)
        assert np.all(most <= first * (1 + 1e-9)), seed
        count += first.size
    assert count >= 100_000
