"""Files of two profiles in one folder or program: none works with another's, and it is said."""

import itertools
import subprocess
import sys
import time
from pathlib import Path

import pytest

from identification import NotWrittenError, write_files
from tests.exported import tuned
from tests.guard import compiler, write
from tests.processes import needs_posix
from tests.test_export import STUB
from tune import SafeProfile, export

_USER = """\
#include "haptune_guard.h"
int main(void)
{
    haptune_guard guard;
    haptune_init(&guard);
    haptune_reset(&guard, HAPTUNE_ELEMENT_RUBBER, 0.0, 0);
    return haptune_force(&guard, HAPTUNE_ELEMENT_RUBBER, 0, 0.0, 1.0) != 0.0;
}
"""
#: One axis of a C++ program, which is given its name.
_AXIS = """\
#include "haptune_chai3d.hpp"
double NAME()
{
    haptune::Axis axis(chai3d::cVector3d{1.0, 0.0, 0.0});
    axis.enter(HAPTUNE_ELEMENT_RUBBER, 0.0, 0);
    axis.force(HAPTUNE_ELEMENT_RUBBER, 0, 0.0);
    return axis.force(HAPTUNE_ELEMENT_RUBBER, 1, 1e-4).x;
}
"""
_TWO_AXES = """\
#include <cstdio>
double stiff();
double soft();
int main() { std::printf("%g %g\\n", stiff(), soft()); }
"""


def _softer() -> SafeProfile:
    """Another profile of the same names."""
    rubber = tuned().elements["rubber"].model_copy(update={"stiffness": 100.0})
    profile = tuned().model_copy(update={"elements": {**tuned().elements, "rubber": rubber}})
    return profile.signed()


def _built(folder: Path, *arguments: str) -> str:
    """What the compiler says, "" where it is content."""
    cc, cxx = compiler("cc", "gcc", "clang"), compiler("c++", "g++", "clang++")
    plus = any(each.endswith(".cpp") for each in arguments)
    command = [cxx, "-std=c++11"] if plus else [cc, "-std=c99"]
    done = subprocess.run(
        [*command, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.stderr if done.returncode else ""


NAMES = ("haptune_guard.c", "haptune_guard.h", "haptune_chai3d.hpp")


@pytest.mark.parametrize("foreign", ["", *NAMES])
def test_a_file_of_another_profile_does_not_compile_with_the_rest(
    tmp_path: Path, foreign: str
) -> None:
    own, other = (export(each, "chai3d") for each in (tuned(), _softer()))
    write({name: (other if name == foreign else own)[name] for name in NAMES}, tmp_path)
    write({"chai3d.h": STUB, "a.cpp": '#include "haptune_chai3d.hpp"\n'}, tmp_path)
    for source, beside in (("haptune_guard.c", NAMES[:1]), ("a.cpp", NAMES[2:])):
        alike = len({name == foreign for name in (*beside, "haptune_guard.h")}) == 1
        said = _built(tmp_path, "-c", source, "-o", "a.o")
        assert (said == "") == alike
        assert alike or "comes from another profile" in said


def test_two_headers_in_one_source_do_not_compile(tmp_path: Path) -> None:
    for name, profile in (("own", tuned()), ("other", _softer())):
        (tmp_path / name).mkdir()
        write({**export(profile, "chai3d"), "chai3d.h": STUB}, tmp_path / name)
    for header in NAMES[1:]:
        lines = [f'#include "{folder}/{header}"\n' for folder in ("own", "other")]
        write({"both.cpp": "".join(lines), "one.cpp": lines[0] * 2}, tmp_path)
        assert "headers of two profiles" in _built(tmp_path, "-c", "both.cpp")
        assert _built(tmp_path, "-c", "one.cpp") == ""


def test_what_was_compiled_with_another_header_does_not_link(tmp_path: Path) -> None:
    for name, profile in (("own", tuned()), ("other", _softer())):
        (tmp_path / name).mkdir()
        write({**export(profile, "c"), "user.c": _USER}, tmp_path / name)
        for source in ("user", "haptune_guard"):
            assert _built(tmp_path / name, "-c", f"{source}.c", "-o", f"{source}.o") == ""
    for one, other in itertools.product(("own", "other"), repeat=2):
        said = _built(tmp_path, f"{one}/user.o", f"{other}/haptune_guard.o", "-o", "program")
        assert (said == "") == (one == other)
        assert one == other or "undefined" in said.lower()


def test_two_profiles_in_one_program_play_each_their_own(tmp_path: Path) -> None:
    objects: list[str] = []
    for name, profile in (("stiff", tuned()), ("soft", _softer())):
        folder = tmp_path / name
        folder.mkdir()
        axis = {"chai3d.h": STUB, "axis.cpp": _AXIS.replace("NAME", name)}
        write({**export(profile, "chai3d"), **axis}, folder)
        assert _built(folder, "-c", "axis.cpp", "-o", "axis.o") == ""
        assert _built(folder, "-c", "haptune_guard.c", "-o", "guard.o") == ""
        objects += [f"{name}/axis.o", f"{name}/guard.o"]
    write({"main.cpp": _TWO_AXES}, tmp_path)
    assert _built(tmp_path, "main.cpp", *objects, "-o", "program") == ""
    told = subprocess.run([tmp_path / "program"], capture_output=True, text=True, check=True)
    assert told.stdout == "-0.07 -0.01\n"


def test_what_cannot_be_written_leaves_the_old_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name of the set that turns into a folder when its turn comes."""
    files = {tmp_path / f"{k}": b"old" for k in range(3)}
    write_files(dict.fromkeys(list(files)[:2], b"old"))
    really = Path.replace
    monkeypatch.setattr("sys.executable", "")  # by this process itself

    def refused(self: Path, target: Path) -> Path:
        if target.name == "2":
            raise PermissionError(13, "held by another program")
        return really(self, target)

    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(NotWrittenError, match="held by another program") as caught:
        write_files(dict.fromkeys(files, b"new"))
    assert "2" in str(caught.value)
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert left == {"0": b"old", "1": b"old"}


#: Kills itself and its group as it gives the second file its name, or as it has begun a process.
_DYING = """\
import os, signal, subprocess, sys
from pathlib import Path
from identification import write_files
given, really = [], Path.replace
def replace(self, target):
    given.append(target)
    if len(given) == 2:
        os.killpg(0, signal.SIGKILL)
    return really(self, target)
class Popen(subprocess.Popen):
    def __init__(self, *given, **options):
        super().__init__(*given, **options)
        os.killpg(0, signal.SIGKILL)
Path.replace = replace
if sys.argv[1] == "begun":
    subprocess.Popen = Popen
write_files({Path(name): b"new" for name in sys.argv[2:]})
"""


@needs_posix
@pytest.mark.parametrize("moment", ["second", "begun"])
def test_names_are_given_where_a_kill_does_not_reach(tmp_path: Path, moment: str) -> None:
    files = [tmp_path / name for name in "abc"]
    for path in files:
        path.write_text("old", encoding="utf-8")
    command = [sys.executable, "-c", _DYING, moment, *map(str, files)]
    subprocess.run(command, start_new_session=True, check=False)
    end = time.monotonic() + 10
    while (found := {path.read_text("utf-8") for path in files}) != {"new"}:
        assert time.monotonic() < end, found
        time.sleep(0.01)
