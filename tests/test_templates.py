"""The scene that suits a known device is tuned on it as it stands, with every effect felt."""

from __future__ import annotations

from pathlib import Path

import pytest

from identification import load_device, load_document, named_devices
from tests.commands import form
from tune import Scene, optimise


@pytest.mark.long
@pytest.mark.parametrize("name", named_devices())
def test_a_scene_that_suits_a_device_is_played_whole(tmp_path: Path, name: str) -> None:
    (tmp_path / "scene.yaml").write_text(form("scene", "--device", name), encoding="utf-8")
    scene = load_document(Scene, tmp_path / "scene.yaml")
    profile = optimise(load_device(name), scene)
    for element, wanted in scene.elements.items():
        steps = profile.elements[element].perceived_steps
        assert steps.keys() == wanted.wishes().keys()
        assert min(steps.values()) >= 1.0
