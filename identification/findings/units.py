"""Are force and position in SI units?

A unit multiplies every parameter and changes no residual, so a log cannot prove its own. What can
be seen: numbers no handle reaches, whole numbers throughout, and disagreement with the hardware
file. Volts, amperes or mN that happen to look like newtons pass unseen without one, and with one
where their numbers lie between a part of the continuous force and the peak force; a profile says
that it takes the unit on trust.

No remedy fits the hardware to the log: limits and counts come from data sheets, or a wrong unit
would move into the device. One file: the findings about the units of two columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.signals import encoder_count, position_noise
from identification.trajectory import Motion, Trajectory

FloatArray = NDArray[np.float64]

#: A column of whole numbers that spans at least this many of them comes from a counter or a
#: converter; forces commanded in whole newtons stay below.
WHOLE_NUMBERS = 200
#: Times the peak force of the hardware above which it is not the actuator that is overloaded.
OVER_LIMIT = 10.0
#: Part of the continuous force of the hardware that a calibration reaches; what stays below may be
#: in volts or amperes, of which most handles need fewer than newtons.
UNDER_LIMIT = 0.4
#: Ratio of the count seen to the count stated above which one of them has another unit: less than
#: 57, from degrees to radians, and more than interpolation by four to sixteen.
COUNT_RATIO = 25.0
#: Scatter of a reading, in counts stated, from which one of them has another unit: an encoder's
#: readings scatter by a count, and by at least 0.29 of one, which is 17 in degrees.
SCATTER = 10.0
#: Units a column may be in by mistake, and SI in each; ...
_FORCES = (("mN or N·mm", 1e-3), ("kN", 1e3))
_LENGTHS = {
    "linear": (("mm", 1e-3), ("µm", 1e-6), ("cm", 1e-2), ("inches", 0.0254)),
    "rotary": (("degrees", float(np.pi / 180)), ("turns", float(2 * np.pi)), ("mrad", 1e-3)),
}
#: ... what counts as one of them may be off by this part.
_NAMED = 0.1


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
_MASS: dict[Motion | None, tuple[float, float]] = {
    "linear": (1e-4, 1000.0),
    "rotary": (1e-9, 100.0),
    None: (1e-9, 1000.0),
}
_MASS_UNIT: dict[Motion | None, str] = {"linear": "kg", "rotary": "kg·m²", None: "kg (kg·m²)"}


def units(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``force-unit`` as far as it shows before anything is estimated."""
    return (
        *_whole_numbers(trajectory),
        *_against_limit(trajectory, hardware),
        *_against_count(trajectory, hardware),
        *_out_of_reach(trajectory),
    )


def mass_unit(trajectory: Trajectory, mass: float) -> tuple[Finding, ...]:
    """``force-unit`` where the mass is none a device has."""
    low, high = _MASS[trajectory.motion]
    if low <= mass <= high or mass <= 0:
        return ()
    unit = _MASS_UNIT[trajectory.motion]
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"{trajectory.source} gives a mass of {mass:.3g} {unit}",
            needed=f"{low:g} to {high:g} {unit}, which handles and axes have",
            remedy="Give what one unit of each column is in SI with --force-gain (mN, volts, "
            "amperes or counts?), --position-gain (mm or degrees?) and --time-gain (ms?), and "
            "state force_limit and encoder_resolution in the hardware file.",
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
    """Force far above what the actuator gives, or so small that it may be volts or amperes."""
    if hardware is None or hardware.force_limit is None:
        return ()
    limit, peak = hardware.force_limit, float(np.max(np.abs(trajectory.force)))
    over = peak > OVER_LIMIT * limit.peak
    under = peak < UNDER_LIMIT * limit.continuous and "force" not in trajectory.stated_units
    if limit.peak == 0 or not (over or under):
        return ()
    likely = [
        f"; {unit}: --force-gain {size:g}"
        for unit, size in _FORCES
        if UNDER_LIMIT * limit.continuous <= peak * size <= limit.peak
    ]
    sure = "" if over else ", or --force-gain 1 if it is in N (N·m)"
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"{trajectory.source} reaches a force of {peak:.4g}; the actuator gives "
            f"{limit.continuous:.4g} continuous and {limit.peak:.4g} peak",
            needed=f"between {UNDER_LIMIT * limit.continuous:.4g} and {limit.peak:.4g}, so that "
            "the unit of the column is no guess",
            remedy="Volts or amperes are possible: give N (N·m) per unit of the force column with "
            f"--force-gain (per ampere: torque constant and transmission{''.join(likely)}){sure}. "
            "Limits are those of the data sheet, in N (N·m) at the handle.",
        ),
    )


def _against_count(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """A count, or a scatter of readings, that is not that of the encoder stated.

    Noise or few digits may hide the count; a digit printed may look like one.
    """
    if hardware is None or hardware.encoder_resolution is None:
        return ()
    stated, seen = hardware.encoder_resolution.value, encoder_count(trajectory.position)
    likely, sure = "", ""
    if seen is not None and not 1 / COUNT_RATIO < seen / stated < COUNT_RATIO:
        ratio, words = seen / stated, f"steps by {seen:.4g}"
        needed = f"the same within a factor of {COUNT_RATIO:g}"
        for unit, size in _LENGTHS[trajectory.motion or "linear"]:
            if abs(ratio * size - 1) < _NAMED:
                likely = f" (in {unit}: --position-gain {size:.6g})"
    elif "position" in trajectory.stated_units:
        return ()
    else:
        scatter = position_noise(trajectory.position, trajectory.force, trajectory.steps)
        if scatter <= SCATTER * stated:
            return ()
        ratio, words = scatter / stated, f"scatters by {scatter:.4g} rms"
        needed = f"at most {SCATTER:g} times"
        sure = ", or --position-gain 1 if it is"
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"position in {trajectory.source} {words}, {ratio:.3g} times the encoder "
            f"resolution {stated:.4g} of the hardware",
            needed=needed,
            remedy="Where position is not in m (rad), give what one unit of it is with "
            f"--position-gain{likely}{sure}. The encoder resolution is that of the data "
            "sheet, in m (rad) at the handle.",
        ),
    )


def _out_of_reach(trajectory: Trajectory) -> tuple[Finding, ...]:
    limits = _PLAUSIBLE[trajectory.motion or "linear"]
    travel = float(np.ptp(trajectory.position))
    speed = float(np.max(_speeds(trajectory)))
    if travel <= limits.travel and speed <= limits.speed:
        return ()
    remedy = (
        f"Give --position-gain: the position looks like {limits.wrong}, or the motion that the "
        "hardware file states is not that of the axis."
    )
    if trajectory.motion is None:
        remedy = (
            "If the axis turns, state motion: rotary in the hardware file (--hardware), and for "
            "degrees --position-gain 0.0174533; if it slides, state motion: linear and give "
            f"--position-gain, since the position looks like {limits.wrong}."
        )
    return (
        Finding(
            code="force-unit",
            severity="refusal",
            seen=f"{trajectory.source} travels {travel:.4g} {limits.unit} at up to {speed:.4g} "
            f"{limits.unit}/s" + ("" if trajectory.motion else ", read as m"),
            needed=f"at most {limits.travel:g} {limits.unit} and {limits.speed:g} {limits.unit}/s",
            remedy=remedy,
        ),
    )


def _speeds(trajectory: Trajectory) -> FloatArray:
    """Speed over spans of about a hundredth of the log's samples, which noise does not swell."""
    span = max(1, len(trajectory) // 100)
    return np.abs(
        (trajectory.position[span:] - trajectory.position[:-span])
        / (trajectory.time[span:] - trajectory.time[:-span])
    )
