"""The files for ROS 2: the law in Python, its node, and messages that stop or come late."""

import math
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from importlib.metadata import Distribution
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from identification import UsageError
from tests.commands import haptune
from tests.exported import LOOPS, STEP, on_axes, tuned, walled
from tests.guard import STATUS, Guard, built, enter, module_of, parameters_of, push, write
from tune import export


class Middleware:
    """One node from the files of a folder, its timers and what it publishes."""

    def __init__(
        self, folder: Path, parameters: Mapping[str, Any], patch: pytest.MonkeyPatch
    ) -> None:
        self.now = 5_000_000_000
        self.sent: list[tuple[int, float]] = []
        self.others: list[list[float]] = []  # of further axes
        self.said: list[str] = []
        self.topics: list[str] = []
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
                ros.topics.append(topic)

                def publish(message: Any) -> None:
                    force, *others = message.data
                    ros.sent.append((ros.now, force))
                    ros.others.append(others)

                return SimpleNamespace(publish=publish)

            def create_subscription(self, kind: type, topic: str, back: Any, depth: int) -> None:
                ros.topics.append(topic)
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
            "rclpy": {"init": init, "spin": spin, "try_shutdown": lambda: None},
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


#: Sets that a hand may touch, some of them not certified.
TOUCHED = (
    (),
    ("wall",),
    ("other",),
    ("wall", "other"),
    ("wall", "other", "rubber"),
    ("cup",),
    ("wall", "cup"),
    ("other", "cup"),
    ("rubber",),
    ("rubber", "cup"),
)


class Knocked:
    """A fake device of mass and damping, and a hand that pushes at random."""

    def __init__(self, seed: int) -> None:
        self.source = np.random.default_rng(seed)
        self.place = self.speed = self.hand = 0.0

    def move(self, force: float) -> None:
        """One period under a force."""
        self.hand += 0.02 * (float(self.source.normal(0.0, 200.0)) - self.hand) - self.place
        self.speed += (force + self.hand - 10.0 * self.speed) / 3.0 * STEP
        self.place += self.speed * STEP


def drive(law: Any, guard: Guard, samples: int) -> tuple[float, set[str]]:
    """Play both on one device, to the last bit alike: (largest force, every status seen)."""
    device = Knocked(samples)
    source = device.source
    places = {name: 1 << place for place, name in enumerate(law.names)}
    guard.start()
    touched: tuple[str, ...] = ()
    largest = 0.0
    seen: set[str] = set()
    for k in range(samples):
        changes = source.random()
        if changes < 0.01:
            touched = TOUCHED[source.integers(len(TOUCHED))]
        elements = sum(places[name] for name in touched)
        if changes < 0.02:
            chosen = [touched, touched[:1], law.names][source.integers(3)]
            rest = device.place + float(source.choice([0.0, 0.01, -0.01]))
            side = int(source.choice([-1, 0, 1], p=[0.45, 0.1, 0.45]))
            told = guard.call(enter(sum(places[name] for name in chosen), rest, side)).status
            assert law.reset(chosen, rest, side).name == told
            seen.add(told)
        period = (2**32 - 500 + k) % 2**32
        reading, chance, gain = device.place, source.random(), 1.0
        if chance < 0.02:  # nothing came, for one period or several
            device.move(law.last_force)
            if chance > 0.0005:
                continue
        elif chance < 0.025:
            reading = float(source.choice([np.nan, np.inf, reading + 0.3]))
        elif chance < 0.03:
            period = (period - 1) % 2**32
        elif chance < 0.1:
            gain = float(source.choice([0.0, 0.5, 1.5]))
        force = law.force(touched, period, reading, gain)
        reply = guard.call(push(elements, period, reading, gain))
        assert (law.status.name, law.clamped) == (reply.status, reply.clamped)
        assert (law.missed, law.glitches) == (reply.missed, reply.glitches)
        assert force == reply.force
        assert abs(force) <= law.peak
        walls = [law.elements[name] for name in law.walls]
        assert all(wall.force * wall.side >= 0 for wall in walls)
        largest = max(largest, abs(force))
        seen.add(reply.status)
        device.move(force)
    return largest, seen


@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("as-tuned", 10_000),
        *(pytest.param(name, 100_000, marks=pytest.mark.long) for name in LOOPS),
    ],
)
def test_the_law_in_python_keeps_to_the_forces_of_the_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, samples: int
) -> None:
    profile = walled(**LOOPS[name])
    files = export(profile, "ros2")
    write(files, tmp_path)
    law = module_of(tmp_path, "haptune_law", monkeypatch).Law(
        parameters_of(files["haptune_params.yaml"])
    )
    largest, seen = drive(law, built(export(profile, "c"), tmp_path), samples)
    assert largest > 10
    assert seen == set(STATUS)


def test_the_node_plays_the_law_by_the_stamps_of_its_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = export(walled(), "ros2", node="/robot/haptune_x")
    write(files, tmp_path)
    given = parameters_of(files["haptune_params.yaml"], "/robot/haptune_x")
    ros = Middleware(tmp_path, given, monkeypatch)
    law = sys.modules["haptune_law"]

    class Played(ros.module.HaptuneNode):
        def touched(self, position: float) -> dict[str, tuple[float, int]]:
            rubber = {"rubber": (9.0, 0)} if position > 0 else {}
            return {"wall": (0.0 if node.law.missed < 2 else 1e-3, -1)} | rubber

    node, alone = Played(), law.Law(given)
    with pytest.raises(ValueError, match="full names"):
        law.Law({"digest": given["digest"], "force_limit": {"peak": given["force_limit.peak"]}})
    assert node.name == "haptune_x"
    periods = [*range(20), *range(21, 40), *range(50, 80), *range(81, 300)]
    wanted: list[float] = []
    inside: dict[str, tuple[float, int]] = {}
    for period in periods:
        place = 0.002 * np.sin(period / 10)
        now = 1_000_000_000 + period * 1_000_000 + 40_000 * (period % 3)
        touched = node.touched(place)
        ros.now = now
        ros.deliver(now, ["other", "x"], [9.0, place])
        for name, entry in touched.items():
            if inside.get(name) != entry and alone.reset([name], *entry).name == "OK":
                inside[name] = entry
        wanted.append(alone.force(list(touched), period, place))
        inside = {name: inside[name] for name in touched if name in inside}
        if alone.status.name == "LATE":
            inside = {}
    assert [force for _, force in ros.sent] == wanted
    assert min(wanted) < -0.5
    assert wanted[60:70] != [0.0] * 10
    assert alone.elements["wall"].face == 1e-3
    assert any(text.startswith("LATE") for text in ros.said)


def test_the_node_of_axes_plays_faces_and_elements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Joints in any order; a floor that is met, rubber that is entered and left."""
    files = export(on_axes(2), "ros2")
    write(files, tmp_path)
    given = parameters_of(files["haptune_params.yaml"])
    ros = Middleware(tmp_path, given, monkeypatch)
    axes = module_of(tmp_path, "haptune_axes", monkeypatch)
    module = module_of(tmp_path, "haptune_node_of_axes", monkeypatch)
    floor = ("wall", [0.0, 1.0], 0.0)

    class Played(module.NodeOfAxes):
        def touched(self, *position: float) -> Mapping[str, tuple[str, list[float], float] | None]:
            return {"floor": floor} | ({"rubber": None} if position[0] > 0 else {})

    node, alone = Played(), axes.LawOfAxes(given)
    assert alone.place("floor", *floor).name == "OK"
    wanted: list[list[float]] = []
    inside = False
    for period in range(400):
        place = [0.002 * math.sin(period / 30), 0.002 * math.cos(period / 40)]
        ros.now = 1_000_000_000 + period * 1_000_000
        ros.deliver(ros.now, ["y", "other", "x"], [place[1], 9.0, place[0]])
        if place[0] > 0 and not inside:
            assert alone.enter(["rubber"]).name == "OK"
        inside = place[0] > 0
        wanted.append(alone.force(["rubber"] * inside, ["floor"], period, place))
    assert [[each, *rest] for (_, each), rest in zip(ros.sent, ros.others, strict=True)] == wanted
    assert max(force[1] for force in wanted) > 1
    assert min(force[0] for force in wanted) < -0.1
    ros.deliver(2_000_000_000, ["x"], [0.0])
    assert "no position of y" in ros.said[-1]
    node.stop()
    assert (ros.sent[-1][1], ros.others[-1]) == (0.0, [0.0])


@pytest.mark.parametrize("name", ["9x", "a-b", "/robot//x", "robot/x", "", "9 bad\nfoo: {}"])
def test_a_name_that_no_node_can_have_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="is no name of a node"):
        export(tuned(), "ros2", node=name)


#: ns, one period.
PERIOD = 1_000_000


class Bench:
    """A node whose damper pushes with 3 N all the time, and how its messages come."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, extra: int = 1) -> None:
        profile = tuned()
        wall = profile.elements["wall"].model_copy(update={"stiffness": 0.0, "damping": 30.0})
        seal = profile.certificate.model_copy(update={"extra_delay_samples": float(extra)})
        changed = {"elements": {**profile.elements, "wall": wall}, "certificate": seal}
        files = export(profile.model_copy(update=changed).signed(), "ros2")
        write(files, folder)
        self.ros = Middleware(folder, parameters_of(files["haptune_params.yaml"]), patch)

        class Pushed(self.ros.module.HaptuneNode):
            def touched(self, position: float) -> dict[str, tuple[float, int]]:
                return {"wall": (0.0, 0)}

        self.node: Any = Pushed()
        self.extra = extra
        #: The last half is for the way of the next message.
        self.covered = (2 * extra + 3) * PERIOD // 2
        self.stamps = 1_700_000_000_000_000_000  # what the clock of stamps is ahead
        self.period = 0

    @property
    def force(self) -> float:
        """What is held at this moment, N."""
        return self.ros.sent[-1][1]

    def message(self, *, late: float = 0.0) -> None:
        """The reading of the next period at a steady speed, so many periods later than usual."""
        self.period += 1
        read = 5_000_000_000 + self.period * PERIOD
        self.ros.advance(read + round(late * PERIOD))
        self.ros.deliver(read + self.stamps, ["other", "x"], [9.0, 1e-4 * self.period])

    def settle(self, messages: int = 60) -> None:
        """Until it pushes, as it has to be able to at any time."""
        for _ in range(messages):
            self.message()
        assert self.force < -1.0

    def held(self) -> list[tuple[int, int, float]]:
        """(from, to, N) of all that stood at the output."""
        ends = [time for time, _ in self.ros.sent[1:]] + [self.ros.now]
        return [(a, b, f) for (a, f), b in zip(self.ros.sent, ends, strict=True)]


@pytest.fixture
def bench(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(tmp_path, monkeypatch, getattr(request, "param", 1))


#: With as many lost messages certified.
each_extra = pytest.mark.parametrize("bench", [1, 2], indirect=True)


@each_extra
def test_where_messages_stop_there_is_0_within_the_periods_covered(bench: Bench) -> None:
    bench.period += 50
    bench.ros.advance(bench.ros.now + 50 * PERIOD)  # before the first there is none either
    assert {force for _, force in bench.ros.sent} == {0.0}
    bench.settle()
    last = bench.ros.now
    bench.ros.advance(last + bench.covered - PERIOD // 10)
    assert bench.force < -1.0
    bench.ros.advance(last + bench.covered)
    assert bench.force == 0.0
    bench.ros.advance(last + 10**9)
    assert bench.force == 0.0
    bench.period += 1000
    bench.message()
    assert bench.force == 0.0
    bench.settle()


@each_extra
def test_as_many_lost_messages_as_are_certified_end_no_contact(bench: Bench) -> None:
    """However long the next one is on its way, up to half a period."""
    bench.settle()
    for _ in range(20):
        bench.ros.sent.clear()
        bench.period += bench.extra
        bench.message(late=0.4)
        bench.message()
        assert len(bench.ros.sent) == 2
        assert max(force for _, force in bench.ros.sent) < -1.0


def test_after_a_silence_no_force_from_before_comes_back(bench: Bench) -> None:
    """With the next stamp in order and a reading that cannot be: nothing is held but 0."""
    bench.settle()
    bench.ros.advance(bench.ros.now + bench.covered)
    assert bench.force == 0.0
    bench.period += 1
    stamp = 5_000_000_000 + bench.period * PERIOD + bench.stamps
    for place in (math.nan, 1.0):
        bench.ros.deliver(stamp, ["x"], [place])
        assert bench.force == 0.0


@pytest.mark.parametrize("kind", ["no number", "stale", "impossible"])
def test_readings_that_are_of_no_use_keep_no_force_alive(bench: Bench, kind: str) -> None:
    bench.settle()
    last = bench.ros.now
    for k in range(1, 4):
        bench.ros.advance(last + k * (bench.covered - PERIOD // 10))
        period = bench.period + (0 if kind == "stale" else k)
        place = math.nan if kind == "no number" else 1.0 if kind == "impossible" else 0.0
        bench.ros.deliver(5_000_000_000 + period * PERIOD + bench.stamps, ["x"], [place])
        assert bench.force == 0.0 or (k == 1 and kind != "stale")
    assert max(b for a, b, f in bench.held() if f) <= last + bench.covered


@pytest.mark.parametrize(
    ("names", "places"),
    [(["other"], [0.005]), (["x"], []), (["other", "x"], [0.005])],
)
def test_messages_without_the_joint_are_counted_and_keep_nothing_alive(
    bench: Bench, names: list[str], places: list[float]
) -> None:
    bench.settle()
    last = bench.ros.now
    for k in range(1, 41):
        bench.ros.advance(last + k * PERIOD // 4)
        bench.ros.deliver(last + bench.stamps, names, places)
        assert (bench.force == 0.0) == (k * PERIOD // 4 >= bench.covered)
    assert bench.node.ignored == 40
    assert "40 messages ignored" in bench.ros.said[-1]
    bench.period += 10
    bench.settle()
    for _ in range(50):  # and disturb nothing between the others
        bench.ros.deliver(bench.ros.now + bench.stamps, names, places)
        bench.message()
        assert bench.force < -1.0


@each_extra
def test_readings_that_grow_old_on_their_way_give_no_force(bench: Bench) -> None:
    """A third of a period later each, and in order: none stops for long, each is older."""
    bench.settle()
    for k in range(1, 60):
        bench.message(late=k / 3)
        assert (bench.force == 0.0) == (k / 3 > bench.extra + 0.5)
    for _ in range(70):
        bench.message(late=20.0)
        assert bench.force == 0.0


@pytest.mark.parametrize("jump", [3600.0, -3600.0, -0.003])
def test_a_jump_of_the_clock_of_stamps_ends_neither_node_nor_limits(
    bench: Bench, jump: float
) -> None:
    """In both directions, once and every tenth period."""
    for count in (1, 5):
        bench.settle()
        for _ in range(count):
            bench.stamps += round(jump * 1e9)
            for _ in range(10):
                bench.message()
    for _ in range(7000):  # what is later for good is late until clocks may have drifted so far
        bench.message()
    bench.settle()


@pytest.mark.parametrize("drift", [5e-4, -5e-4])
def test_clocks_that_run_apart_disturb_nothing(bench: Bench, drift: float) -> None:
    bench.settle()
    for _ in range(4000):
        bench.stamps += round(drift * PERIOD)
        bench.message()
        assert bench.force < -1.0


def chaos(bench: Bench, source: random.Random, messages: int) -> None:
    """Whatever comes, no force is held beyond what is covered after a message of the joint."""
    bench.ros.advance(bench.ros.now + 10**9)
    bench.ros.sent.clear()
    last = [bench.ros.now]
    deliver = bench.ros.deliver

    def noted(stamp: int, names: Sequence[str] = (), places: Sequence[float] = ()) -> None:
        if "x" in names[: len(places)]:
            last.append(bench.ros.now)
        deliver(stamp, names, places)

    bench.ros.deliver = noted
    late = 0.0
    acts: tuple[Callable[[], None], ...] = (
        lambda: bench.ros.advance(bench.ros.now + source.randrange(20 * PERIOD)),
        lambda: noted(bench.ros.now, ["other"], [1.0]),
        lambda: noted(0, ["x"], []),
        lambda: noted(bench.ros.now + bench.stamps, ["x"], [math.nan]),
        lambda: noted(source.randrange(2**62), ["x"], [source.uniform(-1, 1)]),
    )
    for _ in range(messages):
        if source.random() < 0.05:
            source.choice(acts)()
        if source.random() < 0.02:
            bench.stamps += source.choice([-1, 1]) * source.randrange(
                1, 10 ** source.randint(6, 15)
            )
            bench.stamps = max(bench.stamps, 10**9)
        if source.random() < 0.05:
            late = source.choice([0.0, 0.0, source.uniform(0, 6)])
        bench.period += source.random() < 0.02
        bench.message(late=late)
    bench.ros.advance(bench.ros.now + 10**9)
    bench.ros.deliver = deliver
    pushed = 0
    for begun, ended, force in bench.held():
        before = max(time for time in last if time <= begun)
        assert force == 0.0 or ended - before <= bench.covered
        assert -28.0 <= force <= 28.0
        pushed += force != 0.0
    assert pushed > messages // 10


@pytest.mark.parametrize("seed", [1, pytest.param(None, marks=pytest.mark.long)])
def test_whatever_comes_no_force_outlives_its_message(bench: Bench, seed: int | None) -> None:
    for each in range(200) if seed is None else [seed]:
        chaos(bench, random.Random(each), 600)  # noqa: S311


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError])
def test_the_last_that_goes_out_is_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: type[BaseException]
) -> None:
    bench = Bench(tmp_path, monkeypatch)
    before = signal.getsignal(signal.SIGTERM)

    def spin(node: Any) -> None:
        bench.ros.callback = bench.node.read
        bench.settle()
        if ending is KeyboardInterrupt:
            signal.raise_signal(signal.SIGTERM)
        raise ending

    bench.ros.spin = spin
    expected = nullcontext() if ending is KeyboardInterrupt else pytest.raises(ending)
    try:
        with expected:
            bench.ros.module.main()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert bench.force == 0.0


def test_files_of_two_profiles_do_not_load_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = export(tuned(), "ros2")
    other = export(tuned().model_copy(update={"notes": ("another",)}).signed(), "ros2")
    own, foreign = (parameters_of(each["haptune_params.yaml"]) for each in (one, other))
    write(one, tmp_path)
    ros = Middleware(tmp_path, foreign, monkeypatch)
    for parameters in (foreign, {k: v for k, v in own.items() if k != "digest"}):
        ros = Middleware(tmp_path, parameters, monkeypatch)
        with pytest.raises(ValueError, match="export both again"):
            ros.module.HaptuneNode()
    write({"haptune_node.py": other["haptune_node.py"]}, tmp_path)
    with pytest.raises(ImportError, match="export both again"):
        Middleware(tmp_path, own, monkeypatch)


def test_the_export_is_a_package_whose_entry_point_plays(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Installed from its folder, as colcon does; the node runs on a stand-in of the middleware."""
    Path("profile.yaml").write_text(tuned().to_yaml(), encoding="utf-8")
    assert haptune("export", "profile.yaml", "--to", "ros2").code == 0
    package = ElementTree.parse("haptune_controller/package.xml").getroot()  # noqa: S314 - ours
    assert package.findtext("name") == "haptune_controller"
    assert package.findtext("export/build_type") == "ament_python"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    pip += ["--no-build-isolation", "--target", "there", "./haptune_controller"]
    subprocess.run(pip, check=True, capture_output=True)
    there = here / "there"
    index = there / "share" / "ament_index" / "resource_index" / "packages"
    assert (index / "haptune_controller").is_file()
    (found,) = Distribution.discover(name="haptune_controller", path=[str(there)])
    (entry,) = found.entry_points.select(group="console_scripts")
    assert entry.name == "haptune_node"
    text = (there / "share" / "haptune_controller" / "haptune_params.yaml").read_text("utf-8")
    renamed = {"joint": "elbow", "state_topic": "arm/states", "command_topic": "arm/efforts"}
    ros = Middleware(there, parameters_of(text) | renamed, monkeypatch)
    ros.spin = lambda node: ros.deliver(1_000_000, ("wrist",), (0.1,))
    assert entry.module == ros.module.__name__
    getattr(ros.module, entry.attr)()
    assert ros.topics == ["arm/efforts", "arm/states"]
    (said,) = ros.said
    assert "no position of elbow, but of wrist" in said
    assert [force for _, force in ros.sent] == [0.0]
    ros = Middleware(there, {}, monkeypatch)
    with pytest.raises(ValueError, match="no parameters came"):
        ros.module.HaptuneNode()
