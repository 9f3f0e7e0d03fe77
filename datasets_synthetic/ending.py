"""How a run ends: at rest, still dying out, oscillating or diverging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Verdict = Literal["settles", "keeps-oscillating", "diverges"]

#: The last two parts of a run that are compared, each so long; what came before is the beginning.
PART = 0.3
#: An amplitude below this part of that before it is dying out, unless another part is stated, ...
DIES = 0.9
#: ... and one above this multiple of it growing.
_GROWS = 1.1
#: Travel below this multiple of the amplitude is what an oscillation leaves of a straight line.
_MORE = 3.0
#: Amplitudes below this part of what is allowed are rounding and said to be none.
_NOTHING = 1e-6
#: Slow motion taken off each part: a polynomial of this degree, so that what creeps to its rest is
#: no oscillation.
_DEGREE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowed:
    """What may be left at the end of a run."""

    counts: float  # amplitude of the readings, and travel beyond the steady one, in counts
    force: float  # amplitude of the force, N (N·m)
    dies: float = DIES  # an amplitude below this part of that before it is dying out
    steady: float = 0.0  # travel of a part at which damping holds what pushes, in counts


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """The end of one run."""

    verdict: Verdict  # "settles", "keeps-oscillating" (or keeps moving) or "diverges"
    at_rest: bool  # whether all that is left is allowed
    #: amplitude of the readings at the end, in counts: √2 times the rms of what is left without
    #: slow motion
    counts: float
    force: float  # likewise of the force, N (N·m)
    reason: str  # half a sentence


def endings(
    position: FloatArray, force: FloatArray, count: FloatArray, allowed: Sequence[Allowed]
) -> list[Ending]:
    """The end of every run, position (m) and force (N) of shape (batch, n), counts in m."""
    with np.errstate(over="ignore", invalid="ignore"):
        parts = _parts(position) / count[:, None, None]
        forces = _parts(force)
        moved, pulled = _amplitudes(parts), _amplitudes(forces)
        # How far the straight line through each part goes.
        place = np.linspace(-1, 1, parts.shape[2])
        travel = np.abs(2 * (parts @ place) / (place @ place))
        travel = np.where(travel > _MORE * moved, travel, 0.0)
        reaches = np.ptp(parts, axis=2), np.ptp(forces, axis=2)
    sizes = zip(moved, pulled, travel, *reaches, strict=True)
    return [_ending(*each, may) for each, may in zip(sizes, allowed, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class _Left:
    """What is left of one quantity in the last two parts of a run."""

    phrase: str  # what it is, with places for its size before and now
    pair: FloatArray  # amplitude or travel in the part before and the last one
    reach: FloatArray  # from the least to the most of all in each of them
    allowed: float  # the most that counts as none
    dies: float  # below this part of what was before it is dying out

    @property
    def over(self) -> bool:
        """Whether more is left than allowed."""
        return bool(self.pair[1] > self.allowed)

    @property
    def lasts(self) -> bool:
        """Whether it is not dying out.

        Amplitude and travel of a slow oscillation depend on its phase, a quantiser makes its own of
        slow motion: what reaches less far than before dies out all the same.
        """
        return bool(np.all([each[1] >= self.dies * each[0] for each in (self.pair, self.reach)]))

    @property
    def grows(self) -> bool:
        """Whether there is clearly more of it than before."""
        return bool(self.pair[1] > _GROWS * self.pair[0])


def _listed(quantities: list[_Left]) -> str:
    """Each with its size before and now."""
    return " and ".join(
        each.phrase.format(*(_shown(size, each.allowed) for size in each.pair))
        for each in quantities
    )


def _ending(
    counts: FloatArray,
    force: FloatArray,
    travel: FloatArray,
    reach: FloatArray,
    pulled: FloatArray,
    allowed: Allowed,
) -> Ending:
    """From what is left in the two last parts, before and after, each shape (2,)."""
    most, dies = allowed.counts, allowed.dies
    readings = _Left("readings from {} to {} counts", counts, reach, most, dies)
    pull = _Left("force from {} to {}", force, pulled, allowed.force, dies)
    # No faster than what pushes makes it, a handle is at rest in this sense, gaining or not.
    beyond = np.maximum(travel - allowed.steady, 0.0)
    moved = _Left("travel from {} to {} counts", beyond, reach, most, dies)
    over = [each for each in (readings, pull, moved) if each.over]
    lasting = [each for each in over if each.lasts]
    growing = [each for each in lasting if each.grows]
    size = f"{_shown(counts[1], allowed.counts)} counts and "
    size += f"{_shown(force[1], allowed.force)} of force"
    limits = f"{allowed.counts:g} counts and {allowed.force:.3g} of force are allowed"
    verdict: Verdict = "settles"
    if not all(np.all(np.isfinite(pair)) for pair in (counts, force, travel)):
        verdict, reason = "diverges", "the motion grew without bound"
    elif not over:
        reason = f"ends with {size}; {limits}"
    elif not lasting:
        reason = f"still dying out: {_listed(over)}; {limits}"
    elif lasting == [moved]:
        verdict = "diverges" if moved.grows else "keeps-oscillating"
        reason = f"moves on by {travel[1]:.3g} counts, after {travel[0]:.3g} as long before"
    elif growing:
        verdict = "diverges"
        beside = [each for each in (readings, pull) if each not in growing]
        also = f"; beside it {_listed(beside)}" if beside else ""
        reason = f"still growing: {_listed(growing)}{also}; {limits}"
    else:
        verdict, reason = "keeps-oscillating", f"keeps oscillating with {size}; {limits}"
    return Ending(
        verdict=verdict,
        at_rest=verdict == "settles" and not over,
        counts=float(counts[1]),
        force=float(force[1]),
        reason=reason,
    )


def _parts(values: FloatArray) -> FloatArray:
    """The last two parts of each run, shape (batch, 2, length)."""
    length = int(PART * values.shape[1])
    return values[:, values.shape[1] - 2 * length :].reshape(values.shape[0], 2, length)


def _amplitudes(parts: FloatArray) -> FloatArray:
    """Amplitude in each part without slow motion, shape (batch, 2)."""
    place = np.linspace(-1, 1, parts.shape[2])
    slow, _ = np.linalg.qr(np.polynomial.legendre.legvander(place, _DEGREE))
    left = parts - (parts @ slow) @ slow.T
    return np.sqrt(2 * np.mean(left**2, axis=2))


def _shown(amplitude: float, allowed: float) -> str:
    """To three digits, rounding errors as none."""
    return "0" if amplitude < _NOTHING * allowed else f"{amplitude:.3g}"
