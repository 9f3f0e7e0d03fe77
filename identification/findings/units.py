"""Are force and position in SI units?

A unit multiplies every parameter and changes no residual, so a log cannot prove its own. What can
be seen: numbers no handle reaches, whole numbers throughout, and disagreement with the hardware
file. A force in volts or mN that happens to look like newtons passes unseen without one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.device.device import Hardware
from identification.errors import Finding
from identification.estimators.noise import encoder_count
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: A column of whole numbers that spans at least this many of them comes from a counter or a
#: converter; forces commanded in whole newtons stay below.
WHOLE_NUMBERS = 200
#: Times the peak force of the hardware above which it is not the actuator that is overloaded.
OVER_LIMIT = 10.0
#: Part of the peak force of the hardware below which a log was perhaps not in newtons.
UNDER_LIMIT = 0.02
#: Ratio of the count seen to the count stated above which one of them has another unit: less than
#: 57, from degrees to radians, and more than interpolation by four to sixteen.
COUNT_RATIO = 25.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plausible:
    """What a handle or a servo axis stays below, in SI; doubted above."""

    travel: float
    speed: float
    unit: str
    wrong: str


#: A gantry of 20 m; a hand throws at 10 to 20 m/s. A shaft of 20 000 rpm turns at 2 100 rad/s, and
#: a log of 1 000 turns is long.
_PLAUSIBLE = {
    "linear": _Plausible(travel=20.0, speed=20.0, unit="m", wrong="millimetres or counts"),
    "rotary": _Plausible(travel=6000.0, speed=2500.0, unit="rad", wrong="degrees or counts"),
}
#: A mass, kg, or inertia, kg·m², that is no handle's: a forging press, and a fly's wing.
_MASS = {"linear": (1e-4, 1000.0), "rotary": (1e-9, 100.0)}


def units(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``force-unit`` as far as it shows before anything is estimated."""
    return (
        *_whole_numbers(trajectory),
        *_against_limit(trajectory, hardware),
        *_against_count(trajectory, hardware),
        *_out_of_reach(trajectory),
    )


def mass_unit(trajectory: Trajectory, mass: float) -> tuple[Finding, ...]:
    """``force-unit`` where the mass is none a device has.

    A warning, because nothing but the size speaks against it.
    """
    low, high = _MASS[trajectory.motion]
    if low <= mass <= high or mass <= 0:
        return ()
    unit = "kg" if trajectory.motion == "linear" else "kg·m²"
    return (
        Finding(
            code="force-unit",
            severity="warning",
            seen=f"{trajectory.source} gives a mass of {mass:.3g} {unit}",
            needed=f"{low:g} to {high:g} {unit}, which handles and axes have",
            remedy="Check --force-gain (mN, volts or counts?) and --position-gain (mm or "
            "degrees?), and state force_limit in the hardware file.",
        ),
    )


def _whole_numbers(trajectory: Trajectory) -> tuple[Finding, ...]:
    findings: list[Finding] = []
    for name, column in (("force", trajectory.force), ("position", trajectory.position)):
        if not np.all(column == np.rint(column)) or np.ptp(column) < WHOLE_NUMBERS:
            continue
        findings.append(
            Finding(
                code="force-unit",
                severity="refusal",
                seen=f"every {name} in {trajectory.source} is a whole number, from "
                f"{column.min():.0f} to {column.max():.0f}",
                needed="SI units, not the counts of a converter",
                remedy=f"Give what one count is with --{name}-gain.",
            )
        )
    return tuple(findings)


def _against_limit(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    if hardware is None or hardware.force_limit is None:
        return ()
    limit, peak = hardware.force_limit.peak, float(np.max(np.abs(trajectory.force)))
    over = peak > OVER_LIMIT * limit
    if limit == 0 or (peak >= UNDER_LIMIT * limit and not over):
        return ()
    return (
        Finding(
            code="force-unit",
            severity="refusal" if over else "warning",
            seen=f"{trajectory.source} reaches a force of {peak:.4g}, {peak / limit:.2g} times "
            f"the peak force {limit:.4g} of the hardware",
            needed=f"{UNDER_LIMIT:g} to 1 times, {OVER_LIMIT:g} at most",
            remedy="Give what one unit of the force column is in N (N·m) with --force-gain, or "
            "correct force_limit.",
        ),
    )


def _against_count(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    if hardware is None or hardware.encoder_resolution is None:
        return ()
    stated, seen = hardware.encoder_resolution.value, encoder_count(trajectory.position)
    if seen is None or 1 / COUNT_RATIO < seen / stated < COUNT_RATIO:
        return ()
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"position in {trajectory.source} steps by {seen:.4g}, {seen / stated:.3g} times "
            f"the encoder resolution {stated:.4g} of the hardware",
            needed=f"the same within a factor of {COUNT_RATIO:g}",
            remedy="Give what one unit of the position column is in m (rad) with --position-gain, "
            "or correct encoder_resolution.",
        ),
    )


def _out_of_reach(trajectory: Trajectory) -> tuple[Finding, ...]:
    limits = _PLAUSIBLE[trajectory.motion]
    travel = float(np.ptp(trajectory.position))
    speed = float(np.max(_speeds(trajectory)))
    if travel <= limits.travel and speed <= limits.speed:
        return ()
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"{trajectory.source} travels {travel:.4g} {limits.unit} at up to {speed:.4g} "
            f"{limits.unit}/s",
            needed=f"at most {limits.travel:g} {limits.unit} and {limits.speed:g} {limits.unit}/s",
            remedy=f"Give --position-gain: the position looks like {limits.wrong}.",
        ),
    )


def _speeds(trajectory: Trajectory) -> FloatArray:
    """Speed over spans of about a hundredth of the log's samples, which noise does not swell."""
    span = max(1, len(trajectory) // 100)
    return np.abs(
        (trajectory.position[span:] - trajectory.position[:-span])
        / (trajectory.time[span:] - trajectory.time[:-span])
    )
