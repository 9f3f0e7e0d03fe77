"""What a log does not say: noise, unlogged forces, uneven clocks, lost rows, a hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import choose_members

FloatArray = NDArray[np.float64]
Purpose = Literal["position", "force", "coloured", "tremor", "wander", "clock", "rows", "start"]

#: The place of a purpose is part of its seed: new ones go to the end.
_PURPOSES = get_args(Purpose)

#: Lines of a signal in a band, one in each of as many equal parts of it: enough for its values to
#: be all but normal (kurtosis 3 - 1.5/48).
_LINES = 48
#: Golden ratio: where in its part each line stands, all over it, so that the signal never repeats.
_GOLDEN = (1 + 5**0.5) / 2


class Sources:
    """Independent generators of every member, one for each thing that is random."""

    __slots__ = ("_sequences",)

    def __init__(self, seeds: Sequence[int], batch: int) -> None:
        """One seed is spread over the members by numpy's SeedSequence; several are one a member.

        The first member of a batch of one seed is the same as that of a batch of one.
        """
        if len(seeds) == 1:
            self._sequences = np.random.SeedSequence(seeds[0]).spawn(batch)
        else:
            self._sequences = [np.random.SeedSequence(each).spawn(1)[0] for each in seeds]

    def generators(self, purpose: Purpose) -> list[np.random.Generator]:
        """One generator a member, always the same for the same purpose and seed."""
        place = _PURPOSES.index(purpose)
        return [
            np.random.default_rng(
                np.random.SeedSequence(each.entropy, spawn_key=(*each.spawn_key, place))
            )
            for each in self._sequences
        ]


def white_noise(
    sources: Sources, purpose: Purpose, rms: FloatArray, samples: int
) -> FloatArray | None:
    """Normal noise of the given rms (batch,), shape (samples, batch); None if every rms is zero."""
    if not np.any(rms):
        return None
    noise = np.zeros((samples, rms.size))
    for member, source in enumerate(sources.generators(purpose)):
        if rms[member] > 0:
            noise[:, member] = rms[member] * source.standard_normal(samples)
    return noise


def scatter(sources: Sources, spread: FloatArray) -> FloatArray:
    """One number a member, even between -spread and spread, shape (batch,)."""
    if not np.any(spread):
        return np.zeros_like(spread)
    return spread * np.array([each.uniform(-1, 1) for each in sources.generators("start")])


def coloured_noise(
    sources: Sources, rms: FloatArray, correlation_time: FloatArray, stamps: FloatArray
) -> FloatArray | None:
    """Stationary normal noise whose correlation over a time t is exp(-t/correlation_time).

    Args:
        sources: of every member.
        rms: in the unit of the answer, shape (batch,).
        correlation_time: s, shape (batch,).
        stamps: s, shape (n, batch), at which it is taken; need not be even.
    """
    white = white_noise(sources, "coloured", rms, stamps.shape[0])
    if white is None:
        return None
    kept = np.exp(-np.diff(stamps, axis=0) / correlation_time)
    fresh = np.sqrt(-np.expm1(-2 * np.diff(stamps, axis=0) / correlation_time))
    noise = np.empty_like(white)
    noise[0] = white[0]
    for k in range(1, white.shape[0]):
        noise[k] = kept[k - 1] * noise[k - 1] + fresh[k - 1] * white[k]
    return noise


def band_noise(
    sources: Sources,
    purpose: Purpose,
    rms: FloatArray,
    band: tuple[float, float],
    stamps: FloatArray,
) -> FloatArray | None:
    """A sum of sines of equal amplitude spread over a band, in random phases; None if all zero.

    Args:
        sources: of every member.
        purpose: which of its generators to use.
        rms: over a long time, in the unit of the answer, shape (batch,).
        band: lowest and highest frequency, Hz.
        stamps: s, shape (n, batch), at which it is taken; need not be even.
    """
    if not np.any(rms):
        return None
    low, high = band
    place = (np.arange(_LINES) + np.arange(_LINES) * _GOLDEN % 1.0) / _LINES
    turns = 2 * np.pi * (low + (high - low) * place)
    phase = 2 * np.pi * np.stack([each.random(_LINES) for each in sources.generators(purpose)])
    amplitude = rms * np.sqrt(2 / _LINES)
    common = stamps[:, :1]
    time = common if np.array_equal(np.broadcast_to(common, stamps.shape), stamps) else stamps
    noise = np.zeros(stamps.shape)
    for line, turn in enumerate(turns):
        angle = turn * time
        noise += np.sin(angle) * (amplitude * np.cos(phase[:, line]))
        noise += np.cos(angle) * (amplitude * np.sin(phase[:, line]))
    return noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """What disturbs the log; numbers, or arrays of shape (batch,).

    Attributes:
        position_noise: rms of white noise added to the position before rounding, m (rad).
        force_noise: rms of a white force that acts but is not logged, held one sample, N (N·m).
        coloured_force: rms of a slower unlogged force, held one sample, N (N·m), ...
        correlation_time: ... whose correlation over a time t is exp(-t/correlation_time), s.
        start_spread: the device starts anywhere within this of its stated start, evenly, m (rad):
            where between two counts it stands is chance.
    """

    position_noise: float | FloatArray = 0.0
    force_noise: float | FloatArray = 0.0
    coloured_force: float | FloatArray = 0.0
    correlation_time: float | FloatArray = 0.1
    start_spread: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        if np.any(np.asarray(self.correlation_time) <= 0):
            raise ValueError(f"correlation_time must be positive, not {self.correlation_time}")

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        noise = (self.position_noise, self.force_noise, self.start_spread)
        return [np.size(field) for field in (*noise, self.coloured_force, self.correlation_time)]


#: Jitter is cut at this part of the shortest step, so that stamps never meet.
_FURTHEST = 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """Uneven sampling and lost rows; the log carries the true stamps.

    The device is read, and its force renewed, at the uneven instants themselves. Rows are lost from
    the log only: the loop ran at every sample.

    Attributes:
        steps: lengths of the steps, s, taken in turn, over and over; empty means the rig's
            sample time at every step.
        jitter: rms of each stamp about its even place, normal, cut at 45 % of the shortest step,
            s, a number or shape (batch,). It does not add up; the first stamp is 0.
        dropped: probability of each row but the first and the last to be lost, 0 to below 1, a
            number or shape (batch,).
    """

    steps: tuple[float, ...] = ()
    jitter: float | FloatArray = 0.0
    dropped: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        if any(step <= 0 for step in self.steps):
            raise ValueError(f"steps of a clock must be positive, not {self.steps}")
        if np.any(np.asarray(self.jitter) < 0):
            raise ValueError(f"jitter must not be negative, not {self.jitter}")
        lost = np.asarray(self.dropped)
        if np.any((lost < 0) | (lost >= 1)):
            raise ValueError(f"dropped must be at least 0 and less than 1, not {self.dropped}")

    @property
    def even(self) -> bool:
        """Whether every step is the rig's sample time."""
        return not self.steps and not np.any(self.jitter)

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(self.jitter), np.size(self.dropped)]

    def nominal(self, sample_time: FloatArray) -> FloatArray:
        """Mean step, s, shape (batch,): what the filters of a controller are made for."""
        return np.full_like(sample_time, np.mean(self.steps)) if self.steps else sample_time

    def stamps(self, sample_time: FloatArray, samples: int, sources: Sources) -> FloatArray:
        """True stamps, s, shape (samples, batch), from zero and increasing."""
        if self.steps:
            turns = np.resize(np.asarray(self.steps, dtype=np.float64), samples)
            places = np.concatenate(([0.0], np.cumsum(turns)[:-1]))
            stamps = np.repeat(places[:, None], sample_time.size, axis=1)
            shortest = np.full_like(sample_time, min(self.steps))
        else:
            stamps = np.arange(samples, dtype=np.float64)[:, None] * sample_time
            shortest = sample_time
        jitter = np.broadcast_to(np.asarray(self.jitter, dtype=np.float64), sample_time.shape)
        if not np.any(jitter):
            return stamps
        for member, source in enumerate(sources.generators("clock")):
            if jitter[member] > 0:
                bound = _FURTHEST * shortest[member]
                moved = np.clip(jitter[member] * source.standard_normal(samples), -bound, bound)
                stamps[1:, member] += moved[1:]
        return stamps

    def kept(self, batch: int, samples: int, sources: Sources) -> NDArray[np.bool_] | None:
        """Which rows reach the log, shape (batch, samples); None if all of them do."""
        dropped = np.broadcast_to(np.asarray(self.dropped, dtype=np.float64), (batch,))
        if not np.any(dropped):
            return None
        generators = sources.generators("rows")
        rows = np.stack([each.random(samples) for each in generators]) >= dropped[:, None]
        rows[:, [0, -1]] = True
        return rows


#: Physiological tremor of hand and forearm, Hz (R. J. Elble, W. C. Koller, Tremor, 1990).
TREMOR_BAND = (8.0, 12.0)
#: Voluntary motion of a hand that is not tracking anything fast, Hz.
WANDER_BAND = (0.1, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """Mass, damper and spring that move with the handle; numbers, or arrays of shape (batch,).

    The spring and the damper are fixed to ground, the spring at the rest position.

    Attributes:
        mass: of the hand, kg (kg·m²), added to that of the device.
        damping: N·s/m (N·m·s/rad).
        stiffness: N/m (N·m/rad).
        rest: where the spring is relaxed, m (rad).
        tremor: rms of an unlogged force of 8 to 12 Hz, held one sample, N (N·m).
        wander: rms of a slow voluntary motion of the rest position, 0.1 to 1 Hz, m (rad).
    """

    mass: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    stiffness: float | FloatArray = 0.0
    rest: float | FloatArray = 0.0
    tremor: float | FloatArray = 0.0
    wander: float | FloatArray = 0.0

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Hand:
        """The hands on these members, shape (members,); a value that all share stays a number."""
        return Hand(**{name: choose_members(getattr(self, name), which) for name in _FIELDS})

    def push(self, sources: Sources, stamps: FloatArray) -> FloatArray | None:
        """Force of tremor and voluntary motion (its spring at zero apart), N, shape (n, batch).

        None where both are nothing.
        """

        def column(values: float | FloatArray) -> FloatArray:
            return np.broadcast_to(np.asarray(values, dtype=np.float64), stamps.shape[1:])

        moved = column(self.stiffness) * column(self.wander)
        tremor = band_noise(sources, "tremor", column(self.tremor), TREMOR_BAND, stamps)
        wander = band_noise(sources, "wander", moved, WANDER_BAND, stamps)
        parts = [part for part in (tremor, wander) if part is not None]
        return sum(parts[1:], start=parts[0]) if parts else None


_FIELDS = ("mass", "damping", "stiffness", "rest", "tremor", "wander")
