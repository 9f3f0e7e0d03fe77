"""An axis in continuous time, written for the bench of outside logs; it shares no code with any."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STEP = 5e-5  # longest step of the integration, s


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A second body on the axis: a load on a shaft, behind backlash, or a hand."""

    mass: float
    stiffness: float  # of what joins it to the axis
    damping: float  # of the same
    gap: float = 0.0  # half of the play
    ground_stiffness: float = 0.0  # to the wall, or to the person's body
    ground_damping: float = 0.0
    push: FloatArray | None = None  # its own force, one value a row


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """What moves; SI."""

    mass: float
    damping: float
    coulomb: float = 0.0
    static: float = 0.0  # further dry friction at rest, gone at speed as exp(-(v/stribeck)²)
    stribeck: float = 1.0
    drag: float = 0.0  # of drag·v·|v|
    asymmetry: float = 0.0  # damping and friction are (1 ± this) times theirs forward and backward
    warming: float = 0.0  # part of damping and friction lost in the end ...
    warming_time: float = 1.0  # ... with this time constant
    bristle_stiffness: float = 0.0  # dry friction as a bristle (LuGre; Dahl without damping)
    bristle_damping: float = 0.0
    slips: tuple[tuple[float, float], ...] = ()  # stiffness and limit of each (Maxwell slip)
    load: float = 0.0  # dry friction per force of the motor
    place: Callable[[float], float] | None = None  # force by position that pulls back
    grade: Callable[[float], float] | None = None  # what damping is multiplied with, by position
    body: Body | None = None
    lag_hz: float = 0.0  # corner of the current loop


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """What is played and read, a row each ``sample_time``."""

    sample_time: float
    plan: FloatArray  # force, or set-point of a servo
    delay: float
    count: float  # of the encoder
    servo: tuple[float, float] | None = None  # gains on position and velocity
    limit: float = np.inf
    quantum: float = 0.0  # step of the force that acts
    disturbance: float = 0.0  # rms of force that is not logged, 0.2 ms memory
    noise: float = 0.0  # of a reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """One log, and what only the simulator knows; arrays of one length, rows of ``sample_time``."""

    time: FloatArray
    command: FloatArray
    reading: FloatArray
    force: FloatArray  # mean force that acted over the row
    dry: FloatArray  # mean dry friction over the row
    further: FloatArray  # mean force of position, drag and warming over the row
    apart: FloatArray  # second body's place less the axis', at the row
    fastest: float


def played_delay(delay: float, sample_time: float) -> float:
    """The delay that is played for one wanted: whole steps of the integration, s."""
    step = sample_time / max(1, round(sample_time / STEP))
    return round(delay / step) * step


def play(axis: Axis, drive: Drive, rng: np.random.Generator) -> Played:  # noqa: PLR0912
    """Run the axis from rest."""
    rows = drive.plan.size
    steps = max(1, round(drive.sample_time / STEP))
    h = drive.sample_time / steps
    half, late = h / 2, round(drive.delay / h)
    follow = 1.0 if not axis.lag_hz else 1 - exp(-2 * np.pi * axis.lag_hz * h)
    shake = (drive.disturbance * rng.standard_normal(rows)).tolist()
    fuzz = (drive.noise * rng.standard_normal(rows)).tolist()
    plan, m, body = drive.plan.tolist(), axis.mass, axis.body
    push = [0.0] * rows if body is None or body.push is None else body.push.tolist()
    place, grade, bristle = axis.place, axis.grade, axis.bristle_stiffness
    one_way, drag, load, static = axis.asymmetry, axis.drag, axis.load, axis.static
    stretch = [0.0] * len(axis.slips)
    slides = not (bristle or stretch)
    x = v = f = z = y = w = fastest = filtered = 0.0
    last = last_plan = held = 0.0
    command: list[float] = []
    acted: list[float] = [0.0] * (late // steps + 1)
    out: list[tuple[float, ...]] = []
    dry_now = 0.0
    for k in range(rows):
        reading = round((x + fuzz[k]) / drive.count) * drive.count
        order = plan[k]
        if drive.servo is not None:
            rate = ((order - last_plan) - (reading - last)) / drive.sample_time
            filtered += 0.3 * (rate - filtered)
            last, last_plan = reading, order
            order = drive.servo[0] * (plan[k] - reading) + drive.servo[1] * filtered
        order = min(max(order, -drive.limit), drive.limit)
        command.append(order)
        acted.append(round(order / drive.quantum) * drive.quantum if drive.quantum else order)
        fade = 1.0
        if axis.warming:
            fade -= axis.warming * (1 - exp(-k * drive.sample_time / axis.warming_time))
        apart, unlogged, level = y - x, shake[k], acted[k]
        damping, rough = axis.damping * fade, axis.coulomb * fade
        viscous, limit = damping, rough
        total = dry = further = 0.0
        for s in range(steps):
            if s == late % steps:
                level = acted[k + 1]
            f += (level - f) * follow
            middle, speed = x + half * v, abs(v)
            if one_way:
                side = 1 + one_way * ((v > 0) - (v < 0))
                viscous, limit = damping * side, rough * side
            resisting = viscous + drag * speed if drag else viscous
            if grade is not None:
                resisting *= grade(middle)
            pull = f + unlogged
            if place is not None:
                held = place(middle)
                pull -= held
            if body is not None:
                far = y + half * w
                along = far - middle
                if body.gap:
                    along = along - body.gap if along > body.gap else min(along + body.gap, 0.0)
                joint = body.stiffness * along + (body.damping * (w - v) if along else 0.0)
                pull += joint
                ground = body.ground_stiffness * far + body.ground_damping * w
                w += h * (push[k] - joint - ground) / body.mass
                y = far + half * w
            most = limit + load * abs(f) if load else limit
            if static:
                most += static * exp(-((v / axis.stribeck) ** 2))
            if bristle:
                steady = most / bristle
                if v:
                    way = steady if v > 0 else -steady
                    new = way + (z - way) * exp(-speed * h / steady)
                    rate, z = (new - z) / h, new
                else:
                    rate = 0.0
                dry_now = bristle * z + axis.bristle_damping * rate
                pull -= dry_now
            if stretch:
                for index, (stiffness, longest) in enumerate(axis.slips):
                    there = stretch[index] + h * v * stiffness
                    stretch[index] = min(max(there, -longest), longest)
                dry_now = sum(stretch)
                pull -= dry_now
            ease = resisting * half / m
            free = (v * (1 - ease) + h * pull / m) / (1 + ease)
            if slides:
                stop = h * most / m
                new = free - stop if free > stop else min(free + stop, 0.0)
                dry_now = (free - new) * m / h
                free = new
            further += held + (resisting - axis.damping) * (v + free) / 2
            x = middle + half * free
            v = free
            total += f
            dry += dry_now
            fastest = max(fastest, speed)
        out.append((reading, total / steps, dry / steps, further / steps, apart))
    columns = np.array(out).T
    return Played(
        time=np.arange(rows, dtype=np.float64) * drive.sample_time,
        command=np.array(command),
        reading=columns[0],
        force=columns[1],
        dry=columns[2],
        further=columns[3],
        apart=columns[4],
        fastest=fastest,
    )
