"""On a terminal haptune asks for what only a person knows, and never fills in a hint."""

import io
import sys
from pathlib import Path

import pytest

from datasets_synthetic import bundled_path
from identification import Hardware, load_device, load_document
from tests.commands import FLUID, Ended, bundled_log, haptune
from tune.cli.session import Session

#: Motion, sample time, (delay is told by the log), one count, force for long and for a moment.
FACTS = ("linear", "0.001", "6e-6", "14", "28")


@pytest.fixture(autouse=True)
def _bench(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a log, one of other names than haptune's, and a quick scene."""
    Path("plain.csv").write_text(bundled_log(), encoding="utf-8")
    Path("log.csv").write_text(bundled_log(names="stamps,motor,handle"), encoding="utf-8")
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")
    monkeypatch.setattr(Session, "asks", property(_asks))


def _asks(session: Session) -> bool:
    return not (session.as_json or session.quiet or session.no_input)


def _typed(monkeypatch: pytest.MonkeyPatch, lines: tuple[str, ...], *arguments: str) -> Ended:
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))
    return haptune(*arguments)


def test_calibrate_asks_for_columns_and_facts_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = _typed(
        monkeypatch,
        ("1", "9", "motor", "1", *FACTS),
        # The file that answers are kept in may be named before it is there, no other.
        *("calibrate", "log.csv", "--scene", "scene.yaml", "--hardware", "hardware.yaml"),
    )
    assert ended.code == 0, ended.err
    assert "Which column is the time" in ended.err
    assert "a hint, which is not used" in ended.err
    stated = load_document(Hardware, Path("hardware.yaml"))
    assert stated.encoder_resolution is not None
    assert stated.encoder_resolution.value == 6e-6
    assert stated.force_limit is not None
    assert stated.force_limit.peak == 28
    # What was stated is taken the next time, if a person says so.
    columns = ("--time", "stamps", "--force", "motor", "--position", "handle")
    again = _typed(monkeypatch, ("yes",), "calibrate", "log.csv", "--scene", "scene.yaml", *columns)
    assert again.code == 0, again.err
    assert "encoder" not in again.err
    lost = _typed(
        monkeypatch, FACTS, "identify", "log.csv", *columns, "--hardware", "hardwear.yaml"
    )
    assert lost.code == 3
    assert "hardwear.yaml: cannot be read" in lost.err


def test_tune_asks_for_what_a_device_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = haptune("identify", "plain.csv", "--no-input")
    assert ended.code == 0, ended.err
    wrong = ("linear", "fast", "0.001", "6e-6", "14", "2", "14", "28")
    ended = _typed(monkeypatch, wrong, "tune", "device.yaml", "scene.yaml")
    assert ended.code == 0, ended.err
    assert ended.err.count("Please answer again") == 2
    assert haptune("tune", "device.yaml", "scene.yaml", "--no-input").code == 0
    assert Path("hardware.yaml").is_file()


@pytest.mark.parametrize("option", ["--no-input", "--json", "--quiet"])
def test_without_a_person_it_ends_as_before(option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("calibrate", "plain.csv", "--scene", "scene.yaml")
    ended = _typed(monkeypatch, FACTS, *arguments, option)
    assert ended.code == 3
    assert "does not state motion" in ended.err
    named = _typed(monkeypatch, FACTS, *arguments, option, "--hardware", "hardware.yaml")
    assert named.code == 3
    assert "hardware.yaml: cannot be read" in named.err
    assert not Path("hardware.yaml").exists()


def test_nothing_answered_leaves_a_fact_open(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("calibrate", "plain.csv", "--scene", "scene.yaml")
    ended = _typed(monkeypatch, ("linear", ""), *arguments)
    assert ended.code == 3
    assert "does not state sample_time" in ended.err
    known = load_document(Hardware, Path("hardware.yaml"))
    assert known.motion == "linear"
    assert known.sample_time is None


def test_a_column_named_by_a_number_is_meant_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a header 3 is the third column, also where two are left to choose from."""
    rows = Path("log.csv").read_text(encoding="utf-8").splitlines()[1:]
    swapped = (
        f"{force},{time},{position}" for time, force, position in (r.split(",") for r in rows)
    )
    Path("log.csv").write_text("\n".join(swapped), encoding="utf-8")
    ended = _typed(monkeypatch, ("2", "2", "1", "3", *FACTS), "identify", "log.csv")
    assert ended.code == 0, ended.err
    assert '--time "2" --force "1" --position "3"' in ended.err
    assert "warning" not in ended.err  # the delay is told by the log, all else was answered
    assert load_device("device.yaml").mass.value == pytest.approx(3.0, rel=1e-3)


def test_a_column_in_amperes_asks_for_its_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Path("log.csv").read_text(encoding="utf-8")
    Path("log.csv").write_text(text.replace("stamps,motor,handle", "t,force [A],pos"), "utf-8")
    ended = _typed(monkeypatch, ("many", "1.0", *FACTS), "identify", "log.csv")
    assert ended.code == 0, ended.err
    assert "N (N·m) per unit of that column, torque constant times transmission" in ended.err
    assert "could not convert" not in ended.err


def test_a_unit_of_one_axis_is_asked_for_and_told_for_this_axis(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = bundled_path("planar.csv").read_text("utf-8").splitlines()[:2001]
    rows[0] = rows[0].replace("force_y", "force_y [A]")
    Path("plane.csv").write_text("\n".join(rows), "utf-8")
    columns = ("--force", "force_x,force_y", "--position", "position_x,position_y")
    ended = _typed(monkeypatch, ("1", *FACTS), "identify", "plane.csv", *columns)
    assert ended.code == 0, ended.err
    assert "--force-gain ,1" in ended.err


def test_help_is_found_by_every_convention() -> None:
    for arguments in (("help", "tune"), ("tune", "-h"), ("tune", "--help")):
        ended = haptune(*arguments)
        assert ended.code == 0
        assert "Example: haptune tune device.yaml scene.yaml" in ended.out
        assert "<" not in ended.out.partition("Options:")[0]
    assert "Commands:" in haptune("help").out
    assert haptune("help", "tuna").code == 2


def test_a_number_with_its_unit_is_told_to_leave_it_out() -> None:
    Path("hardware.yaml").write_text("sample_time: 1 ms\n", encoding="utf-8")
    ended = haptune("doctor", "plain.csv", "--hardware", "hardware.yaml")
    assert ended.code == 3
    assert "the number alone, in seconds (seen: '1 ms')" in ended.err
