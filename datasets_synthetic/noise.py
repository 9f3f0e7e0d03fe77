"""Noise of a batch, each member from its own generators: white, coloured, band-limited."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

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
