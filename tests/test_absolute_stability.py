"""Clamps, switched dampers and fading masses: what is proved of a sum, against its eigenvalues.

The reference forms the matrix of the condition from the closed form of the sampled plant and looks
at its least eigenvalue over corners, delays, levels and frequencies: an own assembly, an own test.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from identification import load_device, to_mapping
from tests.test_clamps import response
from tests.wall_play import Array
from tune import SafeProfile, Scene, optimise
from tune.certificate.certify import certify
from tune.certificate.check import check_content
from tune.documents.certified import AbsoluteStability, Channel, Multiplier
from tune.documents.errors import CheckFailedError
from tune.documents.profile import ElementProfile, digest_of

STEP = 1e-3
#: Three channels, and two levels at which nothing stands but what fades.
MOMENTS = ("wall + water + rubber", "wall + cup + feather")


@pytest.fixture(scope="module")
def profile() -> SafeProfile:
    """HomeRehab with a wall that meets a damper, a spring, a mass and what makes it lighter."""
    elements = {
        "wall": {"stiffness": 4000.0, "damping": 30.0, "one_sided": True},
        "water": {"damping": 15.0},
        "rubber": {"stiffness": 1400.0, "damping": 3.0},
        "cup": {"mass": 0.8, "damping": 20.0},
        "feather": {"mass": -0.6},
    }
    return optimise(
        load_device("homerehab"),
        Scene.model_validate(
            {
                "elements": elements,
                "together": [["cup", "feather"], ["water", "rubber"]],
                "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
                "ripple_limit": 1.0,
            }
        ),
    )


def estimates(theta: Array) -> tuple[Array, Array]:
    """Velocity and acceleration over position, by filters of 50 Hz and twice 30 Hz."""
    z = np.exp(1j * theta)
    slow, slower = np.exp(-2 * np.pi * 50.0 * STEP), np.exp(-2 * np.pi * 30.0 * STEP)
    velocity = (1 - slow) * (z - 1) / (STEP * (z - slow))
    return velocity, ((1 - slower) * (z - 1) / (STEP * (z - slower))) ** 2


def multiplier_at(channel: Channel, theta: Array) -> Array:
    turns = [1 - np.exp(-1j * tap.samples * theta) for tap in channel.taps]
    slope = sum(tap.weight * tap.samples for tap in channel.taps) or 1.0
    weighed = sum((t.weight * turn for t, turn in zip(channel.taps, turns, strict=True)), 0 * theta)
    return (channel.constant + weighed) / slope


def least_eigenvalue(profile: SafeProfile, moment: str, multiplier: Multiplier, g: float) -> float:
    """Of the Hermitian part of Mᵢ·(δᵢⱼ/(g·sᵢ) + oᵢ·G), twice."""
    names, seal = moment.split(" + "), profile.certificate
    chosen = [profile.elements[name] for name in names]
    springs = [each for each in chosen if each.stiffness]
    fading = [each for each in chosen if each.fades]
    switched = sum(e.damping for e in chosen if not e.stiffness and not e.fades)
    theta = np.unique(np.r_[np.geomspace(1e-3, np.pi, 300), np.linspace(0.02, np.pi, 300)])
    velocity, acceleration = estimates(theta)

    def law(element: ElementProfile) -> Array:
        moved = element.damping * velocity + element.mass * acceleration
        return element.stiffness + moved

    laws = [law(each) for each in springs] + ([switched * velocity] if switched else [])
    sizes = [each.stiffness for each in springs] + ([switched] if switched else [])
    factors = [multiplier_at(channel, theta) for channel in multiplier.channels]
    low, high = seal.delay_samples
    late = np.linspace(low, high + seal.extra_delay_samples, 4)
    least = np.inf
    for mass, damping, samples in product(seal.mass, seal.damping, late):
        bare = response(mass, damping, STEP, float(samples), theta)
        for levels in product((0.0, 0.5 * g, g), repeat=len(fading)):
            steady = sum((lv * law(e) for lv, e in zip(levels, fading, strict=True)), 0 * theta)
            plant = bare / (1 + steady * bare)
            rows = [
                [
                    factor * (spoken / size * plant + (i == j) / (g * size))
                    for j in range(len(sizes))
                ]
                for i, (factor, spoken, size) in enumerate(zip(factors, laws, sizes, strict=True))
            ]
            matrix = np.moveaxis(np.array(rows), -1, 0)
            values = np.linalg.eigvalsh(matrix + np.conj(np.swapaxes(matrix, 1, 2)))
            least = min(least, float(np.min(values)))
    return least


def failures(profile: SafeProfile, moment: str, gain: float) -> tuple[str, ...]:
    """What `certify` says where a moment is to be proved with its multiplier up to a gain."""
    stated = dict(profile.certificate.absolute_stability or {})
    stated[moment] = stated[moment].model_copy(update={"gain": gain})
    try:
        certify(profile, 20_000, stated)
    except CheckFailedError as error:
        return error.failures
    return ()


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_sum_is_proved_as_far_as_its_eigenvalues_allow(profile: SafeProfile, moment: str) -> None:
    """A hundredth below the gain at which the least of them vanishes, and not a hundredth above."""
    stated: AbsoluteStability = (profile.certificate.absolute_stability or {})[moment]
    assert stated.free is not None
    good, bad = stated.gain, 20.0 * stated.gain
    while bad > good * 1.004:
        middle = float(np.sqrt(good * bad))
        positive = least_eigenvalue(profile, moment, stated.free, middle) > 0
        good, bad = (middle, bad) if positive else (good, middle)
    assert stated.gain < good
    assert not failures(profile, moment, 0.99 * good)
    refused = failures(profile, moment, 1.01 * bad)
    assert [each.startswith(f"{moment}: not proved") for each in refused] == [True]


def test_saturation_is_not_said_where_the_stated_multipliers_prove_more(
    profile: SafeProfile,
) -> None:
    """Of rubber that was wanted as it is."""
    content = to_mapping(profile)
    assert content["elements"]["rubber"]["limited_by"]["damping"] == "wanted"
    content["elements"]["rubber"]["limited_by"]["damping"] = "saturation"
    content["digest"] = digest_of(content)
    with pytest.raises(CheckFailedError, match="rubber: damping is said to be limited by satur"):
        check_content(content, "profile.yaml")
