"""Columns of several axes in other units than said: what tells, which axis, and what helps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import identification as ident
from identification import Hardware, LogRefusedError, identify
from tests.planar import DAMPING, FRICTION, HARDWARE, MASS, motion


def _hardware(**given: object) -> Hardware:
    content = ident.load_mapping("hardware.yaml", HARDWARE) | given
    return ident.parse_document(Hardware, content, "hardware.yaml")


@pytest.mark.parametrize(("method", "gain"), [("auto", 0.5), ("least-squares", 1.1)])
def test_a_force_of_one_axis_in_another_unit_is_refused(method: ident.Method, gain: float) -> None:
    """The mass that couples x to y is 1 kg in the force of x, and the gain times that in y's."""
    log = motion(MASS, DAMPING, FRICTION, seed=1).log()
    x, y = log.axes
    wrong = replace(log, axes=(x, replace(y, force=gain * y.force)))
    with pytest.raises(LogRefusedError) as refused:
        identify(wrong, hardware=_hardware(), method=method)
    (found,) = (each for each in refused.value.findings if each.severity == "refusal")
    assert found.code == "force-unit"
    numbers = [float(word) for word in found.seen.split() if word[0].isdecimal()]
    assert np.allclose(numbers, (1.0, gain, 1 / gain), rtol=0.03)
    small, large = ("y", "x") if gain < 1 else ("x", "y")
    assert f"position of {small} reads" in found.remedy
    assert f"one of {large} as much too large" in found.remedy
