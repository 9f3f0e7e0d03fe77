"""Whether the effects of a profile keep their margin on another device."""

from __future__ import annotations

from identification import Device, UsageError, as_stored
from tune.certificate.certify import certify
from tune.documents.certified import AbsoluteStability, Certificate
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design, Margins, SafeProfile
from tune.documents.scene import LARGEST

#: How closely the gain that is kept is found, as part of the margin.
_STEP = 0.01


def certify_on(design: Design, device: Device) -> Certificate:
    """Prove the effects, filters and margin of a design over the box of another device.

    What the design states of the device it was made for, such as margins beyond the one asked for
    and what is felt, is not asked of the other one.

    Args:
        design: effects, filters, hand and margin; a profile is one.
        device: the other device, of the same motion.

    Raises:
        UsageError: one axis slides and the other turns.
        UnstatedError: facts of the device that a person has to state.
        CheckFailedError: force, ripple or stability of some moment does not hold there.
    """
    if device.motion != design.device.motion:
        raise UsageError(
            "device",
            f"the profile is for a {design.device.motion} axis, the device is {device.motion}",
            "Give a device of the same motion",
        )
    device.require_stated()
    return certify(_moved(design, device), witnesses=_witnesses(design, design.margin.gain))


def kept_gain(design: Design, device: Device) -> float:
    """The gain margin that is proved on another device, with the extra delay of the design's.

    Force and ripple are not looked at.

    Returns:
        At most the margin asked for, within a hundredth below the largest; 0 if nothing is proved.
    """
    moved = _moved(design, device.model_copy(update={"force_limit": None})).model_copy(
        update={"ripple_limit": LARGEST}
    )
    kept, lost = 0.0, design.margin.gain
    if _is_proved(moved, lost, _witnesses(design, lost)):
        return lost
    while lost - kept > _STEP * design.margin.gain:
        middle = (kept + lost) / 2
        proved = _is_proved(moved, middle, _witnesses(design, middle))
        kept, lost = (middle, lost) if proved else (kept, middle)
    return kept


def _is_proved(design: Design, gain: float, witnesses: dict[str, AbsoluteStability]) -> bool:
    margin = design.margin.model_copy(update={"gain": gain})
    try:
        certify(design.model_copy(update={"margin": margin}), witnesses=witnesses)
    except CheckFailedError:
        return False
    return True


def _witnesses(design: Design, gain: float) -> dict[str, AbsoluteStability]:
    """The multipliers of a profile, asked for no more than a gain."""
    seal = design.certificate if isinstance(design, SafeProfile) else None
    stated = (seal and seal.absolute_stability) or {}
    return {name: each.model_copy(update={"gain": gain}) for name, each in stated.items()}


def _moved(design: Design, device: Device) -> Design:
    """The design on the device, its claims those of its margin and no more."""
    kept = Margins(
        gain=0.0,
        extra_delay_samples=float(design.margin.extra_delay_samples),
        passive=False,
    )
    unclaimed = {
        name: element.model_copy(
            update={
                "margins": kept,
                "ripple": LARGEST,
                "rendered": None,
                "perceived_steps": {},
            }
        )
        for name, element in design.elements.items()
    }
    return design.model_copy(update={"device": as_stored(device), "elements": unclaimed})
