"""A node of ROS 2 around the certified law: one axis, effort out for each position in.

    colcon build --packages-select haptune_controller
    ros2 run haptune_controller haptune_node --ros-args --params-file haptune_params.yaml

Reads sensor_msgs/JointState from ``joint_states`` and writes std_msgs/Float64MultiArray to
``commands``, as effort controllers of ros2_control take it; the parameters ``state_topic`` and
``command_topic`` name others. Fill in ``touched``. The joint is the profile's axis, or the
parameter ``joint``. Stamps number the periods of the loop, so they have to be those of the
readings. What is certified is the law, not the way that messages take: its time belongs to the
delay of the device, what differs of it too. Where they stop, or come half a period later than the
certificate covers, 0 goes out. What takes the efforts has to fall to 0 by itself where this node is
gone. A loop that must not miss a period plays the C guard.
"""

from __future__ import annotations

import signal
from typing import Any

import rclpy
from haptune_law import PROFILE, Law, Status
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

if PROFILE != "${digest}":
    raise ImportError(f"haptune_law.py is of another profile, {PROFILE}: export both again")

_NANOSECONDS = 1_000_000_000
#: By so much of a period may stamps fall behind the steady clock in one: clocks differ.
_DRIFT = 1e-3


class HaptuneNode(Node):
    """Plays the elements that are touched."""

    def __init__(self) -> None:
        super().__init__("${node}", automatically_declare_parameters_from_overrides=True)
        found = {name: each.value for name, each in self.get_parameters_by_prefix("").items()}
        if not found:
            raise ValueError(
                "no parameters came: give --ros-args --params-file haptune_params.yaml, "
                "in which the node has the name it runs under"
            )
        self.law, self.joints = self.made_of(found)
        self.step = self.law.sample_time * _NANOSECONDS
        self.first: int | None = None
        self.quickest: float | None = None
        self.ignored = 0
        self.inside: dict[str, Any] = {}
        self.commands = self.create_publisher(
            Float64MultiArray, found.get("command_topic", "commands"), 1
        )
        self.create_subscription(JointState, found.get("state_topic", "joint_states"), self.read, 1)
        # A clock that neither jumps nor stands still, as that of the system or a simulation may.
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        # After as many missed as are certified the next is due one period later; half a period is
        # for the way of messages, which belongs to the delay of the device.
        longest = (self.law.extra_delay + 1.5) * self.law.sample_time
        self.silence = self.create_timer(longest, self.stop, clock=self.steady)

    def made_of(self, found: dict[str, Any]) -> tuple[Any, list[str]]:
        """The law of these parameters, and the joints that it reads and drives."""
        return Law(found), [found.get("joint", found["axis"])]

    def touched(self, position: float) -> dict[str, tuple[float, int]]:
        """Fill in: each element touched there, and walls always, with (rest, side).

        Rest, m (rad), is the face of a wall, other springs rest where they are entered; side is 1
        for a wall that pushes towards growing positions and -1 for the other way. Both are taken
        when an element is entered, and when they change while it gives no force.
        """
        del position
        return {}

    def read(self, message: JointState) -> None:
        """One reading: the force of what is touched goes out, zero after anything not certified."""
        names = list(message.name)[: len(message.position)]
        lacking = [joint for joint in self.joints if joint not in names]
        if lacking:
            self.ignored += 1
            text = f"{self.ignored} messages ignored that have no position of {lacking[0]}, but of "
            text += f"{', '.join(names) or 'none'}: name the right one with the parameter "
            text += "joint" if len(self.joints) == 1 else "joints"
            self.get_logger().warning(text, throttle_duration_sec=1.0)
            return
        places = [message.position[names.index(joint)] for joint in self.joints]
        stamp = message.header.stamp.sec * _NANOSECONDS + message.header.stamp.nanosec
        self.first = stamp if self.first is None else self.first
        force = self.play(round((stamp - self.first) / self.step), places)
        if not self.law.waiting:  # the reading was used
            self.silence.reset()
        if self.overdue(stamp):
            force = self.ended()
        if self.law.status in (Status.LATE, Status.NOT_ENTERED):
            self.inside = {}
        if self.law.status is not Status.OK:
            text = f"{self.law.status.name}: {self.law.status.value}"
            self.get_logger().warning(text, throttle_duration_sec=1.0)
        self.commands.publish(Float64MultiArray(data=force))

    def play(self, period: int, places: list[float]) -> list[float]:
        """The force of what is touched; what is left, and what was ended, is entered anew."""
        now = self.touched(*places)
        for name, place in now.items():
            new = name not in self.inside
            moved = self.law.elements[name].one_sided and self.inside.get(name) != place
            if (new or moved) and self.law.reset([name], *place) is Status.OK:
                self.inside[name] = place
        self.inside = {name: place for name, place in self.inside.items() if name in now}
        return [self.law.force(list(now), period, *places)]

    def ended(self) -> list[float]:
        """No force, and every contact ended."""
        self.law.stop()
        return [0.0] * len(self.joints)

    def overdue(self, stamp: int) -> bool:
        """Whether a message took more periods longer than the quickest than are certified."""
        took = self.steady.now().nanoseconds - stamp
        if self.quickest is None or self.law.status is Status.LATE:  # its clock may have jumped
            self.quickest = took
        self.quickest = min(self.quickest + _DRIFT * self.step, took)
        return round((took - self.quickest) / self.step) > self.law.extra_delay

    def stop(self) -> None:
        """Nothing came for longer than is certified: no force until something is entered anew."""
        self.inside = {}
        self.commands.publish(Float64MultiArray(data=self.ended()))


def main(kind: type[HaptuneNode] = HaptuneNode) -> None:
    """Run the node until it is told to stop; the last that goes out is 0."""
    # What ROS does about signals would let nothing out after them.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node = kind()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.commands.publish(Float64MultiArray(data=[0.0] * len(node.joints)))
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
