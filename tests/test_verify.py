"""Verification of closed-loop logs: what agrees passes, and what is wrong is named."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb

from datasets_synthetic import Controller, Faults, Hand, Rig, log_text, simulate
from identification import Device, LogRefusedError, Trajectory, UsageError, load_device, quantity
from tests.commands import haptune
from tests.reference import crossings, reference_loop, stable_by_jury
from tune import Scene, Verification, optimise, verify
from tune.documents.profile import Design

T = 0.001
Sizes = tuple[float, float, float]


class Bench:
    """A simulated device, the profile written for it, and logs of an element on it."""

    def __init__(
        self,
        *,
        start: float,
        elements: dict[str, Sizes],
        velocity_filter_hz: float | None = None,
        acceleration_filter_hz: float | None = None,
        loop: dict[str, Any] | None = None,
        **truth: Any,
    ) -> None:
        self.truth: dict[str, Any] = {"sample_time": T, "delay": T, **truth}
        self.start = start
        self.elements = elements
        filters = {
            "velocity_filter_hz": velocity_filter_hz,
            "acceleration_filter_hz": acceleration_filter_hz,
        }
        self.filters: dict[str, Any] = {name: hz or np.inf for name, hz in filters.items()}
        self.profile = Design.model_validate(
            {
                "device": self._device(),
                "scene": "bench",
                "loop": {"sample_time": T, "extra_delay_samples": 1.0, **filters, **(loop or {})},
                "margin": {"name": "balanced", "gain": 2.0, "extra_delay_samples": 1},
                "elements": {name: _element(sizes) for name, sizes in elements.items()},
                "ripple_limit": 0.1,
            }
        )

    def _device(self) -> Device:
        """As it would be identified: mass to 1 %, damping to 5 %, friction to 10 %."""

        def within(name: str, part: float) -> Any:
            value = self.truth[name]
            return quantity(value, value * (1 - part), value * (1 + part))

        return Device(
            motion=self.truth.get("motion", "linear"),
            mass=within("mass", 0.01),
            damping=within("damping", 0.05),
            coulomb_friction=within("coulomb_friction", 0.1),
            position_stiffness=within("stiffness", 0.02) if "stiffness" in self.truth else None,
            sample_time=quantity(T),
            delay=quantity(T),
            encoder_resolution=self.truth["encoder_resolution"],
            force_limit={
                "continuous": self.truth["force_limit"] / 2,
                "peak": self.truth["force_limit"],
            },  # pyright: ignore[reportArgumentType]
        )

    def log(
        self,
        element: str,
        gain: float,
        *,
        samples: int = 1500,
        other: dict[str, float] | None = None,
        position: float | None = None,
        velocity: float = 0.0,
        run: dict[str, Any] | None = None,
        **controller: Any,
    ) -> Trajectory:
        """An element played at a gain; ``other`` truth of the device than the profile's."""
        K, B, M = (gain * size for size in self.elements[element])
        conditions: dict[str, Any] = dict(run or {})
        rules = {"stiffness": K, "damping": B, "mass": M, **self.filters, **controller}
        return simulate(
            Rig(**{**self.truth, **(other or {})}),
            np.zeros(samples),
            controller=Controller(**rules),
            position=self.start if position is None else position,
            velocity=velocity,
            **conditions,
        ).trajectory()


def _element(sizes: Sizes) -> dict[str, Any]:
    return {
        **dict(zip(("stiffness", "damping", "mass"), sizes, strict=True)),
        "perceived_steps": {},
        "margins": {"gain": 3.0, "extra_delay_samples": 1.0, "passive": "not-applicable"},
        "limited_by": {},
        "motion": {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0},
    }


AXIS = Bench(
    mass=3.0,
    damping=10.0,
    coulomb_friction=0.8,
    encoder_resolution=6e-6,
    force_limit=28.0,
    start=0.02,
    elements={"wall": (1000.0, 10.0, 0.0), "cup": (1000.0, 10.0, 1.0), "water": (0.0, 20.0, 0.0)},
    velocity_filter_hz=50.0,
    acceleration_filter_hz=30.0,
)
STYLUS = Bench(
    mass=0.05,
    damping=0.1,
    coulomb_friction=0.02,
    encoder_resolution=2e-5,
    force_limit=3.0,
    start=0.03,
    elements={"wall": (100.0, 0.4, 0.0), "gel": (50.0, 8.0, 0.0)},
    velocity_filter_hz=100.0,
)
KNOB = Bench(
    motion="rotary",
    mass=1e-4,
    damping=5e-4,
    coulomb_friction=0.002,
    encoder_resolution=0.00076699,
    force_limit=0.15,
    start=0.6,
    elements={"detent": (0.1, 5e-4, 0.0)},
    velocity_filter_hz=100.0,
)
BENCHES = {
    "axis": (AXIS, "cup", 0.8),
    "stylus": (STYLUS, "wall", 0.5),
    "knob": (KNOB, "detent", 0.5),
}


def verdicts(seen: Verification) -> dict[str, str]:
    return {each.check: each.verdict for each in seen.outcomes}


def said(seen: Verification, check: str) -> str:
    return str(next(each for each in seen.outcomes if each.check == check))


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


@pytest.mark.parametrize("name", BENCHES)
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
    assert "the delay were 1 sample longer" in said(seen, "decay")


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


def test_a_handle_that_is_moved_away_and_held_is_free_from_its_release_on() -> None:
    log = STYLUS.log("wall", 0.5, samples=2000)
    away = 0.03 * (1 - np.cos(np.pi * np.arange(400) / 400)) / 2
    held = 0.03 + 1e-4 * np.sin(np.arange(600) / 9)  # a hand trembles
    position = np.concatenate([away, held, log.position])
    whole = Trajectory(
        time=T * np.arange(position.size, dtype=np.float64),
        position=position,
        force=_force(position),
    )
    # Where the device really swung it is what its controller commanded.
    np.testing.assert_allclose(whole.force[-1000:], log.force[-1000:], atol=1e-9)
    seen = verify(STYLUS.profile, whole)
    assert seen.motion is not None
    assert seen.motion.release is not None
    assert 1000 <= seen.motion.release.first < 1030
    assert not seen.disagreements
    assert verdicts(seen)["decay"] == "agrees"


def _force(position: Any) -> Any:
    """The law of the stylus's wall at half gain on these positions, by its difference equation."""
    pole = np.exp(-2 * np.pi * 100.0 * T)
    velocity, force = 0.0, np.empty_like(position)
    for row, place in enumerate(position):
        change = (place - position[row - 1]) / T if row else 0.0
        velocity = pole * velocity + (1 - pole) * change
        force[row] = -0.5 * (100.0 * place + 0.4 * velocity)
    return force


def _beats() -> Trajectory:
    """Two modes at once: no device of one mass behind a spring moves so."""
    time = T * np.arange(1500, dtype=np.float64)
    modes = 0.01 * np.exp(-2 * time) * np.cos(10 * np.pi * time)
    modes += 0.012 * np.exp(-time) * np.cos(13 * np.pi * time)
    position = 2e-5 * np.round(modes / 2e-5)
    return Trajectory(time=time, position=position, force=_force(position))


def _stuck_at_its_limit() -> Trajectory:
    log = STYLUS.log("wall", 0.5)
    return replace(log, force=np.where(np.arange(len(log)) < 1480, 3.0, log.force))


HARD = Bench(
    **STYLUS.truth, start=2e-4, elements={"wall": (2000.0, 3.0, 0.0)}, velocity_filter_hz=100.0
)


@pytest.mark.parametrize(
    ("bench", "log", "check", "verdict", "words"),
    [
        (
            STYLUS,
            lambda: STYLUS.log("wall", 0.5, position=5e-3, other={"delay": 20 * T}),
            "decay",
            "disagrees",
            "the swings grow until the log ends",
        ),
        (
            STYLUS,
            lambda: STYLUS.log("wall", 0.5, other={"coulomb_friction": 0.5}),
            "decay",
            "not assessed",
            "where the device as identified swings on. If no hand stopped it, friction or damping",
        ),
        (STYLUS, _beats, "frequency", "not assessed", "leaves 18"),
        (STYLUS, _stuck_at_its_limit, "law", "not assessed", "20 rows are neither saturated"),
        (
            STYLUS,
            lambda: STYLUS.log("wall", 0.5, other={"force_limit": 0.8}),
            "law",
            "disagrees",
            "the force stays at 0.8 N where the law asks for up to 1.5 N; nothing in the profile",
        ),
        (
            STYLUS,
            lambda: STYLUS.log("gel", 0.5),
            "frequency",
            "not assessed",
            "does not oscillate, which is predicted",
        ),
        (
            AXIS,
            lambda: AXIS.log("water", 0.5, samples=300, position=0.0, velocity=0.012),
            "decay",
            "not assessed",
            "moves freely for 34 rows only",
        ),
        (HARD, lambda: HARD.log("wall", 0.5), "decay", "not assessed", "may not come to rest"),
    ],
)
def test_what_a_motion_cannot_tell_is_said(
    bench: Bench, log: Callable[[], Trajectory], check: str, verdict: str, words: str
) -> None:
    seen = verify(bench.profile, log())
    assert verdicts(seen)[check] == verdict
    assert words in said(seen, check)
    assert verdicts(seen)["delay"] != "agrees"


def test_rows_that_are_not_those_of_the_loop_are_refused() -> None:
    log = STYLUS.log("wall", 0.5)
    kept = np.delete(np.arange(len(log)), slice(700, 705))
    torn = replace(log, time=log.time[kept], force=log.force[kept], position=log.position[kept])
    uneven = 0.1 * T * np.resize([0.0, 1.0, 1.0, 0.0], len(log))
    for wrong, words in (
        (replace(log, time=1.2 * log.time), "steps by 1.2 ms; needed: the sample time .* 1 ms"),
        (torn, r"1 gap\(s\), the longest 6 ms"),
        (replace(log, time=log.time + uneven), "vary by 7.07% rms"),
    ):
        with pytest.raises(LogRefusedError, match=words):
            verify(STYLUS.profile, wrong)


def test_the_command_compares_draws_and_ends_with_its_code(here: Path) -> None:
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


ELEMENTS = {"rubber": (1400.0, 0.0, 0.0), "wall": (1155.0, 82.0, 0.0), "cup": (0.0, 0.0, 1.44)}
BENCH = Bench(
    **AXIS.truth,
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
    assert told.predicted == "1 sample"
    assert told.seen == f"{delays[0]:.3g} to {delays[1]:.3g} samples"


def test_the_cutoffs_that_a_rounded_force_allows_are_stated() -> None:
    log = _log("wall", 0.3, 1)
    exact = verify(PROFILE, log)
    rounded = verify(PROFILE, replace(log, force=np.round(log.force, 1)))
    widths = [seen.cutoffs[0].high / seen.cutoffs[0].low for seen in (exact, rounded)]
    assert widths[0] < 1.001 < widths[1]
    for seen in (exact, rounded):
        assert seen.cutoffs[0].low <= 134.1 <= seen.cutoffs[0].high


def test_the_command_says_what_to_play_and_lays_out_what_is_wrong(here: Path) -> None:
    scene = Scene.model_validate({"elements": {"rubber": {"stiffness": 1400.0}}})
    profile = optimise(load_device("homerehab"), scene)
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    Path("unclear.csv").write_text(log_text(_log("rubber", 0.3, 1)), encoding="utf-8")
    Path("late.csv").write_text(log_text(_log("rubber", 0.9, 6)), encoding="utf-8")
    plan = haptune("verify", "profile.yaml", "--json")
    assert plan.code == 0
    (advice,) = json.loads(plan.out)["details"]["play"]
    assert advice["play"]["combination"] == ["rubber"]
    assert haptune("verify", "profile.yaml", "--picture", "seen.png").code == 2
    unclear = haptune("verify", "profile.yaml", "unclear.csv")
    assert unclear.code == 4
    assert f"play rubber at gain {advice['play']['gain']:g}" in unclear.err
    late = haptune("verify", "profile.yaml", "late.csv", "--quiet")
    assert late.code == 6
    lines = late.err.splitlines()
    assert [line.split()[0] for line in lines if "disagrees:" in line] == ["delay", "decay"]
    assert max(map(len, lines)) < 200


@pytest.mark.parametrize("name", BENCHES)
def test_another_cutoff_is_named_with_its_value_and_a_missing_filter(name: str) -> None:
    bench, element, gain = BENCHES[name]
    cutoff = 0.7 * bench.filters["velocity_filter_hz"]
    for hertz, words in ((cutoff, f"filtered at {cutoff:g} Hz"), (np.inf, "not filtered")):
        seen = verify(bench.profile, bench.log(element, gain, velocity_filter_hz=hertz))
        assert verdicts(seen)["law"] == "disagrees"
        assert f"velocity is {words}" in said(seen, "law")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"acceleration_filter_hz": 45.0}, "acceleration is filtered at 45 Hz"),
        (
            {"acceleration_filter_order": 1},
            "acceleration is filtered at 30 Hz and order 1 instead of 2",
        ),
        ({"velocity_filter_order": 2}, "velocity is filtered at 50 Hz and order 2 instead of 1"),
        (
            {"velocity_filter_hz": np.inf, "acceleration_filter_hz": np.inf},
            "velocity and acceleration are not filtered",
        ),
        ({"stiffness": 560.0}, "stiffness at 0.56 of the profile's, damping at 0.8"),
        ({"damping": 0.008}, "damping at 0.0008 of the profile's"),
    ],
    ids=str,
)
def test_what_the_controller_runs_instead_is_named(changed: dict[str, Any], words: str) -> None:
    seen = verify(AXIS.profile, AXIS.log("cup", 0.8, samples=1200, **changed), element="cup")
    assert verdicts(seen)["law"] == "disagrees"
    assert words in said(seen, "law")


def test_a_sign_that_is_wrong_is_named_of_its_element() -> None:
    seen = verify(STYLUS.profile, STYLUS.log("gel", 0.1, samples=300, damping=-0.8))
    assert seen.elements == ("gel",)
    assert "damping at -0.1 of the profile's" in said(seen, "law")
    assert said(seen, "law").endswith("Is the sign of damping wrong?")


@pytest.mark.parametrize("rows", [1, -1, 2])
def test_a_shifted_force_column_is_named(rows: int) -> None:
    log = STYLUS.log("wall", 0.5, samples=1200)
    seen = verify(STYLUS.profile, replace(log, force=np.roll(log.force, rows)))
    side = "late" if rows > 0 else "early"
    assert f"the force column is {abs(rows)} row(s) {side}" in said(seen, "law")


def test_a_flipped_sign_is_named_and_no_motion_is_judged() -> None:
    log = AXIS.log("cup", 0.8, samples=1200)
    seen = verify(AXIS.profile, replace(log, position=-log.position))
    assert verdicts(seen)["gain"] == "disagrees"
    assert "sign of force or position is wrong" in said(seen, "gain")
    assert verdicts(seen)["frequency"] == "not assessed"


@pytest.mark.parametrize("known", [True, False])
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


@pytest.mark.parametrize(
    "loop",
    [
        {"velocity_filter_order": 2},
        {"velocity_filter_order": 2, "filter_damping_ratio": 0.7071},
        {"acceleration_filter_order": 1},
        {"velocity_filter_hz": None, "velocity_window_samples": 15},
    ],
    ids=str,
)
def test_every_filter_of_a_profile_is_recognised(loop: dict[str, Any]) -> None:
    profile = AXIS.profile.model_copy(update={"loop": AXIS.profile.loop.model_copy(update=loop)})
    run: dict[str, Any] = {name: np.inf if value is None else value for name, value in loop.items()}
    seen = verify(profile, AXIS.log("cup", 0.8, samples=1200, **run))
    assert verdicts(seen)["law"] == "agrees"
    assert seen.gain == pytest.approx(0.8, rel=1e-6)
    unlike = verify(AXIS.profile, AXIS.log("cup", 0.8, samples=1200, **run))
    assert verdicts(unlike)["law"] == "disagrees"


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
