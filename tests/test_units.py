"""Logs in other units than SI: none ends in a certified profile of a wrong device."""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from datasets_synthetic import SCENARIOS, log_text, named_rig, run
from identification import Hardware, Trajectory, examine, load_device
from tests.commands import Ended, haptune
from tune import load_profile

pytestmark = pytest.mark.usefixtures("here")

#: Scenario of a good log of each named device.
LOGS = {"homerehab": "homerehab", "emps": "emps-open-loop", "stylus": "stylus", "knob": "knob"}
#: What a message has to name: an option or a key that mends it.
NAMED = re.compile(r"--(force|position|time)-gain|force_limit|encoder_resolution|motion: ")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mangled:
    """A log in other units: what each column was multiplied with, and what mends it."""

    device: str
    unit: str
    force: float = 1.0
    position: float = 1.0
    time: float = 1.0

    def __str__(self) -> str:
        return f"{self.device} in {self.unit}"

    @property
    def remedy(self) -> tuple[str, ...]:
        """The gains that make it SI again."""
        gains = {"force": self.force, "position": self.position, "time": self.time}
        return tuple(
            word
            for column, factor in gains.items()
            if factor != 1
            for word in (f"--{column}-gain", f"{1 / factor:.17g}")
        )


def _versions(device: str) -> tuple[Mangled, ...]:
    rotary = load_device(device).motion == "rotary"
    amperes = {"homerehab": (3.5, 5.0), "emps": (35.1507, 60.0), "stylus": (1.5, 4.0)}
    constants = amperes.get(device, (0.02, 0.05))
    place = ("degrees", 180 / np.pi) if rotary else ("mm", 1000.0)
    return (
        Mangled(device=device, unit="N·mm" if rotary else "mN", force=1000.0),
        Mangled(device=device, unit=place[0], position=place[1]),
        *([Mangled(device=device, unit="turns", position=0.5 / np.pi)] if rotary else []),
        Mangled(device=device, unit="ms", time=1000.0),
        *(Mangled(device=device, unit=f"A at {k:g} N/A", force=1 / k) for k in constants),
    )


VERSIONS = tuple(each for device in LOGS for each in _versions(device))


@cache
def _log(device: str) -> Trajectory:
    return run(replace(SCENARIOS[LOGS[device]], duration=6.0))


def _calibrated(case: Mangled, *options: str, hardware: bool) -> Ended:
    """``haptune calibrate`` on the log, with the hardware file of the named device or none."""
    log = _log(case.device)
    changed = replace(
        log,
        time=log.time * case.time,
        force=log.force * case.force,
        position=log.position * case.position,
    )
    Path("log.csv").write_text(log_text(changed), encoding="utf-8")
    damping = 4 * load_device(case.device).damping.value
    Path("scene.yaml").write_text(f"elements: {{water: {{damping: {damping}}}}}", encoding="utf-8")
    if hardware:
        assert haptune("new", "hardware", "--device", case.device, "--quiet").code == 0
        options = ("--hardware", "hardware.yaml", *options)
    return haptune("calibrate", "log.csv", "--scene", "scene.yaml", *options)


def _right(case: Mangled) -> bool:
    """Whether the mass that was certified is the true one to a fifth."""
    true = float(named_rig(case.device).mass[0])
    return abs(load_profile("profile.yaml").device.mass.value / true - 1) < 0.2


def _judge(case: Mangled, *, hardware: bool) -> None:
    ended = _calibrated(case, hardware=hardware)
    assert ended.code in {3, 4}, ended.out
    assert not Path("profile.yaml").exists()
    assert NAMED.search(ended.err), ended.err
    if hardware:  # nothing is left to ask: the unit is refused, and the column named
        assert ended.code == 4
        assert f"{case.remedy[0]} " in ended.err


@pytest.mark.parametrize("case", VERSIONS, ids=str)
def test_another_unit_with_hardware_is_refused_and_its_gain_named(case: Mangled) -> None:
    _judge(case, hardware=True)


@pytest.mark.parametrize("case", [each for each in VERSIONS if each.unit in {"mm", "ms"}], ids=str)
def test_another_unit_without_hardware_is_refused_or_asked_about(case: Mangled) -> None:
    _judge(case, hardware=False)


def test_radians_without_a_motion_are_told_about_rotary() -> None:
    plain = Mangled(device="knob", unit="rad")
    ended = _calibrated(plain, "--method", "least-squares", hardware=False)
    assert ended.code == 3
    assert ended.err.count("motion: rotary") >= 2, "as a warning and in the question"


def test_what_travels_too_far_for_metres_may_turn() -> None:
    far = replace(_log("knob"), position=_log("knob").position * 100, motion=None)
    (told,) = [each for each in examine(far).findings if "travels" in each.seen]
    assert told.remedy.index("motion: rotary") < told.remedy.index("--position-gain")
    assert "for degrees" in told.remedy
    known = replace(far, stated_units=frozenset({"position"}))  # by its header
    assert not [each for each in examine(known).findings if "for degrees" in each.remedy]


@pytest.mark.parametrize("device", LOGS)
def test_readings_without_counts_scatter_in_other_units(device: str) -> None:
    """Noise of half a count after the counter, or few digits, hide the counts, not the unit."""
    log, known = _log(device), load_device(device)
    assert known.encoder_resolution is not None
    count = known.encoder_resolution.value
    hardware = Hardware(
        motion=known.motion, axis=known.axis, encoder_resolution=known.encoder_resolution
    )
    noise = 0.5 * count * np.random.default_rng(1).standard_normal(len(log))
    hidden = replace(log, position=log.position + noise)
    seen = examine(hidden, hardware=hardware, method="least-squares").findings
    assert not [each for each in seen if "encoder resolution" in each.seen]
    factor = 180 / np.pi if known.motion == "rotary" else 1000.0
    other = replace(hidden, position=np.round(hidden.position * factor, 2))
    seen = examine(other, hardware=hardware, method="least-squares").findings
    told = [each for each in seen if "encoder resolution" in each.seen]
    assert [each.severity for each in told] == ["refusal"]
    assert "--position-gain" in told[0].remedy


def test_a_log_in_si_units_with_hardware_is_calibrated() -> None:
    case = Mangled(device="stylus", unit="SI")
    ended = _calibrated(case, "--verbose", hardware=True)
    assert ended.code == 0, ended.err
    assert _right(case)
    assert "taken on trust: logs in SI units: force in N" in ended.out
