"""How much of the linear limit of a spring is proved when it is one-sided, over random devices."""

from __future__ import annotations

import numpy as np
import pytest

from tests.absolute_reference import Axis, least_eigenvalue
from tune.certificate.absolute import prove_absolute
from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import Setting
from tune.certificate.region import ModeRegion, Region
from tune.documents.effects import Effects
from tune.loop.loop import Loop
from tune.loop.mechanism import ModeNumbers
from tune.stability.absolute import absolute_gain
from tune.stability.multipliers import find_multiplier
from tune.stability.responses import Responses
from tune.stability.verdict import largest

_DEVICES = 100
_ONE = Effects(stiffness=1.0)
_SPRING = Setting(
    stiffness=1.0, damping=0.0, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
)


def _drawn(rng: np.random.Generator, kind: str) -> Axis:
    """A mass of one kilogram with 0 to 4 samples of delay; bT/m from 1e-4 to 10."""
    delay = float(rng.integers(4)) if rng.random() < 0.5 else float(rng.uniform(0, 4))
    top = 1.0 if kind == "rigid" else -0.3
    damping = 10 ** rng.uniform(-4, top) * 1e3
    lag = 10 ** rng.uniform(-4.5, -2) if kind == "lag" else 0.0
    mode = None
    if kind == "mode":
        mode = (10 ** rng.uniform(0.5, 2.6), 10 ** rng.uniform(-2.5, -0.3), rng.uniform(-1.5, 1.5))
    return Axis(mass=1.0, damping=damping, delay_samples=delay, lag=lag, mode=mode)


def _parts(axis: Axis) -> tuple[float, bool]:
    """(found over linear limit, whether 0.97 of what was found is proved); looked at densely."""
    modes = ()
    boxes = ()
    if axis.mode is not None:
        f, ratio, share = axis.mode
        modes = (ModeNumbers(frequency_hz=f, damping_ratio=ratio, at_encoder=share, at_handle=0.0),)
        boxes = (
            ModeRegion(
                frequency_hz=(f, f), damping_ratio=(ratio, ratio), at_encoder=share, at_handle=0.0
            ),
        )
    loop = Loop.from_numbers(
        mass=np.array([axis.mass]),
        damping=axis.damping,
        sample_time=axis.sample_time,
        delay_samples=axis.delay_samples,
        current_lag=axis.lag,
        modes=modes,
    )
    responses = Responses.of(loop)
    multiplier = find_multiplier(responses, _ONE)
    if multiplier is None:
        return 0.0, True
    found = float(absolute_gain(responses, _ONE, multiplier)[0])
    assert least_eigenvalue(axis, 0.998 * found, None, multiplier) > 0
    region = Region(
        mass=(axis.mass, axis.mass),
        damping=(axis.damping, axis.damping),
        sample_time=(axis.sample_time, axis.sample_time),
        delay=(axis.delay_samples * axis.sample_time, axis.delay_samples * axis.sample_time),
        current_lag=(axis.lag, axis.lag),
        modes=boxes,
    )
    claim = Claim(gain=0.97 * found, extra=0.0)
    proof = prove_absolute(region, _SPRING, None, multiplier, claim, 100_000)
    return found / float(largest(loop, "stiffness")[0]), proof.proved


@pytest.mark.long
def test_a_one_sided_spring_has_nearly_all_of_the_linear_limit() -> None:
    """Less where friction stops the device within a sample, and of lightly damped modes."""
    rng = np.random.default_rng(41)
    parts: dict[str, list[float]] = {"rigid": [], "lag": [], "mode": []}
    proved: list[bool] = []
    braked: list[bool] = []
    for _ in range(_DEVICES):
        for kind, found in parts.items():
            axis = _drawn(rng, kind)
            part, shown = _parts(axis)
            if kind == "rigid":
                braked.append(axis.damping * axis.sample_time > axis.mass)
            found.append(part)
            proved.append(shown)
    for kind, found in parts.items():
        low = np.quantile(found, [0.0, 0.01, 0.05, 0.1, 0.5])
        print(kind, np.round(low, 4), np.round(np.sort(found)[:8], 3))
    print("proved", np.mean(proved))
    assert np.max([np.max(found) for found in parts.values()]) < 1 + 1e-3
    assert np.min(np.array(parts["rigid"])[~np.array(braked)]) > 0.98
    assert np.min(parts["rigid"]) > 0.75
    assert np.min(parts["lag"]) > 0.98
    assert np.median(parts["mode"]) > 0.99
    assert np.mean(proved) > 0.99
