"""Signals at any moment: an orderly end, whole files, a true sentence."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

from tests.commands import FLUID, files
from tests.processes import needs_posix, started
from tests.thinned import thinned
from tune.cli.session import Session, run_command

pytestmark = needs_posix


@pytest.fixture(autouse=True)
def _folder(here: Path) -> None:
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")
    Path("log.csv").write_text("time,force,position\n" + "0,0,0\n" * 300, encoding="utf-8")


#: Files that the commands write.
_OUTPUTS = ("new.yaml", "other.csv")


def _ended_in_order(arguments: str, name: str, delay: float) -> None:
    """Send a signal some seconds after the start and judge all that is left."""
    for output in _OUTPUTS:
        Path(output).unlink(missing_ok=True)
    process = started(*arguments.split())
    time.sleep(delay)
    process.send_signal(getattr(signal, name))
    out, err = process.communicate()
    what = f"{arguments}, {name} after {delay:.4f} s: {process.returncode}\n{out}{err}"
    own = 4 if arguments.startswith("doctor") else 0  # the code of a command that was quicker
    assert process.returncode in {130, own}, what
    assert "Traceback" not in out + err, what
    assert "ignored" not in err, what
    assert not {name for name in files() if name.startswith(".")}, what
    if process.returncode == 130:
        assert "interrupted; " in err, what
        # CPython tells of a module whose import was interrupted and begun anew.
        said = [line for line in err.splitlines() if "_decimal/libmpdec" not in line]
        assert len(said) == 1, what
        if "--json" in arguments:
            result = json.loads(out.splitlines()[-1])
            assert result["status"] == "interrupted", what
            for output in _OUTPUTS:
                assert (output in result["outputs"]) == Path(output).exists(), what


@pytest.mark.parametrize(
    ("arguments", "name", "delay"),
    [
        ("--help", "SIGINT", 0.0),
        ("new hardware -o new.yaml --json", "SIGTERM", 0.0),
        ("new hardware -o new.yaml --json", "SIGINT", 0.05),
        ("tune homerehab scene.yaml", "SIGHUP", 0.3),
        ("audit homerehab --stiffness 500 --json", "SIGINT", 0.1),
        ("simulate knob -o other.csv --json", "SIGTERM", 0.2),
    ],
)
def test_a_signal_ends_a_command_in_order(arguments: str, name: str, delay: float) -> None:
    _ended_in_order(arguments, name, delay)


#: Puts a signal in the middle of writing: the disk takes its time, and the signal comes meanwhile.
_SLOW_DISK = (
    "import signal, time; real = os.fsync; "
    "os.fsync = lambda handle: (signal.raise_signal(signal.{name}), real(handle))"
)


@pytest.mark.parametrize("name", thinned(["SIGINT", "SIGTERM"], 1))
def test_a_file_that_is_being_written_is_finished_and_named(name: str) -> None:
    old = Path("scene.yaml").read_text(encoding="utf-8")
    process = started("new", "scene", "--json", before=_SLOW_DISK.format(name=name))
    out, err = process.communicate()
    assert process.returncode == 130
    assert err == "haptune new: interrupted; written: scene.yaml\n"
    assert json.loads(out)["outputs"] == ["scene.yaml"]
    assert files() == {"scene.yaml", "scene.yaml.bak", "log.csv"}
    assert Path("scene.yaml.bak").read_text(encoding="utf-8") == old
    assert Path("scene.yaml").read_text(encoding="utf-8") != old


def test_what_is_left_of_several_files_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    def action(session: Session) -> None:
        for name in ("one.c", "two.h", "three.md"):
            session.target(Path(name))
        session.write(Path("one.c"), "int one;\n")
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as ended:
        run_command(Session(command="export", as_json=False, quiet=False), action)
    assert ended.value.exit_code == 130
    assert capsys.readouterr().err == (
        "haptune export: interrupted; written: one.c; not written: two.h, three.md\n"
    )


def test_a_signal_that_was_ignored_at_the_start_stays_ignored() -> None:
    """As under ``nohup``."""
    ignoring = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    process = started("new", "hardware", before=ignoring)
    process.send_signal(signal.SIGHUP)
    assert process.communicate()[1] == ""
    assert process.returncode == 0


def test_nothing_is_loaded_before_the_first_line() -> None:
    """A signal during an import that comes before would end in Python's traceback."""
    code = (
        "import sys; before = set(sys.modules); import tune.cli; print(set(sys.modules) - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(eval(done.stdout)) <= {"tune", "tune.cli", "__future__"}  # noqa: S307
