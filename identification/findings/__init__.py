"""What is wrong, or doubtful, with a log: one idea per file, each finding with its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.estimators.least_squares import Delay
from identification.findings.columns import (
    encoder_wrap,
    mass_unit,
    resolution,
    sampling,
    saturation,
    stiction,
    units,
)
from identification.findings.excitation import (
    causality,
    contradicting_delays,
    excitation,
    unknown_delay,
)
from identification.findings.force_balance import balance_of
from identification.findings.forces import (
    cross_validation,
    cut_off_sensitivity,
    hand,
    inertia,
    position_dependence,
    unlogged,
)
from identification.trajectory import Trajectory

#: Every code a finding can have; the list is part of the file format and of the command line.
CODES = (
    "not-exciting-mass",
    "not-exciting-damping",
    "few-counts",
    "force-saturated",
    "force-unit",
    "dropped-samples",
    "jitter",
    "clock-backward",
    "encoder-wrap",
    "sign-flip",
    "gravity",
    "stiction",
    "hand-on-device",
    "controller-identified",
    "delay-unknown",
    "non-finite",
    "constant-column",
    "too-short",
    "heldout-misfit",
    "unmodelled-force",
)


def inspect(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """What can be said before anything is estimated."""
    wrapped = tuple(encoder_wrap(trajectory))
    if wrapped:  # what else the position says is not the device's
        return (*sampling(trajectory, hardware), *wrapped, *saturation(trajectory, hardware))
    return (
        *sampling(trajectory, hardware),
        *units(trajectory, hardware),
        *resolution(trajectory, hardware),
        *saturation(trajectory, hardware),
        *stiction(trajectory, hardware),
    )


def judge(
    trajectory: Trajectory,
    regression: Estimate,
    chosen: Estimate,
    *,
    delay: Delay | None = None,
    consulted: Sequence[Estimate] = (),
) -> tuple[Finding, ...]:
    """What the estimates say about the log."""
    balance = balance_of(trajectory, chosen)
    left = unlogged(trajectory, balance, chosen)
    return (
        *causality(trajectory, balance, chosen),
        *excitation(trajectory, balance, regression, chosen, delay, left),
        *position_dependence(trajectory, balance, chosen),
        *hand(trajectory, balance, left),
        *cross_validation(trajectory, balance, chosen),
        *inertia(trajectory, balance, chosen),
        *cut_off_sensitivity(trajectory, chosen),
        *unknown_delay(trajectory, delay),
        *contradicting_delays(trajectory, chosen, consulted),
        *mass_unit(trajectory, chosen.value("mass")),
    )
