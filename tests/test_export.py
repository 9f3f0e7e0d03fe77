"""Exported files say what the profile says, whatever its elements are called; the command."""

import copy
import functools
import json
import pickle
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import yaml

from identification import (
    InvalidInputError,
    UnstatedError,
    UsageError,
    load_device,
    to_mapping,
    to_yaml,
)
from tests.commands import FULL, digest_of, failing, files, haptune
from tests.exported import FADE, LOOPS, SCENE, changed, on_axes, poles, renamed, tuned
from tests.guard import compiler, compiles, write
from tune import CheckFailedError, SafeProfile, Scene, export, optimise
from tune.exporters import TARGETS, Target

HOSTILE = (
    ("while", "on", "int main(void) {return 1;}"),
    ("a b", "a_b", "a-b"),
    ("*/ #error out", "/* ?" + "?/", "\\"),
    ('"quoted"', "Wänd\n#error new line", "壁"),
    ("", " ", "\t\r\n"),
    ("1e3", "0x10", "12:30:45"),
    ("Wall", "WALL", "wall"),
    ("x" * 5000, "x" * 5000 + "y", "x" * 39 + "_z"),
    ("$tag", "${heading}", "%s\x00\u2028😀"),
)


def test_what_nothing_is_exported_to_is_refused() -> None:
    for target in ("unity", ["c", "json"]):
        with pytest.raises(UsageError, match=r"is no target\. Choose from ros2, c, chai3d, json"):
            export(tuned(), cast("Target", target))


@pytest.mark.parametrize(
    "names",
    [
        pytest.param(names, id=str(k), marks=pytest.mark.long if k > 4 else ())
        for k, names in enumerate(HOSTILE)
    ],
)
def test_hostile_names_are_harmless_everywhere(tmp_path: Path, names: tuple[str, ...]) -> None:
    profile = renamed(*names)
    texts = {name: text for target in TARGETS for name, text in export(profile, target).items()}
    write(texts, tmp_path)
    assert compiles(tmp_path) == ""
    assert all(text.isascii() for text in texts.values())
    stated = json.loads(texts["haptune_profile.json"])
    assert list(stated["elements"]) == list(names)
    parameters = yaml.safe_load(texts["haptune_params.yaml"])["haptune"]["ros__parameters"]
    told = [item["name"] for item in parameters["elements"].values()]
    assert told == [name[:60] for name in names]
    words = list(parameters["elements"])
    assert len({*words}) == len(names)
    for word in words:
        assert re.fullmatch(r"[a-z][a-z0-9_]{0,60}", word)
        assert word not in {"while", "on", "null", "true", "no", "int"}
    assert parameters["together"] == {"group_1": words[:2]}


@pytest.mark.parametrize("name", LOOPS)
def test_json_states_the_coefficients_of_the_poles(name: str) -> None:
    profile = changed(**LOOPS[name])
    content = json.loads(export(profile, "json")["haptune_profile.json"])
    assert all(key in content["law"] for each in content["elements"].values() for key in each)
    assert content["digest"] == profile.digest
    assert content["combinations"] == [["wall"], ["cup"], ["rubber"], ["wall", "cup"]]
    sizes = {"stiffness": 500.0, "damping": 10.0, "mass": 0.0}
    played = {"one_sided": False, "force_level": 28.0, "speed": 0.2, "fade_time": 0.0}
    assert content["elements"]["wall"] == {**sizes, **played}
    assert (content["apart"], content["taps"]) == ([], 1)
    assert content["elements"]["cup"]["fade_time"] == FADE
    assert content["force_limit"] == {"continuous": 14.0, "peak": 28.0}
    assert content["margin"] == {"name": "balanced", "gain": 2.0, "extra_delay_samples": 1}
    assert content["assumes"] == list(profile.certificate.assumes)
    assert content["not_assessed"] == list(profile.certificate.not_assessed)
    loop = profile.loop
    for which, order, cutoff in (
        ("velocity", loop.velocity_filter_order, loop.velocity_filter_hz),
        ("acceleration", loop.acceleration_filter_order, loop.acceleration_filter_hz),
    ):
        stated = content[which]
        if cutoff is None:
            window = which == "velocity" and loop.velocity_window_samples
            assert stated == ({"kind": "window", "samples": 7} if window else {"kind": "none"})
            continue
        below = poles(cutoff, order, loop.filter_damping_ratio)
        assert [1.0, -stated["t"], stated["p"]][: below.size] == pytest.approx(below, rel=1e-14)
        assert stated["g"] == pytest.approx(below.sum(), rel=1e-12)
        assert stated["cutoff_hz"] == cutoff
        if "a" in stated:
            assert np.polyval(below, stated["a"]) == pytest.approx(0, abs=1e-15)


def test_every_file_says_what_is_certified_and_what_is_not() -> None:
    profile = tuned()
    for target in TARGETS:
        for name, text in export(profile, target).items():
            words = " ".join(re.sub(r"[\n*#]|\\\w", " ", text).split())
            assert profile.digest in words, name
            assert "homerehab" in words
            for sentence in (*profile.certificate.assumes, *profile.certificate.not_assessed):
                assert sentence in words, name


STUB = """\
#pragma once
#include <memory>
namespace chai3d {
struct cHapticDeviceInfo {
    double m_maxLinearForce = 100, m_maxLinearStiffness = 300, m_maxLinearDamping = 40;
    double m_maxAngularTorque = 5, m_maxAngularStiffness = 6, m_maxAngularDamping = 7;
};
struct cVector3d {
    double x, y, z;
    double dot(const cVector3d& o) const { return x * o.x + y * o.y + z * o.z; }
    cVector3d operator+(const cVector3d& o) const { return cVector3d{x + o.x, y + o.y, z + o.z}; }
    cVector3d operator*(double s) const { return cVector3d{x * s, y * s, z * s}; }
};
struct cMaterial {
    double stiffness = -1, viscosity = -1, damping = -1;
    void setStiffness(double v) { stiffness = v; }
    void setViscosity(double v) { viscosity = v; }
    void setDamping(double v) { damping = v; }
};
typedef std::shared_ptr<cMaterial> cMaterialPtr;
}
"""


STUB_MAIN = """\
#include "haptune_chai3d.hpp"
#include <cstdio>
int main()
{
    for (std::uint64_t element = 1; element <= 4; element <<= 1) {
        auto material = std::make_shared<chai3d::cMaterial>();
        bool whole = haptune::set_material(material, element, 2.0);
        std::printf("%d %g %g %g\\n", whole, material->stiffness, material->viscosity,
            material->damping);
    }
    haptune::Axis axis(chai3d::cVector3d{0.0, 1.0, 0.0});
    double place = axis.along(chai3d::cVector3d{5.0, 0.002, 5.0});
    axis.enter(HAPTUNE_ELEMENT_RUBBER, 0.0, 0);
    axis.force(HAPTUNE_ELEMENT_RUBBER, 0, 0.0019);
    chai3d::cVector3d force = axis.force(HAPTUNE_ELEMENT_RUBBER, 1, place);
    std::printf("%g %g %g %d\\n", force.x, force.y, force.z, (int)axis.status());
    auto limp = std::make_shared<chai3d::cMaterial>();
    bool taken = haptune::set_material(limp, 4, 0.0);
    std::printf("%d %g\\n", taken, limp->stiffness);
    const auto info = haptune::limited(chai3d::cHapticDeviceInfo());
    std::printf("%g %g %g %g\\n", info.m_maxLinearForce, info.m_maxLinearStiffness,
        info.m_maxLinearDamping, info.m_maxAngularTorque);
}
"""


def played(texts: Mapping[str, str], program: str, folder: Path) -> list[list[str]]:
    """The words of each line that a program around exported files prints."""
    write({**texts, "chai3d.h": STUB, "main.cpp": program}, folder)
    assert compiles(folder) == ""
    cxx = compiler("c++", "g++", "clang++")
    subprocess.run(
        [cxx, "-std=c++11", "-Wall", "-Wextra", "-Werror", "main.cpp", "haptune_guard.o"],
        cwd=folder,
        check=True,
    )
    told = subprocess.run([folder / "a.out"], capture_output=True, text=True, check=True).stdout
    return [line.split() for line in told.splitlines()]


def test_chai3d_plays_springs_itself_and_the_rest_by_the_guard(tmp_path: Path) -> None:
    texts = export(tuned(), "chai3d")
    lines = ([float(x) for x in line] for line in played(texts, STUB_MAIN, tmp_path))
    wall, cup, rubber, force, limp, limits = lines
    assert wall == [0, 0, 0, 0]
    assert cup == [0, 0, 0, 0]
    assert rubber == [1, 350, 0, 0]  # in a world twice as large
    assert limp == [0, 0]
    assert limits == [28, 300, 40, 5]
    assert force == pytest.approx([0, -0.07, 0, 0])
    assert "NOT certified" in texts["haptune_chai3d.hpp"]
    assert {**export(tuned(), "c")}.items() <= texts.items()
    assert compiles(tmp_path, "-x", "c++", standard="c++11") == ""


AXES_MAIN = """\
#include "haptune_chai3d.hpp"
#include <cstdio>
int main()
{
    const chai3d::cVector3d axes[2] = {{0.0, 0.6, 0.8}, {1.0, 0.0, 0.0}};
    haptune::Device device(axes);
    device.enter(HAPTUNE_ELEMENT_RUBBER);
    device.force(HAPTUNE_ELEMENT_RUBBER, 0, 0, chai3d::cVector3d{0.0, 0.0, 0.0});
    chai3d::cVector3d force = device.force(
        HAPTUNE_ELEMENT_RUBBER, 0, 1, chai3d::cVector3d{1e-4, 6e-5, 8e-5});
    std::printf("%g %g %g %d\\n", force.x, force.y, force.z, (int)device.status());
    int placed = device.place(0, HAPTUNE_ELEMENT_WALL, chai3d::cVector3d{0.0, 0.6, 0.8}, 0.0);
    force = device.force(0, 1, 2, chai3d::cVector3d{0.0, -6e-5, -8e-5});
    force = device.force(0, 1, 3, chai3d::cVector3d{0.0, -12e-5, -16e-5});
    bool along = force.y > 0 && force.y * 0.8 == force.z * 0.6;
    std::printf("%d %d %d\\n", placed, force.x == 0.0, along);
}
"""


def test_chai3d_plays_several_axes_as_vectors(tmp_path: Path) -> None:
    rubber, wall = played(export(on_axes(2), "chai3d"), AXES_MAIN, tmp_path)
    assert [float(each) for each in rubber] == pytest.approx([-0.07, -0.042, -0.056, 0])
    assert wall == ["0", "1", "1"]


@pytest.mark.parametrize("target", TARGETS)
def test_a_limit_that_nobody_stated_is_not_exported(target: Target) -> None:
    device = tuned().device.model_copy(update={"force_limit": None})
    with pytest.raises(UnstatedError, match="force_limit") as caught:
        export(tuned().model_copy(update={"device": device}).signed(), target)
    assert [fact.key for fact in caught.value.missing] == ["force_limit"]


def test_what_was_changed_after_it_was_certified_is_neither_exported_nor_signed_anew() -> None:
    rubber = tuned().elements["rubber"].model_copy(update={"stiffness": 9e5})
    with pytest.raises(TypeError, match="read-only"):
        tuned().elements["rubber"] = rubber
    for copied in (pickle.loads(pickle.dumps(tuned())), copy.deepcopy(tuned())):  # noqa: S301
        assert copied == tuned()
        with pytest.raises(TypeError, match="read-only"):
            copied.elements.pop("rubber")
    stiff = tuned().model_copy(update={"elements": {**tuned().elements, "rubber": rubber}})
    for target in TARGETS:
        with pytest.raises(CheckFailedError, match="was changed after it was certified"):
            export(stiff, target)
    with pytest.raises(CheckFailedError, match="was changed after it was certified"):
        stiff.to_yaml()


def test_more_elements_than_bits_are_refused() -> None:
    profile = tuned()
    element = profile.elements["wall"]
    many = {f"e{k}": element for k in range(65)}
    profile = profile.model_copy(update={"elements": many, "together": ()}).signed()
    with pytest.raises(InvalidInputError, match="has 65, a guard holds 64"):
        export(profile, "c")
    many.pop("e64")
    text = export(profile.model_copy(update={"elements": many}).signed(), "c")["haptune_guard.c"]
    assert "known = UINT64_C(0xffffffffffffffff);" in text


ALL = {"haptune_guard.c", "haptune_guard.h", "haptune_chai3d.hpp", "haptune_profile.json"}


@functools.cache
def walled() -> SafeProfile:
    """One wall: a command checks anew what it exports."""
    scene = {"elements": {"wall": SCENE["elements"]["wall"]}, "loop": {"velocity_filter_hz": 50.0}}
    return optimise(load_device("homerehab"), Scene.model_validate(scene))


@pytest.fixture
def here(here: Path) -> Path:
    Path("profile.yaml").write_text(walled().to_yaml(), encoding="utf-8")
    return here


def test_several_targets_are_written_atomically_with_backup_and_difference(here: Path) -> None:
    ended = haptune("export", "profile.yaml", "--to", "ros2,c", "--to", "json", "--to", "chai3d")
    assert (ended.code, ended.err) == (0, "")
    assert files() == {"profile.yaml", "haptune_controller", *ALL}
    for target in TARGETS:
        folder = Path("haptune_controller" if target == "ros2" else "")
        for name, text in export(walled(), target).items():
            assert (folder / name).read_text(encoding="utf-8") == text
    Path("haptune_guard.c").write_text("int mine;\n", encoding="utf-8")
    ended = haptune("export", "profile.yaml", "--to", "c")
    assert "-int mine;" in ended.out
    assert Path("haptune_guard.c.bak").read_text(encoding="utf-8") == "int mine;\n"


def _forged(where: str, value: Any) -> str:
    """A profile whose digest is right and whose certificate is not."""
    content = to_mapping(walled())
    *above, last = where.split(".")
    functools.reduce(lambda part, key: part[key], above, content)[last] = value
    content["digest"] = digest_of(content)
    return to_yaml(content)


@pytest.mark.parametrize(
    ("code", "words", "arguments"),
    [
        (6, "was changed after it was certified", "changed.yaml --to c"),
        (6, "unstable", "forged.yaml --to c,json"),
        (2, "'matlab' is no target. Choose from ros2, c, chai3d, json", "profile.yaml --to matlab"),
        (2, "--to", "profile.yaml"),
        (2, "PROFILE", "--to c"),
        (2, "one of the inputs", "haptune_profile.json --to json"),
        (2, "is no name of a node", "profile.yaml --to ros2 --node 9x"),
        (2, "names a node of ROS 2", "profile.yaml --to c --node haptune"),
        (3, "No such file", "missing.yaml --to c"),
        (3, "is not valid YAML", "torn.yaml --to c"),
        (7, "there is no folder", "profile.yaml --to c -o absent/deeper"),
        (7, "there is no folder", "profile.yaml --to c -o torn.yaml"),
        (7, "there is no folder", "profile.yaml --to c -o torn.yaml/below"),
        (7, "too long", f"profile.yaml --to c -o {'x' * 999}"),
        (7, "it is a folder", "profile.yaml --to ros2,json -o full"),
    ],
)
def test_a_refusal_has_its_code_and_writes_nothing(
    here: Path, code: int, words: str, arguments: str
) -> None:
    text = walled().to_yaml()
    Path("haptune_profile.json").write_text(text, encoding="utf-8")
    changed_text = text.replace("stiffness: 500.0", "stiffness: 501.0", 1)
    Path("changed.yaml").write_text(changed_text, encoding="utf-8")
    forged = _forged("elements.wall.damping", -50.0)
    Path("forged.yaml").write_text(forged, encoding="utf-8")
    Path("torn.yaml").write_text("{", encoding="utf-8")
    (here / "full" / "haptune_profile.json").mkdir(parents=True)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    ended = haptune("export", *arguments.split(), "--json")
    assert ended.code == code
    assert words.lower() in ended.err.lower()
    assert ended.err.count("\n") == 1 or code == 6
    assert ended.result["outputs"] == []
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before


def test_a_full_disk_leaves_no_folder_that_was_made(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.fsync", failing(FULL))
    Path("mine").mkdir()
    before = set(here.rglob("*"))
    for folder in ("mine", "new"):
        ended = haptune("export", "profile.yaml", "--to", "c,ros2", "-o", folder)
        assert (ended.code, "No space" in ended.err) == (7, True)
        assert set(here.rglob("*")) == before


def test_a_folder_is_made_where_its_parent_stands_and_used_again(here: Path) -> None:
    for _ in range(2):
        ended = haptune("export", "profile.yaml", "--to", "c,ros2", "-o", "controller", "--json")
        assert ended.code == 0, ended.err
    made = {path.name for path in Path("controller").iterdir()}
    assert made == {"haptune_guard.c", "haptune_guard.h", "haptune_controller"}
