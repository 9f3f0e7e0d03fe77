"""Two-stage design: a gentle first play that makes the full second one safe.

What is guessed may be two times wrong, and a constant force that nobody knows of makes a device
without a spring drift: f0/b metres a second, for as long as the play lasts. So the first play is
short and weak enough for all of that; its log tells mass, damping, friction and the constant force
well enough for the second to be planned within their intervals.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from identification.device.device import Device, load_device, named_devices
from identification.device.quantities import (
    BOX_CONFIDENCE,
    Quantity,
    quantity,
    widen_interval,
    widening,
)
from identification.documents import load_document, parse_document, to_mapping
from identification.errors import InvalidInputError
from identification.planning.response import step_response
from identification.planning.spec import ABOVE_FRICTION, FEWEST_RAMPS, ExcitationSpec
from identification.planning.worst_motion import UNPLANNED, WRONG
from identification.trajectory import SHORTEST

#: The gentle play uses at most this part of the force limit, more only where friction asks for it.
_FORCE = 0.5
#: Part of the travel that the lightest device may drift under the constant force, and in the
#: shortest play: the rest is left to the force that is planned.
_DRIFT = 0.4
_MOST_DRIFT = 0.7
#: Samples of the shortest play: its log must be long enough to be read.
_FEWEST = 1.25 * SHORTEST
#: Bisections of the duration: to a thousandth.
_HALVINGS = 12
#: Quantities of a device that a plan rests on.
_IDENTIFIED = 4


def gentle_spec(spec: ExcitationSpec) -> ExcitationSpec:
    """Limits and guesses of a first play on a device that is hardly known.

    Mass, damping and friction may be two times wrong either way, a constant force of 2 % of the
    limit may act beside the one guessed; force and duration are reduced until that is safe.

    Raises:
        InvalidInputError: the constant force alone uses up the travel before anything can be read.
    """
    unplanned = max(UNPLANNED) * spec.force
    offset = quantity(
        spec.force_offset.value,
        spec.force_offset.low - unplanned,
        spec.force_offset.high + unplanned,
    )
    steady = max(abs(offset.low), abs(offset.high))
    mass, damping = _wrong(spec.mass), _wrong(spec.damping)
    # Against more friction than the force can move, nothing goes far.
    most = max(spec.coulomb_friction.high, spec.force / ABOVE_FRICTION - steady)
    friction = _wrong(spec.coulomb_friction, most)
    force = max(_FORCE * spec.force, ABOVE_FRICTION * (friction.high + steady))
    drift = max(offset.high - offset.value, offset.value - offset.low)
    duration = _duration(spec, drift, mass.low, damping.low)
    changes = {
        "gentle": False,
        "mass": mass.model_dump(),
        "damping": damping.model_dump(),
        "coulomb_friction": friction.model_dump(),
        "force_offset": offset.model_dump(),
        "force": min(force, spec.force),
        "duration": duration,
        "ramp": min(spec.ramp, duration / (2 * FEWEST_RAMPS)),
    }
    return parse_document(ExcitationSpec, to_mapping(spec) | changes, "gentle excitation")


def _wrong(guess: Quantity, most: float = float("inf")) -> Quantity:
    """A guess that may be wrong by the factor, either way."""
    high = max(guess.high, min(guess.value * WRONG, most))
    return quantity(guess.value, min(guess.low, guess.value / WRONG), high)


def _duration(spec: ExcitationSpec, force: float, mass: float, damping: float) -> float:
    """The longest play, at most as stated, over which a constant force drifts no farther, s."""

    def drift(duration: float) -> float:
        return force / mass * step_response(damping / mass, duration)[1].real

    low, high = min(_FEWEST * spec.sample_time, spec.duration), spec.duration
    room = _DRIFT * spec.travel
    if drift(low) > _MOST_DRIFT * spec.travel:
        raise InvalidInputError(
            "gentle excitation",
            f"a constant force of {force:.3g}, {max(UNPLANNED):.0%} of the limit and the interval "
            f"of force_offset, moves the lightest device {drift(low):.2g} in the {low:.3g} s that "
            f"a log needs at least; {_MOST_DRIFT * spec.travel:.2g} of the travel is to spare",
            "Measure the constant force and narrow force_offset, lower the force limit, allow more "
            "travel, or shorten sample_time",
        )
    if drift(high) <= room:
        return high
    if drift(low) > room:
        return low
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if drift(middle) <= room else (low, middle)
    return round(low / spec.sample_time) * spec.sample_time


def load_excitation(path: str | PathLike[str]) -> ExcitationSpec:
    """Read and validate excitation.yaml, and the device it names. Raises InvalidInputError."""
    return spec_from_device(load_document(ExcitationSpec, path), Path(path).parent)


def spec_from_device(spec: ExcitationSpec, folder: Path) -> ExcitationSpec:
    """The spec with the guesses replaced by what its device file says.

    The 95 % intervals of the file are widened to hold all at once with 99.9 %, as they are for
    certificates (box.py): a play has to keep its limits on more than 95 devices of 100.

    Raises:
        InvalidInputError: no such device, one of another motion, or one that a force of position
            moves, which no plan knows.
    """
    if spec.device is None:
        return spec
    known = spec.device in named_devices()
    device = load_device(spec.device if known else folder / spec.device)
    if device.motion != spec.motion:
        raise InvalidInputError(
            spec.device,
            f"is {device.motion}, the excitation {spec.motion}",
            "Give the device that the force is for, and its motion",
        )
    if device.position_stiffness is not None or device.gravity is not None:
        raise InvalidInputError(
            spec.device,
            "has a force of position (position_stiffness or gravity), which no plan knows",
            "Level or counterbalance the axis and take off springs, then identify it again",
        )
    box = device.simultaneous_box()
    factor = _widening(device)
    friction, offset = device.coulomb_friction, device.force_offset
    frictions = [friction]
    if device.friction_by_direction is not None:
        pair = device.friction_by_direction
        frictions += [pair.forward, pair.backward]
    ends = [widen_interval(each, factor) for each in frictions]
    changes = {
        "mass": quantity(device.mass.value, *box.mass),
        "damping": _not_negative(device.damping.value, *box.damping),
        "coulomb_friction": _not_negative(
            friction.value, min(low for low, _ in ends), max(high for _, high in ends)
        ),
        "force_offset": quantity(offset.value, *widen_interval(offset, factor)),
    }
    stated = {name: each.model_dump() for name, each in changes.items()}
    return parse_document(ExcitationSpec, to_mapping(spec) | stated, spec.device)


def _widening(device: Device) -> float:
    """From half of a 95 % interval to half of the simultaneous one."""
    joint = device.covariance
    if joint is None:
        return widening(_IDENTIFIED, float("inf"), BOX_CONFIDENCE)
    count = max(_IDENTIFIED, len(joint.parameters))
    return widening(count, joint.degrees_of_freedom, BOX_CONFIDENCE)


def _not_negative(value: float, low: float, high: float) -> Quantity:
    return quantity(max(value, 0.0), max(low, 0.0), max(high, 0.0))
