"""Twenty forms of three logs need no edit by hand: a right profile, or the option that gives it."""

from __future__ import annotations

import functools
import re
import shlex
from pathlib import Path

import pytest

from datasets_synthetic import log_text, run, scenario_named
from identification import Trajectory, load_document
from tests.commands import Ended, form, haptune
from tests.mangled import MANGLED, TORQUE_CONSTANT
from tune import SafeProfile

#: Scenario of a log by the known device it is of.
LOGS = {"homerehab": "homerehab", "knob": "knob", "emps": "emps-open-loop"}
SCENE = "elements: {water: {damping: max}}\nloop: {velocity_filter_hz: 50.0}\n"
#: An option in a message with what stands behind it.
_OPTION = re.compile(r"(--[a-z]+(?:-[a-z]+)*) (\"[^\"]+\"|[-\w]+(?:\.\d+(?:e-?\d+)?)?)")
#: What only a person knows, by what a message has in its place.
KNOWN = {
    ("--force-gain", "X"): str(TORQUE_CONSTANT),
    ("--time", "COL"): "zeit",
    ("--force", "COL"): "kraft",
    ("--position", "COL"): "weg",
}
#: Times that somebody reads a message and adds what it names.
PATIENCE = 3


@functools.cache
def log_of(device: str) -> Trajectory:
    return run(scenario_named(LOGS[device])).part(slice(0, 2500))


def pasted(message: str, given: list[str]) -> list[str]:
    """The options that a message names and nobody gave yet, with their values."""
    found: dict[str, str] = {}
    for option, value in _OPTION.findall(message):
        known = KNOWN.get((option, value), shlex.split(value)[0])
        if option not in given and known not in {"X", "COL"}:
            found.setdefault(option, known)
    return [word for pair in found.items() for word in pair]


def calibrated(log: str) -> tuple[Ended, list[str]]:
    """Calibrate with what the messages ask for; the options that it took."""
    arguments = ["--hardware", "hardware.yaml", "--scene", "scene.yaml"]
    arguments += ["--method", "least-squares", "-o", "p.yaml"]
    options: list[str] = []
    ended = haptune("calibrate", log, *arguments)
    for _ in range(PATIENCE):
        if ended.code == 0:
            break
        options += pasted(ended.err, options)
        ended = haptune("calibrate", log, *arguments, *options)
    return ended, options


@pytest.mark.long
@pytest.mark.parametrize("device", LOGS)
def test_no_form_of_a_log_needs_an_edit_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    assert len(MANGLED) == 20
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(SCENE, encoding="utf-8")
    Path("hardware.yaml").write_text(form("hardware", "--device", device), encoding="utf-8")
    log = log_of(device)
    Path("plain.csv").write_text(log_text(log), encoding="utf-8")
    ended, options = calibrated("plain.csv")
    assert (ended.code, options) == (0, []), ended.err
    plain = load_document(SafeProfile, Path("p.yaml"))
    wrong: list[str] = []
    for name, written in MANGLED.items():
        path = Path(f"log.{written.ending}")
        path.write_bytes(written.content(log, plain.device.motion == "rotary"))
        ended, options = calibrated(path.name)
        print(f"{device}, {name}: {ended.code} {shlex.join(options)}")
        if ended.code:
            wrong.append(f"{name}: {ended.err}")
            continue
        found = load_document(SafeProfile, Path("p.yaml"))
        for quantity in ("mass", "damping"):
            true, seen = getattr(plain.device, quantity), getattr(found.device, quantity)
            if abs(seen.value - true.value) > 0.01 * (true.high - true.low):
                wrong.append(f"{name}: {quantity} {seen.value} and not {true.value}")
        true, seen = plain.elements["water"].damping, found.elements["water"].damping
        if abs(seen / true - 1) > 1e-3:
            wrong.append(f"{name}: water of {seen} and not {true}")
    assert wrong == []
