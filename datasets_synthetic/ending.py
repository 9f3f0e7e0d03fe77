"""How a trial ends: at rest, oscillating or diverging, and what a contact gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import Hand, Rig, per_member
from datasets_synthetic.law import Controller
from datasets_synthetic.simulation import Recording, simulate

FloatArray = NDArray[np.float64]
Verdict = Literal["settles", "keeps-oscillating", "diverges"]

#: The last two parts of a run that are compared, each so long; what came before is the beginning.
_PART = 0.3
#: An amplitude below this part of that before it is dying out, ...
_DIES = 0.9
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

    counts: float  # amplitude of the readings, and travel if nothing pushes, in counts
    force: float  # amplitude of the force, N (N·m)
    pushed: bool = False  # whether something pushes to the end: then steady travel is no fault


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
    """The end of every run, position (m) and force (N) of shape (batch, n).

    Count of the encoder, m, and what is allowed are one a run.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        parts = _parts(position) / count[:, None, None]
        forces = _parts(force)
        moved, pulled = _amplitudes(parts), _amplitudes(forces)
        travel = _travel(parts)
        travel = np.where(travel > _MORE * moved, travel, 0.0)
        reaches = np.ptp(parts, axis=2), np.ptp(forces, axis=2)
    sizes = zip(moved, pulled, travel, *reaches, strict=True)
    return [_ending(*each, may) for each, may in zip(sizes, allowed, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Left:
    """What is left of one quantity in the last two parts of a run."""

    phrase: str  # what it is, with places for its size before and now
    pair: FloatArray  # amplitude or travel in the part before and the last one
    reach: FloatArray  # from the least to the most of all in each of them
    allowed: float  # the most that counts as none

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
        return bool(np.all([each[1] >= _DIES * each[0] for each in (self.pair, self.reach)]))

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
    readings = _Left(
        phrase="readings from {} to {} counts", pair=counts, reach=reach, allowed=allowed.counts
    )
    pull = _Left(phrase="force from {} to {}", pair=force, reach=pulled, allowed=allowed.force)
    moved = _Left(
        phrase="travel from {} to {} counts", pair=travel, reach=reach, allowed=allowed.counts
    )
    left = [readings, pull]
    # Steady travel under a push is at rest in this sense; travel that gains is not.
    left += [moved] if moved.grows or not allowed.pushed else []
    over = [each for each in left if each.over]
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
    length = int(_PART * values.shape[1])
    return values[:, values.shape[1] - 2 * length :].reshape(values.shape[0], 2, length)


def _amplitudes(parts: FloatArray) -> FloatArray:
    """Amplitude in each part without slow motion, shape (batch, 2)."""
    place = np.linspace(-1, 1, parts.shape[2])
    slow, _ = np.linalg.qr(np.polynomial.legendre.legvander(place, _DEGREE))
    left = parts - (parts @ slow) @ slow.T
    return np.sqrt(2 * np.mean(left**2, axis=2))


def _travel(parts: FloatArray) -> FloatArray:
    """How far the straight line through each part goes, shape (batch, 2)."""
    place = np.linspace(-1, 1, parts.shape[2])
    return np.abs(2 * (parts @ place) / (place @ place))


def _shown(amplitude: float, allowed: float) -> str:
    """To three digits, rounding errors as none."""
    return "0" if amplitude < _NOTHING * allowed else f"{amplitude:.3g}"


#: Growth of the energy over that of every contact before that is taken for none: what the friction
#: of a fraction of a sample, between the wall and the reading that finds it, may make of it.
GROWTH = 0.01
#: Counts of travel that an encoder may hide: energy below what the push and the spring do over
#: them is not counted.
_COUNTS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounces:
    """What each device brought to its contacts with the wall, one entry a device.

    Attributes:
        time: of the sample that found each contact, s, shape (contacts,) of each device.
        energy: of motion and springs on reaching the wall, J, the work of the push taken off;
            shape (contacts,) of each device.
        floor: energy within the resolution of the encoder, J, shape (batch,).
        grows: whether a contact had more energy than any before it, by more than ``GROWTH`` and
            the floor; also where the motion became infinite; shape (batch,).
        recording: of all of it.
    """

    time: tuple[FloatArray, ...]
    energy: tuple[FloatArray, ...]
    floor: FloatArray
    grows: NDArray[np.bool_]
    recording: Recording

    def speed(self, mass: float, member: int = 0) -> FloatArray:
        """Speed at each contact of a rigid mass of this energy, m/s (rad/s), shape (contacts,)."""
        return np.sqrt(2 * self.energy[member] / mass)

    def largest_ratio(self, member: int = 0) -> float:
        """Largest energy of a contact, less the floor, over the most of any before; 0 for none."""
        return largest_ratio(self.energy[member], self.floor[member])


def bounce(
    rig: Rig,
    controller: Controller,
    *,
    push: float | FloatArray,
    drop: float | FloatArray,
    hand: Hand | None = None,
    samples: int = 4000,
    seed: int = 0,
) -> Bounces:
    """Lets a constant push carry each handle from rest into its wall, again and again.

    Args:
        rig: the devices: delay, quantiser, friction and force limit are theirs.
        controller: effects with a wall above its face (``side`` -1).
        push: of the hand towards the wall, N (N·m), positive, a number or shape (batch,).
        drop: how far before the wall it starts, m (rad), positive, a number or shape (batch,).
        hand: whose mass, damper and spring are on the handle; its spring is relaxed at the start
            of the wall unless ``rest`` says otherwise.
        samples: of the run.
        seed: of tremor, if the hand has any.

    Raises:
        ValueError: there is no wall to fall into.
    """
    hand = hand or Hand()
    faces = [each.place for each in controller.elements if np.all(np.less(each.side, 0))]
    if not faces:
        raise ValueError("there is no wall to fall into: give the controller an element of side -1")
    batch = max(rig.batch, controller.size(), *hand.sizes(), np.size(push), np.size(drop))
    column = partial(per_member, batch=batch)
    place, pushed = column(faces[0]), column(push)
    recording = simulate(
        rig,
        np.zeros(samples),
        controller=controller,
        hand=hand,
        position=place - column(drop),
        push=np.broadcast_to(pushed[:, None], (batch, samples)),
        watch=True,
        seed=seed,
    )
    net = pushed - column(rig.force_offset)
    floor = energy_floor(net, column(rig.encoder_resolution), column(controller.total_stiffness()))
    found = [contacts(recording, k, place[k], net[k]) for k in range(batch)]
    finite = np.all(np.isfinite(recording.position), axis=1)
    more = [grows(energy, least) for (_, energy), least in zip(found, floor, strict=True)]
    return Bounces(
        time=tuple(each for each, _ in found),
        energy=tuple(each for _, each in found),
        floor=floor,
        grows=~finite | more,
        recording=recording,
    )


def energy_floor(net: FloatArray, resolution: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Energy within the resolution of the encoder, J, shape (batch,).

    From the force in front of the wall, N (N·m), and the stiffness of all that acts, N/m (N·m/rad).
    """
    count = _COUNTS * resolution
    return np.abs(net) * count + 0.5 * np.abs(stiffness) * count**2


def grows(energy: FloatArray, floor: float) -> bool:
    """Whether a contact had clearly more energy than any before it, J, shape (contacts,)."""
    return bool(np.any(energy[1:] > (1 + GROWTH) * _largest_before(energy) + floor))


def largest_ratio(energy: FloatArray, floor: float) -> float:
    """Largest energy of a contact, J, shape (contacts,), less the floor, over the most before.

    0 where there was one contact or none.
    """
    if energy.size < 2:
        return 0.0
    return float(np.max((energy[1:] - floor) / _largest_before(energy)))


def _largest_before(energy: FloatArray) -> FloatArray:
    """Most energy of all contacts before each but the first, J."""
    return np.maximum.accumulate(energy)[:-1]


def contacts(
    recording: Recording, member: int, place: float, net: float
) -> tuple[FloatArray, FloatArray]:
    """Time (s) of each sample that finds the wall, and the energy (J) brought there.

    This is what the handle had on reaching ``place`` (m) but for the work of the ``net`` force (N)
    beyond it, which is taken off; what a damper took before the face is gone.

    Both answers have shape (contacts,).
    """
    assert recording.truth is not None
    inside = recording.position[member] > place
    entered = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1
    truth = recording.truth
    energy = truth.energy[member][entered] - net * (truth.handle[member][entered] - place)
    return recording.instants(member)[entered], energy
