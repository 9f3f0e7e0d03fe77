"""Standard streams that are full, closed or without a reader, each with a real process."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from tests.commands import FULL, failing, files
from tests.processes import needs_full_device, redirected
from tune.cli.session import Session, run_command

pytestmark = [needs_full_device, pytest.mark.usefixtures("here")]


@pytest.mark.parametrize("arguments", ["new scene --json", "new scene"])
def test_results_that_a_full_disk_does_not_take_end_with_7_and_say_what_was_written(
    arguments: str,
) -> None:
    ended = redirected(">/dev/full", *arguments.split())
    assert ended.returncode == 7
    assert files() == {"scene.yaml"}
    assert "standard output: not written: No space left on device" in ended.stderr
    assert "; written: scene.yaml." in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize("arguments", ["--version", "new --help"])
def test_help_that_a_full_disk_does_not_take_ends_with_7(arguments: str) -> None:
    ended = redirected(">/dev/full", *arguments.split())
    assert ended.returncode == 7
    assert "no file was written" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("redirection", "arguments"),
    [
        (">&- 2>&- <&-", "new scene"),
        ("2>/dev/full", "new scene"),
        ("| true", "--help"),
        (">&-", "--version"),
    ],
)
def test_streams_nobody_reads_change_nothing(redirection: str, arguments: str) -> None:
    ended = redirected(redirection, *arguments.split())
    assert ended.returncode == 0
    assert ended.stderr == ""
    assert files() == ({"scene.yaml"} if arguments == "new scene" else set())


@pytest.mark.parametrize("redirection", ["2>&-", "2>/dev/full"])
def test_a_refusal_without_standard_error_keeps_its_code_and_its_result(redirection: str) -> None:
    ended = redirected(redirection, "doctor", "missing.csv", "--json")
    assert ended.returncode == 3
    result = json.loads(ended.stdout)
    assert result["exit_code"] == 3
    assert result["message"].startswith("missing.csv: cannot be read")
    assert redirected(redirection, "tuna").returncode == 2


def test_no_file_takes_the_place_of_a_closed_stream() -> None:
    """What a library prints to descriptor 1 would end in the first file that is opened."""
    code = (
        "from tune.cli.process import prepare_streams; prepare_streams(); import os; "
        "os.write(1, b'lost'); file = os.open('a.yaml', os.O_RDWR | os.O_CREAT); assert file > 2"
    )
    command = ["sh", "-c", 'exec "$@" >&- 2>&- <&-', "sh", sys.executable, "-c", code]
    assert subprocess.run(command, check=False).returncode == 0


def test_a_failure_between_two_files_says_which_is_written(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def action(session: Session) -> None:
        for name in ("one.c", "two.h"):
            session.target(Path(name))
        session.write(Path("one.c"), "int one;\n")
        monkeypatch.setattr("os.fsync", failing(FULL))
        session.write(Path("two.h"), "int two;\n")

    with pytest.raises(typer.Exit) as ended:
        run_command(Session(command="export", as_json=False, quiet=False), action)
    assert ended.value.exit_code == 7
    assert "two.h: not written: No space left" in (err := capsys.readouterr().err)
    assert err.endswith("Of all files, written: one.c; not written: two.h.\n")
    assert files() == {"one.c"}
