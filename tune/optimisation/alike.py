"""Elements that are alike: one of each kind is tuned and proved, the others play the same.

A maze of thirty equal walls has the effects of a maze with one, in the time of one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from tune.certificate.certify import note_of_apart, note_of_dropped, note_of_unmet
from tune.documents.profile import Design
from tune.documents.scene import EFFECT_NAMES, Scene, groups_of


def with_all_alike(design: Design, scene: Scene) -> Design:
    """The design of a whole scene, from that of the first element of each kind."""
    order, members = [*scene.elements], dict[str, list[str]]()
    kinds = scene.alike()
    for name, first in kinds.items():
        members.setdefault(first, []).append(name)
    there = design.elements
    pairs = {pair: list(_alike(pair, members, order)) for pair in design.apart}
    method = {
        each: how for names, how in design.method.items() for each in members.get(names, (names,))
    }
    return design.model_copy(
        update={
            "elements": {name: there[first] for name, first in kinds.items() if first in there},
            "apart": groups_of(order, [each for alike in pairs.values() for each in alike]),
            "notes": tuple(_notes(design, members, pairs)),
            "method": method,
        }
    )


_Pairs = Mapping[tuple[str, ...], Sequence[tuple[str, ...]]]


def _alike(
    names: Sequence[str], members: Mapping[str, Sequence[str]], order: Sequence[str]
) -> Iterator[tuple[str, ...]]:
    """Every choice of elements of which each is alike one of some."""
    for each in product(*(members[name] for name in names)):
        yield tuple(sorted(each, key=order.index))


def _notes(design: Design, members: Mapping[str, Sequence[str]], pairs: _Pairs) -> Iterator[str]:
    """The notes of a design, one for each element or pair that they are about."""
    of_pairs = {note_of_apart(pair): alike for pair, alike in pairs.items()}
    begun = {
        name: tuple(
            begin(f"{name}.{effect}")
            for begin, effect in product((note_of_dropped, note_of_unmet), EFFECT_NAMES)
        )
        for name in members
    }
    for note in design.notes:
        yield from map(note_of_apart, of_pairs.get(note, ()))
        for name in (each for each, words in begun.items() if note.startswith(words)):
            yield from (each + note.removeprefix(name) for each in members[name])
