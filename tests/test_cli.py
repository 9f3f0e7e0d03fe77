"""What commands say and write: help, JSON, quiet, dry run and backup."""

import re
from pathlib import Path

import pytest

from identification import load_device
from tests.commands import FLUID, bundled_log, files, haptune

COMMANDS = {
    "demo": "--planar --json --quiet --verbose",
    "new": "--device --output --language --dry-run --json --quiet --verbose",
    "doctor": "--time --time-gain --force --position --reference --force-gain --position-gain "
    "--axis --decimal --hardware --allow --picture --json --quiet --verbose",
    "identify": "--output --time --time-gain --force --position --reference --force-gain "
    "--position-gain --axis --decimal --hardware --allow --method --picture --dry-run "
    "--json --quiet --verbose --no-input",
    "tune": "--output --margin --candidates --what-if --picture --dry-run --json --quiet "
    "--verbose --no-input",
    "calibrate": "--scene --output --time --time-gain --force --position --reference --force-gain "
    "--position-gain --axis --decimal --hardware --allow --method --margin --candidates "
    "--picture --dry-run --json --quiet --verbose --no-input",
    "fleet": "--scene --output --time --time-gain --force --position --reference --force-gain "
    "--position-gain --axis --decimal --hardware --allow --method --margin --workers --scheduler "
    "--dry-run --json --quiet --verbose",
    "audit": "--stiffness --damping --mass --extra-delay-samples --velocity-filter "
    "--acceleration-filter --filter-damping-ratio --like --margin --picture --json --quiet "
    "--verbose",
    "check": "--device --picture --json --quiet --verbose",
    "verify": "--element --gain --release --time --time-gain --force --position --force-gain "
    "--position-gain --axis --decimal --picture --json --quiet --verbose",
    "compare": "--output --picture --json --quiet --verbose",
    "export": "--to --output --node --dry-run --json --quiet --verbose",
    "report": "--output --what-if --time --time-gain --force --position --reference --force-gain "
    "--position-gain --axis --decimal --json --quiet --verbose",
    "open": "--port --no-browser --json --quiet --verbose",
    "excite": "--output --picture --dry-run --json --quiet --verbose",
    "simulate": "--output --seed --json --quiet --verbose",
}


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_lists_exactly_the_options_there_are(command: str) -> None:
    ended = haptune(command, "--help")
    assert ("--picture" in ended.out) == ("PNG, SVG or PDF" in " ".join(ended.out.split()))
    assert ended.code == 0
    options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", ended.out))
    assert options == {*COMMANDS[command].split(), "--help"}


def test_help_names_every_command_and_every_exit_code() -> None:
    ended = haptune("--help")
    assert ended.code == 0
    listed = re.findall(r"^  ([a-z]+)  +\w", ended.out.partition("Commands:")[2], re.MULTILINE)
    assert listed == [*COMMANDS, "help"]
    assert "..." not in ended.out.partition("Commands:")[2], "a summary was cut off"
    codes = re.findall(r"\b(\d+) [a-z]", ended.out.partition("Exit codes:")[2])
    assert codes == ["0", "1", "2", "3", "4", "5", "6", "7", "130"]


def test_version() -> None:
    from importlib.metadata import version

    assert haptune("--version").out == f"haptune {version('haptune')}\n"


def test_no_command_shows_the_help_and_is_a_usage_error() -> None:
    ended = haptune()
    assert ended.code == 2
    assert ended.out == ""
    assert ended.err.startswith("Usage: haptune")


def test_the_main_job_from_a_log_to_check() -> None:
    Path("log.csv").write_text(bundled_log(), encoding="utf-8")
    assert haptune("new", "hardware", "--device", "homerehab").code == 0
    ended = haptune("calibrate", "log.csv", "--hardware", "hardware.yaml", "--scene", "scene.yaml")
    assert ended.code == 0, ended.err
    assert re.search(r"homerehab: mass \S+ kg ± .* %, damping ", ended.out)
    # The verdict comes first; what is proved in detail is for who asks.
    assert ended.out.index("safe: proved") < ended.out.index("water damping")
    assert "cells excluded" not in ended.out
    assert "profile.yaml written" in ended.out
    ended = haptune("check", "profile.yaml")
    assert ended.code == 0, ended.err
    assert "passed" in ended.out
    apart = haptune("identify", "log.csv", "--hardware", "hardware.yaml", "--json")
    assert apart.result["outputs"] == ["device.yaml"]
    assert haptune("tune", "device.yaml", "scene.yaml", "-o", "two.yaml").code == 0
    assert Path("two.yaml").read_bytes() == Path("profile.yaml").read_bytes()


def test_warnings_are_findings_and_the_axis_of_a_log_is_that_of_the_hardware() -> None:
    assert haptune("simulate", "homerehab", "--quiet").code == 0
    Path("y.yaml").write_text("axis: y\nsample_time: 0.001\n", encoding="utf-8")
    plain = haptune("identify", "log.csv", "--hardware", "y.yaml")
    assert plain.code == 0, plain.err
    assert load_device("device.yaml").axis == "y"
    codes = re.findall(r"^warning: ([a-z-]+): ", plain.err, re.MULTILINE)
    assert codes == ["not-stated"]
    found = haptune("identify", "log.csv", "--hardware", "y.yaml", "--json").result["findings"]
    assert [(each["code"], each["severity"]) for each in found] == [("not-stated", "warning")]


@pytest.mark.parametrize(
    "command", ["new scene", "tune homerehab scene.yaml", "simulate homerehab -o a.csv"]
)
def test_quiet_prints_nothing(command: str) -> None:
    ended = haptune(*command.split(), "--quiet")
    assert (ended.code, ended.out, ended.err) == (0, "", "")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("new scene -o other.yaml", "elements:"),
        ("tune homerehab scene.yaml", "digest: sha256:"),
    ],
)
def test_dry_run_shows_the_file_and_writes_nothing(command: str, words: str) -> None:
    ended = haptune(*command.split(), "--dry-run")
    assert ended.code == 0, ended.err
    assert words in ended.out
    assert files() == {"scene.yaml"}
    assert haptune(*command.split(), "--dry-run", "--json").result["outputs"] == []


def test_rewriting_keeps_a_backup_and_tells_what_changed() -> None:
    """Effects where they did, else lines of the file, which --verbose shows too."""
    tune = ("tune", "homerehab", "scene.yaml")
    assert haptune(*tune).code == 0
    first = Path("profile.yaml").read_bytes()
    assert "profile.yaml unchanged" in haptune(*tune).out
    assert not Path("profile.yaml.bak").exists()
    ended = haptune(*tune, "--margin", "conservative")
    assert "-margin: {gain: 2.0, extra_delay_samples: 1, name: balanced}" in ended.out
    assert "+margin: {gain: 3.0, extra_delay_samples: 2, name: conservative}" in ended.out
    assert "profile.yaml.bak" in ended.out
    assert Path("profile.yaml.bak").read_bytes() == first
    Path("scene.yaml").write_text(FLUID.replace("10.0", "12.0"), encoding="utf-8")
    ended = haptune(*tune)
    assert "water damping 10 → 12 N·s/m\nprofile.yaml written" in ended.out
    assert "@@" not in ended.out
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")
    assert "-    damping: 12.0\n+    damping: 10.0" in haptune(*tune, "--verbose").out


def test_names_are_printed_as_they_are() -> None:
    """Square brackets and colons mean nothing to the printer, dots nothing to the keys."""
    Path("scene.yaml").write_text(
        'elements: {"[/bold] :smile:": {damping: 10.0}, "a.b": {damping: 0.1}}\n'
        "loop: {velocity_filter_hz: 50.0}",
        encoding="utf-8",
    )
    ended = haptune("tune", "homerehab", "scene.yaml")
    assert ended.code == 0, ended.err
    assert "[/bold] :smile: damping" in ended.out
    assert "a.b.damping dropped" in ended.err
    assert haptune("check", "profile.yaml").code == 0
