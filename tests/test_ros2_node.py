"""The ROS 2 node where messages stop, come late, are of another joint, and clocks jump."""

from __future__ import annotations

import math
import random
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.exported import tuned
from tests.guard import parameters_of, write
from tests.middleware import Middleware
from tune import SafeProfile, export

#: ns, one period.
STEP = 1_000_000


class Bench:
    """A node whose damper pushes with 3 N all the time, and how its messages come."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, extra: int = 1) -> None:
        files = export(_pushing(extra), "ros2")
        write(files, folder)
        self.ros = Middleware(folder, parameters_of(files["haptune_params.yaml"]), patch)

        class Pushed(self.ros.module.HaptuneNode):
            def touched(self, position: float) -> dict[str, tuple[float, int]]:
                return {"wall": (0.0, 0)}

        self.node: Any = Pushed()
        self.covered = (extra + 1) * STEP
        self.stamps = 1_700_000_000_000_000_000  # what the clock of stamps is ahead
        self.period = 0

    @property
    def force(self) -> float:
        """What is held at this moment, N."""
        return self.ros.sent[-1][1]

    def message(self, *, late: float = 0.0) -> None:
        """The reading of the next period, which takes so many periods longer than usual."""
        self.period += 1
        read = 5_000_000_000 + self.period * STEP
        self.ros.advance(read + round(late * STEP))
        self.ros.deliver(read + self.stamps, ["other", "x"], [9.0, self.place(self.period)])

    def place(self, period: int) -> float:
        """At a steady speed, m."""
        return 1e-4 * period

    def settle(self, messages: int = 60) -> None:
        """Until it pushes, as it has to be able to at any time."""
        for _ in range(messages):
            self.message()
        assert self.force < -1.0

    def held(self) -> list[tuple[int, int, float]]:
        """(from, to, N) of all that stood at the output."""
        ends = [time for time, _ in self.ros.sent[1:]] + [self.ros.now]
        return [(a, b, f) for (a, f), b in zip(self.ros.sent, ends, strict=True)]


def _pushing(extra: int) -> SafeProfile:
    profile = tuned()
    wall = profile.elements["wall"].model_copy(update={"stiffness": 0.0, "damping": 30.0})
    seal = profile.certificate.model_copy(update={"extra_delay_samples": float(extra)})
    elements = {**profile.elements, "wall": wall}
    return profile.model_copy(update={"elements": elements, "certificate": seal})


@pytest.fixture(params=[1, 2])
def bench(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(tmp_path, monkeypatch, request.param)


def test_before_the_first_message_there_is_no_force(bench: Bench) -> None:
    bench.ros.advance(bench.ros.now + 50 * STEP)
    assert bench.ros.sent
    assert {force for _, force in bench.ros.sent} == {0.0}


@pytest.mark.parametrize("wait", [0.2, 0.9])
def test_where_messages_stop_there_is_0_within_the_periods_covered(
    bench: Bench, wait: float
) -> None:
    bench.settle()
    last = bench.ros.now
    bench.ros.advance(last + bench.covered - round((1 - wait) * STEP))
    assert bench.force < -1.0
    bench.ros.advance(last + bench.covered)
    assert bench.force == 0.0
    bench.ros.advance(last + 10**9)
    assert bench.force == 0.0
    bench.period += 1000
    bench.message()
    assert bench.force == 0.0
    bench.settle()


def test_after_a_silence_no_force_from_before_comes_back(bench: Bench) -> None:
    """With the next stamp in order and a reading that cannot be: nothing is held but 0."""
    bench.settle()
    bench.ros.advance(bench.ros.now + bench.covered)
    assert bench.force == 0.0
    bench.period += 1
    stamp = 5_000_000_000 + bench.period * STEP + bench.stamps
    for place in (math.nan, 1.0):
        bench.ros.deliver(stamp, ["x"], [place])
        assert bench.force == 0.0


@pytest.mark.parametrize("kind", ["no number", "stale", "impossible"])
def test_readings_that_are_of_no_use_keep_no_force_alive(bench: Bench, kind: str) -> None:
    bench.settle()
    last = bench.ros.now
    for k in range(1, 4):
        bench.ros.advance(last + k * (bench.covered - STEP // 10))
        period = bench.period + (0 if kind == "stale" else k)
        place = math.nan if kind == "no number" else 1.0 if kind == "impossible" else 0.0
        bench.ros.deliver(5_000_000_000 + period * STEP + bench.stamps, ["x"], [place])
        assert bench.force == 0.0 or (k == 1 and kind != "stale")
    assert max(b for a, b, f in bench.held() if f) <= last + bench.covered


@pytest.mark.parametrize(
    ("names", "places"),
    [(["other"], [0.005]), ([], []), (["x"], []), (["other", "x"], [0.005]), ([], [0.005])],
)
def test_messages_without_the_joint_are_counted_and_keep_nothing_alive(
    bench: Bench, names: list[str], places: list[float]
) -> None:
    bench.settle()
    last = bench.ros.now
    for k in range(1, 41):
        bench.ros.advance(last + k * STEP // 4)
        bench.ros.deliver(last + bench.stamps, names, places)
        assert (bench.force == 0.0) == (k * STEP // 4 >= bench.covered)
    assert bench.node.ignored == 40
    assert "40 messages ignored" in bench.ros.said[-1]
    bench.period += 10
    bench.settle()
    for _ in range(50):  # and disturb nothing between the others
        bench.ros.deliver(bench.ros.now + bench.stamps, names, places)
        bench.message()
        assert bench.force < -1.0


def test_readings_that_grow_old_on_their_way_give_no_force(bench: Bench) -> None:
    """A third of a period later each, and in order: none stops for long, each is older."""
    bench.settle()
    for k in range(1, 60):
        bench.message(late=k / 3)
        assert (bench.force == 0.0) == (k / 3 > (bench.covered / STEP - 0.5))
    for _ in range(70):
        bench.message(late=20.0)
        assert bench.force == 0.0


def test_a_queue_that_comes_at_once_gives_force_from_new_readings_alone(bench: Bench) -> None:
    bench.settle()
    for k in range(40, 0, -1):
        bench.message(late=float(k))
        if k > bench.covered // STEP:
            assert bench.force == 0.0
    bench.settle()


@pytest.mark.parametrize("jump", [3600.0, -3600.0, 0.02, -0.02, 0.003, -0.003, -0.001, 4294967.296])
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
    for _ in range(6000):
        bench.stamps += round(drift * STEP)
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
        lambda: bench.ros.advance(bench.ros.now + source.randrange(20 * STEP)),
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
    try:
        if ending is KeyboardInterrupt:
            bench.ros.module.main()
        else:
            with pytest.raises(ending):
                bench.ros.module.main()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert bench.force == 0.0


def test_files_of_two_profiles_do_not_load_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = export(tuned(), "ros2")
    other = export(tuned().model_copy(update={"digest": "sha256:" + "12" * 32}), "ros2")
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
