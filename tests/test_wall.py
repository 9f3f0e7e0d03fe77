"""Clamps, what may change of them while they act, and the energy brought to a wall."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

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
from datasets_synthetic.law import ADVERSE
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
