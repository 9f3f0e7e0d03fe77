"""Estimators against closed forms, exact and independent simulation, and their invariances."""

from __future__ import annotations

from functools import cache
from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import Trajectory
from identification.estimators import ESTIMATORS, least_squares
from identification.estimators.estimate import Model, correlation_length, half_width, spread
from identification.estimators.filters import LowPass, whiteness
from identification.estimators.least_squares import (
    MOST_SAMPLES,
    CutOff,
    Delay,
    choose_cut_off,
    find_delay,
    prepare,
)
from identification.estimators.signals import Signals
from identification.trajectory import encoder_count, finest_reading, position_noise
from tests.estimates import estimate_by
from tests.exact_axis import Axis, counted, multisine, positions
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 1e-3


def log(force: Array, position: Array, step: float = STEP) -> Trajectory:
    time: Array = np.arange(force.size) * np.float64(step)
    return Trajectory(time=time, force=force, position=position)


def excited(axis: Axis, samples: int = 6000, runs: int = 1, seed: int = 0) -> Array:
    plain = Axis(mass=axis.mass, damping=axis.damping, sample_time=axis.sample_time)
    return multisine(np.random.default_rng(seed), samples=samples, runs=runs, axis=plain)


def test_low_pass_keeps_lines_and_halves_the_power_at_its_cut_off() -> None:
    low_pass = LowPass.at(20.0, STEP)
    index = np.arange(2000.0)
    kept = slice(low_pass.half, -low_pass.half)
    np.testing.assert_allclose(low_pass(3 + 2 * index), (3 + 2 * index)[kept], rtol=1e-12)
    wave = np.cos(2 * np.pi * 20.0 * STEP * (index - 1000))
    np.testing.assert_allclose(low_pass(wave), (wave / np.sqrt(2))[kept], atol=1e-5)


def test_encoder_count_is_found_and_not_invented() -> None:
    generator = np.random.default_rng(4)
    smooth = np.sin(np.arange(5000) / 100)
    assert encoder_count(counted(smooth, 3.7e-4) + 12.3) == pytest.approx(3.7e-4, rel=1e-9)
    assert encoder_count(smooth) is None
    assert encoder_count(generator.standard_normal(5000)) is None
    assert encoder_count(np.ones(500)) is None


@pytest.mark.parametrize("deviation", thinned([1e-5, 1e-6, 1e-4], 1))
def test_position_noise_is_read_from_the_log(deviation: float) -> None:
    axis = Axis()
    force = excited(axis)
    noise = deviation * np.random.default_rng(5).standard_normal(force.shape)
    place = (positions(axis, force) + noise)[:, 0]
    assert position_noise(place, force[:, 0]) == pytest.approx(deviation, rel=0.05)
    assert finest_reading(place, force[:, 0]) == pytest.approx(deviation * np.sqrt(12), rel=0.05)
    rounded = counted(positions(axis, force)[:, 0], 6e-6)
    assert finest_reading(rounded, force[:, 0]) == pytest.approx(6e-6, rel=1e-6)


def test_the_cut_off_falls_with_noise_and_keeps_it_out() -> None:
    axis = Axis()
    force = excited(axis)
    place = positions(axis, force)[:, 0]
    white = np.random.default_rng(6).standard_normal(place.size)
    sizes = (1e-9, 1e-6, 1e-5)
    cut_offs = [
        choose_cut_off(
            Signals.of(log(force[:, 0], place + size * white)).kinematics.acceleration, STEP, size
        )
        for size in sizes
    ]
    frequencies = [each.frequency for each in cut_offs]
    assert frequencies == sorted(frequencies, reverse=True)
    assert 9.5 < frequencies[-1] < frequencies[0] <= 100
    for each, size in zip(cut_offs, sizes, strict=True):
        # Power of filtered white noise in a second difference, summed directly.
        kernel = np.convolve(LowPass.at(each.frequency, STEP).kernel, [1, -2, 1])
        signal = np.convolve(place, kernel, mode="valid")
        assert size**2 * np.sum(kernel**2) < 3e-4 * np.mean(signal**2)


@cache
def noise_free(damping: float, delay: float) -> Trajectory:
    axis = Axis(mass=3.0, damping=damping, offset=0.4, delay=delay)
    force = excited(axis, samples=3000)
    return log(force[:, 0], positions(axis, force)[:, 0])


@pytest.mark.parametrize("method", ESTIMATORS)
@pytest.mark.parametrize("damping", thinned([2.0, 0.0, 300.0], 1))
@pytest.mark.parametrize("delay", [0.0, 1.6 * STEP])
def test_noise_free_logs_give_the_truth(method: str, damping: float, delay: float) -> None:
    found = estimate_by(method, noise_free(damping, delay), Model(coulomb=False), delay)
    exact = 1e-9 if method == "output-error" else 1e-4
    assert found.value("mass") == pytest.approx(3.0, rel=exact)
    assert found.value("damping") == pytest.approx(damping, rel=exact, abs=3.0 * exact)
    assert found.value("force_offset") == pytest.approx(0.4, abs=max(0.4 * exact, 1e-3 * exact))
    assert found.value("coulomb_friction") == found.deviation("coulomb_friction") == 0.0
    assert found.explained == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("coulomb", thinned([3.0, 0.8], 1))
def test_friction_with_stick_and_slip(coulomb: float) -> None:
    """Standing a tenth of the time at 3 N of 14 N: the turning points still come out."""
    axis = Axis(coulomb=coulomb, offset=-0.3, delay=STEP)
    force = excited(axis, samples=12000)
    place = counted(positions(axis, force), 6e-6)[:, 0]
    found = estimate_by("least-squares", log(force[:, 0], place), Model(), STEP)
    assert found.value("mass") == pytest.approx(3.0, rel=2e-3)
    assert found.value("damping") == pytest.approx(10.0, rel=1e-2)
    assert found.value("coulomb_friction") == pytest.approx(coulomb, rel=5e-3)
    assert found.value("force_offset") == pytest.approx(-0.3, abs=5e-3)


@pytest.mark.long
def test_refined_direction_is_the_true_one() -> None:
    axis = Axis(coulomb=3.0)
    force = excited(axis, samples=4000)
    fine = Axis(coulomb=3.0, sample_time=STEP / 10)
    path = positions(fine, np.repeat(force, 10, axis=0))[:, 0]
    steps = np.diff(path)
    sense = np.sign(np.where(np.abs(steps) < 1e-14, 0.0, steps))
    truth = np.concatenate((sense, sense[-1:])).reshape(4000, 10).mean(axis=1)[:-1]
    table = prepare(log(force[:, 0], path[::10]), Model(), 0.0)
    stood = truth == 0
    assert 0.05 < stood.mean() < 0.5
    assert np.mean(table.motion.moving[stood]) < 0.03
    moved = np.abs(truth) == 1
    wrong = np.abs(table.motion.direction.mean() - truth)[moved] > 0.1
    assert wrong.mean() < 0.003


@cache
def _five_seconds() -> Trajectory:
    axis = Axis()
    force = excited(axis, samples=5000)
    return log(force[:, 0], positions(axis, force)[:, 0])


@pytest.mark.parametrize("method", ESTIMATORS)
def test_estimators_are_fast(method: str) -> None:
    """20 ms of a core, preparation included; the limit leaves room for a slow one."""
    trajectory = _five_seconds()
    estimate_by(method, trajectory, Model(), 0.0)
    start = process_time()
    estimate_by(method, trajectory, Model(), 0.0)
    assert process_time() - start < 0.5


def looked_for(trajectory: Trajectory, model: Model) -> Delay:
    most = MOST_SAMPLES * trajectory.sample_time
    table = prepare(trajectory, model, most, refine=False)
    return find_delay(trajectory, table)


@pytest.mark.parametrize("delay", thinned([0.7, 0.0, 1.0, 3.4], 1))
def test_the_delay_is_found(delay: float) -> None:
    axis = Axis(delay=delay * STEP)
    force = excited(axis)
    place = counted(positions(axis, force), 6e-6)[:, 0]
    found = looked_for(log(force[:, 0], place), Model())
    assert found.value == pytest.approx(delay * STEP, abs=0.01 * STEP)
    assert found.deviation < 0.01 * STEP
    assert int(np.argmin(found.residuals)) in {int(delay), int(delay) + 1}


def test_a_single_frequency_cannot_tell_delay_from_damping() -> None:
    axis = Axis(delay=STEP)
    time = np.arange(8000) * STEP
    force = 6 * np.sin(2 * np.pi * 4 * time)[:, None]
    noise = 1e-5 * np.random.default_rng(8).standard_normal(force.shape)
    single = log(force[:, 0], (positions(axis, force) + noise)[:, 0])
    rich = excited(axis, samples=8000)
    many = log(rich[:, 0], (positions(axis, rich) + noise)[:, 0])
    model = Model(coulomb=False)
    assert looked_for(single, model).deviation > 5 * looked_for(many, model).deviation


def test_whiteness() -> None:
    noise = np.random.default_rng(9).standard_normal(20000)
    assert whiteness(noise) < 0.02
    assert whiteness(noise.cumsum()) > 0.9
    assert whiteness(np.diff(noise)) > 0.2
    assert whiteness(np.zeros(100)) == 0


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99])
def test_correlation_length_of_a_first_order_process(memory: float) -> None:
    from scipy.signal import lfilter

    noise = lfilter([1], [1, -memory], np.random.default_rng(10).standard_normal(200_000))
    expected = (1 + memory) / (1 - memory)
    assert correlation_length(np.asarray(noise)) == pytest.approx(expected, rel=0.15)


def test_the_covariance_survives_colour() -> None:
    """Mean of a coloured series: variance (1+a)/(1-a)/n, forty times the ordinary one."""
    from scipy.signal import lfilter

    runs, samples, memory = 200, 6000, 0.95
    generator = np.random.default_rng(11)
    series = np.asarray(lfilter([1], [1, -memory], generator.standard_normal((runs, samples))))
    ones = np.ones((1, samples))
    silent = np.zeros(samples)
    deviations = np.array(
        [
            np.sqrt(spread(ones, row - row.mean(), 1, signal=silent).covariance[0, 0])
            for row in series
        ]
    )
    assert np.sqrt(np.mean(deviations**2)) == pytest.approx(series.mean(axis=1).std(), rel=0.2)


def test_collinear_columns_are_shown_and_do_not_break() -> None:
    generator = np.random.default_rng(12)
    one = generator.standard_normal(1000)
    columns = np.stack((one, one + 1e-9 * generator.standard_normal(1000)))
    found = spread(columns, generator.standard_normal(1000), 2, signal=one)
    assert found.condition > 1e6
    assert np.all(np.isfinite(found.covariance))


def test_notes_say_how_much_the_cut_off_matters() -> None:
    axis = Axis(coulomb=0.8)
    force = excited(axis)
    table = prepare(log(force[:, 0], positions(axis, force)[:, 0]), Model(), 0.0)
    found = least_squares.fit(table, 0.0)
    assert "low-pass at" in found.notes[0]
    assert "half the cut-off" in found.notes[1]
    assert "twice the cut-off" in found.notes[2]
    given = least_squares.fit(table.at_cut_off(15.0), 0.0)
    assert given.notes[0] == CutOff(frequency=15.0).reason
    assert half_width(given, "mass") > 0
