"""What logs suggest of the hardware where no person states it, and the warnings that say so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.device.hardware import ForceLimit, Hardware
from identification.device.quantities import Quantity, quantity
from identification.errors import Finding
from identification.estimators.estimate import NORMAL_95
from identification.estimators.signals import LOST, finest_reading
from identification.fitting.one_log import LogFit

#: Part of the steps between stamps that the stored interval of the sample time holds.
_PART = 0.95


def unstated_warnings(fits: Sequence[LogFit], hardware: Hardware | None) -> tuple[Finding, ...]:
    """Warnings for everything that no hardware file states, and what the logs suggest of it.

    Only a delay that the logs tell within a sample is used; for the rest `tune` will ask.
    """
    hardware = hardware or Hardware()
    findings: list[Finding] = []
    if fits[0].trajectory.motion is None:
        findings.append(_no_motion(fits))
    if hardware.delay is None:
        step, given = sample_time_of(fits, Hardware()).value, delay_of(fits, hardware)
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
        peak = force_limit_of(fits).peak
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
                f"log is {resolution_of(fits):.4g}",
                needed="one count of the encoder at the handle, from its data sheet",
                remedy="State encoder_resolution in the hardware file.",
            )
        )
    return tuple(findings)


def _no_motion(fits: Sequence[LogFit]) -> Finding:
    """Whether an axis turns cannot be seen: radians and metres are numbers."""
    travel = max(float(np.ptp(fit.trajectory.position)) for fit in fits)
    return Finding(
        code="force-unit",
        severity="warning",
        seen=f"no motion is stated; position spans {travel:.4g}, which may be m or rad",
        needed="whether the axis slides (N, m, kg) or turns (N·m, rad, kg·m²)",
        remedy="State motion: linear or motion: rotary in the hardware file (--hardware); degrees "
        "need --position-gain 0.0174533 too.",
    )


def mark_stated(known: Quantity | None) -> Quantity | None:
    """What the hardware states, marked so; what it only assumes stays assumed."""
    if known is None or known.source is not None:
        return known
    return known.model_copy(update={"source": "hardware"})


def sample_time_of(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    """The sample time stated, or the mean and spread of the steps between stamps, s."""
    stated = mark_stated(hardware.sample_time)
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


def delay_of(fits: Sequence[LogFit], hardware: Hardware) -> Quantity:
    """The delay stated, or the interval that the logs allow, up to one sample at least.

    A loop that computes between reading and commanding is later than one that plays a plan.
    """
    stated = mark_stated(hardware.delay)
    if stated is not None:
        return stated
    least = sample_time_of(fits, Hardware()).value
    found = [fit.delay for fit in fits if fit.delay is not None]
    low = min(each.value - NORMAL_95 * each.deviation for each in found)
    high = max(each.value + NORMAL_95 * each.deviation for each in found)
    value = max(each.value for each in found)
    return quantity(max(value, least), max(low, 0.0), max(high, least), source="log")


def resolution_of(fits: Sequence[LogFit]) -> float:
    """The coarsest of the finest readings of position, m (rad)."""
    return max(finest_reading(fit.trajectory.position, fit.trajectory.force) for fit in fits)


def force_limit_of(fits: Sequence[LogFit]) -> ForceLimit:
    """The largest force logged, N (N·m); no limit of any actuator."""
    peak = max(float(np.max(np.abs(fit.trajectory.force))) for fit in fits)
    return ForceLimit(continuous=peak, peak=peak, source="log")
