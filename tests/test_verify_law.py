"""The law of a closed-loop log: what runs as stated is recognised, what does not is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.closed_loop_logs import AXIS, BENCHES, KNOB, STYLUS, Bench, said, verdicts
from tests.thinned import thinned
from tune import verify


@pytest.mark.parametrize("name", thinned(BENCHES, 1))
def test_another_cutoff_is_named_with_its_value(name: str) -> None:
    bench, element, gain = BENCHES[name]
    cutoff = 0.7 * bench.filters["velocity_filter_hz"]
    seen = verify(bench.profile, bench.log(element, gain, velocity_filter_hz=cutoff))
    assert verdicts(seen)["law"] == "disagrees"
    assert f"velocity is filtered at {cutoff:g} Hz" in said(seen, "law")


@pytest.mark.parametrize("name", thinned(reversed(BENCHES), 1))
def test_a_missing_filter_is_named(name: str) -> None:
    bench, element, gain = BENCHES[name]
    seen = verify(bench.profile, bench.log(element, gain, velocity_filter_hz=np.inf))
    assert "velocity is not filtered" in said(seen, "law")


@pytest.mark.parametrize(
    ("changed", "words"),
    thinned(
        [
            ({"acceleration_filter_hz": 45.0}, "acceleration is filtered at 45 Hz"),
            (
                {"acceleration_filter_order": 1},
                "acceleration is filtered at 30 Hz and order 1 instead of 2",
            ),
            (
                {"velocity_filter_order": 2},
                "velocity is filtered at 50 Hz and order 2 instead of 1",
            ),
            (
                {"velocity_filter_hz": np.inf, "velocity_window_samples": 15},
                "velocity is taken over a window of 15 sample(s)",
            ),
            ({"velocity_filter_hz": 30.0, "acceleration_filter_hz": 50.0}, "are exchanged"),
            (
                {"velocity_filter_hz": np.inf, "acceleration_filter_hz": np.inf},
                "velocity and acceleration are not filtered",
            ),
            ({"stiffness": 560.0}, "stiffness at 0.56 of the profile's, damping at 0.8"),
            ({"damping": 0.008}, "damping at 0.0008 of the profile's"),
        ],
        3,
    ),
    ids=str,
)
def test_what_the_controller_runs_instead_is_named(changed: dict[str, Any], words: str) -> None:
    seen = verify(AXIS.profile, AXIS.log("cup", 0.8, samples=1200, **changed), element="cup")
    assert verdicts(seen)["law"] == "disagrees"
    assert words in said(seen, "law")


@pytest.mark.parametrize("rows", thinned([1, -1, 2], 2))
def test_a_shifted_force_column_is_named(rows: int) -> None:
    log = STYLUS.log("wall", 0.5, samples=1200)
    seen = verify(STYLUS.profile, replace(log, force=np.roll(log.force, rows)))
    side = "late" if rows > 0 else "early"
    assert f"the force column is {abs(rows)} row(s) {side}" in said(seen, "law")


@pytest.mark.parametrize("name", BENCHES)
def test_a_flipped_sign_is_named_and_no_motion_is_judged(name: str) -> None:
    bench, element, gain = BENCHES[name]
    log = bench.log(element, gain, samples=1200)
    seen = verify(bench.profile, replace(log, position=-log.position))
    assert verdicts(seen)["gain"] == "disagrees"
    assert "sign of force or position is wrong" in said(seen, "gain")
    assert verdicts(seen)["frequency"] == "not assessed"


@pytest.mark.parametrize("known", thinned([True, False], 1))
def test_millimetres_are_named_with_and_without_a_known_encoder(known: bool) -> None:
    log = STYLUS.log("wall", 0.5)
    profile = STYLUS.profile
    if not known:
        device = profile.device.model_copy(update={"encoder_resolution": None})
        profile = profile.model_copy(update={"device": device})
    seen = verify(profile, replace(log, position=1000 * log.position))
    words = said(seen, "encoder") if known else said(seen, "frequency")
    assert ("--position-gain 0.001" if known else "Is the position in mm?") in words
    stated = verify(profile, replace(log, position=1000 * log.position), gain=0.5)
    assert "Is one of them in mm?" in said(stated, "gain")


def test_a_gain_that_is_not_the_stated_one_is_refused() -> None:
    log = KNOB.log("detent", 0.5)
    assert verdicts(verify(KNOB.profile, log, gain=0.5))["gain"] == "agrees"
    assert verdicts(verify(KNOB.profile, log, gain=0.4))["gain"] == "disagrees"
    twice = verify(KNOB.profile, KNOB.log("detent", 1.2))
    assert verdicts(twice)["gain"] == "disagrees"


def test_saturated_rows_are_set_apart() -> None:
    low = {"force_limit": 1.0}
    bench = Bench(
        **{**STYLUS.truth, **low},
        start=0.03,
        elements=STYLUS.elements,
        velocity_filter_hz=100.0,
    )
    seen = verify(bench.profile, bench.log("wall", 0.5))
    assert np.count_nonzero(~seen.law.used) > 20
    assert not seen.disagreements
    assert seen.assessed
    unknown = bench.profile.device.model_copy(update={"force_limit": None})
    again = verify(bench.profile.model_copy(update={"device": unknown}), bench.log("wall", 0.5))
    assert np.count_nonzero(~again.law.used) > 20
    assert verdicts(again)["law"] == "agrees"


@pytest.mark.parametrize(
    ("loop", "run"),
    thinned(
        [
            ({"velocity_filter_order": 2}, {"velocity_filter_order": 2}),
            (
                {"velocity_filter_order": 2, "filter_damping_ratio": 0.7071},
                {"velocity_filter_order": 2, "filter_damping_ratio": 0.7071},
            ),
            ({"acceleration_filter_order": 1}, {"acceleration_filter_order": 1}),
            (
                {"velocity_filter_hz": None, "velocity_window_samples": 15},
                {"velocity_filter_hz": np.inf, "velocity_window_samples": 15},
            ),
        ],
        1,
    ),
    ids=str,
)
def test_every_filter_of_a_profile_is_recognised(loop: dict[str, Any], run: dict[str, Any]) -> None:
    profile = AXIS.profile.model_copy(update={"loop": AXIS.profile.loop.model_copy(update=loop)})
    seen = verify(profile, AXIS.log("cup", 0.8, samples=1200, **run))
    assert verdicts(seen)["law"] == "agrees"
    assert seen.gain == pytest.approx(0.8, rel=1e-6)
    unlike = verify(AXIS.profile, AXIS.log("cup", 0.8, samples=1200, **run))
    assert verdicts(unlike)["law"] == "disagrees"


def test_a_log_may_begin_while_the_controller_already_runs() -> None:
    """What the filters remember from before is not known and must not matter."""
    log = AXIS.log("cup", 0.8)
    seen = verify(AXIS.profile, log.part(slice(90, None)))
    assert verdicts(seen)["law"] == "agrees"
    assert seen.gain == pytest.approx(0.8, rel=1e-6)
