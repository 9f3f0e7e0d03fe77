"""Two devices or two profiles side by side, and whether the old profile holds on the new device."""

from __future__ import annotations

from pathlib import Path

import pytest

from identification import (
    Device,
    Hardware,
    InvalidInputError,
    UsageError,
    load_device,
    load_document,
    parse_document,
    to_mapping,
    to_yaml,
)
from tests.commands import haptune
from tests.true_loops import safe_gain
from tune import SafeProfile, Scene, compare, optimise

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
    later = compare(old, _device(delay=0.008))
    assert not later.holds
    assert later.gain is not None
    assert 0.3 < later.gain < 0.5 * old.margin.gain


def test_the_gain_kept_on_a_device_of_less_damping_is_where_its_loop_becomes_unstable(
    profile: SafeProfile,
) -> None:
    """The first unstable gain of its worst delay, by roots in many digits."""
    found = compare(profile, _device(damping=5.0))
    assert not found.holds
    assert found.gain is not None
    first = min(safe_gain(profile, ("wall",), (3.0, 5.0, 0.001), delay) for delay in (1, 2))
    assert 0 < found.gain <= first < found.gain + 0.02 * profile.margin.gain


def test_kinds_that_cannot_be_compared_are_refused(profile: SafeProfile) -> None:
    with pytest.raises(UsageError, match="Swap them"):
        compare(_device(), profile)
    with pytest.raises(UsageError, match="one motion"):
        compare(_device(), load_device("knob"))


def test_the_command_ends_with_six_where_the_old_profile_no_longer_holds(
    profile: SafeProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    Path("worn.yaml").write_text(to_yaml(to_mapping(_device(damping=5.0))), encoding="utf-8")
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
    profile: SafeProfile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("profile.yaml").write_text(profile.to_yaml(), encoding="utf-8")
    years: list[str] = []
    for year, damping in ((2024, 10.0), (2025, 12.0), (2026, 15.0)):
        device = _device(damping=damping).model_copy(update={"date": f"{year}-05-01"})
        Path(f"{year}.yaml").write_text(to_yaml(to_mapping(device)), encoding="utf-8")
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
        ("date: 2026-11-22T10:00:00", "reads as a datetime"),
        ("serial: 0012", "put it in quotes"),
        ("operator: ''", "give one line of text"),
    ],
)
def test_a_nameplate_that_cannot_be_read_says_how(line: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "hardware.yaml"
    path.write_text(line + "\n", encoding="utf-8")
    with pytest.raises(InvalidInputError, match=sentence):
        load_document(Hardware, path)
