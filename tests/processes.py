"""Commands as processes of their own, with real streams and real signals."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

#: An interrupt is ignored by what a shell starts in the background: here it is what it always is.
_MAIN = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from tune.cli import main, process
def take_over(really=process.unwind_on_signals):
    {before}
    really()
    {ready}
process.unwind_on_signals = take_over
sys.argv[0] = "haptune"
main()
"""

#: What the shell of this system must understand, and the device that is always full.
needs_full_device = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
needs_posix = pytest.mark.skipif(os.name != "posix", reason="signals and owners are of POSIX")


def redirected(redirection: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``haptune ARGUMENTS REDIRECTION`` in a shell and wait for it."""
    haptune = [sys.executable, "-c", _MAIN.format(before="pass", ready="pass"), *arguments]
    return subprocess.run(
        ["sh", "-c", f'exec "$@" {redirection}', "sh", *haptune],
        capture_output=True,
        text=True,
        check=False,
    )


def started(*arguments: str, before: str = "pass") -> subprocess.Popen[str]:
    """Start ``haptune ARGUMENTS`` after a statement of the test's."""
    code = _MAIN.format(before=before, ready=r"os.write(1, b'ready\n')")
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process
