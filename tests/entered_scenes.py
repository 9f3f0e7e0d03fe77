"""Scenes of the named devices, each about as large as it can be had, to be played by a guard."""

from __future__ import annotations

from identification import load_device
from tests.exported import tuned
from tune import SafeProfile
from tune.documents.profile import ElementProfile
from tune.documents.scene import DEFAULT_MOTION

#: Sizes (K, B, M) of elements by name; those named wall push only. The first is the demo's scene.
SCENES: dict[str, dict[str, tuple[float, float, float]]] = {
    "homerehab": {
        "wall": (1155.0, 82.0, 0.0),
        "water": (0.0, 10.0, 0.0),
        "cup": (0.0, 0.0, 1.475),
        "rubber": (1400.0, 0.0, 0.0),
        "feather": (0.0, 0.0, -1.2),
    },
    "stylus": {
        "wall": (90.0, 9.9, 0.0),
        "thing": (26.0, 0.37, 0.11),
        "free": (0.0, -0.058, 0.0),
        "feather": (0.0, 0.0, -0.0236),
    },
    "knob": {
        "wall": (0.5, 0.01, 0.0),
        "thing": (0.124, 8.8e-4, 1.4e-4),
        "free": (0.0, -1.4e-4, 0.0),
        "feather": (0.0, 0.0, -3.1e-5),
    },
    "emps": {
        "wall": (11_700.0, 1170.0, 0.0),
        "thing": (4470.0, 320.0, 121.0),
        "free": (0.0, -91.0, 0.0),
        "feather": (0.0, 0.0, -46.0),
    },
}
#: Cut-offs of velocity and acceleration, Hz.
CUT_OFFS = {"homerehab": (127.0, 32.6)}


def scene_on(name: str) -> SafeProfile:
    """A profile with these elements; what is played does not depend on its certificate."""
    device = load_device(name)
    velocity, acceleration = CUT_OFFS.get(name, (50.0, 30.0))
    some = tuned().elements["wall"]
    elements = {
        each: _element(some, each, sizes).model_copy(
            update={"motion": DEFAULT_MOTION[device.motion]}
        )
        for each, sizes in SCENES[name].items()
    }
    loop = tuned().loop.model_copy(
        update={
            "sample_time": device.sample_time.value,
            "extra_delay_samples": device.delay.value / device.sample_time.value,
            "velocity_filter_hz": velocity,
            "acceleration_filter_hz": acceleration,
        }
    )
    return tuned().model_copy(
        update={"device": device, "elements": elements, "loop": loop, "together": ()}
    )


def _element(some: ElementProfile, name: str, sizes: tuple[float, float, float]) -> ElementProfile:
    stiffness, damping, mass = sizes
    changed = some.model_copy(update={"stiffness": stiffness, "damping": damping, "mass": mass})
    return changed.model_copy(
        update={"one_sided": name == "wall", "fade_time": 0.1 if changed.fades else 0.0}
    )


def depth_of(profile: SafeProfile, name: str) -> float:
    """How deep a hand goes: as stated, else where the spring takes the peak force; m (rad)."""
    element, limit = profile.elements[name], profile.device.force_limit
    if element.motion.penetration is not None:
        return element.motion.penetration
    assert limit is not None
    return limit.peak / element.stiffness


def stated_sum(profile: SafeProfile, name: str) -> float:
    """|K|·depth + |B|·speed + |M|·acceleration, N (N·m)."""
    element = profile.elements[name]
    motion = element.motion
    return (
        abs(element.stiffness) * depth_of(profile, name)
        + abs(element.damping) * motion.speed
        + abs(element.mass) * motion.acceleration
    )
