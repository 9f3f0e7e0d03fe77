"""The stability limit of a simulated device, found as at the bench: raise a gain until it rings.

Every trial pushes the device once and looks at the readings alone. Many gains are tried at once;
the next round tries as many between the last gain that let the push die out and the first that
did not.
"""

from __future__ import annotations

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
    """Where a push no longer dies out; each array shape (batch,), in multiples of the given gains.

    Attributes:
        low: the largest gain tried below which, and at which, every push died out.
        high: the smallest gain tried at which a push lasted; inf if none did.
        duration: of the last trials, s.
    """

    low: FloatArray
    high: FloatArray
    duration: FloatArray

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
    force: float | FloatArray = 0.0,
    speed: float | FloatArray | None = None,
    position: float | FloatArray = 0.0,
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

    What the verdict of a real device is worth, against that of its linear loop: Coulomb friction
    makes the limit look higher, the more the slower the push; a force limit likewise, the more the
    faster the push; an encoder makes it look lower, by a percent or so; a one-sided wall makes it
    look higher where the push leaves the wall, for the flight takes energy.

    Args:
        rig: the devices.
        controller: effects; one gain multiplies those that are raised, the others stay.
        raised: which effects.
        between: gains to look between, numbers or shape (batch,); below the lower one if a push
            lasts there already.
        hand: on the handle, or None.
        force: constant push of a hand, N (N·m), a number or shape (batch,).
        speed: of the push, m/s (rad/s), a number or shape (batch,); None for a hundred counts a
            sample, or one if the reading is exact.
        position: where the push starts, m (rad).
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
    if not np.all((low > 0) & (high > low)):
        raise ValueError(f"gains to look between must be positive and rising, not {between}")
    which = np.repeat(np.arange(batch), trials)
    bench = _Bench(
        rig=_of(rig, which),
        controller=controller.members(which),
        raised=raised,
        hand=hand.members(which),
        force=per_member(force, batch)[which],
        speed=_speed(rig, speed, batch)[which],
        position=per_member(position, batch)[which],
    )
    step = np.arange(trials) / (trials - 1)
    gains = low[:, None] * (high / low)[:, None] ** step
    below, above = np.zeros(batch), np.full(batch, np.inf)
    for turn in range(rounds):
        length = round(samples * _FIRST_LOOK) if turn == 0 else samples
        lasts = bench.lasts(gains.ravel(), length).reshape(batch, trials)
        edges = np.column_stack([below, gains, above])
        first = np.where(lasts.any(axis=1), np.argmax(lasts, axis=1), trials)
        rows = np.arange(batch, dtype=np.intp)
        if turn > 0:
            rows = np.flatnonzero(np.isfinite(above))  # elsewhere there is nothing to divide
        below[rows], above[rows] = edges[rows, first[rows]], edges[rows, first[rows] + 1]
        top = np.where(np.isinf(above), below, above)
        gains = below[:, None] + (top - below)[:, None] * (np.arange(trials) + 1) / (trials + 1)
    duration = samples * per_member(rig.sample_time, batch)
    return Limit(low=below, high=above, duration=duration)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bench:
    """Everything of a run but the gain; one member a trial."""

    rig: Rig
    controller: Controller
    raised: tuple[EffectName, ...]
    hand: Hand
    force: FloatArray
    speed: FloatArray
    position: FloatArray

    def lasts(self, gains: FloatArray, samples: int) -> BoolArray:
        """Whether a push lasts at each gain, shape (trials,)."""
        multiplied = {name: gains * getattr(self.controller, name) for name in self.raised}
        recording = simulate(
            self.rig,
            np.zeros(samples),
            controller=replace(self.controller, **multiplied),
            hand=self.hand,
            position=self.position,
            velocity=self.speed,
            push=np.broadcast_to(self.force[:, None], (gains.size, samples)),
        )
        return lasting(recording.position, self.rig.encoder_resolution)


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


def _speed(rig: Rig, speed: float | FloatArray | None, batch: int) -> FloatArray:
    if speed is not None:
        return per_member(speed, batch)
    counts = _COUNTS * rig.encoder_resolution / rig.sample_time
    return per_member(np.where(counts > 0, counts, 1.0), batch)


def _of(rig: Rig, which: NDArray[np.intp]) -> Rig:
    return rig.members(which if rig.batch > 1 else np.zeros_like(which))
