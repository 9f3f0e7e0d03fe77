"""Several logs to one device: values averaged, intervals enveloped, covariances joined.

Where no person states the hardware, the logs suggest it, and warnings say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.device.device import (
    ByDirection,
    Covariance,
    Device,
    ForceLimit,
    Gravity,
    LogRecord,
    Quantity,
    SlopeRange,
    quantity,
)
from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.estimate import NORMAL_95, quantile
from identification.estimators.signals import LOST, finest_reading
from identification.fitting.one_log import LogFit

FloatArray = NDArray[np.float64]

#: Parameters every device states, fitted or not.
_PARAMETERS = ("mass", "damping", "coulomb_friction", "force_offset")

#: Largest logarithm of the interval of a mass to its value; only a log that was allowed although it
#: does not tell the mass comes near this factor of a thousand.
_WIDEST_MASS = 7.0
_CONFIDENCE = 0.95  # probability that a stored interval holds the truth


def device_from(
    fits: Sequence[LogFit], hardware: Hardware | None, records: Sequence[LogRecord]
) -> Device:
    """The device all logs agree with: values averaged, intervals enveloped, covariance joint."""
    hardware = hardware or Hardware()
    first = fits[0].trajectory
    springs, weights = (
        [fit for fit in fits if fit.estimate.model.gravity == kind]
        for kind in ("proportional", "pendulum")
    )
    return Device(
        name=hardware.name,
        axis=first.axis,
        serial=hardware.serial,
        date=hardware.date,
        operator=hardware.operator,
        motion=first.motion or "linear",
        missing=() if first.motion else ("motion",),
        sample_time=_sample_time_of(fits, hardware),
        mass=_envelope(fits, "mass"),
        damping=_envelope(fits, "damping"),
        coulomb_friction=_envelope(fits, "coulomb_friction"),
        force_offset=_envelope(fits, "force_offset"),
        delay=_delay_of(fits, hardware),
        encoder_resolution=_mark_stated(hardware.encoder_resolution)
        or quantity(_resolution_of(fits), source="log"),
        force_limit=hardware.force_limit or _force_limit_of(fits),
        modes=hardware.modes,
        current_lag=hardware.current_lag,
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
    """Hull of the intervals of a weighted sum of parameters.

    Mass lies on a logarithmic scale, so that it stays positive; friction is clipped at zero, where
    physics ends.
    """
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
    """Mean covariance of the logs plus the covariance between their values.

    The degrees of freedom are those of the poorest log: between logs there are too few to count.
    """
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


_PART = 0.95  # part of the steps between stamps that the stored interval of the sample time holds


def unstated_warnings(fits: Sequence[LogFit], hardware: Hardware | None) -> tuple[Finding, ...]:
    """Warnings for everything that no hardware file states, and what the logs suggest of it.

    Only a delay that the logs tell within a sample is used; for the rest `tune` will ask.
    """
    hardware = hardware or Hardware()
    findings: list[Finding] = []
    if fits[0].trajectory.motion is None:
        # Whether an axis turns cannot be seen: radians and metres are numbers.
        travel = max(float(np.ptp(fit.trajectory.position)) for fit in fits)
        findings.append(
            Finding(
                code="force-unit",
                severity="warning",
                seen=f"no motion is stated; position spans {travel:.4g}, which may be m or rad",
                needed="whether the axis slides (N, m, kg) or turns (N·m, rad, kg·m²)",
                remedy="State motion: linear or motion: rotary in the hardware file (--hardware); "
                "degrees need --position-gain 0.0174533 too.",
            )
        )
    if hardware.delay is None:
        step, given = _sample_time_of(fits, Hardware()).value, _delay_of(fits, hardware)
        seen = ", ".join(
            f"{fit.delay.value * 1e3:.4g} ± {2 * fit.delay.deviation * 1e3:.1g} ms in "
            f"{fit.trajectory.source}"
            for fit in fits
            if fit.delay is not None
        )
        findings.append(
            Finding(
                code="delay-unknown",
                severity="warning",
                seen=f"no delay is stated; the log says {seen}, looking from 0 to 4 samples. "
                f"The device is given {given.low * 1e3:.4g} to {given.high * 1e3:.4g} ms, one "
                f"sample ({step * 1e3:.4g} ms) or more at its upper end",
                needed="the delay from command to measured force, within a sample",
                remedy="State delay in the hardware file.",
            )
        )
    if hardware.force_limit is None:
        peak = _force_limit_of(fits).peak
        findings.append(
            Finding(
                code="force-saturated",
                severity="warning",
                seen=f"no force limit is stated, and the largest force logged, {peak:.4g}, is none;"
                " whether the column is in N (N·m), or in volts or amperes, nothing here can tell",
                needed="continuous and peak force of the actuator, from its data sheet",
                remedy="State force_limit in the hardware file; where the column is in another "
                "unit, give N (N·m) per unit with --force-gain (per ampere: torque constant and "
                "transmission).",
            )
        )
    if hardware.encoder_resolution is None:
        findings.append(
            Finding(
                code="few-counts",
                severity="warning",
                seen="no encoder resolution is stated; the finest reading of position in the "
                f"log is {_resolution_of(fits):.4g}",
                needed="one count of the encoder at the handle, from its data sheet",
                remedy="State encoder_resolution in the hardware file.",
            )
        )
    return tuple(findings)


def _mark_stated(known: Quantity | None) -> Quantity | None:
    """What the hardware states, marked so; what it only assumes stays assumed."""
    if known is None or known.source is not None:
        return known
    return known.model_copy(update={"source": "hardware"})


def _sample_time_of(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    """The sample time stated, or the mean and spread of the steps between stamps, s."""
    stated = _mark_stated(hardware.sample_time)
    if stated is not None:
        return stated
    logs = [np.asarray(fit.trajectory.steps) for fit in fits]
    # Lost rows are long steps of the log, not of the loop.
    usual = [steps[steps <= LOST * np.median(steps)] for steps in logs]
    means = [float(np.mean(steps)) for steps in usual]
    low = min(float(np.quantile(steps, (1 - _PART) / 2)) for steps in usual)
    high = max(float(np.quantile(steps, (1 + _PART) / 2)) for steps in usual)
    value = float(np.mean(means))
    return quantity(value, min(low, value), max(high, value), source="log")


def _delay_of(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    """The delay stated, or the interval that the logs allow, up to one sample at least.

    A loop that computes between reading and commanding is later than one that plays a plan.
    """
    stated = _mark_stated(hardware.delay)
    if stated is not None:
        return stated
    least = _sample_time_of(fits, Hardware()).value
    found = [fit.delay for fit in fits if fit.delay is not None]
    low = min(each.value - NORMAL_95 * each.deviation for each in found)
    high = max(each.value + NORMAL_95 * each.deviation for each in found)
    value = max(each.value for each in found)
    return quantity(max(value, least), max(low, 0.0), max(high, least), source="log")


def _resolution_of(fits: Sequence[LogFit]) -> float:
    """The coarsest of the finest readings of position, m (rad)."""
    return max(finest_reading(fit.trajectory.position, fit.trajectory.force) for fit in fits)


def _force_limit_of(fits: Sequence[LogFit]) -> ForceLimit:
    """The largest force logged, N (N·m); no limit of any actuator."""
    peak = max(float(np.max(np.abs(fit.trajectory.force))) for fit in fits)
    return ForceLimit(continuous=peak, peak=peak, source="log")
