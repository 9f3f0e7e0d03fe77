"""Friction that the model lacks is found, named, and its slope is what the certificate holds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from identification import SlopeRange, identify, load_device
from tests.simulated.friction_rigs import SHARES, Friction, Kind, friction_of, hardware, record
from tests.thinned import thinned

#: Of the scene, as it must be with the device as it is.
GAIN, LATE = 2.0, 1
#: What a log of each kind is found to show.
NAMED = {
    "quadratic": "drag",
    "cubic": "drag",
    "stribeck": "falling",
    "place": "place",
    "cogging": "position",
    "cable": "memory",
    "presliding": "memory",
}


@pytest.mark.parametrize(
    ("kind", "servo"),
    thinned([("presliding", True), ("quadratic", False), ("place", False), ("stribeck", True)], 1),
)
def test_each_kind_is_named_and_mass_and_slope_are_right_beside_it(kind: Kind, servo: bool) -> None:
    log = record(friction_of(kind, SHARES["middle"]), range(3, 4), servo=servo, seconds=6.0)[0]
    curve = identify(log.trajectory, hardware=hardware()).logs[0].curve
    assert curve is not None
    assert curve.found[0].kind == NAMED[kind]
    assert 0.3 * log.share < curve.found[0].share < 1.7 * log.share
    assert 0.8 * log.least_slope < curve.slope.low <= log.least_slope
    assert log.greatest_slope <= curve.slope.high
    assert abs(curve.mass / log.mass - 1) < 0.01
    held = curve.presliding
    assert (held is None) == (kind != "presliding")
    if held is not None:
        # Where it turns, a bristle is up to twice as stiff as at rest.
        assert log.friction.presliding <= held.high <= 3 * log.friction.presliding
        assert 0 < held.low < held.high


@pytest.mark.parametrize("seed", thinned(range(2), 1))
@pytest.mark.parametrize("servo", [False, True])
def test_plain_friction_shows_no_curve(seed: int, servo: bool) -> None:
    (log,) = record(Friction(), range(seed, seed + 1), servo=servo, seconds=6.0)
    assert identify(log.trajectory, hardware=hardware()).logs[0].curve is None


def test_drag_is_told_and_the_box_holds_its_slopes() -> None:
    log = record(friction_of("quadratic", 0.08), range(1), servo=False, seconds=6.0)[0]
    found = identify(log.trajectory, hardware=hardware())
    assert [each.code for each in found.findings] == ["unmodelled-force"]
    assert "drag that grows faster than speed" in found.findings[0].seen
    device = found.device
    assert device.damping_slope is not None
    box = device.simultaneous_box()
    assert box.damping == (device.damping_slope.low, device.damping_slope.high)
    assert device.damping.low > log.least_slope, "damping alone would be certified away"
    assert device.logs[0].unmodelled_forces[0].kind == "drag"


def test_the_box_takes_the_wider_of_interval_and_slopes() -> None:
    device = load_device("homerehab")
    plain = device.simultaneous_box()
    inside = device.model_copy(update={"damping_slope": SlopeRange(low=9.99, high=10.01)})
    assert inside.simultaneous_box() == plain
    wider = device.model_copy(update={"damping_slope": SlopeRange(low=4.0, high=10.01)})
    assert wider.simultaneous_box() == replace(plain, damping=(4.0, plain.damping[1]))
