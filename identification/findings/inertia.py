"""Mass without a model of friction: force while accelerating against force while braking.

At equal velocity every friction that depends on velocity alone is equal, whatever its law; so what
the force changes by, over what the acceleration changes by, is the mass. All rows of a narrow band
of velocity are used: within the band force and acceleration are each taken less a straight line
in velocity, and the slope of the one over the other is the mass (the partially linear model of
Robinson, Econometrica 56, 1988, p. 931). What else pushes the device, and noise of position, make
the slope of force over acceleration too small and the inverse of that of acceleration over force
too large; the mass lies between (Frisch's bounds: Klepper and Leamer, Econometrica 52, 1984,
p. 163). The judge knows the mass less well than an estimator does, and it is there to doubt one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.findings.force_balance import ForceBalance, even_sizes, least_squares_residual
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Bands of velocity in each direction at most, and rows in each at least: two take up what
#: the straight line costs, the others tell.
_BANDS = 20
_ROWS = 24
#: ... of which this part, at least, is accelerated, and as many braked.
_EITHER = 0.2
#: Bands without which there is no judgement.
_FEWEST_BANDS = 4
#: Stretches of the log left out in turn for the deviation.
_STRETCHES = 30
#: Windows, the delay and what friction remembers are good to this part of the mass.
_SYSTEMATIC = 0.01
#: Deviations of the difference beyond which the estimate is not of this device.
SIGMAS = 4.0
#: ... and part of the mass beyond which it is refused; below, stability margins absorb it.
REFUSED = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """Mass told by rows at equal velocity.

    Attributes:
        least: slope of force over acceleration, kg (kg·m²).
        most: inverse slope of acceleration over force, kg (kg·m²).
        deviation: standard deviation of either, kg (kg·m²).
    """

    least: float
    most: float
    deviation: float

    def outside(self, estimate: Estimate) -> float:
        """How far the mass of an estimate lies below (negative) or above the bounds, kg (kg·m²)."""
        mass = estimate.value("mass")
        return mass - float(np.clip(mass, self.least, self.most))

    def contradicts(self, estimate: Estimate) -> bool:
        """Whether a mass lies further outside than chance and its own doubt explain."""
        chance = float(np.hypot(self.deviation, estimate.deviation("mass")))
        return abs(self.outside(estimate)) > SIGMAS * chance


def inertia_of(balance: ForceBalance) -> Inertia | None:
    """The mass that a log tells without a model of friction; None where it tells too little.

    Args:
        balance: rows of the log; a force of position that the estimate carries is taken out.
    """
    moving = np.flatnonzero(balance.moving)
    velocity = balance.velocity[moving]
    acceleration, force = balance.acceleration[moving], balance.force[moving]
    carried, bands = balance.carried[moving], 0
    columns = np.column_stack((acceleration, force, carried))
    left: list[FloatArray] = []
    told: list[NDArray[np.intp]] = []
    for sense in (1.0, -1.0):
        side = np.flatnonzero(sense * velocity > 0)
        side = side[np.argsort(velocity[side])]
        sizes = even_sizes(side.size, max(1, min(_BANDS, side.size // _ROWS)))
        gaining = _sums(sense * acceleration[side] > 0, sizes)
        either = np.minimum(gaining, sizes - gaining)
        tells = (sizes >= _ROWS) & (either >= _EITHER * sizes)
        bands += np.count_nonzero(tells)
        kept = np.repeat(tells, sizes)
        left.append(_levelled(columns[side], velocity[side], sizes)[kept])
        told.append(side[kept])
    if bands < _FEWEST_BANDS:
        return None
    table, rows = np.concatenate(left), np.concatenate(told)
    if table.shape[1] > 2:
        table[:, :2] = np.stack(
            [least_squares_residual(table[:, 2:], each) for each in table[:, :2].T], axis=1
        )
    change, pull = table[:, 0], table[:, 1]
    power, both = float(change @ change), float(change @ pull)
    if both <= 0:
        return None
    value = both / power
    stretch = moving[rows] * _STRETCHES // len(balance)
    squares = np.bincount(stretch, change * change, minlength=_STRETCHES)
    scores = np.bincount(stretch, change * (pull - value * change), minlength=_STRETCHES)
    # A stretch that alone tells nearly all leaves no judgement of the others.
    if np.max(squares) > 0.5 * power:
        return None
    shifts = scores / (power - squares)
    chance = float(np.sqrt((_STRETCHES - 1) / _STRETCHES * np.sum(shifts**2)))
    return Inertia(
        least=value,
        most=float(pull @ pull) / both,
        deviation=float(np.hypot(chance, _SYSTEMATIC * value)),
    )


def _sums(rows: FloatArray | NDArray[np.bool_], sizes: NDArray[np.intp]) -> FloatArray:
    """Sum of the rows of each band, shape (bands, ...)."""
    if not len(rows):
        return np.zeros((sizes.size, *rows.shape[1:]))
    return np.add.reduceat(rows, np.cumsum(sizes) - sizes, axis=0, dtype=np.float64)


def _levelled(columns: FloatArray, velocity: FloatArray, sizes: NDArray[np.intp]) -> FloatArray:
    """Columns less a straight line in velocity in each band, shape (rows, columns)."""
    both = np.column_stack((velocity, columns))
    both = both - np.repeat(_sums(both, sizes) / np.maximum(sizes, 1)[:, None], sizes, axis=0)
    speed, rest = both[:, :1], both[:, 1:]
    power = _sums(speed * speed, sizes)
    slopes = _sums(speed * rest, sizes) / np.where(power > 0, power, 1.0)
    return rest - speed * np.repeat(slopes, sizes, axis=0)


def inertia(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> tuple[Finding, ...]:
    """``heldout-misfit``: the mass is not the one that rows at equal velocity tell."""
    judge = inertia_of(balance)
    if judge is None or not judge.contradicts(chosen):
        return ()
    mass, doubt = chosen.value("mass"), 2 * judge.deviation
    refused = abs(judge.outside(chosen)) > REFUSED * abs(mass)
    return (
        Finding(
            code="heldout-misfit",
            severity="refusal" if refused else "warning",
            seen=f"at equal velocity the force of {trajectory.source} while accelerating, less "
            f"that while braking, tells a mass from {judge.least:.4g} to {judge.most:.4g}, "
            f"± {doubt:.2g}, "
            f"{chosen.method.replace('-', ' ')} {mass:.4g} ± {2 * chosen.deviation('mass'):.2g}",
            needed=f"within {REFUSED:.0%}" if refused else f"within {SIGMAS:g} deviations",
            remedy="The friction is not what the model has: excite faster, so that inertia is "
            "more of the force, and look for play, cables or a gear that remember the motion.",
        ),
    )
