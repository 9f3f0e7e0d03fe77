"""Every command's JSON: valid by its schema, with every number that the command's tables show."""

import functools
import html
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from datasets_synthetic import Controller, bundled_path, log_text, named_rig, simulate
from identification import load_trajectory
from tests.commands import FLUID, SCHEMAS, Ended, form, haptune
from tests.exported import LOOPS, changed
from tune import export
from tune.cli.app import app
from tune.cli.session import Session
from tune.documents.results import DETAILS

#: A fluid settles at once; the wall has all that a profile can say.
SCENES = {
    "fluid": FLUID,
    "wall": "elements: {water: {damping: max}, sponge: {damping: 12.0, stiffness: 40.0, "
    "one_sided: true}}\nloop: {velocity_filter_hz: 50.0}\n",
    "spring": "elements: {spring: {stiffness: 1000.0, damping: 10.0}}\n"
    "loop: {velocity_filter_hz: 50.0}\n",
}
#: Closed-loop logs of the spring: mass of the device, and where the handle is let go, m.
PLAYED = {"agreeing": (3.0, 0.02), "heavy": (3.9, 0.02), "stuck": (3.0, 2.5e-3)}
#: Words of the tables that hold numbers which are no results.
FIXED = ("95 %", "0.5 to 5 Hz, mean (at 0.5 to at 5 Hz)", "haptune/", "no force beyond 2e-5 of it")


@functools.cache
def _schema(name: str) -> Draft202012Validator:
    return Draft202012Validator(json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8")))


def both(*arguments: str) -> tuple[Ended, str]:
    """A command run once with --json, and what it says to people without it."""
    said: list[str] = []
    tell = Session.say

    def keep(session: Session, text: Any) -> None:
        from rich.console import Console

        console = Console(width=200, highlight=False, markup=False, emoji=False)
        with console.capture() as captured:
            console.print(text, soft_wrap=isinstance(text, str))
        said.append(captured.get())
        tell(session, text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "say", keep)
        ended = haptune(*arguments, "--json")
    _schema("result").validate(ended.result)
    return ended, "".join(said)


def numbers_of(content: Any) -> Iterator[float]:
    """Every number of a JSON object; none of those inside texts."""
    if isinstance(content, dict):
        for item in content.values():
            yield from numbers_of(item)
    elif isinstance(content, list):
        for item in content:
            yield from numbers_of(item)
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield float(content)


def sentences_of(content: Any) -> Iterator[str]:
    """Every sentence of a JSON object; what people are told in the same words needs no number."""
    if isinstance(content, dict | list):
        for item in content.values() if isinstance(content, dict) else content:
            yield from sentences_of(item)
    elif isinstance(content, str) and content.count(" ") > 3:
        yield content


#: A number that is no part of a word, what stands before "1 - " as the whole of it, and its unit.
_NUMBER = re.compile(
    r"(?<![\w.])(1 - )?[-+≥]?(\d+(?:\.\d+)?(?:e[-+]?\d+)?)(?![\w.]*[A-Za-z]\d)( ?%| ms| µm)?"
)


def missing_numbers(text: str, result: dict[str, Any]) -> list[str]:
    """Numbers of a text that are in the details of no result, rounded as the text rounds them."""
    for words in (*FIXED, *sentences_of(result)):
        text = text.replace(words, "")
    text = re.sub("certified with .*", "", text)  # versions of libraries
    known = [abs(number) for number in numbers_of(result.get("details", {}))]
    missing: list[str] = []
    for found in _NUMBER.finditer(text):
        one_less, digits, unit = found.groups()
        mantissa, _, power = digits.partition("e")
        place = -len(mantissa.partition(".")[2]) + int(power or 0)
        size = {None: 1.0, " ms": 1e-3, " µm": 1e-6}.get(unit, 1e-2)
        value, half = float(digits) * size, 0.5000001 * 10.0**place * size
        # Zeros at the end of a whole number may be of rounding.
        half *= 10 ** (len(mantissa) - len(mantissa.rstrip("0"))) if "." not in mantissa else 1
        value = 1 - value if one_less else value
        if not any(math.isclose(value, each, rel_tol=1e-9, abs_tol=half) for each in known):
            line = text[text.rfind("\n", 0, found.start()) + 1 :].partition("\n")[0]
            missing.append(f"{found.group()} in {line.strip()!r}")
    return missing


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log, a device and a profile, made by the commands themselves."""
    place = tmp_path_factory.mktemp("results")
    log = load_trajectory(bundled_path("homerehab.csv")).part(slice(0, 2000))
    (place / "log.csv").write_text(log_text(log), encoding="utf-8")
    for name, scene in SCENES.items():
        (place / f"{name}.yaml").write_text(scene, encoding="utf-8")
    text = form("excitation", "--device", "homerehab").replace("duration: 10.0", "duration: 2.0")
    (place / "excitation.yaml").write_text(text, encoding="utf-8")
    (place / "axes.yaml").write_text(text + "axes: [x, y]\n", encoding="utf-8")
    for name, (mass, start) in PLAYED.items():
        played = Controller(stiffness=800.0, damping=8.0, velocity_filter_hz=50.0)
        rig = replace(named_rig("homerehab"), mass=mass)
        run = simulate(rig, np.zeros(1500), controller=played, position=start)
        (place / f"{name}.csv").write_text(log_text(run.trajectory()), encoding="utf-8")
    (place / "hardware.yaml").write_text(
        bundled_path("homerehab.hardware.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    return place


#: In this order: some write what later ones read.
QUICK = (
    "identify log.csv --hardware hardware.yaml --method least-squares",
    "calibrate log.csv --hardware hardware.yaml --scene fluid.yaml --method least-squares",
    "audit homerehab --stiffness 30000",
    "check profile.yaml",
    "compare profile.yaml homerehab",
    "new scene -o new.yaml",
    "export profile.yaml --to json,ros2",
)
THOROUGH = (
    "doctor log.csv --hardware hardware.yaml",
    "identify log.csv --hardware hardware.yaml",
    "calibrate log.csv --hardware hardware.yaml --scene wall.yaml --candidates",
    "tune homerehab fluid.yaml -o other.yaml --what-if",
    "audit homerehab --stiffness 1000 --damping 10 --mass 1 --velocity-filter 30 "
    "--acceleration-filter 30",
    "check profile.yaml --device homerehab",
    "compare device.yaml homerehab",
    "report profile.yaml log.csv --what-if wall.yaml",
    "verify profile.yaml",
    "tune homerehab spring.yaml -o spring-profile.yaml",
    *(f"verify spring-profile.yaml {name}.csv" for name in PLAYED),
    "excite excitation.yaml -o force.csv",
    "excite axes.yaml -o forces.csv",
    "simulate homerehab -o simulated.csv",
)


def _tables_of(page: Path) -> str:
    """What the tables of a page show, and the lines below them."""
    text = page.read_text(encoding="utf-8")
    parts = re.findall(r"<(?:table|ul)\b.*?</(?:table|ul)>", text, re.DOTALL)
    return html.unescape(re.sub(r"<[^>]*>", "\n", "\n".join(parts)))


def _wanting(commands: tuple[str, ...]) -> str:
    """Numbers that the tables of commands show and their JSON lacks, a line each."""
    wanting: list[str] = []
    for arguments in commands:
        ended, text = both(*arguments.split())
        assert ended.code in {0, 4, 6}, ended.err
        details = ended.result.get("details", {})
        pages = (each for each in ended.result["outputs"] if each.endswith(".html"))
        text = "".join((text, *(_tables_of(Path(each)) for each in pages)))
        shown = "\n".join(line for line in text.splitlines() if line[:1] not in set("+-@"))
        wanting += [f"{arguments}: {each}" for each in missing_numbers(shown, ended.result)]
        for file in {"device", "profile"} & details.keys():
            _schema(file).validate(details[file])
    return "\n".join(wanting)


def test_tables_and_json_hold_the_same_numbers(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert _wanting(QUICK) == ""


@pytest.mark.long
def test_tables_and_json_of_larger_scenes_hold_the_same_numbers(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert _wanting(THOROUGH) == ""


def test_every_command_has_a_schema() -> None:
    commands = {command.name for command in app.registered_commands} - {"help"}  # prints text
    assert commands <= DETAILS.keys()


@pytest.mark.parametrize("name", LOOPS)
def test_an_exported_profile_is_valid(name: str) -> None:
    text = export(changed(**LOOPS[name]), "json")["haptune_profile.json"]
    _schema("export").validate(json.loads(text))
