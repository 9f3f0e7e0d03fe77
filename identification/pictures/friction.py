"""Friction over speed: what a log shows of it beside what the device states."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from identification.device.device import Device
from identification.estimators.estimate import Estimate
from identification.findings.force_balance import ForceBalance, balance_of
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Classes of speed of which the middle value is drawn, in each direction.
_CLASSES = 10
#: Rows that a class has at least.
_FEWEST = 3


def draw_friction(
    axes: Axes, trajectory: Trajectory, device: Device, estimate: Estimate | None, force: str
) -> None:
    """Force less inertia, offset and weight over velocity, beside b·q̇ + Fc·sign(q̇).

    Args:
        axes: to draw on.
        trajectory: a log of the device.
        device: as identified.
        estimate: gives delay and terms of gravity; None takes the device alone.
        force: its unit.
    """
    from identification.figure import legend_above

    rows = balance_of(trajectory, estimate)
    friction = rows.force - device.mass.value * rows.acceleration - _offset(device)
    if device.position_stiffness is not None:
        friction = friction - device.position_stiffness.value * rows.position
    if device.gravity is not None:
        friction = friction - device.gravity.sine.value * np.sin(rows.position)
        friction = friction - device.gravity.cosine.value * np.cos(rows.position)
    moving = rows.moving
    axes.plot(rows.velocity[moving], friction[moving], ".", color="0.75", ms=2, label="log")
    _draw_middles(axes, rows, friction)
    fastest = float(np.max(np.abs(rows.velocity)))
    for sense in (-1, 1):
        speed = np.linspace(0, fastest, 50)
        axes.plot(
            sense * speed,
            sense * (_coulomb(device, sense) + _viscous(device, sense) * speed),
            color="tab:green",
            lw=1.5,
            label="b·q̇ + Fc·sign(q̇)" if sense > 0 else None,
        )
        slope = device.damping_slope
        if slope is not None:
            start = _coulomb(device, sense)
            axes.fill_between(
                sense * speed,
                sense * (start + slope.low * speed),
                sense * (start + slope.high * speed),
                color="tab:green",
                alpha=0.2,
                lw=0,
                label="slopes of friction" if sense > 0 else None,
            )
    axes.set_xlabel(f"velocity, {'m' if device.motion == 'linear' else 'rad'}/s")
    axes.set_ylabel(f"friction, {force}")
    legend_above(axes)


def _draw_middles(axes: Axes, rows: ForceBalance, friction: np.ndarray) -> None:
    """Median friction in classes of speed, each direction apart."""
    for sense in (-1, 1):
        chosen = np.flatnonzero(rows.moving & (sense * rows.velocity > 0))
        if chosen.size < _CLASSES * _FEWEST:
            continue
        order = chosen[np.argsort(rows.velocity[chosen])]
        parts = np.array_split(order, _CLASSES)
        axes.plot(
            [float(np.median(rows.velocity[part])) for part in parts],
            [float(np.median(friction[part])) for part in parts],
            "o",
            color="tab:blue",
            ms=3.5,
            label="log, median by speed" if sense > 0 else None,
        )


def _offset(device: Device) -> float:
    """The offset that is beside the friction, N; a friction by direction holds all of it."""
    return device.force_offset.value if device.friction_by_direction is None else 0.0


def _coulomb(device: Device, sense: int) -> float:
    pair = device.friction_by_direction
    if pair is None:
        return device.coulomb_friction.value
    return (pair.forward if sense > 0 else pair.backward).value


def _viscous(device: Device, sense: int) -> float:
    pair = device.damping_by_direction
    if pair is None:
        return device.damping.value
    return (pair.forward if sense > 0 else pair.backward).value
