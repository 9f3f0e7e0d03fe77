"""A log of several axes in the direction of its force, and what must be true across it.

Effects are the same in every direction, so that the force in one is the law of one axis on the
positions in it. Across, walls do nothing. The motion there is that of one axis too while it stays
on its line, or only walls push.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification import Trajectories, Trajectory, UsageError
from tune.documents.profile import Design
from tune.documents.scene import UNITS
from tune.loop.polynomials import FloatArray
from tune.verification.law import (
    Combination,
    Digits,
    Log,
    Outcome,
    combinations_of,
    compared,
    effects_of,
    force_of,
    rms,
    scale_effects,
    unassessed_outcome,
)
from tune.verification.measured_law import MISFIT, ROUNDING, MeasuredLaw


def leading_direction(forces: Sequence[FloatArray]) -> tuple[float, ...]:
    """Unit vector of the direction in which forces of axes, N, (n,) each, vary most."""
    varying = np.stack([each - np.mean(each) for each in forces])
    return _signed(np.linalg.svd(varying, full_matrices=False)[0][:, 0])


def principal_directions(profile: Design) -> list[tuple[tuple[float, ...] | None, Design]]:
    """The principal directions of the mass, the lightest first, with the profile on each.

    Of one axis it is the profile itself, without a direction.
    """
    device = profile.device
    if device.poses is None:
        return [(None, profile)]
    found: list[tuple[tuple[float, ...] | None, Design]] = []
    for unit in np.linalg.eigh(np.array(device.poses[0].mass))[1].T:
        direction = _signed(unit)
        changed = {"device": device.along(direction)}
        found.append((direction, profile.model_copy(update=changed)))
    return found


def _signed(unit: FloatArray) -> tuple[float, ...]:
    """A direction, its largest part positive."""
    return tuple((unit * np.sign(unit[np.argmax(np.abs(unit))])).tolist())


def comparable(
    profile: Design, direction: Sequence[float] | None, element: str | None
) -> tuple[Combination, ...]:
    """Combinations that a log may be of, or the one named.

    In a direction of several axes walls stand alone: beside what acts in every direction the force
    does not tell their normal. Raises UsageError.
    """
    found = combinations_of(profile, element)
    if direction is None:
        return found
    kept = tuple(each for each in found if len({name in profile.walls for name in each}) == 1)
    if not kept:
        problem = f"'{element}' is a wall beside other elements, which one force does not tell"
        raise UsageError("--element", problem, "Play and compare the wall alone, then the others")
    return kept


def along(profile: Design, direction: Sequence[float] | None) -> str:
    """A direction of a profile in words that end a sentence; "" of one axis."""
    return "" if direction is None else f" {profile.device.in_words(direction)}"


def turned_to(log: Trajectories, direction: Sequence[float]) -> Trajectory:
    """The log of one axis that lies in a direction, a unit vector."""
    force, position = (
        np.sum([part * getattr(a, name) for part, a in zip(direction, log.axes, strict=True)], 0)
        for name in ("force", "position")
    )
    return Trajectory(
        time=log.axes[0].time,
        force=force,
        position=position,
        axis=log.axis,
        motion=log.motion,
        source=log.source,
        digest=log.digest,
    )


def judge_across(
    profile: Design,
    axes: Sequence[Trajectory],
    direction: Sequence[float],
    law: MeasuredLaw,
    digits: Digits,
) -> Outcome:
    """Is the force across the direction that of the elements that are no walls, at one gain?"""
    if law.effects is None or np.isnan(law.gain):
        return unassessed_outcome("across", "no law is known that was played")
    unit = UNITS[profile.device.motion]["force"]
    free = effects_of(profile, _without_walls(profile, law.elements))
    played = scale_effects(free, law.gain)
    left: list[FloatArray] = []
    for force, position in _across(axes, direction):
        log = Log(loop=law.loop, force=force, position=position, used=law.log.used)
        columns = log.columns(law.loop)
        if columns is None:
            return unassessed_outcome("across", "too few rows")
        if not free.present():
            left.append(force[columns.rows])
        else:
            left.append(columns.force + force_of(played, columns.parts))
    scale = rms(law.log.force[law.log.used])
    seen = float(np.linalg.norm([rms(each) for each in left]))
    allowed = max(MISFIT * scale, ROUNDING * digits.noise(played, law.loop))
    return compared(
        "across",
        {"seen": seen, "scale": scale, "tolerance": allowed},
        agrees=seen <= allowed,
        seen=f"{seen:.2g} {unit} rms of {scale:.3g} {unit} unexplained",
        predicted="no force across a wall; of other elements the law that is seen along",
        tolerance=f"{allowed:.2g} {unit}",
        remedy="Play one element, with one wall of one normal at most, with the same gain on all "
        "axes; check which motor and encoder each column is of, and their signs.",
    )


def motion_across(
    profile: Design, axes: Sequence[Trajectory], direction: Sequence[float], law: MeasuredLaw
) -> float:
    """Rms of the motion across, part of that along; 0 where only walls push, which act along."""
    if not _without_walls(profile, law.elements):
        return 0.0
    used = law.log.used
    across = [np.std(position[used]) for _, position in _across(axes, direction)]
    return float(np.linalg.norm(across) / np.std(law.log.position[used]))


def _without_walls(profile: Design, combination: Combination) -> Combination:
    return tuple(name for name in combination if name not in profile.walls)


def _across(
    axes: Sequence[Trajectory], direction: Sequence[float]
) -> list[tuple[FloatArray, FloatArray]]:
    """(force, position) in each of the directions at right angles."""
    forces = np.stack([each.force for each in axes])
    positions = np.stack([each.position for each in axes])
    others = np.linalg.svd(np.array([direction]))[2][1:]
    return [(unit @ forces, unit @ positions) for unit in others]
