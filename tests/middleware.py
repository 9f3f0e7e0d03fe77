"""A stand-in of ROS 2's middleware: what the exported node takes of rclpy, and a clock to set."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest


def module_of(folder: Path, name: str, patch: pytest.MonkeyPatch) -> Any:
    """An exported Python file as a module, found by others of its folder by its name."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    patch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    return module


class Middleware:
    """One node from the files of a folder, its timers and what it publishes."""

    def __init__(
        self, folder: Path, parameters: Mapping[str, Any], patch: pytest.MonkeyPatch
    ) -> None:
        self.now = 5_000_000_000
        self.sent: list[tuple[int, float]] = []
        self.said: list[str] = []
        self.callback: Any = None
        self.due: list[Any] = []
        self.spin: Any = None
        self._parameters = parameters
        self._install(patch)
        module_of(folder, "haptune_law", patch)
        self.module = module_of(folder, "haptune_node", patch)

    def deliver(
        self, stamp: int, names: Sequence[str] = ("x",), places: Sequence[float] = ()
    ) -> None:
        """A message of joints, with the time at which they were read, ns."""
        time = SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = SimpleNamespace(stamp=time)
        self.callback(SimpleNamespace(header=header, name=list(names), position=list(places)))

    def advance(self, until: int) -> None:
        """Let time go by to a moment of the steady clock, ns; timers come when they are due."""
        while self.due and (first := min(self.due, key=lambda each: each.at)).at <= until:
            self.now = first.at
            first.at += first.period
            first.callback()
        self.now = max(self.now, until)

    def _install(self, patch: pytest.MonkeyPatch) -> None:
        ros = self

        class Node:
            def __init__(self, name: str, **options: Any) -> None:
                assert options == {"automatically_declare_parameters_from_overrides": True}
                self.name = name

            def get_parameters_by_prefix(self, prefix: str) -> dict[str, Any]:
                assert prefix == ""
                return {name: SimpleNamespace(value=x) for name, x in ros._parameters.items()}

            def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
                def publish(message: Any) -> None:
                    (force,) = message.data
                    ros.sent.append((ros.now, force))

                return SimpleNamespace(publish=publish)

            def create_subscription(self, kind: type, topic: str, back: Any, depth: int) -> None:
                ros.callback = back

            def create_timer(self, seconds: float, callback: Any, *, clock: Any) -> Any:
                assert clock.kind == "steady"  # others may jump, or stand still
                period = round(seconds * 1e9)
                timer = SimpleNamespace(at=ros.now + period, period=period, callback=callback)
                timer.reset = lambda: setattr(timer, "at", ros.now + period)
                ros.due.append(timer)
                return timer

            def get_logger(self) -> Any:
                return SimpleNamespace(warning=lambda text, **options: ros.said.append(text))

            def destroy_node(self) -> None:
                ros.callback = None

        class Clock:
            def __init__(self, *, clock_type: str) -> None:
                self.kind = clock_type

            def now(self) -> Any:
                assert self.kind == "steady"
                return SimpleNamespace(nanoseconds=ros.now)

        def init(*, signal_handler_options: str) -> None:
            assert signal_handler_options == "no"  # else nothing goes out after a signal

        def spin(node: Any) -> None:
            ros.spin(node)

        modules: dict[str, dict[str, Any]] = {
            "rclpy": {
                "init": init,
                "spin": spin,
                "try_shutdown": lambda: None,
            },
            "rclpy.clock": {"Clock": Clock, "ClockType": SimpleNamespace(STEADY_TIME="steady")},
            "rclpy.node": {"Node": Node},
            "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO="no")},
            "sensor_msgs": {},
            "sensor_msgs.msg": {"JointState": SimpleNamespace},
            "std_msgs": {},
            "std_msgs.msg": {"Float64MultiArray": SimpleNamespace},
        }
        for name, content in modules.items():
            module = ModuleType(name)
            module.__dict__.update(content)
            patch.setitem(sys.modules, name, module)
