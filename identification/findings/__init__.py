"""What is wrong, or doubtful, with a log: one idea per file, each finding with its numbers."""

from __future__ import annotations

from identification.device import Hardware
from identification.errors import Finding
from identification.estimators.model import Estimate
from identification.findings.causality import causality
from identification.findings.excitation import excitation
from identification.findings.resolution import resolution
from identification.findings.sampling import sampling
from identification.findings.saturation import saturation
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
)


def inspect(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """What can be said before anything is estimated.

    Args:
        trajectory: the log as it was recorded, with its own time stamps.
        hardware: what is known of the device, or None.

    Raises:
        InvalidInputError: a sample time that has nothing to do with the hardware's.
    """
    return (
        *sampling(trajectory, hardware),
        *resolution(trajectory, hardware),
        *saturation(trajectory, hardware),
    )


def judge(trajectory: Trajectory, regression: Estimate, chosen: Estimate) -> tuple[Finding, ...]:
    """What the estimates say about the log.

    Args:
        trajectory: the log.
        regression: the least-squares estimate, whose columns show what was excited.
        chosen: the estimate that is to be used.
    """
    return (*causality(trajectory, chosen), *excitation(trajectory, regression, chosen))
