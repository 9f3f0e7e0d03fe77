"""Commands run in this process as a shell would run them."""

import contextlib
import functools
import hashlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from unittest import mock

import typer.main

import tune
from datasets_synthetic import bundled_path
from tune.cli.app import run_app

#: The quickest scene there is: no filter is chosen, and a fluid settles at once in rehearsal.
FLUID = "elements: {water: {damping: 10.0}}\nloop: {velocity_filter_hz: 50.0}\n"
#: The JSON Schemas that are shipped.
SCHEMAS = Path(tune.__file__).parent / "schemas"
#: What --json prints, whatever happens; a message and details are added where there are any.
RESULT_KEYS = {"schema", "command", "status", "exit_code", "findings", "outputs"}
#: A process builds its commands once; here they stay from one call to the next.
_COMMAND = functools.cache(typer.main.get_command)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a command ended: its exit code and all that it printed."""

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        """The one JSON object on standard output; anything else there is an error."""
        found: dict[str, Any] = json.loads(self.out)
        assert self.out.count("\n") == 1
        assert RESULT_KEYS <= set(found) <= RESULT_KEYS | {"message", "details"}
        assert found["schema"] == "haptune/result/1"
        assert found["exit_code"] == self.code
        return found


def haptune(*arguments: str, **environment: str) -> Ended:
    """Run ``haptune ARGUMENTS`` in the current folder, as into a pipe."""
    # pytest-xdist states a width in COLUMNS, which is its own affair.
    inherited = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.dict(os.environ, inherited | environment, clear=True),
        mock.patch("typer.main.get_command", _COMMAND),
        mock.patch.object(sys, "argv", ["haptune", *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            run_app()
        except SystemExit as ended:
            code = ended.code
        else:
            raise AssertionError("a command always exits")
    assert isinstance(code, int)
    assert "Traceback" not in err.getvalue()
    return Ended(code=code, out=out.getvalue(), err=err.getvalue())


def log_text(samples: int = 400, force: str = "") -> str:
    """A small log as CSV; every force is ``force`` where one is given."""
    rows = [
        f"{0.001 * k:.3f},{force or (k * 7) % 13 - 6},{1e-5 * ((k * k) % 97):.6f}"
        for k in range(samples)
    ]
    return "\n".join(["time,force,position", *rows]) + "\n"


def bundled_log(samples: int = 2000, names: str = "time,force,position") -> str:
    """The first samples of the log of HomeRehab as CSV, under these names."""
    rows = bundled_path("homerehab.csv").read_text(encoding="utf-8").splitlines()
    return "\n".join([names, *rows[1 : samples + 1], ""])


def failing(error: BaseException) -> Callable[..., NoReturn]:
    """What ends with an error, whatever it is called with."""

    def fail(*_: object, **__: object) -> NoReturn:
        raise error

    return fail


#: No space is left: what a full disk answers.
FULL = OSError(28, "No space left on device")


def files() -> set[str]:
    """Names of everything in the current folder."""
    return {path.name for path in Path().iterdir()}


def form(*arguments: str) -> str:
    """What ``haptune new`` writes for these arguments."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "form.yaml"
        ended = haptune("new", *arguments, "-o", str(path), "--quiet")
        assert ended.code == 0, ended.err
        return path.read_text(encoding="utf-8")


def digest_of(content: Mapping[str, Any]) -> str:
    """The digest of a profile as documented: sha256 of its JSON, keys in order, without itself."""
    rest = {key: value for key, value in content.items() if key != "digest"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return "sha256:" + hashlib.sha256(text.encode()).hexdigest()
