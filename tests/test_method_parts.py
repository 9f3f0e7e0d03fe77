"""Parts that methods are made of, each against what it stands for."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.filters import is_coloured
from identification.estimators.linear import gauss_newton
from identification.estimators.response import HeldResponse
from identification.estimators.signals import FIRST, LAST, HeldColumn, Kinematics, of_rows
from identification.estimators.stick_slip import Direction, path
from identification.estimators.weak import BandedCovariance, Operators, bands, bump_weights

STEP = 1e-3


def test_bumps_are_weights_that_end() -> None:
    place = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 500)) * STEP
    weights = bump_weights(place, 0.01)
    dense = weights.toarray()
    np.testing.assert_allclose(dense.sum(axis=1), 1.0, rtol=1e-12)
    assert np.all(dense >= 0)
    middle = dense[len(dense) // 2]
    centre = middle @ place
    deviation = np.sqrt(middle @ (place - centre) ** 2)
    assert deviation == pytest.approx(0.01, rel=0.05)
    assert np.ptp(place[middle > 0]) < 0.1


def test_operators_are_the_rows() -> None:
    generator = np.random.default_rng(1)
    steps = generator.uniform(0.8e-3, 1.2e-3, 299)
    position = generator.standard_normal(300)
    known = 3
    rows = Kinematics.of(position, steps)
    place = np.cumsum(steps)[FIRST - 1 : -LAST][known:]
    weights = bump_weights(place, 0.004)
    found = Operators.of(weights, steps, 300, known)
    middle = HeldColumn.constant((position[1:] + position[:-1]) / 2, steps)
    for operator, row in (
        (found.acceleration, rows.acceleration),
        (found.velocity, rows.velocity),
        (found.place, of_rows(middle.triangle())),
    ):
        expected = weights @ row[known:]
        np.testing.assert_allclose(
            operator @ position, expected, atol=1e-9 * np.abs(expected).max()
        )


def test_banded_covariance_is_the_dense_one() -> None:
    place = np.arange(200) * np.float64(STEP)
    weights = bump_weights(place, 0.005)
    dense = (weights @ weights.T).toarray()
    banded = bands(weights @ weights.T)[0]
    # On its own the overlap of smooth functions is all but singular.
    dense += 0.01 * np.eye(len(dense))
    banded[0] += 0.01
    covariance = BandedCovariance.of(banded)
    right = np.random.default_rng(2).standard_normal((2, len(dense)))
    white = covariance.whitened(right)
    inverse = np.linalg.inv(dense)
    np.testing.assert_allclose(white @ white.T, right @ inverse @ right.T, rtol=1e-6)
    np.testing.assert_allclose(covariance.solve(right[0]), inverse @ right[0], rtol=1e-5)
    assert covariance.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-9)


def test_a_path_is_finite_whatever_drives_it() -> None:
    """The search asks for such rates, and forces that change inside an interval for any mean."""
    generator = np.random.default_rng(8)
    for _ in range(200):
        device = HeldResponse.at(generator.uniform(-0.25, 2.0) / STEP, STEP)
        way = Direction.of(device, 0.01 * generator.standard_normal(201))
        found = path(
            way,
            way,
            2.0 * generator.standard_normal(200),
            mass=1.0,
            friction=1.0,
            start=0.01 * generator.standard_normal(),
        )
        assert np.all(np.isfinite(found.speed))
        assert np.all(np.isfinite(found.kept))
        left = np.asarray(found.motion.direction.left)
        assert np.all((left >= 0) & (left <= STEP))


def test_a_parameter_that_changes_nothing_does_not_move() -> None:
    generator = np.random.default_rng(6)
    slopes = np.stack((generator.standard_normal(500), np.zeros(500)))
    move, _ = gauss_newton(slopes, 2.0 * slopes[0] + generator.standard_normal(500), 1e-13)
    assert move[0] == pytest.approx(2.0, abs=0.2)
    assert move[1] == 0


@pytest.mark.long
@pytest.mark.parametrize("sides", [1, 2])
def test_white_noise_is_seldom_taken_for_coloured(sides: int) -> None:
    """Eight octaves, each side once in 10 000 times: 8 or 16 of 10 000 logs at most."""
    noise = np.random.default_rng(7)
    rows = (noise.standard_normal(2000) for _ in range(10_000))
    taken = sum(is_coloured(each, either_side=sides == 2) for each in rows)
    assert taken <= 8 * sides + 3 * np.sqrt(8 * sides)


def test_a_quiet_octave_counts_where_either_side_does() -> None:
    """A tenth of the power between 0.03 and 0.06 of the rows; nothing at all is no colour."""
    lines = np.fft.rfft(np.random.default_rng(1).standard_normal(4000))
    lines[120:240] *= np.sqrt(0.1)
    rows = np.fft.irfft(lines)
    assert not is_coloured(rows)
    assert is_coloured(rows, either_side=True)
    assert not is_coloured(np.zeros(4000), either_side=True)
