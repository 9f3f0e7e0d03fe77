"""Letters that steer a terminal or turn the direction of writing come out nowhere."""

import copy
import functools
import json
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from identification import (
    InvalidInputError,
    UsageError,
    identify,
    load_device,
    load_mapping,
    load_trajectory,
    to_mapping,
    to_yaml,
)
from tests.commands import FLUID, SCHEMAS, Ended, digest_of, haptune
from tests.mutations import DOCUMENTS
from tests.packed_logs import FORCE, SAMPLES, bag_of, mat, npz
from tests.test_log_workbooks import workbook
from tests.thinned import thinned
from tune import Scene, optimise

#: Escape, a bell, nothing, and what turns writing round.
LETTERS = "a\x1b[31m\x07\x00\u202eb\u2066"
#: What a name in a log may hold: text has no NUL.
NAME = "x\x1b]0;y\x07\u202ez"
Place = tuple[str | int, ...]
#: What reads a document, hostile.yaml.
READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    "scene": (("tune", "homerehab", "hostile.yaml", "--dry-run"),),
    "hardware": (("doctor", "log.csv", "--hardware", "hostile.yaml"),),
    "device": (("tune", "hostile.yaml", "fluid.yaml", "--dry-run"),),
    "excitation": (("excite", "hostile.yaml", "--dry-run"),),
    "perception": (("tune", "homerehab", "felt.yaml", "--dry-run"),),
    "profile": (("check", "hostile.yaml"), ("report", "hostile.yaml", "-o", "page.html")),
}


def hidden(text: str) -> str:
    """The letters of a text that are not seen, ends of lines and tabs aside."""
    return "".join(
        letter
        for letter in text
        if unicodedata.category(letter) in {"Cc", "Cf", "Cs"} and letter not in "\n\t"
    )


def assert_clean(ended: Ended, *written: Path) -> None:
    texts = {"standard output": ended.out, "standard error": ended.err}
    texts |= {path.name: path.read_text("utf-8") for path in written}
    if ended.out.startswith("{"):  # as whoever reads it has it
        texts["JSON"] = json.dumps(ended.result, ensure_ascii=False)
    for name, text in texts.items():
        assert not hidden(text), f"{name}: {hidden(text)!r}"


@functools.cache
def _schema(kind: str) -> dict[str, Any]:
    return json.loads((SCHEMAS / f"{kind}.json").read_text("utf-8"))


def _branches(kind: str, part: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The ways in which a part of a schema can be met, references followed."""
    if "$ref" in part:
        yield from _branches(kind, _schema(kind)["$defs"][part["$ref"].rpartition("/")[2]])
    for one in part.get("anyOf", ()):
        yield from _branches(kind, one)
    if "$ref" not in part and "anyOf" not in part:
        yield part


def places(kind: str, part: Mapping[str, Any], above: Place = ()) -> Iterator[Place]:
    """Where a document can hold a text, names that it chooses itself (the last of a place) too."""
    for one in _branches(kind, part):
        if one.get("type") == "string" or "enum" in one or "const" in one:
            yield above
        if one.get("type") == "object":
            yield (*above, LETTERS)
            for name, each in one.get("properties", {}).items():
                yield from places(kind, each, (*above, name))
            if isinstance(each := one.get("additionalProperties"), Mapping):
                yield from places(kind, each, (*above, "any"))
        for each in [one["items"]] if "items" in one else one.get("prefixItems", ())[:1]:
            yield from places(kind, each, (*above, 0))


def _put(content: Any, place: Place) -> Any:
    """Content with the letters in a place, and what has to be there for it to exist."""
    if not place:
        return LETTERS
    first, *rest = place
    if isinstance(first, int):
        listed = list(content) if isinstance(content, list | tuple) else []
        return [_put(listed[0] if listed else None, tuple(rest)), *listed[1:]]
    named = dict(content) if isinstance(content, Mapping) else {}
    if first == "any" and first not in named and named:
        first = next(iter(named))
    return named | {first: _put(named.get(first), tuple(rest))}


@functools.cache
def _good(kind: str) -> dict[str, Any]:
    if kind == "profile":
        scene = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
        return to_mapping(optimise(load_device("homerehab"), scene).signed())
    if kind == "perception":
        return load_mapping(SCHEMAS.parent / "data" / "homerehab_study.yaml")
    Path("good.yaml").write_text(DOCUMENTS[kind], encoding="utf-8")
    return load_mapping("good.yaml")


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("fluid.yaml").write_text(FLUID, encoding="utf-8")
    Path("felt.yaml").write_text(FLUID + "perception: hostile.yaml\n", encoding="utf-8")
    rows = "".join(f"{t:.3f},{f:.6f},{p:.6f}\n" for t, f, p in SAMPLES)
    Path("log.csv").write_text(f"time,force,position\n{rows}", encoding="utf-8")


@pytest.mark.parametrize(
    ("kind", "one_in"),
    thinned([*((kind, 18) for kind in READERS), *((kind, 1) for kind in READERS)], 6),
)
def test_no_text_of_a_document_comes_out(kind: str, one_in: int) -> None:
    found = list(dict.fromkeys(places(kind, _schema(kind))))
    assert len(found) > 5
    for place in [each for k, each in enumerate(found) if k % one_in == 0 or len(each) == 1]:
        content = _put(copy.deepcopy(_good(kind)), place)
        if kind == "profile" and place != ("digest",):
            content["digest"] = digest_of(content)
        Path("hostile.yaml").write_text(to_yaml(content), encoding="utf-8")
        for command in READERS[kind]:
            ended = haptune(*command, "--json")  # which says the same twice, there and to people
            assert ended.code in {3, 6}, (place, ended)
            assert ended.result["outputs"] == []
            assert ended.result["message"] in ended.err
            assert_clean(ended, *Path().glob("page.html"))


def _csv() -> tuple[Path | str, ...]:
    rows = "".join(f"{t:.3f},{f:.6f},{p:.6f},1\n" for t, f, p in SAMPLES)
    path = Path("log.csv")
    path.write_text(f"time,{NAME} [N],position,{NAME}\n{rows}", encoding="utf-8")
    return path, "--force", NAME + " [N]"


def _mat() -> tuple[Path | str, ...]:
    name = NAME.replace("\u202e", "\x9b")  # names are of Latin letters
    return mat(Path(), **{name: FORCE, f"{name}2": 1.0}), "--force", name


def _npz() -> tuple[Path | str, ...]:
    return npz(Path(), **{NAME: FORCE}), "--force", NAME


def _xlsx() -> tuple[Path | str, ...]:
    header = ("time", "\u202eforce\u2066 [N]", "position")
    sheets = {"\u202esheet": [header, *SAMPLES], "\u2066other": []}
    return workbook(Path(), sheets=sheets), "--force", "\u202eforce\u2066"


def _mcap() -> tuple[Path | str, ...]:
    path = bag_of(Path(), f"# {NAME}\n", b"", name=NAME)
    return path, "--position", f"/{NAME}/position", "--force", f"/{NAME}/force"


@pytest.mark.parametrize("write", thinned([_csv, _mcap, _xlsx, _mat, _npz], 1))
def test_no_name_of_a_log_comes_out(write: Callable[[], tuple[Path | str, ...]]) -> None:
    log, *options = map(str, write())
    named = Path(f"{NAME}{Path(log).suffix}")
    Path(log).rename(named)
    Path("hardware.yaml").write_text(DOCUMENTS["hardware"], encoding="utf-8")
    stated = ("--hardware", "hardware.yaml", "--picture", "a.svg")
    told: list[str] = []
    # Named as asked, and named by nobody: what there is instead is told.
    for asked in (options, [*options[:-1], "nothing"]):
        for command in (("doctor",), ("identify", "-o", f"{NAME}.yaml")):
            for extra in ((), ("--json",)):
                ended = haptune(*command, str(named), *asked, *stated, *extra)
                assert ended.code in {0, 3, 4}, ended
                assert_clean(ended, *Path().glob("*.svg"), *Path().glob("x*.yaml"))
                told.append(ended.out + ended.err)
    assert "\\x1b" in "".join(told) or "\\u202e" in "".join(told)


def test_no_error_of_the_library_holds_them() -> None:
    log = load_trajectory("log.csv")
    with pytest.raises(UsageError) as method:
        identify([log], method=LETTERS)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidInputError) as name:
        load_trajectory(f"{NAME}.csv")
    for refused in (method, name):
        assert "\\x1b" in str(refused.value)
        assert not hidden(str(refused.value))


def test_no_name_of_a_file_comes_out() -> None:
    ended = haptune("new", "scene", "-o", f"{NAME}.yaml")
    assert (ended.code, "\\x1b" in ended.out) == (0, True)
    assert_clean(ended)
    for options in ((), ("--json",)):
        ended = haptune("new", "scene", "-o", f"{NAME}/scene.yaml", *options)
        assert (ended.code, "\\x1b" in ended.err) == (7, True)
        assert_clean(ended)
