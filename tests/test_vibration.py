"""Handle vibration against a threshold curve: spectrum, weighting, and the data shipped."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from identification import InvalidInputError, load_document
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.rendering import (
    ThresholdCurve,
    default_thresholds,
    handle_spectrum,
    handle_vibration,
    vibration_in_thresholds,
)

COUNT = 6e-6
MASS = Effects(mass=1.0)


def _loop(cutoff: float | None = None) -> Loop:
    return Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1,
        filters=Filters(velocity_filter_hz=cutoff, acceleration_filter_hz=cutoff),
    )


def _curve(*points: tuple[float, float], amplitude: str = "rms") -> ThresholdCurve:
    return ThresholdCurve.model_validate(
        {
            "name": "test",
            "source": "test",
            "amplitude": amplitude,
            "points": [{"frequency_hz": f, "displacement": x} for f, x in points],
        }
    )


def test_a_flat_threshold_counts_plain_rms() -> None:
    """All but what lies below 1 Hz."""
    f = np.linspace(0, 1, 10_001)[1:]
    below = float(np.sum(handle_spectrum(_loop(), MASS, COUNT, f)) * (f[1] - f[0]))
    expected = np.sqrt(float(handle_vibration(_loop(), MASS, COUNT)) ** 2 - below) / 1e-7
    felt = vibration_in_thresholds(_loop(), MASS, COUNT, _curve((1.0, 1e-7), (2.0, 1e-7)))
    assert felt == pytest.approx(expected, rel=1e-5)
    # Half the threshold is felt twice as much; a peak amplitude is √2 of its rms.
    half = _curve((1.0, 0.5e-7), (2.0, 0.5e-7))
    assert vibration_in_thresholds(_loop(), MASS, COUNT, half) == pytest.approx(2 * felt, rel=1e-9)
    peak = _curve((1.0, 1e-7), (2.0, 1e-7), amplitude="peak")
    assert vibration_in_thresholds(_loop(), MASS, COUNT, peak) == pytest.approx(
        felt * 2**0.5, rel=1e-9
    )


def test_weighting_by_a_curve_against_a_fine_sum() -> None:
    curve = default_thresholds()
    f = np.linspace(1, 500, 400_001)
    f = (f[1:] + f[:-1]) / 2
    for cutoff in (None, 20.0):
        density = handle_spectrum(_loop(cutoff), MASS, COUNT, f) / curve.rms(f) ** 2
        expected = np.sqrt(float(np.sum(density) * (f[1] - f[0])))
        assert vibration_in_thresholds(_loop(cutoff), MASS, COUNT) == pytest.approx(
            expected, rel=1e-4
        )


def test_a_sharp_resonance_is_not_missed() -> None:
    """A hard spring near its limit rings at 9 Hz with a damping ratio of 1e-4 or so."""
    effects = Effects(stiffness=6650.0)
    curve = _curve((1.0, 1e-7), (2.0, 1e-7))
    closed = float(handle_vibration(_loop(), effects, COUNT)) / 1e-7
    assert vibration_in_thresholds(_loop(), effects, COUNT, curve) == pytest.approx(
        closed, rel=1e-3
    )


def test_unfiltered_virtual_mass_is_plainly_felt_and_filters_help() -> None:
    """docs/theory.md, 7: one count of 1 kg on 6 µm and 1 ms is plainly felt."""
    assert vibration_in_thresholds(_loop(), MASS, COUNT) > 3
    assert vibration_in_thresholds(_loop(20.0), MASS, COUNT) < 1
    assert vibration_in_thresholds(_loop(), Effects(), COUNT) == 0.0


def test_shipped_curves_say_where_they_are_from_and_how_sure_that_is() -> None:
    for name in ("grasped_cylinder.yaml", "thenar.yaml"):
        curve = load_document(ThresholdCurve, Path(str(files("tune") / "data" / name)))
        assert "to be checked" in curve.source
    # What the source's abstract states: a U with its minimum between 150 and 200 Hz.
    f = np.geomspace(10, 500, 500)
    best = f[np.argmin(default_thresholds().rms(f))]
    assert 150 <= best <= 200


def test_shipped_curves_have_the_shapes_their_sources_state() -> None:
    thenar = load_document(ThresholdCurve, Path(str(files("tune") / "data" / "thenar.yaml")))
    at = thenar.rms(np.array([2.0, 40.0, 60.0, 120.0, 250.0]))
    assert at[0] == pytest.approx(at[1])
    assert 20 * np.log10(at[2] / at[3]) == pytest.approx(12, abs=0.1)
    assert np.argmin(at) == 4
    # The grasp is more sensitive than the palm, and steeper above 20 Hz.
    grasp = default_thresholds().rms(np.array([20.0, 40.0, 200.0, 300.0]))
    assert 20 * np.log10(grasp[0] / grasp[1]) > 12
    assert np.all(grasp < thenar.rms(np.array([20.0, 40.0, 200.0, 300.0])))


def test_curve_that_does_not_rise_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="must rise"):
        _curve((10.0, 1e-7), (10.0, 1e-8))
    text = (
        "schema: haptune/vibration/1\nname: x\nsource: x\namplitude: rms\nunit: m\n"
        "points:\n  - {frequency_hz: 10.0, displacement: -1.0}\n"
    )
    (tmp_path / "curve.yaml").write_text(text)
    with pytest.raises(InvalidInputError):
        load_document(ThresholdCurve, tmp_path / "curve.yaml")
