"""Whatever is given, a command ends in a sentence: no traceback, no exit 1."""

from pathlib import Path

import pytest

from tests.mutations import KINDS, fault, prepare

#: Cases of each kind by default.
FEW = {"yaml": 12, "log": 8, "options": 8}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("mutations")
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(made)
        prepare()
    return made


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param(kind, seed, marks=pytest.mark.long if seed >= few else ())
        for kind, few in FEW.items()
        for seed in range(1000)
    ],
)
def test_a_command_ends_in_a_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str, seed: int
) -> None:
    monkeypatch.chdir(folder)
    outcome = KINDS[kind](seed)
    assert not fault(outcome), outcome
