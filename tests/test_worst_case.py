"""The search for the worst point: it finds known limits, and never contradicts a proof."""

from __future__ import annotations

import pytest

from tests.random_boxes import EXTRA, around, draw, safe_gain
from tune.certificate.poles import judge
from tune.certificate.region import Region, Setting
from tune.certificate.worst_point import worst_points
from tune.certificate.zero_exclusion import Claim, prove
from tune.documents.certified import HandBox

SPRING = Setting(
    stiffness=1.0, damping=0.0, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
)


def _spring_region() -> Region:
    return Region(
        mass=around(3.0, 0.1), damping=(10.0, 12.0), sample_time=(1e-3, 1e-3), delay=(0.0, 1e-3)
    )


def test_the_worst_of_a_spring_is_the_least_damped_and_latest_device() -> None:
    """K < b/(T/2 + delay) to first order: least b, longest delay; the mass hardly matters."""
    worst = worst_points(_spring_region(), SPRING, [Claim(gain=3900.0, extra=1.0)])[0]
    assert worst.point.damping == pytest.approx(10.0)
    assert worst.point.delay_samples == pytest.approx(2.0)
    assert worst.verdict.answer == "stable"


def test_a_limit_passed_by_a_thousandth_at_one_corner_is_found() -> None:
    """The table of docs/theory.md: 4 006 N/m with two samples of delay at b = 10."""
    found = worst_points(_spring_region(), SPRING, [Claim(gain=4011.0, extra=1.0)])[0]
    assert found.verdict.answer == "unstable"


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
