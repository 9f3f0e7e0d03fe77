"""Optimal excitation: the force that tells mass and damping with the least intervals.

Three families of signals are brought to their best within the limits and compared. What is played
is the net force of the best, plus the friction of the guessed device while it moves, so that
friction neither holds the device nor bends its path, and the constant force guessed. Every corner
of the guesses is then simulated exactly and the force scaled until none of them leaves its limits;
for the force that is played, devices between the corners too. One file: the steps of one plan, in
their order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.planning.design_grid import DesignGrid
from identification.planning.families import Family, Shape, binaries, multisines, swept_sines
from identification.planning.information import Prediction, predict
from identification.planning.response import Response
from identification.planning.spec import ExcitationSpec
from identification.planning.stick_slip import Guess, simulate_stick_slip
from identification.planning.two_stage import gentle_spec
from identification.planning.worst_motion import (
    BETWEEN,
    Region,
    WorstMotion,
    extremes,
    worst_motions,
)

FloatArray = NDArray[np.float64]

_FAMILIES: tuple[tuple[str, Callable[[DesignGrid], list[Shape]]], ...] = (
    ("multisine", multisines),
    ("swept sine", swept_sines),
    ("binary sequence", binaries),
)
#: Part of the limits aimed at: what is left covers the rounding of the force in its file.
_AIM = 0.999
#: Fitting to the limits ends when this much of one of them is used, ...
_ENOUGH = 0.985
#: ... or after this many simulations of all corners.
_TRIES = 12
#: A force scaled down to this part of what the guess alone would allow tells next to nothing.
_LEAST = 0.1
#: Friction is made up for from this part of the peak speed on; below it comes in smoothly.
_SMOOTH = 0.01
#: Significant digits of a force in its file: a millionth of the limit is below any amplifier.
_DIGITS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Used:
    """Parts of the limits of force, travel and speed; speed 0 where it has no limit."""

    force: float
    travel: float
    speed: float

    @property
    def most(self) -> float:
        """The largest of them."""
        return max(self.force, self.travel, self.speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """The best force of one family.

    Attributes:
        family: "multisine", "swept-sine" or "binary".
        band: its lowest and its highest frequency, Hz.
        lines: how many frequencies it has; 0 where it sweeps through all of the band.
        force: N (N·m), shape (n,), held from sample to sample, zero at both ends.
        prediction: motion of the guessed device and Cramér-Rao bound.
        used: parts of the limits that the worst corner uses.
    """

    family: Family
    band: tuple[float, float]
    lines: int
    force: FloatArray
    prediction: Prediction
    used: Used

    @property
    def description(self) -> str:
        """Its frequencies in words."""
        lines = f"{self.lines} lines, " if self.lines else ""
        return f"{lines}{self.band[0]:.3g} to {self.band[1]:.3g} Hz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """A planned force and what it is predicted to tell.

    Attributes:
        spec: limits and guesses it was planned for; of a gentle play the narrower limits and wider
            guesses that make it gentle.
        candidates: the best of each family, the best of all first.
        worst: how far and how fast the best moves devices other than guessed.
    """

    spec: ExcitationSpec
    candidates: tuple[Candidate, ...]
    worst: tuple[WorstMotion, ...]

    def __repr__(self) -> str:
        return (
            f"Excitation({len(self.best.force)} samples of {self.best.family}, expected half-width "
            f"mass {self.mass:.3g}, damping {self.damping:.3g}; {len(self.candidates)} candidates)"
        )

    @property
    def best(self) -> Candidate:
        """The candidate to be played."""
        return self.candidates[0]

    @property
    def time(self) -> FloatArray:
        """s, shape (n,)."""
        return np.arange(self.best.force.size, dtype=np.float64) * self.spec.sample_time

    @property
    def beyond(self) -> tuple[WorstMotion, ...]:
        """Which of the worst motions leave the travel or the speed allowed."""
        speed = self.spec.speed or np.inf
        return tuple(
            each for each in self.worst if each.travel > self.spec.travel or each.speed > speed
        )

    @property
    def mass(self) -> float:
        """Predicted half-width of the 95 % interval of the mass, kg (kg·m²)."""
        return self.best.prediction.mass

    @property
    def damping(self) -> float:
        """Predicted half-width of the 95 % interval of the damping, N·s/m (N·m·s/rad)."""
        return self.best.prediction.damping


def plan_excitation(
    spec: ExcitationSpec, *, progress: Callable[[str], None] | None = None
) -> Excitation:
    """The multisine, swept sine or binary signal with the least product of both intervals.

    Args:
        spec: limits and guesses.
        progress: called with a sentence before each part of the work.

    Raises:
        InvalidInputError: no force keeps every device the guesses allow within the limits.
    """

    def say(sentence: str) -> None:
        if progress is not None:
            progress(sentence)

    wanted = gentle_spec(spec) if spec.gentle else spec
    bench = DesignGrid.of(wanted)
    found: list[tuple[Candidate, Shape]] = []
    used: list[Used] = []
    for name, family in _FAMILIES:
        say(f"designing a {name}")
        tried = [(_fitted(bench, shape, _corners_used), shape) for shape in family(bench)]
        fitting = [(each, shape) for each, shape in tried if isinstance(each, Candidate)]
        used += [each for each, _ in tried if isinstance(each, Used)]
        if fitting:
            found.append(min(fitting, key=_product))
    say("looking for the devices that go farthest")
    found.sort(key=_product)
    while found and wanted.ranges:
        secured = _fitted(bench, found[0][1], _used)
        if isinstance(secured, Candidate):
            found[0] = (secured, found[0][1])
            break
        used.insert(0, secured)
        del found[0]
    if not found:
        raise InvalidInputError("excitation", *_impossible(wanted, used[0]))
    candidates = tuple(candidate for candidate, _ in found)
    return Excitation(
        spec=wanted,
        candidates=candidates,
        worst=worst_motions(spec, candidates[0].force),
    )


def _fitted(
    bench: DesignGrid, shape: Shape, judge: Callable[[ExcitationSpec, FloatArray], Used]
) -> Candidate | Used:
    """The shape on the controller's samples, friction and offset made up for, within all limits.

    Returns what the last try used of the limits, by the judge, if none keeps them.
    """
    spec = bench.spec
    step = spec.sample_time
    net = shape.force((np.arange(spec.samples, dtype=np.float64) + 0.5) * step)
    guess = _device(spec.corners()[0])
    response = Response(rate=guess.rate, step=step, count=net.size, noise=1.0)
    speed = response.speed(net / guess.mass)
    middle = (speed + np.concatenate(([0.0], speed[:-1]))) / 2
    sense = middle / np.hypot(middle, _SMOOTH * np.max(np.abs(middle)))
    scale, accepted = 1.0, 0.0
    best: tuple[FloatArray, Used] | None = None
    used = Used(force=0.0, travel=0.0, speed=0.0)
    for _ in range(_TRIES):
        against = guess.coulomb_friction * sense + guess.force_offset
        force = _rounded(scale * net + against, spec.force)
        used = judge(spec, force)
        if used.most <= 1 and scale > accepted:
            best, accepted = (force, used), scale
            if used.most >= _ENOUGH:
                break
        scale *= _AIM / used.most
        if scale < _LEAST:
            break
    if best is None:
        return used
    force, used = best
    prediction = predict(
        force[:-1],
        guess,
        step=step,
        noise=spec.reading_noise,
        force_noise=spec.force_noise,
        delay_known=spec.delay == "known",
    )
    return Candidate(
        family=shape.family,
        band=shape.band,
        lines=shape.lines,
        force=force,
        prediction=prediction,
        used=used,
    )


def _product(found: tuple[Candidate, Shape]) -> float:
    """What is to be small: the product of both intervals."""
    prediction = found[0].prediction
    return prediction.mass * prediction.damping


def _device(corner: tuple[float, float, float, float]) -> Guess:
    mass, damping, friction, offset = corner
    return Guess(mass=mass, damping=damping, coulomb_friction=friction, force_offset=offset)


def _rounded(force: FloatArray, limit: float) -> FloatArray:
    """The force as its file will hold it, with a row of zero at either end."""
    decimals = _DIGITS - 1 - int(np.floor(np.log10(limit)))
    rows = np.append(np.round(force, decimals), 0.0)
    rows[0] = 0.0
    return rows


def _corners_used(spec: ExcitationSpec, force: FloatArray) -> Used:
    """Parts of the limits that the worst corner uses."""
    travel = speed = 0.0
    for corner in spec.corners():
        motion = simulate_stick_slip(force[:-1], _device(corner), spec.sample_time)
        travel, speed = max(travel, motion.reach), max(speed, motion.speed)
    return _parts(spec, force, travel, speed)


def _used(spec: ExcitationSpec, force: FloatArray) -> Used:
    """Parts of the limits that the worst device of the guesses uses, between the corners too."""
    reach, speed = extremes(force[:-1], Region.stated(spec).devices(), spec.sample_time)
    return _parts(spec, force, BETWEEN * float(np.max(reach)), BETWEEN * float(np.max(speed)))


def _parts(spec: ExcitationSpec, force: FloatArray, travel: float, speed: float) -> Used:
    return Used(
        force=float(np.max(np.abs(force))) / spec.force,
        travel=travel / spec.travel,
        speed=0.0 if spec.speed is None else speed / spec.speed,
    )


def _impossible(spec: ExcitationSpec, used: Used) -> tuple[str, str]:
    """What no force can keep, and what to do."""
    if used.travel == used.most:
        return (
            f"however small the force, some device within the guesses moves {used.travel:.2g} "
            f"times the travel of {spec.travel:g} in {spec.duration:g} s",
            "Without a spring an unknown friction or offset makes a device drift: narrow the "
            "ranges of coulomb_friction and force_offset (gentle: true plans a first play that "
            "tells them), shorten the duration, or allow more travel",
        )
    return (
        f"no force keeps every device within the guesses below the speed of {spec.speed:g}",
        "Allow more speed, or narrow the ranges of the guesses",
    )
