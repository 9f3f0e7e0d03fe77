"""Audit and compare: what is unfit, the nearest safe values; two devices or profiles compared."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb

from identification import (
    Device,
    Hardware,
    InvalidInputError,
    UsageError,
    load_device,
    load_document,
    named_devices,
    parse_document,
    to_mapping,
    to_yaml,
)
from tests.commands import haptune
from tests.reference import reference_loop, stable_by_jury
from tests.true_loops import safe_gain
from tune import (
    Audit,
    Effects,
    Filters,
    Loop,
    SafeProfile,
    Scene,
    audit,
    compare,
    largest,
    optimise,
)
from tune.loop.loop import filters_of


def tuned(elements: dict[str, Any], **more: Any) -> SafeProfile:
    """On HomeRehab."""
    return optimise(load_device("homerehab"), Scene.model_validate({"elements": elements, **more}))


def stored(name: str, thing: Device | SafeProfile) -> None:
    """In the current folder."""
    Path(name).write_text(to_yaml(to_mapping(thing)), encoding="utf-8")


#: Of profiles with walls.
FIFTY = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": "none"}
PAPER = ("--stiffness", "1000", "--damping", "10", "--mass", "1")
FILTERED = ("--velocity-filter", "30", "--acceleration-filter", "30")


def test_a_spring_is_audited_on_a_device_whose_force_limit_nobody_states(here: Path) -> None:
    content = to_mapping(load_device("homerehab"))
    del content["force_limit"]
    (here / "device.yaml").write_text(to_yaml(content), encoding="utf-8")
    ended = haptune("audit", "device.yaml", *PAPER, *FILTERED)
    assert (ended.code, ended.err) == (0, "")


def test_the_papers_own_setting_is_safe_with_filters() -> None:
    ended = haptune("audit", "homerehab", *PAPER, *FILTERED)
    assert ended.code == 0, ended.err
    assert "delay 1 sample" in ended.out
    assert "gain margin" in ended.out
    assert "extra delay, samples" in ended.out
    assert "N rms" in ended.out
    assert "safe with margin balanced" in ended.out


def test_a_profile_with_tracking_filters_is_judged_as_it_was_certified() -> None:
    """Mass and damping of a tuned element, by hand into the command: the same gain margin."""
    loop = {"velocity_filter": "tracking", "acceleration_filter": "tracking"}
    profile = tuned({"it": {"mass": "max", "damping": 30.0}}, loop=loop)
    it, used = profile.elements["it"], profile.loop
    ended = haptune(
        *("audit", "homerehab", "--mass", str(it.mass), "--damping", str(it.damping)),
        *("--velocity-filter", f"{used.velocity_filter_hz},tracking"),
        *("--acceleration-filter", f"{used.acceleration_filter_hz},tracking,4", "--json"),
    )
    assert ended.code == 0, ended.err
    details = ended.result["details"]
    assert details["loop"] == used.model_dump(mode="json")
    assert details["gain_margin"] == pytest.approx(it.margins.gain, rel=2e-3)


def test_a_wall_of_a_profile_is_judged_as_a_wall_that_is_cut(tmp_path: Path) -> None:
    """As another element it would hold 25 N where the actuator gives 14; it is cut there."""
    wall = {"stiffness": 3000.0, "damping": 30.0, "one_sided": True}
    path = tmp_path / "profile.yaml"
    path.write_text(tuned({"wall": wall}, loop=FIFTY).to_yaml())
    softer = ("audit", "homerehab", "--stiffness", "2500", "--damping", "30", "--json")
    plain = haptune(*softer, "--velocity-filter", "50").result["details"]
    assert {each["limit"] for each in plain["faults"]} == {"force"}
    ended = haptune(*softer, "--like", f"{path},wall")
    assert ended.code == 0, ended.err
    assert ended.result["details"]["sustained_force"] is None
    assert ended.result["details"]["loop"]["velocity_filter_hz"] == 50.0
    assert ended.result["details"]["gain_margin"] == plain["gain_margin"]
    stiff = haptune(*softer[:2], "--stiffness", "60000", "--like", f"{path},wall", "--json")
    assert stiff.code == 6
    assert {each["limit"] for each in stiff.result["details"]["faults"]} == {"stability"}
    own = haptune(*softer[:2], "--like", f"{path},wall", "--json")
    same = (*softer[:2], "--stiffness", "3000", "--damping", "30", "--like", f"{path},wall")
    assert own.code == 0
    assert own.result["details"] == haptune(*same, "--json").result["details"]
    strange = haptune(*softer, "--like", f"{path},door")
    assert strange.code == 2
    assert "door is no element of it" in strange.err


def test_elements_of_a_profile_are_judged_with_its_margin_and_in_its_hand(tmp_path: Path) -> None:
    """What is safe with the usual margin is not, where its profile keeps more."""
    sides = {"mass": (0.0, 0.1), "damping": (0.0, 1.0), "stiffness": (100.0, 3000.0)}
    hand = {n: {"value": high, "low": low, "high": high} for n, (low, high) in sides.items()}
    rubber = {"rubber": {"stiffness": 900.0}}
    path = tmp_path / "profile.yaml"
    path.write_text(tuned(rubber, margin="conservative", hand=hand).to_yaml())
    like, gains = ("--like", f"{path},rubber"), ("--stiffness", "900")
    own = haptune("audit", "homerehab", *like)
    assert own.code == 0, own.err
    assert "safe with margin conservative" in own.out
    assert "taken on trust: the device alone, and with any hand within" in own.out
    plain = haptune("audit", "homerehab", *gains)
    assert "safe with margin balanced" in plain.out
    assert "taken on trust: no hand: the device alone" in plain.out
    assert haptune("audit", "homerehab", *gains, *like).code == 6
    assert haptune("audit", "homerehab", *gains, *like, "--margin", "firm").code == 0


def test_a_wall_that_shares_the_peak_is_judged_as_cut_at_its_own_level() -> None:
    """Of 28 N at the peak rubber takes 5 N, 1 cm deep; half of the rest is for each of them."""
    wall = {"stiffness": 3000.0, "damping": 30.0, "one_sided": True}
    profile = tuned({"wall": wall, "rubber": {"stiffness": 500.0}}, loop=FIFTY)
    its = profile.elements["wall"]
    assert its.force_level == 11.5
    assert its.contact is not None
    effects = Effects(stiffness=its.stiffness, damping=its.damping)
    filters = filters_of(profile.loop)
    found = audit(profile.device, effects, filters=filters, like=(profile, "wall"))
    assert found.wall.depth_at_peak_force == its.contact.depth_at_peak_force


def test_a_wall_met_farther_before_its_face_than_its_profile_allows_is_not_safe() -> None:
    """Met speed·(B/K - T - T/2) before its face, by the delay and half a sample."""
    wall = {"stiffness": "max", "damping": "max", "one_sided": True, "lead": 0.001}
    profile = tuned({"wall": wall}, loop=FIFTY)
    its, T, speed = profile.elements["wall"], 1e-3, 0.2

    def judged(stiffness: float, damping: float) -> Audit:
        effects = Effects(stiffness=stiffness, damping=damping)
        filters = filters_of(profile.loop)
        return audit(profile.device, effects, filters=filters, like=(profile, "wall"))

    assert judged(its.stiffness, its.damping).safe
    far = judged(1000.0, 60.0)
    (fault,) = far.faults
    assert fault.limit == "lead"
    assert fault.seen == f"it is met {speed * (0.06 - 1.5 * T):.4g} before its face"
    assert fault.needed == "0.001 at most"
    assert far.nearest is not None
    K, B = (float(value) for value in far.nearest.arrays()[:2] if value is not None)
    assert 0.9e-3 < speed * (B / K - 1.5 * T) < 1.001e-3
    assert judged(K, B).safe


def test_without_filters_the_encoder_is_why_it_is_not_fit() -> None:
    ended = haptune("audit", "homerehab", *PAPER)
    assert ended.code == 6
    assert "the encoder makes the force ripple by 4.19 rms" in ended.err
    assert "Filter velocity and acceleration" in ended.err


def test_the_box_that_is_covered_is_told_and_whether_a_log_told_it(tmp_path: Path) -> None:
    """95 % of one widened to 99.9 % of mass, damping and friction at once; mass on a log scale."""
    words = ("--stiffness", "500", "--json")
    box = haptune("audit", "homerehab", *words).result["details"]["box"]
    factor = math.sqrt(16.26624) / 1.959964  # of χ² with three degrees of freedom
    assert box["damping"] == pytest.approx([10 - factor, 10 + factor], rel=1e-4)
    assert box["mass"] == pytest.approx([3 * 0.9**factor, 3 * 1.1**factor], rel=1e-4)
    assert not box["from_logs"]
    told = haptune("audit", "homerehab", *words[:2]).out
    assert "mass 2.41526 to 3.65004 kg, damping 7.94224 to 12.0578 N·s/m, stated or assumed" in told
    content = to_mapping(load_device("homerehab"))
    log = {"source": "log.csv", "digest": "sha256:0", "samples": 2000, "method": "least-squares"}
    content["logs"] = [log]
    path = tmp_path / "device.yaml"
    path.write_text(to_yaml(content))
    assert haptune("audit", str(path), *words).result["details"]["box"]["from_logs"]
    assert "from no log" not in haptune("audit", str(path), *words[:2]).out


def test_a_spring_too_stiff_ends_in_6_with_the_nearest_safe_value() -> None:
    ended = haptune(
        "audit", "homerehab", "--stiffness", "30000", "--damping", "0", "--mass", "0", "--json"
    )
    assert ended.code == 6
    details = ended.result["details"]
    assert {fault["limit"] for fault in details["faults"]} == {"stability", "force"}
    assert details["nearest"] == {"stiffness": pytest.approx(1400.0)}
    assert details["wall"]["restitution"][1] > 1  # an unstable wall gives more than it takes
    assert details["jitter"] == 0
    assert "nearest safe values: --stiffness 1400" in ended.err


def test_the_nearest_safe_values_are_safe_and_near() -> None:
    device = load_device("homerehab")
    wanted = Effects(stiffness=1000.0, damping=10.0, mass=1.0)
    found = audit(device, wanted)
    assert found.nearest is not None
    again = audit(device, found.nearest)
    assert again.safe
    assert again.certificate is not None
    K, B, M = (float(value) for value in found.nearest.arrays() if value is not None)
    assert 100 < K <= 1000
    assert 1 < B <= 10
    assert 0 < M < 0.1  # at 6 N of ripple a kilogram, 0.1 N is all but reached by 0.02 kg


def test_the_gain_margin_is_that_of_the_roots() -> None:
    """The device is known exactly but for the box of its mass and damping: the worst corner."""
    device = load_device("homerehab")
    box = device.simultaneous_box()
    found = audit(device, Effects(stiffness=2000.0))
    T = device.sample_time.value
    for share, stable in ((1 - 1e-6, True), (1 + 1e-6, False)):
        corners = [
            stable_by_jury(
                reference_loop(b * T / m, 2000.0 * T * T / m, 0, 0, delay=1).at(
                    arb(found.gain * share)
                )
            )
            for m in box.mass
            for b in box.damping
        ]
        assert all(corners) == stable


def test_further_delay_becomes_part_of_the_device() -> None:
    device = load_device("homerehab")
    gains = Effects(stiffness=1000.0, damping=10.0)
    near = audit(device, gains, filters=Filters(velocity_filter_hz=50.0))
    late = audit(device, gains, filters=Filters(velocity_filter_hz=50.0), extra_delay_samples=1.5)
    assert late.design.device.delay.value == pytest.approx(0.0025)
    assert late.gain < near.gain
    assert near.delay_samples == 10.0 or near.delay_samples - late.delay_samples == pytest.approx(
        1.5, abs=0.11
    )


EFFECTS = ("stiffness", "damping", "mass")


def _limits(name: str) -> dict[str, float]:
    """What each effect may be alone on the device at its best estimate; below zero all it has."""
    device = load_device(name)
    loop = Loop.from_parts(device, Filters())
    found = {effect: float(largest(loop, effect, Effects())) for effect in EFFECTS}
    return found | {"less damping": -device.damping.value, "less mass": -device.mass.value}


@pytest.mark.parametrize(
    ("name", "gains"),
    [
        (name, {effect.removeprefix("less "): share * limit})
        for name, share in zip(named_devices(), (1.001, 10.0, 1.001, 10.0), strict=True)
        for effect, limit in _limits(name).items()
    ],
)
def test_every_named_device_is_judged_at_or_beyond_its_limit(
    name: str, gains: dict[str, float]
) -> None:
    """An audit has an answer in numbers: safe with a certificate, or the faults."""
    found = audit(load_device(name), Effects(**gains))
    assert found.safe == (found.certificate is not None) == (not found.faults)
    assert found.gain >= 0
    assert (found.margins is None) == (found.gain <= 1)
    assert found.ripple is None or math.isfinite(found.ripple)
    if found.nearest is not None:
        assert all(np.isfinite(size) for size in found.nearest.arrays() if size is not None)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--stiffness", "1e308"), "--stiffness: 1e+308 is beyond 1e-09 to 1e+09"),
        (("--damping", "-1e10"), "--damping: -1e+10 is beyond"),
        (("--mass", "1e-308"), "--mass: 1e-308 is beyond"),
        (("--mass", "1", "--velocity-filter", "1e-300"), "--velocity-filter: 1e-300 is beyond"),
        (("--mass", "1", "--acceleration-filter", "1e300"), "--acceleration-filter: 1e+300 is"),
        (("--mass", "1", "--acceleration-filter", "x"), "--acceleration-filter: x is no cut-off"),
        (("--mass", "1", "--velocity-filter", "9,kalman"), "--velocity-filter: kalman is no kind"),
        (("--mass", "1", "--velocity-filter", "9,tracking,4"), "order must be 2 or 3, states of"),
    ],
)
def test_values_that_no_scene_holds_are_a_usage_error(options: tuple[str, ...], words: str) -> None:
    ended = haptune("audit", "homerehab", *options)
    assert ended.code == 2
    assert words in ended.err


#: A spring on an actuator that never tires; what the device loses by itself limits it.
WALL = Scene.model_validate(
    {"elements": {"wall": {"stiffness": 1300.0, "penetration": 0.01}}, "ripple_limit": 1e6}
)
STRONG = {"force_limit": {"continuous": 1e6, "peak": 1e6}}


def _device(**changes: object) -> Device:
    content = to_mapping(load_device("homerehab")) | STRONG | changes
    return parse_document(Device, content, "a device")


@pytest.fixture(scope="module")
def profile() -> SafeProfile:
    return optimise(_device(), WALL)


def test_intervals_that_share_a_value_are_no_change() -> None:
    old = _device(mass={"value": 3.0, "low": 2.9, "high": 3.1})
    for value, low, high, beyond in (
        (3.15, 3.05, 3.25, False),
        (3.15, 3.1, 3.2, False),
        (3.2, 3.11, 3.3, True),
        (2.5, 2.4, 2.6, True),
    ):
        new = _device(mass={"value": value, "low": low, "high": high})
        found = {change.name: change for change in compare(old, new).changes}
        assert found["mass"].beyond is beyond
        assert found["mass"].part == pytest.approx(value / 3.0 - 1)
        assert not found["damping"].beyond


def test_what_one_file_alone_states_is_a_change() -> None:
    found = compare(_device(), _device(current_lag=0.0002))
    (lag,) = (change for change in found.changes if change.name == "current_lag")
    assert (lag.old, lag.beyond, lag.part) == (None, True, None)
    assert found.holds is None


def test_friction_is_felt_and_another_device_or_axis_is_named(here: Path) -> None:
    old = _device(coulomb_friction=0.8)
    for friction, steps in ((0.95, 0.73), (6.0, 8.5), (0.0, -6.92)):
        felt = {each.name: each for each in compare(old, _device(coulomb_friction=friction)).felt}
        # Steps of 26.7 % above 0.1 N/log(1.267) = 0.4225 N, of 0.1 N below.
        assert felt["coulomb_friction"].steps == pytest.approx(steps, rel=0.02)
    other = _device(coulomb_friction=6.0, axis="y", serial="S-2")
    stored("old.yaml", old)
    stored("new.yaml", other)
    ended = haptune("compare", "old.yaml", "new.yaml")
    assert "feels different: coulomb friction 0.8 → 6 N (+8.5 steps)" in ended.out
    assert "not called the same: axis x → y" in ended.out
    assert "not called" not in haptune("compare", "old.yaml", "old.yaml").out


@pytest.mark.parametrize(
    ("factors", "offset", "told"),
    [
        ((1.1, 1.1, 1.1), 0.11, True),
        ((0.8, 0.8, 0.8), 0.08, True),
        ((1.1, 1.1, 1.1), 0.2, False),
        ((1.1, 1.1, 1.3), 0.11, False),
        ((1.1, 1.0, 1.0), 0.1, False),
    ],
)
def test_one_factor_of_all_that_a_force_scales_is_said(
    factors: tuple[float, ...], offset: float, told: bool, here: Path
) -> None:
    names, values = ("mass", "damping", "coulomb_friction"), (3.0, 10.0, 0.8)
    new = dict(zip(names, (a * b for a, b in zip(factors, values, strict=True)), strict=True))
    for file, known in (
        ("old.yaml", dict(zip(names, values, strict=True)) | {"force_offset": 0.1}),
        ("new.yaml", new | {"force_offset": offset}),
    ):
        sure = {
            name: {"value": x, "low": x * 0.999, "high": x * 1.001} for name, x in known.items()
        }
        stored(file, _device(**sure))
    words = f"; one factor of {factors[0]:.4g} explains mass, damping and friction"
    assert (words in haptune("compare", "old.yaml", "new.yaml").out) is told
    details = json.loads(haptune("compare", "old.yaml", "new.yaml", "--json").out)["details"]
    assert (details["one_factor"] is not None) is told


def test_a_profile_holds_on_its_own_device_and_on_a_better_one(profile: SafeProfile) -> None:
    for device in (profile.device, _device(delay=0.0), _device(damping=11.0)):
        found = compare(profile, device)
        assert found.holds, found.failures
        assert found.gain == profile.margin.gain


def test_a_wall_is_proved_anew_with_its_own_multipliers() -> None:
    """On its own device all of the margin, on one with a longer delay less of it."""
    wall = {"stiffness": 8000.0, "damping": 60.0, "one_sided": True}
    scene = {"elements": {"wall": wall}, "loop": {"velocity_filter_hz": 50.0}}
    old = optimise(_device(), Scene.model_validate(scene))
    same = compare(old, old)
    assert same.holds, same.failures
    assert same.gain == old.margin.gain
    later = compare(old, _device(delay=0.01))
    assert not later.holds
    assert later.gain is not None
    assert 0.2 < later.gain < 0.25


def test_the_gain_kept_on_a_device_of_less_damping_is_where_its_loop_becomes_unstable(
    profile: SafeProfile,
) -> None:
    """The first unstable gain of its worst delay, by roots in many digits."""
    found = compare(profile, _device(damping=5.0))
    assert not found.holds
    assert found.gain is not None
    first = min(safe_gain(profile, ("wall",), (3.0, 5.0, 0.001), delay) for delay in (1, 2))
    assert 0 < found.gain <= first < found.gain + 0.02 * profile.margin.gain


def test_a_profile_at_its_margin_outlives_the_next_log_of_the_same_device(here: Path) -> None:
    """A lighter device is proved up to half of the least damping of one log, not of the next."""

    def logged(value: float, half: float) -> Device:
        return _device(damping={"value": value, "low": value - half, "high": value + half})

    feather = Scene.model_validate({"elements": {"feather": {"damping": "min"}}})
    profile = optimise(logged(10.0, 0.01), feather)
    assert profile.elements["feather"].limited_by == {"damping": "gain-margin"}
    stored("old.yaml", profile)
    for value, half, at_margin in (
        (9.995, 0.01, True),
        (9.95, 0.01, False),  # changed
        (9.9, 0.2, False),  # loses three hundredths of the margin
    ):
        stored("new.yaml", logged(value, half))
        ended = haptune("compare", "old.yaml", "new.yaml")
        assert ended.code == (0 if at_margin else 6)
        assert ended.out.startswith("at its margin: " if at_margin else "not proved: ")
        assert ("with a gain margin of 1.98; tune again" in ended.out) is at_margin


def test_kinds_that_cannot_be_compared_are_refused(profile: SafeProfile) -> None:
    with pytest.raises(UsageError, match="Swap them"):
        compare(_device(), profile)
    with pytest.raises(UsageError, match="one motion"):
        compare(_device(), load_device("knob"))


def test_the_command_ends_with_six_where_the_old_profile_no_longer_holds(
    profile: SafeProfile, here: Path
) -> None:
    stored("profile.yaml", profile)
    stored("worn.yaml", _device(damping=5.0))
    ended = haptune("compare", "profile.yaml", "worn.yaml", "--json")
    assert ended.code == 6
    details = ended.result["details"]
    assert details["holds"] is False
    assert 0 < details["gain"] < profile.margin.gain
    changed = {each["name"] for each in details["changes"] if each["beyond"]}
    assert changed == {"damping"}
    assert "Tune again for it" in ended.err
    same = haptune("compare", "profile.yaml", "profile.yaml")
    assert same.code == 0, same.err
    assert "nothing of the device changed" in same.out
    assert same.out.startswith("safe: profile.yaml holds")
    assert "feels the same" in same.out
    assert "holds on the device of profile.yaml" in same.out
    assert haptune("compare", "worn.yaml", "knob").code == 2
    assert haptune("compare", "worn.yaml", "nowhere.yaml").code == 3


def test_three_verdicts_stand_on_a_page_with_all_years_in_one_picture(
    profile: SafeProfile, here: Path
) -> None:
    stored("profile.yaml", profile)
    years: list[str] = []
    for year, damping in ((2024, 10.0), (2025, 12.0), (2026, 15.0)):
        device = _device(damping=damping).model_copy(update={"date": f"{year}-05-01"})
        stored(f"{year}.yaml", device)
        years.append(f"{year}.yaml")
    ended = haptune(
        *("compare", "profile.yaml", *years, "-o", "page.html", "--picture", "years.svg"),
        COLUMNS="80",
    )
    assert ended.code == 0, ended.err
    assert ended.out.startswith("safe: ")
    # A step of damping is 26.7 %: log(15/10)/log(1.267).
    felt = "feels different: damping 10 → 15 N·s/m (+1.7 steps)"
    assert felt in ended.out
    for word in ("coulomb", "friction", "encoder", "resolution"):  # none is cut or broken
        assert f" {word} " in ended.out.replace("\n", " ")
    page = Path("page.html").read_text(encoding="utf-8")
    assert felt in page
    assert "://" not in page
    assert Path("years.svg").stat().st_size > 1000


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("date: yesterday", "give a date as year-month-day"),
        ("date: 2026-11-22T10:00:00", "give a date as year-month-day"),
        ("serial: 0012", "put it in quotes"),
        ("operator: ''", "give one line of text"),
        ("axis: ''", "give one line of text"),
    ],
)
def test_a_nameplate_that_cannot_be_read_says_how(line: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "hardware.yaml"
    path.write_text(line + "\n", encoding="utf-8")
    with pytest.raises(InvalidInputError, match=sentence):
        load_document(Hardware, path)
