"""Plans as they are asked for: repeatable, in any unit, by command, refused in a sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import (
    InvalidInputError,
    force_text,
    load_excitation,
    plan_excitation,
)
from tests.commands import files, form, haptune
from tests.excitation_plans import LIMITS, STEP, planned, spec


def test_the_same_limits_give_the_same_force() -> None:
    again = plan_excitation(spec(duration=3.0))
    assert force_text(again) == force_text(planned("homerehab"))


def test_units_do_not_matter() -> None:
    """Millimetres and millinewtons give the same force and the same relative intervals."""
    small: dict[str, Any] = {
        "force": 1.4e4,
        "travel": 100.0,
        "speed": 1000.0,
        "encoder_resolution": 6e-3,
        "position_noise": 3e-3,
    }
    plan, other = planned("homerehab"), plan_excitation(spec(duration=3.0, **small))
    # Rounding leads a search of hundreds of steps slightly elsewhere.
    assert other.mass == pytest.approx(plan.mass, rel=0.05)
    assert other.damping == pytest.approx(plan.damping, rel=0.05)


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("mass: must be greater than 0", {"mass": -1}),
        ("damping must not be negative", {"damping": -1}),
        ("hardly moves the device; allow 3 or more", {"force": 2.5, "coulomb_friction": 2.0}),
        ("samples; 200 to 200000 can be planned", {"duration": 1e6}),
        ("samples; 200 to 200000 can be planned", {"duration": 0.1, "ramp": 0.0}),
        ("leaves too little between two ramps", {"ramp": 1.5}),
        ("travel: must be greater than 0", {"travel": 0}),
        ("true and false are no numbers", {"force": True}),
        ("finite number", {"speed": float("inf")}),
        ("delay: must be 'known' or 'unknown'", {"delay": 0.001}),
    ],
)
def test_senseless_limits_are_a_sentence(words: str, change: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError) as caught:
        spec(**change)
    assert words in str(caught.value)


def test_drift_that_no_force_can_prevent_is_a_sentence() -> None:
    with pytest.raises(InvalidInputError) as caught:
        plan_excitation(spec(force_offset={"value": 0.0, "low": -1.0, "high": 1.0}))
    assert "some device within the guesses moves" in str(caught.value)
    assert "narrow the ranges of coulomb_friction and force_offset" in str(caught.value)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    lines = [
        f"{key}: {value}"
        for key, value in (
            {"sample_time": STEP, "duration": 1.2, "ramp": 0.2} | LIMITS["homerehab"]
        ).items()
    ]
    Path("excitation.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tmp_path


@pytest.mark.usefixtures("here")
def test_command_writes_force_and_picture() -> None:
    ended = haptune("excite", "excitation.yaml", "--picture", "force.png")
    assert ended.code == 0, ended.err
    for word in ("multisine", "swept-sine", "binary", "predicted 95 % intervals: mass 3 ±"):
        assert word in ended.out
    rows = Path("force.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "time,force"
    assert rows[1] == "0,0"
    assert rows[-1] == "1.2,0"
    table = np.loadtxt(rows[1:], delimiter=",")
    np.testing.assert_allclose(np.diff(table[:, 0]), STEP, rtol=1e-9)
    plan = plan_excitation(load_excitation(Path("excitation.yaml")))
    np.testing.assert_array_equal(table[:, 1], plan.best.force)
    assert Path("force.png").read_bytes().startswith(b"\x89PNG")


def test_command_says_what_it_would_do_and_what_is_wrong(here: Path) -> None:
    before = files()
    ended = haptune("excite", "excitation.yaml", "--dry-run")
    assert ended.code == 0
    assert "force.csv would be written, 1201 rows" in ended.out
    assert files() == before
    for code, arguments in (
        (2, "excitation.yaml -o excitation.yaml"),
        (2, "excitation.yaml --picture force.csv"),
        (3, "missing.yaml"),
        (7, "excitation.yaml -o absent/force.csv"),
    ):
        ended = haptune("excite", *arguments.split(), "--json")
        assert ended.code == code
        assert ended.result["outputs"] == []
        assert len(ended.err.splitlines()) == 1
    assert files() == before
    text = (here / "excitation.yaml").read_text(encoding="utf-8")
    drifting = text + "force_offset: {value: 0, low: -5, high: 5}\n"
    Path("drift.yaml").write_text(drifting, encoding="utf-8")
    ended = haptune("excite", "drift.yaml")
    assert ended.code == 3
    assert len(ended.err.splitlines()) == 1
    assert "makes a device drift" in ended.err
    assert haptune("excite", "excitation.yaml", "--quiet").out == ""


@pytest.mark.usefixtures("here")
def test_template_is_read() -> None:
    assert haptune("new", "excitation", "-o", "blank.yaml", "--quiet").code == 0
    assert Path("blank.yaml").read_text(encoding="utf-8") == form("excitation")
    filled = ("--device", "homerehab", "-o", "mine.yaml", "--quiet")
    assert haptune("new", "excitation", *filled).code == 0
    read = load_excitation(Path("mine.yaml"))
    assert (read.mass.low, read.mass.high, read.samples) == (2.7, 3.3, 10_000)
    assert len(read.corners()) == 9
    assert replace(planned("homerehab"), spec=read).time[-1] == pytest.approx(3.0)
