"""What Python gets: the main job in one call, results as frames, the region in given axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import haptune
from datasets_synthetic import bundled_path
from identification import Hardware, load_device, load_document, load_trajectory
from tests.commands import FLUID
from tune import Effects, audit, compare, load_profile, region_picture

LOG = bundled_path("homerehab.csv")
HARDWARE = bundled_path("homerehab.hardware.yaml")


def test_calibrate_goes_from_a_log_to_a_profile_whose_results_are_frames(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(FLUID, encoding="utf-8")
    profile = haptune.calibrate(LOG, scene, hardware=HARDWARE)
    frame = profile.to_frame()
    assert frame.select("element", "effect", "value").rows() == [("water", "damping", 10.0)]
    assert frame["limited_by"].to_list() == ["wanted"]
    assert "<table" in profile._repr_html_()  # pyright: ignore[reportPrivateUsage]
    path = tmp_path / "profile.yaml"
    path.write_text(profile.to_yaml(), encoding="utf-8")
    rows = compare(load_profile(path), load_device("homerehab")).to_frame()
    assert {"quantity", "old", "new", "beyond", "steps"} <= set(rows.columns)
    axes = Figure().add_subplot()
    assert region_picture(profile, ax=axes) is axes.figure
    assert "square-root" in axes.get_xlabel()


def test_identification_and_audit_are_frames() -> None:
    hardware = load_document(Hardware, HARDWARE)
    found = haptune.identify(load_trajectory(LOG), hardware=hardware)
    rows = {row["quantity"]: row for row in found.to_frame().to_dicts()}
    assert rows["mass"]["low"] < 3.0 < rows["mass"]["high"]
    judged = audit(load_device("homerehab"), Effects(stiffness=800.0)).to_frame()
    peak = judged.filter(judged["quantity"] == "peak_force")
    np.testing.assert_allclose(peak["seen"][0], 8.0)  # 800 N/m over 10 mm
    assert peak["needed"][0] == 28.0
