"""Cut-offs that are free, against those that a search from outside found."""

from __future__ import annotations

import math
from typing import Any

import pytest

from identification import Device, ForceLimit, as_stored, load_device, quantity
from tune import NoFeasibleEffectError, Scene, optimise


def _chosen(elements: dict[str, Any], **more: Any) -> Any:
    scene = Scene.model_validate({"elements": elements, **more})
    return optimise(load_device("homerehab"), scene).loop


def test_a_filter_that_is_fixed_stays_while_the_other_is_found() -> None:
    loop = {"velocity_filter_hz": 40.0, "velocity_filter_order": 2, "filter_damping_ratio": 0.7}
    found = _chosen({"cup": {"damping": 30.0, "mass": "max"}}, loop=loop)
    assert (found.velocity_filter_hz, found.velocity_filter_order) == (40.0, 2)
    assert found.filter_damping_ratio == 0.7
    assert 20 < (found.acceleration_filter_hz or 0.0) < 60


def test_no_filter_where_none_is_needed() -> None:
    """Ten times the ripple allowed: a wanted damper is felt best as it is."""
    assert _chosen({"water": {"damping": 10.0}}, ripple_limit=1.0).velocity_filter_hz is None


@pytest.mark.parametrize(
    ("numbers", "fixed"),
    [
        # The better of two hills has no velocity filter, and the first climbed is not left.
        ((1e-3, 2e-3, 2.621, 8.055, 0.696e-6, 29.2, 60.4, 0.279, 0.133), ("none", 18.4)),
        # Limits meet in a ridge that bends: the function is concave on neither side.
        ((5e-4, 1e-3, 0.6285, 4.164, 4.889e-6, 37.4, 74.8, 0.7245, 0.04566), (90.4, 18.8)),
    ],
)
def test_no_cutoffs_found_from_outside_are_a_percent_better(
    numbers: tuple[float, ...], fixed: tuple[float | str, float]
) -> None:
    step, delay, mass, damping, count, continuous, peak, friction, ripple = numbers
    device = Device(
        name="drawn",
        motion="linear",
        sample_time=quantity(step),
        delay=quantity(delay),
        encoder_resolution=quantity(count),
        force_limit=ForceLimit(continuous=continuous, peak=peak),
        mass=quantity(mass),
        damping=quantity(damping),
        coulomb_friction=quantity(friction),
    )
    wish = dict.fromkeys(("stiffness", "damping", "mass"), "max")
    motion = {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0}
    products: list[float] = []
    for velocity, acceleration in (("free", "free"), fixed):
        scene = Scene.model_validate(
            {
                "elements": {"all": wish | motion},
                "margin": "conservative",
                "ripple_limit": ripple,
                "loop": {"velocity_filter_hz": velocity, "acceleration_filter_hz": acceleration},
            }
        )
        steps = optimise(as_stored(device), scene).elements["all"].perceived_steps
        products.append(math.prod(steps.values()))
    assert products[0] >= 0.99 * products[1]


def test_a_wanted_value_is_met_by_filters_that_allow_it() -> None:
    """Of this mass less would be felt as well with less filtering; but it is wanted."""
    profile = optimise(
        load_device("homerehab"),
        Scene.model_validate({"elements": {"cup": {"mass": 1.0, "damping": 50.0}}}),
    )
    assert profile.elements["cup"].mass == 1.0
    assert profile.elements["cup"].limited_by == {"mass": "wanted", "damping": "wanted"}


def test_a_range_no_filter_allows_is_refused_as_before() -> None:
    with pytest.raises(NoFeasibleEffectError, match="range starts at 2000"):
        optimise(
            load_device("homerehab"),
            Scene.model_validate({"elements": {"cup": {"mass": {"min": 2000.0, "max": 3000.0}}}}),
        )
