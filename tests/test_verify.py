"""Verification of closed-loop logs: what agrees passes, and each thing that is wrong is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Clock, Faults, Hand, log_text
from identification import LogRefusedError, Trajectory, UsageError
from tests.closed_loop_logs import AXIS, BENCHES, STYLUS, Bench, T, said, verdicts
from tests.commands import haptune
from tests.thinned import thinned
from tune import Scene, optimise, verify
from tune.verification import verification_picture


@pytest.mark.parametrize("name", BENCHES)
def test_an_agreeing_log_passes_and_its_element_and_gain_are_found(name: str) -> None:
    bench, element, gain = BENCHES[name]
    seen = verify(bench.profile, bench.log(element, gain))
    assert seen.elements == (element,)
    assert seen.gain == pytest.approx(gain, rel=1e-6)
    assert not seen.disagreements
    assert seen.assessed
    found = verdicts(seen)
    assert [found[check] for check in ("law", "gain", "frequency", "decay")] == ["agrees"] * 4


def test_the_measured_mode_is_that_of_the_continuous_device() -> None:
    """A spring without delay to speak of: ω = √(K/m - (b/2m)²), σ = b/2m, from the textbook."""
    bench = Bench(
        mass=2.0,
        damping=6.0,
        coulomb_friction=0.4,
        encoder_resolution=1e-6,
        force_limit=100.0,
        start=0.03,
        elements={"spring": (400.0, 0.0, 0.0)},
    )
    seen = verify(bench.profile, bench.log("spring", 1.0, other={"delay": 0.0}))
    assert seen.motion is not None
    measured = seen.motion.measured
    assert measured is not None
    # The hold delays by half a sample, which takes K·T/4m = 0.05 1/s from the decay.
    assert measured.decay == pytest.approx(6.0 / 4 - 400.0 * T / 4 / 2, rel=0.01)
    assert measured.frequency == pytest.approx(np.sqrt(200.0 - 1.5**2) / 2 / np.pi, rel=1e-3)
    assert measured.friction == pytest.approx(0.4 / 400.0, rel=0.05)
    assert abs(measured.decay - 1.45) < measured.decay_half + 0.01


@pytest.mark.parametrize("name", thinned(BENCHES, 1))
def test_a_mass_that_differs_by_30_percent_shows_in_the_frequency(name: str) -> None:
    bench, element, gain = BENCHES[name]
    other = {"mass": 1.3 * bench.truth["mass"]}
    seen = verify(bench.profile, bench.log(element, gain, other=other))
    assert verdicts(seen)["law"] == "agrees"
    assert verdicts(seen)["frequency"] == "disagrees"
    if not bench.elements[element][2]:  # no virtual mass that moves with it
        assert "moving mass were 1.3 times" in said(seen, "frequency")


def test_one_more_sample_of_delay_shows_in_the_decay() -> None:
    seen = verify(STYLUS.profile, STYLUS.log("wall", 0.5, other={"delay": 2 * T}))
    assert verdicts(seen)["law"] == "agrees"
    assert verdicts(seen)["frequency"] == "agrees"
    assert "the delay were 1 sample(s) longer" in said(seen, "decay")


def test_an_actuator_that_gives_too_much_shows_in_the_frequency() -> None:
    """Force is logged as commanded; all of the device but the actuator is as identified."""
    part = 1 / 1.4
    other = {n: part * STYLUS.truth[n] for n in ("mass", "damping", "coulomb_friction")}
    seen = verify(STYLUS.profile, STYLUS.log("wall", 0.5, other=other))
    assert "the actuator gave 1.4" in said(seen, "frequency")


def test_a_hand_on_the_handle_is_noticed() -> None:
    held = STYLUS.log("wall", 0.5, run={"hand": Hand(mass=0.05, damping=0.5, stiffness=20.0)})
    seen = verify(STYLUS.profile, held)
    assert verdicts(seen)["law"] == "agrees"
    assert verdicts(seen)["decay"] == "disagrees"


def test_ripple_is_that_of_the_encoder_and_noise_shows() -> None:
    quiet = verify(STYLUS.profile, STYLUS.log("wall", 0.5))
    assert verdicts(quiet)["ripple"] == "agrees"
    noisy = STYLUS.log("wall", 0.5, run={"faults": Faults(position_noise=4e-5), "seed": 3})
    assert [each.check for each in verify(STYLUS.profile, noisy).disagreements] == ["ripple"]


def test_outside_of_a_one_sided_wall_nothing_is_claimed() -> None:
    left = STYLUS.log("wall", 0.5, side=-1)  # the handle flies out of the wall
    log = STYLUS.log("wall", 0.5)
    again = replace(log, force=np.where(log.position > 0, log.force, 0.0))  # and comes back
    for one_sided in (left, again):
        seen = verify(STYLUS.profile, one_sided)
        assert verdicts(seen)["law"] == "agrees"
        assert seen.gain == pytest.approx(0.5, rel=1e-3)
        assert verdicts(seen)["frequency"] == "not assessed"
        with pytest.raises(LogRefusedError, match="outside of a one-sided wall"):
            seen.refuse_unassessed("Play more.")


def test_a_handle_that_is_moved_away_and_held_is_free_from_its_release_on() -> None:
    log = STYLUS.log("wall", 0.5, samples=2000)
    away = 0.03 * (1 - np.cos(np.pi * np.arange(400) / 400)) / 2
    held = 0.03 + 1e-4 * np.sin(np.arange(600) / 9)  # a hand trembles
    position = np.concatenate([away, held, log.position])
    whole = Trajectory(
        time=T * np.arange(position.size, dtype=np.float64),
        position=position,
        force=_force(position, log),
    )
    seen = verify(STYLUS.profile, whole)
    assert seen.motion is not None
    assert seen.motion.release is not None
    assert 1000 <= seen.motion.release.first < 1030
    assert not seen.disagreements
    assert verdicts(seen)["decay"] == "agrees"


def _force(position: Any, log: Trajectory) -> Any:
    """The law of the stylus's wall at half gain on these positions, by its difference equation."""
    pole = np.exp(-2 * np.pi * 100.0 * T)
    velocity, force = 0.0, np.empty_like(position)
    for row, place in enumerate(position):
        change = (place - position[row - 1]) / T if row else 0.0
        velocity = pole * velocity + (1 - pole) * change
        force[row] = -0.5 * (100.0 * place + 0.4 * velocity)
    # Where the device really swung it is what its controller commanded.
    np.testing.assert_allclose(force[-1000:], log.force[-1000:], atol=1e-9)
    return force


def test_rows_of_another_clock_are_refused() -> None:
    log = STYLUS.log("wall", 0.5, samples=1200)
    for changed, code in (
        (log.part(slice(None, None, 2)), "dropped-samples"),
        (replace(log, time=0.7 * log.time), "jitter"),
        (_without(log, 300), "dropped-samples"),
    ):
        with pytest.raises(LogRefusedError) as refused:
            verify(STYLUS.profile, changed)
        assert [finding.code for finding in refused.value.findings] == [code]
    jittered = STYLUS.log("wall", 0.5, samples=1200, run={"clock": Clock(jitter=7e-5)})
    with pytest.raises(LogRefusedError, match="vary by"):
        verify(STYLUS.profile, jittered)


def _without(log: Trajectory, row: int) -> Trajectory:
    columns = {name: np.delete(column, row) for name, column in log.columns()}
    return replace(log, **columns)


def test_requests_that_cannot_be_met_are_refused() -> None:
    log = STYLUS.log("wall", 0.5, samples=600)
    for request, words in (
        ({"element": "door"}, "'door' is not in the profile. Choose from wall, gel"),
        ({"gain": 0.0}, "0 is no gain"),
        ({"release": 9.0}, "outside of the log"),
    ):
        with pytest.raises(UsageError, match=words):
            verify(STYLUS.profile, log, **request)  # pyright: ignore[reportArgumentType]
    with pytest.raises(UsageError, match="profile of x"):
        verify(STYLUS.profile, replace(log, axis="y"))


def test_the_command_compares_draws_and_ends_with_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bench = Bench(
        **AXIS.truth, start=0.02, elements={"wall": (1000.0, 10.0, 0.0)}, velocity_filter_hz=50.0
    )
    scene: dict[str, Any] = {
        "elements": {"wall": {"stiffness": 1000.0, "damping": 10.0}},
        "loop": {"velocity_filter_hz": 50.0},
    }
    profile = optimise(bench.profile.device, Scene.model_validate(scene))
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    Path("good.csv").write_text(log_text(bench.log("wall", 0.8)), encoding="utf-8")
    heavy = bench.log("wall", 0.8, other={"mass": 3.9})
    Path("heavy.csv").write_text(log_text(heavy), encoding="utf-8")
    stuck = bench.log("wall", 0.8, position=2.5e-3)  # friction stops it within half a swing
    Path("stuck.csv").write_text(log_text(stuck), encoding="utf-8")

    good = haptune("verify", "profile.yaml", "good.csv", "--picture", "seen.png")
    assert good.code == 0, good.err
    assert Path("seen.png").read_bytes().startswith(b"\x89PNG")
    assert "frequency" in good.out
    assert "behaves as profile.yaml predicts" in good.out
    bad = haptune("verify", "profile.yaml", "heavy.csv", "--json")
    assert bad.code == 6
    told = json.loads(bad.out)
    checks = {each["check"]: each for each in told["details"]["checks"]}
    assert checks["frequency"]["verdict"] == "disagrees"
    assert checks["law"]["verdict"] == "agrees"
    assert "frequency disagrees" in told["message"]
    assert haptune("verify", "profile.yaml", "stuck.csv", "--quiet").code == 4
    assert haptune("verify", "profile.yaml", "absent.csv").code == 3
    assert haptune("verify", "profile.yaml", "good.csv", "--element", "door").code == 2
    assert haptune("verify", "profile.yaml", "good.csv", "--picture", "good.csv").code == 2
    assert haptune("verify", "profile.yaml", "good.csv", "--force", "torque").code == 3


def test_the_picture_shows_the_envelope_only_where_one_is_predicted() -> None:
    for bench, element, gain, envelope in ((STYLUS, "wall", 0.5, 2), (STYLUS, "gel", 0.5, 0)):
        seen = verify(bench.profile, bench.log(element, gain))
        axes = verification_picture(bench.profile, seen).get_axes()
        assert len(axes[0].collections) == envelope
