"""The door import haptune: its verbs, names of files by text or path, frames, quiet libraries."""

import copy
import inspect
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.figure import Figure

import haptune
import identification
import tune
from datasets_synthetic import bundled_path
from identification import (
    Device,
    Finding,
    Hardware,
    IdentificationError,
    InvalidInputError,
    LogRefusedError,
    NotWrittenError,
    QuestionError,
    Replaced,
    Unstated,
    UnstatedError,
    UsageError,
    load_device,
    load_document,
    load_excitation,
    load_trajectory,
    to_mapping,
    to_yaml,
)
from tests.commands import FLUID, form, log_text
from tests.exported import tuned
from tune import (
    CheckFailedError,
    Effects,
    Loop,
    LoopError,
    NoFeasibleEffectError,
    SafeProfile,
    Scene,
    TuneError,
    audit,
    compare,
    count_jump,
    force_ripple,
    load_profile,
    optimise,
    region_picture,
)

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_there() -> None:
    assert dir(haptune) == sorted(haptune.__all__)
    for name in haptune.__all__:
        assert getattr(haptune, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        _ = haptune.solve  # type: ignore[attr-defined]


def test_every_error_can_be_handed_on_by_a_worker_and_copied() -> None:
    wrong = Finding(code="jitter", severity="refusal", seen="1", needed="2", remedy="Do it")
    fact = Unstated(key="motion", write="motion: linear", hint="")
    errors: list[Exception] = [
        IdentificationError("said"),
        InvalidInputError("a.csv", "is empty", "Give another"),
        QuestionError("a.csv", "is it?", "Say", question="Which?", option="time", choices="ab"),
        UnstatedError("a.csv", (fact,), "State it:"),
        UsageError("name", "is none", "Choose"),
        LogRefusedError((wrong,)),
        NotWrittenError(Path("a.csv"), "no space"),
        TuneError("said"),
        LoopError("no loop"),
        NoFeasibleEffectError(("weak", "late")),
        CheckFailedError(("digest",), unproved=(("wall",),), spent=True),
    ]
    named = [getattr(each, name) for each in (identification, tune) for name in each.__all__]
    kinds = {each for each in named if isinstance(each, type) and issubclass(each, Exception)}
    assert kinds == {type(each) for each in errors}
    for error in errors:
        handed = pickle.loads(pickle.dumps(error))  # noqa: S301
        for again in (handed, copy.copy(error), copy.deepcopy(error)):
            assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


def test_importing_it_loads_nothing() -> None:
    code = "import haptune, sys; assert not {'numpy', 'tune', 'identification'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_a_tune_of_another_project_is_told(tmp_path: Path) -> None:
    """Its __init__ stands in the place of ours, as two installations in one folder leave it."""
    (tmp_path / "tune").mkdir()
    (tmp_path / "tune" / "__init__.py").write_text("best = 1\n", encoding="utf-8")
    shutil.copytree(ROOT / "tune" / "cli", tmp_path / "tune" / "cli")
    for code in ("from tune.cli import main; main()", "from haptune import optimise"):
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        )
        assert done.returncode == 1
        assert "belongs to another project" in done.stderr
        assert "virtual environment of its own" in done.stderr


@dataclass(frozen=True)
class Named:
    """A path object that is no Path."""

    text: str

    def __fspath__(self) -> str:
        return self.text


def test_text_and_path_objects_name_the_same_file(tmp_path: Path) -> None:
    """In every public function that reads or writes a file, called on one that stands there."""
    profile, device = tuned().to_yaml(), to_yaml(to_mapping(load_device("homerehab")))
    old = Replaced(content=b"before", backup=tmp_path / "file.csv.bak")
    calls: dict[str, tuple[str, Callable[[Any], object]]] = {
        "check": (profile, tune.check),
        "difference_of": ("", lambda path: identification.difference_of(path, old, "after")),
        "load_device": (device, load_device),
        "load_document": (FLUID, lambda path: load_document(Scene, path)),
        "load_excitation": (form("excitation", "--device", "homerehab"), load_excitation),
        "load_log": (log_text(), identification.load_log),
        "load_mapping": (FLUID, identification.load_mapping),
        "load_profile": (profile, load_profile),
        "load_scene": (FLUID, tune.load_scene),
        "load_trajectory": (log_text(), load_trajectory),
        "write_bytes": ("", lambda path: identification.write_bytes(path, b"written")),
        "write_files": ("", lambda path: identification.write_files({Path(path): b"written"})),
        "write_text": ("", lambda path: identification.write_text(path, "written")),
    }
    path = tmp_path / "file.csv"
    for text, call in calls.values():
        for given in (str(path), path, Named(str(path))):
            path.write_text(text, encoding="utf-8")
            call(given)
    assert load_device(Named("homerehab")).name == "homerehab"
    public = [getattr(home, name) for home in (identification, tune) for name in home.__all__]
    taking = {
        each.__name__
        for each in public
        if inspect.isfunction(each)
        and any("Path" in str(kind) for kind in each.__annotations__.values())
    }
    # This one is given the content; the name is for its messages.
    assert taking - {"parse_document"} == set(calls)


@pytest.mark.parametrize("given", ["missing.yaml", Path("missing.yaml"), Named("missing.yaml")])
def test_messages_name_the_file_as_it_was_given(given: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"^missing.yaml: cannot be read"):
        tune.load_scene(given)


#: The command's entry point around work in which two libraries complain.
_COMPLAINING = """
import logging, warnings
import tune.cli.app

def run():
    warnings.warn("invalid value encountered", RuntimeWarning)
    logging.getLogger("library").warning("a cache was built")

tune.cli.app.run_app = run
from tune.cli import main
main()
"""


@pytest.mark.parametrize(("options", "silent"), [((), True), (("-W", "default"), False)])
def test_warnings_of_libraries_are_shown_to_those_who_ask(
    options: tuple[str, ...], silent: bool
) -> None:
    done = subprocess.run(
        [sys.executable, *options, "-c", _COMPLAINING],
        capture_output=True,
        text=True,
        check=False,
        env={name: value for name, value in os.environ.items() if name != "PYTHONWARNINGS"},
    )
    assert done.returncode == 0, done.stderr
    assert (done.stderr == "") == silent


LOG = bundled_path("homerehab.csv")
HARDWARE = bundled_path("homerehab.hardware.yaml")


def test_calibrate_goes_from_a_log_to_a_profile_whose_results_are_frames(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(FLUID, encoding="utf-8")
    profile = haptune.calibrate(LOG, scene, hardware=HARDWARE)
    frame = profile.to_frame()
    assert frame.select("element", "effect", "value").rows() == [("water", "damping", 10.0)]
    assert frame["limited_by"].to_list() == ["wanted"]
    assert "<table" in profile._repr_html_()  # pyright: ignore[reportPrivateUsage]
    path = tmp_path / "profile.yaml"
    path.write_text(profile.to_yaml(), encoding="utf-8")
    rows = compare(load_profile(path), load_device("homerehab")).to_frame()
    assert {"quantity", "old", "new", "beyond", "steps"} <= set(rows.columns)
    axes = Figure().add_subplot()
    assert region_picture(profile, ax=axes) is axes.figure
    assert "square-root" in axes.get_xlabel()


def test_identification_and_audit_are_frames() -> None:
    hardware = load_document(Hardware, HARDWARE)
    found = haptune.identify(load_trajectory(LOG), hardware=hardware)
    rows = {row["quantity"]: row for row in found.to_frame().to_dicts()}
    assert rows["mass"]["low"] < 3.0 < rows["mass"]["high"]
    judged = audit(load_device("homerehab"), Effects(stiffness=800.0)).to_frame()
    peak = judged.filter(judged["quantity"] == "peak_force")
    np.testing.assert_allclose(peak["seen"][0], 8.0)  # 800 N/m over 10 mm
    assert peak["needed"][0] == 28.0


_SCENE = Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})
_LOOP = Loop.from_numbers(mass=3.0, damping=10.0, sample_time=0.001)


@pytest.mark.parametrize(
    ("words", "call"),
    [
        (r"shape \(2,\). Judge one", lambda d, _: audit(d, Effects(stiffness=[8.0, 9.0]))),
        (r"-1 would take", lambda d, _: audit(d, Effects(damping=9.0), extra_delay_samples=-1)),
        (
            "'nope' is no element. Choose from wall, cup, rubber",
            lambda d, p: audit(d, Effects(damping=9.0), like=(p, "nope")),
        ),
        (
            "'speed' is no effect. Choose from stiff",
            lambda d, _: optimise(d, _SCENE, favour=cast("Any", "speed")),
        ),
        (
            r"arrays of shape \(0,\) hold no device",
            lambda *_: Loop.from_numbers(mass=np.array([]), damping=1.0, sample_time=0.001),
        ),
        ("not -1; state it", lambda *_: force_ripple(_LOOP, Effects(stiffness=9.0), -1)),
        ("sample_time must be above 0", lambda *_: count_jump(Effects(damping=9.0), 0.0, 1e-5)),
    ],
)
def test_what_no_call_can_answer_is_refused_with_the_value(
    words: str, call: Callable[[Device, SafeProfile], object]
) -> None:
    with pytest.raises((UsageError, LoopError), match=words):
        call(load_device("homerehab"), tuned())


@pytest.mark.parametrize("strange", [None, Path("nope"), {}])
def test_what_is_of_another_type_is_refused_with_what_to_give(strange: Any) -> None:
    device, profile, log = load_device("homerehab"), tuned(), load_trajectory(LOG)
    calls: dict[str, Callable[[], object]] = {
        "device: {}a device, as load_device reads it": lambda: optimise(strange, _SCENE),
        "scene: {}a scene, as load_scene reads it": lambda: optimise(device, scene=strange),
        "effects: {}Effects(": lambda: audit(device, strange),
        "profile: {}a profile, as load_profile reads it": lambda: haptune.verify(strange, log),
        "trajectory: {}a log, as load_trajectory reads": lambda: haptune.verify(profile, strange),
        "profile: {}a profile": lambda: haptune.export(strange, "c"),
        "new: {}a device, as load_device reads it or a profile": lambda: compare(device, strange),
        "extra_delay_samples: {}a number": lambda: audit(
            device, Effects(damping=9.0), extra_delay_samples=strange
        ),
    }
    kind = type(strange)
    if kind.__name__ != "NoneType":
        calls["device: {}a device"] = lambda: haptune.check("profile.yaml", strange)
        calls["hardware: {}hardware, as"] = lambda: haptune.identify(log, hardware=strange)
    if not issubclass(kind, str | Path):
        calls["reference: {}the name of a file"] = lambda: load_device(strange)
        calls["path: {}the name of a file"] = lambda: load_profile(strange)
        calls["scene: {}the name of a file or a scene"] = lambda: haptune.calibrate(log, strange)
    for words, call in calls.items():
        with pytest.raises(UsageError) as refused:
            call()
        assert words.format(f"is of type {kind.__name__}. Give ") in str(refused.value)
    with pytest.raises(UsageError, match=r"logs: .*(is no log that was read|none given)"):
        haptune.identify(strange)


def test_numbers_of_numpy_are_numbers() -> None:
    one: Any = np.float32(1)
    assert audit(load_device("homerehab"), Effects(damping=3.0), extra_delay_samples=one).safe
