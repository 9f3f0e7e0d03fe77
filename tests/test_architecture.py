"""The plan of each package from its imports: rooms, floors, circles, the one direction of data."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import identification

ROOT = Path(__file__).parents[1]
PACKAGES = ("identification", "tune", "datasets_synthetic")
LINES = 620
Graph = dict[str, set[str]]


@cache
def _imports(path: Path) -> frozenset[str]:
    """Full dotted names of ours that a file imports: a.b of ``from a import b``, or as used."""
    found: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    packages: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if not alias.asname}
            packages |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    within: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in packages:
                found.add(f"{packages[node.value.id]}.{node.attr}")
                within.add(node.value)
        elif isinstance(node, ast.Name) and node.id in packages and node not in within:
            found.add(packages[node.id])
    return frozenset(name for name in found if name.partition(".")[0] in PACKAGES)


def _files(folder: str) -> list[Path]:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    return files


@cache
def file_graph(package: str) -> Graph:
    """Modules of a package, and those of it that each imports, for types or when called too."""
    files = {_dotted(path): path for path in _files(package)}
    del files[package]

    def module(name: str) -> str:
        return name if name in files else name.rpartition(".")[0]

    return {
        name: ({module(each) for each in _imports(path)} & files.keys()) - {name}
        for name, path in files.items()
    }


def _dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_graph(package: str) -> Graph:
    """Rooms of a package, and those that the files of each import."""
    rooms: Graph = {}
    for name, imported in file_graph(package).items():
        room = _room(name)
        rooms[room] = rooms.get(room, set()) | ({_room(each) for each in imported} - {room})
    return rooms


def _room(name: str) -> str:
    return name.split(".")[1]


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_is_imported_in_circles_and_no_file_is_too_long(package: str) -> None:
    """Rooms stand on floors, each above all that it imports."""
    for graph in (file_graph(package), room_graph(package)):
        TopologicalSorter(graph).prepare()
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in _files(package)}
    assert [path for path, count in lines.items() if count > LINES] == []


def test_every_file_that_the_plan_names_is_there() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = re.findall(
        r"`((?:identification|tune|datasets_synthetic|tests|notebooks)/[^`]*)`", text
    )
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_tables_have_every_room_on_its_floor() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    for package in ("identification", "tune"):
        (section,) = re.findall(rf"## The rooms of `{package}`\n(.*?)(?=\n## |\Z)", text, re.DOTALL)
        rows = re.findall(r"^\| (\d+) \| (`.+?`) \|", section, re.MULTILINE)
        told = {room: int(floor) for floor, names in rows for room in re.findall(r"`(.+?)`", names)}
        rooms, floors = room_graph(package), dict[str, int]()
        for name in TopologicalSorter(rooms).static_order():
            floors[name] = 1 + max((floors[each] for each in rooms[name]), default=0)
        assert told == floors


#: What the simulator knows of the rest: no algebra.
SHARED = (
    "identification.Device",
    "identification.Hardware",
    "identification.InvalidInputError",
    "identification.Trajector",
    "identification.load_device",
    "identification.to_yaml",
)
#: What each folder may import of ours, all of it or its names that begin so.
ALLOWED = {
    "identification": ("identification",),
    "datasets_synthetic": ("datasets_synthetic", *SHARED),
    "tests/simulated": ("datasets_synthetic", *SHARED),
    "tune/certificate": (
        "tune.certificate",
        "identification.Device",
        "identification.to_mapping",
        # Arguments, words, and what people write and read.
        "identification.typed",
        "identification.counted",
        "tune.documents.profile",
        "tune.documents.scene",
        "tune.documents.CheckFailedError",
    ),
}


@pytest.mark.parametrize("folder", ALLOWED)
def test_a_folder_shares_no_algebra_with_what_it_judges(folder: str) -> None:
    reached = {name for path in _files(folder) for name in _imports(path)}
    assert {name for name in reached if not name.startswith(ALLOWED[folder])} == set()


def test_tune_imports_public_names_of_identification_only() -> None:
    for path in _files("tune"):
        for name in _imports(path):
            package, _, rest = name.partition(".")
            if package == "identification":
                assert rest in identification.__all__, f"{path} reaches into {name}"
            if package == "datasets_synthetic":
                assert path.name in {"preparation.py", "profiles.py"}, f"{path} imports {name}"


def test_the_certificate_shares_no_algebra_when_it_runs() -> None:
    """Nor through what it imports: no plant, loop, criterion or ripple is loaded to check."""
    code = (
        "import sys, tune.certificate.check, tune.certificate.certify\n"
        "bad = [n for n in ('identification.plant', 'tune.loop.loop', 'tune.stability.verdict',"
        " 'tune.stability.criterion', 'tune.rendering', 'tune.optimisation.feasibility')"
        " if n in sys.modules]\n"
        "sys.exit(', '.join(bad) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


#: What setuptools adds.
MADE = {"PKG-INFO", "setup.cfg"}


@pytest.mark.skipif(
    shutil.which("git") is None or not (ROOT / ".git").exists(),
    reason="no version control here to compare with",
)
def test_every_file_under_version_control_is_in_the_source_distribution(tmp_path: Path) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    tracked = {name for name in listed.stdout.split("\0") if (ROOT / name).is_file()}
    source = tmp_path / "source"
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    code = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    command = [sys.executable, "-c", code, str(tmp_path)]
    subprocess.run(command, cwd=source, capture_output=True, check=True)
    (archive,) = tmp_path.glob("haptune-*.tar.gz")
    with tarfile.open(archive) as stored:
        names = [member.name for member in stored.getmembers() if member.isfile()]
    held = {name.partition("/")[2] for name in names}
    assert {name for name in held if ".egg-info/" not in name} - MADE == tracked
