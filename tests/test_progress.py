"""Work in hand is shown with its stage, how long it takes already, and about how much longer."""

import io
import os
import sys
from unittest import mock

import pytest

from tune.cli.process import wrap_text
from tune.cli.session import Session, Stage


class Terminal(io.StringIO):
    """Standard error on a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_stage_says_what_it_is_and_a_count_of_parts_how_long_it_takes() -> None:
    now = 0.0
    stage = Stage(lambda: now)
    stage("certifying")
    now = 0.5
    assert str(stage) == "certifying"
    now = 4.0
    assert str(stage) == "certifying, 4 s"
    stage("rehearsing cup (1 of 5)")
    now = 7.0
    assert str(stage) == "rehearsing cup (1 of 5), 7 s"
    stage("rehearsing wall (2 of 5)")
    assert str(stage) == "rehearsing wall (2 of 5), 7 s, about 12 s more"
    now = 9.0
    assert str(stage) == "rehearsing wall (2 of 5), 9 s, about 10 s more"
    now = 11.0
    stage("rehearsing water (4 of 5)")
    assert str(stage).endswith("about 5 s more")  # 7 s for three parts, two are left
    stage("tuning for half the delay (1 of 5)")
    assert str(stage) == "tuning for half the delay (1 of 5), 11 s"
    stage("drawing")
    assert str(stage) == "drawing, 11 s"


def test_a_terminal_sees_the_stages_and_a_pipe_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream, shown in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(sys, "stderr", stream)
        with (
            mock.patch.dict(os.environ, {"TERM": "xterm"}),
            Session(command="tune", as_json=False, quiet=False).progress() as say,
        ):
            say("tuning [wall]")
        assert ("tuning [wall]" in stream.getvalue()) is shown


def test_failures_are_broken_between_words_on_a_terminal_alone() -> None:
    line = "haptune tune: scene.yaml: does not state what is needed. State it in the scene.yaml"
    text = f"{line}\n  motion: linear (kg, N·s/m, N, m) or motion: rotary (kg·m², N·m·s/rad)"
    with mock.patch.dict(os.environ, {"COLUMNS": "60"}):
        found = wrap_text(text, Terminal())
        assert wrap_text(text, io.StringIO()) == text
    assert max(map(len, found.splitlines())) <= 60
    assert found.split() == text.split()
    assert [len(each) - len(each.lstrip()) for each in found.splitlines()] == [0, 2, 2, 4]
