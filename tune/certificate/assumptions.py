"""What a certificate takes for granted, leaves to others and refuses at once, in sentences."""

from __future__ import annotations

from dataclasses import dataclass

from identification import Device
from tune.documents import CheckFailedError
from tune.documents.profile import Design
from tune.documents.scene import EFFECT_NAMES, UNITS, EffectName

METHOD = (
    "no pole can cross the unit circle anywhere in the box: excluded by subdivision with "
    "first-order forms and bounds of the rest, over frequency and its aliases; poles at single "
    "points isolated in 400-bit balls; a search for the worst point found none that contradicts"
)
ASSUMES = (
    "constant sample time within its interval; a missed period holds the force, is bridged by a "
    "straight line and counts as one extra sample of delay",
    "a linear loop: forces stay below the limit, the force of saturation is not relied on",
    "elements and gains change slowly against the loop; switching is not part of the proof",
    "the controller runs the very filters named, on every reading of the axis",
    "Coulomb friction gives no damping",
    "everything within its interval, in any combination, and constant while the loop runs",
)
#: What is said instead where some moments are proved absolutely stable.
LINEAR_ELSEWHERE = (
    "a linear loop, but for moments with absolute_stability: forces stay below the limit, the "
    "force of saturation is not relied on"
)
SLOW_ELSEWHERE = (
    "elements and gains change slowly against the loop; of moments with absolute_stability clamps "
    "may push on one side only or cut at any level that falls, and damping may be switched, at any "
    "moment; a level rises, and a face or rest moves, only while its clamp gives no force"
)
_ASSUMES_WITH_WALLS = (ASSUMES[0], LINEAR_ELSEWHERE, SLOW_ELSEWHERE, *ASSUMES[3:])
#: Of designs in which something fades, or does beside a clamp that may be reached.
FADES = (
    "elements with mass or a negative effect fade over fade_time: proved at every constant level "
    "of each; that no hand pumps by entering and leaving in time was looked for in waves of the "
    "level on the device alone, and is not proved"
)
FADING_SPRINGS = (
    "elements whose spring fades with their mass are entered and left all the way: on a device "
    "that loses little, a hand that hovers between could pump it"
)
NOT_CUT = (
    "levels of what fades stand still while a wall pushes; its force is not cut: where a wall is "
    "pushed so hard that the sum reaches the force limit, the hand is taken to hold it without "
    "swinging"
)
MISSED = (
    "a period missed at a wall counts as one extra sample of delay for all of the contact; periods "
    "missed by chance were played, not proved"
)
OPPOSITE = (
    "walls on opposite sides push one at a time; a swing to and fro between walls of unlike B/K is "
    "played, not proved"
)
CURVE = (
    "friction that rises with speed is rehearsed as damping of its least and its largest slope, "
    "not as the curve"
)
MULTIPLIER = (
    "; absolute stability by the stated multipliers, their condition shown in every cell of the box"
)
NO_HAND = "no hand: the device alone"
WITH_HAND = (
    "the device alone, and with any hand within the intervals: a mass, a damper and a spring to a "
    "place that rests"
)
HELD = (
    "friction with a memory slides, or holds the device by a spring without loss of {:.6g} to "
    "{:.6g} {} beside it"
)
RIGID = "a rigid mechanism: no vibration mode is stated"
SPRUNG = (
    "the device's own force by position is proportional to it over all the travel, and acts on the "
    "rigid mass; no gravity"
)
WITH_MODES = "no vibration modes but those stated"
NO_LAG = "no lag of the current loop but what the delay holds"
SLOPES = (
    "friction that rises with speed acts as some constant damping between its least and its "
    "largest slope"
)
UNEVEN = "steps that vary in length: margins.jitter is assessed at corners of the box, not proved"
NOT_ASSESSED = (
    UNEVEN,
    "bounce on a one-sided wall, and sustained oscillation from quantiser and friction: the "
    "simulator's part",
)
NOT_ASSESSED_OF_WALLS = (
    UNEVEN,
    "sustained oscillation from quantiser and friction: the simulator's part",
    "clamps that rise under force; a grip that changes during contact",
)
FACTS = "facts of the device as stated, which a log cannot show: {} motion, {}"
LOG_UNITS = (
    "logs in SI units: force in {}, not volts or amperes (those need --force-gain, the torque "
    "constant and transmission), and position in {}; a unit changes no residual"
)
ASSUMED = "of the device, what was only assumed: {}"
#: What to do about a device that its own force pushes away, or turns over.
_BALANCE = (
    "Counterbalance the axis, level it, take off the spring or magnet, or let the controller "
    "compensate the force; then log again, with the compensation running."
)


def trusted_facts(device: Device) -> tuple[str, ...]:
    """Facts that no log and no calculation can confirm, and who has to answer for them."""
    units = ("N", "m") if device.motion == "linear" else ("N m", "rad")
    facts = ["sample time", "delay"]
    facts += ["encoder resolution"] if device.encoder_resolution is not None else []
    facts += ["force limit"] if device.force_limit is not None else []
    assumed = [name.replace("_", " ") for name in device.assumed()]
    return (
        FACTS.format(device.motion, ", ".join(facts)),
        *((LOG_UNITS.format(*units),) if device.logs else ()),
        *((ASSUMED.format(", ".join(assumed)),) if assumed else ()),
    )


def assumptions(design: Design) -> tuple[str, ...]:
    """What the proof takes for granted."""
    device = design.device
    spring, unit = device.presliding_stiffness, UNITS[device.motion]["stiffness"]
    return (
        *(ASSUMES if not _walls(design) else _ASSUMES_WITH_WALLS),
        *((FADES,) if _fades(design) else ()),
        *((FADING_SPRINGS,) if _fades(design, "stiffness") else ()),
        *((NOT_CUT,) if _fades(design) and _walls(design) else ()),
        *((MISSED,) if _walls(design) else ()),
        *((OPPOSITE,) if len(design.walls) > 1 else ()),
        *trusted_facts(device),
        NO_HAND if design.hand is None else WITH_HAND,
        *(() if device.slope_at_zero == 0 else (SPRUNG,)),
        WITH_MODES if device.modes else RIGID,
        *(() if device.current_lag is not None else (NO_LAG,)),
        *(() if device.damping_slope is None else (SLOPES,)),
        *(() if spring is None else (HELD.format(spring.low, spring.high, unit),)),
    )


def not_assessed(design: Design) -> tuple[str, ...]:
    """What the proof leaves out."""
    return (
        *_uncovered(design),
        *(NOT_ASSESSED_OF_WALLS if _walls(design) else NOT_ASSESSED),
        *(() if design.device.damping_slope is None else (CURVE,)),
    )


def method(design: Design) -> str:
    """How it was proved."""
    return METHOD + (MULTIPLIER if _walls(design) else "")


def _walls(design: Design) -> bool:
    """Whether some moment is proved absolutely stable."""
    return any(
        element.one_sided or (element.stiffness and element.motion.penetration is None)
        for element in design.elements.values()
    )


def _fades(design: Design, effect: EffectName | None = None) -> bool:
    """Whether some element fades, one with an effect if that is named."""
    return any(
        element.fades and (effect is None or getattr(element, effect))
        for element in design.elements.values()
    )


def _uncovered(design: Design) -> tuple[str, ...]:
    """Friction that the logs show and no slope over speed covers."""
    return tuple(
        f"{force.words}, {force.share:.1%} of the force in {log.source}: the certified loop has "
        "none"
        for log in design.device.logs
        for force in log.unmodelled_forces
        if not force.rises
        and not (force.kind == "memory" and design.device.presliding_stiffness is not None)
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


def note_of_apart(pair: tuple[str, ...]) -> str:
    """The note about two elements that the scene did not tell apart."""
    return (
        f"kept apart: {' and '.join(pair)} are not proved together at one step of each; the guard "
        "gives no force where both are asked for"
    )


def note_of_dropped(label: str) -> str:
    """How the note about an effect that is left out begins, by its label element.effect."""
    return f"{label} dropped: "


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
    unit = UNITS[device.motion]["stiffness"]
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
