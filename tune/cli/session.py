"""One run of a command: what it says, what it writes, how it ends.

One file: one run of a command from its first line to its exit code.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from tune.cli.details import finite
from tune.cli.exit_codes import (
    EXIT_CHECK,
    EXIT_INTERNAL,
    EXIT_INTERRUPTED,
    EXIT_INVALID,
    EXIT_NOT_WRITTEN,
    EXIT_NOTHING,
    EXIT_REFUSED,
    EXIT_USAGE,
    STATUS,
)
from tune.cli.interruption import FilesWhole, ignore_signals, was_interrupted
from tune.cli.ownership import owner_of
from tune.cli.streams import delivery_failure, wrap_text

if TYPE_CHECKING:
    from identification import Finding

#: Columns where no terminal says how wide it is: tables are as wide as they need to be.
_WIDE = 200

_Result = TypeVar("_Result")


@dataclass(slots=True, kw_only=True)
class Session:
    """What a command collects while it runs.

    Attributes:
        command: its name, "haptune" alone where no command was found.
        as_json: one JSON object on standard output, nothing else.
        quiet: only errors.
        findings: about logs, in the order found.
        targets: files that are to be written.
        outputs: files written.
        details: what a command computed, by name; in the JSON result where there is any.
        understood: by log, how one that is no plain table in SI units was read.
    """

    command: str
    as_json: bool
    quiet: bool
    findings: list[dict[str, str]] = field(default_factory=list[dict[str, str]])
    targets: list[str] = field(default_factory=list[str])
    outputs: list[str] = field(default_factory=list[str])
    details: dict[str, object] = field(default_factory=dict[str, object])
    understood: dict[str, str] = field(default_factory=dict[str, str])

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
        printed = captured.get()
        if not isinstance(text, str):  # tables are padded to their width
            printed = "".join(f"{line.rstrip()}\n" for line in printed.splitlines())
        sys.stdout.write(printed)
        sys.stdout.flush()

    def add_findings(self, findings: tuple[Finding, ...]) -> None:
        """Keep findings for the JSON result and warn on standard error."""
        for finding in findings:
            self.findings.append(asdict(finding))
            if not self.as_json and not self.quiet:
                _print_error(f"{finding.severity}: {finding}")

    def warn(self, sentence: str) -> None:
        """Print on standard error what a person should know before the output is used."""
        if not self.as_json and not self.quiet:
            _print_error(f"warning: {sentence}")

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
        self.targets.append(str(output))

    def write(self, path: Path, text: str, *, dry_run: bool = False) -> None:
        """Write a file atomically, keep a backup, show what changed. Raises NotWrittenError."""
        if dry_run:
            self.say(f"dry run: {path} would be written")
            self.say(text)
            return
        from identification import difference_of, write_text

        before = path.exists()
        replaced = self._store(path, lambda: write_text(path, text))
        if replaced is not None:
            self.say(difference_of(path, replaced, text))
            self.say(f"{path} written; the file before is {replaced.backup.name}")
        else:
            self.say(f"{path} {'unchanged' if before else 'written'}")

    def store(self, path: Path, content: bytes) -> None:
        """Write a file that nobody reads as text atomically. Raises NotWrittenError."""
        from identification import write_bytes

        self._store(path, lambda: write_bytes(path, content))
        self.say(f"{path} written")

    def _store(self, path: Path, store: Callable[[], _Result]) -> _Result:
        """Write a file and note it as written, both or neither; tell if it changed hands."""
        before = owner_of(path)
        with FilesWhole():
            stored = store()
            self.outputs.append(str(path))
        now = owner_of(path)
        if before not in {None, now} and not self.quiet:
            _print_error(
                f"warning: {path} belongs to {now} now and belonged to {before} before, which this "
                "user may not keep"
            )
        return stored

    @contextmanager
    def progress(self) -> Generator[Callable[[str], None]]:
        """A function that is told each stage of the work, which a terminal shows with its clock."""
        if self.as_json or self.quiet or not sys.stderr.isatty():
            yield _ignore_stage
            return
        from tune.cli.progress import show_stages

        with show_stages() as say:
            yield say

    def finish(self, code: int, message: str = "") -> int:
        """Print how it ended and return the exit code."""
        if self.as_json:
            result: dict[str, object] = {
                "schema": "haptune/result/1",
                "command": self.command,
                "status": STATUS[code],
                "exit_code": code,
                "findings": self.findings,
                "outputs": self.outputs,
            }
            if self.details:
                result["details"] = self.details
            if message:
                result["message"] = message
            print(json.dumps(finite(result), allow_nan=False), flush=True)  # noqa: T201
        if message:
            self._complain(message)
        return self.delivery_exit_code() if code == 0 else code

    def delivery_exit_code(self) -> int:
        """The exit code of a command that did all it should, if what it printed was taken too."""
        reason = delivery_failure()
        if not reason:
            return 0
        self._complain(
            f"standard output: not written: {reason}; {self.whereabouts()}. Print to another "
            "place, or use --quiet where nothing need be printed"
        )
        return EXIT_NOT_WRITTEN

    def whereabouts(self) -> str:
        """Which files were written and which were not."""
        left = [target for target in self.targets if target not in self.outputs]
        if not self.outputs:
            return "no file was written"
        written = f"written: {', '.join(self.outputs)}"
        return f"{written}; not written: {', '.join(left)}" if left else written

    def _complain(self, message: str) -> None:
        name = "haptune" if self.command == "haptune" else f"haptune {self.command}"
        _print_error(f"{name}: {message}")


def _print_error(text: str) -> None:
    print(wrap_text(text, sys.stderr), file=sys.stderr)  # noqa: T201


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
        ignore_signals()
    except typer.Exit:
        raise
    except BaseException as error:  # noqa: BLE001 - no traceback ever reaches a user
        interrupted = was_interrupted() or isinstance(error, KeyboardInterrupt)
        code = _end_interrupted(session) if interrupted else _end_failed(session, error)
    else:
        code = session.finish(0)
    raise typer.Exit(code)


def finish_interrupted() -> int:
    """Print that a signal came before a command began or after it ended; return the exit code."""
    return _end_interrupted(Session(command="haptune", as_json="--json" in sys.argv, quiet=False))


def _end_interrupted(session: Session) -> int:
    ignore_signals()
    return session.finish(EXIT_INTERRUPTED, f"interrupted; {session.whereabouts()}")


def _end_failed(session: Session, error: BaseException) -> int:
    """Print why a command failed and return its exit code."""
    ignore_signals()
    from identification import (
        InvalidInputError,
        LogRefusedError,
        NotWrittenError,
        UnstatedError,
        UsageError,
    )
    from tune.documents.errors import CheckFailedError, LoopError, NoFeasibleEffectError

    if isinstance(error, LogRefusedError):
        session.findings += [asdict(finding) for finding in error.findings]
        lines = [f"{finding.severity}: {finding}" for finding in error.findings]
        return session.finish(EXIT_REFUSED, "log refused\n" + "\n".join(lines))
    if isinstance(error, NotWrittenError):
        others = f" Of all files, {session.whereabouts()}." if session.outputs else ""
        return session.finish(EXIT_NOT_WRITTEN, f"{error}{others}")
    if isinstance(error, CheckFailedError) and len(error.failures) > 1:
        return session.finish(EXIT_CHECK, "\n".join(("check failed", *error.failures)))
    if isinstance(error, UnstatedError):
        session.details["missing"] = [asdict(fact) for fact in error.missing]
    for kind, code in (
        (UsageError, EXIT_USAGE),
        (InvalidInputError, EXIT_INVALID),
        (LoopError, EXIT_INVALID),
        (NoFeasibleEffectError, EXIT_NOTHING),
        (CheckFailedError, EXIT_CHECK),
    ):
        if isinstance(error, kind):
            return session.finish(code, str(error))
    return session.finish(
        EXIT_INTERNAL,
        f"internal error: {type(error).__name__}: {error}; {session.whereabouts()}. "
        "Please report it with the command and the files",
    )


def _ignore_stage(_: str) -> None: ...
