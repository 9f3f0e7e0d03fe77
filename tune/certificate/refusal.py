"""Devices on which no effect at all can be certified, because their own force pushes them away."""

from __future__ import annotations

from dataclasses import dataclass

from identification import Device
from tune.certificate.assumptions import STIFFNESS_UNITS
from tune.documents.errors import CheckFailedError

#: What to do about either.
_BALANCE = (
    "Counterbalance the axis, level it, take off the spring or magnet, or let the controller "
    "compensate the force; then log again, with the compensation running."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why no effect on a device can be certified: what was seen, what is needed, what to do."""

    seen: str
    needed: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.seen}; needed: {self.needed}. {self.remedy}"


def refusal_of(device: Device) -> Refusal | None:
    """Why a device is unstable beside every effect that is weak enough; None where it is not.

    Every gain in (0, g] is to be stable, and so the device at next to none. One that its own force
    pushes away from where it is, anywhere in its box or on its travel, runs away by itself.
    """
    low, high = device.simultaneous_box().position_stiffness
    unit = STIFFNESS_UNITS[device.motion]
    if device.gravity is not None and any(
        side
        for part in (device.gravity.sine, device.gravity.cosine)
        for side in (part.low, part.high)
    ):
        return Refusal(
            seen=f"gravity: the slope of the device's own force runs from {low:.4g} to {high:.4g} "
            f"{unit} as the axis turns; "
            + (
                "where it is negative the device falls by itself, beside any effect that is weak"
                if low < 0
                else "what is proved holds for a slope that does not change"
            ),
            needed="no gravity",
            remedy=_BALANCE,
        )
    if low > 0 or low == high == 0:
        return None
    return Refusal(
        seen=f"position_stiffness: {low:.4g} to {high:.4g} {unit} over the box of the device; "
        "where it is not positive nothing brings the device back, and it runs away by itself "
        "beside any effect that is weak",
        needed=f"above 0 {unit} throughout, or none",
        remedy=_BALANCE + (" A log of more travel narrows the interval." if high > 0 else ""),
    )


def refuse_unbalanced(device: Device) -> None:
    """Raise CheckFailedError where `refusal_of` a device has a reason."""
    refusal = refusal_of(device)
    if refusal is not None:
        raise CheckFailedError((f"device: {refusal}",))
