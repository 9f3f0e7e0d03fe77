"""One thread of linear algebra a worker, and no deadline for examples."""

import os
from pathlib import Path

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
