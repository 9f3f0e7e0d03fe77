"""One run of a command: what it says, what it writes, how it ends."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification import Finding

EXIT_INTERNAL = 1
EXIT_USAGE = 2
EXIT_INVALID = 3
EXIT_REFUSED = 4
EXIT_NOTHING = 5
EXIT_CHECK = 6
EXIT_NOT_WRITTEN = 7
EXIT_INTERRUPTED = 130

#: Columns where no terminal says how wide it is: tables are as wide as they need to be.
_WIDE = 200

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
        command: its name, "haptune" alone where no command was found.
        as_json: one JSON object on standard output, nothing else.
        quiet: only errors.
        findings: about logs, in the order found.
        outputs: files written.
        details: what a command computed, by name; in the JSON result where there is any.
    """

    command: str
    as_json: bool
    quiet: bool
    findings: list[dict[str, str]] = field(default_factory=list[dict[str, str]])
    outputs: list[str] = field(default_factory=list[str])
    details: dict[str, object] = field(default_factory=dict[str, object])

    def say(self, text: Any) -> None:
        """Print a text or a rich renderable for people."""
        if self.as_json or self.quiet:
            return
        from rich.console import Console

        fixed = sys.stdout.isatty() or "COLUMNS" in os.environ
        console = Console(
            highlight=False, markup=False, emoji=False, width=None if fixed else _WIDE
        )
        with console.capture() as captured:
            console.print(text, soft_wrap=isinstance(text, str))
        _out(captured.get())

    def found(self, findings: tuple[Finding, ...]) -> None:
        """Keep findings for the JSON result and warn on standard error."""
        for finding in findings:
            self.findings.append(_plain(finding))
            if not self.as_json and not self.quiet:
                print(f"{finding.severity}: {finding}", file=sys.stderr)  # noqa: T201

    def target(self, output: Path, *inputs: Path | None) -> None:
        """Refuse, before any work is done, an output that cannot be written or is an input.

        Raises:
            UsageError: the output is one of the inputs.
            NotWrittenError: its folder does not exist, or it is no file itself.
        """
        from identification import NotWrittenError, UsageError

        for given in inputs:
            if given is not None and os.path.realpath(given) == os.path.realpath(output):
                raise UsageError(
                    "--output", f"{output} is one of the inputs", "Choose another name with -o"
                )
        try:
            if not output.parent.is_dir():
                raise NotWrittenError(output, f"there is no folder {output.parent}")
            if output.exists() and not output.is_file():
                raise NotWrittenError(output, "it is a folder or a device, not a file")
        except OSError as error:
            raise NotWrittenError(output, error.strerror or str(error)) from None

    def write(self, path: Path, text: str, *, dry_run: bool = False) -> None:
        """Write a file atomically, keep a backup, show what changed. Raises NotWrittenError."""
        from identification import write_text

        if dry_run:
            self.say(f"dry run: {path} would be written")
            self.say(text)
            return
        before = path.exists()
        difference = write_text(path, text)
        self.outputs.append(str(path))
        if difference:
            self.say(difference)
            self.say(f"{path} written; the file before is {path}.bak")
        else:
            self.say(f"{path} {'unchanged' if before else 'written'}")

    def draw(self, path: Path, figure: Figure) -> None:
        """Write a picture atomically. Raises NotWrittenError."""
        from io import BytesIO

        from identification import write_bytes

        stream = BytesIO()
        picture: Any = figure
        picture.savefig(stream, format="png", dpi=120)
        write_bytes(path, stream.getvalue())
        self.outputs.append(str(path))
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
            result: dict[str, object] = {
                "schema": "haptune/result/1",
                "command": self.command,
                "status": _STATUS[code],
                "exit_code": code,
                "findings": self.findings,
                "outputs": self.outputs,
            }
            if self.details:
                result["details"] = self.details
            if message:
                result["message"] = message
            _out(json.dumps(result) + "\n")
        if message:
            name = "haptune" if self.command == "haptune" else f"haptune {self.command}"
            print(f"{name}: {message}", file=sys.stderr)  # noqa: T201
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
    from tune.documents.errors import CheckFailedError, LoopError, NoFeasibleEffectError

    if isinstance(error, LogRefusedError):
        session.findings += [_plain(finding) for finding in error.findings]
        lines = [f"{finding.severity}: {finding}" for finding in error.findings]
        return session.finish(EXIT_REFUSED, "log refused\n" + "\n".join(lines))
    for kind, code in (
        (UsageError, EXIT_USAGE),
        (InvalidInputError, EXIT_INVALID),
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
    text: str = getattr(error, "format_message", error.__str__)()
    if text.startswith("Usage:"):  # no command was given: the text is the help
        print(text, file=sys.stderr)  # noqa: T201
        return
    sentence = " ".join(text.replace("Value error, ", "").split()).rstrip(".")
    Session(command=command, as_json="--json" in sys.argv, quiet=False).finish(
        EXIT_USAGE, f"{sentence}. See '{path} --help'"
    )


def prepare_streams() -> None:
    """Letters that a terminal cannot show become question marks instead of an error."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # type: ignore[attr-defined]


def _out(text: str) -> None:
    """Write to standard output; a reader that has gone away stops nothing."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _nothing(sentence: str) -> None:
    del sentence
