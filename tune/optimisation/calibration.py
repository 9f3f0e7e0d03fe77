"""The main job in one call: logs and a scene to a certified profile."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from os import PathLike
from pathlib import Path

from identification import (
    Hardware,
    LogColumns,
    Method,
    Trajectories,
    Trajectory,
    identify,
    load_document,
    load_log,
    typed,
)
from tune.documents.perception import perception_of
from tune.documents.profile import SafeProfile
from tune.documents.scene import Scene, load_scene
from tune.optimisation import optimise

File = str | PathLike[str]


@typed
def calibrate(
    logs: File | Trajectory | Trajectories | Sequence[File | Trajectory | Trajectories],
    scene: File | Scene,
    *,
    hardware: File | Hardware | None = None,
    columns: LogColumns | None = None,
    method: Method = "auto",
    allow: Collection[str] = (),
) -> SafeProfile:
    """Identify the device of logs and tune a scene for it; the device is kept in the profile.

    The command of this name also rehearses the profile in simulation before it is written.

    Args:
        logs: files or trajectories of one axis, one or several; or of several axes driven
            together, one of each pose.
        scene: file or scene; a perception table it names lies beside the file.
        hardware: file or document of what no log tells: motion, sample time and so on.
        columns: of the files; None takes `LogColumns()`.
        method: estimator.
        allow: codes of findings that are accepted.

    Raises:
        InvalidInputError: a file that cannot be read, or a fact that nobody stated.
        LogRefusedError: logs from which no device can be told.
        NoFeasibleEffectError: nothing of the scene can be played safely.
    """
    known = hardware
    if known is not None and not isinstance(known, Hardware):
        known = load_document(Hardware, known)
    motion, axis, axes = (None,) * 3 if known is None else (known.motion, known.axis, known.axes)

    def read(log: File | Trajectory | Trajectories) -> Trajectory | Trajectories:
        if isinstance(log, Trajectory | Trajectories):
            return log
        return load_log(log, columns, motion=motion, axis=axis, axes=axes)

    given = [logs] if isinstance(logs, str) or not isinstance(logs, Iterable) else logs
    device = identify([read(each) for each in given], hardware=known, method=method, allow=allow)
    wish = scene if isinstance(scene, Scene) else load_scene(scene)
    beside = Path() if isinstance(scene, Scene) else Path(scene).parent
    return optimise(device.device, wish, table=perception_of(wish, beside))
