"""Whole regions proved to the edge of what is true, nothing false, and what a search finds."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.random_boxes import EXTRA, around, draw, safe_gain, unstable_samples
from tests.thinned import thinned
from tune.certificate.poles import judge
from tune.certificate.region import Point, Region, Setting
from tune.certificate.worst_point import worst_points
from tune.certificate.zero_exclusion import Claim, prove
from tune.documents.profile import HandBox

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


@pytest.mark.parametrize(("damper", "proved"), [(3.0, True), (1.4, False)])
def test_a_device_that_may_have_no_damping_needs_a_damper(damper: float, proved: bool) -> None:
    """b from 0: a spring K holds for B > K·(delay + T/2), here 2.5 N·s/m, and no less."""
    region = Region(
        mass=(2.9, 3.1), damping=(0.0, 1.0), sample_time=(1e-3, 1e-3), delay=(1e-3, 1e-3)
    )
    setting = Setting(
        stiffness=1000.0,
        damping=damper,
        mass=0.0,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    claim = Claim(gain=1.5, extra=1.0)
    assert prove(region, setting, [claim], 5000).proved is proved
    assert (worst_points(region, setting, [claim])[0].verdict.answer == "stable") is proved


def test_a_hand_on_a_rigid_device_is_mass_and_damper_more() -> None:
    """A hand without a spring proves what the heavier, more damped device proves, cell by cell."""
    region, setting = draw(3, 0.1, with_everything=False)
    hand = HandBox(mass=(0.1, 0.2), damping=(1.0, 2.0), stiffness=(0.0, 0.0))
    heavier = replace(
        region,
        mass=(region.mass[0] + 0.1, region.mass[1] + 0.2),
        damping=(region.damping[0] + 1.0, region.damping[1] + 2.0),
    )
    claim = Claim(gain=safe_gain(heavier, setting) / LEFT, extra=EXTRA)
    held = prove(replace(region, hand=hand), setting, [claim], CELLS)
    assert held.proved
    low, high = np.array(heavier.sides()).T
    for part in np.random.default_rng(0).random((20, len(low))):
        point = heavier.point(low + part * (high - low), float(part[0]))
        assert judge(point, setting, claim.gain).answer == "stable"


def _device(mass: float, damping: float, step: float, delay: float) -> Region:
    return Region(
        mass=(mass, mass),
        damping=(damping, damping),
        sample_time=(step, step),
        delay=(delay, delay),
    )


def test_a_gap_in_the_gains_is_not_overlooked() -> None:
    """Stable near zero and at full gain, unstable between them, in a box of a single device."""
    region = _device(1.0, 0.0057, 1.0, 0.0)
    setting = Setting(
        stiffness=0.752,
        damping=0.211,
        mass=0.576,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    point = Point(mass=1.0, damping=0.0057, sample_time=1.0, delay_samples=0)
    assert judge(point, setting, 1.0).radius < 1
    assert not prove(region, setting, [Claim(gain=1.0, extra=0.0)], FEW_CELLS).proved
    assert prove(region, setting, [Claim(gain=0.039, extra=0.0)], FEW_CELLS).proved


def test_a_negative_damper_that_outweighs_the_device_is_not_overlooked() -> None:
    """The root leaves through z = 1: b = 1.0 to 1.1 against 0.6 times the gain."""
    region = Region(
        mass=(1.0, 1.1), damping=(1.0, 1.1), sample_time=(1e-3, 1e-3), delay=(1e-3, 1e-3)
    )
    setting = Setting(
        stiffness=0.0, damping=-0.6, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert prove(region, setting, [Claim(gain=1.5, extra=0.0)], FEW_CELLS).proved
    assert not prove(region, setting, [Claim(gain=1.9, extra=0.0)], FEW_CELLS).proved


@pytest.mark.parametrize("extra", [0.0, 1.0, 2.0])
def test_the_known_limit_of_a_spring_is_the_edge_of_the_proof(extra: float) -> None:
    """m = 3 kg, b = 10 N·s/m, 1 ms: 20 011, 6 673 and 4 006 N/m by samples of delay.

    The table of docs/theory.md prints whole newtons; between the samples every delay counts too.
    """
    limit = {0.0: 20_011.0, 1.0: 6_673.0, 2.0: 4_006.0}[extra]
    region = _device(3.0, 10.0, 1e-3, 0.0)
    setting = Setting(
        stiffness=1.0, damping=0.0, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert prove(region, setting, [Claim(gain=limit - 1, extra=extra)], FEW_CELLS).proved
    assert not prove(region, setting, [Claim(gain=limit + 1, extra=extra)], FEW_CELLS).proved


def test_a_loss_between_two_samples_of_delay_is_not_overlooked() -> None:
    """A box whose delay covers 0 to 1 sample is not proved by its two ends."""
    rng, found = np.random.default_rng(3), 0
    region = _device(1.0, 5.0, 1e-3, 0.0)
    for _ in range(60):
        stiffness, damping, mass = 10 ** rng.uniform([2.7, -0.3, -2], [4, 2.2, -0.3])
        setting = Setting(
            stiffness=float(stiffness),
            damping=float(damping),
            mass=float(mass),
            velocity_filter_hz=float(rng.uniform(20, 200)),
            acceleration_filter_hz=float(rng.uniform(20, 200)),
        )
        claim = Claim(gain=float(rng.uniform(1, 6)), extra=1.0)
        verdicts = [
            judge(region.point(np.array(region.sides())[:, 0], part), setting, claim.gain).answer
            for part in np.linspace(0, 1, 9).tolist()
        ]
        if set(verdicts) != {"stable"}:
            found += 1
            assert not prove(region, setting, [claim], FEW_CELLS).proved
    assert found >= 5


def test_a_stiff_grip_that_destabilises_is_found() -> None:
    """A device made lighter by half stands alone but not in a stiff, hardly damped hand."""
    region = Region(
        mass=(3.0, 3.0), damping=(10.0, 10.0), sample_time=(1e-3, 1e-3), delay=(1e-3, 1e-3)
    )
    lighter = Setting(
        stiffness=0.0,
        damping=0.0,
        mass=-1.5,
        velocity_filter_hz=100.0,
        acceleration_filter_hz=20.0,
    )
    claim = Claim(gain=1.9, extra=0.5)
    assert prove(region, lighter, [claim], 3000).proved
    hand = HandBox(mass=(0.005, 1.0), damping=(1.0, 30.0), stiffness=(20.0, 2000.0))
    held = Region(
        mass=region.mass,
        damping=region.damping,
        sample_time=region.sample_time,
        delay=region.delay,
        hand=hand,
    )
    found = worst_points(held, lighter, [claim])[0]
    assert found.verdict.answer == "unstable"
    assert found.point.hand is not None
    assert found.point.hand.stiffness > 1000
    assert found.point.hand.damping < 5


#: Where the search for a limit ends; a setting as safe as that has none.
NO_LIMIT = 999.0


def _agree(
    seed: int, spread: float, parts: tuple[float, ...], cells: int, *, everything: bool
) -> list[str]:
    """What proof and search say of a box whose setting is at a part of its safe gain."""
    region, setting = draw(seed, spread, with_everything=everything)
    limit = safe_gain(region, setting)
    said: list[str] = []
    for part in parts if limit < NO_LIMIT else ():
        claim = Claim(gain=limit * part, extra=EXTRA)
        proof = prove(region, setting, [claim], cells)
        worst = worst_points(region, setting, [claim], proof.doubt, thorough=2)[0]
        stable = worst.verdict.answer == "stable"
        # Neither may contradict the other: a proof and an unstable point cannot both be.
        assert stable or not proof.proved
        if not stable:
            assert judge(worst.point, setting, claim.gain).answer != "stable"
        said.append("proved" if proof.proved else "unproved" if stable else "unstable")
    return said


@pytest.mark.long
def test_proof_and_search_settle_boxes_on_either_side_of_the_limit() -> None:
    """At 0.97 of the corners' safe gain boxes are proved, at 1.03 a point is found."""
    said = [_agree(seed, 0.1, (0.97, 1.03), 2000, everything=False) for seed in range(5)]
    settled = [each for each in said if each]
    assert len(settled) >= 3
    assert settled == [["proved", "unstable"]] * len(settled)


@pytest.mark.long
def test_proof_and_search_never_contradict_each_other() -> None:
    parts = (0.8, 0.98, 1.02, 1.2)
    said = [
        word
        for seed in range(2000, 2100)
        for word in _agree(seed, 0.2, parts, 50_000, everything=seed % 5 == 0)
    ]
    assert said.count("proved") > 100
    assert said.count("unstable") > 100
    assert said.count("unproved") < 40
