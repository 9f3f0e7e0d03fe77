"""Mass and damping matrices of a device whose axes are driven together, or one after another.

The matrices are estimated jointly. What an axis would have shown alone, its force less what moves
the others, is then looked at as any log of one axis: excitation, friction, hands, delays. What that
makes doubtful of an axis widens its entries, unless noise of the encoders explains all that is
left.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

import numpy as np

from identification.device.device import Device, ForceLimit, LogRecord
from identification.device.hardware import Hardware, SuggestedFacts
from identification.device.quantities import (
    Covariance,
    Pose,
    Quantity,
    direction_in_words,
    quantity,
)
from identification.errors import Finding, LogRefusedError, UsageError, refusal, refuse
from identification.estimators import Method
from identification.estimators.joint import JointLog, driven, driving_logs
from identification.estimators.joint_fits import (
    JointEstimate,
    JointMethod,
    NoMassError,
    fit_jointly,
    prepare_axes,
)
from identification.estimators.least_squares import find_delay, longest_delay, prepare
from identification.estimators.motion import distinguishable_terms
from identification.estimators.reciprocity import UnequalCoupling, unequal_couplings
from identification.estimators.turned_friction import TurnedFriction, turned_friction
from identification.estimators.uneven_mass import uneven_mass
from identification.findings import inspect
from identification.findings.forces import POSITION_REMEDY
from identification.fitting import LogFit, explained_by_noise, fit_log, suggested_by
from identification.readers.columns import say_gains_by_axis
from identification.trajectory import (
    EVEN,
    MOST_FITTED,
    NORMAL_95,
    FloatArray,
    Trajectories,
    Trajectory,
    refuse_sizes,
)

#: An axis that moves by less than this part of its motion in another log stands in this one.
_STANDS = 0.05
#: A mass of any direction must be known to this factor, or the axes are not told apart.
_LOOSEST = 1.5
#: Least eigenvalue of the correlations of accelerations; 1 where axes move independently, some
#: 0.002 where independent forces move a device thirty times as heavy one way as another.
_ALIKE = 1e-3
#: Delays are read from each axis alone and put to all so often at most, or until they move by less
#: than this part of a standard deviation.
_MOST_DELAYS, _SETTLED = 6, 0.2
#: s, the least standard deviation of a delay.
_EXACT = 1e-9
#: Standard deviations by which a force of position may move what an axis shows alone.
_MOVED = 3.0
_NEGATED = (
    "Negate the force of {axis} in the log, force being positive along +position; --force-gain -1 "
    "does that where it is in N (N·m)."
)
_TURNED = "Log and tune in the coordinates of the joints or motors along which friction acts."
#: Part of a damping by which what such friction leaves over may make it doubtful, 95 %.
_MOST_DOUBT = 0.5
_APART = "Drive all axes at once with forces of their own (other lines or phases), for longer."


@dataclass(frozen=True, slots=True, kw_only=True)
class _JointFit:
    """What the logs of several axes at one pose said."""

    logs: tuple[Trajectories, ...]
    estimate: JointEstimate
    alone: tuple[LogFit, ...]  # of each axis, from the log that drives it most
    reason: str
    apart: float  # least eigenvalue of the correlations of the accelerations
    unequal: tuple[UnequalCoupling, ...]  # contradictions between the rows of two axes
    turned: TurnedFriction | None  # friction along directions that are no axis
    #: least and largest mass of each axis that depends on position, (2, axes), where an axis
    #: alone shows what that may be
    uneven: FloatArray | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesFit:
    """What logs of several axes said."""

    poses: tuple[_JointFit, ...]  # the joint fit of each pose
    logs: tuple[LogFit, ...]  # what each axis of each pose shows alone
    records: tuple[LogRecord, ...]  # of the logs, for the device
    findings: tuple[Finding, ...]  # warnings, those allowed among them

    def device(self, hardware: Hardware) -> Device:
        """The device all poses make: mass and damping over every direction, axes at their worst."""
        first, facts = self.poses[0].logs[0], suggested_by(self.logs)
        poses = tuple(_pose(joint.estimate) for joint in self.poses)
        by_axis = [joint.estimate.model.friction(joint.estimate.values) for joint in self.poses]
        return Device(
            **facts.of_device(hardware, first.motion),
            axis=first.axis,
            axes=first.names,
            poses=poses,
            mass=_over_directions(poses, "mass"),
            damping=_over_directions(poses, "damping"),
            coulomb_friction=_range_of([np.maximum(rough, 0.0) for rough, _ in by_axis]),
            force_offset=_range_of([offset for _, offset in by_axis]),
            force_limit=hardware.force_limit or _weakest(self.poses[0].logs),
            logs=self.records,
        )


def fit_axes(
    logs: Sequence[Trajectories], hardware: Hardware, method: Method, allow: Collection[str]
) -> AxesFit:
    """Estimate the matrices of a device at each pose; arguments and errors as of ``identify``."""
    if method != "auto" and method not in get_args(JointMethod):
        known = ", ".join(get_args(JointMethod))
        raise UsageError("--method", f"{method} is for one axis", f"Choose from auto, {known}")
    if hardware.modes or hardware.current_lag is not None:
        problem = "states modes or a current lag, which are known of one axis only"
        raise UsageError("--hardware", problem, "Leave them out, or identify axis by axis")
    for axis in (each for log in logs for each in log.axes):
        refuse_sizes(axis)
    poses = poses_of([_middle_of(each) for each in logs])
    noticed = [_inspected(each, hardware) for each in poses]
    refuse(noticed, allow)
    fits = tuple(_fitted(each, hardware, method) for each in poses)
    noticed = [
        found
        + tuple(
            _of_axis(each, joint.logs[0].names, place, fit.trajectory.source)
            for place, fit in enumerate(joint.alone)
            for each in _of_alone(joint, place)
        )
        + tuple(
            each.of(_sources(joint.logs))
            for each in (
                *_not_told_apart(joint),
                *_uneven(joint),
                *_turned(joint),
                *_unequal(joint),
            )
        )
        for found, joint in zip(noticed, fits, strict=True)
    ]
    refuse(noticed, allow)
    alone = tuple(replace(fit, reason=joint.reason) for joint in fits for fit in joint.alone)
    missing = tuple(each.of(_sources(logs)) for each in suggested_by(alone).not_stated(hardware))
    records = tuple(
        LogRecord(
            source=log.source,
            digest=log.digest,
            samples=len(log),
            method=joint.estimate.method,
            findings=tuple(dict.fromkeys(each.code for each in (*found, *missing))),
            allowed=tuple(dict.fromkeys(f.code for f in found if f.severity == "refusal")),
            read_as=log.read_as,
        )
        for joint, found in zip(fits, noticed, strict=True)
        for log in joint.logs
    )
    findings = tuple(replace(each, severity="warning") for found in noticed for each in found)
    return AxesFit(poses=fits, logs=alone, records=records, findings=findings + missing)


def _sources(logs: Sequence[Trajectories]) -> str:
    return ", ".join(log.source for log in logs)


def poses_of(logs: Sequence[Trajectories]) -> list[tuple[Trajectories, ...]]:
    """Logs of several axes by pose: one that drives all axes, or consecutive ones that drive some.

    An axis is driven where a force of its own moves it by a twentieth of what any log has.

    Raises:
        UsageError: logs of a pose with other axes or another sample time.
        LogRefusedError: axes that no log of the last pose drives.
    """
    poses: list[tuple[Trajectories, ...]] = []
    if not logs:
        return poses
    reach = np.array([[np.std(axis.position) for axis in log.axes] for log in logs])
    some: list[Trajectories] = []
    seen = np.zeros(reach.shape[1], dtype=np.bool_)
    for log, moves in zip(logs, reach >= _STANDS * reach.max(axis=0), strict=True):
        drives = moves & np.array([driven(axis) for axis in log.axes])
        if some and log.names != some[0].names:
            raise UsageError("--axis", "differs between the logs of a pose", "Name them alike")
        step = log.axes[0].sample_time
        if some and abs(step / some[0].axes[0].sample_time - 1) > EVEN:
            problem = f"{step:g} s in {log.source}, {some[0].axes[0].sample_time:g} s before"
            raise UsageError("the sample time", problem, "Log the axes of a pose alike")
        some.append(log)
        seen |= drives
        if seen.all():
            poses.append(tuple(some))
            some, seen = [], np.zeros_like(seen)
    if some:
        names = [name for name, there in zip(some[0].names, seen, strict=True) if not there]
        found = refusal(
            "axes-not-told-apart",
            seen=f"no force of its own moves {', '.join(names)}",
            needed="a force and motion of every axis at each pose",
            remedy="Drive all axes at once, or give a log that drives each, one after another.",
        )
        raise LogRefusedError((found.of(_sources(some)),))
    return poses


def _of_axis(finding: Finding, axes: Sequence[str], place: int, source: str) -> Finding:
    """A finding of one axis, with the remedy for its columns among those of all."""
    if finding.code == "sign-flip":
        finding = replace(finding, remedy=_NEGATED.format(axis=axes[place]))
    said = say_gains_by_axis(finding.remedy, axes, place)
    return replace(finding, remedy=said).of(source)


def _of_alone(joint: _JointFit, place: int) -> Iterator[Finding]:
    """Findings of an axis alone; ``gravity`` is a refusal, for the matrices have no term for it."""
    fit, axis = joint.alone[place], joint.logs[0].names[place]
    if joint.uneven is not None:  # each axis alone takes it for something else
        return
    if fit.estimate.model.gravity == "none":
        yield from fit.findings
        return
    known = {which: joint.estimate.told(f"{which}_{axis}_{axis}") for which in ("mass", "damping")}
    moved = any(
        abs(fit.estimate.value(which) - value) > _MOVED * deviation
        for which, (value, deviation) in known.items()
    )
    yield from (each for each in fit.findings if each.code != "gravity")
    if moved or any(each.code == "gravity" for each in fit.findings):
        seen = ", ".join(
            f"{which} {fit.estimate.value(which):.4g} with it and {known[which][0]:.4g} without"
            for which in known
        )
        yield refusal(
            "gravity",
            seen=f"a force of position acts on axis {axis}: {seen}",
            needed="none, for mass and damping matrices are estimated without a term for it",
            remedy=POSITION_REMEDY,
        )


def _inspected(logs: tuple[Trajectories, ...], hardware: Hardware) -> tuple[Finding, ...]:
    named = [replace(axis, source=_axis_of(axis)) for axis in _driven(logs)]
    return tuple(
        _of_axis(each, logs[0].names, place, axis.source)
        for place, axis in enumerate(named)
        for each in inspect(axis, hardware, alone=False)
    )


def _axis_of(log: Trajectory) -> str:
    """The log of an axis in words."""
    return f"{log.source}, axis {log.axis}"


def _driven(logs: Sequence[Trajectories]) -> list[Trajectory]:
    """Each axis as the log has it that drives it most."""
    return [logs[place].axes[axis] for axis, place in enumerate(driving_logs(logs))]


def _fitted(logs: tuple[Trajectories, ...], hardware: Hardware, method: Method) -> _JointFit:
    """The joint estimate of the logs of a pose, and what each axis shows alone."""
    known = hardware.delay
    step = logs[0].axes[0].sample_time
    longest = longest_delay(step, min(len(log) for log in logs))
    if known is None:
        delay = float(np.median([_seen_delay(axis, longest) for axis in _driven(logs)]))
        room, doubt = min(delay + step, longest), 0.0
    else:
        delay, room = known.value, known.value + step
        doubt = (known.high - known.low) / (2 * NORMAL_95)
    try:
        prepared = prepare_axes(logs, delay, room, doubt)
        if prepared.apart is not None:
            raise LogRefusedError((_uncoupled(*prepared.apart).of(_sources(logs)),))
        try:
            estimate, reason = _chosen(prepared, method, fits_delay=known is None)
        except NoMassError:  # which axis is to blame is told below
            estimate, reason = fit_jointly(prepared, "least-squares"), "no mass to start from"
        alone = _fitted_alone(prepared, estimate, hardware)
        seeks_delay = known is None and estimate.method != "output-error"
        # What moves the others is taken from each axis at this delay, and so moves theirs.
        for _ in range(_MOST_DELAYS if seeks_delay else 0):
            late, doubt = _pooled_delay(alone)
            if abs(late - prepared.delay) <= _SETTLED * doubt:
                break
            prepared = replace(prepared, delay=min(late, room), doubt=doubt)
            estimate = fit_jointly(prepared, estimate.method)
            alone = _fitted_alone(prepared, estimate, hardware)
        heavy = bool(np.all(np.diag(estimate.matrices[0]) > 0))  # else told by what is to blame
        explained = _explained(estimate, logs)
        turned = turned_friction(prepared, estimate) if heavy and not explained else None
        if turned is not None:
            prepared, estimate = turned.prepared, turned.estimate
            reason = f"{estimate.method.replace('-', ' ')} with friction along no axis"
    except (NoMassError, np.linalg.LinAlgError):
        raise LogRefusedError((_no_mass().of(_sources(logs)),)) from None
    if not explained:
        estimate = _widened(estimate, alone)
    doubted = any(fit.findings for fit in alone)
    bends = [[table.columns[0] for table in part.tables] for part in prepared.parts]
    together = np.stack([np.concatenate(each) for each in zip(*bends, strict=True)])
    apart = float(np.linalg.eigvalsh(np.corrcoef(together))[0])
    return _JointFit(
        logs=logs,
        estimate=estimate,
        alone=alone,
        reason=reason,
        apart=apart,
        unequal=unequal_couplings(prepared, estimate) if heavy else (),
        turned=turned,
        uneven=uneven_mass(prepared) if heavy and not explained and doubted else None,
    )


def _fitted_alone(
    prepared: JointLog, estimate: JointEstimate, hardware: Hardware
) -> tuple[LogFit, ...]:
    """What each axis shows alone, its force less what moves the others."""
    found: list[LogFit] = []
    for axis, place in enumerate(driving_logs(prepared.logs)):
        simulated = None if estimate.positions is None else estimate.positions[place]
        own = prepared.parts[place].alone(axis, estimate.matrices, estimate.delay, simulated)
        found.append(fit_log(replace(own, source=_axis_of(own)), hardware, "auto"))
    return tuple(found)


def _pooled_delay(alone: Sequence[LogFit]) -> tuple[float, float]:
    """The delay that all axes show and its standard deviation, s, as far as they disagree."""
    seen = [fit.delay for fit in alone if fit.delay is not None]
    weights = np.array([max(each.deviation, _EXACT) ** -2 for each in seen])
    values = np.array([each.value for each in seen])
    mean = float(weights @ values / weights.sum())
    apart = float(weights @ (values - mean) ** 2 / max(len(seen) - 1, 1))
    return mean, float(np.sqrt(max(apart, 1.0) / weights.sum()))


def _middle_of(log: Trajectories) -> Trajectories:
    """The middle of a log that is longer than estimates are made of."""
    spare = len(log) - MOST_FITTED
    if spare <= 0:
        return log
    rows = slice(spare // 2, spare // 2 + MOST_FITTED)
    return replace(log, axes=tuple(each.part(rows) for each in log.axes))


def _seen_delay(axis: Trajectory, longest: float) -> float:
    """The delay that an axis shows by itself, s: a start for what all show together."""
    return find_delay(axis, prepare(axis, distinguishable_terms(axis), longest, refine=False)).value


def _chosen(prepared: JointLog, method: Method, *, fits_delay: bool) -> tuple[JointEstimate, str]:
    """The estimate to believe and a sentence why."""
    if method in get_args(JointMethod):
        asked = cast("JointMethod", method)
        return fit_jointly(
            prepared, asked, fits_delay=fits_delay
        ), f"{method.replace('-', ' ')} as asked"
    if isinstance(prepared.steps, float):
        simulated = fit_jointly(prepared, "output-error", fits_delay=fits_delay)
        if _explained(simulated, prepared.logs):
            return simulated, "output error, because noise of the encoders explains its residuals"
    tables = [table for part in prepared.parts for table in part.tables]
    referenced = all(table.signals.reference is not None for table in tables)
    usual: JointMethod = "instruments" if referenced else "least-squares"
    found = fit_jointly(prepared, usual)
    why = "noise of the encoders does not explain what output error leaves"
    return found, f"{usual.replace('-', ' ')}, because {why}"


def _explained(estimate: JointEstimate, logs: Sequence[Trajectories]) -> bool:
    """Whether noise of the encoders explains all that output error leaves of every axis."""
    return estimate.residuals is not None and all(
        explained_by_noise(residual, axis)
        for left, log in zip(estimate.residuals, logs, strict=True)
        for residual, axis in zip(left, log.axes, strict=True)
        if driven(axis)
    )


def _widened(estimate: JointEstimate, alone: Sequence[LogFit]) -> JointEstimate:
    """With the deviations of an axis alone, where they exceed the joint ones."""
    names, axes = estimate.model.parameters, estimate.model.axes
    factors = {
        (which, axis): max(
            1.0, fit.estimate.deviation(which) / estimate.told(f"{which}_{axis}_{axis}")[1]
        )
        for which in ("mass", "damping")
        for axis, fit in zip(axes, alone, strict=True)
    }
    scale = np.ones(len(names))
    for place, name in enumerate(names[: 2 * len(estimate.model.pairs)]):
        which = "mass" if name.startswith("mass_") else "damping"
        row, column = estimate.model.pairs[place % len(estimate.model.pairs)]
        scale[place] = np.sqrt(factors[which, axes[row]] * factors[which, axes[column]])
    return replace(estimate, covariance=estimate.covariance * np.outer(scale, scale))


def _not_told_apart(joint: _JointFit) -> Iterator[Finding]:
    """``axes-not-told-apart``: axes that move alike, or a direction whose mass is not known."""
    estimate = joint.estimate
    if joint.apart < _ALIKE:
        yield refusal(
            "axes-not-told-apart",
            seen="some combination of the axes hardly accelerates: the least eigenvalue of the "
            f"correlations of their accelerations is {joint.apart:.2g}",
            needed=f"{_ALIKE:g} at least",
            remedy=_APART,
        )
        return
    try:
        pose = _pose(estimate)
    except ValueError:
        yield _no_mass()
        return
    matrix, half = np.array(pose.mass), pose.deviations()
    for end in (*pose.extremes("mass", half), *pose.extremes("mass", -half)):
        unit = np.array(end.direction)
        value = float(unit @ matrix @ unit)
        factor = float(np.exp(abs(np.log(end.value / value))))
        if factor > _LOOSEST:
            yield refusal(
                "axes-not-told-apart",
                seen=f"{end.along(estimate.model.axes)} the mass is {value:.4g}, known to a "
                f"factor of {factor:.3g}",
                needed=f"a mass known to a factor of {_LOOSEST:g} in every direction",
                remedy=_APART,
            )
            return


def _uneven(joint: _JointFit) -> Iterator[Finding]:
    """``unmodelled-force`` where the mass depends on position, as that of an arm."""
    if joint.uneven is None:
        return
    axis = int(np.argmax(joint.uneven[1] / joint.uneven[0]))
    low, high = joint.uneven[:, axis]
    refused = any(each.severity == "refusal" for fit in joint.alone for each in fit.findings)
    yield Finding(
        code="unmodelled-force",
        severity="refusal" if refused else "warning",
        seen="the mass depends on position, as of an arm: that of "
        f"{joint.logs[0].names[axis]} goes from {low:.4g} to {high:.4g} over the motion logged",
        needed="a mass that is the same in all of a log",
        remedy="Move less, and log several poses: the device takes the mass of each.",
    )


def _turned(joint: _JointFit) -> Iterator[Finding]:
    """``unmodelled-force`` where friction acts along directions that are no axis."""
    turned, names = joint.turned, joint.logs[0].names
    if turned is None:
        return
    direction, friction = turned.strongest
    damping, before = (np.diag(each.matrices[1]) for each in (turned.estimate, turned.before))
    doubt = NORMAL_95 * turned.left * np.abs(damping - before)
    axis = int(np.argmax(doubt / np.abs(damping)))
    most = _MOST_DOUBT * abs(damping[axis])
    yield Finding(
        code="unmodelled-force",
        severity="refusal" if doubt[axis] > most else "warning",
        seen=f"friction of {friction:.3g} {'N·m' if joint.logs[0].motion == 'rotary' else 'N'} "
        f"acts {direction_in_words(direction, names)}: damping of {names[axis]} is "
        f"{before[axis]:.4g} without it, {damping[axis]:.4g} ± {doubt[axis]:.2g} with it",
        needed=f"friction along {' and '.join(names)} alone, or ± {most:.2g} at most",
        remedy=_TURNED,
    )


def _unequal(joint: _JointFit) -> Iterator[Finding]:
    """``force-unit`` where axes couple unequally by a gain, or else ``unmodelled-force``."""
    units = {"mass": "kg", "damping": "N·s/m"}
    if joint.logs[0].motion == "rotary":
        units = {"mass": "kg·m²", "damping": "N·m·s/rad"}
    for each in joint.unequal:
        (one, other), ratio = each.axes, each.ratio
        seen = (
            f"the {each.which} that couples {one} to {other} is {each.forth:.4g} "
            f"{units[each.which]} in the force of {one} and {each.back:.4g} in that of {other}"
        )
        needed = "the same, as of one device"
        if not each.alike:
            seen += ", and no gain mends both mass and damping"
            remedy = f"Look for forces between them, as of friction at joints. {_TURNED}"
            yield refusal("unmodelled-force", seen=seen, needed=needed, remedy=remedy)
            continue
        small, large = (other, one) if abs(ratio) > 1 else (one, other)
        size = max(abs(ratio), 1 / abs(ratio))
        blame = (
            f"The force or the position of {small} reads {size:.3g} times too small, or one of "
            f"{large} as much too large"
        )
        if ratio < 0:
            blame = f"The force or the position of {one} or of {other} has the wrong sign"
        yield refusal(
            "force-unit",
            seen=f"{seen}, {ratio:.3g} times",
            needed=needed,
            remedy=f"{blame}: check the columns of each axis, their order, signs and units; "
            "--force-gain and --position-gain take a number for each axis, between commas.",
        )


def _uncoupled(one: str, other: str) -> Finding:
    return refusal(
        "axes-not-told-apart",
        seen=f"{one} and {other} never move in one log, which would tell what couples them",
        needed="motion of both at once, beyond noise",
        remedy="Drive all axes at once: friction holds an axis that only another one moves.",
    )


def _no_mass() -> Finding:
    return refusal(
        "axes-not-told-apart",
        seen="the mass matrix is not positive definite",
        needed="a positive mass in every direction",
        remedy="Check the signs and units of all axes; drive them with forces of their own.",
    )


def _pose(estimate: JointEstimate) -> Pose:
    """The matrices of one estimate with the covariance of their entries."""
    mass, damping = estimate.matrices
    friction, offset = estimate.model.friction(estimate.values)
    count = 2 * len(estimate.model.pairs)
    return Pose(
        mass=_rows(mass),
        damping=_rows(damping),
        coulomb_friction=tuple(np.maximum(friction, 0.0).tolist()),
        force_offset=tuple(offset.tolist()),
        covariance=Covariance(
            parameters=estimate.model.parameters[:count],
            matrix=_rows(estimate.covariance[:count, :count]),
            degrees_of_freedom=estimate.degrees_of_freedom,
        ),
    )


def _rows(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in ((matrix + matrix.T) / 2).tolist())


def _weakest(logs: Sequence[Trajectories]) -> ForceLimit:
    """The least of the largest forces that the axes were logged with, N (N·m)."""
    limits = [SuggestedFacts(logs=(axis,), delays=()).force_limit() for axis in _driven(logs)]
    return min(limits, key=lambda each: each.peak)


def _over_directions(poses: Sequence[Pose], which: Literal["mass", "damping"]) -> Quantity:
    """Mean over directions, and the interval that holds every direction at every pose."""
    matrices = [np.array(getattr(pose, which)) for pose in poses]
    ends = [end.value for pose in poses for end in pose.extremes(which, pose.deviations())]
    value = float(np.mean([np.trace(each) / len(each) for each in matrices]))
    return quantity(value, min(ends), max(ends))


def _range_of(by_pose: Sequence[FloatArray]) -> Quantity:
    """Mean and range over axes and poses."""
    found = np.concatenate(by_pose)
    return quantity(float(found.mean()), float(found.min()), float(found.max()))
