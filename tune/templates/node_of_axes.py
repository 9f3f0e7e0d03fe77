"""A node of ROS 2 around the certified law of several axes: efforts out for the positions in.

    colcon build --packages-select haptune_controller
    ros2 run haptune_controller haptune_node_of_axes --ros-args --params-file haptune_params.yaml

As haptune_node, of which it is one; the joints are the profile's axes, or the parameter ``joints``.
Fill in ``touched``.
"""

from __future__ import annotations

from typing import Any

from haptune_axes import LawOfAxes
from haptune_law import Status
from haptune_node import HaptuneNode, main


class NodeOfAxes(HaptuneNode):
    """Plays the elements that are touched, on all axes."""

    def made_of(self, found: dict[str, Any]) -> tuple[Any, list[str]]:
        """The law of these parameters, and the joints that it reads and drives."""
        return LawOfAxes(found), list(found.get("joints", found["axes"]))

    def touched(self, *position: float) -> dict[str, tuple[str, list[float], float] | None]:
        """Fill in: what is touched there, m (rad).

        An element that is no wall stands by its name, with None. A face of a wall, near or far,
        stands by any name of its own with (wall, normal, offset): free space is where the product
        of normal, of length 1, and position is offset or more.
        """
        del position
        return {}

    def play(self, period: int, places: list[float]) -> list[float]:
        """The force of what is touched; what is left, and what was ended, is entered anew."""
        now = self.touched(*places)
        for name, face in now.items():
            if name in self.inside and self.inside[name] == face:
                continue
            done = self.law.enter([name]) if face is None else self.law.place(name, *face)
            if done is Status.OK:
                self.inside[name] = face
        self.inside = {name: face for name, face in self.inside.items() if name in now}
        faces = [name for name, face in now.items() if face is not None]
        return self.law.force([name for name in now if name not in faces], faces, period, places)


def run() -> None:
    """Run the node until it is told to stop."""
    main(NodeOfAxes)


if __name__ == "__main__":
    run()
