"""A tuned profile and its variants, for what is exported from them."""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification import load_device
from tune import SafeProfile, Scene, optimise

Array = NDArray[np.float64]

#: s, in which the cup fades.
FADE = 0.15
SCENE: dict[str, Any] = {
    "elements": {
        "wall": {"stiffness": 500.0, "damping": 10.0},
        "cup": {"mass": 1.0, "damping": 30.0, "fade_time": FADE},
        "rubber": {"stiffness": 700.0},
    },
    "together": [["wall", "cup"]],
    "loop": {
        "velocity_filter_hz": 50.0,
        "acceleration_filter_hz": 30.0,
        "filter_damping_ratio": 0.5,
    },
}

STEP = 1e-3

#: What differs from the tuned loop.
LOOPS: dict[str, dict[str, Any]] = {
    "as-tuned": {},
    "unfiltered": {"velocity_filter_hz": None, "acceleration_filter_hz": None},
    "butterworth": {
        "velocity_filter_order": 2,
        "filter_damping_ratio": 0.7071,
        "acceleration_filter_hz": 12.5,
    },
    "first-order": {"acceleration_filter_order": 1},
    "window": {"velocity_filter_hz": None, "velocity_window_samples": 7},
}


@functools.cache
def tuned() -> SafeProfile:
    return optimise(load_device("homerehab"), Scene.model_validate(SCENE))


def changed(**loop: Any) -> SafeProfile:
    """The tuned profile with another loop; what is exported does not depend on its margins."""
    profile = tuned()
    return profile.model_copy(update={"loop": profile.loop.model_copy(update=loop)}).signed()


def walled(**loop: Any) -> SafeProfile:
    """The tuned profile with two walls that push only, one of them never met with the cup."""
    profile = changed(**loop)
    wall = profile.elements["wall"].model_copy(update={"one_sided": True})
    other = wall.model_copy(update={"damping": 20.0, "force_level": 10.0})
    elements = {**profile.elements, "wall": wall, "other": other}
    return profile.model_copy(update={"elements": elements, "apart": (("other", "cup"),)}).signed()


def on_axes(count: int, profile: SafeProfile | None = None) -> SafeProfile:
    """That profile, or another one, of a device of so many axes, as an export sees it."""
    made, names = profile or walled(), ("x", "y", "z", "u", "v", "w")[:count]
    device = made.device.model_copy(update={"axes": names})
    return made.model_copy(update={"device": device}).signed()


def renamed(*names: str) -> SafeProfile:
    """The tuned profile with its elements renamed."""
    profile = tuned()
    new = dict(zip(profile.elements, names, strict=True))
    return profile.model_copy(
        update={
            "elements": {new[name]: element for name, element in profile.elements.items()},
            "together": tuple(tuple(new[name] for name in group) for group in profile.together),
        }
    ).signed()


def poles(cutoff: float | None, order: int, ratio: float) -> Array:
    """Denominator of a low-pass from its complex poles."""
    if cutoff is None:
        return np.array([1.0])
    turn = 2 * np.pi * cutoff * STEP
    if order == 1:
        return np.array([1.0, -np.exp(-turn)])
    pole = np.exp(-turn * (ratio + 1j * np.sqrt(1 - ratio**2)))
    return np.asarray(np.poly([pole, np.conj(pole)]).real, dtype=np.float64)
