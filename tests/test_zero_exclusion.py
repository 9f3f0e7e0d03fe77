"""Whole regions proved to the edge of what is true, nothing false, and what a search finds."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from tests.random_boxes import EXTRA, around, draw, safe_gain, unstable_samples
from tests.thinned import thinned
from tune.certificate.region import Region, Setting
from tune.certificate.worst_point import worst_points
from tune.certificate.zero_exclusion import Claim, prove

#: What is left of the safe gain, as the studies ask.
LEFT = 1.5
CELLS, FEW_CELLS = 200_000, 3000
#: 3 kg and 10 N·s/m within a tenth, 1 kHz within a hundredth, one sample late.
AROUND_HOMEREHAB = Region(
    mass=around(3.0, 0.1),
    damping=around(10.0, 0.1),
    sample_time=around(1e-3, 0.01),
    delay=(1e-3, 1e-3),
)


@pytest.mark.parametrize(
    ("stiffness", "damping", "mass"),
    thinned(
        [
            (1000.0, 10.0, 1.0),
            (2000.0, 0.0, 0.0),
            (0.0, 100.0, 0.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, -1.0),
        ],
        2,
    ),
)
def test_the_proof_reaches_to_the_very_edge_of_the_margin(
    stiffness: float, damping: float, mass: float
) -> None:
    """A ±10 % box with the worst corner a part in 10⁵ inside is proved, one as far outside not."""
    setting = Setting(
        stiffness=stiffness,
        damping=damping,
        mass=mass,
        velocity_filter_hz=100.0,
        acceleration_filter_hz=20.0,
    )
    limit = safe_gain(AROUND_HOMEREHAB, setting)
    assert prove(
        AROUND_HOMEREHAB, setting, [Claim(gain=limit * (1 - 1e-5), extra=EXTRA)], 10_000
    ).proved
    assert not prove(
        AROUND_HOMEREHAB, setting, [Claim(gain=limit * (1 + 1e-4), extra=EXTRA)], 10_000
    ).proved


def _study(
    spread: float, seeds: range, samples: int, *, everything: bool
) -> list[dict[str, object]]:
    """Boxes with a gain margin of 1.5 left: proved or not, in what time; search and samples."""
    rows: list[dict[str, object]] = []
    for seed in seeds:
        region, setting = draw(seed, spread, with_everything=everything)
        limit = safe_gain(region, setting)
        if limit == 0:
            continue
        claim = Claim(gain=limit / LEFT, extra=EXTRA)
        worst = worst_points(region, setting, [claim])[0]
        start = time.process_time()
        proof = prove(region, setting, [claim], CELLS)
        seconds = time.process_time() - start
        bad = 0
        if proof.proved:
            assert worst.verdict.answer == "stable"
            bad = unstable_samples(region, setting, claim, samples, np.random.default_rng(seed))
        rows.append(
            {
                "seed": seed,
                "stable": worst.verdict.answer == "stable",
                "proved": proof.proved,
                "seconds": seconds,
                "cells": proof.cells,
                "unstable": bad,
            }
        )
    kept = os.environ.get("HAPTUNE_STUDY")
    if kept:
        Path(kept).write_text(json.dumps(rows), encoding="utf-8")
    return rows


def _share(rows: list[dict[str, object]]) -> float:
    stable = [row for row in rows if row["stable"]]
    return float(np.mean([bool(row["proved"]) for row in stable]))


@pytest.mark.parametrize("spread", thinned([0.2, 0.1], 1))
def test_boxes_with_margin_are_proved(spread: float) -> None:
    """A short version of the study; cells stand for time, which a busy machine would blur."""
    rows = _study(spread, range(6), 300, everything=False)
    assert _share(rows) == 1.0
    assert all(row["unstable"] == 0 for row in rows)
    assert max(int(str(row["cells"])) for row in rows) < 3000


def test_boxes_with_delay_hand_and_mode_are_proved() -> None:
    rows = _study(0.1, range(3, 5), 300, everything=True)
    assert _share(rows) == 1.0
    assert all(row["unstable"] == 0 for row in rows)


@pytest.mark.long
@pytest.mark.parametrize(
    ("spread", "everything", "count", "samples", "share", "seconds"),
    [
        (0.1, False, 1000, 10_000, 0.95, 0.25),
        (0.2, False, 1000, 10_000, 0.95, 1.0),
        (0.1, True, 1000, 10_000, 0.80, 30.0),
    ],
)
def test_a_thousand_boxes(
    spread: float, everything: bool, count: int, samples: int, share: float, seconds: float
) -> None:
    """Share of truly stable boxes proved, 95th percentile of the time, no unstable sample."""
    rows = _study(spread, range(count), samples, everything=everything)
    assert _share(rows) >= share
    assert np.quantile([float(str(row["seconds"])) for row in rows], 0.95) <= seconds
    assert all(row["unstable"] == 0 for row in rows)
