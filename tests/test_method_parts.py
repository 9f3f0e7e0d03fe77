"""Parts that methods are made of, each against what it stands for."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.estimate import gauss_newton
from identification.estimators.filters import is_coloured
from identification.estimators.output_error import Direction, path
from identification.estimators.signals import HeldResponse

STEP = 1e-3


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
