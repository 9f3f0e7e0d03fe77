"""Profiles are written, read by every reader, checked and exported, whatever elements are named."""

from __future__ import annotations

import functools
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from identification import Device, load_device, load_mapping, quantity, to_mapping
from tests.test_yaml_readers import WORDS
from tests.unlimited import UNLIMITED
from tune import SafeProfile, Scene, check, optimise
from tune.documents import TuneError
from tune.exporters import TARGETS, export

SCENE: dict[str, Any] = {
    "elements": {"a": {"damping": 1.0}, "b": {"damping": 2.0}, "c": {"damping": 4.0}},
    "together": [["a", "b", "c"]],
    "loop": {"velocity_filter_hz": "none"},
}
#: Perceivable on it are a few N·s/m.
LIGHT = {
    "motion": "linear",
    "sample_time": 0.001,
    "delay": 0.001,
    "mass": 0.5,
    "damping": {"value": 1.0, "low": 0.9, "high": 1.1},
    **UNLIMITED,
}


@functools.cache
def _tuned() -> SafeProfile:
    return optimise(Device.model_validate(LIGHT), Scene.model_validate(SCENE))


def _renamed(names: tuple[str, ...]) -> SafeProfile:
    """The tuned profile, with its certificate, for elements of other names."""
    new = dict(zip("abc", names, strict=True))
    profile = _tuned()
    seal = profile.certificate

    def each(old: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(new[name] for name in old)

    certificate = seal.model_copy(
        update={
            "interior": dict.fromkeys((" + ".join(each(m)) for m in profile.moments()), "proved"),
            "worst": seal.worst.model_copy(update={"elements": each(seal.worst.elements)}),
        }
    )
    return profile.model_copy(
        update={
            "elements": {new[name]: element for name, element in profile.elements.items()},
            "together": tuple(each(group) for group in profile.together),
            "method": dict.fromkeys([", ".join(names)], next(iter(profile.method.values()))),
            "certificate": certificate,
        }
    ).signed()


def _goes_round(profile: SafeProfile, path: Path) -> None:
    path.write_text(profile.to_yaml(), encoding="utf-8")
    content = to_mapping(profile)
    assert load_mapping(path) == content
    assert yaml.safe_load(path.read_text(encoding="utf-8")) == content
    checked = check(path).profile
    assert checked == profile
    for target in TARGETS:
        assert export(checked, target)


NASTY_TRIPLES = (
    ("water", "feather", "wall"),
    ("cup", "rubber", "yes"),
    ("1e3", "a: b", "x, #y"),
    ("- z", "wall + cup", "é?"),
)


@pytest.mark.parametrize(
    "names",
    [NASTY_TRIPLES[0], *(pytest.param(each, marks=pytest.mark.long) for each in NASTY_TRIPLES[1:])],
)
def test_a_profile_goes_round(tmp_path: Path, names: tuple[str, ...]) -> None:
    _goes_round(_renamed(names), tmp_path / "profile.yaml")


@pytest.mark.long
@pytest.mark.parametrize("first", WORDS)
def test_every_triple_goes_round(tmp_path: Path, first: str) -> None:
    for names in itertools.permutations(WORDS, 3):
        if names[0] == first:
            _goes_round(_renamed(names), tmp_path / "profile.yaml")


def _random_scene(chance: np.random.Generator) -> Scene:
    names = [str(name) for name in chance.choice(WORDS, int(chance.integers(1, 5)), replace=False)]
    effects = ["stiffness", "damping", "mass"]
    wishes: dict[str, list[Any]] = {
        "stiffness": ["max", 200.0, {"min": 1.0, "max": 2000.0}],
        "damping": ["max", "min", 5.0, {"min": 0.0, "max": 50.0}],
        "mass": ["max", "min", 0.5, {"min": 0.0, "max": 5.0}],
    }
    elements = {
        name: {
            str(effect): wishes[effect][int(chance.integers(len(wishes[effect])))]
            for effect in chance.choice(effects, int(chance.integers(1, 4)), replace=False)
        }
        for name in names
    }
    groups = [[str(n) for n in chance.permutation(names)]] if len(names) > 1 else []
    return Scene.model_validate(
        {
            "elements": elements,
            "together": groups[: int(chance.integers(2))],
            "margin": str(chance.choice(["conservative", "balanced", "firm"])),
            "hand": str(chance.choice(["none", "none", "none", "free-to-rigid"])),
            "loop": {
                "velocity_filter_hz": float(chance.choice([30.0, 60.0])),
                "acceleration_filter_hz": float(chance.choice([20.0, 40.0])),
                "velocity_filter_order": int(chance.integers(1, 3)),
            },
        }
    )


@pytest.mark.long
@pytest.mark.parametrize("block", range(30))
def test_random_profiles_go_round(tmp_path: Path, block: int) -> None:
    """Nothing that was tuned is refused by the check, nor changed by any reader."""
    done = 0
    for seed in itertools.count(1000 * block):
        chance = np.random.default_rng(seed)
        mass, part = 10 ** chance.uniform(-1, 1), float(chance.choice([0.01, 0.1]))
        damping = mass * 10 ** chance.uniform(0, 1)
        device = load_device("homerehab").model_copy(
            update={
                "mass": quantity(mass, mass * (1 - part), mass * (1 + part)),
                "damping": quantity(damping, damping * (1 - part), damping * (1 + part)),
                "delay": quantity(float(chance.choice([0.0, 0.0005, 0.001, 0.002]))),
            }
        )
        try:
            profile = optimise(device, _random_scene(chance))
        except TuneError:
            continue
        _goes_round(profile, tmp_path / "profile.yaml")
        done += 1
        if done == 10:
            break
