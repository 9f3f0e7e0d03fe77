"""Friction that the model lacks is found, named, and its slope is what the certificate holds.

The truth is an integrator of its own (`tests.simulated.friction_rigs`), with the friction known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from identification import (
    Device,
    Identification,
    LogRefusedError,
    SlopeRange,
    identify,
    load_device,
)
from tests.friction_play import settled
from tests.simulated.families import FAMILIES
from tests.simulated.friction_rigs import (
    KINDS,
    SHARES,
    Friction,
    Kind,
    Recorded,
    T,
    friction_of,
    hardware,
    record,
)
from tests.thinned import thinned
from tests.true_loops import judged
from tests.unlimited import BOUNDLESS
from tune import SafeProfile, Scene, optimise
from tune.documents import NoFeasibleEffectError

WALL = Scene.model_validate(
    {
        "elements": {
            "wall": {"stiffness": "max", "damping": "max"},
            "rubber": {"stiffness": "max"},
        },
        "ripple_limit": 1e6,
        "loop": {"velocity_filter_hz": 60.0},
    }
)
#: One damper that nothing but stability limits on an actuator without limits.
WATER = Scene.model_validate(
    {
        # More than is stable on any of the devices here: the nearest safe value is the largest.
        "elements": {"water": {"damping": 1e5}},
        "ripple_limit": 1e6,
        "loop": {"velocity_filter_hz": 60.0},
    }
)
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
#: theory.md 10: drag on HomeRehab, N·s²/m².
DRAGS = (0.0, 3.0, 10.0, 100.0)


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


@pytest.mark.long
def test_what_holds_before_it_slides_is_proved_beside_what_slides() -> None:
    device = load_device("homerehab").model_copy(
        update={"presliding_stiffness": SlopeRange(low=10.0, high=800.0)}
    )
    profile = optimise(device, WALL)
    assert profile.certificate.presliding_stiffness == (10.0, 800.0)
    assert any("slides, or holds the device" in each for each in profile.certificate.assumes)
    # Late and filtered, a damper pushes where a stiff spring swings fast.
    strong = load_device("homerehab").model_copy(update={"force_limit": BOUNDLESS})
    stiff = SlopeRange(low=1e5, high=2e5)
    sprung = strong.model_copy(update={"presliding_stiffness": stiff})
    most, less = (optimise(each, WATER).elements["water"].damping for each in (strong, sprung))
    assert 0 < less < 0.5 * most


def _identified(log: Recorded) -> Identification | None:
    try:
        return identify(log.trajectory, hardware=hardware())
    except LogRefusedError:
        return None


def _unsafe(friction: Friction, pairs: Sequence[tuple[Recorded, Device]]) -> list[str]:
    """Devices whose profile does not keep its margin on the device as it is.

    Judged with the least and the greatest slope that the friction has, and played with the
    friction itself at nearly the gain, and with the extra delay, of the margin.
    """
    logs: list[Recorded] = []
    profiles: list[SafeProfile] = []
    for log, device in pairs:
        try:
            profiles.append(optimise(device, WALL))
        except NoFeasibleEffectError:
            continue
        logs.append(log)
    if not logs:
        return []
    rests = [
        settled(friction, logs, profiles, name, gain=0.97 * GAIN, late=LATE)
        for name in WALL.elements
    ]
    return [
        log.trajectory.source
        for log, profile, *rest in zip(logs, profiles, *rests, strict=True)
        if not all(rest)
        or any(
            judged(profile, (log.mass, slope, T), 1) != "stable"
            for slope in (log.least_slope, log.greatest_slope)
        )
    ]


@pytest.mark.long
@pytest.mark.parametrize("drag", DRAGS[2:3])
def test_drag_never_costs_the_margin(drag: float) -> None:
    _drag_never_costs_the_margin(drag)


@pytest.mark.long
@pytest.mark.parametrize("drag", DRAGS)
def test_the_four_drags_keep_the_margin_or_are_refused(drag: float) -> None:
    _drag_never_costs_the_margin(drag)


def _drag_never_costs_the_margin(drag: float) -> None:
    friction = Friction(quadratic=drag)
    logs = record(friction, range(1), servo=False)
    found = [(log, _identified(log)) for log in logs]
    assert not _unsafe(friction, [(log, each.device) for log, each in found if each is not None])


@dataclass(frozen=True, slots=True)
class _Tally:
    """What became of the logs of all families."""

    below: list[bool] = field(default_factory=list[bool])
    close: list[bool] = field(default_factory=list[bool])
    accepted: list[bool] = field(default_factory=list[bool])
    masses: list[bool] = field(default_factory=list[bool])

    def add(self, log: Recorded, found: Identification | None) -> None:
        if log.share <= 0.08:
            self.accepted.append(found is not None)
        if found is None:
            return
        mass, slope = found.device.mass, found.device.damping_slope
        low = found.device.damping.low if slope is None else slope.low
        self.below.append(low <= log.least_slope)
        if log.share <= 0.08:
            self.close.append(low >= 0.8 * log.least_slope)
        near = abs(mass.value / log.mass - 1) < 0.02
        self.masses.append(mass.low <= log.mass <= mass.high or near)


@pytest.mark.long
def test_thirty_families_of_friction_outside_the_model() -> None:
    """Seven kinds, three strengths, open loop and servo, 20 devices each."""
    tally, unsafe = _Tally(), list[str]()
    for kind in KINDS:
        for strength, share in SHARES.items():
            for servo in (False, True):
                friction = friction_of(kind, share)
                pairs: list[tuple[Recorded, Device]] = []
                for log in record(friction, range(20), servo=servo):
                    found = _identified(log)
                    tally.add(log, found)
                    if found is not None:
                        pairs.append((log, found.device))
                unsafe += [f"{kind} {strength} {servo} {each}" for each in _unsafe(friction, pairs)]
    assert not unsafe
    assert np.mean(tally.below) >= 0.95
    assert np.mean(tally.close) >= 0.8
    assert np.mean(tally.accepted) >= 0.8
    assert np.mean(tally.masses) >= 0.97


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_no_curve_is_found_where_there_is_none(name: str) -> None:
    logs = FAMILIES[name].logs(range(200))
    found = [identify(log, hardware=FAMILIES[name].hardware).logs[0].curve for log in logs]
    assert sum(each is not None for each in found) <= 2
