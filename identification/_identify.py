"""Mass, damping, friction and delay of an axis from its logs, and what one log can support."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from identification.device.device import (
    ByDirection,
    Covariance,
    Device,
    Gravity,
    LogRecord,
    SlopeRange,
)
from identification.device.hardware import Hardware, held_modes
from identification.device.quantities import Quantity, Tabular, quantity, widest
from identification.documents import as_stored, complaints
from identification.errors import (
    Finding,
    InvalidInputError,
    LogRefusedError,
    UsageError,
    refuse,
    typed,
)
from identification.estimators import METHODS, Method
from identification.estimators.estimate import Estimate, quantile
from identification.estimators.signals import position_noise
from identification.findings import CODES, inspect
from identification.findings.force_balance import ForceBalance, balance_of
from identification.findings.lost_rows import Restored, restored
from identification.fitting import LogFit, fit_log, suggested_by
from identification.trajectory import (
    FloatArray,
    Motion,
    Trajectories,
    Trajectory,
    encoder_count,
    refuse_sizes,
)

#: The excited band holds the power of the velocity but for this part at either end.
_OUTSIDE = 0.01
#: Parameters every device states, fitted or not.
_PARAMETERS = ("mass", "damping", "coulomb_friction", "force_offset")

#: Largest logarithm of the interval of a mass to its value; only a log that was allowed although it
#: does not tell the mass comes near this factor of a thousand.
_WIDEST_MASS = 7.0
_CONFIDENCE = 0.95  # probability that a stored interval holds the truth


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification(Tabular):
    """What identify found.

    Attributes:
        device: hardware plus what was identified, numbers rounded as they will be stored.
        logs: one fit for each log, in the order given.
        findings: warnings about the logs, those allowed among them.
    """

    device: Device
    logs: tuple[LogFit, ...]
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        mass, damping = self.device.mass, self.device.damping
        return (
            f"Identification(mass {mass.value:.6g} ({mass.low:.6g} to {mass.high:.6g}), "
            f"damping {damping.value:.6g} ({damping.low:.6g} to {damping.high:.6g}), "
            f"by {self.method} from {len(self.logs)} log(s), {len(self.findings)} finding(s))"
        )

    def _rows(self) -> list[dict[str, object]]:
        names = ("mass", "damping", "coulomb_friction", "force_offset", "delay")
        found = {name: getattr(self.device, name) for name in names}
        return [
            {"quantity": name, "value": each.value, "low": each.low, "high": each.high}
            for name, each in found.items()
        ]

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimate believed of each log."""
        return tuple(fit.estimate for fit in self.logs)

    @property
    def method(self) -> str:
        """Method of the estimates believed; several are joined by "+"."""
        return "+".join(dict.fromkeys(fit.method for fit in self.logs))

    @property
    def reason(self) -> str:
        """Why this method, a sentence for each log."""
        return "; ".join(f"{fit.trajectory.source}: {fit.reason}" for fit in self.logs)


@typed
def identify(
    trajectory: Trajectory | Trajectories | Sequence[Trajectory | Trajectories],
    *,
    hardware: Hardware | None = None,
    method: Method = "auto",
    allow: Collection[str] = (),
) -> Identification:
    """Identify one axis from one log or several, or a device of several axes driven together.

    Args:
        trajectory: a log, or several of one axis; several give the envelope. A log of which nobody
            said whether it is linear or rotary has the motion of the hardware. A log of several
            axes is a pose, as are logs that drive one axis after another.
        hardware: what is known of the device. A delay it states is honoured, 0 included. What it
            does not state is ``missing`` in the device, which holds what the logs suggest of it
            with ``source: log``; only a delay that they tell within a sample counts as known.
        method: "auto" believes output error where position noise explains its residual, else the
            most efficient method that a more robust one does not contradict; or one of METHODS.
        allow: codes of findings that are not to refuse a log; recorded with the device.

    Raises:
        UsageError: no log that was read, logs of different axes, an unknown method or code.
        InvalidInputError: hardware and log contradict each other.
        LogRefusedError: mass and damping cannot honestly be told; carries every finding.
    """
    one = isinstance(trajectory, str) or not isinstance(trajectory, Iterable)
    given = cast("Sequence[object]", (trajectory,) if one else trajectory)
    allow = (allow,) if isinstance(allow, str) else allow
    for each in given:
        if not isinstance(each, Trajectory | Trajectories):
            problem = f"{repr(each)[:80]} is no log that was read"
            raise UsageError("logs", problem, "Read it with load_trajectory or load_log")
    several = tuple(each for each in given if isinstance(each, Trajectories))
    trajectories = tuple(each for each in given if isinstance(each, Trajectory))
    if several and trajectories:
        raise UsageError("logs", "are of one axis and of several", "Give one kind at a time")
    _check_request(trajectories or several, hardware, method, allow)
    hardware = hardware or Hardware()
    if several:
        from identification.fitting.several_axes import fit_axes

        several = tuple(
            replace(log, axes=tuple(_moving(axis, several, hardware) for axis in log.axes))
            for log in several
        )
        found = fit_axes(several, hardware, method, allow)
        device = _stored(several, lambda: found.device(hardware))
        return Identification(device=device, logs=found.logs, findings=found.findings)
    trajectories = tuple(_moving(log, trajectories, hardware) for log in trajectories)
    for log in trajectories:
        refuse_sizes(log)
    noticed = [
        tuple(each.of(log.source) for each in inspect(log, hardware)) for log in trajectories
    ]
    refuse(noticed, allow)
    fits: list[LogFit] = []
    for place, log in enumerate(trajectories):
        timed = Restored(trajectory=_clocked(log, hardware))
        if {"lost-rows", "repeated-rows"} & {each.code for each in noticed[place]}:
            timed = restored(timed.trajectory)
        fit = fit_log(timed.trajectory, hardware, method)
        fits.append(replace(fit, estimate=timed.carried_by(fit.estimate)))
        noticed[place] += tuple(each.of(log.source) for each in fit.findings)
    refuse(noticed, allow)
    if any(fit.estimate.value("mass") <= 0 for fit in fits):  # no permission makes a device of it
        raise LogRefusedError(tuple(finding for found in noticed for finding in found))

    sources = ", ".join(log.source for log in trajectories)
    missing = tuple(each.of(sources) for each in suggested_by(fits).not_stated(hardware))
    records = [
        LogRecord(
            source=fit.trajectory.source,
            digest=fit.trajectory.digest,
            samples=len(fit.trajectory),
            method=fit.method,
            findings=tuple(dict.fromkeys(finding.code for finding in (*found, *missing))),
            allowed=tuple(dict.fromkeys(f.code for f in found if f.severity == "refusal")),
            unmodelled_forces=() if fit.curve is None else fit.curve.found,
            read_as=fit.trajectory.read_as,
        )
        for fit, found in zip(fits, noticed, strict=True)
    ]
    logs = tuple(  # what was let through warns
        replace(fit, findings=tuple(replace(each, severity="warning") for each in found))
        for fit, found in zip(fits, noticed, strict=True)
    )
    return Identification(
        device=_stored(trajectories, lambda: _device_from(fits, hardware, records)),
        logs=logs,
        findings=(*(each for log in logs for each in log.findings), *missing),
    )


def _check_request(
    trajectories: Sequence[Trajectory] | Sequence[Trajectories],
    hardware: Hardware | None,
    method: str,
    allow: Collection[str],
) -> None:
    if not trajectories:
        raise UsageError("logs", "none given", "Give at least one log")
    if method not in METHODS:
        problem = f"'{method}' is not available"
        raise UsageError("--method", problem, "Choose from " + ", ".join(METHODS))
    unknown = sorted(set(allow) - set(CODES))
    if unknown:
        problem = f"{', '.join(unknown)} is no finding"
        raise UsageError("--allow", problem, "Choose from " + ", ".join(CODES))
    for name in ("axis", "motion"):
        said = (getattr(log, name) for log in trajectories)
        seen = list(dict.fromkeys(item for item in said if item is not None))
        if len(seen) > 1:
            remedy = f"Give logs of one {name} at a time; each has its own device"
            raise UsageError(f"--{name}", f"the logs are of {' and '.join(seen)}", remedy)
        known = None if hardware is None else getattr(hardware, name)
        if name == "axis" and hardware is not None:
            several = isinstance(trajectories[0], Trajectories)
            if hardware.axes is not None:
                known = ",".join(hardware.axes)
            elif several and "axis" not in hardware.model_fields_set:
                known = None  # nobody asked for x
            if hardware.axes is not None and not several:
                raise UsageError(
                    "--hardware",
                    f"states the axes {known}, and {trajectories[0].source} is read as one",
                    f"Name a column of each with {_each_of('force', hardware.axes)} and "
                    f"{_each_of('position', hardware.axes)}, or state the one axis there (axis: "
                    f"{hardware.axes[0]})",
                )
        if seen and known is not None and known != seen[0]:
            problem = f"the logs are of {seen[0]}, the hardware of {known}"
            remedy = f"Give the logs and the hardware of one {name}"
            if "," in seen[0] and "," not in known:
                remedy = f"State axes: [{seen[0]}] in the hardware file, or name columns of one"
            raise UsageError(f"--{name}", problem, remedy)


def _each_of(role: str, axes: Sequence[str]) -> str:
    """An option that names a column of each axis."""
    return f"--{role} {','.join(f'{role}_{axis}' for axis in axes)}"


def _stored(
    logs: Sequence[Trajectory] | Sequence[Trajectories], make: Callable[[], Device]
) -> Device:
    """A device as its file will hold it. Raises InvalidInputError for numbers that none has."""
    from pydantic import ValidationError

    try:
        return as_stored(make())
    except ValidationError as error:
        raise InvalidInputError(
            ", ".join(log.source for log in logs),
            f"gives numbers that no device has ({complaints(Device, error)})",
            "Name the right columns, and give gains that make them SI",
        ) from None


def _moving(
    log: Trajectory, logs: Sequence[Trajectory] | Sequence[Trajectories], hardware: Hardware
) -> Trajectory:
    """The log with the motion that the hardware, or else another of the logs, states."""
    stated = [hardware.motion, *(each.motion for each in logs)]
    motion = next((each for each in stated if each is not None), None)
    return log if log.motion == motion else replace(log, motion=motion)


def _clocked(trajectory: Trajectory, hardware: Hardware) -> Trajectory:
    """An even log on the sample time stated; an uneven one with its own stamps."""
    stated = hardware.sample_time
    if stated is None or isinstance(trajectory.steps, np.ndarray):
        return trajectory
    return replace(trajectory, time=np.arange(len(trajectory)) * stated.value)


def _device_from(
    fits: Sequence[LogFit], hardware: Hardware, records: Sequence[LogRecord]
) -> Device:
    """The device all logs agree with: values averaged, intervals enveloped, covariance joint."""
    first = fits[0].trajectory
    springs, weights = (
        [fit for fit in fits if fit.estimate.model.gravity == kind]
        for kind in ("proportional", "pendulum")
    )
    beside = [fit.dynamics for fit in fits if fit.dynamics is not None]
    facts = suggested_by(fits)
    return Device(
        **facts.of_device(hardware, first.motion),
        axis=first.axis,
        mass=_envelope(fits, "mass"),
        damping=_envelope(fits, "damping"),
        coulomb_friction=_envelope(fits, "coulomb_friction"),
        force_offset=_envelope(fits, "force_offset"),
        force_limit=hardware.force_limit or facts.force_limit(),
        modes=held_modes(hardware.modes, [each.mode for each in beside if each.mode is not None]),
        current_lag=widest(hardware.current_lag, [each.current_lag for each in beside]),
        covariance=_covariance(fits),
        damping_slope=_hull_of(fits, "slope"),
        presliding_stiffness=_hull_of(fits, "presliding"),
        logs=tuple(records),
        damping_by_direction=_by_direction(fits, "damping"),
        friction_by_direction=_by_direction(fits, "friction"),
        position_stiffness=_envelope(springs, "position_stiffness") if springs else None,
        gravity=Gravity(
            sine=_envelope(weights, "gravity_sine"), cosine=_envelope(weights, "gravity_cosine")
        )
        if weights
        else None,
    )


def _envelope(fits: Sequence[LogFit], name: str) -> Quantity:
    """Mean of one parameter by inverse variance, and the interval that holds that of every log."""
    return _hull(fits, least=0.0 if name == "coulomb_friction" else None, **{name: 1.0})


def _hull(fits: Sequence[LogFit], *, least: float | None = None, **weights: float) -> Quantity:
    """Hull of the intervals of a weighted sum of parameters, that of a mass in logarithms."""
    # Of one log's interval, so that the envelope of several has 95 % for all.
    confidence = 1 - (1 - _CONFIDENCE) / len(fits)
    pairs: FloatArray = np.array([fit.estimate.combined(**weights) for fit in fits])
    values, deviations = pairs[:, 0], pairs[:, 1]
    quantiles = [quantile(fit.estimate, confidence) for fit in fits]
    halves: FloatArray = deviations * np.array(quantiles)
    lows, highs = values - halves, values + halves
    if weights.keys() == {"mass"}:
        ratio = np.exp(np.minimum(halves / values, _WIDEST_MASS))
        lows, highs = values / ratio, values * ratio
    if len(fits) == 1 or np.any(deviations == 0):
        value = float(np.mean(values))
    else:
        value = float(values @ (deviations**-2 / np.sum(deviations**-2)))
    low, high = float(lows.min()), float(highs.max())
    if least is not None:
        value, low, high = max(value, least), max(low, least), max(high, least)
    return quantity(value, low, high)


def _by_direction(fits: Sequence[LogFit], what: str) -> ByDirection | None:
    """Damping or Coulomb friction forward and backward, of the logs that tell them apart."""
    telling = [fit for fit in fits if fit.estimate.model.directional]
    if not telling:
        return None
    # The offset of the model holds at the mean speed; at rest damping has no asymmetry.
    speed = float(np.mean([fit.estimate.mean_speed for fit in telling]))

    def one_way(side: float) -> Quantity:
        if what == "damping":
            return _hull(telling, damping=1.0, damping_asymmetry=side)
        weights = {"force_offset": side, "damping_asymmetry": -side * speed}
        return _hull(telling, least=0.0, coulomb_friction=1.0, **weights)

    return ByDirection(forward=one_way(1.0), backward=one_way(-1.0))


def _hull_of(fits: Sequence[LogFit], name: Literal["slope", "presliding"]) -> SlopeRange | None:
    """Range over all logs whose friction is no straight line over speed."""
    found: list[SlopeRange | None] = [getattr(each.curve, name, None) for each in fits]
    known = [each for each in found if each is not None]
    if not known:
        return None
    return SlopeRange(low=min(each.low for each in known), high=max(each.high for each in known))


def _covariance(fits: Sequence[LogFit]) -> Covariance:
    """Mean covariance of the logs plus that between their values; freedom of the poorest log."""
    shared = [name for name in _PARAMETERS if all(name in fit.estimate.parameters for fit in fits)]
    within: list[FloatArray] = []
    for fit in fits:
        order = [fit.estimate.parameters.index(name) for name in shared]
        within.append(fit.estimate.covariance[np.ix_(order, order)])
    total = np.mean(within, axis=0)
    if len(fits) > 1:
        values = [[fit.estimate.value(name) for name in shared] for fit in fits]
        total = total + np.cov(np.array(values).T)
    return Covariance(
        parameters=tuple(shared),
        matrix=tuple(tuple(float(cell) for cell in row) for row in total),
        degrees_of_freedom=min(fit.estimate.degrees_of_freedom for fit in fits),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Examination:
    """One log and what identify makes of it; SI units, or the rotary ones of Device.

    Attributes:
        source: where the log comes from.
        motion: "linear" or "rotary"; None where nobody stated it.
        samples: number of rows.
        fitted: rows that mass and damping are told from; None if they are not told.
        duration: s.
        sample_time: usual step, s.
        travel: m, from end to end.
        peak_speed: m/s, as smooth as noise of position asks for.
        peak_force: N.
        count: step of the position, m, if all positions lie on a grid.
        noise: standard deviation of one position reading, m.
        band: Hz, lowest and highest frequency of the motion; 1 % of the squared velocity lies below
            and 1 % above.
        mass: kg, with its 95 % interval; None if none can be had at all.
        damping: N·s/m, with its 95 % interval; None if none can be had at all.
        findings: every one, refusals first; allowed ones are warnings.
        refused: whether identify refuses the log.
        found: what identify makes of it, were every finding accepted; None if nothing.
    """

    source: str
    motion: Motion | None
    samples: int
    fitted: int | None
    duration: float
    sample_time: float
    travel: float
    peak_speed: float
    peak_force: float
    count: float | None
    noise: float
    band: tuple[float, float]
    mass: Quantity | None
    damping: Quantity | None
    findings: tuple[Finding, ...]
    refused: bool
    found: Identification | None


def examine(
    trajectory: Trajectory,
    *,
    hardware: Hardware | None = None,
    method: Method = "auto",
    allow: Collection[str] = (),
) -> Examination:
    """Look at one log as identify would, and refuse nothing.

    Args:
        trajectory: the log.
        hardware: as for identify.
        method: as for identify.
        allow: as for identify.

    Raises:
        UsageError: an unknown method or code, hardware of another axis.
        InvalidInputError: hardware and log contradict each other, or no numbers of a device.
    """
    found: Identification | None = None
    try:
        found = identify(trajectory, hardware=hardware, method=method, allow=allow)
        findings, refused = found.findings, False
    except LogRefusedError as error:
        findings, refused = error.findings, True
        with suppress(LogRefusedError, InvalidInputError):  # then it tells nothing at all
            found = identify(trajectory, hardware=hardware, method=method, allow=CODES)
    rows = balance_of(trajectory)
    time = trajectory.time
    return Examination(
        source=trajectory.source,
        motion=trajectory.motion or (None if hardware is None else hardware.motion),
        samples=len(trajectory),
        fitted=None if found is None else found.logs[0].fitted,
        duration=float(time[-1] - time[0]),
        sample_time=trajectory.sample_time,
        travel=float(np.ptp(trajectory.position)),
        peak_speed=float(np.max(np.abs(rows.velocity))),
        peak_force=float(np.max(np.abs(trajectory.force))),
        count=encoder_count(trajectory.position),
        noise=position_noise(trajectory.position, trajectory.force),
        band=_band(rows),
        mass=None if found is None else found.device.mass,
        damping=None if found is None else found.device.damping,
        findings=findings,
        refused=refused,
        found=found,
    )


def _band(rows: ForceBalance) -> tuple[float, float]:
    """Frequencies between which the motion has its velocity, Hz."""
    step = float(np.median(np.diff(rows.time)))
    velocity = (rows.velocity - np.mean(rows.velocity)) * np.hanning(len(rows))
    power: FloatArray = np.cumsum(np.abs(np.fft.rfft(velocity)) ** 2)
    frequency = np.fft.rfftfreq(len(rows), step)
    low = int(np.count_nonzero(power < _OUTSIDE * power[-1]))
    high = int(np.count_nonzero(power < (1 - _OUTSIDE) * power[-1]))
    return float(frequency[low]), float(frequency[min(high, frequency.size - 1)])
