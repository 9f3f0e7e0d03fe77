"""The one-sided wall: its force, its contacts, and the energy brought to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import (
    Controller,
    Element,
    Hand,
    Rig,
    Vibration,
    Wall,
    bounce,
    named_rig,
    simulate,
)
from datasets_synthetic.law import ControlLaw
from datasets_synthetic.wall import ADVERSE, OPEN, RANDOM
from tests.sampled_bench import SampledBench

FloatArray = NDArray[np.float64]

T = 0.001
DEVICES = ("homerehab", "stylus", "knob", "emps")
#: Mass, damper and spring of a hand that suits the device.
GRIP = {"homerehab": (0.4, 5.0, 300.0), "stylus": (0.02, 0.3, 20.0)}
GRIP |= {"knob": (2e-5, 5e-4, 0.02), "emps": (1.0, 20.0, 1000.0)}


def plain(damping: float = 0.0) -> Rig:
    return Rig(mass=2.0, damping=damping, sample_time=T)


def test_a_wall_pushes_from_where_its_law_passes_zero() -> None:
    """Of the free motion: max(0, K·depth + B·v), B·v/K before the face is reached."""
    place, speed = 0.0423, 0.4
    wall = Element(stiffness=500.0, damping=40.0, one_sided=True)
    controller = Controller(beside=(wall,), wall=Wall(place=place))
    log = simulate(plain(), np.zeros(80), controller=controller, velocity=speed)
    position, force = log.position[0], log.force[0]
    first = int(np.argmax(force < 0))
    # The device has no damping: it comes at a steady 0.4 m/s.
    early = 40.0 * speed / 500.0
    assert place - early < position[first] < place - early + 2 * speed * T
    moved = np.diff(position, prepend=position[0]) / T
    expected = -np.maximum(0.0, 500.0 * (position - place) + 40.0 * moved)
    np.testing.assert_allclose(force[5:], expected[5:], atol=1e-9)


@pytest.mark.parametrize("window", [1, 6])
def test_the_force_of_a_wall_is_what_pushes_of_effects_everywhere(window: int) -> None:
    """Estimates run on while it gives nothing, and a level cuts it."""
    filters: dict[str, Any] = {
        "velocity_filter_hz": np.inf if window > 1 else 30.0,
        "acceleration_filter_hz": 20.0,
        "velocity_window_samples": window,
    }
    effects: dict[str, Any] = {"stiffness": 400.0, "damping": 20.0, "mass": 1.0}
    place = np.concatenate([np.linspace(-1, 1, 21), np.linspace(1, -1, 21), np.linspace(-1, 1, 21)])
    wall = Element(**effects, one_sided=True, level=3000.0)
    behind = law_on(place, Controller(beside=(wall,), wall=Wall(), **filters))
    everywhere = law_on(place, Controller(**effects, **filters))
    np.testing.assert_allclose(behind, np.clip(everywhere, -3000.0, 0.0), atol=1e-9)
    assert np.any(behind == 0)
    assert np.any(behind == -3000.0)


def law_on(place: FloatArray, controller: Controller) -> FloatArray:
    """Force for given places: of a device that a stiff hand's push puts there at each sample."""
    law = ControlLaw(controller, np.array([T]))
    return np.array([float(law.force(np.array([each]))[0]) for each in place])


def test_a_one_sided_element_never_pulls() -> None:
    effects: dict[str, Any] = {"stiffness": 300.0, "damping": 20.0}
    sticky = Controller(**effects, wall=Wall())
    smooth = Controller(beside=(Element(**effects, one_sided=True),), wall=Wall())
    logs = [
        simulate(plain(), np.zeros(400), controller=each, velocity=0.4) for each in (sticky, smooth)
    ]
    assert np.max(logs[0].force) > 0
    assert np.max(logs[1].force) <= 0
    assert np.min(logs[1].force) < 0


def test_gates_shut_dampers_at_random_or_where_they_would_take_energy() -> None:
    place = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-5, 3000)) + 1.0
    moved = np.diff(place, prepend=place[0])
    forces: dict[int, FloatArray] = {}
    for gate in (OPEN, RANDOM, ADVERSE):
        element = Element(damping=10.0, gate=gate, calls=place.size)
        forces[gate] = law_on(place, Controller(velocity_filter_hz=40.0, beside=(element,)))
    assert np.sum(forces[OPEN] * moved) < 0
    assert np.sum(forces[ADVERSE] * moved) > 0
    shut = forces[RANDOM] == 0
    assert 0.2 < np.mean(shut) < 0.8
    part = forces[RANDOM][~shut] / forces[OPEN][~shut]
    assert np.all((part >= 0.3) & (part <= 1.0))
    assert np.ptp(part) > 0.3


def test_energy_of_the_first_contact_is_the_work_of_the_fall() -> None:
    """Without friction push·drop, with Coulomb friction (push - Fc)·drop, at any depth found."""
    rig = Rig(mass=2.0, damping=0.0, sample_time=T, coulomb_friction=[0.0, 1.0])
    fall = bounce(
        rig,
        Controller(stiffness=2000.0, wall=Wall(place=0.05)),
        push=4.0,
        drop=0.0321,
        samples=600,
    )
    assert fall.energy[0][0] == pytest.approx(4.0 * 0.0321, rel=1e-9)
    # Friction goes on to work until the reading finds the wall, at most a sample later.
    assert fall.energy[1][0] == pytest.approx(3.0 * 0.0321, rel=5e-3)
    assert fall.speed(2.0)[0] == pytest.approx(np.sqrt(2 * 4.0 * 0.0321 / 2.0), rel=1e-9)
    assert fall.time[0][0] == pytest.approx(np.sqrt(2 * 0.0321 * 2.0 / 4.0), abs=T)


def test_a_mode_and_a_hand_carry_their_part_of_the_energy() -> None:
    mode = Vibration(frequency_hz=40.0, damping_ratio=0.0, at_encoder=0.5, at_handle=-1.0)
    fall = bounce(
        replace(plain(), modes=(mode,)),
        Controller(stiffness=2000.0, wall=Wall()),
        push=4.0,
        drop=0.03,
        hand=Hand(mass=0.3, stiffness=20.0),
        samples=400,
    )
    # The push works on the handle, which the mode moves too; what is taken off is its work, and
    # the spring of the hand keeps what it had at the start.
    assert fall.energy[0][0] == pytest.approx(4.0 * 0.03 + 20.0 * 0.03**2 / 2, rel=1e-9)


def test_sampling_feeds_an_undamped_wall() -> None:
    """Held force lags by half a sample: without any damping every contact gives energy."""
    fall = bounce(plain(), Controller(stiffness=20_000.0, wall=Wall()), push=20.0, drop=0.01)
    assert fall.grows[0]
    assert fall.energy[0].size > 5
    assert fall.energy[0][-1] > 2 * fall.energy[0][0]
    assert fall.largest_ratio() > 1.05


def test_enough_damping_takes_it_out_again() -> None:
    fall = bounce(plain(40.0), Controller(stiffness=20_000.0, wall=Wall()), push=20.0, drop=0.01)
    assert not fall.grows[0]
    assert fall.energy[0].size > 2
    assert np.all(np.diff(fall.energy[0]) < 0)
    assert 0 < fall.largest_ratio() < 0.8


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
    falls = bounce(
        replace(rig.members(np.zeros(len(cases), dtype=int)), coulomb_friction=frictions),
        Controller(stiffness=gains[0], damping=gains[1], mass=gains[2], wall=Wall(), **filters),
        push=0.3 * limit + np.abs(rig.force_offset),
        drop=drops,
        hand=Hand(mass=mass, damping=damping, stiffness=stiffness),
        samples=2500,
    )
    assert np.any(np.abs(falls.recording.force) >= 0.999 * limit)
    assert max(energy.size for energy in falls.energy) >= 3
    assert not np.any(falls.grows)


@pytest.mark.parametrize("mass", [0.5, -0.5])
def test_entering_a_virtual_mass_is_no_blow(mass: float) -> None:
    """Without spring and friction the handle keeps its speed, whatever mass it enters."""
    effects = Controller(
        acceleration_filter_hz=100.0, beside=(Element(mass=mass, fade_time=0.05),), wall=Wall()
    )
    log = simulate(
        plain(), np.zeros(200), controller=effects, position=-0.01, velocity=0.3, watch=True
    )
    assert log.truth is not None
    assert float(log.truth.speed[0, -1]) == pytest.approx(0.3, rel=1e-6)


def test_a_fall_needs_a_wall() -> None:
    for wall in (None, Wall(place=-np.inf)):
        with pytest.raises(ValueError, match="there is no wall to fall into"):
            bounce(plain(), Controller(stiffness=10.0, wall=wall), push=1.0, drop=0.1)
