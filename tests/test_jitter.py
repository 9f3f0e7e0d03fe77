"""Steps of uneven length and fades: against sequences chosen to do harm."""

import functools
import math
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import ForceLimit, InvalidInputError, load_device, quantity
from tune import Effects, Filters, SafeProfile, Scene, audit, optimise

FloatArray = NDArray[np.float64]

T = 0.001
#: Mass, damping, samples of delay; K, B, M; filters of both, Hz.
LOOPS = {
    "spring": (3.0, 10.0, 1, (1154.0, 0.0, 0.0), None, None),
    "stiff spring": (3.0, 10.0, 1, (6000.0, 0.0, 0.0), None, None),
    "wall": (3.0, 10.0, 1, (1154.0, 82.0, 0.0), 72.55, None),
    "late wall": (3.0, 10.0, 2, (1500.0, 50.0, 0.0), 60.0, None),
    "bare damper": (3.0, 10.0, 1, (0.0, 1246.0, 0.0), None, None),
    "close to the limit": (3.0, 10.0, 1, (5000.0, 2000.0, 0.0), None, None),
    "cup": (3.0, 10.0, 1, (0.0, 0.0, 1.47), None, 33.0),
    "all": (3.0, 10.0, 1, (1000.0, 10.0, 1.0), 30.0, 30.0),
}


def _jitter(
    delay: float, values: tuple[float, float, float], filters: Filters, damping: float = 10.0
) -> float:
    """What an audit says of gains on 3 kg."""
    device = load_device("homerehab").model_copy(
        update={"mass": quantity(3.0), "damping": quantity(damping), "delay": quantity(delay)}
    )
    K, B, M = (each or None for each in values)
    found = audit(device, Effects(stiffness=K, damping=B, mass=M), filters=filters)
    jitter = found.design.elements["gains"].margins.jitter
    assert jitter is not None
    return jitter


def _margin(name: str) -> float:
    _, damping, late, values, velocity, acceleration = LOOPS[name]
    filters = Filters(velocity_filter_hz=velocity, acceleration_filter_hz=acceleration)
    return _jitter(late * T, values, filters, damping)


@functools.cache
def _step(name: str, length: float) -> FloatArray:
    mass, damping, late, values, velocity, acceleration = LOOPS[name]
    return one_step(mass, damping, late, values, velocity, acceleration, length)


def one_step(
    mass: float,
    damping: float,
    late: int,
    values: tuple[float, float, float],
    velocity: float | None,
    acceleration: float | None,
    length: float = 1.0,
    step: float = T,
) -> FloatArray:
    """The loop's states after one step of so many sample times, by playing it from unit states."""
    K, B, M = values
    rate, time = damping / mass, length * step
    poles = [math.exp(-2 * math.pi * f * step) if f else 0.0 for f in (velocity, acceleration)]

    def played(state: FloatArray) -> FloatArray:
        x, v, *rest = state
        sent, (last, slow, change, once, twice) = rest[:late], rest[late:]
        slope = (x - last) / step
        slow = poles[0] * slow + (1 - poles[0]) * slope
        once = poles[1] * once + (1 - poles[1]) * (slope - change) / step
        twice = poles[1] * twice + (1 - poles[1]) * once
        sent = [-(K * x + B * slow + M * twice), *sent]
        end, left = sent[-1] / damping, math.exp(-rate * time)
        moved = x + end * time + (v - end) * (1 - left) / rate
        return np.array([moved, end + (v - end) * left, *sent[:-1], x, slow, slope, once, twice])

    count = 7 + late
    return np.array([played(unit) for unit in np.eye(count)]).T


def _growth(name: str, lengths: tuple[float, ...]) -> float:
    """Largest modulus of an eigenvalue, per step, of steps in turn; free motion is left out."""
    whole = np.eye(len(_step(name, 1.0)))
    for length in lengths:
        whole = _step(name, length) @ whole
    poles = np.sort(np.abs(np.linalg.eigvals(whole)))
    return float(poles[-1 if LOOPS[name][3][0] else -2]) ** (1 / len(lengths))


@pytest.mark.parametrize("name", LOOPS)
def test_no_sequence_within_the_margin_does_harm(name: str) -> None:
    """Every sequence of shortest and longest steps of up to seven in turn, and some by chance."""
    margin = _margin(name)
    assert 0.02 < margin <= 0.5
    ends = (1 - margin, 1 + margin)
    worst = max(_growth(name, turn) for n in range(1, 8) for turn in product(ends, repeat=n))
    chance = np.random.default_rng(2)
    worst = max(
        worst,
        *(_growth(name, tuple(chance.uniform(*ends, 12).round(6).tolist())) for _ in range(5)),
    )
    assert worst < 1


#: A light device that hardly damps, at 500 Hz: kg, N·s/m, s; its cut-off, Hz.
LIGHT, OILED, SLOW, CUT_OFF = 0.1, 0.4, 0.002, 40.0


@functools.cache
def _tuned(fade_time: float | None = None) -> SafeProfile:
    """A spring beside a mass that fades, both as large as may be."""
    device = load_device("homerehab").model_copy(
        update={
            "mass": quantity(LIGHT),
            "damping": quantity(OILED),
            "sample_time": quantity(SLOW),
            "delay": quantity(0.0),
            "encoder_resolution": quantity(1e-8),
            "force_limit": ForceLimit(continuous=1e4, peak=1e4),
        }
    )
    fade = {} if fade_time is None else {"fade_time": fade_time}
    scene = {
        "elements": {"rubber": {"stiffness": "max"}, "cup": {"mass": "max", **fade}},
        "together": [["rubber", "cup"]],
        "loop": {"acceleration_filter_hz": CUT_OFF},
    }
    return optimise(device, Scene.model_validate(scene))


def _pumped(seconds: float) -> float:
    """Largest growth of a period in which a hand waits out of the mass, and then in it."""
    rubber, cup = (_tuned().elements[name] for name in ("rubber", "cup"))
    played = (
        (2 * rubber.stiffness, 0.0, 2 * cup.mass * level)
        for level in np.linspace(0, 1, round(seconds / SLOW) + 1)
    )
    steps = [one_step(LIGHT, OILED, 0, each, None, CUT_OFF, step=SLOW) for each in played]
    rise = fall = np.eye(len(steps[0]))
    for up, down in zip(steps[1:], steps[-2::-1], strict=True):
        rise, fall = up @ rise, down @ fall
    waits = np.arange(0, 200, 4)
    out, within = (
        np.array([np.linalg.matrix_power(s, k) for k in waits]) for s in (steps[0], steps[-1])
    )
    periods = fall @ within[:, None] @ rise @ out[None]
    return float(np.abs(np.linalg.eigvals(periods)).max())


def test_the_fade_that_is_stated_lets_nothing_grow_and_a_fast_one_does() -> None:
    assert _tuned().elements["cup"].fade_time == 0.2
    assert _pumped(0.04) > 1.05
    assert _pumped(0.2) < 1


def test_a_scene_may_ask_for_a_longer_fade_and_not_for_a_shorter_one() -> None:
    assert _tuned(fade_time=0.6).elements["cup"].fade_time == 0.6
    with pytest.raises(InvalidInputError, match=r"it must fade over 0\.2 s") as refused:
        _tuned(fade_time=0.15)
    assert "cup.fade_time" in str(refused.value)
