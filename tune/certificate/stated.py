"""Statements of a profile beside its certificate, compared with the facts they are written from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from identification import to_mapping
from tune.certificate.assumptions import note_of_apart, note_of_dropped, skipped_parts
from tune.certificate.differences import differences
from tune.certificate.elements import inconsistent
from tune.documents.profile import Design, MarginProfile, SafeProfile
from tune.documents.scene import groups_of

#: Numbers are stored with twelve digits.
_AGREE = 1e-9


def form_failures(profile: SafeProfile, content: Mapping[str, Any]) -> Iterator[str]:
    """Keys and values that a file would not hold if haptune had written it."""
    for each in differences(content, to_mapping(profile)):
        yield each.words("the file", "what haptune writes")


def stated_failures(design: Design) -> Iterator[str]:
    """What a design says and would not say if it had been tuned; nothing is computed for it."""
    for fact in design.device.unstated():
        yield f"device.{fact} was stated by nobody. State it in the device and tune again"
    kept = MarginProfile.of(design.margin.name)
    for each in differences(to_mapping(design.margin), to_mapping(kept)):
        yield each.words("margin", f"the margin {kept.name}")
    if design.together != groups_of(design.elements, design.together):
        yield "together names each set of elements once, in the order of the elements"
    if design.apart != groups_of(design.elements, design.apart):
        yield "apart names each pair of elements once, in the order of the elements"
    yield from _wrong_loop(design)
    if design.perception is None:
        yield "perception, in which steps are counted, is missing. Tune again"
    for name in design.elements:
        yield from inconsistent(design, name)
    if design.skipped != skipped_parts(design):
        yield (
            f"skipped says {_listed(design.skipped)}, device and elements of the file skip "
            f"{_listed(skipped_parts(design))}"
        )
    yield from _wrong_notes(design)
    yield from _wrong_methods(design)


def _wrong_loop(design: Design) -> Iterator[str]:
    """What the controller is told to run but the device is not said to do."""
    loop, device = design.loop, design.device
    for name, said, known in (
        ("sample_time", loop.sample_time, device.sample_time.value),
        ("extra_delay_samples", loop.extra_delay_samples * loop.sample_time, device.delay.value),
    ):
        if not abs(said - known) <= _AGREE * known:
            yield f"loop.{name} amounts to {said:.12g} s, the device has {known:.12g} s"
    used = loop.with_effects(
        damping=any(element.damping for element in design.elements.values()),
        mass=any(element.mass for element in design.elements.values()),
    )
    for each in differences(to_mapping(loop), to_mapping(used)):
        yield each.words("loop", "the loop that the effects use")


def _wrong_notes(design: Design) -> Iterator[str]:
    """Notes are about the effects that were dropped, one about each."""
    dropped = [
        note_of_dropped(f"{name}.{effect}")
        for name, element in design.elements.items()
        for effect, word in element.limited_by.items()
        if word == "not-perceptible"
    ]
    for words in dropped:
        if sum(note.startswith(words) for note in design.notes) != 1:
            yield f"notes: one begins with '{words}'"
    pairs = [pair for pair in design.apart if note_of_apart(pair) in design.notes]
    if len(design.notes) != len(dropped) + len(pairs):
        yield (
            f"notes: {len(design.notes)} of them, {len(dropped)} effects were dropped and "
            f"{len(pairs)} pairs kept apart"
        )


def _wrong_methods(design: Design) -> Iterator[str]:
    """A method is named for the elements of each group in which something acts."""
    order = list(design.elements)
    for group in _connected(design):
        played = [design.elements[name] for name in group]
        acts = any(each.stiffness or each.damping or each.mass for each in played)
        name = ", ".join(sorted(group, key=order.index))
        if (name in design.method) != acts:
            yield f"method: {1 - acts:d} stated for {name[:80]}, not {acts:d}"
    if len(design.method) > len(_connected(design)):
        yield "method is stated for elements that are not tuned together"


def _connected(design: Design) -> list[set[str]]:
    """Elements that are tuned together, because groups join them; walls apart from others."""
    found: list[set[str]] = [{name} for name in design.elements]
    for group in design.together:
        for part in (set(group) & design.walls, set(group) - design.walls):
            if part:
                joined = set[str]().union(*(each for each in found if each & part))
                found = [*(each for each in found if not each & part), joined]
    return found


def _listed(words: tuple[str, ...]) -> str:
    return ", ".join(words)[:200] or "nothing"
