"""One thread of linear algebra a worker, and no deadline for examples."""

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Time is measured where it is asked for; a busy machine is no failure.
settings.register_profile("haptune", deadline=None)
settings.load_profile("haptune")

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unrehearsed(monkeypatch: pytest.MonkeyPatch) -> None:
    """`haptune tune` takes it for granted that what it tunes settles."""
    monkeypatch.setattr("tune.cli.settling.refuse_restless", lambda *_: None)


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreign parsers read here, unless ``monkeypatch.undo()`` gives them their own process."""

    def read(reader: str, *given: Any) -> Any:
        module, _, function = reader.partition(".")
        return getattr(import_module(f"identification.readers.{module}"), function)(*given)

    monkeypatch.setattr("identification.readers.read_isolated", read)
