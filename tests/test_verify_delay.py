"""Agreement is said only where every loop that the log allows keeps the profile's margin."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import arb

from datasets_synthetic import Faults, log_text
from identification import Trajectory, load_device
from tests.closed_loop_logs import Bench, T
from tests.commands import haptune
from tests.reference import crossings, reference_loop, stable_by_jury
from tests.thinned import thinned
from tune import Scene, Verification, optimise, verify
from tune.verification import margins_of_others

ELEMENTS = {"rubber": (1400.0, 0.0, 0.0), "wall": (1155.0, 82.0, 0.0), "cup": (0.0, 0.0, 1.44)}
BENCH = Bench(
    mass=3.0,
    damping=10.0,
    coulomb_friction=0.8,
    encoder_resolution=6e-6,
    force_limit=28.0,
    start=0.02,
    elements=ELEMENTS,
    velocity_filter_hz=134.1,
    acceleration_filter_hz=33.0,
)
PROFILE = BENCH.profile.model_copy(update={"device": load_device("homerehab")})


def _log(element: str, gain: float, delay: int, seed: int = 0, **other: float) -> Trajectory:
    """A free motion: released from 20 mm, or pushed where no spring holds; truth may differ."""
    pushed = not ELEMENTS[element][0]
    return BENCH.log(
        element,
        gain,
        samples=2000,
        other={"delay": delay * T, **other},
        position=0.0 if pushed else None,
        velocity=0.3 if pushed else 0.0,
        run={"seed": seed, "faults": Faults(position_noise=3e-7)} if seed else None,
    )


def _code(seen: Verification) -> int:
    return 6 if seen.disagreements else 0 if seen.assessed else 4


def _margin_is_kept(element: str, delay: int, mass: float = 3.0, damping: float = 10.0) -> bool:
    """Whether the true loop keeps the profile's margin, by ball arithmetic on its z-polynomial."""
    K, B, M = ELEMENTS[element]
    poles = [np.exp(-2 * np.pi * f * T) for f in (134.1, 33.0)]

    def safe(further: int, gain: float) -> bool:
        loop = reference_loop(
            damping * T / mass,
            K * T * T / mass,
            B * T / mass,
            M / mass,
            delay=delay + further,
            velocity_pole=float(poles[0]),
            acceleration_pole=float(poles[1]),
        )
        first = min((float(each.mid()) for each in crossings(loop)), default=np.inf)
        return first > gain and stable_by_jury(loop.at(arb(min(first, 1.0) / 2)))

    margin = PROFILE.margin
    return safe(0, margin.gain) and safe(int(margin.extra_delay_samples), 1.0)


@pytest.mark.parametrize(
    ("element", "gain", "delay", "code"),
    thinned(
        [
            ("rubber", 0.3, 1, 4),
            ("rubber", 0.9, 1, 0),
            ("rubber", 0.9, 6, 6),
            ("wall", 0.3, 1, 4),
            ("cup", 0.3, 1, 0),
            ("rubber", 0.1, 2, 4),
            ("rubber", 0.1, 7, 4),
            ("rubber", 0.3, 7, 4),
            ("rubber", 0.9, 3, 4),
        ],
        5,
    ),
)
def test_agreement_is_said_only_where_the_log_tells(
    element: str, gain: float, delay: int, code: int
) -> None:
    seen = verify(PROFILE, _log(element, gain, delay))
    assert _code(seen) == code
    if code == 0:
        assert _margin_is_kept(element, delay)


def test_the_interval_of_the_delay_holds_the_true_one_and_names_what_is_lost() -> None:
    seen = verify(PROFILE, _log("rubber", 0.9, 6))
    assert seen.delay.allowed is not None
    delays = seen.delay.allowed.delays
    assert delays is not None
    assert 3 <= delays[0] <= 6 <= delays[1] <= 9
    told = next(each for each in seen.disagreements if each.check == "delay")
    assert told.predicted == "1 sample(s)"
    assert told.seen == f"{delays[0]:.3g} to {delays[1]:.3g} samples"


def test_a_log_says_which_other_elements_it_does_not_vouch_for() -> None:
    seen = verify(PROFILE, _log("cup", 0.3, 1))
    kept = {each.elements: each.lost_at for each in margins_of_others(PROFILE, seen.delay)}
    assert kept[("wall",)] is None
    lost = kept[("rubber",)]
    assert lost is not None
    assert not _margin_is_kept("rubber", int(np.ceil(lost)) + 1)


def test_the_cutoffs_that_a_rounded_force_allows_are_stated() -> None:
    log = _log("wall", 0.3, 1)
    exact = verify(PROFILE, log)
    rounded = verify(PROFILE, replace(log, force=np.round(log.force, 1)))
    widths = [seen.cutoffs[0].high / seen.cutoffs[0].low for seen in (exact, rounded)]
    assert widths[0] < 1.001 < widths[1]
    for seen in (exact, rounded):
        assert seen.cutoffs[0].low <= 134.1 <= seen.cutoffs[0].high


def test_the_command_says_what_to_play_and_lays_out_what_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = Scene.model_validate({"elements": {"rubber": {"stiffness": 1400.0}}})
    profile = optimise(load_device("homerehab"), scene)
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    Path("unclear.csv").write_text(log_text(_log("rubber", 0.3, 1)), encoding="utf-8")
    Path("late.csv").write_text(log_text(_log("rubber", 0.9, 6)), encoding="utf-8")
    plan = haptune("verify", "profile.yaml", "--json")
    assert plan.code == 0
    (advice,) = json.loads(plan.out)["details"]["play"]
    assert advice["play"]["moment"] == ["rubber"]
    assert haptune("verify", "profile.yaml", "--picture", "seen.png").code == 2
    unclear = haptune("verify", "profile.yaml", "unclear.csv")
    assert unclear.code == 4
    assert f"play rubber at gain {advice['play']['gain']:g}" in unclear.err
    late = haptune("verify", "profile.yaml", "late.csv", "--quiet")
    assert late.code == 6
    lines = late.err.splitlines()
    assert [line.split()[0] for line in lines if "disagrees:" in line] == ["decay", "delay"]
    assert max(map(len, lines)) < 200
