"""Many devices: rows that depend on no worker, folders that are resumed, devices unlike others."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import polars as pl
import pytest

import haptune as door
import identification
from identification import InvalidInputError, UsageError, load_device
from tests.commands import FLUID, haptune
from tests.fleet_logs import fleet_logs
from tests.processes import needs_posix
from tune import Scene, load_profile, optimise, study
from tune.documents.manifest import load_manifest
from tune.optimisation.study import QUANTITIES
from tune.presentation.fleet import unlike_others

COMMAND = (
    *("fleet", "manifest.csv", "--scene", "scene.yaml", "--hardware", "hardware.yaml"),
    *("--method", "least-squares"),
)
COUNT, ODD = 6, 2


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of logs, one of them none, and ``fleet`` of them; what came of it is not changed."""
    folder = tmp_path_factory.mktemp("calibrated")
    fleet_logs(folder, COUNT, unlike=ODD, samples=2000)
    with (folder / "manifest.csv").open("a", encoding="utf-8") as manifest:
        manifest.write("SNnone,logs/none.csv\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = haptune(*COMMAND, "--workers", "1")
    assert done.code == 3
    assert f"{COUNT} of {COUNT + 1} devices tuned and proved safe; 1 refused" in done.out
    assert "1 not like the others: SN2" in done.out
    assert "SNnone (3): " in done.err
    return folder


@pytest.fixture
def here(calibrated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder, in which a test may do what it likes."""
    shutil.copytree(calibrated, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def table(folder: Path = Path("fleet")) -> pl.DataFrame:
    return pl.read_parquet(folder / "results.parquet")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def records(folder: Path) -> list[Path]:
    return list((folder / "records").glob("*.json"))


def test_each_device_gets_what_calibrate_gives_it(calibrated: Path, here: Path) -> None:
    found = table()
    assert found["name"].to_list() == [*(f"SN{k}" for k in range(COUNT)), "SNnone"]
    assert found["exit_code"].to_list() == [0] * COUNT + [3]
    assert "cannot be read" in found["sentence"][COUNT]
    one = haptune("calibrate", "logs/SN1.csv", *COMMAND[2:])
    assert one.code == 0, one.err
    alone, profile = load_profile("profile.yaml"), load_profile("fleet/profiles/SN1.yaml")
    assert profile.device.serial == "SN1"
    assert profile.elements == alone.elements
    assert profile.certificate == alone.certificate
    row = found.row(1, named=True)
    assert row["digest"] == profile.digest
    assert row["mass_low"] == profile.device.mass.low
    assert row["water.damping"] == profile.elements["water"].damping
    page = (calibrated / "fleet" / "summary.html").read_text(encoding="utf-8")
    assert "not like the others" in page
    assert "SNnone" in page
    for name in ("mass", "damping", "water damping"):
        assert re.search(rf"\b{name}\s[^\n]*\s{COUNT}\s", re.sub(r"<[^>]*>", " ", page)), name
    assert not re.search(r"(src|href)=.(?!data:)", page)


def test_what_is_done_and_unchanged_is_not_done_again(here: Path) -> None:
    before = contents(here / "fleet")
    times = {path: path.stat().st_mtime_ns for path in records(here / "fleet")}
    again = haptune(*COMMAND, "--json")
    assert again.result["details"]["done_before"] == COUNT + 1
    assert contents(here / "fleet") == before
    assert {path: path.stat().st_mtime_ns for path in records(here / "fleet")} == times
    # Another log, a profile that somebody changed, a log that is none now, and one that came late.
    shutil.copy("logs/SN1.csv", "logs/SN0.csv")
    with Path("fleet/profiles/SN3.yaml").open("a", encoding="utf-8") as profile:
        profile.write("# changed\n")
    Path("logs/SN5.csv").write_text("time,force,position\n0,1,0\n", encoding="utf-8")
    shutil.copy("logs/SN4.csv", "logs/none.csv")
    told = haptune(*COMMAND, "--dry-run")
    listed = re.findall(r"dry run: (\w+) would", told.out)
    assert listed == ["SN0", "SN3", "SN5", "SNnone"]
    done = haptune(*COMMAND, "--workers", "1")
    assert done.code == 4
    assert table()["exit_code"].to_list() == [0] * (COUNT - 1) + [4, 0]
    assert table()["mass"][0] == table()["mass"][1]
    after = contents(here / "fleet")
    assert after["profiles/SN3.yaml"] == before["profiles/SN3.yaml"]
    assert "profiles/SN5.yaml" not in after  # what is refused later loses its profile
    assert after["profiles/SN5.yaml.bak"] == before["profiles/SN5.yaml"]
    # Another scene: all of them.
    Path("scene.yaml").write_text(FLUID.replace("10", "9"), encoding="utf-8")
    assert haptune(*COMMAND, "--dry-run").out.count("would be done") == COUNT + 1


def run_in_background(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    code = "import sys; from tune.cli import main; sys.argv[0] = 'haptune'; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *COMMAND, *more],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def wait_for(folder: Path, count: int, running: subprocess.Popen[bytes]) -> None:
    while len(records(folder)) < count and running.poll() is None:
        time.sleep(0.01)


@needs_posix
@pytest.mark.parametrize(
    ("workers", "counts"),
    [("1", [2]), pytest.param("2", range(1, COUNT + 2), marks=pytest.mark.long)],
)
def test_killed_and_run_again_gives_the_same(
    calibrated: Path, here: Path, workers: str, counts: Sequence[int]
) -> None:
    shutil.rmtree("fleet")
    for count in counts:
        running = run_in_background(here, "--workers", workers)
        wait_for(here / "fleet", count, running)
        os.killpg(running.pid, signal.SIGKILL)
        running.communicate()
        assert len(records(here / "fleet")) >= count
    haptune(*COMMAND, "--workers", workers)
    assert contents(here / "fleet") == contents(calibrated / "fleet")


def test_interrupted_it_says_how_many_are_done(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SN3", "SN4"):
        Path(f"fleet/records/{name}.json").unlink()
    write = identification.write_bytes

    def write_or_stop(path: Path, content: bytes) -> object:
        if path.name == "SN4.yaml":
            raise KeyboardInterrupt
        return write(path, content)

    monkeypatch.setattr(identification, "write_bytes", write_or_stop)
    done = haptune(*COMMAND, "--workers", "1")
    assert done.code == 130
    assert f"interrupted; {COUNT} of {COUNT + 1} devices done; run it again" in done.err


@pytest.mark.long
@needs_posix
def test_a_worker_that_is_killed_loses_nothing(calibrated: Path, here: Path) -> None:
    shutil.rmtree("fleet")
    running = run_in_background(here, "--workers", "2")
    wait_for(here / "fleet", 1, running)
    workers = subprocess.run(
        ["pgrep", "-P", str(running.pid), "-f", "popen_loky"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout.split()
    os.kill(int(workers[0]), signal.SIGKILL)
    assert running.wait() == 3
    running.communicate()
    assert contents(here / "fleet") == contents(calibrated / "fleet")


@pytest.fixture
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a Dask scheduler on this machine, and its two worker processes."""
    distributed = pytest.importorskip("distributed")
    port = "18786"
    address = f"tcp://127.0.0.1:{port}"

    def begun(what: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--no-dashboard", *arguments]
        return subprocess.Popen(command, stderr=subprocess.DEVNULL)

    scheduler = begun("dask_scheduler", "--host", "127.0.0.1", "--port", port)
    workers = [begun("dask_worker", address, "--nthreads", "1", "--no-nanny") for _ in range(2)]
    try:
        with distributed.Client(address, timeout="60s", set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


@pytest.mark.long
@needs_posix
def test_a_dask_cluster_that_loses_a_worker_loses_and_doubles_nothing(
    calibrated: Path, here: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = cluster
    shutil.rmtree("fleet")
    running = run_in_background(here, "--scheduler", address)
    wait_for(here / "fleet", 2, running)
    workers[0].kill()
    assert running.wait(timeout=600) == 3
    running.communicate()
    assert contents(here / "fleet") == contents(calibrated / "fleet")
    # What is missing, and nothing else, is done by the worker that is left.
    gone = ["records/SN1.json", "profiles/SN4.yaml"]
    for name in gone:
        (here / "fleet" / name).unlink()
    assert haptune(*COMMAND, "--dry-run").out.count("would be done") == 2
    again = run_in_background(here, "--scheduler", address)
    assert again.wait(timeout=600) == 3
    again.communicate()
    assert contents(here / "fleet") == contents(calibrated / "fleet")


def test_a_study_is_what_optimise_says_of_each_whatever_the_workers() -> None:
    homerehab = load_device("homerehab")
    water = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
    stiff = {"elements": {"wall": {"stiffness": {"min": 20000, "max": 30000}}}}
    scenes = {"water": water, "stiff": Scene.model_validate(stiff)}
    devices = {"one": homerehab, "two": "nobody.yaml"}
    said: list[str] = []
    alone = study(devices, scenes, margins=["firm", "balanced"], workers=1, progress=said.append)
    assert said[-1] == "tuning devices (8 of 8)"
    head = alone.select("device", "scene", "margin").rows()
    assert head == [
        (device, scene, margin)
        for device in devices
        for scene in scenes
        for margin in ("firm", "balanced")
    ]
    assert alone["exit_code"].to_list() == [0, 0, 5, 5] + [3] * 4
    assert "its range starts at 20000" in alone["sentence"][2]
    firm = optimise(homerehab, water.model_copy(update={"margin": "firm"}))
    row = alone.row(0, named=True)
    assert row["digest"] == firm.digest
    assert row["water.gain"] == firm.elements["water"].margins.gain
    assert row["mass_high"] == homerehab.mass.high
    assert alone.equals(door.study(devices, scenes, margins=["firm", "balanced"], workers=2))


def test_a_study_takes_one_of_each_and_refuses_before_any_work_what_makes_no_sense() -> None:
    homerehab = load_device("homerehab")
    water = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
    one = study(homerehab, water, margins="firm", workers=1)
    assert one.select("device", "margin", "exit_code").rows() == [("homerehab", "firm", 0)]
    lost: list[Any] = [None, homerehab]
    found = study(lost, water, workers=1)
    assert found.select("device", "exit_code").rows() == [("None", 3), ("homerehab", 0)]
    assert found["sentence"][0] == "devices: None is none. Give a Device, file or name"
    said: list[str] = []
    unknown: Any = ["balanced", "frm"]
    with pytest.raises(
        UsageError, match=r"'frm' is none\. Choose from conservative, balanced, firm"
    ):
        study(homerehab, water, margins=unknown, workers=1, progress=said.append)
    for workers in (0, -5, cast("Any", 1.5)):
        with pytest.raises(UsageError, match=rf"workers: {workers} do no work\. Give 1 or more"):
            study(homerehab, water, workers=workers)
    nothing: Any = None
    with pytest.raises(UsageError, match="path: is of type NoneType"):
        study(homerehab, nothing, workers=1)
    with pytest.raises(UsageError, match="no device or no scene"):
        study({}, water, workers=1)
    assert not said


def fleet_of(mass: list[float], half: list[float]) -> pl.DataFrame:
    values = {"mass": mass}
    values["mass_low"] = [m - h for m, h in zip(mass, half, strict=True)]
    values["mass_high"] = [m + h for m, h in zip(mass, half, strict=True)]
    others = ("damping", "coulomb_friction", "force_offset", "delay")
    values |= {
        f"{name}{end}": [1.0] * len(mass) for name in others for end in ("", "_low", "_high")
    }
    names = [f"SN{k}" for k in range(len(mass))]
    return pl.DataFrame({"name": names, "axis": "x", "motion": "linear", **values})


def test_a_device_is_unlike_others_only_beyond_its_interval() -> None:
    # Median 3, distances 0 to 0.2, their median 0.1: a spread of 0.1/0.67449 = 0.14826.
    mass = [2.8, 2.9, 3.0, 3.1, 3.2, 9.0, 3.0]
    (found,) = unlike_others(fleet_of(mass, [0.0] * 5 + [1.0, 0.0]))
    assert (found.device, found.quantity, found.median) == ("SN5", "mass", 3.0)
    assert found.spread == pytest.approx(0.148260, rel=1e-5)
    assert found.distance == pytest.approx((8.0 - 3.0) / 0.148260, rel=1e-5)
    # With an interval that reaches to the others it may be like them.
    assert not unlike_others(fleet_of(mass, [0.0] * 5 + [5.9, 0.0]))
    # Of four nobody knows what is usual.
    assert not unlike_others(fleet_of([3.0, 3.0, 3.0, 9.0], [0.0] * 4))


@pytest.mark.parametrize(("count", "far"), [(8, 12.0), (200, 5.5)])
def test_few_fleets_alike_in_truth_have_a_device_that_is_not_like_the_others(
    count: int, far: float
) -> None:
    """Four quantities spread by one; of 200 fleets at most five in a hundred, with two sigmas."""
    chance, fleets = np.random.default_rng(5), 200
    seen = missed = 0
    for _ in range(fleets):
        frame = fleet_of([3.0] * count, [0.0] * count)
        drawn = {name: chance.normal(10.0, 1.0, count) for name in QUANTITIES[:4]}
        ends = {
            f"{name}{end}": each for name, each in drawn.items() for end in ("", "_low", "_high")
        }
        alike = frame.with_columns(**ends)
        seen += bool(unlike_others(alike))
        odd = alike.with_columns(
            **{
                f"mass{end}": drawn["mass"] + far * (np.arange(count) == 0)
                for end in ("", "_low", "_high")
            }
        )
        missed += not any(each.device == "SN0" for each in unlike_others(odd))
    assert seen <= fleets * (0.05 + 2 * (0.05 * 0.95 / fleets) ** 0.5)
    assert missed < fleets / 2


def test_what_more_than_half_of_a_fleet_share_is_not_judged() -> None:
    """Friction that few have, a delay that differs by rounding."""
    few = fleet_of([0.0] * 11 + [0.02 + 0.001 * k for k in range(9)], [0.0] * 11 + [0.005] * 9)
    assert not unlike_others(few)
    rounded = fleet_of([1e-3] * 7 + [1e-3 * (1 + 1e-12)] * 7, [0.0] * 14)
    assert not unlike_others(rounded)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,log\na,b\n", "has a column 'name'"),
        ("log\na\n", "has no column 'serial'"),
        ("serial,log\nA,a.csv\na,b.csv\n", "stands there twice"),
        (
            "serial,log,log\nA,a.csv,b.csv\n",
            "column 'log' stands there twice. Give it once; | stands",
        ),
        ("serial,log\nA,\n", "needs either log or device, and has neither"),
        ("serial,log,device\nA,a.csv,knob\n", "needs either log or device, and has both"),
        (
            "serial,log\n\nA,a.csv\n../A,a.csv\n",
            ": line 4, column serial: '../A' cannot name a file",
        ),
        ("serial,log\n,a.csv\n", ": line 2, column serial: is missing. Correct it there; 'haptune"),
        ("serial,log\nA,a.csv,b\n", "more cells than columns in line 2"),
        ("serial,log\n", "there is none; give each device a row"),
        ("", "has no column 'serial'"),
    ],
)
def test_a_manifest_that_makes_no_sense_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "manifest.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        load_manifest(path)


def test_manifests_are_read_as_people_write_them(tmp_path: Path) -> None:
    table, written = tmp_path / "manifest.csv", tmp_path / "manifest.yaml"
    text = "﻿Serial; axis;LOG ;date\nA;x; a.csv | b.csv ;2026-01-02\n;;;\nA;y;c.csv;\n"
    table.write_text(text, encoding="utf-8")
    written.write_text(
        "devices:\n- {serial: A, axis: x, log: [a.csv, b.csv], date: 2026-01-02}\n"
        "- {serial: A, axis: y, log: c.csv}\n",
        encoding="utf-8",
    )
    assert load_manifest(table) == load_manifest(written)
    assert [each.name for each in load_manifest(table).devices] == ["A-x", "A-y"]


def test_what_stops_a_fleet_before_it_begins(here: Path) -> None:
    for code, words, arguments in (
        (2, "SN0 has no scene", ("fleet", "manifest.csv")),
        (3, "No such file", ("fleet", "manifest.csv", "--scene", "none.yaml")),
        (7, "there is no folder", (*COMMAND, "-o", "a/b")),
        (7, "there is no folder", (*COMMAND, "-o", "a/b", "--dry-run")),
        (7, "scene.yaml: not written: ", (*COMMAND, "-o", "scene.yaml", "--dry-run")),
    ):
        ended = haptune(*arguments)
        assert ended.code == code, ended.err
        assert words in ended.err
    assert haptune(*COMMAND, "-o", "new", "--dry-run").code == 0
    assert not Path("new").exists()


@pytest.mark.long
def test_a_scheduler_that_is_not_there_is_told(here: Path) -> None:
    Path("fleet/records/SN0.json").unlink()
    ended = haptune(*COMMAND, "--scheduler", "tcp://127.0.0.1:1")
    assert ended.code == 2
    assert "--scheduler: tcp://127.0.0.1:1 cannot be used" in ended.err
    assert len(records(here / "fleet")) == COUNT
