"""Optimal excitation: the force that tells mass and damping with the least intervals.

Three families of signals are brought to their best within the limits and compared. What is played
is the net force of the best, plus the friction of the guessed device while it moves, so that
friction neither holds the device nor bends its path, and the constant force guessed. The devices of
the guesses that may go farthest are then simulated exactly and the force scaled until none of them
leaves its limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.errors import InvalidInputError, UsageError
from identification.planning.information import DesignGrid, Prediction, predict
from identification.planning.limits import (
    BETWEEN,
    ExcitationSpec,
    Guess,
    Region,
    Used,
    WorstMotion,
    describe_impossible,
    extremes,
    gentle_spec,
    motions_beyond,
    worst_motions,
)
from identification.planning.several_axes import AxesExcitation
from identification.planning.signals import (
    Family,
    Shape,
    binaries,
    fit_to_limits,
    multisines,
    opposing_force,
    rounded,
    swept_sines,
)
from identification.trajectory import FloatArray

_FAMILIES: tuple[tuple[str, Callable[[DesignGrid], list[Shape]]], ...] = (
    ("multisine", multisines),
    ("swept sine", swept_sines),
    ("binary sequence", binaries),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """The best force of one family."""

    family: Family
    band: tuple[float, float]  # its lowest and its highest frequency, Hz
    lines: int  # how many frequencies it has; 0 where it sweeps through all of the band
    force: FloatArray  # N (N·m), shape (n,), held from sample to sample, zero at both ends
    prediction: Prediction  # motion of the guessed device and Cramér-Rao bound
    used: Used  # parts of the limits that the worst device uses

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
        return motions_beyond(self.spec, self.worst)

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
        spec: limits and guesses of one axis; see `plan_axes` for several.
        progress: called with a sentence before each part of the work.

    Raises:
        InvalidInputError: no force keeps every device the guesses allow within the limits.
        UsageError: there are several axes.
    """
    if spec.axes is not None:
        raise UsageError("axes", f"are {', '.join(spec.axes)}", "Plan them with plan_axes")

    say: Callable[[str], None] = progress or (lambda _: None)
    wanted = gentle_spec(spec) if spec.gentle else spec
    bench = DesignGrid.of(wanted)
    devices, spread = Region.stated(wanted).devices(), BETWEEN if wanted.ranges else 1.0
    found: list[Candidate] = []
    used: list[Used] = []
    for name, family in _FAMILIES:
        say(f"designing a {name}")
        tried = [_fitted(bench, shape, devices, spread) for shape in family(bench)]
        used += [each for each in tried if isinstance(each, Used)]
        fitting = [each for each in tried if isinstance(each, Candidate)]
        found += [min(fitting, key=_product)] if fitting else []
    if not found:
        raise InvalidInputError("excitation", *describe_impossible(wanted, used[0]))
    found.sort(key=_product)
    say("looking for the devices that go farthest")
    worst = worst_motions(spec, found[0].force)
    return Excitation(spec=wanted, candidates=tuple(found), worst=worst)


def _fitted(
    bench: DesignGrid, shape: Shape, devices: list[Guess], spread: float
) -> Candidate | Used:
    """The shape on the controller's samples within all limits, or what the last try used."""
    spec = bench.spec
    step = spec.sample_time
    net = shape.force((np.arange(spec.samples, dtype=np.float64) + 0.5) * step)
    against = opposing_force(spec, net)
    found = fit_to_limits(
        lambda scale: rounded(scale * net + against, spec.force),
        lambda force: Used.of(spec, force, *extremes(force[:-1], devices, step), spread),
    )
    if isinstance(found, Used):
        return found
    _, force, used = found
    prediction = predict(
        force[:-1],
        spec.guess,
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


def _product(found: Candidate) -> float:
    """What is to be small: the product of both intervals."""
    return found.prediction.mass * found.prediction.damping


#: Significant digits: a nanosecond in three minutes, and more than the force was rounded to.
_FILE_DIGITS = 12


def force_text(excitation: Excitation | AxesExcitation) -> str:
    """One row a sample; the force of each is held until the next, the first and last are zero."""
    if isinstance(excitation, AxesExcitation):
        names, force = [f"force_{axis}" for axis in excitation.axes], excitation.force
    else:
        names, force = ["force"], excitation.best.force[:, None]
    table = np.column_stack((excitation.time, force + 0.0))
    lines = (",".join(f"{each:.{_FILE_DIGITS}g}" for each in row) for row in table.tolist())
    return "\n".join((",".join(("time", *names)), *lines)) + "\n"
