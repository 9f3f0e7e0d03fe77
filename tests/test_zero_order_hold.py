"""Held inputs, exact responses and rows against event by event integration in 50 digits."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from identification import Trajectory
from identification.estimators.signals import (
    FIRST,
    LAST,
    LOST,
    Commands,
    HeldColumn,
    HeldResponse,
    Kinematics,
    Signals,
    of_rows,
    phi,
    unknown_intervals,
)
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 1e-3
SAMPLES = 40
#: Even steps, and uneven ones, none so long that a row would count as lost.
GRIDS: dict[str, float | Array] = {
    "even": STEP,
    "uneven": np.random.default_rng(0).choice([0.7e-3, 1e-3, 1.1e-3, 1.4e-3], SAMPLES - 1),
}
#: None, a part of a step, a whole step, and longer than most steps.
DELAYS = [0.0, 0.4e-3, 1e-3, 1.7e-3, 3.4e-3]
#: Difference of the 50-digit derivatives: its error is its square, 1e-30.
NUDGE = "1e-15"


def stamps(steps: float | Array) -> Array:
    even = np.broadcast_to(np.asarray(steps, dtype=np.float64), (SAMPLES - 1,))
    return np.concatenate(([0.0], np.cumsum(even)))


def integrated(time: Array, force: Array, rate: Any, delay: Any) -> tuple[list[Any], list[Any]]:
    """Position and velocity at every stamp of q̈ + p·q̇ = F(t - delay), from event to event."""
    stamp = [mpmath.mpf(float(each)) for each in time]
    events = sorted({*stamp, *(t + delay for t in stamp if 0 < t + delay < stamp[-1])})
    place = speed = mpmath.mpf(0)
    places, speeds = [place], [speed]
    for start, end in pairwise(events):
        middle = (start + end) / 2 - delay
        row = max(sum(1 for t in stamp if t <= middle) - 1, 0)
        push, span = mpmath.mpf(float(force[row])), end - start
        kept = mpmath.exp(-rate * span)
        reach = -mpmath.expm1(-rate * span) / rate
        place += reach * speed + push * (span - reach) / rate
        speed = kept * speed + push * reach
        if end in stamp:
            places.append(place)
            speeds.append(speed)
    return places, speeds


def close(found: Array, truth: list[Any], relative: float) -> None:
    exact = np.array([float(each) for each in truth])
    np.testing.assert_allclose(found, exact, rtol=0, atol=relative * np.abs(exact).max())


@pytest.mark.parametrize(
    "delta", [0.0, 1e-300, 1e-12, -1e-5, 0.03, 0.499, 0.501, -0.499, -0.6, 3.0, 40.0, -12.0]
)
def test_phi_to_the_last_bits(delta: float) -> None:
    found = phi(delta)
    for order, got in enumerate(found, 1):
        # ∫₀¹ e^(-δs)·(1-s)^(order-1)/(order-1)! ds by its power series, which divides by nothing.
        with mpmath.workdps(80):
            exact: Any = mpmath.fsum(
                mpmath.mpf(-delta) ** k / mpmath.factorial(k + order) for k in range(250)
            )
        # Beyond the series each order divides what the one before has left by δ.
        assert float(got) == pytest.approx(float(exact), rel=4e-15 if abs(delta) < 0.5 else 2e-14)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("rate", thinned([3.7, -2.0, 400.0], 1))
def test_responses_and_slopes_are_exact(grid: str, delay: float, rate: float) -> None:
    steps = GRIDS[grid]
    force = np.random.default_rng(1).standard_normal(SAMPLES)
    device = HeldResponse.at(rate, steps)
    held = Commands.of(force, steps).after(delay)
    place, speed = device.position(device.gain(held))
    by_rate = device.position_slope(speed, device.slope_by_rate(held))
    by_delay = device.position(device.slope_by_delay(held, float(force[0])))[0]
    with mpmath.workdps(50):
        p, d, h = mpmath.mpf(rate), mpmath.mpf(delay), mpmath.mpf(NUDGE)
        # Rounding of a running sum would put commands beside the stamps they arrive at.
        even = np.arange(SAMPLES) * np.float64(STEP)
        time = even if grid == "even" else stamps(steps)

        def places(rate: Any, delay: Any) -> list[Any]:
            return integrated(time, force, rate, delay)[0]

        def slope(above: list[Any], below: list[Any]) -> list[Any]:
            return [(a - b) / (2 * h) for a, b in zip(above, below, strict=True)]

        truth = integrated(time, force, p, d)
        close(place, truth[0], 1e-12)
        close(speed, truth[1], 1e-12)
        close(by_rate, slope(places(p + h, d), places(p - h, d)), 1e-11)
        # Commands that arrive at a stamp move neither position nor its slope there.
        close(by_delay, slope(places(p, d + h), places(p, d - h)), 1e-10)


@pytest.mark.parametrize("grid", GRIDS)
def test_turns_inside_intervals_are_exact(grid: str) -> None:
    steps = GRIDS[grid]
    generator = np.random.default_rng(2)
    early, late = generator.standard_normal((2, SAMPLES - 1))
    fraction = np.append(generator.uniform(0, 1, SAMPLES - 3), (0.0, 1.0))
    held = HeldColumn.turning(early, late, fraction, steps)
    lengths = np.diff(stamps(steps))
    device = HeldResponse.at(4.0, steps)
    place, speed = device.position(device.gain(held), start=0.3)
    means, areas = [], []
    at, rate = mpmath.mpf(0), mpmath.mpf("0.3")
    with mpmath.workdps(30):
        for k in range(SAMPLES - 1):
            spans = (lengths[k] * fraction[k], lengths[k] * (1 - fraction[k]))
            for push, span in zip((early[k], late[k]), spans, strict=True):
                reach = -mpmath.expm1(-4 * mpmath.mpf(span)) / 4
                at += reach * rate + push * (span - reach) / 4
                rate += (push - 4 * rate) * reach
            assert place[k + 1] == pytest.approx(float(at), rel=1e-12, abs=1e-18)
            assert speed[k + 1] == pytest.approx(float(rate), rel=1e-12)
            means.append((early[k] * spans[0] + late[k] * spans[1]) / lengths[k])
            # Area under the column times the part of the interval that has passed.
            split = fraction[k]
            areas.append(lengths[k] * (early[k] * split**2 + late[k] * (1 - split**2)) / 2)
    np.testing.assert_allclose(held.mean(), means, rtol=1e-12, atol=1e-15)
    mean, rising = np.array(means), np.array(areas)
    falling = mean * lengths - rising
    triangle = (falling[1:] + rising[:-1]) / lengths.mean()
    np.testing.assert_allclose(held.triangle(), triangle, rtol=1e-11, atol=1e-15)


def test_times_keeps_the_column() -> None:
    force = np.random.default_rng(3).standard_normal(SAMPLES)
    factor = np.random.default_rng(4).standard_normal(SAMPLES - 1)
    for steps in GRIDS.values():
        held = Commands.of(force, steps).after(1.7e-3)
        np.testing.assert_allclose(held.times(factor).mean(), factor * held.mean(), rtol=1e-13)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("delay", DELAYS)
def test_intervals_are_known_once_every_force_is_logged(grid: str, delay: float) -> None:
    steps = GRIDS[grid]
    first = unknown_intervals(steps, delay)
    generator = np.random.default_rng(5)
    force = generator.standard_normal(SAMPLES)
    time = stamps(steps)
    # Before the log another force acted: only intervals before ``first`` may feel it.
    earlier = np.concatenate((time[:1] - 5 * STEP, time))
    with mpmath.workdps(30):
        rate, late = mpmath.mpf(1), mpmath.mpf(delay)
        runs = [
            integrated(earlier, np.concatenate(([before], force)), rate, late)[1][1:]
            for before in (0.0, 1.0)
        ]
        gained = [
            [
                b - a * mpmath.exp(a_t - b_t)
                for a, b, a_t, b_t in zip(run[:-1], run[1:], time[:-1], time[1:], strict=True)
            ]
            for run in runs
        ]
    differs = [abs(x - y) > 1e-18 for x, y in zip(*gained, strict=True)]
    assert not any(differs[first:])
    assert sum(differs) >= first - 1


def test_lost_rows_lie_on_the_line_between_their_neighbours() -> None:
    """A ramp survives the loss of any rows; what is left of it acts as if all were there."""
    whole = np.arange(60) * np.float64(0.5)
    kept = np.ones(60, dtype=bool)
    kept[[7, 20, 21, 22, 41]] = False
    time = np.arange(60) * np.float64(STEP)
    commands = Commands.of(whole[kept], np.diff(time[kept]))
    np.testing.assert_allclose(commands.value, whole, rtol=1e-12)
    assert commands.sent is not None
    np.testing.assert_allclose(commands.sent, time, atol=1e-15)
    full = Commands.of(whole, STEP).after(0.4e-3).mean()
    gapped = commands.after(0.4e-3).mean()
    starts = np.flatnonzero(kept)
    expected = [full[a:b].mean() for a, b in pairwise(starts.tolist())]
    np.testing.assert_allclose(gapped, expected, rtol=1e-12)
    assert LOST * STEP < 2 * STEP


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("delay", DELAYS)
def test_rows_are_exact_for_a_pure_mass(grid: str, delay: float) -> None:
    """Difference of slopes against area under a triangle, wherever the force jumps."""
    steps = GRIDS[grid]
    force = np.random.default_rng(6).standard_normal(SAMPLES)
    with mpmath.workdps(40):
        # A rate this small acts as none.
        place = integrated(stamps(steps), force, mpmath.mpf("1e-20"), mpmath.mpf(delay))[0]
        exact = np.array([float(each) for each in place])
    rows = Kinematics.of(exact, steps)
    held = of_rows(Commands.of(force, steps).after(delay).triangle())
    # Rounding of position over the square of a step.
    rounding = 8 * np.spacing(np.abs(exact).max()) / np.min(steps) ** 2
    np.testing.assert_allclose(rows.acceleration, held, rtol=0, atol=rounding)


@pytest.mark.parametrize(
    ("grid", "power"), [("even", 1), ("even", 2), ("even", 3), ("uneven", 1), ("uneven", 2)]
)
def test_rows_of_velocity_are_exact_for_polynomials(grid: str, power: int) -> None:
    steps = GRIDS[grid]
    time = stamps(steps)
    step = float(np.mean(steps))
    rows = Kinematics.of(time**power, steps)
    # ∫ triangle·d(t^n)/dt by parts: difference of the mean of t^n over two intervals.
    area = time ** (power + 1) / (power + 1)
    means = np.diff(area) / np.diff(time)
    truth = of_rows(np.diff(means)) / step
    np.testing.assert_allclose(rows.velocity, truth, rtol=1e-9)
    curved = of_rows(np.diff(np.diff(time**power) / np.diff(time))) / step
    np.testing.assert_allclose(rows.acceleration, curved, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("grid", "order", "part"), [("even", 4, 0.02), ("uneven", 2, 0.02)])
def test_rows_of_velocity_err_by_a_high_power_of_the_step(
    grid: str, order: int, part: float
) -> None:
    """For e^(st): an error of part·(sT)^order, whose order shows when all steps are halved."""
    errors = []
    for scale in (1.0, 0.5):
        steps = GRIDS[grid]
        finer = scale * np.asarray(steps) if isinstance(steps, np.ndarray) else scale * steps
        time = stamps(finer)
        rate = 40.0
        means = np.diff(np.exp(rate * time)) / rate / np.diff(time)
        truth = of_rows(np.diff(means)) / float(np.mean(finer))
        found = Kinematics.of(np.exp(rate * time), finer).velocity
        errors.append(float(np.max(np.abs(found / truth - 1))))
    assert errors[0] < part * (40.0 * STEP) ** order
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


def test_lost_at_both_ends_is_what_the_rows_cannot_read() -> None:
    rows = Kinematics.of(np.arange(50.0), STEP)
    assert rows.velocity.size == 50 - FIRST - LAST
    np.testing.assert_allclose(rows.velocity, 1 / STEP)


@pytest.mark.parametrize("steps", ["even", "uneven", "lost"])
def test_a_part_of_a_log_is_as_if_no_more_had_been_logged(steps: str) -> None:
    """A long log is begun with its first samples."""
    generator, samples, kept = np.random.default_rng(1), 300, 250
    lengths = np.full(samples - 1, STEP)
    if steps != "even":
        lengths *= generator.uniform(0.8, 1.2, samples - 1)
    lengths[[5, 280]] *= 3.0 if steps == "lost" else 1.0
    time = np.concatenate(([0.0], np.cumsum(lengths)))
    force, position, reference = generator.standard_normal((3, samples))
    log = Trajectory(time=time, force=force, position=position, reference=reference)
    part, alone = Signals.of(log).part(kept), Signals.of(log.part(slice(kept)))
    np.testing.assert_allclose(part.steps, alone.steps, rtol=1e-12)
    np.testing.assert_array_equal(part.position, alone.position)
    assert part.reference is not None
    np.testing.assert_array_equal(part.reference, alone.reference)
    np.testing.assert_allclose(part.speed, alone.speed, rtol=1e-9)
    for delay in DELAYS:
        found, truth = part.commands.after(delay), alone.commands.after(delay)
        np.testing.assert_allclose(found.triangle(), truth.triangle(), atol=1e-9)
    scale = np.max(np.abs(alone.kinematics.acceleration))
    for name in ("acceleration", "velocity"):
        seen, expected = getattr(part.kinematics, name), getattr(alone.kinematics, name)
        np.testing.assert_allclose(seen, expected, atol=1e-9 * scale)
