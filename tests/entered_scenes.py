"""Scenes of the named devices, each about as large as it can be had, to be played by a guard."""

from collections.abc import Mapping
from typing import Any

from identification import load_device
from tests.exported import tuned
from tune import SafeProfile, Scene
from tune.documents.profile import AbsoluteStability


def made(
    name: str,
    scene: Mapping[str, tuple[float, float, float]],
    *,
    together: tuple[tuple[str, ...], ...] = (),
    apart: tuple[tuple[str, ...], ...] = (),
    taps: int = 7,
    **motion: float,
) -> SafeProfile:
    """A profile of hand-made elements, those whose names begin with wall pushing only."""
    device = load_device(name)
    assert device.force_limit is not None
    some = tuned().elements["wall"]
    usual = Scene.model_validate({"elements": {"any": {"stiffness": "max", **motion}}}).motion(
        "any", device.motion
    )
    elements: dict[str, Any] = {}
    for each, (stiffness, damping, mass) in scene.items():
        sized = some.model_copy(update={"stiffness": stiffness, "damping": damping, "mass": mass})
        played = {
            "motion": usual,
            "one_sided": each.startswith("wall"),
            "force_level": device.force_limit.peak if stiffness else 0.0,
            "fade_time": 0.1 if sized.fades else 0.0,
        }
        elements[each] = sized.model_copy(update=played)
    loop = tuned().loop.model_copy(
        update={
            "sample_time": device.sample_time.value,
            "extra_delay_samples": device.delay.value / device.sample_time.value,
            "velocity_filter_hz": 50.0,
            "acceleration_filter_hz": 30.0,
            "filter_damping_ratio": 1.0,
        }
    )
    channel = {"name": "any", "taps": [{"samples": taps, "weight": 1.0}]}
    proof = AbsoluteStability.model_validate(
        {"gain": 2.0, "extra_delay_samples": 1.0, "free": {"channels": [channel]}, "covers": ()}
    )
    seal = tuned().certificate.model_copy(update={"absolute_stability": {"any": proof}})
    new = {"device": device, "elements": elements, "loop": loop, "certificate": seal}
    return tuned().model_copy(update={**new, "together": together, "apart": apart}).signed()
