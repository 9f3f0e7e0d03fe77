"""Certified profiles as files for controllers.

``export`` trusts the profile it is given; the command re-checks digest and certificate first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from tune.documents.profile import SafeProfile
from tune.exporters.c_guard import c_files
from tune.exporters.chai3d import chai3d_files
from tune.exporters.law import fade_step
from tune.exporters.plain import plain_files
from tune.exporters.ros2 import ros2_files

__all__ = ["TARGETS", "Target", "export"]

Target = Literal["ros2", "c", "chai3d", "json"]
TARGETS: tuple[Target, ...] = get_args(Target)

_WRITERS: dict[Target, Callable[[SafeProfile], dict[str, str]]] = {
    "ros2": ros2_files,
    "c": c_files,
    "chai3d": chai3d_files,
    "json": plain_files,
}


def export(profile: SafeProfile, target: Target) -> dict[str, str]:
    """Texts of the files of one target, by file name.

    Args:
        profile: certified; check the file it comes from first with ``tune.check``.
        target: ros2 (parameters), c (guard), chai3d (materials and guard) or json.

    Raises:
        UnstatedError: facts of the device that nobody stated.
        InvalidInputError: the profile does not fit the target, or does not say how what must not be
            switched fades.
    """
    profile.device.require_stated()
    for element in profile.elements.values():
        fade_step(element, profile.loop.sample_time)
    return _WRITERS[target](profile)
