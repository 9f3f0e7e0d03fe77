"""Files and options as chance and malice leave them: each from a seed, each always the same."""

import shutil
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import identification
from datasets_synthetic import bundled_path, log_text
from identification import load_trajectory
from tests.commands import FLUID, haptune

#: What stands in place of a number or a name.
SCALARS = (
    *("", "~", "null", "true", "no", ".nan", ".inf", "-.inf", "nan", "0", "-0.0", "1", "-1", "2.5"),
    *("1e-300", "1e-12", "1e-9", "1e-6", "1e6", "1e9", "1e12", "1e300", "1e308", "-1e308", "1e999"),
    *("9" * 30, "0x1F", "0o17", "1_000", "1:30:00", "2024-01-01", "'0.001'", '"\\0"', "'ü ☃'"),
    *("[]", "{}", "[1, 2]", "{value: 1, low: 2, high: 0}", "{value: 1, low: 0.5, high: 2}"),
    *("{min: 1, max: 2}", "max", "min", "free", "none", "linear", "rotary", "x" * 300, "!!str 3"),
    *("&a 1", "*a", "|\n  text", "? 1", "- 1", "#", "@", "`", "%", "%A", "{", "]", ":", "\t"),
)


def one_of(rng: np.random.Generator, choices: Any) -> Any:
    """One of several, by chance."""
    return choices[int(rng.integers(len(choices)))]


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content or b"?")
    for place in rng.integers(0, len(changed), int(rng.integers(1, 5))):
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(0, len(content) + 1))]


def _doubled(content: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted(int(each) for each in rng.integers(0, len(content) + 1, 2))
    return content[:last] + content[first:]


def _lines(change: Callable[[list[bytes], int, np.random.Generator], None]) -> Any:
    def changed(content: bytes, rng: np.random.Generator) -> bytes:
        lines = content.split(b"\n")
        change(lines, int(rng.integers(len(lines))), rng)
        return b"\n".join(lines)

    return changed


def _gone(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    del lines[place]


def _again(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    lines.insert(int(rng.integers(len(lines) + 1)), lines[place])


def _indented(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    lines[place] = b" " * int(rng.integers(1, 4)) + lines[place]


def _another_value(lines: list[bytes], place: int, rng: np.random.Generator) -> None:
    """A word of the line becomes a hostile one."""
    line = lines[place].decode("utf-8", "replace")
    marks = [i for i, letter in enumerate(line) if letter in " ,:{}[]"]
    first = one_of(rng, marks) + 1 if marks else 0
    ends = [mark for mark in marks if mark > first]
    last = ends[0] if ends and rng.random() < 0.7 else len(line)
    lines[place] = (line[:first] + " " + one_of(rng, SCALARS) + line[last:]).encode()


BYTE_MUTATIONS: Any = (_flipped, _cut, _doubled)
TEXT_MUTATIONS: Any = (
    *BYTE_MUTATIONS,
    *(_lines(change) for change in (_gone, _again, _indented, *[_another_value] * 6)),
)


#: What stands in place of the value of an option.
VALUES = (
    *("", " ", "0", "-0", "-1", "1", "3", "0.5", "nan", "inf", "-inf", "1e-300", "1e-12", "1e-6"),
    *("1e6", "1e12", "1e300", "1e308", "-1e308", "1e999", "9" * 400, "0x10", "1_0", "1,5", "٣"),
    *("true", "time", "force", "x" * 5000, "ü☃", "\x1b[31m", "\n", "a\nb", "..", ".", "/"),
    "/dev/null",
    *("/dev/zero", "/dev/full", "/nowhere/at.all", "--json", "-", "--", "%s%n", "{}", "*", "[red]"),
    *("scene.yaml", "log.csv", "device.yaml", "profile.yaml", "x" * 300 + ".yaml", "c,c", "json,"),
)

_SCENE = """schema: haptune/scene/1
name: pool
hand: none
margin: balanced
loop: {velocity_filter_hz: 30.0, acceleration_filter_hz: none}
ripple_limit: 0.1
elements:
  water: {damping: 10.0, speed: 0.2, priority: 1}
  wall: {stiffness: {min: 50.0, max: 300.0}, penetration: 0.01}
"""
_EXCITATION = """schema: haptune/excitation/1
name: axis
axis: x
motion: linear
sample_time: 0.001
duration: 2.0
ramp: 0.2
force: 14.0
travel: 0.1
speed: 1.0
mass: {value: 3.0, low: 2.5, high: 3.5}
damping: 10.0
encoder_resolution: 0.000006
delay: known
"""


def _bare(path: Path) -> str:
    """A good file without the comments above it."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith("#"))


#: The good files: name, text.
DOCUMENTS = {
    "scene": _SCENE,
    "device": _bare(Path(identification.__file__).parent / "device/named/homerehab.yaml"),
    "hardware": _bare(bundled_path("homerehab.hardware.yaml")),
    "excitation": _EXCITATION,
}
#: What reads the mutated file, hostile.yaml or the log.
READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    "scene": (("tune", "device.yaml", "hostile.yaml", "--dry-run"),),
    "device": (
        ("tune", "hostile.yaml", "fluid.yaml", "--dry-run"),
        ("audit", "hostile.yaml", "--damping", "5"),
    ),
    "hardware": (("doctor", "log.csv", "--hardware", "hostile.yaml"),),
    "excitation": (("excite", "hostile.yaml", "--dry-run"),),
    "profile": (
        ("check", "hostile.yaml"),
        ("export", "hostile.yaml", "--dry-run"),
        ("verify", "hostile.yaml", "log.csv"),
    ),
    "log": (("doctor",), ("identify", "--dry-run"), ("verify", "profile.yaml")),
}
#: Commands that work, and the options of each that take a value.
_NAMES = ("--time", "--force", "--position", "--axis")
_GAINS = ("--force-gain", "--position-gain")
_LOG = (*_NAMES, "--reference", *_GAINS, "--hardware", "--allow")
COMMANDS: dict[tuple[str, ...], tuple[str, ...]] = {
    ("doctor", "log.csv"): _LOG,
    ("identify", "log.csv", "--dry-run"): (*_LOG, "--method", "-o"),
    ("calibrate", "log.csv", "--scene", "fluid.yaml", "--dry-run"): (
        *_LOG,
        *("--method", "--margin", "--scene", "-o"),
    ),
    ("tune", "device.yaml", "fluid.yaml", "--dry-run"): ("--margin", "-o"),
    ("audit", "device.yaml", "--damping", "5"): (
        *("--stiffness", "--damping", "--mass", "--extra-delay-samples", "--velocity-filter"),
        *("--acceleration-filter", "--filter-damping-ratio", "--margin"),
    ),
    ("check", "profile.yaml"): (),
    ("verify", "profile.yaml", "log.csv"): (
        *(*_NAMES, *_GAINS, "--element", "--gain", "--release", "--picture"),
    ),
    ("export", "profile.yaml", "--dry-run"): ("--to", "-o"),
    ("excite", "excitation.yaml", "--dry-run"): ("-o", "--picture"),
    ("simulate", "hand-held"): ("-o", "--seed"),
    ("new", "hardware", "--dry-run"): ("--device", "-o"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one case ended."""

    command: tuple[str, ...]
    code: int
    seconds: float  # of the processor: others may be at work beside
    said: str  # standard error, its beginning
    warned: tuple[str, ...]  # by libraries


def prepare() -> None:
    """Write the good files that the commands of all cases need into the current folder.

    They are kept in a folder of their own too: a case may name one of them as its output.
    """
    good = Path("good")
    good.mkdir()
    for name, text in (*DOCUMENTS.items(), ("fluid", FLUID)):
        (good / f"{name}.yaml").write_text(text, encoding="utf-8")
    log = load_trajectory(bundled_path("homerehab.csv")).part(slice(0, 1000))
    (good / "log.csv").write_text(log_text(log), encoding="utf-8")
    files = [str(good / name) for name in ("device.yaml", "fluid.yaml", "profile.yaml")]
    made = haptune("tune", *files[:2], "-o", files[2], "--quiet")
    assert made.code == 0, made.err
    shutil.copytree(good, ".", dirs_exist_ok=True)


def run_yaml(seed: int) -> Outcome:
    """A command on a YAML file with a few places changed."""
    rng = np.random.default_rng((1, seed))
    kind = one_of(rng, (*DOCUMENTS, "profile"))
    text = DOCUMENTS[kind] if kind in DOCUMENTS else Path("profile.yaml").read_text("utf-8")
    content = text.encode()
    for _ in range(int(rng.integers(1, 4))):
        content = one_of(rng, TEXT_MUTATIONS)(content, rng)
    Path("hostile.yaml").write_bytes(content)
    return ended(one_of(rng, READERS[kind]))


def run_log(seed: int) -> Outcome:
    """A command on a table of text with a few places changed."""
    rng = np.random.default_rng((2, seed))
    content = Path("log.csv").read_bytes()
    for _ in range(int(rng.integers(1, 4))):
        content = one_of(rng, TEXT_MUTATIONS)(content, rng)
    Path("hostile.csv").write_bytes(content)
    return ended((*one_of(rng, READERS["log"]), "hostile.csv"))


def run_options(seed: int) -> Outcome:
    """A command with a hostile value for one of its options, or in place of an argument."""
    rng = np.random.default_rng((3, seed))
    command = one_of(rng, tuple(COMMANDS))
    value = one_of(rng, VALUES)
    options = COMMANDS[command]
    if options and rng.random() < 0.8:
        option = one_of(rng, options)
        # As one word, so that "-1" is not taken for an option.
        stated = f"{option}={value}" if option.startswith("--") else f"{option}{value}"
        return ended((*command, stated))
    place = int(rng.integers(1, 1 + sum(not word.startswith("-") for word in command[1:2])))
    return ended((*command[:place], value, *command[place + 1 :]))


KINDS: dict[str, Callable[[int], Outcome]] = {
    "yaml": run_yaml,
    "log": run_log,
    "options": run_options,
}


def ended(command: tuple[str, ...]) -> Outcome:
    """Run a command among the good files and say how it ended."""
    shutil.copytree("good", ".", dirs_exist_ok=True)
    started = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            end = haptune(*command)
            code, said = end.code, end.err
        except BaseException as error:  # noqa: BLE001 - what a user would see as a traceback
            code, said = 1, f"Traceback: {type(error).__name__}: {error}"
    return Outcome(
        command=command,
        code=code,
        seconds=time.process_time() - started,
        said=said[:600],
        warned=tuple(f"{Path(each.filename).name}: {each.message}" for each in caught),
    )


def fault(outcome: Outcome) -> str:
    """What is wrong with how a case ended; empty if nothing is."""
    if outcome.code not in {0, 2, 3, 4, 5, 6, 7}:
        return f"exit {outcome.code}"
    if outcome.warned:
        return "a library warns"
    if outcome.seconds > 10:
        return f"took {outcome.seconds:.0f} s"
    if outcome.code and not outcome.said.strip():
        return "nothing was said"
    return "an internal error" if "internal error" in outcome.said else ""
