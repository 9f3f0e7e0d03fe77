"""What a certificate says it takes for granted, what it leaves to others, where there is none."""

from __future__ import annotations

from dataclasses import dataclass

from identification import Device
from tune.documents.effects import EFFECT_NAMES
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design

METHOD = (
    "no pole can cross the unit circle anywhere in the box: excluded by subdivision with "
    "first-order forms and bounds of the rest, over frequency and its aliases; poles at single "
    "points isolated in 400-bit balls; a search for the worst point found none that contradicts"
)
ASSUMES = (
    "constant sample time within its interval; a missed deadline counts as one extra sample",
    "a linear loop: forces stay below the limit, the force of saturation is not relied on",
    "elements and gains change slowly against the loop; switching is not part of the proof",
    "the controller runs the very filters named, reset on contact",
    "Coulomb friction gives no damping",
    "everything within its interval, in any combination, and constant while the loop runs",
)
NO_HAND = "no hand: the device alone"
WITH_HAND = (
    "the device alone, and with any hand within the intervals: a mass, a damper and a spring to a "
    "place that rests"
)
RIGID = "a rigid mechanism: no vibration mode is stated"
SPRUNG = (
    "the device's own force by position is proportional to it over all the travel, and acts on the "
    "rigid mass; no gravity"
)
WITH_MODES = "no vibration modes but those stated"
NO_LAG = "no lag of the current loop but what the delay holds"
_BALANCE = (
    "Counterbalance the axis, level it, take off the spring or magnet, or let the controller "
    "compensate the force; then log again, with the compensation running."
)
NOT_ASSESSED = (
    "bounce on a one-sided wall, and sustained oscillation from quantiser and friction: the "
    "simulator's part",
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
    unit = {"linear": "N/m", "rotary": "N·m/rad"}[device.motion]
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


def assumptions(design: Design) -> tuple[str, ...]:
    """What the proof takes for granted."""
    device = design.device
    return (
        *ASSUMES,
        NO_HAND if design.hand is None else WITH_HAND,
        *(() if device.slope_at_zero == 0 else (SPRUNG,)),
        WITH_MODES if device.modes else RIGID,
        *(() if device.current_lag is not None else (NO_LAG,)),
    )


def skipped_parts(design: Design) -> tuple[str, ...]:
    """What was not asked for, or is not known, and nothing was spent on."""
    device, loop = design.device, design.loop
    wished = {effect for element in design.elements.values() for effect in element.limited_by}
    parts = (
        *((effect, effect not in wished) for effect in EFFECT_NAMES),
        ("velocity filter", loop.velocity_filter_hz is None),
        ("acceleration filter", loop.acceleration_filter_hz is None),
        ("ripple: the encoder resolution is not known", device.encoder_resolution is None),
        ("force: the force limit is not known", device.force_limit is None),
        ("hand", design.hand is None),
        ("modes", not device.modes),
    )
    return tuple(words for words, skipped in parts if skipped)


def note_of_dropped(label: str) -> str:
    """How the note about an effect that is left out begins, by its label element.effect."""
    return f"{label} dropped: "
