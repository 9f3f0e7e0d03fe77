"""Whatever the gains, ``haptune audit`` ends in a verdict or a sentence, and without warnings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from identification import load_device, named_devices
from tests.commands import haptune
from tests.thinned import thinned
from tune.documents.scene import Effects
from tune.judging import audit
from tune.loop.loop import Filters, Loop
from tune.stability.verdict import largest

EFFECTS = ("stiffness", "damping", "mass")


def _limits(name: str) -> dict[str, float]:
    """What each effect may be alone on the device at its best estimate; below zero all it has."""
    device = load_device(name)
    loop = Loop.from_parts(device, Filters())
    found = {effect: float(largest(loop, effect, Effects())) for effect in EFFECTS}
    return found | {"less damping": -device.damping.value, "less mass": -device.mass.value}


def _judged(name: str, gains: dict[str, float], filters: Filters | None = None) -> None:
    """An audit has an answer in numbers: safe with a certificate, or the faults."""
    found = audit(load_device(name), Effects(**gains), filters=filters)
    assert found.safe == (found.certificate is not None) == (not found.faults)
    assert found.gain >= 0
    assert (found.margins is None) == (found.gain <= 1)
    assert found.ripple is None or math.isfinite(found.ripple)
    if found.nearest is not None:
        assert all(np.isfinite(size) for size in found.nearest.arrays() if size is not None)


def _each(shares: list[float]) -> list[tuple[str, dict[str, float]]]:
    return [
        (name, {effect.removeprefix("less "): share * limit})
        for name in named_devices()
        for effect, limit in _limits(name).items()
        for share in shares
    ]


@pytest.mark.parametrize(("name", "gains"), [*_each([1.001]), *thinned(_each([0.5, 10.0]), 0)])
def test_every_named_device_is_judged_at_and_beyond_its_limit(
    name: str, gains: dict[str, float]
) -> None:
    _judged(name, gains)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--stiffness", "1e308"), "--stiffness: 1e+308 is beyond 1e-09 to 1e+09"),
        (("--damping", "-1e10"), "--damping: -1e+10 is beyond"),
        (("--mass", "1e-308"), "--mass: 1e-308 is beyond"),
        (("--mass", "1", "--velocity-filter", "1e-300"), "--velocity-filter: 1e-300 is beyond"),
        (("--mass", "1", "--acceleration-filter", "1e300"), "--acceleration-filter: 1e+300 is"),
    ],
)
def test_values_that_no_scene_holds_are_a_usage_error(options: tuple[str, ...], words: str) -> None:
    ended = haptune("audit", "homerehab", *options)
    assert ended.code == 2
    assert words in ended.err


def test_what_is_next_to_nothing_is_left_out_of_the_nearest() -> None:
    """Less than the least size that is looked at."""
    device = load_device("homerehab")
    found = audit(device, Effects(stiffness=2e-9, mass=1e7))
    assert found.nearest is not None
    stiffness, _, mass = found.nearest.arrays()
    assert stiffness == 0
    assert mass is not None
    assert mass > 0
