"""The plan of each package from its imports: rooms, floors, circles, the one direction of data."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
Graph = dict[str, set[str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a package keeps to: lowered as it is put in order, never raised."""

    rooms: int
    floors: int
    lines: int = 620


PLANS = {
    "identification": Plan(rooms=12, floors=6),
    "tune": Plan(rooms=15, floors=8),
    "datasets_synthetic": Plan(rooms=8, floors=6),
}


@cache
def file_graph(package: str) -> Graph:
    """Modules of a package, and those of it that each imports, for types or when called too."""
    files = {_dotted(path): path for path in sorted((ROOT / package).rglob("*.py"))}
    del files[package]
    return {name: _imported(path, files) - {name} for name, path in files.items()}


def _dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(path: Path, files: dict[str, Path]) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            named = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (named & files.keys()) or {node.module}
    return found & files.keys()


def room_graph(files: Graph) -> Graph:
    """Rooms of a package, and those that the files of each import."""
    rooms: Graph = {_room(name): set() for name in files}
    for name, imported in files.items():
        rooms[_room(name)] |= {_room(each) for each in imported} - {_room(name)}
    return rooms


def _room(name: str) -> str:
    return name.split(".")[1]


def floors(rooms: Graph) -> dict[str, int]:
    """Length of the longest chain of imports from each room down."""
    found: dict[str, int] = {}
    for name in TopologicalSorter(rooms).static_order():
        found[name] = 1 + max((found[each] for each in rooms[name]), default=0)
    return found


def circle(graph: Graph) -> list[str]:
    """Names that import each other in a ring; empty if there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", PLANS)
def test_no_file_imports_itself_through_others(package: str) -> None:
    assert circle(file_graph(package)) == []


@pytest.mark.parametrize("package", PLANS)
def test_nothing_is_imported_upwards(package: str) -> None:
    """Rooms stand on floors, each above all that it imports: they form no circle."""
    assert circle(room_graph(file_graph(package))) == []


@pytest.mark.parametrize("package", PLANS)
def test_rooms_and_floors_are_as_planned(package: str) -> None:
    rooms = room_graph(file_graph(package))
    assert len(rooms) <= PLANS[package].rooms, sorted(rooms)
    assert max(floors(rooms).values()) <= PLANS[package].floors, floors(rooms)


@pytest.mark.parametrize("package", PLANS)
def test_no_file_has_more_lines_than_planned(package: str) -> None:
    lines = {
        str(path): len(path.read_text(encoding="utf-8").splitlines())
        for path in (ROOT / package).rglob("*.py")
    }
    assert {path for path, count in lines.items() if count > PLANS[package].lines} == set()


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
        assert told == floors(room_graph(file_graph(package)))


#: What people write and read; no algebra.
_DOCUMENTS = ("profile", "scene", "CheckFailedError")
PACKAGES = ("identification", "tune", "datasets_synthetic")


@cache
def _imports(path: Path) -> frozenset[str]:
    """Full dotted names that a file imports: a.b for ``from a import b``, or x.b of a as x."""
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
    return frozenset(found)


def _files(package: str) -> list[Path]:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    return files


def _ours(path: Path) -> set[str]:
    return {name for name in _imports(path) if name.split(".")[0] in PACKAGES}


@pytest.mark.parametrize("path", _files("identification"), ids=str)
def test_identification_imports_nothing_of_ours(path: Path) -> None:
    assert {name.split(".")[0] for name in _ours(path)} <= {"identification"}


@pytest.mark.parametrize("path", _files("tune"), ids=str)
def test_tune_imports_public_names_of_identification_only(path: Path) -> None:
    import identification

    for name in _ours(path):
        package, _, rest = name.partition(".")
        if package == "identification":
            assert rest in identification.__all__, f"{path} reaches into {name}"
        if package == "datasets_synthetic":
            allowed = {"preparation.py", "profiles.py"}
            assert path.name in allowed, f"{path} imports {name}"


@pytest.mark.parametrize(
    "path", [*_files("datasets_synthetic"), *_files("tests/simulated")], ids=str
)
def test_the_simulator_shares_no_algebra(path: Path) -> None:
    allowed = {
        "identification.Device",
        "identification.Hardware",
        "identification.InvalidInputError",
        "identification.Trajectories",
        "identification.Trajectory",
        "identification.load_device",
        "identification.to_yaml",
    }
    outside = {n for n in _ours(path) if not n.startswith("datasets_synthetic")}
    assert outside <= allowed


@pytest.mark.parametrize("path", _files("tune/certificate"), ids=str)
def test_the_certificate_shares_no_algebra_with_what_it_checks(path: Path) -> None:
    allowed = ("tune.certificate", "identification.Device", "identification.to_mapping")
    allowed += ("identification.typed", "identification.counted")  # arguments and words
    allowed += tuple(f"tune.documents.{name}" for name in _DOCUMENTS)
    for name in _ours(path):
        assert name.startswith(allowed), f"{path} imports {name}"


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


def _tracked() -> set[str]:
    """Files under version control; skips where there is none, as in an unpacked distribution."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("no version control here to compare with")
    listed = subprocess.run(
        [git, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {name for name in listed.stdout.split("\0") if (ROOT / name).is_file()}


def test_every_file_under_version_control_is_in_it(tmp_path: Path) -> None:
    tracked = _tracked()
    source = tmp_path / "source"
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    code = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    made = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    (archive,) = tmp_path.glob("haptune-*.tar.gz")
    with tarfile.open(archive) as stored:
        names = [member.name for member in stored.getmembers() if member.isfile()]
    held = {name.partition("/")[2] for name in names}
    assert {name for name in held if ".egg-info/" not in name} - MADE == tracked
