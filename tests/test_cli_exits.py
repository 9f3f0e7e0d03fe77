"""Every exit code of the contract, each from a situation that can happen to a user."""

from pathlib import Path

import pytest

from tests.commands import FLUID, FULL, failing, files, haptune, log_text

STATUS = {
    1: "internal-error",
    2: "usage",
    3: "invalid-input",
    4: "log-refused",
    5: "no-feasible-effect",
    6: "check-failed",
    7: "not-written",
    130: "interrupted",
}

#: code, words of the sentence, command
SITUATIONS: tuple[tuple[int, str, str], ...] = (
    (2, "No such option", "demo --bogus"),
    (2, "No such command", "tuna"),
    (2, "missing argument", "new"),
    (2, "is not one of 'hardware', 'scene'", "new profile"),
    (2, "Missing option '--scene'", "calibrate log.csv"),
    (2, "--seed", "simulate homerehab --seed one"),
    (2, "'soft' is not one of", "tune homerehab scene.yaml --margin soft"),
    (2, "fills in no player", "new player --device knob"),
    (2, "fills in no study", "new study --device knob"),
    (2, "is of no scene", "new scene --language c"),
    (2, "logs are of y", "identify log.csv --axis y --hardware x.yaml"),
    (2, "guess is no finding", "identify log.csv --allow guess"),
    (2, "one of the inputs", "identify log.csv -o log.csv"),
    (2, "one of the inputs", "tune homerehab scene.yaml -o ../here/scene.yaml"),
    (2, "all are zero", "audit homerehab"),
    (2, "-3 is never stable", "audit homerehab --stiffness -3"),
    (2, "nan is no finite number", "audit homerehab --damping nan"),
    (2, "-0.5 would take away from", "audit homerehab --damping 9 --extra-delay-samples -0.5"),
    (2, "there is no folder absent", "open absent"),
    (3, "cannot be read", "fleet absent.csv --scene scene.yaml -o many"),
    (3, "is not UTF-8", "fleet utf16.csv --scene scene.yaml -o many"),
    (7, "there is no folder", "fleet fleet.csv --scene scene.yaml -o absent/many"),
    (7, "exists", "fleet fleet.csv --scene scene.yaml -o scene.yaml"),
    (3, "No such file", "tune homerehab missing.yaml"),
    (3, "neither a file nor a named device", "tune homerehap scene.yaml"),
    (3, "Is a directory", "tune folder scene.yaml"),
    (3, "is not a scenario", "simulate homerehap"),
    (3, "neither a file nor a named device", "new hardware --device nobody"),
    (3, "No such file", "check missing.yaml"),
    (3, "is not valid YAML in line 1", "tune homerehab torn.yaml"),
    (3, "anchors or aliases", "tune homerehab aliases.yaml"),
    (3, "byte 0 is not UTF-8", "tune homerehab utf16.yaml"),
    (3, "no key known here; did you mean stiffness?", "tune homerehab unknown-key.yaml"),
    (3, "schema is 'haptune/scene/1'", "check scene1.yaml"),
    (3, "at most 20 can be tuned", "tune late.yaml scene.yaml"),
    (3, "has no column 'torque'", "identify log.csv --force torque"),
    (3, "not a finite number other than zero", "identify log.csv --force-gain 0"),
    (3, "absent.yaml: cannot be read", "tune homerehab perception.yaml"),
    (4, "force in constant.csv is 2 in every row", "identify constant.csv"),
    (4, "at least 200", "identify short.csv"),
    (5, "wall.stiffness: its range starts at 20000", "tune homerehab impossible.yaml"),
    (6, "was changed after it was certified", "check changed.yaml"),
    (6, "unsigned.yaml: has no digest, the content has sha256:", "check unsigned.yaml"),
    (7, "it is a folder", "tune homerehab scene.yaml -o folder"),
    (7, "there is no folder absent", "tune homerehab scene.yaml -o absent/profile.yaml"),
    (7, "a device, not a file", "tune homerehab scene.yaml -o /dev/null"),
    (2, "written to the standard output", "tune homerehab scene.yaml -o -"),
    (2, "written to the standard output", "export changed.yaml --to c -o -"),
    (3, "Give a smaller file", "tune homerehab large.yaml"),
    (7, "too long", f"new scene -o {'x' * 999}"),
    (3, "too long", f"identify log.csv --hardware {'x' * 999}.yaml"),
    (7, "No space left", "tune homerehab scene.yaml -o folder/full"),
)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    (here / "folder").mkdir(parents=True)
    monkeypatch.chdir(here)
    texts = {
        "scene.yaml": FLUID,
        "scene1.yaml": "schema: haptune/scene/1\n" + FLUID,
        "torn.yaml": "elements: {wall: {stiffness: max",
        "aliases.yaml": "elements: {wall: &w {stiffness: max}, door: *w}",
        "unknown-key.yaml": "elements: {wall: {stifness: max}}",
        "impossible.yaml": "elements: {wall: {stiffness: {min: 20000, max: 30000}}}",
        "perception.yaml": FLUID + "perception: absent.yaml\n",
        "large.yaml": f"elements: {{wall: [{'1, ' * 200}]}}",
        "x.yaml": "axis: x\n",
        "late.yaml": "{motion: linear, sample_time: 0.001, mass: 3, damping: 10, delay: 0.05, "
        "encoder_resolution: 0.00001, force_limit: {continuous: 1, peak: 2}}",
        "changed.yaml": "{schema: haptune/profile/1, certificate: {}, digest: sha256:0}",
        "unsigned.yaml": "{schema: haptune/profile/1, certificate: {}}",
        "log.csv": log_text(),
        "fleet.csv": "serial,log\nA1,log.csv\n",
        "constant.csv": log_text(force="2.0"),
        "short.csv": log_text(20),
    }
    for name, text in texts.items():
        Path(name).write_text(text, encoding="utf-8")
    for name in ("utf16.yaml", "utf16.csv"):
        Path(name).write_text(FLUID, encoding="utf-16")


@pytest.mark.parametrize(("code", "words", "command"), SITUATIONS, ids=str)
def test_each_refusal_has_its_code_and_one_sentence_and_writes_nothing(
    code: int, words: str, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if words == "No space left":
        monkeypatch.setattr("os.fsync", failing(FULL))
    if "smaller" in words:
        monkeypatch.setattr("identification.documents.MOST_EVENTS", 200)
    before = files()
    ended = haptune(*command.split(), "--json")
    assert ended.code == code
    assert words.lower() in ended.err.lower()
    result = ended.result
    assert result["status"] == STATUS[code]
    assert result["message"] in ended.err
    assert result["outputs"] == []
    assert bool(result["findings"]) == (code == 4)
    assert files() == before
    plain = haptune(*command.split())
    assert plain.code == code
    assert plain.err == ended.err
    assert len(plain.err.splitlines()) == (2 if code == 4 else 1)


def test_a_finding_carries_what_was_seen_what_is_needed_and_what_to_do() -> None:
    findings = haptune("identify", "constant.csv", "--json").result["findings"]
    assert [set(finding) for finding in findings] == [
        {"code", "severity", "source", "seen", "needed", "remedy", "at"}
    ]
    assert findings[0]["code"] == "constant-column"
    assert findings[0]["severity"] == "refusal"
    assert findings[0].pop("at") == []
    assert all(findings[0].values())


#: What to break, so that each command is stopped from inside.
INSIDE = {
    "demo": "datasets_synthetic.bundled_path",
    "new scene": "identification.write_files",
    "identify log.csv": "identification.load_log",
    "tune homerehab scene.yaml": "tune.optimisation.optimise",
    "calibrate log.csv --scene scene.yaml": "identification.load_log",
    "check scene.yaml": "tune.certificate.check.check",
    "simulate homerehab": "datasets_synthetic.run",
}


@pytest.mark.parametrize("command", INSIDE)
def test_what_stops_it_from_inside_is_one_sentence_and_writes_nothing(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A defect of ours, without its traceback; a person who interrupts it."""
    before, defect = files(), ZeroDivisionError("by hand")
    for code, words, error in (
        (1, "internal error: ZeroDivisionError: by hand; no file was written", defect),
        (130, "interrupted", KeyboardInterrupt()),
    ):
        monkeypatch.setattr(INSIDE[command], failing(error), raising=False)
        ended = haptune(*command.split(), "--json")
        assert (ended.code, ended.result["status"]) == (code, STATUS[code])
        assert words in ended.err
        assert len(ended.err.splitlines()) == 1
        assert files() == before
