"""Moments: the sets of elements that can be felt at once, from what a scene states of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

#: Elements felt together are certified in every subset, 2^n - 1 sums.
LARGEST_GROUP = 5
#: Sums of several elements in a scene, each tuned, certified and rehearsed, and each with keys of
#: its own in a profile.
MOST_SUMS = 1000
#: Elements of a scene; alone each takes a fraction of a second. In a profile each takes up to 90
#: keys, values and brackets of the 20 000 that a file may hold.
MOST_ELEMENTS = 200


def moments_of(
    elements: Iterable[str],
    together: Iterable[Sequence[str]],
    walls: Collection[str] = (),
    apart: Iterable[Sequence[str]] = (),
) -> tuple[tuple[str, ...], ...]:
    """Every set of elements that can be felt at one moment.

    Each alone, each part of a group, and each wall beside each set of other elements: a wall is
    geometry and is met wherever a hand happens to be. Walls of one side add where a group names
    both.

    Args:
        elements: names, in the order of the file.
        together: groups of names.
        walls: names of the elements that push on one side only.
        apart: pairs that are never met together.

    Returns:
        Each set once, its names in the order of the elements, smaller sets first.
    """
    order = {name: place for place, name in enumerate(elements)}
    found: dict[frozenset[str], None] = {frozenset((name,)): None for name in order}
    for members in groups_of(order, together):
        for mask in range(1, 1 << len(members)):
            found[frozenset(name for bit, name in enumerate(members) if mask >> bit & 1)] = None
    facing = list(dict.fromkeys(part for each in found if (part := each & set(walls))))
    others = list(dict.fromkeys(part for each in found if (part := each - set(walls))))
    found |= dict.fromkeys(other | wall for other in others for wall in facing)
    pairs = [frozenset(pair) for pair in apart]
    kept = [
        tuple(sorted(each, key=order.__getitem__))
        for each in found
        if not any(pair <= each for pair in pairs)
    ]
    return tuple(sorted(kept, key=len))


def groups_of(
    elements: Iterable[str], together: Iterable[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """The groups as a profile states them: each set once, names in the order of the elements."""
    order = {name: place for place, name in enumerate(elements)}
    return tuple(dict.fromkeys(tuple(sorted(set(g), key=order.__getitem__)) for g in together))


def refuse_strange_groups(
    elements: Iterable[str],
    together: Iterable[Sequence[str]],
    walls: Collection[str] = (),
    apart: Iterable[Sequence[str]] = (),
) -> None:
    """Refuse names that cannot be read, and groups or pairs that are no sets of elements.

    Raises:
        ValueError: a name is blank or not printable; a group names no element, one twice, fewer
            than two or more than LARGEST_GROUP, or a pair that is apart; a pair is none; or there
            are more than MOST_ELEMENTS elements or MOST_SUMS sums of several.
    """
    known = dict.fromkeys(elements)
    for name in known:
        if not name.strip() or not name.isprintable():
            raise ValueError(f"an element is named {name!r}; give it a word")
    pairs, sets = list(apart), list(together)
    for word, group in (
        *(("together", each) for each in sets),
        *(("apart", each) for each in pairs),
    ):
        unknown = [name for name in group if name not in known]
        if unknown:
            raise ValueError(f"{word} names {', '.join(unknown)[:80]}, which is no element")
    for pair in pairs:
        if len(pair) != 2 or len(set(pair)) != 2:
            raise ValueError(f"apart needs two different elements, not {pair}"[:200])
    for group in sets:
        if len(set(group)) != len(group) or len(group) < 2:
            raise ValueError(f"together needs two or more different elements, not {group}"[:200])
        if len(group) > LARGEST_GROUP:
            raise ValueError(f"together holds {len(group)} elements, more than {LARGEST_GROUP}")
        for pair in (each for each in pairs if set(each) <= set(group)):
            raise ValueError(f"{' and '.join(pair)} are both together and apart"[:200])
    if len(known) > MOST_ELEMENTS:
        raise ValueError(
            f"there are {len(known)} elements, more than {MOST_ELEMENTS}; split them into scenes "
            "of their own"
        )
    sums = len(moments_of(known, sets, walls, pairs)) - len(known)
    if sums > MOST_SUMS:
        raise ValueError(
            f"{sums} sums of elements are to be certified, more than {MOST_SUMS}; name fewer or "
            "smaller groups together, name walls apart from what they do not meet, or split the "
            "rest into scenes of their own"
        )
