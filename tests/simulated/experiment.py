"""The stability limit of a simulated device, found as at the bench: raise a gain until it rings.

Every trial pushes the device once and looks at the readings alone. Many gains are tried at once;
the next round tries as many between the last gain that let the push die out and the first that
did not.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Controller, Hand, Rig, simulate
from datasets_synthetic.device import per_member

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
EffectName = Literal["stiffness", "damping", "mass"]

EFFECTS: tuple[EffectName, ...] = ("stiffness", "damping", "mass")
#: The push, in counts of the encoder a sample: fast enough that rounding is small beside it.
_COUNTS = 100.0
#: Speeds below so many counts a sample, rms, are the encoder's own and do not last.
_NOISE = 3.0
#: Speeds below this part of the largest position are its rounding.
_ROUNDING = 1e-13
#: Part by which an envelope has to fall in a quarter of the run for the push to die out.
_STEADY = 1e-3
#: The first round looks for the decade only, on this part of the samples.
_FIRST_LOOK = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Where a push no longer dies out, shape (batch,), in multiples of the given gains."""

    low: FloatArray  # the largest gain tried below which, and at which, every push died out
    high: FloatArray  # the smallest gain tried at which a push lasted; inf if none did

    @property
    def middle(self) -> FloatArray:
        """Half way between both."""
        return (self.low + self.high) / 2

    @property
    def width(self) -> FloatArray:
        """high - low over their middle; inf where no gain lasted."""
        apart = np.subtract(self.high, self.low) / np.where(np.isinf(self.high), 1.0, self.middle)
        return np.asarray(apart)


def limit_by_experiment(
    rig: Rig,
    controller: Controller,
    *,
    raised: tuple[EffectName, ...] = EFFECTS,
    between: tuple[float, float] | tuple[FloatArray, FloatArray],
    hand: Hand | None = None,
    speed: float | None = None,
    samples: int = 4000,
    trials: int = 20,
    rounds: int = 3,
) -> Limit:
    """Multiplies some effects of a controller until a push lasts instead of dying out.

    A push starts the handle at a speed. It lasts if the speed of the readings (their difference a
    sample) in the last half of the run is no smaller than a quarter of the run earlier, by 0.1 %:
    rms under two overlapping bell-shaped windows of half the run each. So growth lasts, and an
    oscillation that the force limit bounds does too. Speeds of a few counts a sample do not count,
    so that what an encoder sustains is not taken for growth; motion that is not finite does.

    Args:
        rig: the devices.
        controller: effects; one gain multiplies those that are raised, the others stay.
        raised: which effects.
        between: gains to look between, numbers or shape (batch,); below the lower one if a push
            lasts there already.
        hand: on the handle, or None.
        speed: of the push, m/s (rad/s); None for a hundred counts a sample, or one if the reading
            is exact.
        samples: of each run; the envelope is steady to 1e-3 if its oscillation turns ten times in
            a quarter of them.
        trials: gains tried at once.
        rounds: how often the bracket is divided by trials + 1, after a first one that divides the
            range evenly in proportion.

    Returns:
        The bracket of every device.
    """
    hand = hand or Hand()
    batch = max(rig.batch, controller.size(), *hand.sizes(), np.size(between[0]))
    low, high = per_member(between[0], batch), per_member(between[1], batch)
    counts = _COUNTS * rig.encoder_resolution / rig.sample_time
    pushed = np.where(counts > 0, counts, 1.0) if speed is None else speed
    which = np.repeat(np.arange(batch), trials)
    rigs = rig.members(which if rig.batch > 1 else np.zeros_like(which))
    law, hands, start = controller.members(which), hand.members(which), per_member(pushed, batch)

    def lasts(gains: FloatArray, length: int) -> BoolArray:
        """Whether a push lasts at each gain, shape (batch, trials)."""
        multiplied = {name: gains.ravel() * getattr(law, name) for name in raised}
        recording = simulate(
            rigs,
            np.zeros(length),
            controller=replace(law, **multiplied),
            hand=hands,
            velocity=start[which],
        )
        return lasting(recording.position, rigs.encoder_resolution).reshape(batch, trials)

    step = np.arange(trials) / (trials - 1)
    gains = low[:, None] * (high / low)[:, None] ** step
    below, above = np.zeros(batch), np.full(batch, np.inf)
    for turn in range(rounds):
        found = lasts(gains, round(samples * _FIRST_LOOK) if turn == 0 else samples)
        edges = np.column_stack([below, gains, above])
        first = np.where(found.any(axis=1), np.argmax(found, axis=1), trials)
        rows = np.arange(batch, dtype=np.intp)
        if turn > 0:
            rows = np.flatnonzero(np.isfinite(above))  # elsewhere there is nothing to divide
        below[rows], above[rows] = edges[rows, first[rows]], edges[rows, first[rows] + 1]
        top = np.where(np.isinf(above), below, above)
        gains = below[:, None] + (top - below)[:, None] * (np.arange(trials) + 1) / (trials + 1)
    return Limit(low=below, high=above)


def lasting(position: FloatArray, resolution: FloatArray) -> BoolArray:
    """Whether readings (m, shape (batch, n)) of counts (m, shape (batch,)) do not come to rest."""
    with np.errstate(over="ignore", invalid="ignore"):
        speed = np.diff(position, axis=1)
        half = speed.shape[1] // 2
        bell = np.hanning(half)
        early, late = (
            np.sqrt((speed[:, first : first + half] ** 2) @ bell / np.sum(bell))
            for first in (speed.shape[1] - half - half // 2, speed.shape[1] - half)
        )
        floor = _NOISE * resolution + _ROUNDING * np.max(np.abs(position), axis=1)
        return ~np.isfinite(late) | ((late > (1 - _STEADY) * early) & (late > floor))
