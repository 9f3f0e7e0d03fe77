"""Position dependence: gravity and springs, told from a force that follows the position."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.estimate import Estimate, half_width
from identification.estimators.linear import solve, unit_columns
from identification.findings.force_balance import ForceBalance
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Powers of position that stand for any smooth force over the travel.
_POWERS = (1, 2, 3)
#: Parts a log is cut into; what position explains is judged on the part it was not fitted on.
_PARTS = 4
#: Of the mean square that mass, damping and friction leave over, position explains this part in
#: rows it was not fitted on. Below, it may be chance.
LEAST_GAIN = 0.3
#: The rms force of position is at least this part of the rms force.
LEAST_SHARE = 0.02
#: A shift of mass or damping by less than this part is beyond what these coarse rows can tell.
MATTERS = 0.05
_REMEDY = (
    "Level or counterbalance the axis, take off springs and cables, or subtract the known force of "
    "gravity from the force column."
)


def position_dependence(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate
) -> tuple[Finding, ...]:
    """``gravity``: a weight, a spring or a magnet whose force is not the same everywhere."""
    total = float(np.std(balance.force))
    gain, force = position_force(balance)
    if gain >= LEAST_GAIN and float(np.std(force)) >= LEAST_SHARE * total:
        return (_uncarried(trajectory, balance, chosen, gain, force),)
    force = _carried_force(balance)
    share = float(np.std(force)) / total
    if share < LEAST_SHARE:
        return ()
    return (
        Finding(
            code="gravity",
            severity="warning",
            seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel and "
            f"{share:.0%} of the force rms, acts in {trajectory.source}; the estimate has a term "
            "for it",
            needed=f"below {LEAST_SHARE:.0%}",
            remedy=_REMEDY,
        ),
    )


def _uncarried(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate, gain: float, force: FloatArray
) -> Finding:
    shifts = _shifts(balance, chosen)
    refused = any(
        moved > max(width, MATTERS * abs(chosen.value(name))) for name, moved, width in shifts
    )
    told = ", ".join(f"{name} by {moved:.3g} (± {width:.2g})" for name, moved, width in shifts)
    return Finding(
        code="gravity",
        severity="refusal" if refused else "warning",
        seen=f"a force of position, {np.ptp(force):.3g} from end to end of the travel, explains "
        f"{gain:.0%} of what the other terms leave over in {trajectory.source}; it shifts {told}",
        needed=f"shifts below {MATTERS:.0%}" if refused else f"below {LEAST_SHARE:.0%}",
        remedy=_REMEDY,
    )


def position_force_rms(balance: ForceBalance) -> float:
    """Rms of the force of position that the log shows, whether the estimate has it or not, N."""
    gain, force = position_force(balance)
    return float(np.std(_carried_force(balance) + (force if gain >= LEAST_GAIN else 0.0)))


def _carried_force(balance: ForceBalance) -> FloatArray:
    """Force of the position terms of the estimate's model at each row, N."""
    carried = balance.carried
    if carried.shape[1] == 0:
        return np.zeros(len(balance))
    weights = solve(np.column_stack((balance.plant, carried)), balance.force)
    return carried @ weights[-carried.shape[1] :]


def position_force(balance: ForceBalance) -> tuple[float, FloatArray]:
    """How much of what the estimate's terms leave over position explains.

    Both where it was fitted and where it was not count, and the smaller share is taken: a part of
    the log that is faster than the rest is told badly without position, too.

    The force has shape (rows,), as the balance.

    Returns:
        Share of the mean square, at most 1; its force at each row, N, mean zero.
    """
    moving = balance.moving
    powers = powers_of(balance.position)
    plant = np.column_stack((balance.plant, balance.carried))
    table, norms = unit_columns(np.column_stack((plant, powers, balance.force))[moving])
    both, first = table.shape[1] - 1, plant.shape[1]
    if len(table) < _PARTS * both:
        return 0.0, np.zeros(len(balance))
    # R of each part (QR): what any columns leave of the force there is told by it alone.
    parts: list[FloatArray] = [
        np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64) for rows in _cut(table)
    ]
    every = np.concatenate(parts)
    without, within = (
        sum(
            _left(np.concatenate(parts[:part] + parts[part + 1 :]), count, parts[part])
            for part in range(_PARTS)
        )
        for count in (first, both)
    )
    left, fuller = (_left(every, count, every) for count in (first, both))
    force: FloatArray = powers @ (_solved(every, both) / norms[:both])[first:] * norms[-1]
    kept = max(
        within / without if without > 0 else 1.0,
        fuller / left if left > 0 else 1.0,
    )
    return 1 - kept, force - np.mean(force)


def _cut(table: FloatArray) -> list[FloatArray]:
    """Consecutive parts of a table."""
    edges = -(-np.arange(_PARTS + 1) * len(table) // _PARTS)
    return [table[first:last] for first, last in pairwise(edges.tolist())]


def _solved(rows: FloatArray, count: int) -> FloatArray:
    """Weights by which the first columns fit the last one, shape (count,)."""
    found = np.linalg.lstsq(rows[:, :count], rows[:, -1], rcond=None)[0]
    return np.asarray(found, dtype=np.float64)


def _left(fitted: FloatArray, count: int, shown: FloatArray) -> float:
    """Sum of squares that the first columns, fitted on some rows, leave of the last on others."""
    missed = shown[:, -1] - shown[:, :count] @ _solved(fitted, count)
    return float(missed @ missed)


def powers_of(position: FloatArray) -> FloatArray:
    """Powers of position, -1 to 1 over the travel, shape (rows, 3)."""
    middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
    unit = (position - middle) / (half if half > 0 else 1.0)
    return np.stack([unit**power for power in _POWERS], axis=1)


def _shifts(balance: ForceBalance, chosen: Estimate) -> list[tuple[str, float, float]]:
    """What mass and damping move by when position gets its term, and their half-widths."""
    columns = np.column_stack((balance.plant, balance.carried))
    plain = solve(columns, balance.force)
    fuller = solve(np.column_stack((columns, powers_of(balance.position))), balance.force)
    return [
        (name, abs(float(fuller[index] - plain[index])), half_width(chosen, name))
        for index, name in enumerate(("mass", "damping"))
    ]
