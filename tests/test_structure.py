"""Stability selection names the terms that are there, and no others, whatever the units."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Rig, Servo, simulate
from identification import Trajectory, quantity
from identification.estimators.estimate import Model
from identification.fitting import PreparedLog
from identification.fitting.stability_selection import structure_of, suggest
from tests.axes_with_terms import KnownAxis, known_axes

FloatArray = NDArray[np.float64]


def _structure(log: Trajectory, delay: float = 0.0, *, rotary: bool = True) -> Any:
    table = PreparedLog.of(log, Model(), quantity(delay)).table
    return structure_of(table, delay, rotary=rotary)


def _asked(found: Any) -> set[str]:
    return {"gravity" if name.startswith("gravity") else name for name in found.asked}


def _study(axes: list[KnownAxis]) -> tuple[int, str]:
    """Logs named right, and what went wrong with the others."""
    wrong: list[str] = []
    confused: Counter[str] = Counter()
    for number, axis in enumerate(axes):
        missed, invented = (
            set(axis.shares)
            - (said := _asked(_structure(axis.trajectory, axis.delay, rotary=axis.rotary))),
            set(said),
        )
        invented -= set(axis.shares)
        confused.update([f"missed {name}" for name in missed])
        confused.update([f"invented {name}" for name in invented])
        if missed or invented:
            wrong.append(f"log {number}: {axis.shares}, reach {axis.reach:.3g}: {sorted(said)}")
    return len(axes) - len(wrong), "\n".join([str(dict(confused)), *wrong])


@cache
def _axes() -> list[KnownAxis]:
    return known_axes(12, 1)


@pytest.mark.long
def test_true_terms_are_named_in_a_dozen_logs() -> None:
    right, report = _study(_axes())
    assert right >= 11, report


@pytest.mark.long
def test_true_terms_are_named_in_95_percent_of_200_logs() -> None:
    right, report = _study(known_axes(200, 100))
    print(f"{right} of 200 right; {report}")
    assert right >= 190, report


# Columns without a simulator: independent coloured series.

SEEDS = 15


def _series(generator: np.random.Generator, rows: int, pole: float) -> FloatArray:
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], [1.0, -pole], generator.standard_normal(rows)))


def _unrelated(seed: int, names: tuple[str, ...], rows: int = 6000) -> dict[str, FloatArray]:
    generator = np.random.default_rng(seed)
    return {name: _series(generator, rows, 0.97) for name in ("mass", "damping", *names)}


@pytest.mark.long
def test_coloured_residuals_are_not_taken_for_terms() -> None:
    """Ordinary standard deviations are some four times too small here."""
    invented = 0
    for seed in range(SEEDS):
        columns = _unrelated(seed, ("a", "b", "c"))
        disturbance = _series(np.random.default_rng(1000 + seed), 6000, 0.97)
        found = suggest(columns, columns["mass"] + columns["damping"] + 0.3 * disturbance)
        assert min(verdict.share for verdict in found.verdicts.values()) >= 0
        invented += bool(found.asked)
    assert invented <= 1


def test_share_is_that_of_the_term() -> None:
    columns = _unrelated(5, ("a", "b"))
    force = columns["mass"] + 0.5 * columns["damping"] + 0.1 * columns["b"]
    noisy = force + 0.05 * np.random.default_rng(0).standard_normal(force.size)
    found = suggest(columns, noisy)
    assert found.asked == ("b",)
    expected = 0.1 * np.std(columns["b"]) / np.std(noisy)
    assert found.verdicts["b"].share == pytest.approx(expected, rel=0.05)
    assert found.verdicts["b"].frequency == 1.0
    assert found.verdicts["b"].deviations > 10 > found.verdicts["a"].deviations


def test_a_sure_but_tiny_term_is_not_asked_for() -> None:
    columns = _unrelated(6, ("a",))
    found = suggest(columns, columns["mass"] + columns["damping"] + 0.004 * columns["a"])
    assert found.asked == ()
    assert found.verdicts["a"].frequency == 1.0
    assert found.verdicts["a"].share < 0.01


def test_a_term_seen_in_one_stretch_only_is_not_stable() -> None:
    """A hand that touched the device once is no property of it, however sure the fit."""
    columns = _unrelated(7, ("a", "b"))
    touch = np.zeros(6000)
    touch[2000:2100] = 20.0
    columns["a"] = np.where(touch > 0, 1.0, 0.0) + 1e-3 * columns["a"]
    noise = 0.02 * np.random.default_rng(0).standard_normal(6000)
    found = suggest(columns, columns["mass"] + columns["damping"] + touch + noise)
    assert found.asked == ()
    assert found.verdicts["a"].share > 0.01


def test_a_column_made_of_others_is_not_judged() -> None:
    columns = _unrelated(8, ("a", "b"))
    columns["b"] = columns["a"] - 2 * columns["damping"] + 1e-3 * columns["b"]
    found = suggest(columns, columns["mass"] + columns["a"])
    assert found.unjudged == ("b",)
    assert "b" not in found.verdicts
    assert any("cannot tell b" in sentence for sentence in found.sentences)


# Units, zeros and ranges of real columns.


@pytest.mark.long
def test_the_answer_does_not_depend_on_the_units_of_the_log() -> None:
    axis = next(each for each in _axes() if len(each.shares) >= 2 and not each.rotary)
    log = axis.trajectory
    other = Trajectory(
        time=60.0 * log.time, force=1e-3 * log.force, position=1e3 * log.position, axis="x"
    )
    plain = _structure(log, axis.delay, rotary=False)
    scaled = _structure(other, 60.0 * axis.delay, rotary=False)
    assert _asked(plain) == _asked(scaled) == set(axis.shares)
    for name, verdict in plain.verdicts.items():
        assert scaled.verdicts[name].share == pytest.approx(verdict.share, rel=1e-3, abs=1e-4)


def _swung(rig: Rig, travel: float, centre: float = 0.0) -> Trajectory:
    """10 s of a servo on three sines about a centre."""
    time_ = np.arange(10_000) * 0.001
    lines = [(0.31, 0.55), (1.27, 0.3), (3.1, 0.15)]  # Hz, part of the travel
    waves = np.stack([part * np.sin(2 * np.pi * f * time_) for f, part in lines])
    path = centre + travel * np.sum(waves, axis=0)
    servo = Servo(reference=path, stiffness=400.0, damping=30.0, velocity_filter_hz=60.0)
    return simulate(rig, np.zeros(10_000), controller=servo, position=centre).trajectory()


_ARM = Rig(mass=0.5, damping=1.0, sample_time=0.001, encoder_resolution=1e-5, motion="rotary")


@pytest.mark.long
def test_gravity_needs_range() -> None:
    """Over 0.3 rad it looks like a constant and a spring, over 2 rad like gravity."""
    pulled = replace(_ARM, gravity_sine=2.0, gravity_cosine=1.0)
    short = _structure(_swung(pulled, 0.3))
    assert _asked(short) == {"force_offset", "position_stiffness"}
    assert {"gravity_sine", "gravity_cosine"} <= set(short.unjudged)
    assert any("cannot tell gravity" in sentence for sentence in short.sentences)
    wide = _structure(_swung(pulled, 2.0))
    assert wide.asked == ("gravity_sine", "gravity_cosine")
    assert any("asks for gravity (" in sentence for sentence in wide.sentences)


def test_a_spring_is_no_gravity_over_a_wide_range() -> None:
    sprung = replace(_ARM, stiffness=1.0)
    found = _structure(_swung(sprung, 2.0))
    assert found.asked == ("position_stiffness",)
    assert {"gravity_sine", "gravity_cosine"} <= set(found.unjudged)


@pytest.mark.parametrize(
    ("rig", "terms"),
    [
        pytest.param(replace(_ARM, force_offset=1.0), {"force_offset"}, id="offset"),
        pytest.param(
            replace(_ARM, stiffness=3.0, force_offset=-120.0),
            {"position_stiffness"},
            id="spring",
            marks=pytest.mark.long,
        ),
    ],
)
def test_the_zero_of_a_distant_encoder_is_an_accident(rig: Rig, terms: set[str]) -> None:
    """Moving 0.2 m about 40 m, position is all but a constant; a spring relaxed there shows."""
    linear = replace(rig, motion="linear")
    found = _structure(_swung(linear, 0.2, centre=40.0), rotary=False)
    assert _asked(found) == terms


def test_pysindy_is_loaded_only_when_asked() -> None:
    code = (
        "import sys, identification.fitting.stability_selection\n"
        "sys.exit(', '.join({'pysindy', 'sklearn'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
