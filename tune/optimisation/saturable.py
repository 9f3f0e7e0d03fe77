"""Saturable springs: a hand may go as deep as it likes, and their force is cut at its limit."""

from __future__ import annotations

from collections.abc import Sequence

from tune.documents.scene import DEFAULT_MOTION
from tune.optimisation.problem import DesignTask


def may_saturate(task: DesignTask, elements: Sequence[str]) -> frozenset[str]:
    """Elements whose springs the usual motion would bound, and which may be cut at the force limit.

    They state no penetration, and nothing felt with them has mass or takes something away: what
    pumps must not be cut. A wall is met by all there is, and is cut all the same.
    """
    device, scene = task.device, task.scene
    limit, usual = device.force_limit, DEFAULT_MOTION[device.motion].penetration
    if limit is None or usual is None or not task.region.box.damping[0] > 0:
        return frozenset()
    # A force that friction masks is none to be cut at.
    if limit.continuous <= max(device.coulomb_friction.value, task.table.threshold(device.motion)):
        return frozenset()
    within = set(elements)
    groups = [set(s) for name in elements for s in task.subsets(name) if within >= {*s}]
    cut: set[str] = set()
    for name in elements:
        wish = scene.elements[name].stiffness
        if wish is None or scene.elements[name].penetration is not None:
            continue
        enough = wish.high is not None and wish.high * usual <= limit.continuous
        pumps = any(scene.elements[other].fades for s in groups if name in s for other in s)
        if name in scene.walls or (not enough and not pumps):
            cut.add(name)
    return frozenset(cut)
