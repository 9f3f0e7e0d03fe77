"""The command line's contract: exit codes, JSON, files, and what a spring-only scene loads."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from datasets_synthetic import bundled

SPRING = "schema: haptune/scene/1\nelements:\n  wall: {stiffness: max}\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    code: int
    out: str
    err: str


@pytest.fixture
def haptune(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> object:
    """Run the command line in a folder that holds scene.yaml, a spring-only scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SPRING, encoding="utf-8")

    def run(*arguments: str) -> Ended:
        from tune.cli.app import run as entry

        monkeypatch.setattr(sys, "argv", ["haptune", *arguments])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            entry()
        streams = capsys.readouterr()
        assert "Traceback" not in streams.out + streams.err
        return Ended(code=int(ended.value.code or 0), out=streams.out, err=streams.err)

    return run


def test_tune_and_check_a_known_device(haptune, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    assert haptune("tune", "homerehab", "scene.yaml").code == 0
    passed = haptune("check", "profile.yaml")
    assert passed.code == 0
    assert "passed" in passed.out
    text = (tmp_path / "profile.yaml").read_text(encoding="utf-8")
    (tmp_path / "profile.yaml").write_text(text.replace("stiffness: 1", "stiffness: 2", 1))
    assert haptune("check", "profile.yaml").code == 6


def test_a_forged_profile_with_a_fitting_digest_still_fails(haptune, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Stiffness times twenty, digest made anew: the certificate is what refuses it."""
    from identification import load_mapping, to_yaml
    from tune.profile import digest_of

    assert haptune("tune", "homerehab", "scene.yaml").code == 0
    content = load_mapping(tmp_path / "profile.yaml")
    content["device"].pop("force_limit")
    content["elements"]["wall"]["stiffness"] *= 20
    content["digest"] = digest_of(content)
    (tmp_path / "profile.yaml").write_text(to_yaml(content), encoding="utf-8")
    failed = haptune("check", "profile.yaml")
    assert failed.code == 6
    assert "unstable" in failed.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("tune", "homerehab"), 2, "scene"),
        (("tune", "homerehab", "scene.yaml", "--margin", "brave"), 2, "margin"),
        (("new", "nonsense"), 2, "nonsense"),
        (("tune", "nowhere", "scene.yaml"), 3, "homerehab"),
        (("tune", "homerehab", "absent.yaml"), 3, "absent.yaml"),
        (("identify", "absent.csv"), 3, "absent.csv"),
        (("simulate", "nothing"), 3, "homerehab-clean"),
        (("check", "scene.yaml"), 3, "scene.yaml"),
        (("tune", "homerehab", "scene.yaml", "-o", "no/such/place.yaml"), 7, "no/such"),
    ],
)
def test_exit_codes_and_sentences(haptune, arguments, code: int, words: str) -> None:  # type: ignore[no-untyped-def]
    ended = haptune(*arguments)
    assert ended.code == code, ended.err
    assert words in ended.err


def test_refused_logs_and_hopeless_scenes(haptune, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    rows = "\n".join(f"{k * 0.001:.3f},1.0,{k * 1e-4:.6f}" for k in range(400))
    (tmp_path / "log.csv").write_text(f"time,force,position\n{rows}\n", encoding="utf-8")
    refused = haptune("identify", "log.csv", "--json")
    assert refused.code == 4
    result = json.loads(refused.out)
    assert result["schema"] == "haptune/result/1"
    assert result["exit_code"] == 4
    assert result["findings"][0]["code"] == "constant-column"
    assert set(result["findings"][0]) == {"code", "severity", "seen", "needed", "remedy"}
    (tmp_path / "scene.yaml").write_text(
        SPRING.replace("max", "{min: 20000.0, max: 30000.0}"), encoding="utf-8"
    )
    hopeless = haptune("tune", "homerehab", "scene.yaml")
    assert hopeless.code == 5
    assert not (tmp_path / "profile.yaml").exists()


def test_calibrate_the_bundled_log(haptune, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    log, hardware = bundled("homerehab.csv"), bundled("homerehab.hardware.yaml")
    arguments = ("calibrate", str(log), "--hardware", str(hardware), "--scene", "scene.yaml")
    dry = haptune(*arguments, "--dry-run")
    assert dry.code == 0
    assert not (tmp_path / "profile.yaml").exists()
    done = haptune(*arguments, "--json")
    assert done.code == 0
    assert json.loads(done.out)["outputs"] == ["profile.yaml"]
    again = haptune(*arguments, "--margin", "firm")
    assert again.code == 0
    assert (tmp_path / "profile.yaml.bak").exists()
    assert haptune("check", "profile.yaml", "--quiet").out == ""


def test_interrupted_and_internal_errors(haptune, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    import tune.optimisation

    for error, code in ((KeyboardInterrupt(), 130), (ZeroDivisionError("boom"), 1)):

        def fail(*_: object, error: BaseException = error, **__: object) -> None:
            raise error

        monkeypatch.setattr(tune.optimisation, "optimise", fail)
        assert haptune("tune", "homerehab", "scene.yaml").code == code


def test_a_spring_loads_no_solver(tmp_path: Path) -> None:
    """Commands tune and check in a fresh process each."""
    (tmp_path / "scene.yaml").write_text(SPRING, encoding="utf-8")
    heavy = "('casadi', 'nlopt', 'pysindy', 'scipy.signal')"
    for arguments in (["tune", "homerehab", "scene.yaml"], ["check", "profile.yaml"], ["--help"]):
        code = (
            f"import sys; sys.argv = ['haptune', *{arguments!r}]\n"
            "from tune.cli import main\n"
            "try:\n    main()\nexcept SystemExit as ended:\n    assert not ended.code, ended.code\n"
            f"bad = [name for name in {heavy} if name in sys.modules]\n"
            "sys.exit(', '.join(bad) or 0)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
