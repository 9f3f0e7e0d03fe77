"""Each key of a profile is forged in turn and signed anew; no digit changes unseen."""

import copy
import functools
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from identification import Device, InvalidInputError, load_device, quantity, to_mapping, to_yaml
from tests.commands import digest_of, haptune
from tests.thinned import thinned
from tune import CheckFailedError, SafeProfile, Scene, load_profile, optimise
from tune.certificate.certify import certify
from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST, check_content

Place = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One key of a profile."""

    path: Place
    value: Any
    schema: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(str(part) for part in self.path)


@functools.cache
def _schema() -> dict[str, Any]:
    return SafeProfile.model_json_schema(by_alias=True)


def _branches(schema: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The ways in which a schema can be met, references followed."""
    if "$ref" in schema:
        return _branches(_schema()["$defs"][schema["$ref"].rpartition("/")[2]])
    each = schema.get("anyOf")
    return [found for one in each for found in _branches(one)] if each else [dict(schema)]


def fields(
    content: Any, schema: Mapping[str, Any] | None = None, path: Place = ()
) -> Iterator[Field]:
    """Every key of a profile, those that its schema allows and the file leaves out among them."""
    branches = _branches(_schema() if schema is None else schema)
    if path:
        yield Field(path=path, value=content, schema=schema or {})
    if isinstance(content, dict):
        whole = next((b for b in branches if b.get("type") == "object"), {})
        known: dict[str, Any] = whole.get("properties", {})
        other = whole.get("additionalProperties") or {}
        for name in dict.fromkeys((*known, *content)):
            yield from fields(content.get(name), known.get(name, other), (*path, name))
    elif isinstance(content, list):
        items = next((b.get("items", {}) for b in branches if b.get("type") == "array"), {})
        for place, item in enumerate(content[:2]):
            yield from fields(item, items, (*path, place))


#: What stands for nothing when it is taken away.
GONE = "taken away"


def forgeries(field: Field) -> list[Any]:
    """Values that a forger may write in the place of what a profile says."""
    value = field.value
    found: list[Any] = [] if value is None else [GONE]
    words = [word for b in _branches(field.schema) for word in (b.get("enum") or [])]
    if value is None:
        examples = {"number": 1.0, "integer": 1, "string": "forged", "array": [], "object": {}}
        types = [b.get("type") for b in _branches(field.schema)]
        found += [examples[kind] for kind in types if kind in examples] + words[:1]
    elif isinstance(value, bool):
        found += [not value]
    elif isinstance(value, int | float):
        changed = value + 1 if isinstance(value, int) else value * 1.05 or 1.0
        found += [changed, value * 0.95 or -1.0, -value, value * 1e8 or 1e8]
    elif isinstance(value, str):
        found += [value + " forged", "", *words]
    elif isinstance(value, list):
        found += [[], [*value, *value[:1]], value[:-1]]
        if not any(isinstance(each, float) for each in value):  # numbers may be alike
            found.append(value[::-1])
    else:
        first = next(iter(value), "")
        found += [{}, {**value, "forged": value.get(first, 1.0)}]
    return [each for each in found if each is GONE or each != value]


def forged(content: Mapping[str, Any], field: Field, value: Any) -> dict[str, Any]:
    """A profile with one key changed and the digest that belongs to it."""
    changed: Any = copy.deepcopy(dict(content))
    place: Any = changed
    for key in field.path[:-1]:
        place = place[key]
    if value is GONE:
        del place[field.path[-1]]
    else:
        place[field.path[-1]] = value
    if field.path != ("digest",):
        changed["digest"] = digest_of(changed)
    return changed


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
    """Whether a field, or one above it, is among the keys that a check believes."""
    keys = [key.split(".") for key in (*TAKEN_ON_TRUST, *OPINIONS)]
    return any(
        len(field.names) >= len(key)
        and all(part in {"*", name} for part, name in zip(key, field.names, strict=False))
        for key in keys
    )


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
@pytest.mark.parametrize(
    ("full", "one_in", "least"), thinned([(False, 60, 5), (False, 1, 500), (True, 1, 500)], 1)
)
def test_a_forged_key_is_refused_or_named_as_trusted(full: bool, one_in: int, least: int) -> None:
    """A few of them; all forgeries of all keys are the long run's."""
    passed, tried = _accepted(_tuned(full=full), one_in=one_in)
    assert not passed
    assert tried > least


@pytest.mark.usefixtures("_proofs_are_kept")
def test_a_lead_of_what_has_no_spring_limits_nothing() -> None:
    content = copy.deepcopy(to_mapping(_tuned()))
    assert content["elements"]["water"]["stiffness"] == 0.0
    content["elements"]["water"]["limited_by"]["damping"] = "lead"
    with pytest.raises(CheckFailedError, match="damping is said to be limited by lead"):
        check_content({**content, "digest": digest_of(content)}, "profile.yaml")


def _written(content: dict[str, Any], path: Path) -> str:
    path.write_text(to_yaml({**content, "digest": digest_of(content)}), encoding="utf-8")
    return str(path)


def test_what_is_trusted_is_told(tmp_path: Path) -> None:
    path = _written(to_mapping(_tuned()), tmp_path / "profile.yaml")
    ended = haptune("check", path, "--verbose")
    assert ended.code == 0, ended.err
    told = haptune("check", path, "--json").result["details"]
    for words, kind, keys in (
        ("taken on trust", "taken_on_trust", TAKEN_ON_TRUST),
        ("not checked", "not_checked", OPINIONS),
    ):
        for key, reason in keys.items():
            assert f"{words}: {key}: {reason}\n" in ended.out
        assert told[kind] == keys


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
    ("elements.water.limited_by.damping", "force", "limited by force, which would allow 10%"),
    ("elements.dust.limited_by.damping", "wanted", "does not act, limited_by says wanted"),
    ("skipped", [], "skipped says nothing"),
    ("notes", [], "one begins with 'dust.damping dropped: '"),
    ("method", {}, "method: 0 stated for wall, water"),
    ("elements.wall.rendered", GONE, "rendered is missing. Tune again"),
    ("elements.dust.rendered.mass", 1.0, "something is felt, but no effect acts"),
    ("perception", GONE, "perception, in which steps are counted, is missing. Tune again"),
    ("elements.dust.margins.extra_delay_samples", -1.0, "margins.extra_delay_samples says -1"),
    ("elements.dust.margins.gain", 50.0005, "which is no multiple of 0.001"),
    ("elements.water.ripple", 0.09, "ripple says 0.09"),
    ("elements.water.margins.passive", False, "margins.passive says False"),
    ("loop.acceleration_filter_hz", 20.0, "acceleration_filter_hz: 20.0 in loop"),
    ("loop.velocity_window_samples", 3, "takes the place of velocity_filter_hz"),
)


@pytest.mark.usefixtures("_proofs_are_kept")
@pytest.mark.parametrize(("key", "value", "words"), PASSED_ONCE, ids=lambda item: str(item)[:40])
def test_a_forgery_that_once_passed_is_told_apart(key: str, value: Any, words: str) -> None:
    content = to_mapping(_tuned())
    path = tuple(key.split("."))
    field = Field(path=path, value=None, schema={})
    with pytest.raises((CheckFailedError, InvalidInputError), match=re.escape(words)):
        check_content(forged(content, field, value), "profile.yaml")


def test_a_digit_that_is_changed_once_is_noticed(tmp_path: Path) -> None:
    """Every 23rd: of names, numbers, text and exponents."""
    chance, path = np.random.default_rng(5), tmp_path / "profile.yaml"
    text = _tuned().to_yaml()
    places = [at for at, letter in enumerate(text) if letter.isdigit()][::23]
    assert len(places) > 20
    for at in places:
        other = (int(text[at]) + int(chance.integers(1, 10))) % 10
        path.write_text(f"{text[:at]}{other}{text[at + 1 :]}", encoding="utf-8")
        with pytest.raises(CheckFailedError):
            load_profile(path)


def test_the_digest_tells_devices_apart_by_their_last_digit() -> None:
    device = load_device("homerehab")
    other = device.model_copy(update={"mass": quantity(3.00000000001, 2.7, 3.3)})
    assert digest_of(to_mapping(Device.model_validate(device))) != digest_of(to_mapping(other))
