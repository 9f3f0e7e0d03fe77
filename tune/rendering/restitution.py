"""Restitution: how much of its speed a wall gives back to a free device that runs into it.

Between entry and exit the sampled loop is linear but for a wall that only pushes, which commands
nothing while its law would pull. The ratio of speeds so depends on the device and on where between
two samples the wall is reached, and not on the speed, as long as the force stays below its limit.
The estimates of velocity and acceleration run outside the wall too: on entry they hold the free
motion, speed constant and acceleration none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.loop.state_space import SampledLoop

FloatArray = NDArray[np.float64]

#: Places between two samples at which the wall is reached, evenly up to a whole sample.
PHASES = 8
#: Samples after which a device that is still inside has stayed.
_FOLLOWED = 20_000
#: Samples computed at once, at least and at most.
_FEWEST, _MOST = 32, 1024


def restitutions(
    loop: SampledLoop, *, one_sided: bool, sample_time: float, half_period: float
) -> FloatArray:
    """Speed out over speed in, for each place between two samples at which the wall is reached.

    Speeds are those of the rigid mass at the wall. Where forces on their way still act on a device
    that has left, it is the speed with which free motion would have left the wall: v + (b/m)·x
    does not change in free motion, nor does v + (b/m)·x + τ·F/m while an actuator's force decays.

    Args:
        loop: of the device with the wall's law.
        one_sided: the wall only pushes; else its law acts until the device has left.
        sample_time: T, s.
        half_period: of the device's mass on the wall's spring, s.

    Returns:
        Shape (PHASES,); 0 where the device stays inside.
    """
    plant = loop.plant
    phases = np.arange(1, PHASES + 1) / PHASES
    state = np.zeros((len(loop.read), PHASES))
    state[: len(plant.drive)] = plant.held(phases * sample_time)[0][:, :, plant.speed].T
    state[loop.remembered] = loop.moving(loop.read @ state, sample_time)
    wanted = np.clip(1.1 * half_period / sample_time, _FEWEST, _MOST)
    count = 1 << int(np.ceil(np.log2(wanted)))
    acting, idle = _powers(loop.pushed, count), None
    left = np.zeros(PHASES, dtype=bool)
    followed = np.zeros(PHASES, dtype=np.intp)
    while True:
        left |= loop.read @ state <= 0
        inside = ~left & (followed < _FOLLOWED)
        if not inside.any():
            break
        pushing = (loop.command @ state < 0) | (not one_sided)
        for acts in (True, False):
            chosen = np.flatnonzero(inside & (pushing == acts))
            if not chosen.size:
                continue
            if not acts and idle is None:
                idle = _powers(loop.free, count)
            powers = acting if acts or idle is None else idle
            state[:, chosen], steps = _until_switched(
                loop, powers, state[:, chosen], acts=acts, one_sided=one_sided
            )
            followed[chosen] += steps
    under_way = loop.under_way.stop - loop.under_way.start
    gone = (np.linalg.matrix_power(loop.free, under_way) @ state)[: len(plant.drive)]
    motion = plant.motion[plant.speed]
    speed = gone[plant.speed] - motion[plant.speed] * gone[0]
    if plant.lagged:
        speed -= motion[-1] / plant.motion[-1, -1] * gone[-1]
    return np.where(left, np.maximum(0.0, -speed), 0.0)


def _powers(transition: FloatArray, count: int) -> FloatArray:
    """A⁰ to A^count, count a power of two; shape (count + 1, states, states)."""
    size = transition.shape[0]
    found = np.empty((count + 1, size, size))
    found[0], found[1] = np.eye(size), transition
    done = 1
    while done < count:
        found[done + 1 : 2 * done + 1] = found[1 : done + 1] @ found[done]
        done *= 2
    return found


def _until_switched(
    loop: SampledLoop, powers: FloatArray, state: FloatArray, *, acts: bool, one_sided: bool
) -> tuple[FloatArray, NDArray[np.intp]]:
    """States at the first sample that is outside or in the other law, and how many it took."""
    outside = (loop.read @ powers[1:]) @ state <= 0
    if one_sided:
        outside |= ((loop.command @ powers[1:]) @ state < 0) != acts
    switched = outside.any(axis=0)
    steps = np.where(switched, outside.argmax(axis=0) + 1, len(powers) - 1)
    return np.einsum("cij,jc->ic", powers[steps], state), steps
