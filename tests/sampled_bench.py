"""The exact limit of a gain on a simulated bench, by the eigenvalues of one sample.

The equations of mechanism, actuator, delay, filters and controller are run once more, on unit
vectors: one sample of the closed loop is a matrix, its continuous part scipy's exponential. Nothing
of the simulator, of ``tune`` or of `tests.reference` is used, with which it is compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

FloatArray = NDArray[np.float64]

#: An eigenvalue this near z = 1 is the position that no spring holds.
_AT_ONE = 1e-7
#: Gains tried from the smallest up, before the first unstable one is bracketed.
_TRIED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledBench:
    """One loop in plain numbers; modes are (Hz, ratio, at encoder, at handle)."""

    mass: float
    damping: float
    sample_time: float
    delay: float = 0.0
    current_lag: float = 0.0
    modes: tuple[tuple[float, float, float, float], ...] = ()
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)
    own_stiffness: float = 0.0
    velocity_filter_hz: float = np.inf
    acceleration_filter_hz: float = np.inf
    velocity_filter_order: int = 1
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = 1.0
    velocity_window_samples: int = 1

    def limit(self, ray: tuple[float, float, float], high: float) -> float:
        """Smallest s in (0, high] at which s·(K, B, M) turns unstable, to 1e-10."""
        bare = self._matrix(0.0, 0.0, 0.0)
        along = self._matrix(*ray) - bare  # the loop is affine in its gains
        held = self._held(ray)

        def unstable(gain: float) -> bool:
            return self._radius(bare + gain * along, held=held) > 1

        tried = np.geomspace(high / 1e4, high, _TRIED)
        above = float(next(gain for gain in tried if unstable(float(gain))))
        below = above * float(tried[0] / tried[1])
        while above - below > 1e-10 * above:
            middle = (above + below) / 2
            below, above = (below, middle) if unstable(middle) else (middle, above)
        return (below + above) / 2

    def radii(self, ray: tuple[float, float, float], gains: FloatArray) -> FloatArray:
        """Largest modulus of the closed loop at each gain times (K, B, M), free motion left out."""
        bare = self._matrix(0.0, 0.0, 0.0)
        along = self._matrix(*ray) - bare
        held = self._held(ray)
        return np.array([self._radius(bare + gain * along, held=held) for gain in gains.tolist()])

    def _held(self, gains: tuple[float, float, float]) -> bool:
        return gains[0] != 0 or self.hand[2] > 0 or self.own_stiffness != 0

    @staticmethod
    def _radius(loop: FloatArray, *, held: bool) -> float:
        """Largest modulus of the closed loop; without any spring the pole z = 1 is left out."""
        values = np.linalg.eigvals(loop)
        if not held:
            away = np.abs(values - 1)
            assert np.min(away) < _AT_ONE
            values = np.delete(values, np.argmin(away))
        return float(np.max(np.abs(values)))

    def _continuous(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A and the column of the command of (q, q', Fa), and the row of the reading."""
        m, (mh, bh, kh) = self.mass, self.hand
        g = np.array([1.0, *(mode[2] for mode in self.modes)])
        p = np.array([1.0, *(mode[3] for mode in self.modes)])
        w = np.array([2 * np.pi * mode[0] for mode in self.modes])
        z = np.array([mode[1] for mode in self.modes])
        n = g.size
        inverse = np.linalg.inv(m * np.eye(n) + mh * np.outer(p, p))
        loss = np.diag([self.damping, *(2 * z * w * m)]) + bh * np.outer(p, p)
        spring = np.diag([self.own_stiffness, *(w * w * m)]) + kh * np.outer(p, p)
        a = np.zeros((2 * n + 1, 2 * n + 1))
        command = np.zeros(2 * n + 1)
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n], a[n : 2 * n, n : 2 * n] = -inverse @ spring, -inverse @ loss
        if self.current_lag > 0:
            a[n : 2 * n, 2 * n] = inverse @ g
            a[2 * n, 2 * n], command[2 * n] = -1 / self.current_lag, 1 / self.current_lag
        else:
            command[n : 2 * n] = inverse @ g
            a, command = a[: 2 * n, : 2 * n], command[: 2 * n]
        return a, command, np.concatenate([g, np.zeros(a.shape[0] - n)])

    def _matrix(self, stiffness: float, damping: float, mass: float) -> FloatArray:
        """State: mechanism, the commands on their way, the last readings, the filters."""
        a, command, row = self._continuous()
        T, size = self.sample_time, a.shape[0]
        whole = int(np.floor(self.delay / T + 1e-9))
        part = self.delay - whole * T
        part = 0.0 if part < 1e-9 * T else part

        def over(time: float) -> tuple[FloatArray, FloatArray]:
            both = np.zeros((size + 1, size + 1))
            both[:size, :size], both[:size, size] = a, command
            both = expm(both * time)
            return both[:size, :size], both[:size, size]

        early, early_push = over(part)
        late, late_push = over(T - part)
        readings = max(2, self.velocity_window_samples)
        t1, p1 = self._section(self.velocity_filter_hz, self.velocity_filter_order)
        t2, p2 = self._section(self.acceleration_filter_hz, self.acceleration_filter_order)

        def sample(state: FloatArray) -> FloatArray:
            x, sent, last, v, acc = np.split(state, np.cumsum([size, whole + 1, readings, 2]))
            y = row @ x
            n = self.velocity_window_samples
            slope = (y - last[n - 1]) / (n * T)
            bend = (y - 2 * last[0] + last[1]) / T**2
            velocity = t1 * v[0] - p1 * v[1] + (1 - t1 + p1) * slope
            acceleration = t2 * acc[0] - p2 * acc[1] + (1 - t2 + p2) * bend
            force = -(stiffness * y + damping * velocity + mass * acceleration)
            on_the_way = np.concatenate([[force], sent])  # of this sample, one before, ..
            x = early @ x + early_push * on_the_way[whole + 1]
            x = late @ x + late_push * on_the_way[whole]
            return np.concatenate(
                [x, on_the_way[:-1], [y], last[:-1], [velocity, v[0]], [acceleration, acc[0]]]
            )

        count = size + whole + 1 + readings + 4
        return np.stack([sample(unit) for unit in np.eye(count)], axis=1)

    def _section(self, cutoff: float, order: int) -> tuple[float, float]:
        """(t, p) of z² - t·z + p from the poles themselves."""
        if np.isinf(cutoff):
            return 0.0, 0.0
        turn = 2 * np.pi * cutoff * self.sample_time
        if order == 1:
            return float(np.exp(-turn)), 0.0
        z = self.filter_damping_ratio
        pole = np.exp(-turn * (z + 1j * np.sqrt(1 - z * z)))
        other = np.exp(-turn * (z - 1j * np.sqrt(1 - z * z)))
        return float((pole + other).real), float((pole * other).real)
