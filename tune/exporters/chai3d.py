"""A profile for CHAI3D: springs as materials, everything else through the C guard."""

from __future__ import annotations

from tune.documents.effects import EffectName
from tune.documents.profile import ElementProfile, SafeProfile
from tune.exporters.c_guard import c_files, filled, macros, number
from tune.exporters.heading import force_limit, heading
from tune.exporters.names import block_comment


def chai3d_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_chai3d.hpp and the guard that it plays damping and mass with.

    Materials are springs of linear axes (N/m); on a rotary axis the guard plays everything.
    """
    limit = force_limit(profile)
    words = macros(profile)
    springs = [
        f"    case {words[name]}:\n"
        f"        material->setStiffness({number(element.stiffness)} / workspace_scale);\n"
        f"        return true;\n"
        for name, element in profile.elements.items()
        if _only_spring(element) and profile.device.motion == "linear"
    ]
    kind, load = ("Angular", "Torque") if profile.device.motion == "rotary" else ("Linear", "Force")
    values = {
        "max_force": f"m_max{kind}{load}",
        "max_stiffness": f"m_max{kind}Stiffness",
        "max_damping": f"m_max{kind}Damping",
        "stiffness": number(_largest(profile, "stiffness")),
        "damping": number(_largest(profile, "damping")),
        "heading": block_comment(heading(profile)),
        "continuous": number(limit.continuous),
        "peak": number(limit.peak),
        "springs": "".join(springs),
        "what": "Torque (N*m)" if profile.device.motion == "rotary" else "Force (N)",
    }
    return {"haptune_chai3d.hpp": filled("chai3d.hpp", values), **c_files(profile)}


def _largest(profile: SafeProfile, effect: EffectName) -> float:
    """The largest sum of one effect over what may act at once; 0 where none is positive."""
    sizes: dict[str, float] = {
        name: getattr(element, effect) for name, element in profile.elements.items()
    }
    return max(0.0, *(sum(sizes[name] for name in moment) for moment in profile.moments()))


def _only_spring(element: ElementProfile) -> bool:
    return element.stiffness > 0 and element.damping == 0 and element.mass == 0
