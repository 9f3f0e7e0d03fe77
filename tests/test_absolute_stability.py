"""One-sided, saturated and switched effects: found gains and their proof against other means.

One file: one condition, against a reference in many digits.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from identification import load_device, to_mapping
from tests.absolute_reference import Axis, least_eigenvalue, radius
from tune import Scene, optimise
from tune.certificate.absolute import multiplier_failure, open_device_failure, prove_absolute
from tune.certificate.branch_and_bound import Claim
from tune.certificate.check import check_content
from tune.certificate.point import Setting, setting_of
from tune.certificate.region import ModeRegion, Region, regions_of
from tune.certificate.switched import judge_switched
from tune.documents.certified import Multiplier, Tap
from tune.documents.effects import Effects
from tune.documents.errors import CheckFailedError
from tune.documents.profile import SafeProfile, digest_of
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.loop.mechanism import ModeNumbers
from tune.stability.absolute import absolute_gain, gain_slopes
from tune.stability.multipliers import find_multiplier
from tune.stability.responses import Responses
from tune.stability.verdict import largest

_CUTOFF = 72.55
_WALL = Effects(stiffness=1154.0, damping=82.0)
_NAMED = ("homerehab", "knob", "stylus", "emps")


def _homerehab(delay: float) -> Responses:
    loop = Loop.from_numbers(
        mass=np.array([3.0]),
        damping=10.0,
        sample_time=1e-3,
        delay_samples=delay,
        filters=Filters(velocity_filter_hz=_CUTOFF),
    )
    return Responses.of(loop)


def _region(delay: float, spread: float = 0.0) -> Region:
    return Region(
        mass=(3.0 * (1 - spread), 3.0 * (1 + spread)),
        damping=(10.0 * (1 - spread), 10.0 * (1 + spread)),
        sample_time=(1e-3, 1e-3),
        delay=(delay * 1e-3, delay * 1e-3),
    )


def _setting(effects: Effects) -> Setting:
    return Setting(
        stiffness=float(effects.stiffness or 0),  # type: ignore[arg-type]
        damping=float(effects.damping or 0),  # type: ignore[arg-type]
        mass=0.0,
        velocity_filter_hz=_CUTOFF,
        acceleration_filter_hz=None,
    )


def _multiplier(*taps: tuple[int, float], damping: float | None = None) -> Multiplier:
    return Multiplier(taps=tuple(Tap(samples=i, weight=w) for i, w in taps), damping=damping)


@pytest.mark.parametrize(("delay", "linear"), [(1, 6672.83), (2, 4005.77)])
def test_a_one_sided_spring_may_be_as_stiff_as_a_linear_one(delay: int, linear: float) -> None:
    one = Effects(stiffness=1.0)
    responses = _homerehab(delay)
    multiplier = find_multiplier(responses, one)
    assert multiplier is not None
    found = absolute_gain(responses, one, multiplier)[0]
    assert 0.995 * linear < found < linear * (1 + 1e-5)
    axis = Axis(mass=3.0, damping=10.0, delay_samples=delay)
    assert least_eigenvalue(axis, found * 0.9999, None, multiplier) > 0
    assert least_eigenvalue(axis, found * 1.001, None, multiplier) < 0


@pytest.mark.parametrize(
    ("delay", "one", "five", "best"), [(1, 3.14, 4.25, 4.29), (2, 1.62, 2.84, 2.86)]
)
def test_gains_with_switched_damping_are_those_of_the_eigenvalues(
    delay: int, one: float, five: float, best: float
) -> None:
    responses = _homerehab(delay)
    axis = Axis(mass=3.0, damping=10.0, delay_samples=delay)
    for samples, gain in ((1, one), (5, five)):
        # With a little of another tap: one of five samples alone vanishes at 2π/5.
        taps = {1: 0.01 * (samples > 1), samples: 1.0}
        tried = [
            _multiplier(*(tap for tap in taps.items() if tap[1]), damping=samples * x)
            for x in (0.98, 1.0, 1.02)
        ]
        gains = [absolute_gain(responses, _WALL, each)[0] for each in tried]
        assert max(gains) == pytest.approx(gain, rel=0.006)
    multiplier = find_multiplier(responses, _WALL)
    assert multiplier is not None
    found = absolute_gain(responses, _WALL, multiplier)[0]
    assert 0.99 * best < found < best + 0.005
    for part, sign in ((0.999, 1), (1.002, -1)):
        sizes = 1154.0 * found * part, 82.0 * found * part
        assert sign * least_eigenvalue(axis, *sizes, multiplier, _CUTOFF) > 0


def test_a_device_that_pushes_away_meets_the_condition_and_is_unstable() -> None:
    """The condition alone proves nothing: the open device has to be stable but for one pole."""
    axis = Axis(mass=3.0, damping=10.0, own_stiffness=-500.0)
    constant = Multiplier(constant=1.0)
    assert pytest.approx(least_eigenvalue(axis, 300.0, None, constant), rel=0.05) == 300.0 * 0.0013
    assert radius(axis, 300.0) == pytest.approx(1.0067, abs=1e-4)
    device = load_device("homerehab").model_copy(
        update={
            "position_stiffness": load_device("homerehab").mass.model_copy(
                update={"value": -500.0, "low": -510.0, "high": -490.0}
            )
        }
    )
    scene = Scene.model_validate({"elements": {"wall": {"stiffness": 300.0, "one_sided": True}}})
    with pytest.raises(Exception, match="position_stiffness"):
        optimise(device, scene)


def test_damping_of_device_and_modes_is_what_keeps_the_open_device_stable() -> None:
    assert open_device_failure(_region(1)) is None
    idle = Region(mass=(3, 3), damping=(0, 1), sample_time=(1e-3, 1e-3), delay=(0, 0))
    assert "no damping" in str(open_device_failure(idle))
    mode = ModeRegion(frequency_hz=(80, 90), damping_ratio=(0, 0.1), at_encoder=1, at_handle=1)
    ringing = Region(
        mass=(3, 3), damping=(1, 1), sample_time=(1e-3, 1e-3), delay=(0, 0), modes=(mode,)
    )
    assert "mode" in str(open_device_failure(ringing))


@pytest.mark.parametrize(("delay", "gain"), [(1, 4.2), (2, 2.8)])
def test_the_wall_of_the_study_is_proved(delay: int, gain: float) -> None:
    multiplier = find_multiplier(_homerehab(delay), _WALL)
    assert multiplier is not None
    region, setting = _region(delay), _setting(_WALL)
    assert prove_absolute(region, setting, None, multiplier, Claim(gain=gain, extra=0), 5000).proved
    more = Claim(gain=gain * 1.03, extra=0)
    assert not prove_absolute(region, setting, None, multiplier, more, 5000).proved


def test_a_box_with_an_extra_sample_is_proved_close_to_what_its_corners_allow() -> None:
    loop = Loop.from_numbers(
        mass=np.array([2.7, 2.7, 3.3, 3.3]),
        damping=np.array([9.0, 11.0, 9.0, 11.0]),
        sample_time=1e-3,
        delay_samples=2.0,
        filters=Filters(velocity_filter_hz=_CUTOFF),
    )
    responses = Responses.of(loop)
    for effects in (_WALL, Effects(stiffness=1154.0)):
        multiplier = find_multiplier(responses, effects)
        assert multiplier is not None
        gain = float(np.min(absolute_gain(responses, effects, multiplier)))
        claim = Claim(gain=0.99 * gain, extra=1.0)
        region = _region(1, spread=0.1)
        assert prove_absolute(region, _setting(effects), None, multiplier, claim, 20_000).proved


@pytest.mark.parametrize("name", _NAMED)
def test_springs_of_named_devices_reach_the_linear_limit_and_are_proved(name: str) -> None:
    device = load_device(name)
    mass, damping, step = device.mass.value, device.damping.value, device.sample_time.value
    one = Effects(stiffness=1.0)
    for delay in range(4):
        loop = Loop.from_numbers(
            mass=np.array([mass]), damping=damping, sample_time=step, delay_samples=delay
        )
        responses = Responses.of(loop)
        multiplier = find_multiplier(responses, one)
        assert multiplier is not None
        linear = float(largest(loop, "stiffness")[0])
        found = float(absolute_gain(responses, one, multiplier)[0])
        assert 0.993 * linear < found < linear * (1 + 1e-4)
        region = Region(
            mass=(mass, mass),
            damping=(damping, damping),
            sample_time=(step, step),
            delay=(delay * step, delay * step),
        )
        claim = Claim(gain=0.99 * linear, extra=0.0)
        assert prove_absolute(region, _setting(one), None, multiplier, claim, 20_000).proved


def test_slopes_are_those_of_differences_and_sum_to_minus_one() -> None:
    responses = _homerehab(1)
    multiplier = _multiplier((3, 0.6), (5, 0.4), damping=3.7)
    base = gain_slopes(responses, _WALL, multiplier)
    step = 1e-5
    for place, name in enumerate(("stiffness", "damping")):
        larger = Effects(
            **{
                each: getattr(_WALL, each) * (1 + step * (each == name))
                for each in ("stiffness", "damping")
            }
        )
        change = np.log(gain_slopes(responses, larger, multiplier).gain / base.gain) / step
        np.testing.assert_allclose(base.slopes[place], change, atol=2e-3)
    np.testing.assert_allclose(base.slopes.sum(axis=0), -1, rtol=1e-9)


def test_a_mode_asks_for_its_own_multiplier_and_is_judged_alike() -> None:
    """A vibration mode, a lag and part of a sample of delay beside the rigid mass."""
    axis = Axis(mass=1.0, damping=5.0, delay_samples=1.4, lag=4e-4, mode=(60.0, 0.05, 0.6))
    loop = Loop.from_numbers(
        mass=np.array([1.0]),
        damping=5.0,
        sample_time=1e-3,
        delay_samples=1.4,
        current_lag=4e-4,
        modes=(ModeNumbers(frequency_hz=60.0, damping_ratio=0.05, at_encoder=0.6, at_handle=0.0),),
        filters=Filters(velocity_filter_hz=_CUTOFF),
    )
    responses = Responses.of(loop)
    for effects in (Effects(stiffness=100.0), Effects(stiffness=100.0, damping=5.0)):
        multiplier = find_multiplier(responses, effects)
        assert multiplier is not None
        gain = float(absolute_gain(responses, effects, multiplier)[0])
        damping = None if effects.damping is None else 5.0 * gain
        assert least_eigenvalue(axis, 99.9 * gain, damping, multiplier, _CUTOFF) > 0
        assert least_eigenvalue(axis, 100.3 * gain, damping, multiplier, _CUTOFF) < 0


def test_a_multiplier_of_the_wrong_kind_is_refused() -> None:
    region, setting = _region(1), _setting(_WALL)
    assert "without a constant" in str(
        multiplier_failure(region, setting, Multiplier(constant=1.0, damping=1.0))
    )
    assert "nothing" in str(multiplier_failure(region, setting, Multiplier()))
    assert "no constant for the damping" in str(
        multiplier_failure(region, setting, _multiplier((1, 1.0)))
    )


@pytest.fixture(scope="module")
def walled() -> SafeProfile:
    elements = {"wall": {"stiffness": "max", "damping": "max", "one_sided": True}}
    loop = {"velocity_filter_hz": 72.55}
    scene = {"elements": elements, "loop": loop, "margin": "balanced"}
    return optimise(load_device("homerehab"), Scene.model_validate(scene))


def test_a_wall_is_certified_with_its_multiplier(walled: SafeProfile) -> None:
    proved = (walled.certificate.absolute_stability or {})["wall"]
    assert proved.gain == walled.elements["wall"].margins.absolute_gain
    assert proved.gain >= 2
    assert proved.free is not None
    assert proved.held is None
    assert len(proved.covers) == 2
    assert not any("bounce" in words for words in walled.certificate.not_assessed)
    assert check_content(to_mapping(walled), "profile.yaml").profile == walled


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"gain": 12.0}, "could not be shown"),
        ({"gain": 1.5}, "the margin asks for"),
        ({"extra_delay_samples": 0.0}, "the margin asks for"),
        ({"free": _multiplier((1, 1.0), damping=400.0)}, "could not be shown"),
        ({"free": _multiplier((1, 1.0))}, "no constant for the damping"),
        ({"free": None}, "no multiplier is stated"),
        ({"free": Multiplier(constant=0.1, damping=1.0)}, "without a constant"),
        (None, "no multiplier is stated"),
    ],
)
def test_forged_multipliers_prove_nothing(
    walled: SafeProfile,
    change: dict[str, object] | None,
    sentence: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tune.certificate.switched._MOST_CELLS", 5000)
    stated = walled.certificate.absolute_stability or {}
    forged = {} if change is None else {"wall": stated["wall"].model_copy(update=change)}
    setting = setting_of(walled, ("wall",))
    assert setting is not None
    outcome = judge_switched(walled, ("wall",), setting, regions_of(walled), forged)
    assert outcome.proved is None
    assert sentence in str(outcome.failure)


def test_a_claimed_absolute_gain_is_that_of_the_certificate(walled: SafeProfile) -> None:
    content = to_mapping(walled)
    content["elements"]["wall"]["margins"]["absolute_gain"] += 0.5
    content["digest"] = digest_of(content)
    with pytest.raises(CheckFailedError, match="absolute_gain says"):
        check_content(content, "profile.yaml")


@pytest.mark.long
def test_a_one_sided_spring_loads_no_solver() -> None:
    code = (
        "import sys\n"
        "from identification import load_device\n"
        "from tune import Scene, optimise\n"
        "wall = {'stiffness': 'max', 'one_sided': True, 'penetration': 0.001}\n"
        "scene = {'elements': {'wall': wall}, 'margin': 'conservative'}\n"
        "profile = optimise(load_device('homerehab'), Scene.model_validate(scene))\n"
        "wall = profile.elements['wall']\n"
        "assert wall.limited_by == {'stiffness': 'saturation'}, wall.limited_by\n"
        "assert wall.margins.absolute_gain == 3.0\n"
        "bad = [n for n in ('casadi', 'nlopt', 'scipy.optimize', 'scipy.signal')"
        " if n in sys.modules]\n"
        "sys.exit(', '.join(bad) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
