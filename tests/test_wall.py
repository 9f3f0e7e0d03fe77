"""Clamps, what may change of them while they act, and the energy brought to a wall."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from datasets_synthetic import (
    Calls,
    Controller,
    Element,
    Hand,
    Recording,
    Rig,
    Vibration,
    named_rig,
    simulate,
)
from datasets_synthetic.law import ADVERSE, NOBODY, RANDOM, ControlLaw
from tests.sampled_bench import SampledBench

FloatArray = NDArray[np.float64]

T = 0.001
DEVICES = ("homerehab", "stylus", "knob", "emps")
#: Mass, damper and spring of a hand that suits the device.
GRIP = {"homerehab": (0.4, 5.0, 300.0), "stylus": (0.02, 0.3, 20.0)}
GRIP |= {"knob": (2e-5, 5e-4, 0.02), "emps": (1.0, 20.0, 1000.0)}


def plain(damping: float = 0.0) -> Rig:
    return Rig(mass=2.0, damping=damping, sample_time=T)


def contacts(
    rig: Rig, controller: Controller, *, push: Any, drop: Any, samples: int = 4000, **more: Any
) -> tuple[list[FloatArray], Recording]:
    """Energy brought to each contact with a wall, J, by member, and the recording of the falls.

    A constant push carries each handle from rest into its wall, again and again; its work beyond
    the face is taken off.
    """
    place = float(np.max(controller.place))
    batch = max(rig.batch, controller.size(), np.size(push), np.size(drop))
    log = simulate(
        rig,
        np.zeros(samples),
        controller=controller,
        position=place - drop,
        push=np.broadcast_to(np.reshape(push, (-1, 1)), (batch, samples)),
        watch=True,
        **more,
    )
    assert log.truth is not None
    net = np.broadcast_to(push - rig.force_offset, (batch,))
    inside = log.position > place
    energies: list[FloatArray] = []
    for member in range(batch):
        entered = np.flatnonzero(inside[member, 1:] & ~inside[member, :-1]) + 1
        beyond = log.truth.handle[member][entered] - place
        energies.append(log.truth.energy[member][entered] - net[member] * beyond)
    return energies, log


def ratios(energy: FloatArray, floor: float = 0.0) -> FloatArray:
    """Energy of every contact but the first, less a floor, over the most of any before."""
    return (energy[1:] - floor) / np.maximum.accumulate(energy)[:-1]


def law_on(place: NDArray[np.floating[Any]], controller: Controller) -> FloatArray:
    """Force for given places: of a device that a stiff hand's push puts there at each sample."""
    law = ControlLaw(controller, np.array([T]))
    return np.array([float(law.force(np.array([each]))[0]) for each in place])


def wave(samples: int = 900, size: float = 0.004) -> FloatArray:
    """To and fro about zero, over counts of 6 µm."""
    time = np.arange(samples) * T
    smooth = size * np.sin(2 * np.pi * 1.7 * time) + 0.2 * size * np.sin(2 * np.pi * 11 * time)
    return np.round(smooth / 6e-6) * 6e-6


def clamped(place: FloatArray, low: float, high: float) -> FloatArray:
    """-clamp(u) of 900 N/m, 15 N·s/m at 30 Hz and 0.4 kg at 20 Hz, from transfer functions."""
    slope = np.diff(place, prepend=place[0]) / T
    swift, slow = (np.exp(-2 * np.pi * cutoff * T) for cutoff in (30.0, 20.0))
    pair = [1.0, -2 * slow, slow**2]
    velocity = lfilter([1 - swift], [1.0, -swift], slope)
    acceleration = lfilter([(1 - slow) ** 2], pair, np.diff(slope, prepend=0.0) / T)
    return -np.clip(900.0 * place + 15.0 * velocity + 0.4 * acceleration, low, high)


@pytest.mark.parametrize(
    ("side", "level", "bounds"),
    [
        (0, np.inf, (-np.inf, np.inf)),
        (0, 2.0, (-2.0, 2.0)),
        (-1, np.inf, (0.0, np.inf)),
        (-1, 2.0, (0.0, 2.0)),
        (1, 2.0, (-2.0, 0.0)),
    ],
)
def test_a_spring_is_one_clamp_round_all_of_it(
    side: int, level: float, bounds: tuple[float, float]
) -> None:
    """Of a wall too: its damper acts before the face, and nothing pulls."""
    element = Element(stiffness=900.0, damping=15.0, mass=0.4, side=side, level=level)
    controller = Controller(velocity_filter_hz=30.0, acceleration_filter_hz=20.0, beside=(element,))
    place = wave()
    force = law_on(place, controller)
    np.testing.assert_allclose(force, clamped(place, *bounds), atol=1e-10)
    if side:
        assert np.any(force[side * place > 0])
        assert np.all(side * force >= 0)


def test_estimates_run_on_while_a_wall_gives_nothing() -> None:
    """A wall is what pushes of the same effects everywhere, with a moving window too."""
    effects: dict[str, Any] = {"stiffness": 400.0, "damping": 20.0}
    place = 100 * wave()
    wall = Controller(**effects, velocity_window_samples=6, side=-1)
    everywhere = law_on(place, Controller(**effects, velocity_window_samples=6))
    np.testing.assert_allclose(law_on(place, wall), np.minimum(everywhere, 0.0), atol=1e-9)


def test_effects_add_whatever_clamps_they_are_in() -> None:
    place = wave()
    wall = Element(stiffness=900.0, damping=15.0, side=-1, level=2.0)
    other = Element(stiffness=300.0, level=0.5, place=0.001)
    alone = [law_on(place, Controller(velocity_filter_hz=30.0, beside=(e,))) for e in (wall, other)]
    both = Controller(velocity_filter_hz=30.0, beside=(wall, other))
    np.testing.assert_allclose(law_on(place, both), np.sum(alone, axis=0), atol=1e-12)


def test_a_spring_rests_where_it_is_entered() -> None:
    """At 0.1 m/s only its damper acts at first; left and entered again it rests there."""
    spring = Element(stiffness=700.0, damping=10.0)
    entered = Controller(beside=(spring,), calls=Calls(entrance=0.0))
    there = np.arange(-20, 60) * 1e-4
    place = np.concatenate([there, there[::-1], 2 * there])
    force = law_on(place, entered)
    assert not np.any(force[place <= 0])
    first = int(np.argmax(place > 0))
    rest = place[first]
    assert force[first] == pytest.approx(-1.0)
    np.testing.assert_allclose(
        force[first:80], -(700.0 * (place[first:80] - rest) + 1.0), atol=1e-12
    )
    again = int(np.flatnonzero((place > 0) & (np.arange(place.size) > 160))[0])
    assert np.max(np.abs(force[81:139])) > 1
    assert force[again] == pytest.approx(-2.0)
    np.testing.assert_allclose(np.diff(force[again:]), -700.0 * 2e-4, rtol=1e-9)


@pytest.mark.parametrize(("caller", "taps"), [(RANDOM, 9), (ADVERSE, 9), (RANDOM, 0), (ADVERSE, 0)])
def test_no_motion_takes_energy_from_springs_that_are_called(caller: int, taps: int) -> None:
    """But what a held force gives, K·(change)²/2 a sample; a level that rises at once gives more.

    Springs without dampers, one-sided and cut ones too, and a slow motion, so that all that is
    called in a second is called of what is strained.
    """
    given: list[float] = []
    for element in (
        Element(stiffness=900.0),
        Element(stiffness=900.0, level=1.0),
        Element(stiffness=900.0, side=-1),
        Element(stiffness=900.0, side=1, level=1.0, place=-0.001),
    ):
        place = wave(2000)
        calls = Calls(caller=caller, until=2000, taps=taps)
        force = law_on(place, Controller(beside=(element,), calls=calls))
        change = np.diff(place)
        work = np.cumsum(force[:-1] * change - 450.0 * change**2)
        assert np.any(force)
        given.append(float(work.max()) / float(np.max(np.abs(force)) * 0.004))
    if taps:
        assert max(given) <= 1e-9
    else:
        assert max(given) > 0.3


def test_a_gain_that_fell_rises_only_after_so_many_samples_without_force() -> None:
    """Held at 0.3 going in, a wall stays so coming out; called no more, it is whole again."""
    wall = Element(stiffness=900.0, side=-1)
    place = np.tile(np.concatenate([np.arange(-30, 40), np.arange(40, -30, -1)]) * 1e-4, 3)
    calls = Calls(caller=ADVERSE, until=100, taps=20)
    force = law_on(place, Controller(beside=(wall,), calls=calls))
    inside = place > 0
    dips = np.cumsum(np.diff(inside, prepend=False) & inside)
    np.testing.assert_allclose(force[dips == 1], -270.0 * np.maximum(place[dips == 1], 0))
    np.testing.assert_allclose(force[dips > 1], -900.0 * np.maximum(place[dips > 1], 0))


def test_what_fades_stands_still_while_a_wall_pushes() -> None:
    """Entered at zero, at 0.02 m/s: a wall with its face before it holds the fade back."""
    ice = Element(damping=-6.0, fade_time=0.05)
    place = np.arange(-200, 200) * 2e-5
    for face, held in ((-1e-3, True), (1e-3, False)):
        wall = Element(stiffness=900.0, side=-1, place=face)
        calls = Calls(entrance=0.0)
        force = law_on(place, Controller(beside=(wall, ice), calls=calls))
        pushes = 900.0 * np.maximum(place - face, 0.0)
        level = np.clip(np.arange(1, place.size + 1) - 201, 0, 50) / 50 * (not held)
        np.testing.assert_allclose(force, 6.0 * 0.02 * level - pushes, atol=1e-12)


def test_a_damper_is_called_at_random_or_where_its_lag_gives_energy() -> None:
    place = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-5, 3000)) + 1.0
    moved = np.diff(place, prepend=place[0])
    element, forces = Element(damping=10.0), dict[int, FloatArray]()
    for caller in (NOBODY, RANDOM, ADVERSE):
        calls = Calls(caller=caller, dampers=True)
        law = Controller(velocity_filter_hz=40.0, beside=(element,), calls=calls)
        forces[caller] = law_on(place, law)
    assert np.sum(forces[NOBODY] * moved) < 0
    assert np.sum(forces[ADVERSE] * moved) > 0
    gains = forces[RANDOM][1:] / forces[NOBODY][1:]
    assert set(np.round(gains, 9)) == {0.0, 0.3, 1.0}
    assert 0.2 < np.mean(gains == 0) < 0.8


def test_a_gain_that_rises_inside_a_wall_pumps_and_one_that_waits_does_not() -> None:
    """12 kN/m on HomeRehab, 0.3 of it going in and all coming out, of a free device."""
    wall = Element(stiffness=12_000.0, damping=70.0, side=-1)
    out: list[float] = []
    for taps in (0, 20):
        calls = Calls(caller=ADVERSE, until=3000, taps=taps)
        rig = replace(named_rig("homerehab"), coulomb_friction=0.0, force_limit=np.inf)
        law = Controller(velocity_filter_hz=50.0, beside=(wall,), calls=calls)
        log = simulate(
            rig,
            np.zeros(3000),
            controller=law,
            position=-1e-3,
            velocity=0.2,
            watch=True,
        )
        assert log.truth is not None
        out.append(float(np.max(-log.truth.speed)))
    assert out[0] > 0.2
    assert out[1] < 0.2


def test_energy_of_the_first_contact_is_the_work_of_the_fall() -> None:
    """Without friction push·drop, with Coulomb friction (push - Fc)·drop, at any depth found."""
    rig = Rig(mass=2.0, damping=0.0, sample_time=T, coulomb_friction=[0.0, 1.0])
    law = Controller(stiffness=2000.0, side=-1, place=0.05)
    energy, log = contacts(rig, law, push=4.0, drop=0.0321, samples=600)
    assert energy[0][0] == pytest.approx(4.0 * 0.0321, rel=1e-9)
    # Friction goes on to work until the reading finds the wall, at most a sample later.
    assert energy[1][0] == pytest.approx(3.0 * 0.0321, rel=5e-3)
    found = int(np.argmax(log.position[0] > 0.05))
    assert found * T == pytest.approx(np.sqrt(2 * 0.0321 * 2.0 / 4.0), abs=T)


def test_a_mode_and_a_hand_carry_their_part_of_the_energy() -> None:
    mode = Vibration(frequency_hz=40.0, damping_ratio=0.0, at_encoder=0.5, at_handle=-1.0)
    energy, _ = contacts(
        replace(plain(), modes=(mode,)),
        Controller(stiffness=2000.0, side=-1),
        push=4.0,
        drop=0.03,
        hand=Hand(mass=0.3, stiffness=20.0),
        samples=400,
    )
    # The push works on the handle, which the mode moves too; what is taken off is its work, and
    # the spring of the hand keeps what it had at the start.
    assert energy[0][0] == pytest.approx(4.0 * 0.03 + 20.0 * 0.03**2 / 2, rel=1e-9)


def test_sampling_feeds_an_undamped_wall() -> None:
    """Held force lags by half a sample: without any damping every contact gives energy."""
    wall = Controller(stiffness=20_000.0, side=-1)
    (energy,), _ = contacts(plain(), wall, push=20.0, drop=0.01)
    assert energy.size > 5
    assert energy[-1] > 2 * energy[0]
    assert ratios(energy).max() > 1.05


def test_enough_damping_takes_it_out_again() -> None:
    wall = Controller(stiffness=20_000.0, side=-1)
    (energy,), _ = contacts(plain(40.0), wall, push=20.0, drop=0.01)
    assert energy.size > 2
    assert np.all(np.diff(energy) < 0)
    assert 0 < ratios(energy).max() < 0.8


def rays(m: float, b: float) -> list[tuple[float, float, float]]:
    """K alone, K with B, K with M, and K with B and M that are negative."""
    return [
        (b / T, 0.0, 0.0),
        (b / T, 4 * b, 0.1 * m),
        (b / (5 * T), 0.0, 2 * m),
        (b / (3 * T), -0.25 * b, -0.3 * m),
    ]


@pytest.mark.parametrize("name", DEVICES)
def test_contacts_lose_energy_with_everything_at_once(name: str) -> None:
    """Delay, quantiser, friction or none, force limit, grip or none, at 0.3 of the linear limit.

    From afar, where the force is at its limit, and from near. Measured at 0.7 of the limit as well:
    at most 0.83 of the energy of the contact before.
    """
    rig = named_rig(name)
    m, b = float(rig.mass[0]), float(rig.damping[0])
    count, limit = float(rig.encoder_resolution[0]), float(rig.force_limit[0])
    filters: dict[str, Any] = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}
    bench = SampledBench(mass=m, damping=b, sample_time=T, delay=T, **filters)
    cases = [
        (np.array(ray) * 0.3 * ends, drop, grip, friction)
        for ray in rays(m, b)
        for ends in (bench.limit(ray, 100.0),)
        for drop in (5 * limit / (0.3 * ends * ray[0]), 200 * count)
        for grip in (0.0, 1.0)
        for friction in (0.0, float(rig.coulomb_friction[0]))
    ]
    gains = np.stack([each[0] for each in cases], axis=1)
    drops, held, frictions = np.array([each[1:] for each in cases]).T
    mass, damping, stiffness = np.outer(GRIP[name], held)
    pushed = 0.3 * limit + np.abs(rig.force_offset)
    energies, log = contacts(
        replace(rig.members(np.zeros(len(cases), dtype=int)), coulomb_friction=frictions),
        Controller(stiffness=gains[0], damping=gains[1], mass=gains[2], side=-1, **filters),
        push=pushed,
        drop=drops,
        hand=Hand(mass=mass, damping=damping, stiffness=stiffness),
        samples=2500,
    )
    assert np.any(np.abs(log.force) >= 0.999 * limit)
    assert max(energy.size for energy in energies) >= 3
    # Energy within two counts is not seen.
    seen = 2 * count
    floors = np.abs(pushed - rig.force_offset) * seen + 0.5 * np.abs(gains[0]) * seen**2
    for energy, floor in zip(energies, floors, strict=True):
        assert np.all(ratios(energy, floor) <= 1.01)


@pytest.mark.parametrize("mass", [0.5, -0.5])
def test_entering_a_virtual_mass_is_no_blow(mass: float) -> None:
    """Without spring and friction the handle keeps its speed, whatever mass it enters."""
    effects = Controller(
        acceleration_filter_hz=100.0,
        beside=(Element(mass=mass, fade_time=0.05),),
        calls=Calls(entrance=0.0),
    )
    log = simulate(
        plain(), np.zeros(200), controller=effects, position=-0.01, velocity=0.3, watch=True
    )
    assert log.truth is not None
    assert float(log.truth.speed[0, -1]) == pytest.approx(0.3, rel=1e-6)
