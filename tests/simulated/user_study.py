"""The experiment of the paper's section 3: hands move a simulated device, and what they are given.

Two areas render different stiffness, mass and damping (table 2). In each area a hand moves the
handle to and fro between the walls, where damping and mass alone act, and presses into a wall,
where all three do. A hand is a mass, spring and damper that pull the handle after a place it has
in mind. What it is given is the impedance that explains, by least squares, the force at the grip
from the motion there: the device's own mass and damping and whatever of the virtual effects
survives filters, delay, friction and encoder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Controller, Hand, Rig, simulate

FloatArray = NDArray[np.float64]

#: Table 2: the areas by stiffness (N/m), damping (N·s/m), mass (kg); area 1 in every trial, ...
AREA_1 = (500.0, 0.0, 0.0)
#: ... and area 2 in each of the seven.
AREA_2 = (
    (1000.0, 0.0, 0.0),
    (500.0, 10.0, 0.0),
    (500.0, 0.0, 1.0),
    (1000.0, 10.0, 0.0),
    (1000.0, 0.0, 1.0),
    (500.0, 10.0, 1.0),
    (1000.0, 10.0, 1.0),
)
#: Section 3.2.
PEOPLE = 20

#: Mass (kg), damping (N·s/m) and stiffness (N/m) of an arm, drawn evenly on logarithmic scales. Of
#: the size arms have (Mussa-Ivaldi, Hogan and Bizzi 1985: 100 to 800 N/m); the ranges are assumed.
_ARM = {"mass": (0.3, 1.0), "damping": (5.0, 20.0), "stiffness": (200.0, 600.0)}
#: The place in mind goes to and fro at this rate, Hz, and so far to both sides, m; arms swing
#: farther. The walls stand at 0.1 m.
_RATE, _REACH = (0.7, 1.3), (0.03, 0.06)
#: How deep behind the surface of a wall the place in mind is, m, by how much of that it moves, and
#: how long it takes to get there, s.
_DEPTH, _KNEADING, _ENTRY = (0.02, 0.04), 0.4, 0.1
#: A quicker part of the motion, in multiples of the rate, and its size: one rate alone would not
#: part mass from a spring, nor damping from friction.
_QUICKER, _PART = 2.7, 0.25
#: How long a hand moves about, and how much of it is left out, for it to forget the start, s.
_DURATION, _START = 2.5, 0.5
#: Slower than this the handle is taken to stick, m/s.
_STUCK = 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class People:
    """Hands and how they move; every array shape (people,).

    Attributes:
        arm: mass, damping and stiffness of each.
        rate: of the motion to and fro, Hz.
        reach: of the place in mind, to both sides, m.
        depth: of the place in mind behind a wall, m.
    """

    arm: Hand
    rate: FloatArray
    reach: FloatArray
    depth: FloatArray

    @property
    def count(self) -> int:
        """Number of people."""
        return self.rate.size


def draw_people(count: int = PEOPLE, *, seed: int = 0) -> People:
    """People whose hands and habits differ, drawn by lot."""
    lot = np.random.default_rng(seed)

    def drawn(bounds: tuple[float, float]) -> FloatArray:
        low, high = bounds
        return low * (high / low) ** lot.random(count)

    arm = Hand(**{name: drawn(bounds) for name, bounds in _ARM.items()})
    return People(arm=arm, rate=drawn(_RATE), reach=drawn(_REACH), depth=drawn(_DEPTH))


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """What hands are given in an area; every array shape (areas, people).

    Attributes:
        stiffness: of the wall, N/m.
        damping: of device and area together, N·s/m.
        mass: likewise, kg.
        farthest: from the middle between the walls, m.
        shallowest: behind the surface of the wall that is pressed, m; negative is outside.
        largest_force: that the actuator was asked for, N.
    """

    stiffness: FloatArray
    damping: FloatArray
    mass: FloatArray
    farthest: FloatArray
    shallowest: FloatArray
    largest_force: FloatArray


def play_areas(
    areas: FloatArray,
    people: People,
    rig: Rig,
    *,
    velocity_filter_hz: float = np.inf,
    acceleration_filter_hz: float = np.inf,
) -> Given:
    """Every person moves about and presses in every area.

    Args:
        areas: stiffness (N/m), damping (N·s/m), mass (kg) of each, shape (areas, 3).
        people: who move.
        rig: one device.
        velocity_filter_hz: of the controller, Hz; infinite means no filter.
        acceleration_filter_hz: likewise.
    """
    count, shape = people.count, (len(areas), people.count)
    who = np.tile(np.arange(count), 2 * len(areas))
    # The first half moves about between the walls, the second presses into one.
    stiffness, damping, mass = (np.repeat(np.tile(column, 2), count) for column in areas.T)
    pressing = np.arange(who.size) >= who.size // 2
    step = float(rig.sample_time[0])
    arm, place = people.arm.members(who), _places(people, who, pressing, step)
    pull = _pull(arm, place, step)
    run = simulate(
        rig,
        np.zeros(len(place[0])),
        controller=Controller(
            stiffness=np.where(pressing, stiffness, 0.0),
            damping=damping,
            mass=mass,
            velocity_filter_hz=velocity_filter_hz,
            acceleration_filter_hz=acceleration_filter_hz,
        ),
        hand=arm,
        push=pull,
        watch=True,
    )
    assert run.truth is not None
    handle, speed = run.truth.handle, run.truth.speed
    grip = _grip(arm, pull, handle, speed, step)
    found = _impedances(grip, handle, speed, step)
    largest = np.max(np.abs(run.force), axis=1)
    return Given(
        stiffness=found[pressing, 2].reshape(shape),
        damping=found[~pressing, 1].reshape(shape),
        mass=found[~pressing, 0].reshape(shape),
        farthest=np.max(np.abs(handle[~pressing]), axis=1).reshape(shape),
        shallowest=np.min(handle[pressing], axis=1).reshape(shape),
        largest_force=np.maximum(largest[pressing], largest[~pressing]).reshape(shape),
    )


def _places(
    people: People, who: NDArray[np.intp], pressing: NDArray[np.bool_], step: float
) -> FloatArray:
    """The place that each hand has in mind, m, shape (members, n)."""
    time = step * np.arange(round(_DURATION / step))
    turn = 2 * np.pi * people.rate[who, None] * time
    sway = (np.sin(turn) + _PART * np.sin(_QUICKER * turn)) / (1 + _PART)
    moved = people.reach[who, None] * sway
    pressed = people.depth[who, None] * -np.expm1(-time / _ENTRY) * (1 + _KNEADING * sway)
    return np.where(pressing[:, None], pressed, moved)


def _pull(arm: Hand, place: FloatArray, step: float) -> FloatArray:
    """Force of an arm's spring and damper towards the place in mind, the handle at zero, N."""
    stiffness, damping = np.asarray(arm.stiffness), np.asarray(arm.damping)
    speed = np.gradient(place, step, axis=1)
    return stiffness[:, None] * place + damping[:, None] * speed


def _grip(
    arm: Hand, pull: FloatArray, handle: FloatArray, speed: FloatArray, step: float
) -> FloatArray:
    """Force that the arm gives to the handle, N, shape (members, n)."""
    stiffness, damping, mass = (np.asarray(x) for x in (arm.stiffness, arm.damping, arm.mass))
    own = stiffness[:, None] * handle + damping[:, None] * speed
    return pull - own - mass[:, None] * np.gradient(speed, step, axis=1)


def _impedances(grip: FloatArray, handle: FloatArray, speed: FloatArray, step: float) -> FloatArray:
    """Mass, damping, stiffness, friction and offset of each member, by least squares.

    Where the handle all but sticks, friction has any value: such samples are left out.
    """
    acceleration = np.gradient(speed, step, axis=1)
    columns = (acceleration, speed, handle, np.sign(speed), np.ones_like(speed))
    kept = slice(round(_START / step), -1)  # the last acceleration is one-sided
    slides = np.abs(speed[:, kept]) > _STUCK
    table = np.stack([np.where(slides, column[:, kept], 0.0) for column in columns], axis=1)
    squares = table @ table.transpose(0, 2, 1)
    products = table @ grip[:, kept, None]
    solved: FloatArray = np.linalg.solve(squares, products)[:, :, 0].astype(np.float64)
    return solved
