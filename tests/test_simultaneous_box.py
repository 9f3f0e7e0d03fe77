"""The simultaneous box: as sure as it says, and as wide as Hotelling's T² asks for."""

from __future__ import annotations

import numpy as np
import pytest

from identification import Covariance, InvalidInputError, Quantity, quantity
from tests.bare_device import BEYOND, device


def joint(freedom: float) -> Covariance:
    matrix = np.array([[0.01**2, -0.5 * 0.01 * 0.2], [-0.5 * 0.01 * 0.2, 0.2**2]])
    return Covariance(
        parameters=("mass", "damping"),
        matrix=tuple(tuple(row) for row in matrix.tolist()),
        degrees_of_freedom=freedom,
    )


@pytest.mark.parametrize("freedom", [12.0, 59.0, 1e9])
def test_the_box_holds_both_at_once_999_times_in_1000(freedom: float) -> None:
    """Draws from the joint distribution itself: the box is at least as sure as it says."""
    from scipy.stats import t

    generator = np.random.default_rng(0)
    covariance = joint(freedom)
    normal = generator.multivariate_normal(np.zeros(2), np.array(covariance.matrix), 400_000)
    draws = normal / np.sqrt(generator.chisquare(freedom, (400_000, 1)) / freedom)
    half = t.ppf(0.975, freedom) * np.array([0.01, 0.2])
    found = device(
        mass={"value": 3.0, "low": 3.0 - half[0], "high": 3.0 + half[0]},
        damping={"value": 10.0, "low": 10.0 - half[1], "high": 10.0 + half[1]},
        covariance=covariance.model_dump(),
    )
    box = found.simultaneous_box()
    # The truth lies at the estimate less the error.
    mass, damping = 3.0 - draws[:, 0], 10.0 - draws[:, 1]
    inside = (box.mass[0] <= mass) & (mass <= box.mass[1])
    inside &= (box.damping[0] <= damping) & (damping <= box.damping[1])
    assert inside.mean() >= 0.999 - 3 * np.sqrt(0.001 / draws.shape[0])


def test_the_box_of_exact_numbers_is_a_point() -> None:
    box = device().simultaneous_box()
    assert box.mass == (3.0, 3.0)
    assert box.damping == (10.0, 10.0)


def test_the_box_spans_both_directions() -> None:
    """Half-widths times sqrt(χ²(0.999, k))/1.96; χ² of 6 quantities from printed tables: 22.458."""
    ranged = {
        "mass": {"value": 3.0, "low": 2.9, "high": 3.1},
        "damping": {"value": 10.0, "low": 9.8, "high": 10.2},
        "coulomb_friction": {"value": 0.8, "low": 0.7, "high": 0.9},
        "force_offset": {"value": 0.0, "low": -0.1, "high": 0.1},
        "damping_by_direction": BEYOND["damping_by_direction"],
    }
    factor = np.sqrt(22.458) / 1.96
    box = device(**ranged).simultaneous_box()
    assert box.damping == pytest.approx((9.0 - 0.5 * factor, 12.0 + 1.0 * factor), rel=1e-4)
    wide = {"value": 10.0, "low": 0.0, "high": 20.0}
    hull = device(**ranged | {"damping": wide}).simultaneous_box()
    assert hull.damping == pytest.approx((10.0 - 10 * factor, 10.0 + 10 * factor), rel=1e-4)


def test_the_box_keeps_mass_positive_and_takes_times_as_stated() -> None:
    wide: Quantity = quantity(1.0, 0.3, 3.0)
    box = device(mass=wide, delay=quantity(1e-3, 0.5e-3, 2e-3)).simultaneous_box()
    assert 0 < box.mass[0] < 0.3
    assert box.mass[1] > 3.0
    assert box.delay == (0.5e-3, 2e-3)
    assert box.sample_time == (1e-3, 1e-3)


def test_too_few_degrees_of_freedom_say_so() -> None:
    with pytest.raises(InvalidInputError, match="degrees_of_freedom"):
        device(
            mass={"value": 3.0, "low": 2.98, "high": 3.02},
            damping={"value": 10.0, "low": 9.6, "high": 10.4},
            covariance=joint(2.0).model_dump(),
        ).simultaneous_box()
