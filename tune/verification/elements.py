"""What a profile lets a controller play, and how a law reads in words."""

from __future__ import annotations

from identification import UsageError
from tune.documents.effects import EFFECT_NAMES, Effects
from tune.documents.profile import Design

#: Joins the elements of one moment, on the command line and in sentences.
_AND = "+"


def moments_of(profile: Design, element: str | None) -> tuple[tuple[str, ...], ...]:
    """Every moment the log may be of: all of them, or the one named "wall" or "wall+water".

    Raises:
        UsageError: no such element, or elements that are not felt together.
    """
    every = profile.moments()
    if element is None:
        return tuple(moment for moment in every if not silent(profile, moment))
    wanted = frozenset(element.split(_AND))
    found = tuple(moment for moment in every if frozenset(moment) == wanted)
    if not found or silent(profile, found[0]):
        known = ", ".join(_AND.join(moment) for moment in every if not silent(profile, moment))
        problem = "plays nothing" if found else "is not in the profile"
        raise UsageError("--element", f"'{element[:80]}' {problem}", f"Choose from {known}")
    return found


def silent(profile: Design, moment: tuple[str, ...]) -> bool:
    """Whether all effects of a moment are zero."""
    return all(size is None for size in effects_of(profile, moment).arrays())


def effects_of(profile: Design, moment: tuple[str, ...]) -> Effects:
    """The sum of the effects of a moment; what sums to zero is not there."""
    sums = {
        name: sum(float(getattr(profile.elements[each], name)) for each in moment)
        for name in EFFECT_NAMES
    }
    return Effects(**{name: value or None for name, value in sums.items()})


def scale_effects(effects: Effects, gain: float) -> Effects:
    """Effects at a gain; what is not there stays away."""
    K, B, M = (None if size is None else float(size) * gain for size in effects.arrays())
    return Effects(stiffness=K, damping=B, mass=M)


def moment_in_words(moment: tuple[str, ...]) -> str:
    """The name of a moment."""
    return _AND.join(moment)
