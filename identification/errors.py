"""What identification can refuse, each refusal carrying its numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from inspect import signature
from numbers import Real
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

_Given = ParamSpec("_Given")
_Answer = TypeVar("_Answer")


def printable(text: str) -> str:
    """A text in which no letter steers a terminal or turns writing round: those become escapes."""
    return "".join(
        each if each.isprintable() or each == "\n" else ascii(each)[1:-1] for each in text
    )


def counted(number: object, noun: str) -> str:
    """A number as it is shown with the noun that it counts: 1 row, 2 rows."""
    return f"{number} {noun}{'' if str(number) == '1' else 's'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is wrong, or doubtful, with a log.

    ``code`` is one of `identification.findings.CODES`; ``seen`` and ``needed`` state the value
    found and the value required, with units; ``remedy`` says what to do; ``source`` is the log,
    several with commas; ``at`` are the first and last time, s, of each stretch of the log in which
    it occurs, none where it is of the log as a whole.
    """

    code: str
    severity: Literal["warning", "refusal"] = "warning"
    seen: str
    needed: str
    remedy: str
    source: str = ""
    at: tuple[tuple[float, float], ...] = ()

    def of(self, source: str) -> Finding:
        """This finding about a log, whose name it keeps if it has one."""
        return self if self.source else replace(self, source=source)

    def __str__(self) -> str:
        return f"{self.code}: {self.seen}; needed: {self.needed}. {self.remedy}"


def refusal(
    code: str, *, seen: str, needed: str, remedy: str, at: tuple[tuple[float, float], ...] = ()
) -> Finding:
    """A finding that refuses a log, whatever else is said of it."""
    return Finding(code=code, severity="refusal", seen=seen, needed=needed, remedy=remedy, at=at)


class IdentificationError(Exception):
    """Base of every error this package raises on purpose; workers of a pool can hand it on."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Exception.__new__, (type(self), *self.args), self.__dict__


class _GivenError(IdentificationError):
    """Something that was given and cannot be taken."""

    def __init__(self, subject: str | PathLike[str], problem: str, remedy: str) -> None:
        self.subject = printable(fspath(subject))
        self.problem = printable(problem)
        self.advise(remedy)

    def advise(self, remedy: str) -> None:
        """Say this remedy."""
        self.remedy = printable(remedy)
        stop = "" if self.problem.endswith("?") else "."
        self.args = (f"{self.subject}: {self.problem}{stop} {self.remedy}",)


class InvalidInputError(_GivenError):
    """A file or value that cannot be read or does not make sense.

    Attributes:
        subject: the file or quantity that was rejected.
        problem: what is wrong, with the value seen.
        remedy: what to do about it.
    """


class QuestionError(InvalidInputError):
    """A file that one fact from a person makes readable.

    Attributes:
        question: for that fact.
        option: the field of `LogColumns` that takes it.
        choices: what it may be; none for a number.
        place: of the axis it is of, among several; None of one axis.
    """

    def __init__(
        self,
        subject: str | PathLike[str],
        problem: str,
        remedy: str,
        *,
        question: str,
        option: str,
        choices: Sequence[str] = (),
    ) -> None:
        self.question, self.option, self.choices = question, option, tuple(choices)
        self.place: int | None = None
        super().__init__(subject, problem, remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unstated:
    """One fact of a device that nobody stated.

    Attributes:
        key: in hardware.yaml and device.yaml.
        write: what to write for it, with its unit and an example.
        hint: what a log suggests, which is not used; "" if there is none.
    """

    key: str
    write: str
    hint: str

    def __str__(self) -> str:
        hint = f" (a hint that is not used: {self.hint})" if self.hint else ""
        return f"{self.write}{hint}"


class UnstatedError(InvalidInputError):
    """A question: facts of a device that a person has to state before anything is certified.

    Attributes:
        missing: the facts, all of them.
    """

    def __init__(self, subject: str, missing: tuple[Unstated, ...], where: str) -> None:
        self.missing = missing
        keys = ", ".join(fact.key for fact in missing)
        lines = "".join(f"\n  {fact}" for fact in missing)
        super().__init__(
            subject,
            f"does not state {keys}, without which nothing can be certified",
            f"{where}{lines}",
        )


class UsageError(_GivenError):
    """A request that contradicts itself, such as logs of two axes for one device.

    Attributes:
        subject: the argument at fault.
        problem: what is wrong, with the value seen.
        remedy: what to do about it.
    """


class LogRefusedError(IdentificationError):
    """A readable log from which mass and damping cannot honestly be told.

    Attributes:
        findings: every finding, refusals first.
    """

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        self.findings = tuple(sorted(findings, key=lambda finding: finding.severity != "refusal"))
        super().__init__("\n".join(str(finding) for finding in self.findings))


class NotWrittenError(IdentificationError):
    """A result that could not be stored; the file that stood there before is untouched.

    Attributes:
        path: the file that was to be written.
        reason: the operating system's words.
    """

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(
            f"{path}: not written: {reason}. Choose another place with -o; "
            "what stood there before is untouched."
        )


def refuse(noticed: Sequence[Sequence[Finding]], allow: Collection[str]) -> None:
    """Raise LogRefusedError with all findings where one of them refuses and is not allowed."""
    findings = tuple(finding for found in noticed for finding in found)
    if any(each.severity == "refusal" and each.code not in allow for each in findings):
        raise LogRefusedError(findings)


_FILE, _PROFILE = "the name of a file", "a profile, as load_profile reads it"
#: What verbs take, by the name of its type.
_TAKEN = {
    "Design": _PROFILE,
    "Device": "a device, as load_device reads it",
    "Effects": "Effects(stiffness=..., damping=..., mass=...)",
    "File": _FILE,
    "Hardware": "hardware, as load_document(Hardware, ...) reads it",
    "PathLike[str]": _FILE,
    "SafeProfile": _PROFILE,
    "Scene": "a scene, as load_scene reads it",
    "Trajectory": "a log, as load_trajectory reads it",
    "float": "a number",
}


def typed(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
    """The function, which refuses documents, logs and names of files of another type.

    Types are compared by name: nothing is loaded for it. Sequences are left to the function.

    Raises:
        UsageError: the argument, its type, and what to give.
    """
    given = signature(function).parameters
    wanted: dict[str, tuple[list[str], str]] = {}
    for name, each in given.items():
        kinds = str(each.annotation).split(" | ")
        taken = dict.fromkeys(_TAKEN[kind] for kind in kinds if kind in _TAKEN)
        if taken and "Sequence[" not in str(each.annotation):
            wanted[name] = kinds, " or ".join(taken)

    @wraps(function)
    def validated(*values: _Given.args, **options: _Given.kwargs) -> _Answer:
        for name, value in (*zip(given, values, strict=False), *options.items()):
            if name not in wanted:
                continue
            kinds, taken = wanted[name]
            own = type(value)
            known = {"None" if value is None else each.__name__ for each in own.__mro__}
            known |= {"File", "PathLike[str]"} if isinstance(value, str | PathLike) else set()
            known |= {"float"} if isinstance(value, Real) else set()
            if known.isdisjoint(kinds):
                raise UsageError(name, f"is of type {own.__name__}", f"Give {taken}")
        return function(*values, **options)

    return validated
