"""Are mass and damping the same whatever the cut-off they are read at?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import Finding
from identification.estimators.intervals import half_width
from identification.estimators.model import Estimate
from identification.trajectory import Trajectory

#: Parameters that must not move.
_JUDGED = ("mass", "damping")
#: A move that is this part of the value, or less, matters to no margin.
_HARMLESS = 0.02


def stability(trajectory: Trajectory, chosen: Estimate) -> tuple[Finding, ...]:
    """``heldout-misfit``: what the cut-off moves is more than the interval without it holds.

    A model that is right is right at every frequency. The move is in the interval all the same.
    """
    if chosen.leaning is None:
        return ()
    alone = replace(chosen, covariance=chosen.covariance - np.outer(chosen.leaning, chosen.leaning))
    moved = {name: abs(float(chosen.leaning[chosen.parameters.index(name)])) for name in _JUDGED}
    unstable = [
        name
        for name, move in moved.items()
        if move > half_width(alone, name) and move > _HARMLESS * abs(chosen.value(name))
    ]
    if not unstable:
        return ()
    seen = " and ".join(
        f"{name} {chosen.value(name):.4g} ± {half_width(alone, name):.2g} by ± {moved[name]:.2g}"
        for name in unstable
    )
    return (
        Finding(
            code="heldout-misfit",
            severity="warning",
            seen=f"another cut-off moves the {seen} in {trajectory.source}",
            needed="a move within the interval",
            remedy="A force that the model does not have acts at some frequencies: excite harder, "
            "and look for play, vibration or friction that depends on place.",
        ),
    )
