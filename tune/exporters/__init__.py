"""Certified profiles as files for controllers.

``export`` trusts the profile it is given; the command re-checks digest and certificate first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from tune.documents.profile import SafeProfile
from tune.exporters.data import plain_files, ros2_files
from tune.exporters.guard import c_files, chai3d_files
from tune.exporters.law import fade_step
from tune.exporters.text import NOT_A_SAFETY_FUNCTION, digest

__all__ = ["NOT_A_SAFETY_FUNCTION", "TARGETS", "Target", "digest", "export"]

Target = Literal["ros2", "c", "chai3d", "json"]
TARGETS: tuple[Target, ...] = get_args(Target)

_WRITERS: dict[Target, Callable[[SafeProfile], dict[str, str]]] = {
    "c": c_files,
    "chai3d": chai3d_files,
    "json": plain_files,
}


def export(profile: SafeProfile, target: Target, *, node: str = "haptune") -> dict[str, str]:
    """Texts of the files of one target, by file name.

    Args:
        profile: certified; check the file it comes from first with ``tune.check``.
        target: ros2 (parameters, law, node), c (guard), chai3d (materials and guard) or json.
        node: name of the node of ROS 2, with its namespaces where it has any.

    Raises:
        UnstatedError: facts of the device that nobody stated.
        InvalidInputError: the profile does not fit the target, or does not say how what must not be
            switched fades.
    """
    profile.device.require_stated()
    for element in profile.elements.values():
        fade_step(element, profile.loop.sample_time)
    return ros2_files(profile, node) if target == "ros2" else _WRITERS[target](profile)
