"""One whole session on a pseudo-terminal: what cannot be told is asked, then the work goes on."""

import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from identification import Hardware, load_document
from tests.commands import FLUID, bundled_log
from tests.processes import needs_posix

pytestmark = needs_posix

#: Seconds until a command that shows nothing is taken to hang.
_PATIENCE = 30.0
#: A terminal of its own, whose Ctrl-C reaches the command as a signal.
_MAIN = """
import fcntl, signal, sys, termios
signal.signal(signal.SIGINT, signal.default_int_handler)
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from tune.cli import main
sys.argv[0] = "haptune"
main()
"""
#: Ctrl-C at the first question before its answer is read, in a destructor, which drops it.
_DROPPED = """
import os, signal, sys
from tune.cli.session import Session
ask = Session.ask
class Dying:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
class Stream:
    def __init__(self, inner):
        self.write = inner.write
        self.inner = inner
    def flush(self):
        self.inner.flush()
        sys.stderr = self.inner
        Dying()
def ask_late(session, question):
    sys.stderr = Stream(sys.stderr)
    return ask(session, question)
Session.ask = ask_late
"""
#: Question and answer of columns, of a unit that no header can convert, and of facts.
COLUMNS = (
    ("Which column is the time", "stamps [ms]"),
    ("Which column is the force", "1"),
    ("Which column is the position", "1"),
    ("torque constant times transmission", "2,0"),
)
FACTS = (
    ("linear or rotary", "linear"),
    ("such as 0.001 for 1 kHz", "0,001"),
    ("m (rotary: rad)", "6e-6"),
    ("for long", "14"),
    ("for a moment", "28"),
)


class _Terminal:
    """A command on a terminal of 80 columns: what it shows, what a person types."""

    def __init__(self, *arguments: str, before: str = "") -> None:
        import pty

        self.screen, inner = pty.openpty()
        self.shown, self._seen = "", 0
        self.process = subprocess.Popen(
            [sys.executable, "-c", before + _MAIN, *arguments],
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
            env=os.environ | {"COLUMNS": "80", "TERM": "xterm"},
        )
        os.close(inner)

    def wait_for(self, words: str) -> None:
        """Read until words are shown that were not seen before."""
        end = time.monotonic() + _PATIENCE
        while words not in self.shown[self._seen :]:
            left = max(0.0, end - time.monotonic())
            assert select.select([self.screen], [], [], left)[0], self.shown
            assert self._read(), self.shown
        self._seen = self.shown.index(words, self._seen) + len(words)

    def type(self, line: str) -> None:
        os.write(self.screen, line.encode())

    def end(self) -> int:
        """Exit code, after everything is read."""
        try:
            while select.select([self.screen], [], [], _PATIENCE)[0] and self._read():
                pass
            return self.process.wait(_PATIENCE)
        finally:
            self.process.kill()
            os.close(self.screen)

    def _read(self) -> bytes:
        try:
            new = os.read(self.screen, 65536)
        except OSError:  # Linux, when the other side is closed
            return b""
        self.shown += new.decode(errors="replace")
        return new


@pytest.fixture(autouse=True)
def _bench(here: Path) -> None:
    """A log whose names tell nothing: milliseconds, amperes of 2 N each, millimetres."""
    rows = np.loadtxt(bundled_log().splitlines(), delimiter=",", skiprows=1) * [1e3, 0.5, 1e3]
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    Path("log.csv").write_text("\n".join(["stamps [ms],motor [A],handle [mm]", *lines]), "utf-8")
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")


def _answer(terminal: _Terminal, questions: tuple[tuple[str, str], ...]) -> None:
    for question, said in questions:
        terminal.wait_for(question)
        terminal.type(f"{said}\n")


def _calibrate() -> _Terminal:
    return _Terminal("calibrate", "log.csv", "--scene", "scene.yaml")


def test_columns_unit_and_facts_are_asked_in_one_session_that_goes_on() -> None:
    terminal = _calibrate()
    _answer(terminal, (*COLUMNS, *FACTS))
    assert terminal.end() == 0, terminal.shown
    assert "safe: proved for every device" in terminal.shown
    assert "Traceback" not in terminal.shown
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.shown).replace("\r\n", "\n")
    lines = [line.rpartition("\r")[2] for line in plain.split("\n")]  # a spinner writes over itself
    assert [line for line in lines if len(line) > 80] == []  # the terminal would break words
    told = '--time "stamps [ms]" --force "motor [A]" --position "handle [mm]" --force-gain 2'
    assert told in " ".join(plain.split())
    stated = load_document(Hardware, Path("hardware.yaml"))
    assert stated.motion == "linear"
    assert stated.sample_time is not None
    assert stated.sample_time.value == 0.001
    assert Path("profile.yaml").read_text(encoding="utf-8").count("digest: sha256:")


@pytest.mark.parametrize("answered", [0, 8])
def test_an_interrupt_at_a_question_leaves_nothing_written(answered: int) -> None:
    before = {path.name: path.read_bytes() for path in Path().iterdir()}
    terminal = _calibrate()
    questions = (*COLUMNS, *FACTS)
    _answer(terminal, questions[:answered])
    terminal.wait_for(questions[answered][0])
    terminal.type("\x03")
    assert terminal.end() == 130, terminal.shown
    assert "interrupted" in terminal.shown
    assert "Traceback" not in terminal.shown
    assert {path.name: path.read_bytes() for path in Path().iterdir()} == before


def test_an_interrupt_while_it_tunes_leaves_the_answers_whole() -> None:
    terminal = _calibrate()
    _answer(terminal, (*COLUMNS, *FACTS))
    terminal.wait_for("hardware.yaml")
    terminal.type("\x03")
    assert terminal.end() == 130, terminal.shown
    assert "Traceback" not in terminal.shown
    assert load_document(Hardware, Path("hardware.yaml")).motion == "linear"
    assert {path.name for path in Path().iterdir()} == {"log.csv", "scene.yaml", "hardware.yaml"}


def test_an_interrupt_that_is_dropped_before_the_answer_is_read_ends_the_question() -> None:
    terminal = _Terminal("calibrate", "log.csv", "--scene", "scene.yaml", before=_DROPPED)
    assert terminal.end() == 130, terminal.shown
    assert COLUMNS[0][0] in terminal.shown
    assert "interrupted" in terminal.shown
