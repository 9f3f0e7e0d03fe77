"""One changed byte anywhere: a file is read or refused in a sentence, whatever parses it.

A few hundred cases by default; the long test has 40 000, half of them MATLAB files. None ends by a
signal or a traceback, prints, takes 10 s of the processor or holds 1 GB.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.byte_mutations import KINDS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a case is a fork")
ROOT = Path(__file__).parent.parent
#: Cases of each kind by default, of seeds that the long test does not use; and in the long test.
FEW = 25
MANY = {kind: 5000 if kind.startswith("mat") else 2500 for kind in KINDS}


def _run(first: int, last: int, *kinds: str) -> None:
    command = [sys.executable, "-m", "tests.byte_mutations", str(first), str(last), *kinds]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]
    found = json.loads(ended.stdout.splitlines()[-1])
    assert found["cases"] == (last - first) * len(kinds)
    assert not found["faults"], ended.stdout


def test_a_few_hundred() -> None:
    _run(10**6, 10**6 + FEW, *KINDS)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_forty_thousand(kind: str) -> None:
    _run(0, MANY[kind], kind)
