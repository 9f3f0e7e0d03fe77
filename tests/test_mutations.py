"""Whatever is given, a command ends in a sentence: no traceback, no exit 1."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.mutations import KINDS, fault, prepare

ROOT = Path(__file__).parent.parent
#: Cases of each kind by default, of seeds that the long tests do not use.
FEW = {"yaml": 12, "log": 8, "options": 8}
#: Cases of each kind in the long tests, and how many one process is given.
CASES = {"yaml": 3000, "log": 2000, "options": 1000}
SHARE = 250
MOST_BYTES = 1_000_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("mutations")
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(made)
        prepare()
    return made


@pytest.mark.parametrize(
    ("kind", "seed"),
    [(kind, 10**6 + k) for kind, count in FEW.items() for k in range(count)],
)
def test_a_few(folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str, seed: int) -> None:
    monkeypatch.chdir(folder)
    outcome = KINDS[kind](seed)
    assert not fault(outcome), outcome


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_thousands(tmp_path: Path, kind: str) -> None:
    with ThreadPoolExecutor(2) as pool:
        firsts = range(0, CASES[kind], SHARE)
        faults = [
            each
            for found in pool.map(lambda k: _faults(tmp_path, kind, k), firsts)
            for each in found
        ]
    assert not faults, "\n".join(faults)


def _faults(folder: Path, kind: str, first: int) -> list[str]:
    """What is wrong with the cases of one process."""
    own = folder / str(first)
    own.mkdir()
    ended = subprocess.run(
        [sys.executable, "-m", "tests.mutations", kind, str(first), str(first + SHARE)],
        cwd=own,
        env=_environment(),
        capture_output=True,
        text=True,
        timeout=3600,
        check=False,
    )
    rows = [json.loads(line) for line in ended.stdout.splitlines()]
    cases = [row for row in rows if "seed" in row]
    faults = [f"{kind} {row['seed']}: {row}" for row in cases if row["fault"]]
    if len(cases) < SHARE:
        faults.append(f"{kind} {first + len(cases)} ended the process: {ended.stderr[-500:]}")
    elif ended.stderr:
        faults.append(f"{kind} from {first}: a library wrote {ended.stderr[:500]}")
    peak = max(row.get("peak", 0) for row in rows) if rows else 0
    if peak > MOST_BYTES:
        faults.append(f"{kind} from {first}: {peak} bytes held")
    return faults


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}
