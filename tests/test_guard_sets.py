"""The sets that guard and law play are the moments that were certified, whatever groups overlap."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from identification import to_mapping
from tests.exported import tuned
from tests.guard import InPython
from tune import SafeProfile
from tune.exporters import export

NAMES = [f"e{k}" for k in range(9)]
_GROUPS = st.lists(
    st.lists(st.sampled_from(NAMES), min_size=2, max_size=5, unique=True), max_size=6
)


_PAIRS = st.lists(st.lists(st.sampled_from(NAMES), min_size=2, max_size=2, unique=True), max_size=4)


def _profile(
    groups: list[list[str]], walls: frozenset[str] = frozenset(), apart: Sequence[list[str]] = ()
) -> SafeProfile:
    """The tuned profile with other elements and groups."""
    some = tuned().elements["wall"]
    wall = some.model_copy(update={"one_sided": True})
    return tuned().model_copy(
        update={
            "elements": {name: wall if name in walls else some for name in NAMES},
            "together": tuple(tuple(group) for group in groups),
            "apart": tuple(tuple(pair) for pair in apart),
        }
    )


def _sets(profile: SafeProfile) -> list[int]:
    """The table of sets in the source of the guard."""
    source = export(profile, "c")["haptune_guard.c"]
    table = source.partition("moments[MOMENTS] = {")[2].partition("}")[0]
    return [int(each, 16) for each in re.findall(r"0x([0-9a-f]+)", table)]


@settings(deadline=None, max_examples=50)
@given(_GROUPS, st.frozensets(st.sampled_from(NAMES)), _PAIRS)
def test_the_sets_of_the_guard_are_the_certified_moments(
    groups: list[list[str]], walls: frozenset[str], apart: list[list[str]]
) -> None:
    profile = _profile(groups, walls, apart)
    sets = _sets(profile)
    assert sets == sorted(set(sets))
    played = {frozenset(n for k, n in enumerate(NAMES) if each >> k & 1) for each in sets}
    assert played == {frozenset(moment) for moment in profile.moments()}
    law = InPython(profile).law
    for mask in range(1, 1 << len(NAMES)):
        chosen = frozenset(n for k, n in enumerate(NAMES) if mask >> k & 1)
        assert law.certified(chosen) == (chosen in played)
        parts = chosen & walls, chosen - walls
        wanted = all(len(p) < 2 or any(p <= set(g) for g in groups) for p in parts)
        wanted &= not any(set(pair) <= chosen for pair in apart)
        assert wanted == (chosen in played)


def test_a_name_that_is_repeated_is_never_another_set() -> None:
    """Three times the bit of e1, added up, would be the bits of e1 and e2."""
    group = ["e1", "e1", "e1"]
    assert sorted(_sets(_profile([group]))) == [1 << place for place in range(len(NAMES))]
    content = to_mapping(tuned())
    for strange in ([["wall", "wall"]], [["wall"]], [[]], [["wall", "wind"]], [["wall"] * 6]):
        with pytest.raises(ValidationError, match="together"):
            SafeProfile.model_validate({**content, "together": strange})
