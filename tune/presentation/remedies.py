"""What each limit of an effect means, and what of hardware or scene would move it."""

from __future__ import annotations

from tune.documents.profile import Design, LimitedBy

#: (meaning, what helps) by what binds.
_WORDS: dict[LimitedBy, tuple[str, str]] = {
    "stability": (
        "More of it would shake the loop.",
        "A shorter delay, a faster sample rate or more damping of the device itself help.",
    ),
    "gain-margin": (
        "More of it would keep less than the margin of gain.",
        "A shorter delay or a faster sample rate help; log longer for narrower intervals.",
    ),
    "delay-margin": (
        "More of it would keep less than the margin of delay.",
        "A shorter delay or a faster sample rate help.",
    ),
    "saturation": (
        "More of it is stable as long as nothing is cut or switched, and no proof was found beyond "
        "that.",
        "More damping of the device or a shorter delay help, or name it apart from what it is not "
        "met with.",
    ),
    "lead": (
        "More damping would be met too far before the face of the wall; more stiffness would lag "
        "more than its damping makes good.",
        "A longer lead in the scene gives more damping; a shorter delay gives more of both.",
    ),
    "force": (
        "More of it would ask for more force than the actuator gives.",
        "A stronger actuator, or less penetration, speed or acceleration in the scene help.",
    ),
    "rendering": (
        "More of it would be felt, by filters and delay, as another mass or damping by more than a "
        "step.",
        "A finer encoder (less filtering), a faster sample rate or damping beside it help.",
    ),
    "ripple": (
        "More of it would make the counts of the encoder felt.",
        "A finer encoder helps; a lower cut-off does too, but makes mass and damping lag.",
    ),
    "wanted": ("It is what the scene asks for.", ""),
    "range": ("It is the end of the range that the scene allows.", "A wider range helps."),
    "not-perceptible": (
        "All that is allowed of it is less than a hand can tell, so that it is left out.",
        "See what limits the other effects; --what-if tells what each fact of the hardware costs.",
    ),
}


def limits_of(design: Design) -> tuple[tuple[str, str, str], ...]:
    """(which effects a limit binds, what it means, what helps), each limit once."""
    bound: dict[LimitedBy, list[str]] = {}
    for name, element in design.elements.items():
        for effect, reason in element.limited_by.items():
            bound.setdefault(reason, []).append(f"{name} {effect}")
    return tuple(
        (f"{reason}: {', '.join(effects)}", *_WORDS[reason]) for reason, effects in bound.items()
    )
