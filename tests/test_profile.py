"""A written profile: no digit can change unseen, no claim can be forged, every reader agrees."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import Device, load_device, load_mapping, quantity, to_mapping, to_yaml
from tests.commands import digest_of, haptune
from tests.thinned import thinned
from tune import CheckFailedError, SafeProfile, Scene, load_profile, optimise

#: The digit in a name is in a key, those of the device are in numbers, text and exponents. The
#: depth is stated, so that the limit of force binds and is not where the force is cut.
SPRING: dict[str, Any] = {"elements": {"wall 2": {"stiffness": "max", "penetration": 0.01}}}
RICH: dict[str, Any] = {
    "elements": {
        "wall": {"stiffness": 500.0, "damping": 10.0},
        "cup": {"mass": 1.0},
        "dust": {"damping": 0.1},
    },
    "together": [["wall", "cup"]],
    "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
}


@functools.cache
def _profile(*, rich: bool = False) -> SafeProfile:
    return optimise(load_device("homerehab"), Scene.model_validate(RICH if rich else SPRING))


def _digits_are_guarded(text: str, path: Path, others: Callable[[str], str], every: int) -> int:
    """Change one digit of so many, in turn, to each of ``others``; count all digits."""
    places = [at for at, letter in enumerate(text) if letter.isdigit()]
    assert places
    for at in places[::every]:
        for digit in others(text[at]):
            path.write_text(text[:at] + digit + text[at + 1 :], encoding="utf-8")
            with pytest.raises(CheckFailedError):
                load_profile(path)
    return len(places)


@pytest.mark.parametrize("rich", thinned([False, True], 1))
def test_every_sixth_digit_changed_once_is_noticed(tmp_path: Path, rich: bool) -> None:
    chance = np.random.default_rng(5)
    text = _profile(rich=rich).to_yaml()

    def another(digit: str) -> str:
        return str((int(digit) + int(chance.integers(1, 10))) % 10)

    guarded = _digits_are_guarded(text, tmp_path / "profile.yaml", another, every=6)
    assert guarded > (300 if rich else 200)


@pytest.mark.parametrize(
    "pattern",
    thinned(
        [
            r"schema: haptune/profile/(1)",
            r"mass: \{value: (3)",
            r"encoder_resolution: 6.0e-0(6)",
            r"wall (2):",
            r"stiffness: (\d)",
            r"confidence: 0.99(9)",
            r"haptune: 0.(1)",
            r"digest: sha256:\D*(\d)",
        ],
        4,
    ),
)
def test_a_changed_digit_ends_with_exit_code_6(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pattern: str
) -> None:
    monkeypatch.chdir(tmp_path)
    text = _profile().to_yaml()
    Path("profile.yaml").write_text(text, encoding="utf-8")
    found = re.search(pattern, text)
    assert found, pattern
    at = found.start(1)
    changed = text[:at] + str((int(text[at]) + 1) % 10) + text[at + 1 :]
    Path("profile.yaml").write_text(changed, encoding="utf-8")
    ended = haptune("check", "profile.yaml", "--json")
    assert ended.code == 6
    assert ended.result["status"] == "check-failed"
    assert "Tune again instead of editing a profile" in ended.err


@pytest.mark.parametrize("key", ["digest", "schema"])
def test_a_line_taken_out_is_noticed(tmp_path: Path, key: str) -> None:
    lines = _profile().to_yaml().splitlines()
    path = tmp_path / "profile.yaml"
    path.write_text("\n".join(x for x in lines if not x.startswith(f"{key}:")), encoding="utf-8")
    with pytest.raises(CheckFailedError, match="digest"):
        load_profile(path)


def test_layout_and_comments_are_not_content(tmp_path: Path) -> None:
    content = to_mapping(_profile())
    path = tmp_path / "profile.yaml"
    turned = dict(reversed(content.items()))
    path.write_text("# another comment\n" + to_yaml(turned) + "# and one more\n", encoding="utf-8")
    assert load_profile(path) == _profile()


@pytest.mark.parametrize("rich", [False, True])
def test_every_float_is_a_float_to_yaml_1_1_and_ros_2(tmp_path: Path, rich: bool) -> None:
    """PyYAML takes 1e-06 for text: a float needs a point, an exponent its sign."""
    text = _profile(rich=rich).to_yaml()
    tokens = re.findall(r"(?<=[\s\[{])[-+]?[\d.]+(?:[eE][-+]?\d+)?(?=[\s,\]}])", text)
    assert "6.0e-06" in tokens
    floats = [token for token in tokens if not token.isdigit() and token.count(".") < 2]
    assert len(floats) > 20
    for token in floats:
        assert re.fullmatch(r"[-+]?\d+\.\d+([eE][-+]\d+)?", token), token
    path = tmp_path / "profile.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_mapping(path) == to_mapping(_profile(rich=rich))


def test_the_digest_tells_devices_apart_by_their_last_digit() -> None:
    device = load_device("homerehab")
    other = device.model_copy(update={"mass": quantity(3.00000000001, 2.7, 3.3)})
    assert digest_of(to_mapping(Device.model_validate(device))) != digest_of(to_mapping(other))
