"""What libraries say to programmers does not reach whoever runs a command."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

#: The command's entry point around work in which two libraries complain.
_COMPLAINING = """
import logging, warnings
import tune.cli.app

def run():
    warnings.warn("invalid value encountered", RuntimeWarning)
    logging.getLogger("library").warning("a cache was built")

tune.cli.app.run_app = run
from tune.cli import main
main()
"""


@pytest.mark.parametrize(("options", "silent"), [((), True), (("-W", "default"), False)])
def test_warnings_of_libraries_are_shown_to_those_who_ask(
    options: tuple[str, ...], silent: bool
) -> None:
    done = subprocess.run(
        [sys.executable, *options, "-c", _COMPLAINING],
        capture_output=True,
        text=True,
        check=False,
        env=_without_options(),
    )
    assert done.returncode == 0, done.stderr
    assert (done.stderr == "") == silent


def _without_options() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != "PYTHONWARNINGS"}
