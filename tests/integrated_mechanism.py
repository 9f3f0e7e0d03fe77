"""A mechanism's equations written out once more, for scipy's adaptive integrator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from datasets_synthetic import Hand, Rig
from tests.plain_rigs import T

FloatArray = NDArray[np.float64]


class Law:
    """The equations written out once more: coordinates one by one, no matrices of the simulator."""

    def __init__(self, device: Rig, hand: Hand) -> None:
        self.device, self.hand = device, hand
        self.count = 1 + len(device.modes)
        self.m = float(device.mass[0])
        self.p = np.array([1.0, *(float(np.asarray(v.at_handle)) for v in device.modes)])
        self.g = np.array([1.0, *(float(np.asarray(v.at_encoder)) for v in device.modes)])

    def pull(self, state: FloatArray, command: float) -> FloatArray:
        """Right side of m·qi'' + hi·mh·x'' = .., friction of the rigid coordinate left out."""
        n, hand, device = self.count, self.hand, self.device
        q, v = state[:n], state[n : 2 * n]
        x, speed = float(self.p @ q), float(self.p @ v)
        grip = float(hand.damping) * speed + float(hand.stiffness) * (x - float(hand.rest))
        acting = state[2 * n] if device.current_lag[0] > 0 else command
        right = self.g * acting - self.p * grip
        right[0] -= float(device.damping[0]) * v[0] + float(device.force_offset[0])
        for place, mode in enumerate(device.modes, start=1):
            w = 2 * np.pi * float(np.asarray(mode.frequency_hz))
            loss = 2 * float(np.asarray(mode.damping_ratio)) * w * v[place]
            right[place] -= self.m * (loss + w * w * q[place])
        return right

    def slope(self, state: FloatArray, command: float, way: float, *, stuck: bool) -> FloatArray:
        n = self.count
        right = self.pull(state, command)
        right[0] -= way * float(self.device.coulomb_friction[0])
        mass = self.m * np.eye(n) + float(self.hand.mass) * np.outer(self.p, self.p)
        acceleration = np.zeros(n)
        first = 1 if stuck else 0
        acceleration[first:] = np.linalg.solve(mass[first:, first:], right[first:])
        lag = float(self.device.current_lag[0])
        force = (command - state[2 * n]) / lag if lag > 0 else 0.0
        return np.concatenate([state[n : 2 * n], acceleration, [force]])

    def needed(self, state: FloatArray, command: float) -> float:
        """Force that holds the rigid coordinate where it is."""
        n = self.count
        others = self.slope(state, command, 0.0, stuck=True)[n : 2 * n]
        taken = float(self.hand.mass) * float(self.p @ others)
        return float(self.pull(state, command)[0] - taken)

    def run(self, state: FloatArray, command: float, left: float) -> FloatArray:
        """The state ``left`` s later, through every stop and start."""
        friction = float(self.device.coulomb_friction[0])
        while left > 1e-15:
            way, stuck = float(np.sign(state[self.count])), False
            if friction > 0 and way == 0:
                needed = self.needed(state, command)
                way, stuck = float(np.sign(needed)), abs(needed) <= friction
                way = 0.0 if stuck else way

            def ends(time: float, now: FloatArray, way: float = way, stuck: bool = stuck) -> float:
                if friction == 0 or time == 0:
                    return 1.0
                if stuck:
                    return friction - abs(self.needed(now, command))
                return way * float(now[self.count])

            setattr(ends, "terminal", True)  # noqa: B010 what solve_ivp looks for

            def slope(
                _: float, now: FloatArray, way: float = way, stuck: bool = stuck
            ) -> FloatArray:
                return self.slope(now, command, way, stuck=stuck)

            found = solve_ivp(
                slope, (0.0, left), state, events=ends, method="DOP853", rtol=1e-11, atol=1e-15
            )
            state = np.array(found.y[:, -1])
            left -= float(found.t[-1])
            if found.status == 1 and not stuck:
                state[self.count] = 0.0
            elif found.status == 1:  # breaks away: just beyond what friction holds
                state[self.count] = 1e-13 * np.sign(self.needed(state, command))
        return state


def integrated(
    device: Rig, hand: Hand, force: FloatArray, position: float, velocity: float
) -> tuple[FloatArray, FloatArray]:
    """Readings, and speed of the rigid coordinate, with whole and fractional delay."""
    law = Law(device, hand)
    n = law.count
    state = np.zeros(2 * n + 1)
    state[0], state[n] = position, velocity
    delay = float(device.delay[0])
    whole = int(np.floor(delay / T + 1e-9))
    part = delay - whole * T
    sent = np.concatenate([np.zeros(whole + 1), force])
    readings, speeds = np.empty(force.size), np.empty(force.size)
    for k in range(force.size):
        readings[k], speeds[k] = law.g @ state[:n], state[n]
        if part > 1e-12:
            state = law.run(state, float(sent[k]), part)
        state = law.run(state, float(sent[k + 1]), T - part)
    return readings, speeds
