"""Logs of an outside simulator: what identify makes of devices inside and outside its model."""

import pytest

from tests.outside_logs import KINDS, judged, line_of, outside_log

#: Kinds whose logs are what they should be: none that is usable may be refused.
CLEAN = {"clean-open", "clean-servo", "jitter", "dropped", "delayed"}


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("clean-open", 0), ("clean-servo", 1), ("dropped", 1), ("pendulum-bare", 3), ("spring", 1)],
)
def test_a_usable_log_is_accepted_and_right(kind: str, seed: int) -> None:
    log = outside_log(kind, seed)
    found = judged(log)
    assert log.usable
    assert not found.refusals
    assert not found.wrong
    assert not found.low_above


def test_friction_beyond_the_model_is_named_and_covered() -> None:
    found = judged(outside_log("maxwell", 1))
    assert "unmodelled-force" in found.codes
    assert not found.wrong
    assert not found.low_above


@pytest.mark.parametrize(("kind", "seed"), [("spring-to-tremor", 3), ("mode", 6)])
def test_what_the_logged_force_explains_is_no_hand(kind: str, seed: int) -> None:
    assert "hand-on-device" not in judged(outside_log(kind, seed)).codes


def test_a_hand_is_refused_or_named() -> None:
    found = judged(outside_log("hand", 0))
    assert found.refusals or "hand-on-device" in found.codes


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_campaign(kind: str) -> None:
    rows = [judged(outside_log(kind, seed)) for seed in range(20)]
    print(line_of(rows))
    if kind == "hand":
        assert sum(bool(each.refusals) or "hand-on-device" in each.codes for each in rows) >= 18
        return
    assert sum(bool(each.wrong) and not each.flagged for each in rows) <= 1
    if kind in CLEAN:
        assert not any(each.refusals for each in rows if each.usable)
