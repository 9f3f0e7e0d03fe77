"""One run of a command: what it says, what it writes, how it ends."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification import Finding

EXIT_INTERNAL = 1
EXIT_USAGE = 2
EXIT_INVALID = 3
EXIT_REFUSED = 4
EXIT_NOTHING = 5
EXIT_CHECK = 6
EXIT_NOT_WRITTEN = 7
EXIT_INTERRUPTED = 130

_STATUS = {
    0: "done",
    EXIT_INTERNAL: "internal-error",
    EXIT_USAGE: "usage",
    EXIT_INVALID: "invalid-input",
    EXIT_REFUSED: "log-refused",
    EXIT_NOTHING: "no-feasible-effect",
    EXIT_CHECK: "check-failed",
    EXIT_NOT_WRITTEN: "not-written",
    EXIT_INTERRUPTED: "interrupted",
}


@dataclass(slots=True, kw_only=True)
class Session:
    """What a command collects while it runs.

    Attributes:
        command: its name.
        as_json: one JSON object on standard output, nothing else.
        quiet: only errors.
        findings: about logs, in the order found.
        outputs: files written.
    """

    command: str
    as_json: bool
    quiet: bool
    findings: list[dict[str, str]] = field(default_factory=list[dict[str, str]])
    outputs: list[str] = field(default_factory=list[str])

    def say(self, text: Any) -> None:
        """Print a text or a rich renderable for people."""
        if not (self.as_json or self.quiet):
            from rich.console import Console

            Console(highlight=False, soft_wrap=isinstance(text, str)).print(
                text, markup=not isinstance(text, str)
            )

    def found(self, findings: tuple[Finding, ...]) -> None:
        """Keep findings for the JSON result and warn on standard error."""
        for finding in findings:
            self.findings.append(_plain(finding))
            if not self.as_json and not self.quiet:
                print(f"{finding.severity}: {finding}", file=sys.stderr)  # noqa: T201

    def write(self, path: Path, text: str, *, dry_run: bool = False) -> None:
        """Write a file atomically, keep a backup, show what changed. Raises NotWrittenError."""
        from identification import write_text

        if dry_run:
            self.say(f"dry run: {path} would be written")
            self.say(text)
            return
        difference = write_text(path, text)
        self.outputs.append(str(path))
        if difference:
            self.say(difference)
            self.say(f"{path} written; the file before is {path}.bak")
        else:
            self.say(f"{path} written")

    @contextmanager
    def progress(self) -> Generator[Callable[[str], None]]:
        """A function that shows a sentence while work goes on, on a terminal only."""
        if self.as_json or self.quiet or not sys.stderr.isatty():
            yield _nothing
            return
        from rich.console import Console

        with Console(stderr=True).status("working") as status:
            yield status.update

    def finish(self, code: int, message: str = "") -> int:
        """Print how it ended and return the exit code."""
        if self.as_json:
            result = {
                "schema": "haptune/result/1",
                "command": self.command,
                "status": _STATUS[code],
                "exit_code": code,
                "findings": self.findings,
                "outputs": self.outputs,
            }
            if message:
                result["message"] = message
            print(json.dumps(result))  # noqa: T201
        if message:
            print(f"haptune {self.command}: {message}", file=sys.stderr)  # noqa: T201
        return code


def run_command(
    command: str, action: Callable[[Session], None], *, as_json: bool, quiet: bool
) -> None:
    """Run a command and end the process's work with the contract's exit code.

    Raises:
        typer.Exit: always with the code of what happened.
    """
    import typer

    session = Session(command=command, as_json=as_json, quiet=quiet)
    try:
        action(session)
    except typer.Exit:
        raise
    except KeyboardInterrupt:
        code = session.finish(EXIT_INTERRUPTED, "interrupted; nothing was half-written")
    except Exception as error:  # noqa: BLE001 - no traceback ever reaches a user
        code = _ended(session, error)
    else:
        code = session.finish(0)
    raise typer.Exit(code)


def _ended(session: Session, error: Exception) -> int:
    from identification import InvalidInputError, LogRefusedError, NotWrittenError, UsageError
    from tune.errors import CheckFailedError, LoopError, NoFeasibleEffectError, SceneError

    if isinstance(error, LogRefusedError):
        session.findings += [_plain(finding) for finding in error.findings]
        lines = [f"{finding.severity}: {finding}" for finding in error.findings]
        return session.finish(EXIT_REFUSED, "log refused\n" + "\n".join(lines))
    for kind, code in (
        (UsageError, EXIT_USAGE),
        (InvalidInputError, EXIT_INVALID),
        (SceneError, EXIT_INVALID),
        (LoopError, EXIT_INVALID),
        (NoFeasibleEffectError, EXIT_NOTHING),
        (CheckFailedError, EXIT_CHECK),
        (NotWrittenError, EXIT_NOT_WRITTEN),
    ):
        if isinstance(error, kind):
            return session.finish(code, str(error))
    return session.finish(
        EXIT_INTERNAL,
        f"internal error: {type(error).__name__}: {error}. Nothing was written after it. "
        "Please report it with the command and the files",
    )


def _plain(finding: Finding) -> dict[str, str]:
    return {
        "code": finding.code,
        "severity": finding.severity,
        "seen": finding.seen,
        "needed": finding.needed,
        "remedy": finding.remedy,
    }


def report_usage(error: Exception) -> None:
    """A usage error in one line, as JSON too where that was asked for."""
    context: Any = getattr(error, "ctx", None)
    command = getattr(context, "info_name", None) or "haptune"
    path = getattr(context, "command_path", "haptune")
    text = error.format_message() if hasattr(error, "format_message") else str(error)  # type: ignore[attr-defined]
    Session(command=command, as_json="--json" in sys.argv, quiet=False).finish(
        EXIT_USAGE, f"{text} (see '{path} --help')"
    )


def _nothing(sentence: str) -> None:
    del sentence
