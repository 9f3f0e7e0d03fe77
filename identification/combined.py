"""Several logs to one device: the envelope of what they say, and what hardware leaves open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.device import (
    Covariance,
    Device,
    ForceLimit,
    Hardware,
    LogRecord,
    Quantity,
    quantity,
)
from identification.errors import Finding
from identification.estimators.noise import finest_reading
from identification.intervals import half_width
from identification.one_log import LogFit

FloatArray = NDArray[np.float64]

#: Parameters every device states, fitted or not.
PARAMETERS = ("mass", "damping", "coulomb_friction", "force_offset")

#: Largest logarithm of the interval of a mass to its value; only a log that was allowed although it
#: does not tell the mass comes near this factor of a thousand.
WIDEST_MASS = 7.0


def device_from(
    fits: Sequence[LogFit], hardware: Hardware | None, records: Sequence[LogRecord]
) -> Device:
    """The device all logs agree with: values averaged, intervals enveloped, covariance joint.

    Args:
        fits: at least one, each with positive mass.
        hardware: what is known; the logs fill in the rest with ``source: log``.
        records: one for each fit, stored with the device.
    """
    hardware = hardware or Hardware()
    first = fits[0].trajectory
    resolution = hardware.encoder_resolution
    return Device(
        name=hardware.name,
        axis=first.axis,
        motion=first.motion,
        sample_time=_sample_time(fits, hardware),
        mass=_envelope(fits, "mass"),
        damping=_envelope(fits, "damping"),
        coulomb_friction=_envelope(fits, "coulomb_friction"),
        force_offset=_envelope(fits, "force_offset"),
        delay=_delay(fits, hardware),
        encoder_resolution=(
            quantity(_resolution(fits), source="log")
            if resolution is None
            else quantity(resolution, source="hardware")
        ),
        force_limit=hardware.force_limit or _force_limit(fits),
        covariance=_covariance(fits),
        logs=tuple(records),
    )


def unstated(fits: Sequence[LogFit], hardware: Hardware | None) -> tuple[Finding, ...]:
    """Warnings for everything taken from the logs because no hardware file states it."""
    hardware = hardware or Hardware()
    findings: list[Finding] = []
    if hardware.delay is None:
        step = fits[0].trajectory.sample_time
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
                seen=f"no delay is stated; the residual of least squares, scanned from 0 to 4 "
                f"samples, is smallest at {seen}. The device is given "
                f"{_delay(fits, hardware).value * 1e3:.4g} ms, at least one sample "
                f"({step * 1e3:.4g} ms)",
                needed="the delay from command to measured force",
                remedy="State delay in the hardware file.",
            )
        )
    if hardware.force_limit is None:
        peak = _force_limit(fits).peak
        findings.append(
            Finding(
                code="force-saturated",
                severity="warning",
                seen=f"no force limit is stated; the largest force logged, {peak:.4g}, is taken "
                "as continuous and peak limit",
                needed="continuous and peak force of the actuator",
                remedy="State force_limit in the hardware file.",
            )
        )
    if hardware.encoder_resolution is None:
        findings.append(
            Finding(
                code="few-counts",
                severity="warning",
                seen="no encoder resolution is stated; the finest reading of position in the "
                f"log, {_resolution(fits):.4g}, is taken",
                needed="one count of the encoder at the handle",
                remedy="State encoder_resolution in the hardware file.",
            )
        )
    return tuple(findings)


def _interval(fit: LogFit, name: str) -> tuple[float, float, float]:
    """Value, low and high of one parameter; mass on a logarithmic scale, so that it stays positive.

    Friction is clipped at zero, where physics ends.
    """
    value, half = fit.estimate.value(name), half_width(fit.estimate, name)
    if name == "mass":
        ratio = float(np.exp(min(half / value, WIDEST_MASS)))
        return value, value / ratio, value * ratio
    low, high = value - half, value + half
    if name == "coulomb_friction":
        return max(value, 0.0), max(low, 0.0), max(high, 0.0)
    return value, low, high


def _envelope(fits: Sequence[LogFit], name: str) -> Quantity:
    """Mean weighted by inverse variance, from the lowest low to the highest high of all logs."""
    table: FloatArray = np.array([_interval(fit, name) for fit in fits])
    values, lows, highs = table[:, 0], table[:, 1], table[:, 2]
    deviations = np.array([fit.estimate.deviation(name) for fit in fits])
    if len(fits) == 1 or np.any(deviations == 0):
        value = float(np.mean(values))
    else:
        weights = deviations**-2 / np.sum(deviations**-2)
        value = float(values @ weights)
    return quantity(value, float(lows.min()), float(highs.max()))


def _covariance(fits: Sequence[LogFit]) -> Covariance:
    """Mean covariance of the logs plus the covariance between their values.

    The degrees of freedom are those of the poorest log: between logs there are too few to count.
    """
    shared = [name for name in PARAMETERS if all(name in fit.estimate.parameters for fit in fits)]
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


def _sample_time(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    stated = hardware.sample_time
    if stated is not None:
        return stated.model_copy(update={"source": "hardware"})
    steps = [fit.trajectory.sample_time for fit in fits]
    return quantity(float(np.mean(steps)), min(steps), max(steps), source="log")


def _delay(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    """The delay stated, or the longest found, but not less than one sample."""
    if hardware.delay is not None:
        return hardware.delay.model_copy(update={"source": "hardware"})
    least = float(np.mean([fit.trajectory.sample_time for fit in fits]))
    found = [fit.delay for fit in fits if fit.delay is not None]
    value = max(each.value for each in found)
    if value <= least:
        return quantity(least, source="assumed")
    low = min(each.value - 2 * each.deviation for each in found)
    high = max(each.value + 2 * each.deviation for each in found)
    return quantity(value, max(low, least), high, source="log")


def _resolution(fits: Sequence[LogFit]) -> float:
    return max(finest_reading(fit.trajectory.position, fit.trajectory.force) for fit in fits)


def _force_limit(fits: Sequence[LogFit]) -> ForceLimit:
    peak = max(float(np.max(np.abs(fit.trajectory.force))) for fit in fits)
    return ForceLimit(continuous=peak, peak=peak, source="log")
