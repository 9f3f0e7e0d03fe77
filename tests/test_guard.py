"""The C guard, compiled: the certified law to its last digits, and no force without it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from datasets_synthetic import Controller
from datasets_synthetic.law import ControlLaw
from tests.exported import LOOPS, STEP, Array, changed, poles, tuned
from tests.guard import FLAGS, Guard, built, compiler, compiles, enter, push, write
from tests.unlimited import BOUNDLESS
from tune import SafeProfile
from tune.exporters import export

WALL, CUP, RUBBER = 1, 2, 4


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Guard:
    return built(export(tuned(), "c"), tmp_path_factory.mktemp("guard"))


def movement(samples: int = 400) -> Array:
    """A hand that enters 5 mm deep and trembles, read by an encoder of 6 µm."""
    time = np.arange(samples) * STEP
    smooth = 0.005 * np.sin(2 * np.pi * 1.7 * time) + 2e-4 * np.sin(2 * np.pi * 31 * time)
    return np.round((0.004 + smooth) / 6e-6) * 6e-6


def forces(profile: SafeProfile, name: str, place: Array, rest: float) -> Array:
    """Force of one element from transfer functions, starting from rest at the first reading."""
    loop, element = profile.loop, profile.elements[name]
    ratio, span = loop.filter_damping_ratio, loop.velocity_window_samples or 1
    before = np.concatenate([np.full(span, place[0]), place])
    slow = (place - before[: place.size]) / (span * STEP)
    slope = np.diff(place, prepend=place[0]) / STEP

    def low_pass(below: Array, values: Array) -> Array:
        return np.asarray(lfilter([below.sum()], below, values))

    velocity = low_pass(poles(loop.velocity_filter_hz, loop.velocity_filter_order, ratio), slow)
    acceleration = low_pass(
        poles(loop.acceleration_filter_hz, loop.acceleration_filter_order, ratio),
        np.diff(slope, prepend=0.0) / STEP,
    )
    return -(
        element.stiffness * (place - rest)
        + element.damping * velocity
        + element.mass * acceleration
    )


@pytest.mark.parametrize("name", LOOPS)
def test_the_guard_runs_the_certified_law(tmp_path: Path, name: str) -> None:
    profile = changed(**LOOPS[name])
    device = profile.device.model_copy(update={"force_limit": BOUNDLESS})
    profile = profile.model_copy(update={"device": device})
    guard = built(export(profile, "c"), tmp_path)
    place = movement()
    both = WALL | CUP
    calls = [enter(both, 0, float(place[0]), 0.001)]
    calls += [push(both, k, float(x)) for k, x in enumerate(place)]
    replies = guard.run(calls)[1:]
    assert {(reply.status, reply.missed, reply.clamped) for reply in replies} == {("OK", 0, False)}
    found = np.array([reply.force for reply in replies])

    wanted = forces(profile, "wall", place, 0.001) + forces(profile, "cup", place, 0.001)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())

    loop = profile.loop
    law = ControlLaw(
        Controller(
            stiffness=500.0,
            damping=10.0,
            mass=profile.elements["cup"].mass,
            velocity_filter_hz=loop.velocity_filter_hz or np.inf,
            acceleration_filter_hz=loop.acceleration_filter_hz or np.inf,
            velocity_filter_order=loop.velocity_filter_order,
            acceleration_filter_order=loop.acceleration_filter_order,
            filter_damping_ratio=loop.filter_damping_ratio,
            velocity_window_samples=loop.velocity_window_samples or 1,
        ),
        np.array([STEP]),
    )
    simulated = np.array([law.force(np.array([x]))[0] for x in place]) + 500.0 * 0.001
    np.testing.assert_allclose(found, simulated, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_filters_start_from_rest_on_contact_and_each_element_on_its_own(guard: Guard) -> None:
    place = movement(60)
    calls = [enter(CUP, 0, float(place[0]))]
    calls += [push(CUP, k, float(place[k])) for k in range(30)]
    calls += [enter(WALL, 30, float(place[30]), 0.002)]
    calls += [push(WALL | CUP, k, float(place[k])) for k in range(30, 60)]
    found = [
        reply.force for call, reply in zip(calls, guard.run(calls), strict=True) if call.kind == "F"
    ]
    wanted = forces(tuned(), "cup", place, 0.0)
    wanted[30:] += forces(tuned(), "wall", place[30:], 0.002)
    assert abs(wanted).max() < 28.0
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * abs(wanted).max())
    # 0.1 mm into a spring of 500 N/m: neither B/T nor M/T² of the way there is in the first force.
    replies = guard.run([enter(WALL | CUP, 7, 0.0001), push(WALL | CUP, 7, 0.0001)])
    assert replies[1].force == pytest.approx(-0.05, rel=1e-12)


def test_the_gain_scales_and_the_peak_clamps(guard: Guard) -> None:
    replies = guard.run(
        [
            enter(RUBBER, 5, 0.01),
            push(RUBBER, 5, 0.01),
            push(RUBBER, 6, 0.01, 0.25),
            push(RUBBER, 7, 0.01, 0.0),
            push(RUBBER, 8, 1.0),
            push(RUBBER, 9, -1.0),
            push(RUBBER, 10, 1.0, 0.01),
            push(0, 11, 1.0),
        ]
    )[1:]
    assert [reply.force for reply in replies] == pytest.approx([-7, -1.75, 0, -28, 28, -7, 0])
    assert [reply.clamped for reply in replies] == [False, False, False, True, True, False, False]
    assert {reply.status for reply in replies} == {"OK"}


@pytest.mark.parametrize(
    ("elements", "period", "position", "gain", "status"),
    [
        (WALL | RUBBER, 5, 0.001, 1.0, "NOT_TOGETHER"),
        (WALL | CUP | RUBBER, 5, 0.001, 1.0, "NOT_TOGETHER"),
        (8, 5, 0.001, 1.0, "NOT_TOGETHER"),
        (WALL | 1 << 63, 5, 0.001, 1.0, "NOT_TOGETHER"),
        (RUBBER, 5, 0.001, 1.0, "NOT_ENTERED"),
        (WALL, 5, float("nan"), 1.0, "NOT_FINITE"),
        (WALL, 5, float("-inf"), 1.0, "NOT_FINITE"),
        (WALL, 5, 1e308, 1.0, "NOT_FINITE"),
        (WALL, 5, 0.001, float("nan"), "BAD_GAIN"),
        (WALL, 5, 0.001, 1.0000001, "BAD_GAIN"),
        (WALL, 5, 0.001, -0.1, "BAD_GAIN"),
        (WALL, 4, 0.001, 1.0, "STALE"),
        (WALL, 3, 0.001, 1.0, "LATE"),
        (WALL, 7, 0.001, 1.0, "LATE"),
    ],
)
def test_whatever_is_not_certified_gives_no_force_and_a_reason(
    guard: Guard, elements: int, period: int, position: float, gain: float, status: str
) -> None:
    good = [enter(WALL | CUP, 4, 0.001), push(WALL | CUP, 4, 0.001)]
    replies = guard.run([*good, push(elements, period, position, gain)])
    assert replies[1].force == -0.5
    assert (replies[2].status, replies[2].force) == (status, 0.0)


def test_a_missed_period_is_bridged_and_two_end_the_contact(guard: Guard) -> None:
    assert tuned().certificate.extra_delay_samples == 1
    line = [0.0001 * k for k in range(9)]
    seen = [0, 1, 2, 3, 5, 6, 8]
    calls = [enter(WALL, 0, line[0]), *(push(WALL, k, line[k]) for k in seen)]
    replies = guard.run(calls)[1:]
    wanted = forces(tuned(), "wall", np.array(line), 0.0)[seen]
    assert [reply.force for reply in replies] == pytest.approx(list(wanted), rel=1e-12)
    assert replies[-1].missed == 2

    # A reading that is no number, or seen before, is a missed period too.
    for bad in (push(WALL, 4, float("nan")), push(WALL, 3, line[3])):
        calls[1:] = [push(WALL, k, line[k]) for k in (0, 1, 2, 3)] + [bad]
        calls.append(push(WALL, 5, line[5]))
        replies = guard.run(calls)
        assert replies[-2].force == 0.0
        assert replies[-1].force == pytest.approx(wanted[4], rel=1e-12)
        calls += [push(WALL, 8, line[8]), push(WALL, 9, line[8])]
        calls += [enter(WALL, 10, line[8]), push(WALL, 10, line[8])]
        replies = guard.run(calls)
        assert [r.status for r in replies[-4:]] == ["LATE", "NOT_ENTERED", "OK", "OK"]
        assert [r.force for r in replies[-4:]] == pytest.approx([0, 0, 0, -500 * line[8]])


def test_periods_may_wrap_and_a_contact_may_not_begin_without_a_position(guard: Guard) -> None:
    last = 2**32 - 1
    replies = guard.run([enter(WALL, last, 0.001), push(WALL, last, 0.001), push(WALL, 0, 0.001)])
    assert [reply.status for reply in replies] == ["OK"] * 3
    assert replies[-1].force == -0.5
    for position, rest in ((float("nan"), 0.0), (0.0, float("inf"))):
        replies = guard.run(
            [enter(WALL, 0, 0.0), enter(WALL, 1, position, rest), push(WALL, 1, 0.001)]
        )
        assert [reply.status for reply in replies] == ["OK", "NOT_FINITE", "NOT_ENTERED"]
    assert guard.run([enter(8, 0, 0.0)])[0].status == "NOT_TOGETHER"


def test_files_of_two_profiles_and_fast_math_do_not_compile(tmp_path: Path) -> None:
    write(export(tuned(), "c"), tmp_path)
    assert compiles(tmp_path) == ""
    assert "-ffast-math" in compiles(tmp_path, "-ffast-math")
    other = export(tuned().model_copy(update={"digest": "sha256:" + "12" * 32}), "c")
    write({"haptune_guard.h": other["haptune_guard.h"]}, tmp_path)
    assert "another profile" in compiles(tmp_path)


AXIS = """\
#define HAPTUNE_API static
#include "haptune_guard.c"
double NAME(double position);
double NAME(double position)
{
    haptune_guard guard;
    haptune_init(&guard);
    haptune_reset(&guard, HAPTUNE_ELEMENT_WALL, 0, position, 0.0);
    return haptune_force(&guard, HAPTUNE_ELEMENT_WALL, 0, position, 1.0);
}
"""


TWO_AXES = """\
#include <stdio.h>
double x_axis(double position);
double y_axis(double position);
int main(void)
{
    return printf("%g %g\\n", x_axis(0.001), y_axis(0.001)) < 0;
}
"""


def test_two_axes_live_in_one_program(tmp_path: Path) -> None:
    soft = tuned().elements["wall"].model_copy(update={"stiffness": 100.0})
    other = tuned().model_copy(update={"elements": {**tuned().elements, "wall": soft}})
    for name, profile in (("x_axis", tuned()), ("y_axis", other)):
        (tmp_path / name).mkdir()
        write(export(profile, "c"), tmp_path / name)
        write({f"{name}.c": AXIS.replace("NAME", name)}, tmp_path / name)
    write({"main.c": TWO_AXES}, tmp_path)
    sources = ["main.c", "x_axis/x_axis.c", "y_axis/y_axis.c"]
    cc = compiler("cc", "gcc", "clang")
    subprocess.run([cc, *FLAGS, *sources, "-o", "both"], cwd=tmp_path, check=True)
    told = subprocess.run([tmp_path / "both"], capture_output=True, text=True, check=True).stdout
    assert told == "-0.5 -0.1\n"
