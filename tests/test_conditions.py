"""Each condition of a certificate and each word of a profile, half a per cent to either side."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from identification import load_device, to_mapping, to_yaml
from tests.commands import digest_of
from tune import SafeProfile, Scene, optimise
from tune.certificate.check import check
from tune.certificate.time_domain import contact_failures
from tune.documents import CheckFailedError

OFF = 0.005


@cache
def tuned() -> SafeProfile:
    """A wall, a spring that must last as deep as is stated, something heavy, something wet."""
    elements = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
        "spring": {"stiffness": 500.0, "damping": 5.0, "penetration": 0.01},
        "cup": {"mass": "max", "damping": 30.0},
        "water": {"damping": 10.0},
    }
    scene = Scene.model_validate(
        {
            "elements": elements,
            "together": [["spring", "water"]],
            "apart": [["wall", "spring"], ["wall", "cup"]],
            "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
        }
    )
    return optimise(load_device("homerehab"), scene)


def with_element(design: SafeProfile, name: str, **update: object) -> SafeProfile:
    changed = design.elements[name].model_copy(update=update)
    return design.model_copy(update={"elements": {**design.elements, name: changed}})


def margins(design: SafeProfile, name: str, **update: object) -> SafeProfile:
    return with_element(
        design, name, margins=design.elements[name].margins.model_copy(update=update)
    )


def limit(design: SafeProfile, name: str, part: float) -> SafeProfile:
    """The continuous or peak force of the device at a part of what it is."""
    device = design.device
    assert device.force_limit is not None
    force = device.force_limit.model_copy(update={name: part * getattr(device.force_limit, name)})
    return design.model_copy(update={"device": device.model_copy(update={"force_limit": force})})


def test_a_wall_damps_more_than_its_lag_takes_and_keeps_to_its_lead() -> None:
    wall = tuned().elements["wall"]
    assert wall.lead is not None
    assert not [*contact_failures(tuned(), "wall")]
    for update, words in (
        ({"damping": 0.0025 * wall.stiffness * (1 - OFF)}, "less than the lag"),
        ({"lead": ((wall.contact and wall.contact.lead) or 0.0) * (1 - OFF)}, "before its face"),
    ):
        said = [*contact_failures(with_element(tuned(), "wall", **update), "wall")]
        assert any(words in each for each in said), said


def rewritten(path: Path, change: Callable[[dict[str, Any]], None], *, sign: bool = True) -> Path:
    content = to_mapping(tuned())
    content["digest"] = ""
    change(content)
    if sign:
        content["digest"] = digest_of(content)
    path.write_text(to_yaml(content, "forged"), encoding="utf-8")
    return path


def _set(*keys: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        place = content
        for key in keys[:-1]:
            place = place[key]
        if value is None:
            del place[keys[-1]]
        else:
            place[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("law", value=None), "an earlier law of walls"),
        (_set("law", value="gated"), "the law 'gated'"),
        (
            _set("elements", "wall", "margins", "absolute_gain", value=3.0),
            "margins.absolute_gain says 3.0",
        ),
        (_set("elements", "wall", "margins", "gain", value=2.6), "more than the"),
        (_set("certificate", "mass", value=[1.0, 2.0]), "certificate.mass says"),
        (_set("elements", "water", "limited_by", "damping", value="ripple"), "limited by ripple"),
        (_set("elements", "cup", "limited_by", "mass", value="stability"), "limited by stability"),
        (_set("elements", "cup", "limited_by", "mass", value="delay-margin"), "by delay-margin"),
        (_set("elements", "wall", "limited_by", "stiffness", value="rendering"), "by rendering"),
        (_set("elements", "spring", "limited_by", "damping", value="lead"), "limited by lead"),
        (_set("elements", "wall", "limited_by", "stiffness", value="saturation"), "by saturation"),
        (_set("elements", "water", "limited_by", value={}), "acts, limited_by says nothing"),
        (_set("elements", "water", "as_commanded", value=False), "says it is not"),
        (_set("elements", "water", "perceived_steps", value={}), "perceived_steps has nothing"),
        (_set("elements", "water", "margins", "gain", value=1.5), "margins.gain says 1.5"),
        (_set("elements", "water", "margins", "jitter", value=7.0), "margins.jitter says 7"),
        (_set("elements", "spring", "force_level", value=0.5), "force_level says 0.5"),
    ],
)
def test_check_refuses_every_false_word(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    with pytest.raises(CheckFailedError, match=words):
        check(rewritten(tmp_path / "profile.yaml", change))


def test_a_profile_without_its_digest_is_refused_and_the_true_one_is_not(tmp_path: Path) -> None:
    path = rewritten(tmp_path / "true.yaml", lambda _: None)
    assert check(path).profile.elements["wall"].stiffness == tuned().elements["wall"].stiffness
    with pytest.raises(CheckFailedError, match="digest"):
        check(rewritten(path, lambda _: None, sign=False))
