"""The sets that a C guard plays are the moments that were certified, whatever groups overlap."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from identification import to_mapping
from tests.exported import tuned
from tune import SafeProfile
from tune.exporters import export

NAMES = [f"e{k}" for k in range(12)]
_GROUPS = st.lists(
    st.lists(st.sampled_from(NAMES), min_size=2, max_size=5, unique=True), max_size=6
)


def _profile(groups: list[list[str]]) -> SafeProfile:
    """The tuned profile with other elements and groups."""
    wall = tuned().elements["wall"]
    return tuned().model_copy(
        update={
            "elements": dict.fromkeys(NAMES, wall),
            "together": tuple(tuple(group) for group in groups),
        }
    )


def _sets(profile: SafeProfile) -> list[int]:
    """The table of sets in the source of the guard."""
    source = export(profile, "c")["haptune_guard.c"]
    table = source.partition("moments[MOMENTS] = {")[2].partition("}")[0]
    return [int(each, 16) for each in re.findall(r"0x([0-9a-f]+)", table)]


@settings(deadline=None, max_examples=50)
@given(_GROUPS)
def test_the_sets_of_the_guard_are_the_certified_moments(groups: list[list[str]]) -> None:
    profile = _profile(groups)
    sets = _sets(profile)
    places = {name: place for place, name in enumerate(NAMES)}
    certified = {frozenset(places[name] for name in moment) for moment in profile.moments()}
    played = {frozenset(k for k in places.values() if each >> k & 1) for each in sets}
    assert played == certified
    assert len(sets) == len(certified)
    wanted = {frozenset({place}) for place in places.values()}
    for group in groups:
        for mask in range(1, 1 << len(group)):
            wanted.add(frozenset(places[n] for k, n in enumerate(group) if mask >> k & 1))
    assert certified == wanted


def test_a_name_that_is_repeated_is_never_another_set() -> None:
    """Three times the bit of e1, added up, would be the bits of e1 and e2."""
    group = ["e1", "e1", "e1"]
    assert sorted(_sets(_profile([group]))) == [1 << place for place in range(len(NAMES))]
    content = to_mapping(tuned())
    for strange in ([["wall", "wall"]], [["wall"]], [[]], [["wall", "wind"]], [["wall"] * 6]):
        with pytest.raises(ValidationError, match="together"):
            SafeProfile.model_validate({**content, "together": strange})
