"""The public EMPS log through the commands: bands of its published models, and a whole profile."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from identification import load_device
from tests.commands import form
from tune.certificate.check import check
from tune.documents import CheckFailedError

LOG = Path(__file__).parents[2] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
pytestmark = pytest.mark.skipif(not LOG.exists(), reason="the EMPS log is not beside the project")

OPTIONS = ("--time", "t", "--position", "qm", "--force", "vir", "--reference", "qg")
OPTIONS += ("--force-gain", "35.1507")
SCENE = """\
schema: haptune/scene/1
elements:
  wall: {stiffness: max, damping: max, penetration: 0.01, speed: 0.05}
  fluid: {damping: max, speed: 0.05}
  object: {mass: max, acceleration: 0.2}
together: [[wall, fluid]]
"""


def _haptune(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    from tune.cli.app import run_app

    monkeypatch.setattr(sys, "argv", ["haptune", *arguments])
    with pytest.raises(SystemExit) as ended:
        run_app()
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.long
def test_identify_lands_in_the_published_bands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Janot, Gautier, Brunot 2019: M 95.11, Fv 203.5 (sound methods 203..210), Fc 20.39, -3.165."""
    target = tmp_path / "device.yaml"
    assert _haptune(monkeypatch, "identify", str(LOG), *OPTIONS, "-o", str(target)) == 0
    device = load_device(target)
    assert device.mass.value == pytest.approx(95.11, rel=0.01)
    assert 199 <= device.damping.value <= 214
    assert device.coulomb_friction.value == pytest.approx(20.39, rel=0.03)
    assert device.force_offset.value == pytest.approx(-3.165, rel=0.02)
    mass, damping = device.mass, device.damping
    assert (mass.high - mass.low) / 2 <= 0.015 * mass.value
    assert (damping.high - damping.low) / 2 <= 0.06 * damping.value
    # Ordinary least squares says 0.109 kg and 1.15 N·s/m; the residual is coloured.
    assert (mass.high - mass.low) / 2 >= 1.5 * 1.96 * 0.109
    assert (damping.high - damping.low) / 2 >= 1.5 * 1.96 * 1.15


@pytest.mark.long
def test_calibrate_writes_a_profile_that_check_passes_and_a_changed_digit_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, target = tmp_path / "scene.yaml", tmp_path / "profile.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    hardware = tmp_path / "hardware.yaml"
    hardware.write_text(form("hardware", "--device", "emps"), encoding="utf-8")
    arguments = (str(LOG), *OPTIONS, "--scene", str(scene), "-o", str(target))
    assert _haptune(monkeypatch, "calibrate", *arguments) == 3, "nobody stated the hardware"
    arguments += ("--hardware", str(hardware))
    # The voltage of the drive, taken for newtons.
    volts = tuple(each for each in arguments if each not in {"--force-gain", "35.1507"})
    assert _haptune(monkeypatch, "calibrate", *volts) == 4
    assert _haptune(monkeypatch, "calibrate", *arguments) == 0
    assert _haptune(monkeypatch, "check", str(target)) == 0
    text = target.read_text(encoding="utf-8")
    digits = [place for place, letter in enumerate(text) if letter.isdigit()]
    assert len(digits) > 500
    for place in digits[::9]:
        other = "1" if text[place] != "1" else "2"
        target.write_text(text[:place] + other + text[place + 1 :], encoding="utf-8")
        with pytest.raises(CheckFailedError):
            check(target)
    assert _haptune(monkeypatch, "check", str(target)) == 6
