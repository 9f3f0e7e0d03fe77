"""Each key of a profile is forged in turn and signed anew: it is refused, or named as trusted."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from identification import InvalidInputError, load_device, to_mapping, to_yaml
from tests.commands import digest_of, haptune
from tests.forgeries import GONE, Field, fields, forged, forgeries
from tests.thinned import thinned
from tune import CheckFailedError, SafeProfile, Scene, optimise
from tune.certificate.certify import certify
from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST, check_content

SCENE: dict[str, Any] = {
    "elements": {
        "wall": {"stiffness": "max"},
        "water": {"damping": 10.0},
        "dust": {"damping": 0.05},
    },
    "together": [["wall", "water"]],
    "loop": {"velocity_filter_hz": 50.0},
}
FULL: dict[str, Any] = {
    "elements": {
        "wall": {"stiffness": "max", "damping": "max"},
        "cup": {"mass": {"min": 0.1, "max": 0.5}},
        "feather": {"mass": "min"},
    },
    "together": [["cup", "wall"]],
    "hand": {"mass": 0.1, "damping": {"value": 5.0, "low": 2.0, "high": 9.0}, "stiffness": 300.0},
    "loop": {
        "velocity_window_samples": 4,
        "acceleration_filter_hz": 25.0,
        "filter_damping_ratio": 0.7071,
    },
}


@functools.cache
def _tuned(*, full: bool = False) -> SafeProfile:
    return optimise(load_device("homerehab"), Scene.model_validate(FULL if full else SCENE))


def _trusted(field: Field) -> bool:
    return any(each.covers(field.names) for each in (*TAKEN_ON_TRUST, *OPINIONS))


def _passes(content: dict[str, Any]) -> bool:
    if content.get("digest") != digest_of(content):
        return False  # as `read_signed` finds out before anything else
    try:
        check_content(content, "profile.yaml")
    except (CheckFailedError, InvalidInputError):
        return False
    return True


#: Keys of a profile that no proof reads.
UNREAD = ("certificate", "digest", "notes", "skipped", "method", "scene")


#: What the proof found of designs, by their content.
_PROOFS: dict[str, Any] = {}


@pytest.fixture
def _proofs_are_kept() -> Iterator[None]:
    """The same design is proved once; most forgeries are of what is said about it."""

    def kept(design: Any, witnesses: Any = None) -> Any:
        content = to_mapping(design)
        read = {name: content[name] for name in content if name not in UNREAD}
        key = json.dumps(read) + repr(witnesses)
        if key not in _PROOFS:
            try:
                _PROOFS[key] = certify(design, witnesses=witnesses)
            except CheckFailedError as error:
                _PROOFS[key] = error
        found = _PROOFS[key]
        if isinstance(found, CheckFailedError):
            raise found
        return found

    with mock.patch("tune.certificate.check.certify", kept):
        yield


def _accepted(profile: SafeProfile, *, one_in: int) -> tuple[list[str], int]:
    """Forgeries that pass though they are not named as trusted, and how many were tried."""
    content = to_mapping(profile)
    passed: list[str] = []
    tried, chance = 0, np.random.default_rng(6)
    for field in fields(content):
        for value in forgeries(field):
            if one_in > 1 and (_trusted(field) or chance.random() > 1 / one_in):
                continue
            tried += 1
            shown = "taken away" if value is GONE else repr(value)[:40]
            if _passes(forged(content, field, value)) and not _trusted(field):
                passed.append(f"{'.'.join(field.names)}: {shown}")
    return passed, tried


@pytest.mark.usefixtures("_proofs_are_kept")
def test_a_forged_key_is_refused_or_named_as_trusted() -> None:
    """A few of them; all forgeries of all keys are the long test's."""
    passed, tried = _accepted(_tuned(), one_in=60)
    assert not passed
    assert tried > 5


@pytest.mark.long
@pytest.mark.usefixtures("_proofs_are_kept")
@pytest.mark.parametrize("full", [False, True])
def test_every_forgery_of_every_key_is_refused_or_named_as_trusted(full: bool) -> None:
    passed, tried = _accepted(_tuned(full=full), one_in=1)
    assert not passed
    assert tried > 500


def _written(content: dict[str, Any], path: Path) -> str:
    path.write_text(to_yaml({**content, "digest": digest_of(content)}), encoding="utf-8")
    return str(path)


def test_what_is_trusted_is_told(tmp_path: Path) -> None:
    path = _written(to_mapping(_tuned()), tmp_path / "profile.yaml")
    ended = haptune("check", path)
    assert ended.code == 0, ended.err
    told = haptune("check", path, "--json").result["details"]
    for words, kind, keys in (
        ("taken on trust", "taken_on_trust", TAKEN_ON_TRUST),
        ("not checked", "not_checked", OPINIONS),
    ):
        for trusted in keys:
            assert f"{words}: {trusted.key}: {trusted.reason}\n" in ended.out
        assert told[kind] == {trusted.key: trusted.reason for trusted in keys}


def test_another_device_is_refused_key_by_key_and_the_own_one_rehearsed(tmp_path: Path) -> None:
    path = _written(to_mapping(_tuned()), tmp_path / "profile.yaml")
    ended = haptune("check", path, "--device", "homerehab")
    assert ended.code == 0, ended.err
    assert "rehearsed in simulation: settles" in ended.out
    assert "taken on trust: device" not in ended.out
    with mock.patch("tune.cli.judging.refuse_restless", side_effect=CheckFailedError(("shakes",))):
        ended = haptune("check", path, "--device", "homerehab")
    assert (ended.code, "shakes" in ended.err) == (6, True)
    other = to_mapping(load_device("homerehab"))
    other["mass"]["high"] = 3.4
    other["gravity"] = {"sine": 1.0, "cosine": 0.0}
    del other["coulomb_friction"]
    device = tmp_path / "device.yaml"
    device.write_text(to_yaml(other), encoding="utf-8")
    ended = haptune("check", path, "--device", str(device))
    assert ended.code == 6
    for words in (
        "device.mass.high: 3.4 in the device given, 3.3 in the profile",
        "device.gravity: {'sine': 1.0, 'cosine': 0.0} in the device given, nothing in the profile",
        "device.coulomb_friction: 0.0 in the device given, {'value': 0.8",
    ):
        assert words in ended.err


#: key, forged value, words of the refusal: what passed before all of a profile was recomputed
PASSED_ONCE: tuple[tuple[str, Any, str], ...] = (
    ("together", [["water", "water", "water"]], "two or more different elements"),
    ("together", [["water"]], "two or more different elements"),
    ("together", [["water", "wall"]], "together"),
    ("elements.wall.motion.speed", -5.0, "greater than or equal to 1e-09"),
    ("elements.wall.motion.penetration", 0.0, "greater than or equal to 1e-09"),
    ("elements.wall.motion.penetration", 1e-6, "wall: margins.absolute_gain says"),
    ("margin.name", "conservative", "gain: 2.0 in margin, 3.0 in the margin conservative"),
    ("margin.gain", 1.05, "gain: 1.05 in margin, 2.0 in the margin balanced"),
    ("ripple_limit", 1e12, "less than or equal to 1e+09"),
    ("certificate.assumes", [], "certificate.assumes is not what haptune says"),
    ("certificate.not_assessed", ["nothing"], "certificate.not_assessed is not"),
    ("certificate.method", "looked at", "certificate.method is not"),
    ("certificate.interior", {}, "does not say that wall + water is proved"),
    ("elements.wall.limited_by", {}, "stiffness acts, limited_by says nothing of it"),
    ("elements.wall.limited_by.stiffness", "ripple", "limited by ripple, which would allow 10%"),
    ("elements.water.limited_by.damping", "force", "limited by force, which would allow 10%"),
    ("elements.dust.limited_by.damping", "wanted", "does not act, limited_by says wanted"),
    ("skipped", [], "skipped says nothing"),
    ("notes", [], "one begins with 'dust.damping dropped: '"),
    ("method", {}, "method: 0 stated for wall, water"),
    ("elements.wall.rendered", GONE, "rendered is missing. Tune again"),
    ("elements.dust.rendered.mass", 1.0, "something is felt, but no effect acts"),
    ("perception", GONE, "perception, in which steps are counted, is missing. Tune again"),
    ("elements.wall.perceived_steps", {}, "perceived_steps has nothing, what acts is stiffness"),
    ("elements.wall.margins.gain", -5.0, "margins.gain says -5"),
    ("elements.dust.margins.extra_delay_samples", -1.0, "margins.extra_delay_samples says -1"),
    ("elements.dust.margins.gain", 50.0005, "which is no multiple of 0.001"),
    ("elements.water.ripple", 0.09, "ripple says 0.09"),
    ("elements.water.margins.passive", False, "margins.passive says False"),
    ("loop.acceleration_filter_hz", 20.0, "acceleration_filter_hz: 20.0 in loop"),
    ("loop.velocity_window_samples", 3, "takes the place of velocity_filter_hz"),
)


@pytest.mark.usefixtures("_proofs_are_kept")
@pytest.mark.parametrize(
    ("key", "value", "words"), thinned(PASSED_ONCE, 5), ids=lambda item: str(item)[:40]
)
def test_a_forgery_that_once_passed_is_told_apart(key: str, value: Any, words: str) -> None:
    content = to_mapping(_tuned())
    path = tuple(key.split("."))
    field = Field(path=path, value=None, schema={})
    with pytest.raises((CheckFailedError, InvalidInputError), match=re.escape(words)):
        check_content(forged(content, field, value), "profile.yaml")
