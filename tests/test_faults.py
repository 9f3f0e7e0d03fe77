"""The gate of faults does not rot: each fault stands in the tree, and so do its tests."""

import shlex
from collections import Counter

import pytest

from tests.faults import FAULTS, ROOT, Fault


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_stands_once_in_its_file(fault: Fault) -> None:
    assert (ROOT / fault.file).read_text(encoding="utf-8").count(fault.old) == 1
    assert fault.new != fault.old
    files = [word for word in shlex.split(fault.tests) if word.startswith("tests/")]
    assert files
    assert all((ROOT / name).is_file() for name in files)


def test_faults_have_names_of_their_own() -> None:
    assert set(Counter(fault.name for fault in FAULTS).values()) == {1}
    assert len(FAULTS) >= 60
