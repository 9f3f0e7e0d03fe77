"""Moments: the sets of elements that can be felt at once, from the groups that a scene states."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

#: Elements felt together are certified in every subset, 2^n - 1 sums.
LARGEST_GROUP = 5
#: Sums of several elements in a scene, each tuned, certified and rehearsed. Of groups of five
#: elements, 62 moments took 34 s of processor time with one effect an element, and 31 took 42 s
#: with three.
MOST_SUMS = 100
#: Elements of a scene; alone each takes a fraction of a second. In a profile each takes up to 90
#: keys, values and brackets of the 20 000 that a file may hold.
MOST_ELEMENTS = 200


def moments_of(
    elements: Iterable[str], together: Iterable[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """Every set of elements that can be felt at one moment: each alone, and each part of a group.

    Args:
        elements: names, in the order of the file.
        together: groups of names.

    Returns:
        Each set once, its names in the order of the elements, smaller sets first.
    """
    order = {name: place for place, name in enumerate(elements)}
    found: dict[tuple[str, ...], None] = {(name,): None for name in order}
    for members in groups_of(order, together):
        for mask in range(1, 1 << len(members)):
            found[tuple(name for bit, name in enumerate(members) if mask >> bit & 1)] = None
    return tuple(sorted(found, key=len))


def groups_of(
    elements: Iterable[str], together: Iterable[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """The groups as a profile states them: each set once, names in the order of the elements."""
    order = {name: place for place, name in enumerate(elements)}
    return tuple(dict.fromkeys(tuple(sorted(set(g), key=order.__getitem__)) for g in together))


def refuse_strange_groups(elements: Iterable[str], together: Iterable[Sequence[str]]) -> None:
    """Refuse names that cannot be read and groups that are no set of elements.

    Raises:
        ValueError: a name is blank or not printable; a group names no element, one twice, fewer
            than two or more than LARGEST_GROUP; or there are more than MOST_ELEMENTS elements or
            MOST_SUMS sums of several.
    """
    known = dict.fromkeys(elements)
    for name in known:
        if not name.strip() or not name.isprintable():
            raise ValueError(f"an element is named {name!r}; give it a word")
    for group in together:
        unknown = [name for name in group if name not in known]
        if unknown:
            raise ValueError(f"together names {', '.join(unknown)[:80]}, which is no element")
        if len(set(group)) != len(group) or len(group) < 2:
            raise ValueError(f"together needs two or more different elements, not {group}"[:200])
        if len(group) > LARGEST_GROUP:
            raise ValueError(f"together holds {len(group)} elements, more than {LARGEST_GROUP}")
    if len(known) > MOST_ELEMENTS:
        raise ValueError(
            f"there are {len(known)} elements, more than {MOST_ELEMENTS}; split them into scenes "
            "of their own"
        )
    sums = len(moments_of(known, together)) - len(known)
    if sums > MOST_SUMS:
        raise ValueError(
            f"together makes {sums} sums of elements to certify, more than {MOST_SUMS}; name fewer "
            "or smaller groups, and split the rest into scenes of their own"
        )
