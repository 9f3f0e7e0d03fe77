"""One run of a command: its options, what it says, how far it is, what it writes, how it ends."""

from __future__ import annotations

import inspect
import json
import os
import re
import sys
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache, partial, wraps
from pathlib import Path
from select import select
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_args, get_type_hints

from typer import Argument, Option
from typer.models import ArgumentInfo

import identification as ident
from identification import (
    LogRefusedError,
    Method,
    NotWrittenError,
    UnstatedError,
    UsageError,
    printable,
)
from tune.cli.process import (
    UninterruptedWrites,
    delivery_failure,
    ignore_signals,
    was_interrupted,
    wrap_text,
)
from tune.documents import CheckFailedError, Exit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification import Finding, LogColumns, Replaced


#: Columns where no terminal says how wide it is: tables are as wide as they need to be.
_WIDE = 200
#: Letters of a word that a table never breaks.
_LONG = 14
#: Kinds of picture beside PNG, by the ending of the file.
_VECTORS = {".svg": "svg", ".pdf": "pdf"}
#: Counted parts of the work end a sentence so, which is what an estimate is made of.
_COUNT = re.compile(r"\((\d+) of (\d+)\)$")
#: What options take, by the name of the type, as help shows it.
_WORDS = {"Path": "FILE", "str": "NAME", "int": "N", "float": "X"}
#: Less than this needs no clock, s.
_SHORT = 1.0


def refuse_standard_output(output: Path) -> None:
    """Raise UsageError for "-", by which other programs mean the standard output."""
    if str(output) == "-":
        seen = "nothing is written to the standard output"
        raise UsageError("--output", seen, "Give another name with -o")


@dataclass(slots=True, kw_only=True)
class Session:
    """What a command collects while it runs.

    Its name is "haptune" alone where no command was found; with ``as_json`` one JSON object stands
    on standard output and nothing else; files are targets that are to be written, and outputs once
    they are; ``so_far`` says what is stored before there is any; details are what it computed, by
    name; understood tells of logs that are no plain tables in SI units how they were read.
    """

    command: str
    as_json: bool
    quiet: bool
    verbose: bool = False
    no_input: bool = False
    findings: list[Finding] = field(default_factory=list["Finding"])
    targets: list[str] = field(default_factory=list[str])
    outputs: list[str] = field(default_factory=list[str])
    so_far: str = "no file was written"
    details: dict[str, object] = field(default_factory=dict[str, object])
    understood: dict[str, str] = field(default_factory=dict[str, str])
    logs: int = 0

    def say(self, text: Any) -> None:
        """Print a text, or a table: its rows in words where side by side they would be broken."""
        if self.as_json or self.quiet:
            return
        if isinstance(text, str):
            print(wrap_text(printable(text), sys.stdout), flush=True)  # noqa: T201
            return
        from rich.console import Console

        from tune.presentation.tables import rows_in_words

        fixed = sys.stdout.isatty() or "COLUMNS" in os.environ
        width = None if fixed else _WIDE
        console = Console(highlight=False, markup=False, emoji=False, width=width)
        printed, words = "", rows_in_words(text)
        for shape in (text, words):
            if not _short_words(words) <= _short_words(printed):
                with console.capture() as captured:
                    console.print(shape)
                printed = captured.get()
        lines = printed.splitlines()  # tables are padded to their width
        print("\n".join(line.rstrip() for line in lines), flush=True)  # noqa: T201

    def say_each(self, texts: Iterable[str]) -> None:
        """Print texts for people, each on lines of its own."""
        for text in texts:
            self.say(text)

    def detail(self, *texts: str) -> None:
        """Print texts for who asks for everything (``--verbose``)."""
        if self.verbose:
            self.say_each(texts)

    @property
    def asks(self) -> bool:
        """Whether a person at a terminal can be asked."""
        silent = self.as_json or self.quiet or self.no_input
        return not silent and sys.stdin.isatty() and sys.stderr.isatty()

    def tell(self, text: str) -> None:
        """Print on standard error what a question is about."""
        _print_error(text)

    def ask(self, question: str) -> str:
        """A line that a person types; "" where there is none, or no more input."""
        sys.stderr.write(f"{printable(question)}: ")
        sys.stderr.flush()
        while os.name == "posix" and sys.stdin.isatty() and not select([0], [], [], 0.1)[0]:
            pass  # Ctrl-C may wait for the end of a read: none is begun before there is a line
        return sys.stdin.readline().strip()

    def add_findings(self, findings: tuple[Finding, ...], *, quiet: bool | None = None) -> None:
        """Keep findings for the JSON result and warn on standard error, unless that is quiet."""
        self.findings += findings
        if not self.as_json and not (self.quiet if quiet is None else quiet):
            for finding in findings:
                _print_error(self.in_words(finding))

    def in_words(self, finding: Finding) -> str:
        """A finding with its log, or axis of a log, where that leaves open which is meant."""
        source, words = finding.source, f"{finding.severity}: {finding}"
        one_of_many = ", axis " in source or source.count(", ") + 1 < self.logs
        if not source or source in finding.seen or not one_of_many:
            return words
        return f"{finding.severity}: {replace(finding, seen=f'{source}: {finding.seen}')}"

    def warn(self, sentence: str) -> None:
        """Print on standard error what a person should know before the output is used."""
        if not self.as_json and not self.quiet:
            _print_error(f"warning: {sentence}")

    def target(self, output: Path | None, *inputs: Path | None) -> None:
        """Refuse, before any work is done, an output that cannot be written or is an input."""
        if output is None:
            return
        refuse_standard_output(output)
        for given in inputs:
            if given is not None and os.path.realpath(given) == os.path.realpath(output):
                seen = f"{output} is one of the inputs"
                raise UsageError("--output", seen, "Choose another name with -o")
        try:
            if not output.parent.is_dir():
                raise NotWrittenError(output, f"there is no folder {output.parent}")
            if output.exists() and not output.is_file():
                raise NotWrittenError(output, "it is a folder or a device, not a file")
        except OSError as error:
            raise NotWrittenError(output, error.strerror or str(error)) from None
        self.targets.append(str(output))

    def write(self, path: Path, text: str, *, dry_run: bool = False, changes: str = "") -> None:
        """Write a file atomically, keep a backup, show what changed. Raises NotWrittenError.

        ``changes`` tell it in words; without them, and where everything is said, lines do.
        """
        self.write_together({path: text}, dry_run=dry_run, changes=changes)

    def write_together(
        self, texts: Mapping[Path, str], *, dry_run: bool = False, changes: str = ""
    ) -> None:
        """Write files that belong together, as `write` does: all, or none if NotWrittenError."""
        if dry_run:
            for path, text in texts.items():
                self.say(f"dry run: {path} would be written")
                self.say(text)
            return
        before = {path: path.exists() for path in texts}
        replaced = self._store({path: text.encode() for path, text in texts.items()})
        for path, text in texts.items():
            if path in replaced:
                lines = ident.difference_of(path, replaced[path], text)
                self.say(lines if self.verbose or not changes else changes)
                self.say(f"{path} written; the file before is {replaced[path].backup.name}")
            else:
                self.say(f"{path} {'unchanged' if before[path] else 'written'}")

    def store(self, path: Path, content: bytes) -> None:
        """Write a file that nobody reads as text. Raises NotWrittenError."""
        self._store({path: content})
        self.say(f"{path} written")

    def draw(self, path: Path | None, figure: Callable[[], Figure]) -> None:
        """Draw a picture and write it, PNG but for .svg and .pdf; None is none wanted."""
        from io import BytesIO

        if path is None:
            return
        stream = BytesIO()
        with self.progress("drawing"):
            picture = cast("Any", figure())
        picture.savefig(stream, format=_VECTORS.get(path.suffix.lower(), "png"), dpi=120)
        self.store(path, stream.getvalue())

    def _store(self, contents: Mapping[Path, bytes]) -> dict[Path, Replaced]:
        """Write files and note them as written, all or none; tell if they changed hands."""
        owners = {path: _owner_of(path) for path in contents}
        with UninterruptedWrites():
            replaced = ident.write_files(contents)
            self.outputs += map(str, contents)
        for path, before in owners.items():
            now = _owner_of(path)
            if before not in {None, now} and not self.quiet:
                belongs = f"belongs to {now} now and belonged to {before} before"
                _print_error(f"warning: {path} {belongs}, which this user may not keep")
        return replaced

    @contextmanager
    def progress(self, first: str = "") -> Generator[Callable[[str], None]]:
        """A function that is told each stage of the work, which a terminal shows with its clock.

        To a program that sets HAPTUNE_STAGES each is a line on standard error.
        """
        say = stage = Stage()
        shown: AbstractContextManager[object] = nullcontext()
        if "HAPTUNE_STAGES" in os.environ:
            say = partial(print, file=sys.stderr, flush=True)
        elif not self.as_json and not self.quiet and sys.stderr.isatty():
            from rich.console import Console

            shown = Console(stderr=True, markup=False, highlight=False).status(stage)
        with shown:
            if first:
                say(first)
            yield say

    def finish(self, code: Exit, message: str = "") -> int:
        """Print how it ended and return the exit code."""
        if self.as_json:
            from pydantic_core import to_json

            result: dict[str, object] = {
                "schema": "haptune/result/1",
                "command": self.command,
                "status": code.name.lower().replace("_", "-"),
                "exit_code": code,
                "findings": self.findings,
                "outputs": self.outputs,
            }
            if self.details:
                result["details"] = self.details
            if message:
                result["message"] = printable(message)
            plain = json.loads(to_json(result, inf_nan_mode="null"))  # what is not finite is null
            print(json.dumps(plain), flush=True)  # noqa: T201
        if message:
            self._complain(message)
        return code or self.delivery_exit_code()

    def delivery_exit_code(self) -> int:
        """The exit code of a command that did all it should, if what it printed was taken too."""
        reason = delivery_failure()
        if not reason:
            return 0
        remedy = "Print to another place, or use --quiet where nothing need be printed"
        self._complain(f"standard output: not written: {reason}; {self.files_written()}. {remedy}")
        return Exit.NOT_WRITTEN

    def files_written(self) -> str:
        """Which files were written and which were not."""
        left = [target for target in self.targets if target not in self.outputs]
        if not self.outputs:
            return self.so_far
        written = f"written: {', '.join(self.outputs)}"
        return f"{written}; not written: {', '.join(left)}" if left else written

    def _complain(self, message: str) -> None:
        name = "haptune" if self.command == "haptune" else f"haptune {self.command}"
        _print_error(f"{name}: {message}")


def _short_words(text: str) -> set[str]:
    """Words that no table may break; longer ones are names."""
    words = {word.strip("-,:") for word in text.split()}
    return {word for word in words if 0 < len(word) <= _LONG}


def _print_error(text: str) -> None:
    print(wrap_text(printable(text), sys.stderr), file=sys.stderr)  # noqa: T201


def run_command(session: Session, action: Callable[[Session], None]) -> None:
    """Run a command; raises typer.Exit always, with the contract's code of what happened."""
    import typer

    try:
        action(session)
        ignore_signals()
    except typer.Exit:
        raise
    except BaseException as error:  # noqa: BLE001 - no traceback ever reaches a user
        interrupted = was_interrupted() or isinstance(error, KeyboardInterrupt)
        code = _end_interrupted(session) if interrupted else _end_failed(session, error)
    else:
        code = session.finish(Exit.DONE)
    raise typer.Exit(code)


def finish_interrupted() -> int:
    """Say that a signal came before a command began or after it ended; return the exit code."""
    return _end_interrupted(Session(command="haptune", as_json="--json" in sys.argv, quiet=False))


def _end_interrupted(session: Session) -> int:
    ignore_signals()
    return session.finish(Exit.INTERRUPTED, f"interrupted; {session.files_written()}")


def _end_failed(session: Session, error: BaseException) -> int:
    ignore_signals()

    if isinstance(error, LogRefusedError):
        session.findings += error.findings
        lines = [session.in_words(finding) for finding in error.findings]
        return session.finish(Exit.LOG_REFUSED, "log refused\n" + "\n".join(lines))
    if isinstance(error, NotWrittenError):
        others = f" Of all files, {session.files_written()}." if session.outputs else ""
        return session.finish(Exit.NOT_WRITTEN, f"{error}{others}")
    if isinstance(error, CheckFailedError) and len(error.failures) > 1:
        return session.finish(Exit.CHECK_FAILED, "\n".join(("check failed", *error.failures)))
    if isinstance(error, UnstatedError):
        session.details["missing"] = error.missing
    code = Exit.of(error)
    if code is not Exit.INTERNAL_ERROR:
        return session.finish(code, str(error))
    seen = f"{type(error).__name__}: {error}; {session.files_written()}"
    words = f"internal error: {seen}. Please report it with the command and the files"
    return session.finish(Exit.INTERNAL_ERROR, words)


def _owner_of(path: Path) -> str | None:
    """Owner and group of a file by number; None where there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return f"user {status.st_uid}, group {status.st_gid}"


class Stage:
    """The sentence of the work in hand with its clock; read anew whenever it is drawn."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._sentence = "working"
        self._began = self._said = self._counting = clock()
        self._first = self._part = self._parts = 0

    def __call__(self, sentence: str) -> None:
        """Go on to another stage; "... (3 of 7)" begins the third of seven parts alike."""
        now = self._clock()
        counted = _COUNT.search(sentence)
        part, parts = (int(each) for each in counted.groups()) if counted else (0, 0)
        if parts != self._parts or part <= self._part:
            self._first, self._counting = part, now
        self._part, self._parts = part, parts
        self._sentence, self._said = sentence, now

    def __rich__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        """The sentence, seconds since the work began, and seconds that are left of the parts."""
        now = self._clock()
        text = self._sentence
        if now - self._began >= _SHORT:
            text += f", {now - self._began:.0f} s"
        done = self._part - self._first
        if done > 0:
            mean = (self._said - self._counting) / done
            left = (self._parts - self._part + 1) * mean - (now - self._said)
            text += f", about {max(left, 1.0):.0f} s more" if mean else ""
        return text


Logs = Annotated[
    list[Path], Argument(help="Logs: CSV or other text, Parquet, MAT, NPZ, Excel or MCAP.")
]
HardwareFile = Annotated[
    Path | None,
    Option("--hardware", metavar="FILE", help="hardware.yaml: what is known beforehand."),
]
Allow = Annotated[
    list[str] | None,
    Option("--allow", metavar="CODE", help="Accept this finding about the log; it is recorded."),
]
MethodOption = Annotated[Method, Option(help="Estimator.")]
MarginOption = Annotated[
    Literal["conservative", "balanced", "firm"] | None,
    Option(help="Margin; default that of the scene or profile, else balanced."),
]
Candidates = Annotated[
    bool,
    Option("--candidates", help="Show all margins, more stiffness and more mass side by side."),
]
WhatIf = Annotated[
    bool,
    Option(
        "--what-if",
        help="Also tune with half the delay, twice the sample rate, a finer encoder and so on: "
        "what each fact of the hardware costs in perceived steps.",
    ),
]
Picture = Annotated[
    Path | None, Option("--picture", metavar="FILE", help="Where to draw it (PNG, SVG or PDF).")
]
DryRun = Annotated[bool, Option("--dry-run", help="Show what would be written.")]
_Json = Annotated[bool, Option("--json", help="One JSON object on standard output.")]
_Quiet = Annotated[bool, Option("--quiet", help="Only errors.")]
_NoInput = Annotated[bool, Option("--no-input", help="Ask nothing, also on a terminal.")]
_Verbose = Annotated[bool, Option("--verbose", help="Everything that was found and proved.")]
DeviceOut = Annotated[Path, Option("-o", "--output", help="Where to write the device.")]
ProfileOut = Annotated[Path, Option("-o", "--output", help="Where to write the profile.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """What a person says of the columns of a log; each field is an option of the command."""

    time: Annotated[str, Option(metavar="COL", help="Column of time, in seconds.")] = "time"
    force: Annotated[
        str,
        Option(metavar="COL", help="Column of the actuator's force; of several axes with commas."),
    ] = "force"
    position: Annotated[
        str, Option(metavar="COL", help="Column of position; of several axes with commas.")
    ] = "position"
    reference: Annotated[
        str | None, Option(metavar="COL", help="Column of the set-point, if logged.")
    ] = None
    time_gain: Annotated[
        float | None, Option(metavar="X", help="s per unit of the time column.")
    ] = None
    force_gain: Annotated[
        str | None,
        Option(
            metavar="X",
            help="N (N·m) per unit of the force column: per ampere torque constant and "
            "transmission; 1 states that it is in N (N·m); of several axes one, or one for each "
            "with commas.",
        ),
    ] = None
    position_gain: Annotated[
        str | None,
        Option(
            metavar="X",
            help="m (rad) per unit of the position column; 1 states that it is in m (rad); of "
            "several axes one, or one for each with commas.",
        ),
    ] = None
    axis: Annotated[
        str | None, Option(metavar="NAME", help="Name of the axis; default from the hardware.")
    ] = None
    decimal: Annotated[
        Literal["comma", "point"] | None, Option(help="What stands before decimals in a text file.")
    ] = None

    def columns(self) -> LogColumns:
        """What the readers of logs take. Raises UsageError or InvalidInputError for no gain."""
        given: dict[str, Any] = asdict(self)
        for role in ("force", "position"):
            given[f"{role}_gain"] = _gains(f"--{role}-gain", given[f"{role}_gain"])
        return ident.LogColumns(**given)


def _gains(option: str, text: str | None) -> float | tuple[float | None, ...] | None:
    """One number, or those of axes between commas, some of them blank. Raises UsageError."""
    if text is None:
        return None
    try:
        numbers = [float(each) if each.strip() else None for each in text.split(",")]
    except ValueError:
        numbers = [None]
    if numbers == [None]:
        remedy = "Give one, or one for each axis between commas, as in 1,2"
        raise UsageError(option, f"'{text}' is no number", remedy)
    return tuple(numbers) if len(numbers) > 1 else numbers[0]


def command(
    *, without: Collection[str] = (), asks: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command as typer reads it, made of a function ``name_command`` with its session.

    It offers ``--json``, ``--quiet`` and ``--verbose``, and in the place of ``options``, a
    LogOptions, an option for each field but those it goes without; one that ``asks`` offers
    ``--no-input``.
    """

    def offering(body: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(body, eval_str=True)
        common = [each for each in _log_options() if each.name not in without]
        reads_logs = "options" in own.parameters
        offered: list[inspect.Parameter] = []
        for name, parameter in own.parameters.items():
            if name == "options":
                offered += common
            elif name != "session":
                offered.append(_in_words(parameter))
        flags = {"json": _Json, "quiet": _Quiet, "verbose": _Verbose}
        flags |= {"no_input": _NoInput} if asks else {}
        offered += [_keyword(name, kind, default=False) for name, kind in flags.items()]

        @wraps(body)
        def run(**given: Any) -> None:
            session = Session(
                command=body.__name__.removesuffix("_command"),
                as_json=given.pop("json"),
                quiet=given.pop("quiet"),
                verbose=given.pop("verbose"),
                no_input=given.pop("no_input", False),
                logs=len(given.get("logs") or ()),
            )
            if reads_logs:
                given["options"] = LogOptions(
                    **{each.name: given.pop(each.name) for each in common}
                )
            run_command(session, lambda session: body(session, **given))

        run.__dict__["__signature__"] = own.replace(parameters=offered)  # read by typer
        return run

    return offering


def _in_words(parameter: inspect.Parameter) -> inspect.Parameter:
    """A parameter whose help shows a word for what it takes, where none was chosen."""
    kind, *told = get_args(parameter.annotation)
    if "Literal" in str(kind) or kind is bool:
        return parameter  # its choices are the words; a flag takes nothing
    name = parameter.name.upper().removesuffix("S" if "list[" in str(kind) else "")
    word = next((word for type_, word in _WORDS.items() if type_ in str(kind)), name)
    for each in told:
        if each.metavar is None:
            each.metavar = name if isinstance(each, ArgumentInfo) else word
    return parameter


@cache
def _log_options() -> list[inspect.Parameter]:
    types = get_type_hints(LogOptions, include_extras=True)
    return [
        _keyword(each.name, types[each.name], default=each.default) for each in fields(LogOptions)
    ]


def _keyword(name: str, annotation: object, *, default: object) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)
