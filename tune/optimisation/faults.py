"""Every limit of a problem that given sizes break, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.limits import forces, worst_gain
from tune.optimisation.problem import Problem

FloatArray = NDArray[np.float64]

Word = Literal[
    "device", "stability", "gain-margin", "delay-margin", "force", "ripple", "certificate"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One reason why gains are not fit: which limit, what was seen, what is needed."""

    limit: Word
    seen: str
    needed: str
    remedy: str


def faults_of(problem: Problem, sizes: FloatArray, gain: float, noise: float | None) -> list[Fault]:
    """Every limit that the sizes break, in words; their gain margin and ripple are known.

    Sizes have shape (unknowns,), SI units; the noise is in N (N·m).
    """
    (moment,) = problem.moments
    margin, limits = problem.margin, problem.limits
    late = worst_gain(problem, moment, sizes)
    extra = f"{margin.extra_delay_samples} extra sample{'s' * (margin.extra_delay_samples > 1)}"
    smaller = "Lower the gains, or filter velocity and acceleration."
    faults: list[Fault] = []
    if gain <= 1:
        seen = (
            f"unstable: every gain from 0 holds up to {gain:.4g} of these" if gain else "unstable"
        )
        faults.append(
            Fault(limit="stability", seen=seen, needed=f"{margin.gain:g}", remedy=smaller)
        )
    elif gain <= margin.gain:
        faults.append(
            Fault(
                limit="gain-margin",
                seen=f"stable up to {gain:.4g} of these gains",
                needed=f"{margin.gain:g}",
                remedy=smaller,
            )
        )
    elif late <= margin.gain:
        faults.append(
            Fault(
                limit="delay-margin",
                seen=f"with {extra} of delay stable up to {late:.4g} of these gains",
                needed=f"{margin.gain:g}",
                remedy="Lower the gains, or shorten the delay.",
            )
        )
    for words, force, most in zip(
        ("K·penetration", "K·penetration + |B|·speed + |M|·acceleration"),
        forces(moment, sizes),
        (limits.continuous_force, limits.peak_force),
        strict=True,
    ):
        if most is not None and force > most:
            faults.append(
                Fault(
                    limit="force",
                    seen=f"{words} is {force:.4g}",
                    needed=f"{most:.4g} at most",
                    remedy="Lower the gains, or keep to less penetration.",
                )
            )
    if noise is not None and noise > limits.ripple:
        faults.append(
            Fault(
                limit="ripple",
                seen=f"the encoder makes the force ripple by {noise:.3g} rms",
                needed=f"{limits.ripple:g} at most, what a hand does not notice",
                remedy="Filter velocity and acceleration, or lower damping and mass.",
            )
        )
    return faults
