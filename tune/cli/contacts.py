"""Contact and jitter in words: what a free device meets that enters an element."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tune.documents.profile import Contact, SafeProfile


def jitter_words(jitter: float) -> str:
    """A jitter, which is not looked for beyond `tune.margins.time_varying.MOST_JITTER`."""
    from tune.margins.time_varying import MOST_JITTER

    return f"{jitter:.0%} or more" if jitter >= MOST_JITTER else f"{jitter:.1%}"


def contact_lines(profile: SafeProfile, units: dict[str, str]) -> tuple[str, ...]:
    """What a free device meets that enters each element at the speed of its motion."""
    lines: list[str] = []
    for name, element in profile.elements.items():
        if element.contact is not None:
            speed = f"{element.motion.speed:g} {units['speed']}"
            parts = contact_words(element.contact, units, speed)
            lines += [f"{name}: {', '.join(parts)}"] if parts else []
    return ("on entering, without a hand:", *lines) if lines else ()


def contact_words(contact: Contact, units: dict[str, str], speed: str) -> tuple[str, ...]:
    """Bounce, depths, jolt, lead and energy of one element, those that it has, in words."""
    bounce, length = contact.restitution, units["length"]
    parts: list[str] = []
    if bounce is not None:
        low, high = bounce
        parts.append(f"gives back {low:.2g} to {high:.2g} of the speed")
    if contact.depth_at_continuous_force is not None:
        shallow, deep = contact.depth_at_continuous_force, contact.depth_at_peak_force
        parts.append(
            f"all of the continuous force at {shallow:.3g} {length}, cut at {deep:.3g} {length}"
        )
    if contact.lead is not None:
        side = "before" if contact.lead >= 0 else "behind"
        parts.append(f"met up to {abs(contact.lead):.2g} {length} {side} its place at {speed}")
    if contact.net_damping is not None:
        parts.append(f"damps by {contact.net_damping:.3g} {units['damping']} net of its lag")
    if contact.force_on_entry:
        parts.append(f"{contact.force_on_entry:.3g} {units['force']} on entry at {speed}")
    if contact.energy_per_entry is not None:
        parts.append(f"up to {contact.energy_per_entry:.2g} J an entry at {speed}")
    return tuple(parts)
