"""What people write and read: scene, profile, certificate, perception table; errors."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification import Document


class Exit(IntEnum):
    """Exit codes of the contract; their names are the words for them in JSON results."""

    DONE = 0
    INTERNAL_ERROR = 1
    USAGE = 2
    INVALID_INPUT = 3
    LOG_REFUSED = 4
    NO_FEASIBLE_EFFECT = 5
    CHECK_FAILED = 6
    NOT_WRITTEN = 7
    INTERRUPTED = 130  # whichever signal it was: callers have one code to know

    @classmethod
    def of(cls, error: BaseException) -> Exit:
        """What a command ends with for an error: an internal one if nothing foresaw it."""
        from identification import InvalidInputError, LogRefusedError, NotWrittenError, UsageError

        codes: dict[type[BaseException], Exit] = {
            UsageError: cls.USAGE,
            InvalidInputError: cls.INVALID_INPUT,
            LoopError: cls.INVALID_INPUT,
            LogRefusedError: cls.LOG_REFUSED,
            NoFeasibleEffectError: cls.NO_FEASIBLE_EFFECT,
            CheckFailedError: cls.CHECK_FAILED,
            NotWrittenError: cls.NOT_WRITTEN,
        }
        found = (code for kind, code in codes.items() if isinstance(error, kind))
        return getattr(error, "exit_code", None) or next(found, cls.INTERNAL_ERROR)


class TuneError(Exception):
    """Base of every error this package raises on purpose; workers of a pool can hand it on."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Exception.__new__, (type(self), *self.args), self.__dict__


class LoopError(TuneError):
    """A loop that cannot be built from the numbers given."""


class NoFeasibleEffectError(TuneError):
    """Nothing the scene asks for can be rendered safely. Attributes: reasons, one per effect."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        self.reasons = reasons
        super().__init__("no feasible effect: " + "; ".join(reasons))


class CheckFailedError(TuneError):
    """A profile the independent check does not pass.

    Attributes:
        failures: sentences, one for each.
        points: of type `WorstPoint`, where it is unstable; empty where no point was found.
        unproved: combinations of elements that are not proved stable in the whole box.
        spent: all that may be looked at for a proof was, so that more margin would hardly help.
    """

    def __init__(
        self,
        failures: tuple[str, ...],
        points: tuple[Document, ...] = (),
        unproved: tuple[tuple[str, ...], ...] = (),
        *,
        spent: bool = False,
    ) -> None:
        self.failures = failures
        self.points = points
        self.unproved = unproved
        self.spent = spent
        super().__init__("check failed: " + "; ".join(failures))


def refuse_unknown(subject: str, kind: str, given: object, known: Iterable[str]) -> None:
    """Raise UsageError for a name that is none of a kind."""
    from identification import UsageError

    names = tuple(known)
    if given not in names:
        raise UsageError(subject, f"{given!r} is no {kind}", f"Choose from {', '.join(names)}")
